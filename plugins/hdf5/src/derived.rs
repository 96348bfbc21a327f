//! Columns that PYME computes when it opens fit results: from events, metadata and other columns.

use std::sync::Arc;

use puncta_sdk::Element;
use serde_json::Value;

use crate::column::PartRows;
use crate::columns::{self};
use crate::info::{ColumnInfo, TableInfo};
use crate::open::{self, Opened};
use crate::pyme::EVENTS;
use crate::raw;
use crate::record::{Leaf, LeafType};
use crate::split::{Block, fill_f64, text};

/// Events that are looked at.
const MOST_EVENTS: u64 = 4_000_000;
const UM: f64 = 1000.0;
/// Part of a frame behind which a step of its own frame lies.
const LATER: f64 = 0.01;

/// How a column is computed from a row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Compute {
    /// The value of the last step at or before the frame, plus a length.
    Steps {
        frame: Leaf,
        steps: Arc<[(f64, f64)]>,
        plus: Option<Leaf>,
    },
    /// 2 pi A (sigma / pixel)^2, in photons.
    Photons {
        amplitude: Leaf,
        sigma: Leaf,
        factor: f64,
    },
}

impl Compute {
    /// Fills rows of a column of f64.
    pub(crate) fn fill(&self, block: Block<'_>, rows: usize, out: PartRows<'_>) {
        let PartRows::F64(out) = out else { return };
        let values = |leaf: &Leaf| {
            let mut values = vec![0.0; rows];
            if let LeafType::Number { number, big_endian } = leaf.stored {
                fill_f64(block, leaf.offset, number, big_endian, 1.0, &mut values);
            }
            values
        };
        match self {
            Compute::Steps { frame, steps, plus } => {
                let plus = plus.as_ref().map(&values);
                for (row, (out, frame)) in out.iter_mut().zip(values(frame)).enumerate() {
                    let behind = steps.partition_point(|(at, _)| *at <= frame);
                    let step = behind.checked_sub(1).and_then(|k| steps.get(k));
                    let more = plus
                        .as_ref()
                        .and_then(|p| p.get(row))
                        .copied()
                        .unwrap_or(0.0);
                    *out = step.map_or(0.0, |(_, value)| *value) + more;
                }
            }
            Compute::Photons {
                amplitude,
                sigma,
                factor,
            } => {
                let pairs = values(amplitude).into_iter().zip(values(sigma));
                for (out, (amplitude, sigma)) in out.iter_mut().zip(pairs) {
                    *out = factor * amplitude * sigma * sigma;
                }
            }
        }
    }
}

/// One event: when, what, and its values.
struct Event {
    time: f64,
    name: String,
    values: String,
}

impl Event {
    /// Number `at` of the values.
    fn value(&self, at: usize) -> Option<f64> {
        self.values.split(',').nth(at)?.trim().parse().ok()
    }
}

/// Adds the columns whose sources are there.
pub(crate) fn add(
    opened: &Opened,
    table: &mut TableInfo,
    tree: &Value,
    has_events: bool,
    notes: &mut Vec<String>,
) {
    let mut added: Vec<ColumnInfo> = photons(table, tree).into_iter().collect();
    let events = match has_events {
        true => events(opened).unwrap_or_default(),
        false => Vec::new(),
    };
    match (leaf(table, "tIndex"), Clock::new(tree, &events)) {
        (Some(frame), Some(clock)) => {
            let z0 = leaf(table, "fitResults_z0");
            added.extend(stepped(&frame, z0, &clock, &events));
        }
        (_, None) if !events.is_empty() => {
            let what = "Without StartTime and Camera.CycleTime, no columns come from events.";
            notes.push(what.to_owned());
        }
        _ => {}
    }
    added.retain(|one| table.columns.iter().all(|column| column.name != one.name));
    for one in &mut added {
        one.role = puncta_shared_import::names::role(&one.name);
    }
    table.columns.extend(added);
}

