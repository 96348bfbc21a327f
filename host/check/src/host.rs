//! The state of one call as the validator's host keeps it, and what it notes.

use crate::item::{Cells, Item, Live};
use crate::setting::{Setting, Stop};
use puncta_engine::documents::{
    Element, Failure, Header, Kind, Output, OutputForm, Plan, findings,
};
use serde_json::Value;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Number of the first output; smaller numbers are inputs.
pub const FIRST_OUTPUT: u64 = 1 << 32;

/// An output that its call finished.
#[derive(Clone, Debug, PartialEq)]
pub struct Finished {
    /// Port.
    pub output: String,
    /// Form.
    pub form: OutputForm,
    /// Input that it belongs to.
    pub of: Option<usize>,
    /// What it is.
    pub item: Item,
}

/// An output that is being written.
struct Open {
    output: Output,
    parts: Vec<Vec<Live>>,
}

/// An input of a call.
struct Input {
    item: Arc<Item>,
    /// Memory of the columns that were asked for.
    live: Vec<Vec<Option<Live>>>,
    /// Row numbers, for the virtual column.
    row: Option<Live>,
}

#[derive(Default)]
struct Inner {
    inputs: Vec<Input>,
    open: Vec<Option<Open>>,
    finished: Vec<Finished>,
    failure: Option<Failure>,
    /// What the plugin did that the ABI does not allow, within this call.
    wrong: Vec<String>,
    /// Whether the host refused something.
    refused: bool,
    asked: u64,
}

/// A call.
pub struct Session {
    setting: Setting,
    plan: Mutex<Arc<Plan>>,
    inner: Mutex<Inner>,
    polls: AtomicU64,
    told: AtomicBool,
    told_at: Mutex<Option<Instant>>,
    progress_wrong: Mutex<Option<f64>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a call left in its session.
pub struct Left {
    /// Outputs in the order in which they were finished.
    pub finished: Vec<Finished>,
    /// The plugin's reason.
    pub failure: Option<Failure>,
    /// What it did wrong.
    pub wrong: Vec<String>,
    /// Whether the host refused something.
    pub refused: bool,
    /// A progress that is no fraction.
    pub progress: Option<f64>,
    /// When it was told to stop.
    pub told_at: Option<Instant>,
}

impl Session {
    /// A call in these circumstances.
    pub fn new(setting: &Setting) -> Session {
        let inputs = setting.inputs.iter().map(|(_, item)| Input {
            item: Arc::clone(item),
            live: item
                .parts
                .iter()
                .map(|part| part.iter().map(|_| None).collect())
                .collect(),
            row: None,
        });
        Session {
            inner: Mutex::new(Inner {
                inputs: inputs.collect(),
                ..Inner::default()
            }),
            setting: setting.clone(),
            plan: Mutex::new(Arc::default()),
            polls: AtomicU64::new(0),
            told: AtomicBool::new(false),
            told_at: Mutex::new(None),
            progress_wrong: Mutex::new(None),
        }
    }

    /// Sets the plan whose columns may be read.
    pub fn set_plan(&self, plan: &Arc<Plan>) {
        *lock(&self.plan) = Arc::clone(plan);
    }

    /// Threads of `parallel_for`.
    pub fn threads(&self) -> usize {
        self.setting.threads
    }

    /// Notes something that the ABI does not allow.
    pub fn note(&self, what: String) {
        let mut inner = lock(&self.inner);
        if inner.wrong.len() < 10 {
            inner.wrong.push(what);
        }
    }

    /// Whether the call should stop; counts the question.
    pub fn stop(&self) -> bool {
        let polls = self.polls.fetch_add(1, Ordering::Relaxed) + 1;
        let stop = match &self.setting.stop {
            Stop::Never => false,
            Stop::AtPoll(limit) => polls >= *limit,
            Stop::Flag(flag) => flag.load(Ordering::Relaxed),
        };
        if stop && !self.told.swap(true, Ordering::Relaxed) {
            *lock(&self.told_at) = Some(Instant::now());
        }
        stop
    }

    /// Takes a report of progress.
    pub fn progress(&self, fraction: f64) {
        if !(-1e-9..=1.0 + 1e-9).contains(&fraction) {
            lock(&self.progress_wrong).get_or_insert(fraction);
        }
    }

    /// Remembers the plugin's reason.
    pub fn fail(&self, failure: Failure) {
        lock(&self.inner).failure = Some(failure);
    }

    /// Columns of an input or an open output.
    pub fn columns(&self, object: u64, part: usize) -> Result<Vec<puncta_abi::Column>, String> {
        if object < FIRST_OUTPUT {
            return self.input_columns(object as usize, part);
        }
        let mut inner = lock(&self.inner);
        let open = place(&mut inner.open, object)?;
        let (Some(group), Some(lives)) = (open.output.header.parts.get(part), open.parts.get(part))
        else {
            return Err(format!("asks for part {part} of an output without it"));
        };
        let columns = group.columns.iter().zip(lives);
        Ok(columns
            .map(|(info, live)| live.column(info, group.rows))
            .collect())
    }

