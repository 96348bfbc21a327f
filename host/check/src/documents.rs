//! Checks of requests and plans.

use crate::check::Check;
use crate::child::{Case, Found, Ground, Verdict, survives};
use crate::host::Session;
use crate::item::Item;
use crate::plugin::{Ended, Instance};
use crate::setting::Setting;
use puncta_abi as abi;
use puncta_engine::documents::call::REQUEST;
use puncta_engine::documents::{self, Map, Parameter, ParameterKind, number};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a plan may take.
const SOON: Duration = Duration::from_secs(1);
/// Damaged requests for each operation.
const DAMAGED: u64 = 60;

pub fn find(check: Check, ground: &Ground) -> Option<Found> {
    let one: fn(&Ground, &Instance, &Case<'_>) -> Result<(), String> = match check {
        Check::BadRequests => bad_requests,
        Check::FutureRequest => future_request,
        Check::AtLimits => at_limits,
        Check::BeyondLimits => beyond_limits,
        Check::PrepareQuick => prepare_quick,
        Check::Plans => return Some(plans(ground)),
        Check::UnknownOperation => return Some(unknown_operation(ground)),
        Check::PanicContained => return Some(panic_contained(ground)),
        _ => return None,
    };
    let found = ground
        .instance()
        .and_then(|instance| ground.each(&instance, |case| one(ground, &instance, case)));
    Some(found)
}

fn request(setting: &Setting) -> String {
    documents::write(&setting.request(), REQUEST)
}

/// Asks for a plan and drops it again.
fn planned(instance: &Instance, setting: &Setting, text: &[u8]) -> Option<Ended> {
    let session = Arc::new(Session::new(setting));
    match instance.prepare_text(&session, text) {
        Ok(prepared) => {
            instance.drop(prepared);
            None
        }
        Err(ended) => Some(*ended),
    }
}

fn plans(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let examples = &ground.material.examples;
    let mut notes = Vec::new();
    for (id, example) in examples {
        if let Some(trouble) = &example.trouble {
            return Err(format!("{id}: {trouble}"));
        }
        notes.extend(example.note.iter().map(|note| format!("{id}: {note}")));
    }
    let found = ground.each(&instance, |case| {
        let session = Arc::new(Session::new(&case.full));
        match instance.prepare(&session, &case.full) {
            Ok(prepared) => {
                instance.drop(prepared);
                Ok(())
            }
            Err(ended) => Err(ended.how()),
        }
    })?;
    match notes.first() {
        Some(note) => Ok(Verdict::Warning(note.clone())),
        None => Ok(found),
    }
}

fn unknown_operation(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let known = instance.manifest.operations.first();
    let mut names = vec!["nothing.of.the.kind/1".to_owned(), String::new()];
    if let Some(operation) = known {
        names.push(format!("{}0", operation.id));
        names.push(operation.stem().to_owned());
    }
    for name in names {
        ground.doing(&format!("preparing the unknown operation {name:?}"));
        let setting = Setting::new(&name, Map::new());
        match planned(&instance, &setting, request(&setting).as_bytes()) {
            None => return Err(format!("it plans the unknown operation {name:?}")),
            Some(ended) => ended.decent()?,
        }
    }
    Ok(Verdict::Passed)
}

fn panic_contained(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    ground.doing("being asked to panic");
    let setting = Setting::new("puncta.self-test.panic/1", Map::new());
    let Some(ended) = planned(&instance, &setting, request(&setting).as_bytes()) else {
        return Err("it plans an operation that it does not have".into());
    };
    match (ended.status, instance.manifest.sdk.is_some()) {
        (abi::STATUS_PANICKED, _) => Ok(Verdict::Passed),
        (_, false) => Ok(Verdict::Skipped(
            "it was not built with the SDK, and cannot be asked to panic",
        )),
        (_, true) => Ok(Verdict::Warning(
            "its SDK is older and cannot be asked to panic".into(),
        )),
    }
}

/// A repeatable source of numbers.
struct Random(u64);

impl Random {
    fn next(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_add(1);
        (crate::material::noise(self.0) * below as f64) as usize
    }
}

