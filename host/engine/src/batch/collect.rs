//! One table of what a batch measured, with a column for the file.

use super::{Batch, BatchRecord, State};
use crate::engine::Engine;
use crate::files::check_below;
use crate::headless::{Saving, located};
use crate::job::Progress;
use crate::provenance::{InputRecord, Lineage};
use crate::store::{Object, row_of, stack};
use puncta_documents::findings::REPORT;
use puncta_documents::{Failure, Map, Report};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// What the provenance of a collected table calls it.
pub(crate) const COLLECTED: &str = "collected";
/// The column that names the file.
const FILE: &str = "file";

/// Writes the collected tables. Files whose outputs are not there are left out: their entries say
/// why.
pub(super) fn collect(
    batch: &Batch<'_>,
    record: &BatchRecord,
    engine: &Arc<Engine>,
    progress: &Arc<dyn Progress>,
) -> Result<Vec<String>, Failure> {
    let mut written = Vec::new();
    for (target, output) in &batch.collect {
        let (mut tables, mut records) = (Vec::new(), Vec::new());
        for entry in &record.files {
            let found = entry.outputs.iter().find(|one| one.name == *output);
            let Some(found) = found.filter(|_| entry.state != State::Running) else {
                continue;
            };
            let (table, record) = table(engine, &batch.out.join(&found.path), progress)?;
            tables.push((entry.label.clone(), table));
            records.extend(record);
        }
        let path = batch.out.join(crate::recipe::output_path(target, "")?);
        check_below(batch.out, &path)?;
        let all = stack(FILE, &tables).map_err(|failure| failure.context(target))?;
        let none = Map::new();
        let saving = Saving {
            path: &path,
            writer: None,
            options: &none,
            overwrite: batch.overwrite || batch.resume,
        };
        let made = Lineage {
            object: COLLECTED.into(),
            inputs: BTreeMap::from([(output.clone(), records)]),
            ..Lineage::default()
        };
        engine.save_with(saving, &all, made, progress)?;
        written.push(target.clone());
    }
    Ok(written)
}

/// The table of a file, as its reader gives it with the record of reading, or the values of a
/// report.
fn table(
    engine: &Engine,
    path: &Path,
    progress: &Arc<dyn Progress>,
) -> Result<(Object, Option<InputRecord>), Failure> {
    if path.extension().is_some_and(|suffix| suffix == "json") {
        let text =
            std::fs::read_to_string(path).map_err(|error| Failure::io("read", path, &error))?;
        let report: Report = puncta_documents::parse(&text, REPORT)
            .map_err(|why| Failure::bad_file(format!("{} is {why}", path.display())))?;
        return Ok((row_of(&report)?, None));
    }
    let read = engine.read(path, None, &Map::new(), progress);
    let read = read.map_err(|failure| located(failure, path))?;
    let name = read.objects.first().map(|(name, _)| name.as_str());
    let record = engine.input_record(path, &read, name.unwrap_or_default(), &**progress)?;
    Ok((read.object(None)?.clone(), Some(record)))
}
