//! `device.core/1`, by a retarder that is simulated on a pseudo-terminal: it moves by one wave a
//! second, and its driver waits 0.1 s more. What must come within 50 ms gets four times that.
//! Each call keeps the rules of `DeviceCore1`, on which every `unsafe` relies.
#![allow(unsafe_code, clippy::unwrap_used, clippy::expect_used)]

use puncta_abi::{DEVICE_CORE_1, DeviceCore1, STATUS_CANCELLED, STATUS_FAILED, STATUS_OK, Str};
use puncta_engine::plugins::Library;
use serialport::{SerialPort, TTYPort};
use std::io::{ErrorKind, Read, Write};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_millis(200);
const RETARDANCE: Str = Str::new("retardance");

struct Element {
    from: f64,
    to: f64,
    begun: Instant,
    /// What it says when asked for its retardance.
    answer: fn(f64) -> String,
}

impl Element {
    fn waves(&self) -> f64 {
        let way = self.begun.elapsed().as_secs_f64();
        self.from + (self.to - self.from).clamp(-way, way)
    }
}

/// The simulated element, and the end of its line for the driver; without that, the thread ends.
fn simulate() -> (Arc<Mutex<Element>>, TTYPort) {
    let (mut port, end) = TTYPort::pair().unwrap();
    let element = Element {
        from: 0.25,
        to: 0.25,
        begun: Instant::now(),
        answer: |waves| format!("L {waves:.4}\r"),
    };
    let element = Arc::new(Mutex::new(element));
    let shared = Arc::clone(&element);
    std::thread::spawn(move || {
        let (mut line, mut byte) = (String::new(), [0]);
        loop {
            match port.read(&mut byte) {
                Ok(1) => line.push(char::from(byte[0])),
                Err(error) if error.kind() == ErrorKind::TimedOut => continue,
                _ => return,
            }
            let mut element = shared.lock().unwrap();
            let here = element.waves();
            if line == "L?\r" {
                port.write_all((element.answer)(here).as_bytes()).unwrap();
            } else if line.ends_with(['\r', '\x1b']) {
                let to = line.trim().trim_start_matches("L ").parse().unwrap_or(here);
                (element.from, element.to, element.begun) = (here, to, Instant::now());
            } else {
                continue;
            }
            line.clear();
        }
    });
    (element, end)
}

