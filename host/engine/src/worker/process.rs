//! The host's side of one worker process.

use super::offspring;
use super::output::Output;
use super::protocol::{FromWorker, ToWorker};
use super::socket;
use crate::job::Progress;
use crate::store::Segment;
use puncta_documents::{Failure, FailureCode, Manifest};
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use std::collections::HashMap;
use std::io;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

/// A worker that was told to stop has this long before it is ended.
pub const GRACE: Duration = Duration::from_millis(200);
/// How often a waiting host looks whether the person cancelled.
const GLANCE: Duration = Duration::from_millis(20);
/// How long a frame may stand still that has begun.
const FRAME: Duration = Duration::from_secs(10);
/// Bytes of a worker's last words that are quoted.
const QUOTED: usize = 200;
/// What should take no time ends a worker that is silent for so long.
const SILENCE: Duration = Duration::from_secs(60);
/// Code with which a worker ends that can no longer speak to its host.
pub const LOST: i32 = 75;

/// How workers are started.
#[derive(Clone, Debug)]
pub struct Start {
    /// Program that serves as worker when it is called with `worker`: this same binary.
    pub program: PathBuf,
    /// Threads of each worker.
    pub threads: usize,
    /// Bytes of private memory that a worker may have.
    pub memory: u64,
}

impl Start {
    /// Workers with one thread and three quarters of the machine's memory.
    #[must_use]
    pub fn new(program: PathBuf) -> Start {
        let installed = crate::store::installed_memory().unwrap_or(64 << 30);
        Start {
            program,
            threads: 1,
            memory: installed / 4 * 3,
        }
    }
}

/// A worker process with one plugin in it.
pub struct Worker {
    child: Child,
    socket: UnixStream,
    /// What the plugin is called in messages.
    name: String,
    /// Segments that the worker has mapped.
    pub(super) known: HashMap<u64, Weak<Segment>>,
    output: Arc<Output>,
    mark: String,
    memory: u64,
    /// Whether its process has been waited for.
    ended: bool,
}

fn broken(what: &str, error: &io::Error) -> Failure {
    let message = format!("cannot {what} a worker process: {error}");
    Failure::new(FailureCode::Resources, message)
}

impl Worker {
    /// Starts a worker.
    ///
    /// # Errors
    /// When the system starts no process.
    pub fn start(start: &Start, name: &str) -> Result<Worker, Failure> {
        let reach = |error: io::Error| broken("reach", &error);
        let (socket, other) = UnixStream::pair().map_err(reach)?;
        let (said, says) = io::pipe().map_err(reach)?;
        let mark = offspring::new_mark();
        let child = Command::new(&start.program)
            .args(["worker", "--threads", &start.threads.to_string()])
            .env(offspring::MARK, &mark)
            .stdin(Stdio::from(OwnedFd::from(other)))
            .stdout(says.try_clone().map_err(reach)?)
            .stderr(says)
            // A group of its own: what a plugin starts ends with its worker.
            .process_group(0)
            .spawn()
            .map_err(|error| broken("start", &error))?;
        // Waiting for the rest of a frame, or for room for one, is looked at again and again.
        socket.set_read_timeout(Some(GLANCE)).map_err(reach)?;
        socket.set_write_timeout(Some(FRAME)).map_err(reach)?;
        Ok(Worker {
            child,
            socket,
            name: name.into(),
            known: HashMap::new(),
            output: Output::drain(said),
            mark,
            memory: start.memory,
            ended: false,
        })
    }

    /// Opens the library at `path`.
    ///
    /// # Errors
    /// When it cannot be opened, the worker dies of it or stays silent, or the person cancels.
    pub fn open(
        &mut self,
        path: &Path,
        door: bool,
        progress: &dyn Progress,
    ) -> Result<Manifest, Failure> {
        let order = ToWorker::Open {
            path: path.into(),
            door,
            memory: self.memory,
        };
        self.say(&order, &[])?;
        match self.wait(progress, "being opened", Some(SILENCE))? {
            (FromWorker::Opened { manifest }, _) => Ok(*manifest),
            _ => Err(self.confused()),
        }
    }

