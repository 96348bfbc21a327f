//! Processes that a plugin started and left behind.
//!
//! A worker leads a process group, and its environment carries a mark that its children inherit:
//! the group's end ends most of them, the mark finds those that left the group.

use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, WaitOptions};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Name of the environment variable with the mark.
pub const MARK: &str = "PUNCTA_WORKER";

static NEXT: AtomicU64 = AtomicU64::new(1);

/// A mark that no other worker on this machine has.
pub fn new_mark() -> String {
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let since = since.unwrap_or_default().as_nanos();
    format!("{}-{number}-{since}", std::process::id())
}

/// Ends every process whose environment has the mark.
pub fn end_marked(mark: &str) {
    let entry = format!("{MARK}={mark}");
    let marked = |folder: &Path| {
        let environment = std::fs::read(folder.join("environ")).unwrap_or_default();
        environment
            .split(|byte| *byte == 0)
            .any(|one| one == entry.as_bytes())
    };
    // One that starts another while it is looked for is found in the next round.
    for _ in 0..16 {
        let mut found = false;
        for folder in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
            let name = folder.file_name();
            let number = name.to_str().and_then(|name| name.parse().ok());
            let Some(pid) = number.and_then(Pid::from_raw) else {
                continue;
            };
            if marked(&folder.path()) {
                found |= rustix::process::kill_process(pid, Signal::KILL).is_ok();
            }
        }
        if !found {
            return;
        }
    }
}

/// In a worker: adopts what its children leave behind, so that [`end_children`] finds it.
pub fn adopt() {
    // A system that does not know this leaves only the mark.
    let _ = rustix::process::set_child_subreaper(Some(rustix::process::getpid()));
}

/// In a worker: ends all children. Whether there were any that still ran.
pub fn end_children() -> bool {
    let any = || {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        rustix::process::waitid(WaitId::All, options).is_ok()
    };
    let mut found = false;
    // Children of ended children become ours, at most one generation a round.
    for _ in 0..100 {
        if !any() {
            break;
        }
        for child in children() {
            found |= rustix::process::kill_process(child, Signal::KILL).is_ok();
        }
        while let Ok(Some(_)) = rustix::process::wait(WaitOptions::NOHANG) {}
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    found
}

fn children() -> Vec<Pid> {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten();
    let lists = tasks.flatten().filter_map(|task| {
        let list = task.path().join("children");
        std::fs::read_to_string(list).ok()
    });
    lists
        .flat_map(|list| {
            let numbers = list.split_whitespace().filter_map(|one| one.parse().ok());
            numbers.filter_map(Pid::from_raw).collect::<Vec<_>>()
        })
        .collect()
}
