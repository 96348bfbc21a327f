//! The host's side: workers, and calls in them.

use super::protocol::{FromWorker, Sent, ToWorker, accept, announce};
use super::socket;
use crate::job::Progress;
use crate::plugins::Finished;
use crate::store::{Object, Segment};
use puncta_documents::{Failure, FailureCode, Manifest, Plan, Request};
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use std::collections::{HashMap, VecDeque};
use std::io::{self, Read};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// A worker that was told to stop has this long before it is ended.
const GRACE: Duration = Duration::from_millis(200);
/// How often a waiting host looks whether the person cancelled.
const GLANCE: Duration = Duration::from_millis(20);
/// A worker that nobody called for so long is ended when the next one is called.
const IDLE: Duration = Duration::from_secs(60);
/// How long a frame may take that has begun.
const FRAME: Duration = Duration::from_secs(10);
/// Bytes of a worker's last words that are kept.
const LAST_WORDS: usize = 4096;

/// A worker process with one plugin in it.
pub struct Worker {
    child: Child,
    socket: UnixStream,
    /// What the plugin is called in messages.
    name: String,
    /// Segments that the worker has mapped.
    known: HashMap<u64, Weak<Segment>>,
    last_words: Arc<Mutex<VecDeque<u8>>>,
    /// Whether its process has been waited for.
    ended: bool,
}

fn broken(what: &str, error: &io::Error) -> Failure {
    Failure::new(
        FailureCode::Resources,
        format!("cannot {what} a worker process: {error}"),
    )
}

impl Worker {
    /// Starts a worker.
    ///
    /// # Errors
    /// When the system starts no process.
    pub fn start(program: &Path, threads: usize, name: &str) -> Result<Worker, Failure> {
        let (socket, other) = UnixStream::pair().map_err(|e| broken("reach", &e))?;
        let mut child = Command::new(program)
            .args(["worker", "--threads", &threads.to_string()])
            .stdin(Stdio::from(OwnedFd::from(other)))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            // A group of its own: what a plugin starts ends with its worker.
            .process_group(0)
            .spawn()
            .map_err(|e| broken("start", &e))?;
        // A frame that has begun arrives whole; a worker that stops in the middle is broken.
        socket
            .set_read_timeout(Some(FRAME))
            .map_err(|e| broken("reach", &e))?;
        let last_words = Arc::new(Mutex::new(VecDeque::new()));
        if let Some(stderr) = child.stderr.take() {
            let words = Arc::clone(&last_words);
            std::thread::spawn(move || keep_last_words(stderr, &words));
        }
        Ok(Worker {
            child,
            socket,
            name: name.into(),
            known: HashMap::new(),
            last_words,
            ended: false,
        })
    }

    /// Opens the library at `path`.
    ///
    /// # Errors
    /// When it cannot be opened, or the worker dies of it.
    pub fn open(&mut self, path: &Path, door: bool) -> Result<Manifest, Failure> {
        self.say(
            &ToWorker::Open {
                path: path.into(),
                door,
            },
            &[],
        )?;
        match self.wait(&crate::job::Unwatched, "opening it")? {
            (FromWorker::Opened { manifest }, _) => Ok(*manifest),
            _ => Err(self.confused()),
        }
    }