fn leaf(table: &TableInfo, name: &str) -> Option<Leaf> {
    let found = table.columns.iter().find(|column| column.source == name);
    found.map(|column| column.leaf.clone())
}

/// The photons of a fit in one channel.
fn photons(table: &TableInfo, tree: &Value) -> Option<ColumnInfo> {
    let number = |path: &str| tree.pointer(path).and_then(Value::as_f64);
    let pixel = number("/voxelsize/x").map(|size| size * UM);
    let pixel = pixel.filter(|size| *size > 0.0)?;
    let gain = number("/Camera/TrueEMGain").filter(|gain| *gain > 0.0)?;
    let electrons = number("/Camera/ElectronsPerCount")?;
    if leaf(table, "fitResults_Ag").is_some() {
        return None;
    }
    let compute = Compute::Photons {
        amplitude: leaf(table, "fitResults_A")?,
        sigma: leaf(table, "fitResults_sigma")?,
        factor: std::f64::consts::TAU * electrons / (gain * pixel * pixel),
    };
    let what = "2 pi A (sig / pixel)^2 x electrons per count / gain";
    Some(column("nPhotons", "photon", what, compute))
}

/// What events say of each frame.
fn stepped(frame: &Leaf, z0: Option<Leaf>, clock: &Clock, events: &[Event]) -> Vec<ColumnInfo> {
    let mut added = Vec::new();
    let mut add = |name: &str, unit: &str, what: &str, steps: Arc<[(f64, f64)]>, plus| {
        let frame = frame.clone();
        let compute = Compute::Steps { frame, steps, plus };
        added.push(column(name, unit, what, compute));
    };
    let focus = clock.steps(events, "ProtocolFocus", 1, UM);
    if !focus.is_empty() || z0.is_some() {
        add("z", "nm", "fitted z plus focus", Arc::clone(&focus), z0);
    }
    if !focus.is_empty() {
        add("focus", "nm", "position of the focus", focus, None);
    }
    // A frame has the position and the shift that were known before it began.
    let before = |name: &str, value: usize, scale: f64| -> Arc<[(f64, f64)]> {
        let steps = clock.steps(events, name, value, scale);
        steps.iter().map(|(frame, v)| (frame + LATER, *v)).collect()
    };
    for (name, event) in [("scanx", "ScannerXPos"), ("scany", "ScannerYPos")] {
        let steps = before(event, 0, UM);
        if !steps.is_empty() {
            add(name, "nm", "position of the scanner", steps, None);
        }
    }
    for (value, name) in ["driftx", "drifty", "driftz"].into_iter().enumerate() {
        let steps = before("ShiftMeasure", value, 1.0);
        if !steps.is_empty() {
            let what = "measured shift, as the microscope gave it";
            add(name, "unknown", what, steps, None);
        }
    }
    added
}

fn column(name: &str, unit: &str, what: &str, compute: Compute) -> ColumnInfo {
    let leaf = match &compute {
        Compute::Steps { frame, .. } => frame.clone(),
        Compute::Photons { amplitude, .. } => amplitude.clone(),
    };
    ColumnInfo {
        name: name.to_owned(),
        element: Element::F64,
        unit: unit.to_owned(),
        remedy: None,
        role: None,
        source: String::new(),
        description: format!("computed: {what}"),
        leaf,
        factor: None,
        base: 0,
        place: None,
        compute: Some(compute),
    }
}

