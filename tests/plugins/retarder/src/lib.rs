//! A driver of a liquid-crystal retarder on a serial port, with `device.core/1` written by hand.
//!
//! The protocol is after the VariLC's: lines end with CR, `L <waves>` sets the retardance, `L?` is
//! answered by `L <waves>`, ESC stops the element. What every `unsafe` relies on: the host keeps
//! the rules of [`DeviceCore1`]; its texts and places live as long as the call, and a device's
//! number comes from `open` and is not used after `close`.
#![allow(unsafe_code)]

use puncta_sdk::abi::{self, DeviceCore1, Str};
use puncta_sdk::{documents, serde_json::Value, serde_json::json};
use serialport::TTYPort;
use std::io::{ErrorKind, Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::{cell::RefCell, ptr::null};

/// The longest wait that does not look for a halt.
const SLICE: Duration = Duration::from_millis(10);
/// A device that owes an answer for longer is gone.
const PATIENCE: Duration = Duration::from_millis(500);
const SILENT: &str = "does not answer in time; check its power and cable";
/// Largest retardance, in waves.
const MOST: f64 = 1.0;

puncta_sdk::plugin! {
    id: "test.retarder",
    title: "Retarder",
    description: "A liquid-crystal retarder on a serial port.",
    tables: |id| if id == abi::DEVICE_CORE_1 { (&raw const TABLE).cast() } else { null() },
}

/// What failed, in a sentence; without one: halted, or superseded by a later start.
type Result<T> = std::result::Result<T, Option<String>>;

type Answer = Result<Option<f64>>;
type Enough<'a> = &'a dyn Fn(&mut Line, Instant, f64) -> bool;

#[derive(Default)]
struct Line {
    received: String,
    /// When the one open question was asked: a late answer is never taken for a new one.
    asked: Option<Instant>,
    /// Token of the newest motion, and how often the device was halted before it.
    motion: (u64, u64),
    target: f64,
    begun: Option<Instant>,
    arrived: Option<Instant>,
}

struct Device {
    name: String,
    document: String,
    settle_time: f64,
    line: Mutex<(TTYPort, Line)>,
    /// The port and how often it was halted; nobody holds it while waiting.
    writer: Mutex<(TTYPort, u64)>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Device {
    fn open(settings: &str, seconds: f64) -> Result<Device> {
        let settings: Value = documents::parse(settings, "puncta.device-settings/1")
            .map_err(|why| format!("the settings of the retarder are {why}"))?;
        let path = settings["port"].as_str().unwrap_or_default();
        let name = format!("the retarder on {path}");
        let failed = |error| format!("{name} has no serial port: {error}");
        let builder = serialport::new(path, 9600).timeout(SLICE);
        let port = builder.open_native().map_err(failed)?;
        let writer = Mutex::new((port.try_clone_native().map_err(failed)?, 0));
        let properties = json!({"title": "Liquid-crystal retarder", "properties": [
            {"name": "retardance", "unit": "1", "min": 0, "max": MOST, "description": "In waves."},
            {"name": "settle_time", "unit": "s", "read_only": true},
        ]});
        let device = Device {
            name,
            document: documents::write(&properties, "puncta.device/1"),
            settle_time: settings["settle_time"].as_f64().unwrap_or(0.1),
            line: Mutex::new((port, Line::default())),
            writer,
        };
        device.read("retardance", seconds).map(|_| device)
    }

    fn read(&self, property: &str, seconds: f64) -> Result<f64> {
        let (now, halts) = (Instant::now(), lock(&self.writer).1);
        match property {
            "settle_time" => Ok(self.settle_time),
            "retardance" => {
                let waves = self.listen(seconds, halts, &|_, asked, _| asked >= now)?;
                waves.ok_or_else(|| self.failed(SILENT))
            }
            _ => Err(self.failed(&format!("has no property {property}"))),
        }
    }

    fn start(&self, property: &str, value: f64) -> Result<u64> {
        let refused = match property {
            "retardance" if (0.0..=MOST).contains(&value) => return self.go(value),
            "retardance" => format!("cannot go to {value} waves; use 0 to {MOST}"),
            _ => format!("has no property {property} that can be set"),
        };
        Err(self.failed(&refused))
    }

    fn go(&self, target: f64) -> Result<u64> {
        let line = &mut lock(&self.line).1;
        let halts = lock(&self.writer).1;
        self.tell(&format!("L {target:.4}\r"), Some(halts))?;
        line.motion = (line.motion.0 + 1, halts);
        (line.target, line.begun, line.arrived) = (target, Some(Instant::now()), None);
        Ok(line.motion.0)
    }

    fn poll(&self, token: u64, seconds: f64) -> Result<bool> {
        let (newest, halts) = lock(&self.line).1.motion;
        let settled = |line: &mut Line, asked, waves: f64| {
            let there = Some(asked) >= line.begun && (waves - line.target).abs() < 1e-4;
            line.arrived = there.then(|| line.arrived.unwrap_or_else(Instant::now));
            let rest = line.arrived.map(|arrived| arrived.elapsed().as_secs_f64());
            rest.is_some_and(|rest| rest >= self.settle_time)
        };
        match newest == token {
            true => Ok(self.listen(seconds, halts, &settled)?.is_some()),
            false => Err(None),
        }
    }

    fn safe_state(&self, seconds: f64) -> Result<()> {
        match self.poll(self.go(0.0)?, seconds)? {
            true => Ok(()),
            false => Err(self.failed("was told to go to 0 and is not yet there")),
        }
    }

    /// Halts are counted under the lock: what was told before is stopped, what is later not told.
    fn tell(&self, text: &str, halts: Option<u64>) -> Result<()> {
        let mut writer = lock(&self.writer);
        match halts {
            Some(halts) if halts != writer.1 => return Err(None),
            Some(_) => {}
            None => writer.1 += 1,
        }
        let told = writer.0.write_all(text.as_bytes());
        told.map_err(|error| self.failed(&format!("cannot be told {text:?}: {error}")))
    }

    /// Asks until an answer is `enough`, and gives it; `None` when `seconds` pass first.
    fn listen(&self, seconds: f64, halts: u64, enough: Enough) -> Answer {
        let wait = Duration::try_from_secs_f64(seconds.clamp(0.0, 1e5)).unwrap_or_default();
        let until = Instant::now() + wait;
        let (port, line) = &mut *lock(&self.line);
        loop {
            if line.asked.is_none() {
                self.tell("L?\r", Some(halts))?;
            }
            let asked = *line.asked.get_or_insert_with(Instant::now);
            let mut bytes = [0; 64];
            match port.read(&mut bytes) {
                Ok(count @ 1..) => line.received += &String::from_utf8_lossy(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::TimedOut => {}
                lost => return Err(self.failed(&format!("is no longer connected ({lost:?})"))),
            }
            if let Some(end) = line.received.find('\r') {
                let text = line.received.drain(..=end).collect::<String>();
                let Some(Ok(waves)) = text.trim().strip_prefix("L ").map(str::parse) else {
                    return Err(self.failed(&format!("says {text:?}; look at its display")));
                };
                line.asked = None;
                if enough(line, asked, waves) {
                    return Ok(Some(waves));
                }
                std::thread::sleep(SLICE);
            } else if asked.elapsed() > PATIENCE {
                line.asked = None;
                return Err(self.failed(SILENT));
            }
            if lock(&self.writer).1 != halts {
                return Err(None);
            } else if Instant::now() >= until {
                return Ok(None);
            }
        }
    }

    fn failed(&self, what: &str) -> Option<String> {
        Some(format!("{} {what}", self.name))
    }
}

/// Runs `work`; its result goes to `out`, its sentence to `message`, kept for each thread.
fn call<T>(out: *mut T, message: *mut Str, work: impl FnOnce() -> Result<T>) -> u32 {
    thread_local!(static KEPT: RefCell<String> = const { RefCell::new(String::new()) });
    let (status, text) = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => {
            unsafe { out.write(value) };
            return abi::STATUS_OK;
        }
        Ok(Err(None)) => (abi::STATUS_CANCELLED, "the retarder was stopped".into()),
        Ok(Err(Some(text))) => (abi::STATUS_FAILED, text),
        Err(_) => (abi::STATUS_PANICKED, "the retarder panicked".into()),
    };
    KEPT.set(text);
    KEPT.with_borrow(|text| unsafe { message.write(Str::new(text)) });
    status
}

fn device<'a>(number: u64) -> &'a Device {
    unsafe { &*(number as *const Device) }
}

fn text<'a>(text: Str) -> &'a str {
    unsafe { text.as_str() }.unwrap_or("")
}

unsafe extern "C" fn describe(number: u64, document: *mut Str) -> u32 {
    unsafe { document.write(Str::new(&device(number).document)) };
    abi::STATUS_OK
}

unsafe extern "C" fn close(number: u64) {
    drop(unsafe { Box::from_raw(number as *mut Device) });
}

macro_rules! table {
    ($($name:ident($($arg:ident: $type:ty),*) -> $out:expr, $work:expr;)*) => {
        $(unsafe extern "C" fn $name($($arg: $type,)* message: *mut Str) -> u32 {
            call($out, message, || $work)
        })*
        static TABLE: DeviceCore1 = DeviceCore1 {
            size: size_of::<DeviceCore1>() as u32,
            reserved: 0,
            describe: Some(describe),
            close: Some(close),
            $($name: Some($name),)*
        };
    };
}

table! {
    open(_instance: u64, settings: Str, seconds: f64, number: *mut u64) -> number,
        Device::open(text(settings), seconds).map(|device| Box::into_raw(Box::new(device)) as u64);
    read(number: u64, property: Str, seconds: f64, value: *mut f64) -> value,
        device(number).read(text(property), seconds);
    start(number: u64, property: Str, value: f64, token: *mut u64) -> token,
        device(number).start(text(property), value);
    poll(number: u64, token: u64, seconds: f64, done: *mut u32) -> done,
        device(number).poll(token, seconds).map(u32::from);
    halt(number: u64) -> &mut (), device(number).tell("\x1b", None);
    safe_state(number: u64, seconds: f64) -> &mut (), device(number).safe_state(seconds);
}
