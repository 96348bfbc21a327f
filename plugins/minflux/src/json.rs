//! MINFLUX localisations in JSON: a list of objects, one after the other, without a tree in memory.

use crate::reader::PORT;
use crate::walk::{Rows, Take};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Committer, Failure};
use puncta_shared_import::MappingParams;
use puncta_shared_records::names::{self, Placed};
use puncta_shared_records::{Opened, damaged, minflux, not_mine, open};
use serde::de::DeserializeSeed;
use std::cell::RefCell;
use std::io::{BufReader, Seek, SeekFrom};

const EXAMPLE: &str = concat!(
    "[{\"tim\":1.2,\"tid\":131,\"vld\":true,\"loc\":[3.5e-07,9e-08,1e-08],\"eco\":767,\"efo\":71e3},\n",
    "{\"tim\":1.3,\"tid\":131,\"vld\":true,\"loc\":[3.6e-07,9.1e-08,0],\"eco\":512,\"efo\":69e3}]\n",
);
/// Objects that tell which columns there are.
const LOOK: u64 = 100;
/// The shortest object, with its comma.
const SHORTEST: u64 = 12;
/// Rows between two looks at cancel.
const STEP: u64 = 8192;

/// Reads MINFLUX localisations from a JSON list.
#[derive(Debug, Params)]
pub struct ReadJson {
    /// Keep rows that are not valid final localisations.
    #[param(default = false)]
    all_rows: bool,
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

/// A key of the file: its name, and the number of values of a list.
#[derive(Clone, Debug, PartialEq)]
struct Key {
    name: String,
    values: usize,
    /// First of its columns.
    at: usize,
}

/// Whether a field is a truth value or a number of something.
fn whole(name: &str) -> bool {
    matches!(
        name,
        "tid"
            | "itr"
            | "sqi"
            | "gri"
            | "thi"
            | "sta"
            | "vld"
            | "fnl"
            | "bot"
            | "eot"
            | "act"
            | "dos"
            | "sky"
            | "tic"
    )
}

/// Finds the keys.
#[derive(Default)]
struct Look {
    keys: Vec<Key>,
    rows: u64,
}

impl Take for Look {
    fn value(&mut self, key: &str, axis: Option<usize>, _: f64) {
        let values = axis.map_or(1, |axis| axis + 1);
        let place = self.keys.iter().position(|known| known.name == key);
        match place {
            Some(place) => self.keys[place].values = self.keys[place].values.max(values),
            None if self.keys.len() < 256 => self.keys.push(Key {
                name: key.to_owned(),
                values,
                at: 0,
            }),
            None => {}
        }
    }

    fn end(&mut self) -> Result<(), String> {
        self.rows += 1;
        if self.rows < LOOK {
            Ok(())
        } else {
            Err("enough".into())
        }
    }
}

/// Columns that are being filled.
struct Filling<'a, 'j> {
    keys: &'a [Key],
    columns: Vec<ColumnMut<'a>>,
    placed: &'a [Placed],
    flags: Vec<usize>,
    current: Vec<f64>,
    rows: u64,
    kept: u64,
    room: u64,
    committed: u64,
    committer: Committer<'j>,
    failure: Option<Failure>,
    job: &'j Job,
}

impl Take for Filling<'_, '_> {
    fn value(&mut self, key: &str, axis: Option<usize>, value: f64) {
        let known = self.keys.iter().find(|known| known.name == key);
        let place = axis.unwrap_or(0);
        let known = known.filter(|known| place < known.values);
        if let Some(slot) = known.and_then(|known| self.current.get_mut(known.at + place)) {
            *slot = value;
        }
    }