    /// Gives an order.
    ///
    /// # Errors
    /// When the worker is gone.
    pub fn say(
        &mut self,
        message: &ToWorker,
        descriptors: &[BorrowedFd<'_>],
    ) -> Result<(), Failure> {
        match socket::send(&self.socket, message, descriptors) {
            Ok(()) => Ok(()),
            Err(_) => Err(self.death("being called")),
        }
    }

    /// Segments that the worker has mapped and that nobody here uses any more.
    pub(super) fn dropped(&mut self) -> Vec<u64> {
        let gone = self
            .known
            .extract_if(|_, segment| segment.strong_count() == 0);
        gone.map(|(number, _)| number).collect()
    }

    /// Makes the worker let go of memory that nobody here uses any more.
    pub(super) fn forget_dropped(&mut self) {
        let segments = self.dropped();
        if !segments.is_empty() {
            // A worker that is gone shows when it is next called.
            let _ = socket::send(&self.socket, &ToWorker::Forget { segments }, &[]);
        }
    }

    /// Waits for the answer of a preparation, which should take no time.
    ///
    /// # Errors
    /// As [`Worker::wait_for`], or when it is silent for too long.
    pub fn wait_soon(&mut self, progress: &dyn Progress, what: &str) -> Answer {
        self.wait(progress, what, Some(SILENCE))
    }

    /// Waits for an answer, passing on what the work says.
    ///
    /// # Errors
    /// What the plugin fails with, how its worker died, or that the person cancelled.
    pub fn wait_for(&mut self, progress: &dyn Progress, what: &str) -> Answer {
        self.wait(progress, what, None)
    }

    fn wait(&mut self, progress: &dyn Progress, what: &str, patience: Option<Duration>) -> Answer {
        let mut told: Option<Instant> = None;
        let mut heard = Instant::now();
        loop {
            if told.is_none() && progress.cancelled() {
                self.say(&ToWorker::Cancel, &[])?;
                told = Some(Instant::now());
            }
            if told.is_some_and(|since| since.elapsed() > GRACE) {
                self.kill();
                return Err(Failure::cancelled());
            }
            if patience.is_some_and(|patience| heard.elapsed() > patience) {
                return Err(self.silent(what, heard.elapsed()));
            }
            if !self.readable(GLANCE) {
                continue;
            }
            heard = Instant::now();
            let going_on = || {
                let limit = if progress.cancelled() { GRACE } else { FRAME };
                heard.elapsed() < limit
            };
            match socket::receive::<FromWorker>(&self.socket, &going_on) {
                Ok((FromWorker::Progress { fraction, phase }, _)) => {
                    progress.progress(fraction, &phase);
                }
                Ok((FromWorker::Message { level, text }, _)) => progress.message(level, &text),
                Ok(answer) => {
                    self.pass_on_output(progress);
                    return match answer {
                        (FromWorker::Failed { failure }, _) => Err(failure),
                        answer => Ok(answer),
                    };
                }
                Err(_) if progress.cancelled() => {
                    self.kill();
                    return Err(Failure::cancelled());
                }
                Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                    return Err(self.confused());
                }
                Err(_) => return Err(self.death(what)),
            }
        }
    }

    fn pass_on_output(&self, progress: &dyn Progress) {
        if let Some(text) = self.output.take() {
            progress.message(4, &format!("{} wrote: {text}", self.name));
        }
    }

    /// Whether the worker says something, or ends, within a time.
    pub fn readable(&self, within: Duration) -> bool {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let mut fds = [PollFd::new(&self.socket, PollFlags::IN)];
        let timeout = Timespec {
            tv_sec: 0,
            tv_nsec: i64::from(within.subsec_nanos()),
        };
        match poll(&mut fds, Some(&timeout)) {
            Ok(count) => count > 0,
            // An interrupted wait is another glance; anything else shows when reading.
            Err(error) => error != rustix::io::Errno::INTR,
        }
    }

