//! A file into columns, on all threads, with a few pieces of the file in memory.
//!
//! Threads claim pieces of the file in order. Each reads its piece, counts the rows in it, waits
//! until the earlier pieces are counted, splits its part off the columns and fills it. So rows
//! keep their order, no value is copied twice, and the result does not depend on the threads.

use crate::columns::{ColumnMut, TextMut, Words};
use crate::dialect::Dialect;
use crate::encoding::Source;
use crate::fault::{self, Verdict};
use crate::piece::{Buffer, LONGEST, SIZE};
use crate::rows::{Fault, Layout, Piece, Problem};
use crate::schema::{Change, Kind, Plan};
use crate::sink::{Part, Sink};
use puncta_sdk::Failure;
use puncta_sdk::run::Run;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Why a read stopped.
#[derive(Debug, Clone, PartialEq)]
pub enum Stop {
    /// For good.
    Failed(Failure),
    /// The columns must be made anew after [`Plan::apply`], and the read starts again.
    Replan(Change),
}

impl From<Failure> for Stop {
    fn from(error: Failure) -> Stop {
        Stop::Failed(error)
    }
}

/// The file, where its data ends, and how it is written.
#[derive(Clone, Copy)]
pub struct Input<'a> {
    /// The bytes.
    pub source: &'a dyn Source,
    /// Where the table ends.
    pub end: u64,
    /// How it is written.
    pub dialect: &'a Dialect,
}

/// Called with the number of rows that are complete from the start; it may stop the read.
pub type Commit<'a> = &'a (dyn Fn(u64) -> Result<(), Failure> + Sync);

/// Reads all rows into `columns`: one for each column of the plan, in order, of the planned type,
/// with room for `plan.max_rows` rows. Returns the number of rows.
pub fn read(
    input: Input<'_>,
    plan: &Plan,
    columns: &mut [ColumnMut<'_>],
    run: &dyn Run,
    commit: Commit<'_>,
) -> Result<u64, Stop> {
    if plan.columns.len() != columns.len() {
        let (wanted, got) = (plan.columns.len(), columns.len());
        let message = format!("the plan has {wanted} columns but room for {got} was given");
        return Err(Failure::internal(message).into());
    }
    let pass = Pass::new(input, plan, columns, run, commit, false);
    let threads = run.threads().clamp(1, pass.pieces.max(1));
    run.parallel(threads, &|_| pass.work());
    match pass.result() {
        Err(End::OpenQuote) => {}
        Err(End::Stop(stop)) => return Err(stop),
        Ok(rows) => return Ok(rows),
    }
    // Values in quotes hold line ends: where a row starts is known only from the row before.
    let pass = Pass::new(input, plan, columns, run, commit, true);
    pass.work_in_order();
    pass.result().map_err(|end| match end {
        End::Stop(stop) => stop,
        End::OpenQuote => Failure::bad_file("a quote is never closed").into(),
    })
}

/// How a pass over the file ended, other than well.
#[derive(Debug)]
enum End {
    Stop(Stop),
    OpenQuote,
}

impl From<Failure> for End {
    fn from(error: Failure) -> End {
        End::Stop(Stop::Failed(error))
    }
}

/// What is left of the columns, and the place in the file, before the next piece.
struct Turn<'c> {
    piece: usize,
    line: u64,
    left: Vec<ColumnMut<'c>>,
    /// The first piece that failed, and why.
    end: Option<(usize, End)>,
}

/// What the finished pieces leave.
struct Finished<'c> {
    next: usize,
    rows: u64,
    waiting: BTreeMap<usize, (u64, Vec<(usize, Words)>)>,
    words: BTreeMap<usize, TextMut<'c>>,
}

/// One pass over the file.
struct Pass<'p, 'c> {
    input: Input<'p>,
    plan: &'p Plan,
    layout: Layout,
    run: &'p dyn Run,
    commit: Commit<'p>,
    pieces: usize,
    next: AtomicUsize,
    turn: Mutex<Turn<'c>>,
    turned: Condvar,
    finished: Mutex<Finished<'c>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Tells the other threads when this one panics.
struct Watch<'w, 'p, 'c>(&'w Pass<'p, 'c>, usize);

impl Drop for Watch<'_, '_, '_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop(
                self.1,
                Failure::internal("the reader of text tables failed inside").into(),
            );
        }
    }
}