fn bad_requests(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let good = request(&case.small());
    let mut random = Random(7 * good.len() as u64);
    let fixed: [&[u8]; 8] = [
        b"",
        b"{}",
        b"[]",
        b"null",
        b"\xff\xfe\x00",
        b"{\"format\": \"puncta.request/1\"}",
        b"{\"format\": \"puncta.request/1\", \"operation\": 7}",
        b"{\"format\": \"puncta.request/2\", \"operation\": \"x\"}",
    ];
    for (at, text) in fixed.iter().enumerate() {
        ground.doing(&format!("{}: bad request {at}", case.operation.id));
        if let Some(ended) = planned(instance, &case.full, text) {
            ended
                .decent()
                .or_else(|why| known_misuse(&ended, why))
                .map_err(|why| format!("bad request {at}: {why}"))?;
        } else {
            return Err(format!(
                "it plans the request {}",
                String::from_utf8_lossy(text)
            ));
        }
    }
    for at in 0..DAMAGED {
        let text = damage(&good, &mut random);
        ground.doing(&format!("{}: damaged request {at}", case.operation.id));
        if let Some(ended) = planned(instance, &case.full, &text) {
            ended
                .decent()
                .or_else(|why| known_misuse(&ended, why))
                .map_err(|why| format!("damaged request {at}: {why}"))?;
        }
    }
    Ok(())
}

/// That a request cannot be read is the host's fault, so that the reason is a defect.
fn known_misuse(ended: &Ended, why: String) -> Result<(), String> {
    let code = ended.failure.as_ref().map(|failure| failure.code);
    let allowed = code == Some(documents::FailureCode::Internal)
        && ended.status <= abi::STATUS_NO_MEMORY
        && ended.status != abi::STATUS_PANICKED;
    if allowed { Ok(()) } else { Err(why) }
}

/// A request cut short, with a byte changed, or with a value of another type.
fn damage(good: &str, random: &mut Random) -> Vec<u8> {
    let mut bytes = good.as_bytes().to_vec();
    match random.next(3) {
        0 => bytes.truncate(random.next(good.len())),
        1 => {
            let at = random.next(bytes.len());
            bytes[at] = b"0\"{}[],:x\xff"[random.next(10)];
        }
        _ => {
            let mut value: Value = serde_json::from_str(good).unwrap_or_default();
            if let Some(place) = pick(&mut value, random, 0) {
                *place = [
                    json!(null),
                    json!(-1),
                    json!(1e308),
                    json!("text"),
                    json!([]),
                    json!({}),
                    json!(true),
                ][random.next(7)]
                .clone();
            }
            // Header and operation stay what they are, or every plugin would refuse at once.
            value["format"] = REQUEST.into();
            bytes = value.to_string().into_bytes();
        }
    }
    bytes
}

/// Some value within a value.
fn pick<'a>(value: &'a mut Value, random: &mut Random, depth: usize) -> Option<&'a mut Value> {
    let stop = depth > 0 && random.next(4) == 0;
    let leaf = !value.is_object() && !value.is_array();
    if stop || leaf {
        return Some(value);
    }
    let count = value.as_object().map_or_else(
        || value.as_array().map_or(0, Vec::len),
        serde_json::Map::len,
    );
    if count == 0 {
        return Some(value);
    }
    let at = random.next(count);
    let inner = match value {
        Value::Object(map) => map.values_mut().nth(at),
        Value::Array(list) => list.get_mut(at),
        _ => None,
    };
    pick(inner?, random, depth + 1)
}

fn future_request(_: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let mut value: Value =
        serde_json::from_str(&request(&case.full)).map_err(|error| error.to_string())?;
    value["later"] = json!({"a": [1, {"b": null}]});
    for input in value["inputs"].as_array_mut().into_iter().flatten() {
        input["later"] = json!("x");
        input["header"]["later"] = json!([1.5]);
        for part in input["header"]["parts"]
            .as_array_mut()
            .into_iter()
            .flatten()
        {
            for column in part["columns"].as_array_mut().into_iter().flatten() {
                column["later"] = json!(true);
            }
        }
    }
    let session = Arc::new(Session::new(&case.full));
    match instance.prepare_text(&session, value.to_string().as_bytes()) {
        Ok(prepared) => {
            let ended = instance.run(&session, &prepared);
            instance.drop(prepared);
            ended
                .good()
                .map(|_| ())
                .map_err(|why| format!("with members of a later version, {why}"))
        }
        Err(ended) => Err(format!("with members of a later version, {}", ended.how())),
    }
}