    fn input_columns(&self, place: usize, part: usize) -> Result<Vec<puncta_abi::Column>, String> {
        let plan = Arc::clone(&lock(&self.plan));
        let mut inner = lock(&self.inner);
        let input = inner
            .inputs
            .get_mut(place)
            .ok_or_else(|| format!("asks for input {place}, which there is not"))?;
        let item = Arc::clone(&input.item);
        let read = plan
            .read
            .iter()
            .find(|read| read.input == place && read.part == part);
        let group = item.header.parts.get(part);
        let (Some(read), Some(group)) = (read, group) else {
            return Ok(Vec::new());
        };
        let around = self.setting.inputs_around;
        let mut out = Vec::new();
        for name in &read.columns {
            let Some(at) = group.columns.iter().position(|column| &column.name == name) else {
                if name == "row" {
                    out.push(row_numbers(&mut input.row, group.rows, around)?);
                    continue;
                }
                return Err(format!("reads column {name}, which the input has not"));
            };
            let slot = &mut input.live[part][at];
            if slot.is_none() {
                let live = Live::of(&item.parts[part][at], around).ok_or("no memory")?;
                if self.setting.read_only {
                    live.protect();
                }
                *slot = Some(live);
            }
            if let Some(live) = slot {
                out.push(live.column(&group.columns[at], group.rows));
            }
        }
        Ok(out)
    }

    /// Whether a request for memory is refused.
    fn refuse(&self, inner: &mut Inner) -> bool {
        inner.asked += 1;
        let refused = self
            .setting
            .refuse_from
            .is_some_and(|limit| inner.asked >= limit);
        inner.refused |= refused;
        refused
    }

    /// Begins an output; `None` for want of memory.
    pub fn begin(&self, output: Output) -> Result<Option<u64>, String> {
        output.header.check()?;
        let mut inner = lock(&self.inner);
        if self.refuse(&mut inner) {
            return Ok(None);
        }
        if output.form != OutputForm::Object {
            let rows = output.of.and_then(|of| inner.inputs.get(of));
            if rows.map(|input| input.item.rows()) != Some(output.header.rows()) {
                return Err(format!(
                    "begins {} with another number of rows than its input",
                    output.output
                ));
            }
        }
        let (fill, around) = (self.setting.fill, self.setting.outputs_around);
        let mut parts = Vec::new();
        for part in &output.header.parts {
            let lives: Option<Vec<Live>> = part
                .columns
                .iter()
                .map(|info| Live::room(info, part.rows, fill, around))
                .collect();
            match lives {
                Some(lives) => parts.push(lives),
                None => {
                    inner.refused = true;
                    return Ok(None);
                }
            }
        }
        inner.open.push(Some(Open { output, parts }));
        Ok(Some(FIRST_OUTPUT + inner.open.len() as u64 - 1))
    }

    /// Makes room for more rows; `false` for want of memory.
    pub fn grow(&self, object: u64, part: usize, rows: u64) -> Result<bool, String> {
        let mut inner = lock(&self.inner);
        if self.refuse(&mut inner) {
            return Ok(false);
        }
        let (fill, around) = (self.setting.fill, self.setting.outputs_around);
        let open = place(&mut inner.open, object)?;
        let group = open
            .output
            .header
            .parts
            .get_mut(part)
            .ok_or("grows a part that there is not")?;
        if rows <= group.rows {
            return Ok(true);
        }
        group.rows = rows;
        for (info, live) in group.columns.iter().zip(&mut open.parts[part]) {
            let Some(mut larger) = Live::room(info, rows, fill, around) else {
                return Ok(false);
            };
            larger.copy_from(live);
            *live = larger;
        }
        Ok(true)
    }

    /// Makes rows usable; `false` for want of memory.
    pub fn commit(&self, object: u64, part: usize) -> Result<bool, String> {
        let mut inner = lock(&self.inner);
        if self.refuse(&mut inner) {
            return Ok(false);
        }
        let open = place(&mut inner.open, object)?;
        match open.parts.get(part) {
            Some(_) => Ok(true),
            None => Err("commits rows of a part that there is not".into()),
        }
    }

