//! Processor time of the present thread.

use std::time::Instant;

/// Clock of the share of the time in which the present thread had a processor.
///
/// Other programs take processors away for some of the time. A time in seconds, multiplied by this
/// share, depends on them less.
pub(super) struct CpuClock {
    wall: Instant,
    cpu: Option<f64>,
}

impl CpuClock {
    /// Starts the clock.
    pub fn start() -> CpuClock {
        CpuClock { wall: Instant::now(), cpu: cpu_seconds() }
    }

    /// Returns the share since the start, at most 1; 1 where the system does not tell it.
    pub fn share(&self) -> f64 {
        let wall = self.wall.elapsed().as_secs_f64();
        match (self.cpu, cpu_seconds()) {
            (Some(before), Some(now)) if wall > 0.0 => ((now - before) / wall).min(1.0),
            _ => 1.0,
        }
    }
}

/// Returns the processor time of the present thread, in s.
#[cfg(unix)]
fn cpu_seconds() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
}

/// Returns no time: the system does not tell it.
#[cfg(not(unix))]
fn cpu_seconds() -> Option<f64> {
    None
}

#[cfg(test)]
mod tests {
    use super::CpuClock;
    use std::time::Duration;

    #[test]
    fn a_thread_that_sleeps_has_no_processor() {
        let clock = CpuClock::start();
        std::thread::sleep(Duration::from_millis(50));
        let share = clock.share();
        assert!(share < 0.5 || cfg!(not(unix)), "{share}");
    }
}
