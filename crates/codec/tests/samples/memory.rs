//! The memory of this process.

/// A figure of this process's memory in KiB.
fn memory_kib(figure: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("run this test on Linux");
    let line = status.lines().find(|line| line.starts_with(figure)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

/// Runs `action`, and gives back by how many KiB the process grew from now to its peak.
pub(crate) fn rise_kib<T>(action: impl FnOnce() -> T) -> (T, u64) {
    // Begins a new peak.
    std::fs::write("/proc/self/clear_refs", "5")
        .expect("run this test on Linux, where it may write /proc/self/clear_refs");
    let before = memory_kib("VmRSS:");
    let result = action();
    (result, memory_kib("VmHWM:").saturating_sub(before))
}
