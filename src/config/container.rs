//! How much memory this process may have: in a container, the container's limit.
//!
//! Both versions of control groups are read where they are mounted by convention. Processors need no
//! such reading: [`std::thread::available_parallelism`] counts those that the group's quota allows.

use super::ByteSize;
use std::fs;
use std::path::Path;

/// What the process takes beside the memory budget.
pub const BESIDE_BUDGET: ByteSize = ByteSize(80 << 20);
/// The memory budget where nothing limits the process.
const BUDGET_WITHOUT_LIMIT: ByteSize = ByteSize(1 << 30);
/// The least memory budget that is ever chosen.
const LEAST_BUDGET: ByteSize = ByteSize(16 << 20);
/// The first version writes a number near the largest one where there is no limit.
const UNLIMITED: u64 = 1 << 60;

/// The memory that the process may have; `None` without a limit.
#[must_use]
pub fn memory_limit() -> Option<ByteSize> {
    memory_limit_below(Path::new("/"))
}

/// The memory of the machine; `None` where the system does not tell.
#[must_use]
pub fn machine_memory() -> Option<ByteSize> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024).map(ByteSize)
}

/// The memory budget that suits a limit: two thirds of it, so that a container of 1.5 GiB has the
/// budget of 1 GiB that a process without limits has, and room for what the process takes besides.
#[must_use]
pub(super) fn budget_within(limit: Option<ByteSize>) -> ByteSize {
    let Some(ByteSize(limit)) = limit else { return BUDGET_WITHOUT_LIMIT };
    let budget = (limit / 3 * 2).min(limit.saturating_sub(BESIDE_BUDGET.0));
    ByteSize(budget >> 20 << 20).max(LEAST_BUDGET)
}

/// The least limit of the groups that the process belongs to, in a file system that begins at `root`.
fn memory_limit_below(root: &Path) -> Option<ByteSize> {
    let membership = fs::read_to_string(root.join("proc/self/cgroup")).ok()?;
    let limits = membership.lines().filter_map(|line| {
        let (controllers, group) = line.split_once(':')?.1.split_once(':')?;
        let (mount, file) = match controllers {
            "" => ("sys/fs/cgroup", "memory.max"),
            _ if controllers.split(',').any(|name| name == "memory") => {
                ("sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => return None,
        };
        least_limit(&root.join(mount), Path::new(group), file)
    });
    limits.min().map(ByteSize)
}

/// The least limit of a group and those around it. A container may see its own group as the mount
/// itself, and not where the path says that it is.
fn least_limit(mount: &Path, group: &Path, file: &str) -> Option<u64> {
    let group = group.strip_prefix("/").unwrap_or(group);
    let limits = group.ancestors().filter_map(|group| {
        let text = fs::read_to_string(mount.join(group).join(file)).ok()?;
        text.trim().parse().ok().filter(|&limit| limit < UNLIMITED)
    });
    limits.min()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The limit that is read where files have these contents.
    fn limit(files: &[(&str, &str)]) -> Option<u64> {
        let root = tempfile::tempdir().unwrap();
        for (path, content) in files {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }
        let limit = memory_limit_below(root.path());
        limit.map(|limit| limit.0 >> 20)
    }

    #[test]
    fn a_container_sees_its_limit_at_the_mount_in_both_versions() {
        let second = [("proc/self/cgroup", "0::/\n"), ("sys/fs/cgroup/memory.max", "536870912\n")];
        assert_eq!(limit(&second), Some(512));
        let first = [
            ("proc/self/cgroup", "5:cpu,cpuacct:/docker/ab\n4:memory:/docker/ab\n0::/docker/ab\n"),
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "268435456\n"),
        ];
        assert_eq!(limit(&first), Some(256));
    }

    #[test]
    fn the_least_limit_of_the_groups_around_counts() {
        let nested = [
            ("proc/self/cgroup", "0::/slice/unit\n"),
            ("sys/fs/cgroup/slice/memory.max", "104857600\n"),
            ("sys/fs/cgroup/slice/unit/memory.max", "209715200\n"),
        ];
        assert_eq!(limit(&nested), Some(100));
    }

    #[test]
    fn no_limit_is_none() {
        assert_eq!(limit(&[]), None);
        assert_eq!(
            limit(&[("proc/self/cgroup", "0::/\n"), ("sys/fs/cgroup/memory.max", "max\n")]),
            None
        );
        let first = [
            ("proc/self/cgroup", "4:memory:/\n"),
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n"),
        ];
        assert_eq!(limit(&first), None);
    }

    #[test]
    fn the_budget_leaves_room_within_every_limit() {
        let budget = |mib: u64| budget_within(Some(ByteSize(mib << 20))).0 >> 20;
        assert_eq!(budget_within(None), ByteSize(1 << 30));
        assert_eq!([budget(1536), budget(6144), budget(256), budget(128)], [1024, 4096, 170, 48]);
        assert_eq!(budget(20), 16, "where nothing would be left, the least");
        assert!((97..4096).all(|mib| budget(mib) + 80 <= mib));
    }
}
