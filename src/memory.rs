//! Memory that the machine and its limits leave to this process, and checks that work fits into it.
//!
//! An allocation that fails aborts a Rust program, and one that Linux cannot back may end any
//! program of the machine. Work that takes much memory is therefore estimated and compared with the
//! available memory before it begins. Four limits are read where Linux shows them: the available
//! memory of the machine, the control groups of the process (both versions), and the process's own
//! limits on its address space (`ulimit -v`) and data (`ulimit -d`). On other systems nothing is
//! known, and nothing is refused.

use crate::error::{Error, Result};
use std::fs;
use std::path::{Path, PathBuf};

/// Available memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// Available memory, in bytes.
    pub bytes: u64,
    /// Name of the limit that is the tightest.
    pub limit: &'static str,
}

/// Size of work, in bytes, below which the limits are not read.
const SMALL: u64 = 1 << 20;

/// Memory kept free for small things that are not estimated (buffers, texts, pictures), in bytes.
const RESERVE: u64 = 1 << 25;

/// Checks at the start that some memory is left.
///
/// # Errors
/// Returns [`Error::Memory`] where hardly any is left.
pub fn require_some() -> Result<()> {
    require(SMALL, "any work at all", |_| "free some memory or raise the limit".into())
}

/// Returns the memory left to this process if `processes` processes of the machine share what they
/// have in common. `None` where the system does not tell.
pub fn room(processes: usize) -> Option<Room> {
    room_of(&Sources::system(), processes as u64)
}

/// Returns whether work takes less than a quarter of the memory that is left, as far as the system
/// tells. Small work always does.
pub fn is_plenty_for(bytes: u64) -> bool {
    bytes < SMALL || room(1).is_none_or(|room| bytes < room.bytes / 4)
}

/// Checks that work fits into the memory that is left.
///
/// # Errors
/// Returns [`Error::Memory`] with both figures where it does not. `fits` turns the share of the
/// work that would fit into advice.
pub fn require(bytes: u64, what: &str, fits: impl FnOnce(f64) -> String) -> Result<()> {
    require_of_each(bytes, 1, what, fits)
}

/// Checks like [`require`], where several processes of the machine take as much each.
///
/// # Errors
/// Returns the errors of [`require`].
pub fn require_of_each(
    bytes: u64,
    processes: usize,
    what: &str,
    fits: impl FnOnce(f64) -> String,
) -> Result<()> {
    if bytes < SMALL {
        return Ok(());
    }
    let room_left = room(processes).map(|room| Room { bytes: room.bytes.saturating_sub(RESERVE), ..room });
    match room_left {
        Some(room) if bytes > room.bytes => Err(Error::Memory(format!(
            "{what} takes about {} of memory, and {} leaves {}; {}",
            size(bytes),
            room.limit,
            size(room.bytes),
            fits(room.bytes as f64 / bytes as f64)
        ))),
        _ => Ok(()),
    }
}

/// Returns the number of processes that an MPI launcher (Open MPI or MPICH) has started.
pub fn processes() -> usize {
    told(["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"])
}

/// Returns the number of these processes on this machine.
pub fn processes_here() -> usize {
    told(["OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS"])
}

fn told(names: [&str; 2]) -> usize {
    names.iter().find_map(|name| std::env::var(name).ok()?.parse().ok()).unwrap_or(1)
}

/// Formats a number of bytes with two or three digits: `930 MB`, `12.4 GB`.
pub fn size(bytes: u64) -> String {
    let bytes = bytes as f64;
    let (value, unit) = if bytes >= 1e9 { (bytes / 1e9, "GB") } else { (bytes / 1e6, "MB") };
    if value >= 100.0 { format!("{value:.0} {unit}") } else { format!("{value:.1} {unit}") }
}

/// Formats an integer in groups of three digits: `1 234 567`.
pub fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().map(|group| str::from_utf8(group).unwrap()).collect();
    groups.join(" ")
}

