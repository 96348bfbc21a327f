//! Ways to misbehave.
//!
//! What every `unsafe` in this file relies on: nothing. It does what must never be done, in a
//! process that is there to be lost.
#![allow(unsafe_code)]

use puncta_sdk::prelude::*;
use std::hint::black_box;
use std::io::Write;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A way to misbehave.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Panics.
    Panic,
    /// Ends the process by abort.
    Abort,
    /// Writes where no memory is.
    Segfault,
    /// Calls itself for ever.
    Overflow,
    /// Ends the process as if all were well.
    ExitZero,
    /// Ends the process with status 3.
    ExitThree,
    /// Loops for ever.
    Hang,
    /// Takes memory until it gets no more.
    Memory,
    /// Writes 100 MB to each output stream.
    Flood,
    /// Starts a process and leaves it.
    Child,
    /// Starts a process in a session of its own and leaves it.
    Detached,
    /// Opens files until it gets no more, and keeps them.
    Descriptors,
    /// Closes the files 0 to 10, whatever they are.
    Close,
    /// Ends its own process by the signal that cannot be caught.
    Kill,
    /// Reads behind the end of a mapped file.
    Bus,
    /// Executes what is no instruction.
    Illegal,
    /// Raises the signal of a division by zero.
    Arithmetic,
    /// Leaves a thread behind.
    Thread,
    /// Leaves a thread behind that crashes when the call is over.
    LateCrash,
    /// Gives a document that is not what it should be.
    BadDocument,
    /// Gives a document that is not there.
    NullDocument,
    /// Gives a document that is no UTF-8.
    NotUtf8,
    /// Gives a table of a size that cannot be.
    WildSize,
    /// Gives a table of another ABI.
    WildNumber,
    /// Gives no table.
    NullTable,
    /// Returns a status that does not exist.
    WildStatus,
    /// Fails without a reason.
    NoReason,
    /// Fails with a reason that cannot be read.
    BadReason,
    /// Lets a panic out of its function.
    Unwind,
    /// Calls the host's functions with wrong arguments.
    Misuse,
    /// Writes into its input.
    Scribble,
    /// Finishes more rows than it began.
    TooManyRows,
    /// Commits its output and does not finish it.
    Unfinished,
}

/// Bytes after which memory is no longer taken, so that a missing limit does not hurt the machine.
const MOST_MEMORY: usize = 1536 << 20;

impl Fault {
    /// Misbehaves. Returns if that is over and the call can go on.
    ///
    /// # Errors
    /// When a limit did not hold that should have.
    pub fn commit(self) -> Result<(), Failure> {
        match self {
            Fault::Panic => panic!("this plugin is wrong"),
            Fault::Abort => std::process::abort(),
            Fault::Segfault => segfault(),
            Fault::Overflow => _ = black_box(overflow(black_box(1))),
            Fault::ExitZero => std::process::exit(0),
            Fault::ExitThree => std::process::exit(3),
            Fault::Hang => hang(),
            Fault::Memory => return take_memory(),
            Fault::Flood => flood(),
            Fault::Child => start(false),
            Fault::Detached => start(true),
            Fault::Descriptors => while std::fs::File::open("/dev/null").map(keep).is_ok() {},
            Fault::Close => (0..=10).for_each(|file| _ = unsafe { libc::close(file) }),
            Fault::Kill => _ = unsafe { libc::kill(libc::getpid(), libc::SIGKILL) },
            Fault::Bus => bus(),
            Fault::Illegal => _ = unsafe { libc::raise(libc::SIGILL) },
            Fault::Arithmetic => _ = unsafe { libc::raise(libc::SIGFPE) },
            Fault::Thread => _ = std::thread::spawn(|| std::thread::sleep(LONG)),
            Fault::LateCrash => {
                std::thread::spawn(|| {
                    std::thread::sleep(Duration::from_millis(30));
                    Fault::Segfault.commit()
                });
            }
            // The rest are lies, which are told where there is something to lie about.
            _ => {}
        }
        Ok(())
    }
}

const LONG: Duration = Duration::from_secs(300);

fn keep(file: std::fs::File) {
    std::mem::forget(file);
}

fn segfault() {
    let nowhere = std::ptr::with_exposed_provenance_mut::<u64>(black_box(16));
    unsafe { nowhere.write_volatile(1) };
}

#[allow(unconditional_recursion)]
fn overflow(depth: u64) -> u64 {
    let room = black_box([depth; 64]);
    black_box(overflow(black_box(depth + 1)) + room[7])
}

/// As long as anybody waits; a process that nobody ended ends itself.
fn hang() {
    let begin = Instant::now();
    while begin.elapsed() < LONG {
        std::hint::spin_loop();
    }
    std::process::abort();
}

fn take_memory() -> Result<(), Failure> {
    let mut taken = Vec::new();
    while taken.len() * (16 << 20) < MOST_MEMORY {
        taken.push(black_box(vec![1_u8; 16 << 20]));
    }
    Err(Failure::internal("the limit of memory did not hold"))
}

fn flood() {
    let piece = [b'x'; 1 << 16];
    for _ in 0..1600 {
        // Nobody may listen.
        _ = std::io::stdout().write_all(&piece);
        _ = std::io::stderr().write_all(&piece);
    }
}

/// The time tells whose it is: the host's number behind the point.
fn start(detached: bool) {
    let mut sleep = Command::new("sleep");
    sleep.arg(format!("1000.{}", unsafe { libc::getppid() }));
    sleep.stdin(Stdio::null());
    if detached {
        unsafe {
            sleep.pre_exec(|| {
                libc::setsid();
                Ok(())
            });
        }
    }
    if let Ok(child) = sleep.spawn() {
        std::mem::forget(child);
    }
}

fn bus() {
    unsafe {
        let file = libc::memfd_create(c"bus".as_ptr(), 0);
        let (access, flags) = (libc::PROT_READ, libc::MAP_SHARED);
        let page = libc::mmap(std::ptr::null_mut(), 4096, access, flags, file, 0);
        black_box(page.cast::<u8>().read_volatile());
    }
}