    fn end(&mut self) -> Result<(), String> {
        let stop = |failure: Failure, to: &mut Option<Failure>| {
            *to = Some(failure);
            Err("stopped".to_owned())
        };
        self.rows += 1;
        if self.rows.is_multiple_of(STEP) && self.job.cancelled() {
            return stop(Failure::cancelled(), &mut self.failure);
        }
        let valid = self
            .flags
            .iter()
            .all(|flag| self.current.get(*flag).is_some_and(|v| *v == 1.0));
        if valid {
            if self.kept == self.committed {
                let step = (1 << 16).min(self.room - self.committed);
                if step == 0 {
                    let failure = damaged("there are more rows than fit the file");
                    return stop(failure, &mut self.failure);
                }
                if let Err(failure) = self.committer.commit(0, step) {
                    return stop(failure, &mut self.failure);
                }
                self.committed += step;
            }
            let row = usize::try_from(self.kept).unwrap_or(usize::MAX);
            for (column, placed) in self.columns.iter_mut().zip(self.placed) {
                let value = self.current.get(placed.place).copied().unwrap_or(f64::NAN);
                match column {
                    ColumnMut::F64(to) => to[row] = value * placed.factor - placed.minus,
                    #[allow(clippy::cast_possible_truncation)]
                    ColumnMut::I64(to) => to[row] = (value - placed.minus) as i64,
                    _ => {}
                }
            }
            self.kept += 1;
        }
        self.current.fill(f64::NAN);
        Ok(())
    }
}

/// The keys of the first objects, with the places of their columns.
fn keys(opened: &mut Opened) -> Result<Vec<Key>, Failure> {
    let foreign = || not_mine(&opened.name, "list of MINFLUX localisations");
    let text = opened.head.trim_ascii_start();
    let inner = text.strip_prefix(b"[").map(<[u8]>::trim_ascii_start);
    if inner.is_none_or(|inner| !inner.is_empty() && !inner.starts_with(b"{")) {
        return Err(foreign());
    }
    opened
        .file
        .seek(SeekFrom::Start(0))
        .map_err(|_| foreign())?;
    let look = RefCell::new(Look::default());
    let read = BufReader::new(&opened.file);
    let mut text = puncta_sdk::serde_json::Deserializer::from_reader(read);
    let ended = Rows(&look).deserialize(&mut text);
    let look = look.into_inner();
    let mut keys = look.keys;
    let has = |name: &str, least: usize| {
        keys.iter()
            .any(|key| key.name == name && key.values >= least)
    };
    if !has("loc", 2) || !(has("tid", 1) || has("tim", 1)) {
        return Err(foreign());
    }
    if let Err(error) = ended
        && look.rows < LOOK
    {
        return Err(broken(&opened.name, &error));
    }
    keys.retain(|key| !(key.name == "itr" && key.values > 1));
    let mut at = 0;
    for key in &mut keys {
        key.at = at;
        at += key.values;
    }
    Ok(keys)
}

fn broken(name: &str, error: &puncta_sdk::serde_json::Error) -> Failure {
    let (line, column) = (error.line(), error.column());
    damaged(format!(
        "{name} is no valid JSON at line {line}, column {column}"
    ))
}

/// The header, what becomes of the values, their number, and notes.
type Headed = (Header, Vec<Placed>, usize, Vec<String>);

impl ReadJson {
    fn header(&self, opened: &Opened, keys: &[Key]) -> Result<Headed, Failure> {
        let mut raw = Vec::new();
        for key in keys {
            for axis in 0..key.values {
                let element = if whole(&key.name) {
                    Element::I64
                } else {
                    Element::F64
                };
                let axis = (key.values > 1).then_some(axis);
                raw.push(minflux::column(&key.name, axis, element));
            }
        }
        let (mut placed, notes) = names::place(&opened.name, &self.mapping.mapping()?, &raw)?;
        for one in &mut placed {
            if one.converts() {
                one.info.type_.element = Element::F64;
            }
        }
        let infos = placed.iter().map(|one| one.info.clone()).collect();
        let mut header = Header::table(PORT, opened.length / SHORTEST, infos);
        header
            .metadata
            .insert("format".into(), "MINFLUX json".into());
        Ok((header, placed, raw.len(), notes))
    }
}

impl Operation for ReadJson {
    const ID: &'static str = "puncta.minflux.json.read/1";

    fn info() -> Info {
        Info::reader("MINFLUX JSON", &[".json"])
            .description(
                "Reads MINFLUX localisations from a JSON list of objects, with or without nested \
                 iterations.\nLengths become nm. Of each localisation the last iteration is \
                 taken, and rows that are not valid are left out and counted.",
            )
            .formats(&[], &["MINFLUX json"])
            .output(Ports::table(PORT).description("One row a localisation."))
            .example(json!({}))
            .example_text("example.json", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut opened = open(request, 64)?;
        let keys = keys(&mut opened)?;
        let (header, _, _, notes) = self.header(&opened, &keys)?;
        let mut plan = Plan {
            interruptible: true,
            memory: 16 << 20,
            notes,
            ..Plan::default()
        };
        plan.outputs.push(Output {
            output: PORT.into(),
            form: OutputForm::Object,
            of: None,
            header,
        });
        plan.probe = Some(Probe {
            format: "MINFLUX json".into(),
            confidence: 1.0,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut opened = open(job.request(), 64)?;
        let keys = keys(&mut opened)?;
        let (header, placed, values, _) = self.header(&opened, &keys)?;
        let room = header.rows();
        let mut out = job.begin(PORT, header)?;
        let flags = keys
            .iter()
            .filter(|key| matches!(key.name.as_str(), "vld" | "fnl"));
        let flags = flags.filter(|_| !self.all_rows).map(|key| key.at);
        let filling = Filling {
            keys: &keys,
            placed: &placed,
            flags: flags.collect(),
            current: vec![f64::NAN; values],
            rows: 0,
            kept: 0,
            room,
            committed: 0,
            committer: out.committer(),
            columns: out.columns_mut(0)?,
            failure: None,
            job,
        };
        let filling = RefCell::new(filling);
        opened
            .file
            .seek(SeekFrom::Start(0))
            .map_err(|error| Failure::io("read", &opened.path, &error))?;
        let read = BufReader::with_capacity(1 << 20, &opened.file);
        let mut text = puncta_sdk::serde_json::Deserializer::from_reader(read);
        let ended = Rows(&filling)
            .deserialize(&mut text)
            .and_then(|()| text.end());
        let filling = filling.into_inner();
        let (rows, kept, failure) = (filling.rows, filling.kept, filling.failure);
        drop(filling.columns);
        if let Some(failure) = failure {
            return Err(failure);
        }
        ended.map_err(|error| broken(&opened.name, &error))?;
        if let Some(sentence) = minflux::dropped(kept, rows) {
            job.warn(&sentence);
        }
        out.finish_rows(&[kept])
    }
}