    /// The worker said something that it should not have said.
    pub fn confused(&mut self) -> Failure {
        self.kill();
        let message = format!(
            "the worker of {} gave a wrong answer and was ended",
            self.name
        );
        Failure::new(FailureCode::Crashed, message).remedy(UNTOUCHED)
    }

    fn silent(&mut self, what: &str, time: Duration) -> Failure {
        self.kill();
        let message = format!(
            "the plugin {} did not answer for {} s while {what} and was ended",
            self.name,
            time.as_secs()
        );
        Failure::new(FailureCode::Crashed, message).remedy(UNTOUCHED)
    }

    /// Whether it still runs. Does not wait for it, so that its number stays its own.
    pub fn alive(&self) -> bool {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        let Some(number) = self.number().filter(|_| !self.ended) else {
            return false;
        };
        matches!(waitid(WaitId::Pid(number), options), Ok(None))
    }

    fn number(&self) -> Option<Pid> {
        i32::try_from(self.child.id()).ok().and_then(Pid::from_raw)
    }

    /// Ends the worker, and whatever its plugin started.
    fn kill(&mut self) -> Option<ExitStatus> {
        if std::mem::replace(&mut self.ended, true) {
            return self.child.wait().ok();
        }
        if let Some(group) = self.number() {
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = self.child.kill();
        let status = self.child.wait().ok();
        offspring::end_marked(&self.mark);
        status
    }

    /// Why the worker is gone, in a sentence.
    fn death(&mut self, what: &str) -> Failure {
        // Its own end may still be under way when the socket is already closed.
        let begin = Instant::now();
        while self.alive() && begin.elapsed() < GRACE {
            std::thread::sleep(Duration::from_millis(1));
        }
        let status = self.kill();
        // The reader of the output ends with the process.
        std::thread::sleep(Duration::from_millis(5));
        let text = self.output.text();
        let last = text.lines().rev().find(|line| !line.trim().is_empty());
        let quote = |line: &str| line[..line.floor_char_boundary(QUOTED)].trim().to_owned();
        let said = last.map(|line| format!(", saying \"{}\"", quote(line.trim())));
        let how = how_it_ended(status, &text, self.memory);
        let message = format!(
            "the plugin {} {how} while {what}{}",
            self.name,
            said.unwrap_or_default()
        );
        Failure::new(FailureCode::Crashed, message).remedy(UNTOUCHED)
    }
}

/// What a worker answered, with the descriptors that came with it.
pub type Answer = Result<(FromWorker, Vec<OwnedFd>), Failure>;

const UNTOUCHED: &str = "the rest of the session is untouched; run the step again or report it";

impl Drop for Worker {
    fn drop(&mut self) {
        self.kill();
    }
}

fn how_it_ended(status: Option<ExitStatus>, output: &str, memory: u64) -> String {
    let starved = ["memory allocation of", "bad_alloc", "out of memory"];
    if starved.iter().any(|words| output.contains(words)) {
        let gigabytes = memory as f64 / (1_u64 << 30) as f64;
        return format!("needed more memory than the {gigabytes:.1} GB that a plugin may have");
    }
    let signal = status.and_then(|status| status.signal());
    match (signal, status.and_then(|status| status.code())) {
        (Some(9), _) => "was killed from outside, perhaps because the machine lacked memory".into(),
        (Some(signal), _) => format!("crashed ({})", signal_name(signal)),
        (None, Some(LOST)) => "lost its connection to the session".into(),
        (None, Some(code)) => format!("ended its process with exit status {code}"),
        _ => "ended its process".into(),
    }
}

fn signal_name(signal: i32) -> String {
    let name = match signal {
        4 => "illegal instruction",
        5 => "trap",
        6 => "abort",
        7 => "bus error",
        8 => "arithmetic error",
        11 => "segmentation fault",
        13 => "broken pipe",
        14 => "alarm",
        15 => "terminated",
        24 => "processor time used up",
        31 => "forbidden system call",
        _ => return format!("signal {signal}"),
    };
    name.into()
}
