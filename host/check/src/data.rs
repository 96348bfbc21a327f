//! Checks of what calls do with data: odd values, odd types, memory, and the same bits everywhere.

use crate::check::Check;
use crate::child::{Case, Found, Ground, Verdict, survives};
use crate::host::{Finished, Session};
use crate::item::Item;
use crate::material;
use crate::memory::Around;
use crate::odd;
use crate::plugin::Instance;
use crate::setting::Setting;
use puncta_engine::documents::{Map, OperationKind};
use puncta_engine::engine::Invocation;
use puncta_engine::{Engine, Isolation, Progress, Unwatched};
use std::sync::Arc;

pub fn find(check: Check, ground: &Ground) -> Option<Found> {
    let one: fn(&Ground, &Instance, &Case<'_>) -> Result<(), String> = match check {
        Check::EmptyTable => |ground, instance, case| {
            tables(ground, instance, case, "an empty table", |item| {
                Some(odd::empty(item))
            })
        },
        Check::OneRow => {
            |ground, instance, case| tables(ground, instance, case, "one row", odd::one)
        }
        Check::NotANumber => not_a_number,
        Check::Infinite => infinite,
        Check::MissingColumns => missing_columns,
        Check::WrongTypes => wrong_types,
        Check::ReadsWithin => reads_within,
        Check::InputsUnchanged => inputs_unchanged,
        Check::WritesWithin => writes_within,
        Check::SameAgain => same_again,
        Check::WritesAll => writes_all,
        Check::SameWithThreads => same_with_threads,
        Check::Reentrant => return Some(reentrant(ground)),
        Check::SameInWorker => return Some(same_in_worker(ground)),
        _ => return None,
    };
    let found = ground
        .instance()
        .and_then(|instance| ground.each(&instance, |case| one(ground, &instance, case)));
    Some(found)
}

fn tables(
    ground: &Ground,
    instance: &Instance,
    case: &Case<'_>,
    what: &str,
    change: impl Fn(&Item) -> Option<Item>,
) -> Result<(), String> {
    let Some(setting) = case.small().with_tables(change) else {
        return Ok(());
    };
    ground.doing(&format!("{} with {what}", case.operation.id));
    survives(instance, &setting, &format!("with {what}")).map(|_| ())
}

fn not_a_number(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    tables(ground, instance, case, "columns of NaN", |item| {
        odd::replaced(item, |_, _, _| f64::NAN)
    })?;
    tables(ground, instance, case, "some NaN", |item| {
        odd::replaced(item, |column, row, value| {
            if (row + column).is_multiple_of(7) {
                f64::NAN
            } else {
                value
            }
        })
    })
}

fn infinite(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    for odd_value in [f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 5e-324] {
        tables(
            ground,
            instance,
            case,
            &format!("some values {odd_value:e}"),
            |item| {
                odd::replaced(item, |column, row, value| {
                    if (row + column) % 11 == 3 {
                        odd_value
                    } else {
                        value
                    }
                })
            },
        )?;
    }
    Ok(())
}

/// Names of the columns of tables that a call reads.
fn read(instance: &Instance, setting: &Setting) -> Vec<String> {
    let session = Arc::new(Session::new(setting));
    let Ok(prepared) = instance.prepare(&session, setting) else {
        return Vec::new();
    };
    let reads = prepared.plan.read.iter();
    let mut names: Vec<String> = reads.flat_map(|read| read.columns.clone()).collect();
    names.sort();
    names.dedup();
    instance.drop(prepared);
    names
}

fn missing_columns(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    for name in read(instance, &case.small()) {
        let what = format!("a table without {name}");
        tables(ground, instance, case, &what, |item| {
            odd::without(item, &name)
        })?;
    }
    Ok(())
}

fn wrong_types(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let names = read(instance, &case.small());
    let guarded = |setting: Option<Setting>, what: &str| {
        let Some(mut setting) = setting else {
            return Ok(());
        };
        setting.inputs_around = Around::Guarded;
        ground.doing(&format!("{} with {what}", case.operation.id));
        survives(instance, &setting, &format!("with {what}")).map(|_| ())
    };
    for element in odd::TYPES {
        let other = case
            .small()
            .with_tables(|item| odd::retyped(item, &names, element));
        guarded(other, &format!("columns of {}", element.name()))?;
    }
    for name in &names {
        let other = case.small().with_tables(|item| odd::as_texts(item, name));
        guarded(other, &format!("texts in {name}"))?;
    }
    Ok(())
}

fn reads_within(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let mut setting = case.good(instance);
    setting.inputs_around = Around::Guarded;
    ground.doing(&format!("{} with guarded inputs", case.operation.id));
    instance.call(&setting).good().map(|_| ())
}

fn inputs_unchanged(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let mut setting = case.good(instance);
    let ended = instance.call(&setting);
    if let Some(wrong) = ended
        .wrong
        .iter()
        .find(|one| one.starts_with("writes into"))
    {
        return Err(format!("it {wrong}"));
    }
    setting.read_only = true;
    ground.doing(&format!("{} with read-only inputs", case.operation.id));
    instance.call(&setting).good().map(|_| ())
}

