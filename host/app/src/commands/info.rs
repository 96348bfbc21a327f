//! `puncta info FILE`.

use crate::cli::Info;
use crate::context::Context;
use crate::exit::Ended;
use crate::objects::Described;
use crate::output::plain;
use puncta_engine::documents::{Failure, Map};
use serde_json::json;

pub fn run(context: &Context, info: &Info, options: &Map) -> Result<Ended, Failure> {
    let read = context.read(&info.file, info.reader.as_deref(), options)?;
    let pool = context.engine.pool();
    let describe = |(name, object): &(String, _)| Described::of(name, object);
    let all: Result<Vec<Described>, Failure> =
        pool.install(|| read.objects.iter().map(describe).collect());
    let all = all?;
    if context.json {
        context.output.json(&json!({
            "objects": all.iter().map(Described::json).collect::<Vec<_>>(),
            "reader": read.reader,
            "options": read.options,
            "format": read.format,
            "notes": read.notes,
        }))?;
        return Ok(Ended::Done);
    }
    let format = if read.format.is_empty() {
        "a file"
    } else {
        &read.format
    };
    let file = info.file.display().to_string();
    let mut text = format!(
        "{}: {}, read by {}\n",
        plain(&file),
        plain(format),
        read.reader
    );
    for one in &all {
        text.push('\n');
        text.push_str(&one.text());
    }
    context.output.text(&text)?;
    read.notes.iter().for_each(|note| context.watch.note(note));
    Ok(Ended::Done)
}