    fn say(
        &mut self,
        message: &ToWorker,
        descriptors: &[std::os::fd::BorrowedFd<'_>],
    ) -> Result<(), Failure> {
        match socket::send(&self.socket, message, descriptors) {
            Ok(()) => Ok(()),
            Err(_) => Err(self.death("it was called")),
        }
    }

    /// Waits for an answer, passing on what the work says.
    fn wait(
        &mut self,
        progress: &dyn Progress,
        what: &str,
    ) -> Result<(FromWorker, Vec<OwnedFd>), Failure> {
        let mut told: Option<Instant> = None;
        loop {
            if !self.readable() {
                match told {
                    None if progress.cancelled() => {
                        self.say(&ToWorker::Cancel, &[])?;
                        told = Some(Instant::now());
                    }
                    Some(since) if since.elapsed() > GRACE => {
                        self.kill();
                        return Err(Failure::cancelled());
                    }
                    _ => {}
                }
                continue;
            }
            match socket::receive::<FromWorker>(&self.socket) {
                Ok((FromWorker::Progress { fraction, phase }, _)) => {
                    progress.progress(fraction, &phase);
                }
                Ok((FromWorker::Message { level, text }, _)) => progress.message(level, &text),
                Ok((FromWorker::Failed { failure }, _)) => return Err(failure),
                Ok(answer) => return Ok(answer),
                Err(_) => return Err(self.death(what)),
            }
        }
    }

    /// Whether the worker said something, or ended, within a glance.
    fn readable(&self) -> bool {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let mut fds = [PollFd::new(&self.socket, PollFlags::IN)];
        let timeout = Timespec {
            tv_sec: 0,
            tv_nsec: GLANCE.as_nanos() as i64,
        };
        match poll(&mut fds, Some(&timeout)) {
            Ok(count) => count > 0,
            // An interrupted wait is another glance; anything else shows when reading.
            Err(error) => error != rustix::io::Errno::INTR,
        }
    }

    fn confused(&mut self) -> Failure {
        self.kill();
        Failure::internal(format!("the worker of {} gave a wrong answer", self.name))
    }

    /// Whether it still runs. Does not wait for it, so that its number stays its own.
    fn alive(&self) -> bool {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        let number = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        let Some(number) = number.filter(|_| !self.ended) else {
            return false;
        };
        matches!(waitid(WaitId::Pid(number), options), Ok(None))
    }

    /// Ends the worker, and whatever its plugin started.
    fn kill(&mut self) -> Option<std::process::ExitStatus> {
        if !std::mem::replace(&mut self.ended, true) {
            let group = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
            if let Some(group) = group {
                let _ = kill_process_group(group, Signal::KILL);
            }
            let _ = self.child.kill();
        }
        self.child.wait().ok()
    }

    /// Why the worker is gone, in a sentence.
    fn death(&mut self, what: &str) -> Failure {
        // Its own end may still be under way when the socket is already closed.
        let begin = Instant::now();
        while self.alive() && begin.elapsed() < GRACE {
            std::thread::sleep(Duration::from_millis(1));
        }
        let how = match self.kill() {
            Some(status) => match (status.signal(), status.code()) {
                (Some(signal), _) => format!("crashed ({})", signal_name(signal)),
                (None, Some(code)) => format!("ended its process with code {code}"),
                _ => "ended its process".into(),
            },
            None => "ended its process".into(),
        };
        // The reader of the last words ends with the process.
        std::thread::sleep(Duration::from_millis(5));
        let words = self
            .last_words
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let (front, back) = words.as_slices();
        let text = String::from_utf8_lossy(&[front, back].concat()).into_owned();
        let last = text.lines().rev().find(|line| !line.trim().is_empty());
        let said = last
            .map(|line| format!(", saying \"{}\"", line.trim()))
            .unwrap_or_default();
        let message = format!("the plugin {} {how} while {what}{said}", self.name);
        Failure::new(FailureCode::Crashed, message)
            .remedy("the rest of the session is untouched; run the step again or report it")
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.kill();
    }
}

fn keep_last_words(mut from: impl Read, words: &Mutex<VecDeque<u8>>) {
    let mut buffer = [0; 1024];
    while let Ok(count) = from.read(&mut buffer) {
        if count == 0 {
            return;
        }
        let mut kept = words.lock().unwrap_or_else(PoisonError::into_inner);
        kept.extend(&buffer[..count]);
        let excess = kept.len().saturating_sub(LAST_WORDS);
        kept.drain(..excess);
    }
}

fn signal_name(signal: i32) -> String {
    let name = match signal {
        4 => "illegal instruction",
        6 => "abort",
        7 => "bus error",
        8 => "arithmetic error",
        9 => "killed",
        11 => "segmentation fault",
        15 => "terminated",
        _ => return format!("signal {signal}"),
    };
    name.into()
}

/// Idle workers by plugin.
pub struct Pool {
    program: PathBuf,
    threads: usize,
    idle: Mutex<HashMap<PathBuf, Vec<(Instant, Worker)>>>,
}

impl Pool {
    /// A pool of workers that run `program` (this same binary) with so many threads each.
    #[must_use]
    pub fn new(program: PathBuf, threads: usize) -> Pool {
        Pool {
            program,
            threads,
            idle: Mutex::default(),
        }
    }

    /// Describes a library in a worker that is thrown away.
    ///
    /// # Errors
    /// When it cannot be opened, or the worker dies of it.
    pub fn describe(&self, path: &Path, door: bool) -> Result<Manifest, Failure> {
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        Worker::start(&self.program, 1, &name.unwrap_or_default())?.open(path, door)
    }

