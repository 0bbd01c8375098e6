//! What a test may measure on a busy machine.

/// Seconds that the processor has spent on this thread: however many others wait for it, they do not count. Zero where the system
/// does not tell.
pub fn processor_seconds() -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    told.split_whitespace().next().and_then(|time| time.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
