//! The worker's side.

use super::limits::{self, Usage};
use super::offspring;
use super::process::LOST;
use super::protocol::{FromWorker, Sent, ToWorker, WireObject, accept, announce};
use super::socket;
use crate::job::Progress;
use crate::plugins::context::{JobContext, Resources};
use crate::plugins::library::{Library, Prepared};
use crate::store::segment::Segment;
use puncta_documents::{Failure, Request};
use std::collections::HashMap;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Tells the host what running work says.
struct Reporter {
    socket: Mutex<UnixStream>,
    cancel: AtomicBool,
    last: Mutex<Option<Instant>>,
    /// Messages of the call so far.
    messages: AtomicU32,
    /// The process that may speak: a copy of it that a plugin forks may not.
    process: u32,
}

/// Messages of a call that are passed on.
const MESSAGES: u32 = 1000;
/// Bytes of a message that are passed on.
const MESSAGE: usize = 4096;

impl Reporter {
    fn say(&self, message: &FromWorker) {
        self.send(message, &[]);
    }

    fn send(&self, message: &FromWorker, descriptors: &[BorrowedFd<'_>]) {
        if std::process::id() != self.process {
            std::process::abort();
        }
        let socket = self.socket.lock().unwrap_or_else(PoisonError::into_inner);
        if socket::send(&socket, message, descriptors).is_err() {
            // The host sees from the code that it was not the plugin that ended the process.
            std::process::exit(LOST);
        }
    }

    fn begin(&self) {
        self.cancel.store(false, Ordering::Relaxed);
        self.messages.store(0, Ordering::Relaxed);
    }
}

impl Progress for Reporter {
    fn progress(&self, fraction: f64, phase: &str) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        // Nobody reads more than some twenty reports a second.
        if last.is_none_or(|last| last.elapsed() > Duration::from_millis(50)) {
            *last = Some(Instant::now());
            self.say(&FromWorker::Progress {
                fraction,
                phase: phase.into(),
            });
        }
    }

    fn message(&self, level: u32, text: &str) {
        let text = match self.messages.fetch_add(1, Ordering::Relaxed) {
            0..MESSAGES => text[..text.floor_char_boundary(MESSAGE)].into(),
            MESSAGES => "further messages of this call are left out".into(),
            _ => return,
        };
        self.say(&FromWorker::Message { level, text });
    }

    fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}

/// The host is gone: so are we and what the plugin started, without running anything more of it.
fn end() -> ! {
    offspring::end_children();
    let own = rustix::process::getpid();
    let _ = rustix::process::kill_process(own, rustix::process::Signal::KILL);
    std::process::abort()
}

struct Serving {
    reporter: Arc<Reporter>,
    pool: Arc<rayon::ThreadPool>,
    library: Option<Arc<Library>>,
    prepared: Option<Prepared>,
    /// Bytes that the prepared call may use.
    budget: u64,
    usage: Option<Usage>,
    segments: HashMap<u64, Arc<Segment>>,
}

/// Serves calls over standard input, which is a socket, until the host goes away.
///
/// # Errors
/// When standard input is no socket, or the system gives no threads.
pub fn serve(threads: usize) -> Result<(), Failure> {
    let failed = |what: &str| Failure::internal(format!("a worker cannot {what}"));
    offspring::adopt();
    let socket = take_stdin().map_err(|_| failed("use its socket"))?;
    let listening = socket.try_clone().map_err(|_| failed("use its socket"))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|_| failed("start threads"))?;
    let reporter = Arc::new(Reporter {
        socket: Mutex::new(socket),
        cancel: AtomicBool::new(false),
        last: Mutex::new(None),
        messages: AtomicU32::new(0),
        process: std::process::id(),
    });
    let (sender, orders) = mpsc::channel();
    let canceller = Arc::clone(&reporter);
    std::thread::spawn(move || listen(&listening, &canceller, &sender));
    let mut serving = Serving {
        reporter,
        pool: Arc::new(pool),
        library: None,
        prepared: None,
        budget: u64::MAX,
        usage: None,
        segments: HashMap::new(),
    };
    for (order, descriptors) in orders {
        if let Err(failure) = serving.obey(order, descriptors) {
            serving.reporter.say(&FromWorker::Failed { failure });
        }
    }
    end()
}