    /// Ends an output.
    pub fn finish(&self, object: u64, rows: &[u64], header: Option<Header>) -> Result<(), String> {
        let mut inner = lock(&self.inner);
        let at = usize::try_from(object.wrapping_sub(FIRST_OUTPUT)).unwrap_or(usize::MAX);
        let open = inner.open.get_mut(at).and_then(Option::take);
        let Open { mut output, parts } =
            open.ok_or("finishes an output that is not open".to_owned())?;
        if let Some(header) = header {
            output.header = header;
        }
        let port = output.output.clone();
        if rows.len() != output.header.parts.len() || rows.len() != parts.len() {
            return Err(format!("finishes {port} with another number of parts"));
        }
        let mut item = Item {
            header: output.header,
            parts: Vec::new(),
        };
        for ((group, lives), rows) in item.header.parts.iter_mut().zip(&parts).zip(rows) {
            if *rows > group.rows {
                return Err(format!("finishes {port} with more rows than room"));
            }
            group.rows = *rows;
            if group.columns.len() != lives.len() {
                return Err(format!("finishes {port} with another number of columns"));
            }
            let mut columns: Vec<Cells> = Vec::new();
            for (info, live) in group.columns.iter_mut().zip(lives) {
                if !live.whole() {
                    inner.wrong.push(format!(
                        "writes outside column {} of its output {port}",
                        info.name
                    ));
                }
                columns.push(live.take(info, *rows, info.entries.unwrap_or(0))?);
                info.text_bytes = None;
            }
            item.parts.push(columns);
        }
        if output.form == OutputForm::Selection {
            ascending(&item).map_err(|why| format!("selects in {port} {why}"))?;
        }
        inner.finished.push(Finished {
            output: port,
            form: output.form,
            of: output.of,
            item,
        });
        Ok(())
    }

    /// Takes a figure or a report.
    pub fn emit(&self, document: Value) -> Result<(), String> {
        let text = |name: &str| document.get(name).and_then(Value::as_str);
        let kind = match text("format") {
            Some(findings::FIGURE) => Kind::Figure,
            Some(findings::REPORT) => Kind::Report,
            _ => return Err("gives a document that is neither figure nor report".into()),
        };
        let output = text("output").unwrap_or_default().to_owned();
        let mut header = Header::new(kind, &output);
        header.document = Some(document);
        lock(&self.inner).finished.push(Finished {
            output,
            form: OutputForm::Object,
            of: None,
            item: Item {
                header,
                parts: Vec::new(),
            },
        });
        Ok(())
    }

    /// Ends the session: what is left of the call.
    pub fn end(&self) -> Left {
        let mut inner = lock(&self.inner);
        for input in std::mem::take(&mut inner.inputs) {
            let pairs = input.live.iter().zip(&input.item.parts);
            let groups = input.item.header.parts.iter().zip(pairs);
            for (group, (lives, cells)) in groups {
                for ((info, live), cells) in group.columns.iter().zip(lives).zip(cells) {
                    if live.as_ref().is_some_and(|live| !live.is(cells)) {
                        let name = &input.item.header.name;
                        let column = &info.name;
                        inner
                            .wrong
                            .push(format!("writes into column {column} of its input {name}"));
                    }
                }
            }
        }
        inner.open.clear();
        Left {
            finished: std::mem::take(&mut inner.finished),
            failure: inner.failure.take(),
            wrong: std::mem::take(&mut inner.wrong),
            refused: inner.refused,
            progress: *lock(&self.progress_wrong),
            told_at: *lock(&self.told_at),
        }
    }

    /// Remembers that the host refused something.
    pub fn refused(&self) {
        lock(&self.inner).refused = true;
    }
}

fn place(open: &mut [Option<Open>], object: u64) -> Result<&mut Open, String> {
    let at = usize::try_from(object.wrapping_sub(FIRST_OUTPUT)).unwrap_or(usize::MAX);
    open.get_mut(at)
        .and_then(Option::as_mut)
        .ok_or_else(|| "uses an output that is not open".into())
}

fn row_numbers(
    slot: &mut Option<Live>,
    rows: u64,
    around: crate::memory::Around,
) -> Result<puncta_abi::Column, String> {
    let info = puncta_engine::documents::ColumnInfo::new("row", Element::U64, "1");
    if slot.is_none() {
        let cells = Cells {
            data: (0..rows).flat_map(u64::to_le_bytes).collect(),
            ..Cells::default()
        };
        *slot = Live::of(&cells, around);
    }
    let live = slot.as_ref().ok_or("no memory")?;
    Ok(live.column(&info, rows))
}

fn ascending(item: &Item) -> Result<(), String> {
    let part = item.header.parts.first().zip(item.parts.first());
    let column = part.and_then(|(group, cells)| group.columns.first().zip(cells.first()));
    let Some((info, cells)) = column.filter(|(info, _)| info.name == "row") else {
        return Err("rows without a column row".into());
    };
    let rows: Vec<u64> = match info.type_.element {
        Element::U32 => {
            let (chunks, _) = cells.data.as_chunks::<4>();
            chunks
                .iter()
                .map(|chunk| u32::from_le_bytes(*chunk).into())
                .collect()
        }
        Element::U64 => crate::item::numbers(&cells.data),
        _ => return Err("rows by numbers that are neither u32 nor u64".into()),
    };
    match rows.windows(2).all(|pair| pair[0] < pair[1]) {
        true => Ok(()),
        false => Err("rows that do not ascend".into()),
    }
}
