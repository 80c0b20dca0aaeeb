//! Control groups: a container's limits without a container. Making them takes an administrator.

use crate::server::{Folder, Server, program};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

/// What a group may have.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Limits {
    pub(crate) processors: Option<f64>,
    pub(crate) memory_mib: Option<u64>,
}

/// Groups with limits, of either version; removed when dropped.
pub(crate) struct Group(Vec<PathBuf>);

impl Group {
    /// Makes them, or says why that is not possible.
    pub(crate) fn make(name: &str, limits: Limits) -> Result<Self, String> {
        let name = format!("pixmesh-load-{name}-{}", std::process::id());
        let root = Path::new("/sys/fs/cgroup");
        let is_second = root.join("cgroup.controllers").exists();
        let mut group = Self(Vec::new());
        let quota = limits.processors.map(|count| (count * 1e5) as u64);
        let bytes = limits.memory_mib.map(|mib| (mib << 20).to_string());
        if is_second {
            let quota = quota.map(|quota| format!("{quota} 100000"));
            group.limit(root.join(name), &[("memory.max", bytes), ("cpu.max", quota)])?;
        } else {
            let quota = quota.map(|quota| quota.to_string());
            let folder = |controller: &str| root.join(controller).join(&name);
            group.limit(folder("memory"), &[("memory.limit_in_bytes", bytes)])?;
            group.limit(folder("cpu"), &[("cpu.cfs_quota_us", quota)])?;
        }
        Ok(group)
    }

    fn limit(&mut self, folder: PathBuf, limits: &[(&str, Option<String>)]) -> Result<(), String> {
        let name = folder.display().to_string();
        let why = |error: std::io::Error| format!("{name}: {error}");
        fs::create_dir(&folder).map_err(why)?;
        self.0.push(folder);
        for (file, limit) in limits {
            let Some(limit) = limit else { continue };
            fs::write(format!("{name}/{file}"), limit).map_err(why)?;
        }
        Ok(())
    }

    /// Starts the service within.
    pub(crate) fn start(&self, flags: &[&str]) -> Server {
        let enter =
            self.0.iter().map(|group| format!("echo $$ > {}/cgroup.procs && ", group.display()));
        let script = format!("{}exec \"$0\" \"$@\"", enter.collect::<String>());
        let own = program();
        let mut shell = Command::new("sh");
        for (name, _) in own.get_envs() {
            shell.env_remove(name);
        }
        shell.args(["-c", &script]).arg(own.get_program());
        Server::start_as(shell, flags, Arc::<Folder>::default())
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        for folder in &self.0 {
            let _ = fs::remove_dir(folder);
        }
    }
}
