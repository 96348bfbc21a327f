//! Checks of how calls end and what they give.

use crate::check::Check;
use crate::child::{Case, Found, Ground, survives};
use crate::host::{Finished, Session};
use crate::item::Item;
use crate::odd;
use crate::plugin::{Ended, Instance};
use crate::setting::{Setting, Stop};
use puncta_abi as abi;
use puncta_engine::documents::{
    Failure, Figure, Kind, Operation, OutputForm, Report, Unit, findings, parse,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Until a cancelled call must be back: four times what the host allows.
const BACK: Duration = Duration::from_millis(1000);
/// What a large table is to take at least.
const LONG: Duration = Duration::from_millis(500);
/// A call on a growing table is stopped after this.
const TOO_LONG: Duration = Duration::from_secs(5);
/// Bytes of a large table.
const LARGE: usize = 400 << 20;

pub fn find(check: Check, ground: &Ground) -> Option<Found> {
    let one: fn(&Ground, &Instance, &Case<'_>) -> Result<(), String> = match check {
        Check::ExampleRuns => |_, instance, case| {
            let ended = instance.call(&case.full).good()?;
            // A writer's output is its file.
            let gives = !case.operation.outputs.is_empty();
            match ended.finished.is_empty() && gives {
                true => Err("its example gives nothing".into()),
                false => Ok(()),
            }
        },
        Check::OutputsDeclared => |_, instance, case| declared(instance, case),
        Check::OutputsValid => |_, instance, case| valid(instance, case),
        Check::ProgressRange => |_, instance, case| progress(instance, case),
        Check::PlanAgain => |_, instance, case| plan_again(instance, case),
        Check::AnyThread => |_, instance, case| any_thread(instance, case),
        Check::OptionalInputs => optional_inputs,
        Check::Reasons => reasons,
        Check::NoMemory => no_memory,
        Check::CancelSaid => cancel_said,
        Check::CancelSoon => cancel_soon,
        Check::LargeTable => {
            |ground, instance, case| large(ground, instance, case, LONG).map(|_| ())
        }
        _ => return None,
    };
    let found = ground
        .instance()
        .and_then(|instance| ground.each(&instance, |case| one(ground, &instance, case)));
    Some(found)
}

fn declared(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let operation = case.operation;
    let ended = instance.call(&case.full).good()?;
    for one in &ended.finished {
        let port = operation
            .outputs
            .iter()
            .find(|port| port.name == one.output);
        let port = port.ok_or_else(|| format!("it gives {:?}, which is no output", one.output))?;
        if port.kind != one.item.header.kind {
            let kind = one.item.header.kind;
            return Err(format!(
                "{} is declared as {}, and is {kind}",
                port.name, port.kind
            ));
        }
        if port.form != one.form {
            return Err(format!("{} has another form than declared", port.name));
        }
        if one.form != OutputForm::Object && bound(operation, case, one) != port.of.as_deref() {
            return Err(format!(
                "{} belongs to another input than declared",
                port.name
            ));
        }
    }
    for port in &operation.outputs {
        let count = ended
            .finished
            .iter()
            .filter(|one| one.output == port.name)
            .count();
        if count == 0 && !port.optional {
            return Err(format!("it does not give {}", port.name));
        }
        if count > 1 && !port.many {
            return Err(format!("it gives {count} times {}", port.name));
        }
    }
    Ok(())
}

fn bound<'a>(_: &Operation, case: &'a Case<'_>, one: &Finished) -> Option<&'a str> {
    let input = case.full.inputs.get(one.of?)?;
    Some(&input.0)
}

fn valid(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let ended = instance.call(&case.full).good()?;
    if let Some(wrong) = ended.wrong.iter().find(|one| !one.starts_with("writes ")) {
        return Err(format!("it {wrong}"));
    }
    for one in &ended.finished {
        let header = &one.item.header;
        let name = &one.output;
        header.check().map_err(|why| format!("{name}: {why}"))?;
        let columns = header.parts.iter().flat_map(|part| &part.columns);
        let unknown = |unit: &str| unit != "unknown" && Unit::parse(unit).is_none();
        if let Some(column) = columns.into_iter().find(|column| unknown(&column.unit)) {
            return Err(format!(
                "column {} of {name} has the unit {:?}, which the host does not know",
                column.name, column.unit
            ));
        }
        let text = header.document.as_ref().map(ToString::to_string);
        let text = text.unwrap_or_default();
        let read = match header.kind {
            Kind::Figure => parse::<Figure>(&text, findings::FIGURE).map(|_| ()),
            Kind::Report => parse::<Report>(&text, findings::REPORT).map(|_| ()),
            _ => Ok(()),
        };
        read.map_err(|why| format!("{name} is {why}"))?;
        if let Some(image) = &header.image
            && image.voxels() != Some(header.rows())
        {
            return Err(format!("{name} has not as many values as its size says"));
        }
    }
    Ok(())
}

fn progress(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let ended = instance.call(&case.full).good()?;
    match ended.progress {
        Some(fraction) => Err(format!("it reports the progress {fraction}")),
        None => Ok(()),
    }
}

fn plan_again(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let setting = case.good(instance);
    let session = || Arc::new(Session::new(&setting));
    let prepared = instance
        .prepare(&session(), &setting)
        .map_err(|ended| ended.how())?;
    for time in ["first", "second"] {
        let ended = instance.run(&session(), &prepared);
        ended
            .good()
            .map_err(|why| format!("the {time} run of a plan: {why}"))?;
    }
    instance.drop(prepared);
    let unused = instance
        .prepare(&session(), &setting)
        .map_err(|ended| ended.how())?;
    instance.drop(unused);
    Ok(())
}

fn any_thread(instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let setting = case.good(instance);
    let session = Arc::new(Session::new(&setting));
    let prepared = elsewhere(|| instance.prepare(&session, &setting))?;
    let prepared = prepared.map_err(|ended| ended.how())?;
    let ended = elsewhere(|| instance.run(&session, &prepared))?;
    elsewhere(|| instance.drop(prepared))?;
    ended
        .good()
        .map(|_| ())
        .map_err(|why| format!("prepared on one thread and run on another, {why}"))
}

/// Does work on a thread of its own.
fn elsewhere<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T, String> {
    std::thread::scope(|scope| scope.spawn(work).join())
        .map_err(|_| "a thread of the validator ended".to_owned())
}

fn optional_inputs(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let base = case.small();
    for port in case.operation.inputs.iter().filter(|port| port.optional) {
        let mut setting = base.clone();
        setting.inputs.retain(|(name, _)| name != &port.name);
        let what = format!("without {}", port.name);
        ground.doing(&format!("{}: {what}", case.operation.id));
        survives(instance, &setting, &what)?;
    }
    Ok(())
}

/// Whether a reason is a sentence for a person.
fn sentence(ended: &Ended, what: &str) -> Result<(), String> {
    if ended.status != abi::STATUS_FAILED {
        return Ok(());
    }
    let Some(Failure { message, .. }) = &ended.failure else {
        return Err(format!("{what}, it fails without a reason"));
    };
    let wrong = match message.trim() {
        "" => "is empty",
        text if text.contains('\n') => "has several lines",
        text if text.ends_with('.') => "ends with a full stop",
        text if text.len() > 600 => "is longer than 600 bytes",
        _ => return Ok(()),
    };
    Err(format!("{what}, its reason {wrong}: {message:?}"))
}

fn reasons(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let base = case.small();
    let mut tried: Vec<(String, Setting)> = Vec::new();
    if let Some(setting) = base.with_tables(|item| Some(odd::empty(item))) {
        tried.push(("with an empty table".into(), setting));
    }
    for parameter in &case.operation.parameters {
        let name = &parameter.name;
        let beyond = parameter.min.map(|min| min - 1.0);
        let values = [serde_json::json!("nonsense"), serde_json::json!(beyond)];
        for value in values {
            let mut setting = base.clone();
            let what = format!("with {name} = {value}");
            setting.parameters.insert(name.clone(), value);
            tried.push((what, setting));
        }
    }
    for (_, item) in &base.inputs {
        for name in item.header.parts.iter().flat_map(|part| &part.columns) {
            let cut = base.with_tables(|item| odd::without(item, &name.name));
            if let Some(setting) = cut {
                tried.push((format!("without column {}", name.name), setting));
            }
        }
    }
    for (what, setting) in tried {
        ground.doing(&format!("{}: {what}", case.operation.id));
        let session = Arc::new(Session::new(&setting));
        match instance.prepare(&session, &setting) {
            Ok(prepared) => instance.drop(prepared),
            Err(ended) => sentence(&ended, &what)?,
        }
    }
    Ok(())
}

fn no_memory(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let base = case.good(instance);
    for place in 1..=6 {
        let mut setting = base.clone();
        setting.refuse_from = Some(place);
        let what = format!("without memory from request {place} on");
        ground.doing(&format!("{}: {what}", case.operation.id));
        let ended = survives(instance, &setting, &what)?;
        if !ended.refused {
            break;
        }
        if ended.ok() {
            return Err(format!("{what}, it goes on as if it had got it"));
        }
    }
    Ok(())
}

fn cancel_said(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let base = case.good(instance);
    for poll in [1, 2, 3, 5, 9, 20] {
        let mut setting = base.clone();
        setting.stop = Stop::AtPoll(poll);
        let what = format!("cancelled at its poll {poll}");
        ground.doing(&format!("{}: {what}", case.operation.id));
        let ended = survives(instance, &setting, &what)?;
        match ended.status {
            abi::STATUS_CANCELLED => {}
            abi::STATUS_OK if ended.stopping.is_none() => break,
            // It may have been at its end already.
            abi::STATUS_OK => {}
            _ => return Err(format!("{what}, {}", ended.how())),
        }
    }
    Ok(())
}

/// Runs a call that is stopped after a time. How it ended, and how long it took from then on.
fn stopped_after(
    instance: &Instance,
    setting: &Setting,
    time: Duration,
) -> (Ended, Option<Duration>) {
    let flag = Arc::new(AtomicBool::new(false));
    let mut setting = setting.clone();
    setting.stop = Stop::Flag(Arc::clone(&flag));
    let (done, wait) = mpsc::channel::<()>();
    let watch = std::thread::spawn(move || {
        wait.recv_timeout(time).is_err().then(|| {
            flag.store(true, Ordering::Relaxed);
            Instant::now()
        })
    });
    let ended = instance.call(&setting);
    let back = Instant::now();
    let _ = done.send(());
    let told = watch.join().ok().flatten();
    (ended, told.map(|told| back.saturating_duration_since(told)))
}

/// The columns of a table that a plan reads.
fn lean(instance: &Instance, setting: &Setting) -> Setting {
    let session = Arc::new(Session::new(setting));
    let Ok(prepared) = instance.prepare(&session, setting) else {
        return setting.clone();
    };
    let mut lean = setting.clone();
    for (place, (_, item)) in lean.inputs.iter_mut().enumerate() {
        let reads = prepared.plan.read.iter().filter(|read| read.input == place);
        let names: Vec<&String> = reads.flat_map(|read| &read.columns).collect();
        if item.header.kind != Kind::Table || names.is_empty() {
            continue;
        }
        let mut cut = Item::clone(item);
        let group = std::mem::take(&mut cut.header.parts[0].columns);
        let cells = std::mem::take(&mut cut.parts[0]);
        let kept = group.into_iter().zip(cells);
        let kept = kept.filter(|(info, _)| names.contains(&&info.name));
        (cut.header.parts[0].columns, cut.parts[0]) = kept.unzip();
        *item = Arc::new(cut);
    }
    instance.drop(prepared);
    if instance.call(&lean).ok() {
        lean
    } else {
        setting.clone()
    }
}

/// The example on tables that grow until a call takes so long; with the time of the last.
fn large(
    ground: &Ground,
    instance: &Instance,
    case: &Case<'_>,
    long: Duration,
) -> Result<(Setting, Duration), String> {
    let most: u64 = if ground.orders.strictness >= 9 {
        10_000_000
    } else {
        1_000_000
    };
    let base = lean(instance, &case.good(instance));
    let mut best = (base.clone(), instance.call(&base).time);
    if !case.has_table() {
        return Ok((case.full.clone(), instance.call(&case.full).time));
    }
    let rows = base
        .headers()
        .map(|header| header.rows())
        .max()
        .unwrap_or(0);
    let bytes: usize = base
        .inputs
        .iter()
        .flat_map(|(_, item)| item.parts.iter().flatten())
        .map(|cells| cells.data.len())
        .sum();
    let mut count = 1;
    while best.1 < long {
        let step = if best.1 < long / 20 { 10 } else { 4 };
        count = (count * step).min(most / rows.max(1));
        let Some(setting) = base.with_tables(|item| odd::times(item, count)) else {
            break;
        };
        ground.doing(&format!("{} with {} rows", case.operation.id, rows * count));
        let (ended, stopped) = stopped_after(instance, &setting, TOO_LONG);
        if stopped.is_some() {
            break;
        }
        ended
            .decent()
            .map_err(|why| format!("with {} rows, {why}", rows * count))?;
        if !ended.ok() {
            break;
        }
        best = (setting, ended.time);
        if count >= most / rows.max(1) || bytes.saturating_mul(count as usize) > LARGE / 4 {
            break;
        }
    }
    Ok(best)
}

fn cancel_soon(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let session = Arc::new(Session::new(&case.full));
    let prepared = instance.prepare(&session, &case.full);
    let prepared = prepared.map_err(|ended| ended.how())?;
    let interruptible = prepared.plan.interruptible;
    instance.drop(prepared);
    if !interruptible {
        return Ok(());
    }
    let (setting, time) = large(ground, instance, case, 3 * LONG)?;
    if time < Duration::from_millis(20) {
        return Ok(());
    }
    ground.doing(&format!("{} when cancelled", case.operation.id));
    let (ended, back) = stopped_after(instance, &setting, (time / 8).min(LONG / 4));
    ended.decent()?;
    match back {
        Some(back) if back > BACK => Err(format!(
            "it came back {:.2} s after it was cancelled, in a call of {:.1} s",
            back.as_secs_f64(),
            time.as_secs_f64()
        )),
        _ => Ok(()),
    }
}
