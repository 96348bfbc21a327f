//! `puncta readers list | set | clear`.

use crate::cli::Readers;
use crate::context::Context;
use crate::exit::Ended;
use crate::output::{plain, table};
use puncta_engine::documents::Failure;
use serde_json::json;

pub fn run(context: &Context, readers: &Readers) -> Result<Ended, Failure> {
    let (format, reader) = match readers {
        Readers::List => return list(context),
        Readers::Set { format, reader } => (format, Some(reader)),
        Readers::Clear { format } => (format, None),
    };
    let engine = &context.engine;
    engine.prefer_reader(format, reader.map(String::as_str))?;
    if context.json {
        let choice = json!({ "format": format, "reader": reader });
        context.output.json(&json!({ "choice": choice }))?;
    } else {
        let shown = reader.map_or_else(|| "no choice".to_owned(), |id| plain(id));
        context
            .output
            .text(&format!("{}: {shown}\n", plain(format)))?;
    }
    Ok(Ended::Done)
}

fn list(context: &Context) -> Result<Ended, Failure> {
    let readers = &context.engine.settings().readers;
    if context.json {
        context.output.json(&json!({ "readers": readers }))?;
        return Ok(Ended::Done);
    }
    let rows: Vec<Vec<String>> = readers
        .iter()
        .map(|(format, id)| vec![plain(format), plain(id)])
        .collect();
    context.output.text(&table(&rows, &[], 0))?;
    Ok(Ended::Done)
}
