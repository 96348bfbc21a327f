//! `puncta convert IN OUT`.

use crate::cli::Convert;
use crate::context::Context;
use crate::exit::Ended;
use crate::flags::fits;
use crate::saved;
use puncta_engine::Engine;
use puncta_engine::documents::{Failure, Map, Operation, OperationKind};
use puncta_engine::files::check_target;
use puncta_engine::headless::Saving;
use puncta_engine::provenance::Lineage;
use serde_json::json;
use std::collections::BTreeMap;

/// Options that were given.
pub struct Given {
    /// For the reader or the writer, whichever has them.
    pub either: Map,
    /// For the reader.
    pub reader: Map,
    /// For the writer.
    pub writer: Map,
}

pub fn run(context: &Context, convert: &Convert, given: Given) -> Result<Ended, Failure> {
    let (from, to) = (&convert.input, &convert.output);
    check_target(to, convert.overwrite)?;
    let (reader, writer) = deal(&context.engine, convert, given)?;
    let read = context.read(from, convert.reader.as_deref(), &reader)?;
    read.notes.iter().for_each(|note| context.watch.note(note));
    let object = read.object(convert.object.as_deref())?;
    let name = read
        .objects
        .iter()
        .find(|(_, one)| std::ptr::eq(one, object));
    let name = name.map(|(name, _)| name.clone()).unwrap_or_default();
    let progress = context.progress();
    let input = context
        .engine
        .input_record(from, &read, &name, &*progress)?;
    let made = Lineage {
        object: "input".into(),
        inputs: BTreeMap::from([("input".to_owned(), vec![input])]),
        ..Lineage::default()
    };
    let saving = Saving {
        path: to,
        writer: convert.writer.as_deref(),
        options: &writer,
        overwrite: convert.overwrite,
    };
    let saved = context.save(saving, object, made)?;
    if context.json {
        context.output.json(&json!({
            "object": name,
            "reader": read.reader,
            "format": read.format,
            "notes": read.notes,
            "written": [saved::json(&saved)],
        }))?;
    } else {
        context.output.text(&saved::text(&saved))?;
    }
    Ok(Ended::Done)
}

/// Gives each option to the reader or the writer.
fn deal(engine: &Engine, convert: &Convert, given: Given) -> Result<(Map, Map), Failure> {
    let candidates = |kind: OperationKind, id: Option<&str>, path: &std::path::Path| {
        let all = || {
            let all = engine
                .catalogue()
                .operations()
                .map(|(_, operation)| operation);
            all.filter(move |operation| operation.kind == kind)
        };
        if let Some(id) = id {
            return engine.operation(id).map(|(_, operation)| vec![operation]);
        }
        let generic = |one: &Operation| one.file.as_ref().is_some_and(|rule| rule.generic);
        let fitting: Vec<&Operation> = all()
            .filter(|one| fits(one, path) || generic(one))
            .collect();
        Ok(if fitting.is_empty() {
            all().collect()
        } else {
            fitting
        })
    };
    let readers = candidates(
        OperationKind::Reader,
        convert.reader.as_deref(),
        &convert.input,
    )?;
    let writers = candidates(
        OperationKind::Writer,
        convert.writer.as_deref(),
        &convert.output,
    )?;
    let (mut reader, mut writer) = (given.reader, given.writer);
    for (name, value) in given.either {
        let has = |all: &[&Operation]| {
            all.iter()
                .any(|one| one.parameters.iter().any(|known| known.name == name))
        };
        match (has(&readers), has(&writers)) {
            (true, true) => {
                let message = format!("both the reader and the writer have an option {name}");
                return Err(Failure::bad_parameter(&name, message)
                    .remedy(format!("write --in-{name} or --out-{name}")));
            }
            (false, true) => writer.insert(name, value),
            // A reader without it says which options it has.
            (_, false) => reader.insert(name, value),
        };
    }
    Ok((reader, writer))
}