fn with(setting: &Setting, name: &str, value: Value) -> Setting {
    let mut setting = setting.clone();
    setting.parameters.insert(name.into(), value);
    setting
}

/// Values at the limits that a schema states.
fn extremes(parameter: &Parameter) -> Vec<Value> {
    let limits = [parameter.min, parameter.max].into_iter().flatten();
    let mut values: Vec<Value> = match parameter.kind {
        ParameterKind::Integer | ParameterKind::Number => limits.map(number::to_value).collect(),
        ParameterKind::Bool => vec![true.into(), false.into()],
        ParameterKind::Choice => {
            let choices = parameter.choices.iter();
            choices.map(|one| one.value.clone().into()).collect()
        }
        ParameterKind::Seed => vec!["0".into(), u64::MAX.to_string().into()],
        ParameterKind::Text => vec!["".into(), "\u{1f52c} \"quoted\"\n".into()],
        _ => Vec::new(),
    };
    if parameter.optional {
        values.push(Value::Null);
    }
    let canonical = values.iter().map(|value| parameter.canonical(value));
    canonical.filter_map(Result::ok).collect()
}

fn at_limits(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let small = case.small();
    let cut = small.with_tables(|item: &Item| crate::odd::first(item, 50));
    let base = cut.unwrap_or(small);
    for parameter in &case.operation.parameters {
        for value in extremes(parameter) {
            let what = format!("with {} = {value}", parameter.name);
            ground.doing(&format!("{}: {what}", case.operation.id));
            timely(instance, &with(&base, &parameter.name, value), &what)?;
        }
    }
    Ok(())
}

/// As `survives`, but a call that takes its time is stopped.
fn timely(instance: &Instance, setting: &Setting, what: &str) -> Result<Ended, String> {
    let mut setting = setting.clone();
    let flag = Arc::new(std::sync::atomic::AtomicBool::new(false));
    setting.stop = crate::setting::Stop::Flag(Arc::clone(&flag));
    let (done, wait) = std::sync::mpsc::channel::<()>();
    let watch = std::thread::spawn(move || {
        if wait.recv_timeout(Duration::from_millis(300)).is_err() {
            flag.store(true, std::sync::atomic::Ordering::Relaxed);
        }
    });
    let ended = survives(instance, &setting, what);
    let _ = done.send(());
    let _ = watch.join();
    ended
}

fn beyond_limits(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let base = case.small();
    for parameter in &case.operation.parameters {
        let mut values = vec![
            Value::Null,
            json!("text"),
            json!(["text"]),
            json!({"x": 1}),
            json!(true),
            json!(-1),
            json!(1e300),
            json!("inf"),
            json!("nan"),
        ];
        values.extend(parameter.min.map(|min| json!(min - 1.0)));
        values.extend(parameter.max.map(|max| json!(max + 1.0)));
        for value in values {
            let what = format!("with {} = {value}", parameter.name);
            ground.doing(&format!("{}: {what}", case.operation.id));
            let setting = with(&base, &parameter.name, value);
            check_plan(instance, &setting, &what)?;
        }
        let mut setting = base.clone();
        setting.parameters.remove(&parameter.name);
        check_plan(instance, &setting, &format!("without {}", parameter.name))?;
    }
    Ok(())
}

fn check_plan(instance: &Instance, setting: &Setting, what: &str) -> Result<(), String> {
    match planned(instance, setting, request(setting).as_bytes()) {
        // That a parameter is of another type than the schema says is the host's fault.
        Some(ended) => ended
            .decent()
            .or_else(|why| known_misuse(&ended, why))
            .map_err(|why| format!("{what}: {why}")),
        None => Ok(()),
    }
}

fn prepare_quick(_: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let mut setting = case.full.clone();
    for (_, item) in &mut setting.inputs {
        let mut other = Item {
            header: item.header.clone(),
            parts: Vec::new(),
        };
        if other.header.kind == documents::Kind::Table {
            for part in &mut other.header.parts {
                part.rows = 1_000_000_000;
            }
        }
        *item = Arc::new(other);
    }
    let begin = Instant::now();
    if let Some(ended) = planned(instance, &setting, request(&setting).as_bytes()) {
        ended.decent()?;
    }
    let time = begin.elapsed();
    if time > SOON {
        return Err(format!(
            "the plan for a billion rows took {:.1} s",
            time.as_secs_f64()
        ));
    }
    Ok(())
}
