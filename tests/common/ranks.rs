//! Cases that run on several ranks. Each test starts `mpirun` on its own program with the case's
//! name in the environment, and each rank runs the body of the case.

use super::command::ON_ONE_MACHINE;
use libtest_mimic::{Arguments, Failed, Trial};
use rebond::Result;
use std::process::{Command, ExitCode, Output};

/// Environment variable that names the case to a child.
const CASE: &str = "REBOND_PETSC_CASE";

pub type Body = fn(&[String]) -> Result<()>;

/// Expected outcome of a case under mpirun.
pub enum Expect {
    /// Exit code 0.
    Success,
    /// The given exit code, and the given text exactly once on standard error, within the time
    /// limit.
    Failure(i32, &'static str),
}
pub use Expect::{Failure, Success};

pub struct Case {
    pub name: &'static str,
    pub ranks: &'static [usize],
    pub arguments: &'static [&'static str],
    pub body: Body,
    pub expect: Expect,
    /// Maximum run time on an idle machine, in s. A case of more than a minute is ignored unless
    /// requested.
    pub seconds: u32,
    /// Whether one rank also runs with each kernel that OpenBLAS has for this processor, whose
    /// roundings differ.
    pub each_kernel: bool,
}

/// Kernels of OpenBLAS, one for each set of instructions, that this processor can execute.
fn kernels() -> Vec<&'static str> {
    let mut kernels = Vec::new();
    #[cfg(target_arch = "x86_64")]
    {
        let has_avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
        let known = [
            ("Nehalem", is_x86_feature_detected!("sse4.2")),
            ("Sandybridge", is_x86_feature_detected!("avx")),
            ("Haswell", has_avx2),
            ("Zen", has_avx2),
            ("SkylakeX", is_x86_feature_detected!("avx512vl") && is_x86_feature_detected!("avx512dq")),
        ];
        kernels.extend(known.iter().filter(|(_, runs)| *runs).map(|(name, _)| *name));
    }
    kernels
}

pub const fn case(name: &'static str, ranks: &'static [usize], body: Body) -> Case {
    Case { name, ranks, arguments: &[], body, expect: Success, seconds: 60, each_kernel: false }
}

/// Returns a case that takes minutes.
pub const fn long(name: &'static str, ranks: &'static [usize], body: Body) -> Case {
    Case { seconds: 1200, ..case(name, ranks, body) }
}

/// Runs all cases, or the one that mpirun requests.
pub fn main(cases: impl Iterator<Item = &'static Case>) -> ExitCode {
    if let Ok(name) = std::env::var(CASE) {
        return child(cases, &name);
    }
    let mut trials = Vec::new();
    for case in cases {
        let mut add = |name: String, ranks, kernel| {
            let trial = Trial::test(name, move || parent(case, ranks, kernel));
            trials.push(trial.with_ignored_flag(case.seconds > 60));
        };
        for &ranks in case.ranks {
            add(format!("{}::on_{ranks}", case.name), ranks, None);
        }
        for kernel in kernels().into_iter().filter(|_| case.each_kernel) {
            add(format!("{}::with_{kernel}", case.name), 1, Some(kernel));
        }
    }
    let mut arguments = Arguments::from_args();
    // Two cases run at once, since the ranks of one case already share the cores.
    arguments.test_threads.get_or_insert(2);
    libtest_mimic::run(&arguments, trials).exit_code()
}

fn child(mut cases: impl Iterator<Item = &'static Case>, name: &str) -> ExitCode {
    let case = cases.find(|case| case.name == name).expect("the parent names a case");
    let arguments: Vec<_> = case.arguments.iter().map(ToString::to_string).collect();
    match (case.body)(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => panic!("{error}"),
    }
}

fn parent(case: &Case, ranks: usize, kernel: Option<&str>) -> std::result::Result<(), Failed> {
    let program = std::env::current_exe()?;
    let Output { status, stdout, stderr } = Command::new("mpirun")
        .args(ON_ONE_MACHINE.split(' '))
        // The limit ends a case that hangs; a busy machine may take minutes for seconds of work.
        .args(["--timeout", &(15 * case.seconds).to_string(), "-n", &ranks.to_string()])
        .arg(program)
        .env(CASE, case.name)
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .env_remove("PETSC_OPTIONS")
        .envs(kernel.map(|kernel| ("OPENBLAS_CORETYPE", kernel)))
        .output()?;
    let said = format!("{}{}", String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
    let Some(code) = status.code() else { return Err(format!("{status}\n{said}").into()) };
    match case.expect {
        Success if code == 0 && said.is_empty() => Ok(()),
        Success => Err(format!("exit code {code}\n{said}").into()),
        Failure(expected, text) => {
            // Open MPI 5 breaks its messages into lines.
            let times = said.split_whitespace().collect::<Vec<_>>().join(" ").matches(text).count();
            if code != expected || times != 1 {
                return Err(format!("exit code {code}, {times} times `{text}`\n{said}").into());
            }
            Ok(())
        }
    }
}