fn writes_within(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let mut setting = case.good(instance);
    setting.outputs_around = Around::Guarded;
    ground.doing(&format!("{} with guarded outputs", case.operation.id));
    let ended = instance.call(&setting).good()?;
    match ended
        .wrong
        .iter()
        .find(|one| one.starts_with("writes outside"))
    {
        Some(wrong) => Err(format!("it {wrong}")),
        None => Ok(()),
    }
}

/// The example as declared where much is asked, else on few rows.
fn fair(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Setting {
    if ground.orders.strictness >= 8 {
        case.full.clone()
    } else {
        case.good(instance)
    }
}

/// Fails when outputs differ; says where.
fn same(first: &[Finished], second: &[Finished], what: &str) -> Result<(), String> {
    if first.len() != second.len() {
        return Err(format!("{what} gives another number of outputs"));
    }
    for (a, b) in first.iter().zip(second) {
        if a == b {
            continue;
        }
        let name = &a.output;
        if a.item.header != b.item.header {
            return Err(format!("{what} gives another header of {name}"));
        }
        let groups = a.item.header.parts.iter();
        let columns = groups.flat_map(|part| &part.columns);
        let cells = a
            .item
            .parts
            .iter()
            .flatten()
            .zip(b.item.parts.iter().flatten());
        let differ = columns.zip(cells).find(|(_, (a, b))| a != b);
        let column = differ.map_or("", |(info, _)| info.name.as_str());
        return Err(format!(
            "{what} gives other bits in column {column} of {name}"
        ));
    }
    Ok(())
}

fn same_again(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let setting = fair(ground, instance, case);
    let first = instance.call(&setting).good()?;
    let second = instance.call(&setting).good()?;
    same(&first.finished, &second.finished, "a second run")
}

fn writes_all(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let mut setting = case.good(instance);
    ground.doing(&case.operation.id);
    setting.fill = 0x11;
    let first = instance.call(&setting).good()?;
    setting.fill = 0xEE;
    let second = instance.call(&setting).good()?;
    same(
        &first.finished,
        &second.finished,
        "memory that held something else",
    )
}

fn same_with_threads(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let mut setting = fair(ground, instance, case);
    setting.threads = 1;
    let first = instance.call(&setting).good()?;
    for threads in [2, 3] {
        setting.threads = threads;
        let other = instance.call(&setting).good()?;
        let what = format!("a run on {threads} threads");
        same(&first.finished, &other.finished, &what)?;
    }
    Ok(())
}

fn reentrant(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    if !instance.manifest.reentrant {
        return Ok(Verdict::Skipped("it does not say that it is reentrant"));
    }
    ground.each(&instance, |case| {
        if case.operation.kind == OperationKind::Writer {
            return Ok(());
        }
        let setting = case.good(&instance);
        let alone = instance.call(&setting).good()?;
        let ended = std::thread::scope(|scope| {
            let calls: Vec<_> = (0..3)
                .map(|_| scope.spawn(|| instance.call(&setting)))
                .collect();
            let joined = calls.into_iter().map(std::thread::ScopedJoinHandle::join);
            joined.collect::<Result<Vec<_>, _>>()
        });
        for one in ended.map_err(|_| "a thread of the validator ended")? {
            let one = one.good().map_err(|why| format!("three at once: {why}"))?;
            same(&alone.finished, &one.finished, "a call beside others")?;
        }
        Ok(())
    })
}

fn same_in_worker(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let orders = &ground.orders;
    let mut options = material::again(&orders.options, &orders.folder, &orders.library);
    let open = |options: &puncta_engine::Options| {
        Engine::open(options.clone()).map_err(|failure| failure.to_string())
    };
    let worker = open(&options)?;
    // A plugin that insists on a worker is compared with a second worker.
    options.isolation = Isolation::InProcess;
    let other = open(&options)?;
    ground.each(&instance, |case| {
        let setting = fair(ground, &instance, case);
        let first = called(&worker, &setting)?;
        let second = called(&other, &setting)?;
        if first != second {
            return Err("a worker process gives other bits".into());
        }
        Ok(())
    })
}

/// What the engine gets of a call: objects and the bytes of files.
type Got = (Vec<(String, Item)>, Vec<u8>);

fn called(engine: &Engine, setting: &Setting) -> Result<Got, String> {
    let mut inputs = Vec::new();
    for (port, item) in &setting.inputs {
        let object = item.object().map_err(|failure| failure.to_string())?;
        inputs.push((port.clone(), object));
    }
    let kind = engine
        .operation(&setting.operation)
        .map(|(_, operation)| operation.kind)
        .map_err(|failure| failure.to_string())?;
    let file = setting.file.as_ref();
    let writes = file.filter(|_| kind == OperationKind::Writer);
    if let Some(file) = writes {
        let _ = std::fs::remove_file(&file.path);
    }
    let parameters: Map = setting.parameters.clone();
    let invocation = Invocation {
        operation: setting.operation.clone(),
        parameters,
        inputs,
        file: setting.file.clone(),
    };
    let watch: Arc<dyn Progress> = Arc::new(Unwatched);
    let called = engine.call(&invocation, &watch);
    let called = called.map_err(|failure| failure.to_string())?;
    let mut outputs = Vec::new();
    for (port, object) in &called.outputs {
        let item = Item::of(object).map_err(|failure| failure.to_string())?;
        outputs.push((port.clone(), item));
    }
    let bytes = writes.map(|file| std::fs::read(&file.path).unwrap_or_default());
    Ok((outputs, bytes.unwrap_or_default()))
}
