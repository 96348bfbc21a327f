//! What this process has: children, segments, descriptors, memory. For tests that nothing is left.

use std::fs;
use std::time::{Duration, Instant};

/// A process of this machine.
struct Process {
    number: u32,
    parent: u32,
    ended: bool,
    arguments: String,
}

fn processes() -> Vec<Process> {
    let folders = fs::read_dir("/proc").into_iter().flatten().flatten();
    let look = |folder: fs::DirEntry| -> Option<Process> {
        let number = folder.file_name().to_str()?.parse().ok()?;
        let stat = fs::read_to_string(folder.path().join("stat")).ok()?;
        // The name in brackets may hold anything.
        let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
        let (state, parent) = (fields.next()?, fields.next()?.parse().ok()?);
        let arguments = fs::read(folder.path().join("cmdline")).unwrap_or_default();
        Some(Process {
            number,
            parent,
            ended: state == "Z",
            arguments: String::from_utf8_lossy(&arguments).replace('\0', " "),
        })
    };
    folders.filter_map(look).collect()
}

/// Numbers of the worker processes of this process.
#[must_use]
pub fn workers() -> Vec<u32> {
    workers_of(std::process::id())
}

/// Whether a process has not ended.
#[must_use]
pub fn runs(number: u32) -> bool {
    let mut all = processes().into_iter();
    all.any(|one| one.number == number && !one.ended)
}

/// Processor time that a process used, in ticks of 10 ms.
#[must_use]
pub fn ticks(number: u32) -> u64 {
    let stat = fs::read_to_string(format!("/proc/{number}/stat")).unwrap_or_default();
    let fields = stat.rsplit_once(')').map_or("", |parts| parts.1);
    let used = fields.split_whitespace().nth(11);
    used.and_then(|used| used.parse().ok()).unwrap_or(0)
}

/// Numbers of the worker processes of a process.
#[must_use]
pub fn workers_of(parent: u32) -> Vec<u32> {
    let ours = processes().into_iter();
    let ours = ours.filter(|one| one.parent == parent && !one.ended);
    ours.filter(|one| one.arguments.contains(" worker"))
        .map(|one| one.number)
        .collect()
}

/// Ends a process by the signal that cannot be caught.
pub fn kill(process: u32) {
    signal(process, rustix::process::Signal::KILL);
}

/// What Ctrl-C sends.
pub fn interrupt(process: u32) {
    signal(process, rustix::process::Signal::INT);
}

fn signal(process: u32, signal: rustix::process::Signal) {
    let number = i32::try_from(process).ok();
    if let Some(number) = number.and_then(rustix::process::Pid::from_raw) {
        // It may have ended by itself.
        let _ = rustix::process::kill_process(number, signal);
    }
}

/// What is left of this process's children, and of what the fault plugin started for it.
#[must_use]
pub fn processes_left() -> Vec<String> {
    let own = std::process::id();
    let started = format!("1000.{own} ");
    let all = processes().into_iter();
    all.filter(|one| one.parent == own || one.arguments.contains(&started))
        .map(|one| format!("{} {}", one.number, one.arguments))
        .collect()
}

/// Segments of shared memory that this process has open or mapped.
#[must_use]
pub fn segments() -> usize {
    let open = fs::read_dir("/proc/self/fd")
        .into_iter()
        .flatten()
        .flatten();
    let open = open.filter_map(|one| fs::read_link(one.path()).ok());
    let open = open.filter(|to| to.to_string_lossy().contains("memfd:"));
    let maps = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    open.count() + maps.lines().filter(|line| line.contains("memfd:")).count()
}

/// Open files of this process.
#[must_use]
pub fn descriptors() -> usize {
    fs::read_dir("/proc/self/fd").map_or(0, Iterator::count)
}

/// Resident bytes of this process, without what is free.
#[must_use]
#[allow(unsafe_code)]
pub fn resident() -> u64 {
    #[cfg(target_env = "gnu")]
    // SAFETY: it may be called at any time, from any thread.
    unsafe {
        libc::malloc_trim(0)
    };
    let text = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let number = line.and_then(|line| line.split_whitespace().next());
    number
        .and_then(|number| number.parse::<u64>().ok())
        .unwrap_or(0)
        << 10
}

/// Waits until `done`, at most so long. What ends in the background needs a moment.
#[must_use]
pub fn soon(most: Duration, done: impl Fn() -> bool) -> bool {
    let begin = Instant::now();
    while !done() {
        if begin.elapsed() > most {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

/// Fails unless the children and segments of this process are gone.
pub fn nothing() {
    let gone = || processes_left().is_empty() && segments() == 0;
    if !soon(Duration::from_secs(2), gone) {
        let (processes, segments) = (processes_left(), segments());
        panic!("left behind: {processes:?}, {segments} segments");
    }
}