impl<'p, 'c> Pass<'p, 'c> {
    fn new(
        input: Input<'p>,
        plan: &'p Plan,
        columns: &'c mut [ColumnMut<'_>],
        run: &'p dyn Run,
        commit: Commit<'p>,
        multiline: bool,
    ) -> Pass<'p, 'c> {
        let dialect = input.dialect;
        let words_first = plan
            .columns
            .iter()
            .any(|c| c.field == 0 && c.kind == Kind::Text);
        let layout = Layout {
            delimiter: dialect.delimiter,
            point: dialect.point,
            line_end: dialect.line_end,
            trailing: dialect.trailing,
            comments: !words_first,
            multiline,
        };
        let bytes = input.end.saturating_sub(dialect.data_start);
        let pieces = usize::try_from(bytes.div_ceil(SIZE as u64)).unwrap_or(usize::MAX);
        let mut words = BTreeMap::new();
        let mut left = Vec::with_capacity(columns.len());
        for (i, column) in columns.iter_mut().enumerate() {
            match column.reborrow() {
                ColumnMut::Text(text) => {
                    words.insert(i, text);
                    left.push(ColumnMut::F64(&mut []));
                }
                numbers => left.push(numbers),
            }
        }
        let turn = Turn {
            piece: 0,
            line: dialect.data_line,
            left,
            end: None,
        };
        let finished = Finished {
            next: 0,
            rows: 0,
            waiting: BTreeMap::new(),
            words,
        };
        Pass {
            input,
            plan,
            layout,
            run,
            commit,
            pieces,
            next: AtomicUsize::new(0),
            turn: Mutex::new(turn),
            turned: Condvar::new(),
            finished: Mutex::new(finished),
        }
    }

    fn result(self) -> Result<u64, End> {
        let turn = self
            .turn
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let finished = self
            .finished
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        match turn.end {
            Some((_, end)) => Err(end),
            None => Ok(finished.rows),
        }
    }

    /// Records that a piece failed; the earliest piece counts.
    fn stop(&self, piece: usize, end: End) {
        let mut turn = lock(&self.turn);
        if turn.end.as_ref().is_none_or(|(first, _)| piece < *first) {
            turn.end = Some((piece, end));
        }
        drop(turn);
        self.turned.notify_all();
    }

    /// One thread's work.
    fn work(&self) {
        let mut buffer = Buffer::default();
        loop {
            let piece = self.next.fetch_add(1, Ordering::Relaxed);
            if piece >= self.pieces || lock(&self.turn).end.is_some() {
                return;
            }
            let _watch = Watch(self, piece);
            if let Err(end) = self.piece(piece, &mut buffer) {
                self.stop(piece, end);
                return;
            }
        }
    }

    fn piece(&self, index: usize, buffer: &mut Buffer) -> Result<(), End> {
        if self.run.cancelled() {
            return Err(Failure::cancelled().into());
        }
        let (first, end) = (self.input.dialect.data_start, self.input.end);
        let from = first + (index as u64) * SIZE as u64;
        let to = (from + SIZE as u64).min(end);
        let line_end = self.layout.line_end;
        let start = buffer.load(self.input.source, (first, end), (from, to), line_end)?;
        let piece = Piece {
            bytes: buffer.bytes(),
            end: buffer.end(),
            layout: self.layout,
        };
        let (rows, lines) = piece.count(start);
        let Some((parts, line)) = self.claim(index, rows, lines)? else {
            return Ok(());
        };
        let words = self
            .fill(&piece, start, parts)
            .map_err(|f| self.end(&f, line))?;
        self.finish(index, rows as u64, words)
    }

    /// Waits for the turn of a piece and splits its rows off the columns. `None` when an earlier
    /// piece failed.
    #[allow(
        clippy::type_complexity,
        reason = "the parts of the columns and the first line"
    )]
    fn claim(
        &self,
        index: usize,
        rows: usize,
        lines: u64,
    ) -> Result<Option<(Vec<Part<'c>>, u64)>, End> {
        let mut turn = lock(&self.turn);
        while turn.piece != index {
            if turn.end.as_ref().is_some_and(|(first, _)| *first < index) {
                return Ok(None);
            }
            turn = self
                .turned
                .wait(turn)
                .unwrap_or_else(PoisonError::into_inner);
        }
        let mut parts = Vec::with_capacity(turn.left.len());
        for (left, column) in turn.left.iter_mut().zip(&self.plan.columns) {
            let part = if column.kind == Kind::Text {
                Some(Part::Text(Words::default()))
            } else {
                left.split(rows)
            };
            parts.push(part.ok_or_else(|| {
                Failure::internal("the file has more rows than were planned for")
            })?);
        }
        let line = turn.line;
        turn.line += lines;
        turn.piece += 1;
        drop(turn);
        self.turned.notify_all();
        Ok(Some((parts, line)))
    }

    /// Fills the parts of the columns from a piece; returns its words.
    fn fill(
        &self,
        piece: &Piece<'_>,
        start: usize,
        parts: Vec<Part<'c>>,
    ) -> Result<Vec<(usize, Words)>, Fault> {
        let mut sinks: Vec<Sink<'c>> = Vec::new();
        sinks.resize_with(self.plan.fields, Sink::skip);
        let mut copies = Vec::new();
        for (part, column) in parts.into_iter().zip(&self.plan.columns) {
            if column.copy_of.is_some() {
                copies.push((column.field, part));
            } else if let Some(sink) = sinks.get_mut(column.field) {
                *sink = Sink::new(part, column);
            }
        }
        piece.take(start, &mut sinks)?;
        for (field, copy) in &mut copies {
            if let Some(sink) = sinks.get(*field) {
                copy.copy_from(&sink.part);
            }
        }
        let mut words = Vec::new();
        for (index, column) in self.plan.columns.iter().enumerate() {
            let part = sinks
                .get_mut(column.field)
                .map(|s| std::mem::replace(&mut s.part, Part::Skip));
            if let Some(Part::Text(text)) = part {
                words.push((index, text));
            }
        }
        Ok(words)
    }

    fn end(&self, found: &Fault, line: u64) -> End {
        if found.problem == Problem::OpenQuote && !self.layout.multiline {
            return End::OpenQuote;
        }
        match fault::verdict(found, line, self.plan, self.input.dialect) {
            Verdict::Change(change) => End::Stop(Stop::Replan(change)),
            Verdict::Failure(failure) => End::Stop(Stop::Failed(failure)),
        }
    }

    /// Takes a finished piece; commits the rows that are complete from the start.
    fn finish(&self, index: usize, rows: u64, words: Vec<(usize, Words)>) -> Result<(), End> {
        let mut finished = lock(&self.finished);
        finished.waiting.insert(index, (rows, words));
        let before = finished.next;
        loop {
            let next = finished.next;
            let Some((rows, words)) = finished.waiting.remove(&next) else {
                break;
            };
            for (column, words) in words {
                let room = finished.words.get_mut(&column);
                if !room.is_some_and(|room| room.append(&words)) {
                    return Err(Failure::internal("there is too little room for words").into());
                }
            }
            finished.rows += rows;
            finished.next += 1;
        }
        if finished.next > before {
            (self.commit)(finished.rows)?;
            let done = finished.next as f64 / self.pieces.max(1) as f64;
            drop(finished);
            self.run
                .progress(done.min(1.0), "Reading")
                .map_err(Failure::from)?;
        }
        Ok(())
    }

    /// The whole file on this thread, piece by piece.
    fn work_in_order(&self) {
        let mut index = 0;
        if let Err(end) = self.in_order(&mut index) {
            self.stop(index, end);
        }
    }

    fn in_order(&self, index: &mut usize) -> Result<(), End> {
        let mut buffer = Buffer::default();
        let mut at = self.input.dialect.data_start;
        let mut want = SIZE;
        loop {
            if self.run.cancelled() {
                return Err(Failure::cancelled().into());
            }
            let left = usize::try_from(self.input.end - at).unwrap_or(SIZE);
            let count = left.min(want.saturating_sub(buffer.end()));
            at += buffer.extend(self.input.source, at, count)? as u64;
            let last = at >= self.input.end;
            if last {
                buffer.close(self.layout.line_end);
            } else {
                buffer.pad();
            }
            if buffer.end() == 0 {
                return Ok(());
            }
            let whole = Piece {
                bytes: buffer.bytes(),
                end: buffer.end(),
                layout: self.layout,
            };
            let (rows, lines, end) = whole.count_quoted(0);
            if end == 0 || last && end < buffer.end() {
                let (.., line) = self.claim(*index, 0, 0)?.unwrap_or_default();
                if last || want >= LONGEST {
                    let file = &self.input.dialect.file;
                    return Err(fault::open_quote(file, line + lines).into());
                }
                want *= 2;
                *index += 1;
                self.finish(*index - 1, 0, Vec::new())?;
                continue;
            }
            want = SIZE;
            let piece = Piece { end, ..whole };
            let Some((parts, line)) = self.claim(*index, rows, lines)? else {
                return Ok(());
            };
            let words = self
                .fill(&piece, 0, parts)
                .map_err(|f| self.end(&f, line))?;
            self.finish(*index, rows as u64, words)?;
            buffer.forget(end);
            *index += 1;
        }
    }
}