/// Folders where Linux shows its limits.
struct Sources {
    /// Folder of processes, `/proc`.
    processes: PathBuf,
    /// Folder of control groups, `/sys/fs/cgroup`.
    groups: PathBuf,
}

impl Sources {
    fn system() -> Sources {
        Sources { processes: "/proc".into(), groups: "/sys/fs/cgroup".into() }
    }
}

fn room_of(sources: &Sources, processes: u64) -> Option<Room> {
    let text = |name: &str| fs::read_to_string(sources.processes.join(name)).unwrap_or_default();
    let (machine, status, limits) = (text("meminfo"), text("self/status"), text("self/limits"));
    let kilobytes = |text: &str, key: &str| number_after(text, key).map(|number| 1024 * number);
    let swap = kilobytes(&machine, "SwapFree:").unwrap_or(0);
    let shared = kilobytes(&machine, "MemAvailable:").map(|bytes| (bytes + swap, "the machine"));
    let group = group_room(sources, &text("self/cgroup")).map(|bytes| (bytes, "the control group (cgroup)"));
    let share = |(bytes, limit)| (bytes / processes.max(1), limit);
    let limited = |limit: &str, used: &str| {
        Some(number_after(&limits, limit)?.saturating_sub(kilobytes(&status, used)?))
    };
    let addresses = limited("Max address space", "VmSize:").map(|bytes| (bytes, "`ulimit -v`"));
    let data = limited("Max data size", "VmData:").map(|bytes| (bytes, "`ulimit -d`"));
    let bounds = [shared.map(share), group.map(share), addresses, data];
    let (bytes, limit) = bounds.into_iter().flatten().min()?;
    Some(Room { bytes, limit })
}

/// Returns the first number after a key at the start of a line; `None` for `unlimited`.
fn number_after(text: &str, key: &str) -> Option<u64> {
    text.lines().find_map(|line| line.strip_prefix(key))?.split_whitespace().next()?.parse().ok()
}