    fn idle(&self) -> MutexGuard<'_, HashMap<PathBuf, Vec<(Instant, Worker)>>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Prepares a call in a worker of the plugin at `path`.
    ///
    /// # Errors
    /// What the plugin refuses, or how its worker died.
    pub fn prepare(
        self: &Arc<Self>,
        path: &Path,
        door: bool,
        name: &str,
        request: &Request,
        progress: &dyn Progress,
    ) -> Result<Prepared, Failure> {
        let idle = self.take_idle(path);
        let mut worker = match idle {
            Some(worker) => worker,
            None => {
                let mut worker = Worker::start(&self.program, self.threads, name)?;
                worker.open(path, door)?;
                worker
            }
        };
        worker.say(
            &ToWorker::Prepare {
                request: request.clone(),
            },
            &[],
        )?;
        let what = format!("preparing {}", request.operation);
        match worker.wait(progress, &what) {
            Ok((FromWorker::Prepared { plan }, _)) => Ok(Prepared {
                worker: Some(worker),
                pool: Arc::clone(self),
                path: path.into(),
                operation: request.operation.clone(),
                plan: Arc::new(plan),
            }),
            Ok(_) => Err(worker.confused()),
            Err(failure) => {
                self.give_back(path, worker, &failure);
                Err(failure)
            }
        }
    }

    /// A worker that waits for a call of this plugin. Those that waited too long are ended.
    fn take_idle(&self, path: &Path) -> Option<Worker> {
        let mut idle = self.idle();
        let mut old = Vec::new();
        for waiting in idle.values_mut() {
            let long = |(since, _): &(Instant, Worker)| since.elapsed() > IDLE;
            old.extend(waiting.extract_if(.., |one| long(one)));
        }
        let found = idle.get_mut(path).and_then(Vec::pop);
        drop(idle);
        // Ending a process takes longer than the lock should be held.
        drop(old);
        found.map(|(_, worker)| worker)
    }

    /// Keeps a worker for the next call, unless the failure was its death.
    fn give_back(&self, path: &Path, worker: Worker, failure: &Failure) {
        if worker.alive() && failure.code != FailureCode::Crashed {
            let now = Instant::now();
            self.idle()
                .entry(path.into())
                .or_default()
                .push((now, worker));
        }
    }
}

/// A prepared call in a worker.
pub struct Prepared {
    worker: Option<Worker>,
    pool: Arc<Pool>,
    path: PathBuf,
    operation: String,
    plan: Arc<Plan>,
}

impl Prepared {
    /// What the call will do.
    #[must_use]
    pub fn plan(&self) -> &Arc<Plan> {
        &self.plan
    }

    /// Runs it with these inputs.
    ///
    /// # Errors
    /// What the plugin fails with, or how its worker died.
    pub fn run(
        &mut self,
        inputs: &[Object],
        progress: &dyn Progress,
    ) -> Result<Vec<Finished>, Failure> {
        let what = format!("running {}", self.operation);
        let mut sent = Sent::default();
        let wired = inputs
            .iter()
            .enumerate()
            .map(|(i, object)| sent.input(object, i, &self.plan))
            .collect::<Result<Vec<_>, _>>()?;
        let worker = self
            .worker
            .as_mut()
            .ok_or_else(|| Failure::internal("the call's worker is gone; prepare it again"))?;
        let fresh: Vec<Arc<Segment>> = sent
            .segments()
            .iter()
            .filter(|segment| !worker.known.contains_key(&segment.id()))
            .cloned()
            .collect();
        let forget: Vec<u64> = worker
            .known
            .iter()
            .filter(|(_, segment)| segment.strong_count() == 0)
            .map(|(number, _)| *number)
            .collect();
        forget
            .iter()
            .for_each(|number| drop(worker.known.remove(number)));
        worker
            .known
            .extend(fresh.iter().map(|one| (one.id(), Arc::downgrade(one))));
        let (new, descriptors) = announce(&fresh)?;
        worker.say(
            &ToWorker::Run {
                inputs: wired,
                new,
                forget,
            },
            &descriptors,
        )?;
        let (finished, new, received) = match worker.wait(progress, &what) {
            Ok((FromWorker::Done { finished, new }, received)) => (finished, new, received),
            Ok(_) => return Err(worker.confused()),
            Err(failure) => {
                if !worker.alive() {
                    self.worker = None;
                }
                return Err(failure);
            }
        };
        let mut segments = HashMap::new();
        accept(&new, received, &mut segments)?;
        finished
            .into_iter()
            .map(|one| one.unwire(&segments))
            .collect()
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        if let Some(mut worker) = self.worker.take()
            && worker.say(&ToWorker::Drop, &[]).is_ok()
        {
            self.pool
                .give_back(&self.path, worker, &Failure::internal(""));
        }
    }
}