#[derive(Clone, Copy)]
struct Device(&'static DeviceCore1, u64);
type Outcome<T> = Result<T, (u32, String)>;

fn outcome<T: Default>(work: impl FnOnce(*mut T, *mut Str) -> u32) -> Outcome<T> {
    let (mut value, mut message) = (T::default(), Str::EMPTY);
    match work(&raw mut value, &raw mut message) {
        STATUS_OK => Ok(value),
        status => Err((status, unsafe { message.as_str() }.unwrap().to_owned())),
    }
}

macro_rules! ask {
    ($device:expr, $name:ident $(, $argument:expr)*) => { outcome(|value, message| unsafe {
        $device.0.$name.unwrap()($device.1 $(, $argument)*, value, message)
    }) };
}

macro_rules! tell {
    ($device:expr, $name:ident $(, $argument:expr)*) => { outcome(|_: *mut (), message| unsafe {
        $device.0.$name.unwrap()($device.1 $(, $argument)*, message)
    }) };
}

fn open(port: &str) -> Outcome<Device> {
    let library = Library::open(&puncta_tests::library("puncta_test_retarder"), true).unwrap();
    let table = library.table(DEVICE_CORE_1).cast::<DeviceCore1>();
    let table = unsafe { table.as_ref() }.expect("the plugin has the table device.core/1");
    let settings = format!(r#"{{"format": "puncta.device-settings/1", "port": "{port}"}}"#);
    let plugin = Device(table, library.instance());
    ask!(plugin, open, Str::new(&settings), 5.0).map(|number| Device(table, number))
}

fn failed<T: std::fmt::Debug>(outcome: Outcome<T>, sentence: &str) {
    let (status, text) = outcome.unwrap_err();
    assert!(text.contains(sentence), "{text}");
    assert_eq!(status, STATUS_FAILED);
}

fn cancelled(outcome: Outcome<u32>) {
    assert_eq!(outcome.unwrap_err().0, STATUS_CANCELLED);
}

#[test]
fn starts_polls_and_settles() {
    let (element, end) = simulate();
    let device = open(&end.name().unwrap()).unwrap();
    assert_eq!(element.lock().unwrap().to, 0.25, "opening moves nothing");
    let mut text = Str::EMPTY;
    let status = unsafe { device.0.describe.unwrap()(device.1, &raw mut text) };
    assert!(status == STATUS_OK && unsafe { text.as_str() }.unwrap().contains(r#""max":1.0"#));
    assert_eq!(ask!(device, read, Str::new("settle_time"), 0.0), Ok(0.1));
    let begun = Instant::now();
    let token = ask!(device, start, RETARDANCE, 0.75).unwrap();
    assert!(begun.elapsed() < SOON, "start returns at once");
    assert_eq!(ask!(device, poll, token, 0.05), Ok(0));
    assert!(begun.elapsed() < 2 * SOON, "poll returns at its deadline");
    assert_eq!(ask!(device, poll, token, 30.0), Ok(1));
    assert!(begun.elapsed() >= 3 * SOON, "arrived and settled");
    assert_eq!(ask!(device, read, RETARDANCE, 5.0), Ok(0.75));
    let later = ask!(device, start, RETARDANCE, 0.7).unwrap();
    cancelled(ask!(device, poll, token, 0.0));
    while ask!(device, poll, later, 0.0).unwrap() == 0 {}
    unsafe { device.0.close.unwrap()(device.1) };
    assert_eq!(element.lock().unwrap().to, 0.7, "closing moves nothing");
}

#[test]
fn refuses_and_reports() {
    let (element, end) = simulate();
    let device = open(&end.name().unwrap()).unwrap();
    for value in [-0.01, 1.01, f64::NAN, f64::INFINITY] {
        failed(ask!(device, start, RETARDANCE, value), "use 0 to 1");
    }
    let settle_time = Str::new("settle_time");
    failed(ask!(device, start, settle_time, 0.2), "can be set");
    failed(open("/dev/none").map(|_| ()), "/dev/none has no serial");
    assert_eq!(element.lock().unwrap().to, 0.25, "refused: not moved");
    element.lock().unwrap().answer = |_| "E 7\r".into();
    failed(ask!(device, read, RETARDANCE, 5.0), "E 7");
    element.lock().unwrap().answer = |_| "L 0.".into();
    let token = ask!(device, start, RETARDANCE, 0.3).unwrap();
    let begun = Instant::now();
    failed(ask!(device, read, RETARDANCE, 0.1), "does not answer");
    assert!(begun.elapsed() < 2 * SOON);
    failed(ask!(device, poll, token, 5.0), "does not answer");
    failed(tell!(device, safe_state, 5.0), "does not answer");
    assert!(begun.elapsed() < 25 * SOON, "it is given up early");
    assert_eq!(element.lock().unwrap().to, 0.0, "but told to be safe");
}

#[test]
fn halt_interrupts() {
    let (element, end) = simulate();
    let device = open(&end.name().unwrap()).unwrap();
    let token = ask!(device, start, RETARDANCE, 1.0).unwrap();
    let halting = std::thread::spawn(move || {
        std::thread::sleep(SOON);
        let now = Instant::now();
        tell!(device, halt).map(|()| now)
    });
    cancelled(ask!(device, poll, token, 30.0));
    assert!(halting.join().unwrap().unwrap().elapsed() < SOON);
    cancelled(ask!(device, poll, token, 0.0));
    let here = ask!(device, read, RETARDANCE, 5.0).unwrap();
    assert!(0.3 < here && here < 1.0, "{here}");
    assert_eq!(tell!(device, safe_state, 30.0), Ok(()));
    assert_eq!(element.lock().unwrap().waves(), 0.0);
}

/// The test again as the worker, which holds the device that the variable names.
#[test]
fn without_its_host_a_worker_makes_the_device_safe() {
    const NAME: &str = "without_its_host_a_worker_makes_the_device_safe";
    if let Ok(port) = std::env::var(NAME) {
        return hold(&port);
    }
    let (element, end) = simulate();
    let mut worker = Command::new(std::env::current_exe().unwrap());
    worker.args(["--exact", NAME]).stdin(Stdio::piped());
    let mut worker = worker.env(NAME, end.name().unwrap()).spawn().unwrap();
    while element.lock().unwrap().waves() < 0.5 {
        assert!(worker.try_wait().unwrap().is_none(), "it ended early");
        std::thread::sleep(SOON / 20);
    }
    drop(worker.stdin.take());
    assert!(worker.wait().unwrap().success());
    assert_eq!(element.lock().unwrap().waves(), 0.0);
}

/// A thread listens to the host while this one waits for the device.
fn hold(port: &str) {
    let device = open(port).unwrap();
    let token = ask!(device, start, RETARDANCE, 1.0).unwrap();
    std::thread::spawn(move || {
        std::io::stdin().read_to_end(&mut Vec::new()).unwrap();
        tell!(device, halt).unwrap();
    });
    cancelled(ask!(device, poll, token, 30.0));
    assert_eq!(tell!(device, safe_state, 10.0), Ok(()));
    unsafe { device.0.close.unwrap()(device.1) };
}