/// The events in order of time; nothing where they cannot be read.
fn events(opened: &Opened) -> Option<Vec<Event>> {
    let records = columns::records(opened, EVENTS).ok()?;
    let leaf = |name: &str| records.fields.leaves.iter().find(|leaf| leaf.name == name);
    let (time, name, values) = (leaf("Time")?, leaf("EventName")?, leaf("EventDescr")?);
    let LeafType::Number { number, big_endian } = time.stored else {
        return None;
    };
    let (LeafType::Text { size: name_size }, LeafType::Text { size: values_size }) =
        (name.stored, values.stored)
    else {
        return None;
    };
    if records.rows == 0 || records.rows > MOST_EVENTS {
        return None;
    }
    let rows = usize::try_from(records.rows).ok()?;
    let mut bytes = vec![0; rows.checked_mul(records.record)?];
    let dataset = open::dataset(opened, EVENTS).ok()?;
    raw::read_records(&dataset, 0, rows, &mut bytes).ok()?;
    let record = records.record;
    let mut times = vec![0.0; rows];
    let block = Block::Records {
        bytes: &bytes,
        record,
    };
    fill_f64(block, time.offset, number, big_endian, 1.0, &mut times);
    let words = |row: &[u8], at: usize, size: usize| {
        let bytes = row.get(at..at + size).unwrap_or_default();
        text(bytes.split(|b| *b == 0).next().unwrap_or_default())
    };
    let rows = bytes.chunks_exact(record.max(1)).zip(times);
    let mut events: Vec<Event> = rows
        .map(|(row, time)| Event {
            time,
            name: words(row, name.offset, name_size),
            values: words(row, values.offset, values_size),
        })
        .collect();
    events.sort_by(|a, b| a.time.total_cmp(&b.time));
    Some(events)
}

/// Frames from times: the camera's starts, and its cycle.
struct Clock {
    starts: Vec<(f64, f64)>,
    cycle: f64,
}

impl Clock {
    fn new(tree: &Value, events: &[Event]) -> Option<Clock> {
        let start = tree.pointer("/StartTime")?.as_f64()?;
        let cycle = tree.pointer("/Camera/CycleTime")?.as_f64()?;
        if !(cycle > 0.0 && start.is_finite()) {
            return None;
        }
        let mut starts = vec![(start, 0.0)];
        let begins = events.iter().filter(|event| event.name == "StartAq");
        starts.extend(begins.filter_map(|event| Some((event.time, event.value(0)?))));
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        Some(Clock { starts, cycle })
    }

    /// The frame at a time: counted from the last start, never beyond the next one.
    fn frame(&self, time: f64) -> f64 {
        let behind = self.starts.partition_point(|(start, _)| *start <= time);
        let at = behind.saturating_sub(1);
        let (start, first) = self.starts.get(at).copied().unwrap_or_default();
        let frame = first + ((time - start) / self.cycle).floor().max(0.0);
        match self.starts.get(at + 1) {
            Some((_, next)) => frame.min(*next),
            None => frame,
        }
    }

    /// The steps of a value that events of this name carry.
    fn steps(&self, events: &[Event], name: &str, value: usize, scale: f64) -> Arc<[(f64, f64)]> {
        let own = events.iter().filter(|event| event.name == name);
        let mut steps: Vec<(f64, f64)> = own
            .filter_map(|event| Some((self.frame(event.time), event.value(value)? * scale)))
            .collect();
        steps.sort_by(|a, b| a.0.total_cmp(&b.0));
        steps.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn event(time: f64, name: &str, values: &str) -> Event {
        Event {
            time,
            name: name.into(),
            values: values.into(),
        }
    }

    #[test]
    fn events_become_steps_over_frames() {
        let events = [
            event(100.0, "StartAq", "0"),
            event(101.0, "ProtocolFocus", "10, 2.5"),
            event(102.0, "StartAq", "15"),
            event(101.9, "ProtocolFocus", "19, 3.5"),
            event(102.5, "ProtocolFocus", "broken"),
            event(103.0, "ProtocolFocus", "25, -1"),
        ];
        let clock = Clock::new(
            &json!({"StartTime": 99.0, "Camera": {"CycleTime": 0.1}}),
            &events,
        );
        let clock = clock.unwrap();
        // 1.9 s behind frame 0 would be frame 19, but the camera began again at frame 15.
        let steps = clock.steps(&events, "ProtocolFocus", 1, UM);
        assert_eq!(&*steps, &[(10.0, 2500.0), (15.0, 3500.0), (25.0, -1000.0)]);
        assert!(Clock::new(&json!({"StartTime": 99.0}), &events).is_none());
    }
}
