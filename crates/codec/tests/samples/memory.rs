//! The memory of this process.

/// A figure of this process's memory in KiB; `None` where the system does not tell.
fn memory_kib(figure: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(figure))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// Runs `action`, and gives back by how many KiB the process grew from now to its peak; `None` where
/// the system does not tell.
pub(crate) fn rise_kib<T>(action: impl FnOnce() -> T) -> (T, Option<u64>) {
    // Begins a new peak, where the system allows it.
    let told = std::fs::write("/proc/self/clear_refs", "5").is_ok();
    let before = memory_kib("VmRSS:").filter(|_| told);
    let result = action();
    let rise = before.zip(memory_kib("VmHWM:")).map(|(before, peak)| peak.saturating_sub(before));
    (result, rise)
}
