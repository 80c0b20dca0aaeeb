//! A container's limits: the control group of the process says how many workers there are, and how much
//! memory for work.

use crate::server::program;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Groups with limits, of either version; removed when dropped.
struct Group(Vec<PathBuf>);

impl Group {
    /// Makes groups that allow one processor and so much memory; says why it cannot.
    fn make(name: &str, memory_bytes: u64) -> Result<Self, String> {
        let name = format!("pixmesh-{name}-{}", std::process::id());
        let memory = memory_bytes.to_string();
        let root = Path::new("/sys/fs/cgroup");
        let mut group = Self(Vec::new());
        if root.join("cgroup.controllers").exists() {
            group
                .limit(root.join(name), &[("memory.max", &memory), ("cpu.max", "100000 100000")])?;
        } else {
            let quota = [("cpu.cfs_period_us", "100000"), ("cpu.cfs_quota_us", "100000")];
            group.limit(root.join("memory").join(&name), &[("memory.limit_in_bytes", &memory)])?;
            group.limit(root.join("cpu").join(&name), &quota)?;
        }
        Ok(group)
    }

    fn limit(&mut self, folder: PathBuf, limits: &[(&str, &str)]) -> Result<(), String> {
        let name = folder.display().to_string();
        let why = |error: std::io::Error| format!("{name}: {error}");
        fs::create_dir(&folder).map_err(why)?;
        self.0.push(folder);
        for (file, limit) in limits {
            fs::write(format!("{name}/{file}"), limit).map_err(why)?;
        }
        Ok(())
    }

    /// The settings that the program has within.
    fn settings(&self) -> String {
        let enter: Vec<String> = self
            .0
            .iter()
            .map(|group| format!("echo $$ > {}/cgroup.procs", group.display()))
            .collect();
        let mut shell = Command::new("sh");
        let own = program();
        for (name, value) in own.get_envs() {
            assert!(value.is_none(), "it only takes settings away");
            shell.env_remove(name);
        }
        let script = format!("{} && exec \"$0\" config", enter.join(" && "));
        let output = shell.args(["-c", &script]).arg(own.get_program()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        for folder in &self.0 {
            let _ = fs::remove_dir(folder);
        }
    }
}

#[test]
fn workers_and_memory_follow_the_limits_of_a_container() {
    let group = Group::make("limits", 600 << 20).unwrap_or_else(|why| {
        panic!("{why}; run this test as root, in a container with a writable /sys/fs/cgroup")
    });
    let settings = group.settings();
    assert!(settings.contains("--workers 1\n"), "{settings}");
    assert!(settings.contains("--memory-budget 400MiB\n"), "{settings}");
}

#[test]
fn what_is_set_wins_over_the_limits() {
    let output = program().args(["config", "--workers", "3", "--memory-budget", "2GiB"]).output();
    let settings = String::from_utf8(output.unwrap().stdout).unwrap();
    assert!(settings.contains("--workers 3\n") && settings.contains("--memory-budget 2GiB\n"));
}
