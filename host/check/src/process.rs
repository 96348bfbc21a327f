//! Checks of what calls leave behind in their process.

use crate::check::Check;
use crate::child::{Case, Found, Ground, Verdict};
use crate::plugin::Instance;
use crate::raw;
use std::hint::black_box;
use std::io::{Read, Seek};
use std::time::{Duration, Instant};

/// Calls between two looks at the memory.
const CALLS: usize = 40;
/// Time for them.
const TIME: Duration = Duration::from_millis(1500);
/// What may come and go by chance.
const CHANCE: u64 = 8 << 20;
/// Until threads and files that end with a call are gone.
const SETTLE: Duration = Duration::from_millis(400);

pub fn find(check: Check, ground: &Ground) -> Option<Found> {
    let one: fn(&Instance, &Case<'_>) -> Result<(), String> = match check {
        Check::MemoryReturned => memory_returned,
        Check::NothingOpen => nothing_open,
        Check::NoLateCalls => no_late_calls,
        Check::ProcessKept => process_kept,
        Check::Quiet => return Some(quiet(ground)),
        _ => return None,
    };
    if check != Check::ProcessKept && !cfg!(target_os = "linux") {
        return Some(Ok(Verdict::Skipped("this system does not tell")));
    }
    let found = ground
        .instance()
        .and_then(|instance| ground.each(&instance, |case| one(&instance, case)));
    Some(found)
}

/// Bytes of memory that the process has.
fn resident() -> u64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = text
        .split_whitespace()
        .nth(1)
        .and_then(|one| one.parse().ok());
    pages.unwrap_or(0_u64) * 4096
}

fn memory_returned(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let setting = case.good(instance);
    for _ in 0..3 {
        instance.call(&setting).good()?;
    }
    let (before, begin) = (resident(), Instant::now());
    let mut calls = 0;
    while calls < CALLS && begin.elapsed() < TIME {
        instance.call(&setting).good()?;
        calls += 1;
    }
    let more = resident().saturating_sub(before);
    if calls > 4 && more > CHANCE && more / calls as u64 > 1 << 16 {
        return Err(format!(
            "{calls} calls left {:.1} MB of memory",
            more as f64 / 1e6
        ));
    }
    Ok(())
}

fn count(folder: &str) -> usize {
    std::fs::read_dir(folder).map_or(0, Iterator::count)
}

fn children() -> usize {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten();
    let texts = tasks
        .flatten()
        .map(|task| std::fs::read_to_string(task.path().join("children")).unwrap_or_default());
    texts.map(|text| text.split_whitespace().count()).sum()
}

fn nothing_open(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let setting = case.good(instance);
    instance.call(&setting).good()?;
    let look = || (count("/proc/self/fd"), count("/proc/self/task"), children());
    std::thread::sleep(Duration::from_millis(20));
    let before = look();
    for _ in 0..4 {
        instance.call(&setting).good()?;
    }
    let begin = Instant::now();
    loop {
        let now = look();
        let left = [
            (now.0, before.0, "files"),
            (now.1, before.1, "threads"),
            (now.2, before.2, "processes"),
        ];
        let Some((now, before, what)) = left.iter().find(|(now, before, _)| now > before) else {
            return Ok(());
        };
        if begin.elapsed() > SETTLE {
            let more = now - before;
            return Err(format!("after 4 calls there are {more} {what} more"));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn no_late_calls(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let setting = case.good(instance);
    let before = raw::late_calls();
    instance.call(&setting).good()?;
    std::thread::sleep(Duration::from_millis(150));
    match raw::late_calls() - before {
        0 => Ok(()),
        count => Err(format!(
            "the host was called {count} times for a call that had returned"
        )),
    }
}

/// What calls must leave as it was, by name.
fn surroundings() -> Vec<(&'static str, String)> {
    let folder = std::env::current_dir().map(|path| path.display().to_string());
    let mut variables: Vec<String> = std::env::vars_os()
        .map(|(name, value)| format!("{name:?}={value:?}"))
        .collect();
    variables.sort();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = |name: &str| {
        let found = status.lines().find(|line| line.starts_with(name));
        found.unwrap_or_default().to_owned()
    };
    let third = black_box(1.0_f64) / black_box(3.0);
    let other = black_box(-1.0_f64) / black_box(3.0);
    let tiny = black_box(f64::MIN_POSITIVE) / black_box(2.0);
    let rounding = [third, other, tiny].map(f64::to_bits);
    vec![
        ("current folder", folder.unwrap_or_default()),
        ("environment", variables.join("\n")),
        ("mask of new files", line("Umask:")),
        ("caught signals", caught(&line("SigCgt:"))),
        ("ignored signals", line("SigIgn:")),
        ("blocked signals", line("SigBlk:")),
        ("rounding of numbers", format!("{rounding:?}")),
    ]
}

/// The set of caught signals without the two that the C library takes for itself when it starts
/// threads.
fn caught(line: &str) -> String {
    let set = line.split_whitespace().last().unwrap_or_default();
    let own: u64 = 0b11 << 31;
    let set = u64::from_str_radix(set, 16).unwrap_or_default() & !own;
    format!("{set:x}")
}

fn process_kept(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let before = surroundings();
    instance.call(&case.good(instance)).good()?;
    let after = surroundings();
    match before.iter().zip(&after).find(|(a, b)| a != b) {
        Some(((name, _), _)) => Err(format!("the process's {name} changed")),
        None => Ok(()),
    }
}

/// Writes what is buffered by the C library of this process.
#[allow(unsafe_code)]
fn flush() {
    // SAFETY: null means all streams.
    unsafe { libc::fflush(std::ptr::null_mut()) };
}

fn quiet(ground: &Ground) -> Found {
    let path = ground.scratch().join("said");
    let lost = |error: std::io::Error| format!("the validator cannot listen: {error}");
    let mut file = std::fs::File::options()
        .create(true)
        .truncate(true)
        .read(true)
        .write(true)
        .open(&path)
        .map_err(lost)?;
    rustix::stdio::dup2_stdout(&file).map_err(|error| lost(error.into()))?;
    rustix::stdio::dup2_stderr(&file).map_err(|error| lost(error.into()))?;
    let instance = ground.instance()?;
    let found = ground.each(&instance, |case| {
        instance.call(&case.good(&instance)).good().map(|_| ())
    })?;
    flush();
    let mut said = Vec::new();
    file.rewind().map_err(lost)?;
    file.read_to_end(&mut said).map_err(lost)?;
    match said.is_empty() {
        true => Ok(found),
        false => {
            let text = String::from_utf8_lossy(&said);
            let line = text.lines().next().unwrap_or_default();
            let shown = &line[..line.floor_char_boundary(120)];
            Err(format!("it writes {shown:?} to the standard output"))
        }
    }
}