/// Returns the bytes that the tightest of the control groups around this process leaves.
fn group_room(sources: &Sources, membership: &str) -> Option<u64> {
    let mut least: Option<u64> = None;
    for line in membership.lines() {
        // The format is hierarchy:controllers:path; version 2 has no controllers.
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next()) else {
            continue;
        };
        let (root, names) = match controllers {
            "" => (sources.groups.clone(), ["memory.max", "memory.current", "inactive_file"]),
            _ if controllers.split(',').any(|name| name == "memory") => (
                sources.groups.join("memory"),
                ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"],
            ),
            _ => continue,
        };
        // Inside a container the path may be that of the host; the root is then the group's own
        // folder.
        let path = Path::new(path.trim_start_matches('/'));
        for folder in path.ancestors().map(|part| root.join(part)) {
            let read = |name: &str| fs::read_to_string(folder.join(name)).ok();
            let number = |name: &str| read(name)?.trim().parse::<u64>().ok();
            let (Some(limit), Some(used)) = (number(names[0]), number(names[1])) else { continue };
            // Cached files can be evicted.
            let cached = read("memory.stat").and_then(|stat| number_after(&stat, &format!("{} ", names[2])));
            let unused = limit.saturating_sub(used.saturating_sub(cached.unwrap_or(0)));
            least = Some(least.map_or(unused, |least| least.min(unused)));
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;

    const GIB: u64 = 1 << 30;

    /// Creates a machine with 8 GiB available, as Linux shows it.
    fn machine(name: &str, membership: &str, groups: &[(&str, &str)]) -> Sources {
        let folder = std::env::temp_dir().join(format!("rebond-memory-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        let write = |path: &str, text: &str| {
            let path = folder.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("proc/meminfo", "MemTotal:       16777216 kB\nMemAvailable:    8388608 kB\nSwapFree:  0 kB\n");
        write("proc/self/status", "VmSize:\t 1048576 kB\nVmData:\t 524288 kB\n");
        write("proc/self/cgroup", membership);
        for (path, text) in groups {
            write(&format!("groups/{path}"), text);
        }
        Sources { processes: folder.join("proc"), groups: folder.join("groups") }
    }

    fn limits(sources: &Sources, addresses: &str, data: &str) {
        let text = format!(
            "Limit                     Soft Limit           Hard Limit           Units\n\
             Max data size             {data}            unlimited            bytes\n\
             Max address space         {addresses}       unlimited            bytes\n"
        );
        fs::write(sources.processes.join("self/limits"), text).unwrap();
    }

    #[test]
    fn the_tightest_limit_counts() {
        let sources = machine("limits", "", &[]);
        assert_eq!(room_of(&sources, 1), Some(Room { bytes: 8 * GIB, limit: "the machine" }));
        assert_eq!(room_of(&sources, 4), Some(Room { bytes: 2 * GIB, limit: "the machine" }));
        limits(&sources, &(3 * GIB).to_string(), "unlimited");
        assert_eq!(room_of(&sources, 1), Some(Room { bytes: 2 * GIB, limit: "`ulimit -v`" }));
        // Each process has this limit to itself.
        assert_eq!(room_of(&sources, 4), Some(Room { bytes: 2 * GIB, limit: "`ulimit -v`" }));
        limits(&sources, "unlimited", &GIB.to_string());
        assert_eq!(room_of(&sources, 1), Some(Room { bytes: GIB / 2, limit: "`ulimit -d`" }));
        let nowhere = Sources { processes: "/nowhere".into(), groups: "/nowhere".into() };
        assert_eq!(room_of(&nowhere, 1), None);
    }

    #[test]
    fn groups_of_both_versions_count_with_those_around_them() {
        let limit = "the control group (cgroup)";
        let second = [
            ("a/memory.max", (4 * GIB).to_string()),
            ("a/memory.current", (2 * GIB).to_string()),
            ("a/memory.stat", format!("anon 5\ninactive_file {GIB}\n")),
            ("a/b/memory.max", "max".into()),
            ("a/b/memory.current", "7".into()),
        ];
        let groups: Vec<_> = second.iter().map(|(path, text)| (*path, text.as_str())).collect();
        let sources = machine("second", "0::/a/b\n", &groups);
        assert_eq!(room_of(&sources, 1), Some(Room { bytes: 3 * GIB, limit }));
        let first = [
            ("memory/c/memory.limit_in_bytes", (2 * GIB).to_string()),
            ("memory/c/memory.usage_in_bytes", GIB.to_string()),
            ("memory/memory.limit_in_bytes", "9223372036854771712".into()),
            ("memory/memory.usage_in_bytes", GIB.to_string()),
        ];
        let groups: Vec<_> = first.iter().map(|(path, text)| (*path, text.as_str())).collect();
        let sources = machine("first", "9:name=systemd:/\n4:cpu,memory:/c\n0::/\n", &groups);
        assert_eq!(room_of(&sources, 2), Some(Room { bytes: GIB / 2, limit }));
        // In a container the path does not exist, and the root is the group's own folder.
        let groups = [("memory.max", "1073741824"), ("memory.current", "0")];
        let sources = machine("container", "0::/machine/pod/x\n", &groups);
        assert_eq!(room_of(&sources, 1), Some(Room { bytes: GIB, limit }));
    }

    #[test]
    fn what_does_not_fit_is_refused_with_figures() {
        assert!(require(SMALL - 1, "nothing", |_| unreachable!()).is_ok());
        let error = require(u64::MAX, "all", |part| format!("{}", part < 1e-3)).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        let said = error.to_string();
        assert!(
            said.starts_with("all takes about 18446744074 GB of memory, and ") && said.ends_with("; true"),
            "{said}"
        );
        assert_eq!((size(12_345_678).as_str(), size(5_600_000_000).as_str()), ("12.3 MB", "5.6 GB"));
    }
}