/// Standard input as a socket; a plugin that reads standard input finds it empty.
#[allow(unsafe_code)]
fn take_stdin() -> std::io::Result<UnixStream> {
    let own = rustix::io::fcntl_dupfd_cloexec(std::io::stdin(), 3)?;
    let null = std::fs::File::open("/dev/null")?;
    rustix::stdio::dup2_stdin(&null)?;
    Ok(UnixStream::from(own))
}

fn listen(
    socket: &UnixStream,
    reporter: &Reporter,
    orders: &mpsc::Sender<(ToWorker, Vec<OwnedFd>)>,
) {
    loop {
        match socket::receive::<ToWorker>(socket, &|| true) {
            Ok((ToWorker::Cancel, _)) => reporter.cancel.store(true, Ordering::Relaxed),
            Ok((order, descriptors)) => {
                if matches!(order, ToWorker::Prepare { .. } | ToWorker::Run { .. }) {
                    reporter.begin();
                }
                if orders.send((order, descriptors)).is_err() {
                    end();
                }
            }
            Err(_) => end(),
        }
    }
}

impl Serving {
    fn obey(&mut self, order: ToWorker, descriptors: Vec<OwnedFd>) -> Result<(), Failure> {
        match order {
            ToWorker::Open { path, door, memory } => {
                limits::impose(memory);
                let library = Library::open(&path, door)?;
                let manifest = Box::new(library.manifest().clone());
                self.library = Some(Arc::new(library));
                self.usage = Some(Usage::now());
                self.reporter.say(&FromWorker::Opened { manifest });
                Ok(())
            }
            ToWorker::Prepare { request } => self.prepare(&request),
            ToWorker::Run {
                inputs,
                new,
                forget,
            } => {
                self.forget(&forget);
                accept(&new, descriptors, &mut self.segments)?;
                self.run(inputs)
            }
            ToWorker::Forget { segments } => {
                self.forget(&segments);
                Ok(())
            }
            ToWorker::Drop => {
                self.prepared = None;
                let worn = self.tidy();
                self.reporter.say(&FromWorker::Rested { worn });
                Ok(())
            }
            ToWorker::Cancel => Ok(()),
        }
    }

    fn context(&self, inputs: Vec<crate::store::Object>) -> Arc<JobContext> {
        let progress: Arc<dyn Progress> = Arc::clone(&self.reporter) as Arc<dyn Progress>;
        // What a worker makes is sent away, so that there is nothing to use again.
        let resources = Resources {
            threads: Arc::clone(&self.pool),
            memory: Arc::new(crate::store::SegmentPool::new(0)),
            budget: self.budget,
        };
        JobContext::new(inputs, progress, resources)
    }

    fn forget(&mut self, segments: &[u64]) {
        for number in segments {
            self.segments.remove(number);
        }
    }

    /// Ends what the call left behind. What it left that cannot be undone here.
    fn tidy(&self) -> Option<String> {
        if offspring::end_children() {
            let text = "left a process behind, which was ended".into();
            self.reporter.say(&FromWorker::Message { level: 2, text });
        }
        self.usage.and_then(|usage| usage.excess())
    }

    fn prepare(&mut self, request: &Request) -> Result<(), Failure> {
        self.prepared = None;
        self.budget = request.memory.unwrap_or(u64::MAX);
        let library = self
            .library
            .as_ref()
            .ok_or_else(|| Failure::internal("nothing is open"))?;
        let prepared = library.prepare(&self.context(Vec::new()), request)?;
        let plan = (**prepared.plan()).clone();
        self.prepared = Some(prepared);
        self.reporter.say(&FromWorker::Prepared { plan });
        Ok(())
    }

    fn run(&mut self, inputs: Vec<WireObject>) -> Result<(), Failure> {
        let prepared = self
            .prepared
            .as_ref()
            .ok_or_else(|| Failure::internal("nothing is prepared"))?;
        let inputs = inputs
            .into_iter()
            .map(|input| input.unwire(&self.segments))
            .collect::<Result<_, _>>()?;
        let context = self.context(inputs);
        prepared.run(&context)?;
        let mut sent = Sent::default();
        let finished = context.take_finished();
        let finished = finished
            .iter()
            .map(|one| sent.finished(one))
            .collect::<Result<Vec<_>, _>>()?;
        let (new, descriptors) = announce(sent.segments())?;
        self.reporter
            .send(&FromWorker::Done { finished, new }, &descriptors);
        Ok(())
    }
}
