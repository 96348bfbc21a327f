//! In a worker: what it may use, and whether it may serve again.

use rustix::process::{Resource, Rlimit};
use std::sync::OnceLock;

/// Files that a plugin may leave open, for caches of its libraries.
const LEFT_OPEN: usize = 256;
/// Memory that a plugin may keep between calls.
const KEPT_BYTES: u64 = 1 << 30;

/// Bounds the private memory of this process, makes it the first victim of a machine without
/// memory, and keeps it from writing its memory to the disk when it crashes.
pub fn impose(memory: u64) {
    // A system that does not know one of these decides for itself.
    let _ = std::fs::write("/proc/self/oom_score_adj", "1000");
    let limit = |resource, value: u64| {
        let limit = Rlimit {
            current: Some(value),
            maximum: Some(value),
        };
        let _ = rustix::process::setrlimit(resource, limit);
    };
    limit(Resource::Data, memory);
    limit(Resource::Core, 0);
}

/// What this process used before it opened a plugin.
#[derive(Clone, Copy, Debug)]
pub struct Usage {
    files: usize,
    memory: u64,
}

impl Usage {
    /// What it uses now.
    pub fn now() -> Usage {
        Usage {
            files: std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count),
            memory: private_memory().unwrap_or(0),
        }
    }

    /// What a call left behind that the next should not inherit.
    pub fn excess(&self) -> Option<String> {
        let now = Usage::now();
        let files = now.files.saturating_sub(self.files);
        // Without a free descriptor the folder of descriptors cannot be read.
        if files > LEFT_OPEN || now.files == 0 {
            return Some(if now.files == 0 {
                "left all its files open".into()
            } else {
                format!("left {files} files open")
            });
        }
        let memory = now.memory.saturating_sub(self.memory);
        (memory > KEPT_BYTES).then(|| format!("kept {} MB of memory", memory >> 20))
    }
}

/// Resident bytes that no other process shares.
fn private_memory() -> Option<u64> {
    static PAGE: OnceLock<u64> = OnceLock::new();
    let page = *PAGE.get_or_init(|| rustix::param::page_size() as u64);
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    let mut fields = text.split_whitespace().skip(1);
    let resident: u64 = fields.next()?.parse().ok()?;
    let shared: u64 = fields.next()?.parse().ok()?;
    Some(resident.saturating_sub(shared) * page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_behind_is_named() {
        let usage = Usage::now();
        assert_eq!(usage.excess(), None);
        let open = || std::fs::File::open("/dev/null").unwrap();
        let files: Vec<_> = (0..2 * LEFT_OPEN).map(|_| open()).collect();
        let text = usage.excess().unwrap();
        assert!(text.contains("files open"), "{text}");
        drop(files);
        let used = Usage { memory: 0, ..usage };
        assert!(used.memory <= private_memory().unwrap());
    }
}
