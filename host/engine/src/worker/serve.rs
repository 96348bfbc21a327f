//! The worker's side.

use super::protocol::{FromWorker, Sent, ToWorker, WireObject, accept, announce};
use super::socket;
use crate::job::Progress;
use crate::plugins::context::JobContext;
use crate::plugins::library::{Library, Prepared};
use crate::store::segment::Segment;
use puncta_documents::{Failure, Request};
use std::collections::HashMap;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Tells the host what running work says.
struct Reporter {
    socket: Mutex<UnixStream>,
    cancel: AtomicBool,
    last: Mutex<Option<Instant>>,
}

impl Reporter {
    fn say(&self, message: &FromWorker) {
        let socket = self.socket.lock().unwrap_or_else(PoisonError::into_inner);
        if socket::send(&socket, message, &[]).is_err() {
            end();
        }
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
        self.say(&FromWorker::Message {
            level,
            text: text.into(),
        });
    }

    fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}

/// The host is gone: so are we, without running anything more of the plugin.
fn end() -> ! {
    std::process::exit(0)
}

struct Serving {
    reporter: Arc<Reporter>,
    pool: Arc<rayon::ThreadPool>,
    library: Option<Arc<Library>>,
    prepared: Option<Prepared>,
    segments: HashMap<u64, Arc<Segment>>,
}

/// Serves calls over standard input, which is a socket, until the host goes away.
///
/// # Errors
/// When standard input is no socket, or the system gives no threads.
pub fn serve(threads: usize) -> Result<(), Failure> {
    let failed = |what: &str| Failure::internal(format!("a worker cannot {what}"));
    volunteer();
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
    });
    let (sender, orders) = mpsc::channel();
    let canceller = Arc::clone(&reporter);
    std::thread::spawn(move || listen(&listening, &canceller, &sender));
    let mut serving = Serving {
        reporter,
        pool: Arc::new(pool),
        library: None,
        prepared: None,
        segments: HashMap::new(),
    };
    for (order, descriptors) in orders {
        if let Err(failure) = serving.obey(order, descriptors) {
            serving.reporter.say(&FromWorker::Failed { failure });
        }
    }
    end()
}

/// When the machine runs out of memory, a worker goes before the session.
fn volunteer() {
    // A system that does not know this decides for itself.
    let _ = std::fs::write("/proc/self/oom_score_adj", "1000");
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
        match socket::receive::<ToWorker>(socket) {
            Ok((ToWorker::Cancel, _)) => reporter.cancel.store(true, Ordering::Relaxed),
            Ok((order, descriptors)) => {
                if matches!(order, ToWorker::Prepare { .. } | ToWorker::Run { .. }) {
                    reporter.cancel.store(false, Ordering::Relaxed);
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
            ToWorker::Open { path, door } => {
                let library = Library::open(&path, door)?;
                let manifest = Box::new(library.manifest().clone());
                self.library = Some(Arc::new(library));
                self.reporter.say(&FromWorker::Opened { manifest });
                Ok(())
            }
            ToWorker::Prepare { request } => self.prepare(&request),
            ToWorker::Run {
                inputs,
                new,
                forget,
            } => {
                for number in forget {
                    self.segments.remove(&number);
                }
                accept(&new, descriptors, &mut self.segments)?;
                self.run(inputs)
            }
            ToWorker::Drop => {
                self.prepared = None;
                Ok(())
            }
            ToWorker::Cancel => Ok(()),
        }
    }

    fn context(&self, inputs: Vec<crate::store::Object>) -> Arc<JobContext> {
        let progress: Arc<dyn Progress> = Arc::clone(&self.reporter) as Arc<dyn Progress>;
        // What a worker makes is sent away, so that there is nothing to use again.
        let memory = Arc::new(crate::store::SegmentPool::new(0));
        JobContext::new(inputs, progress, Arc::clone(&self.pool), memory)
    }

    fn prepare(&mut self, request: &Request) -> Result<(), Failure> {
        self.prepared = None;
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
        let message = FromWorker::Done { finished, new };
        let socket = self
            .reporter
            .socket
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if socket::send(&socket, &message, &descriptors).is_err() {
            end();
        }
        Ok(())
    }
}
