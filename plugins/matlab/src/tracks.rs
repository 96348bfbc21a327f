//! Tracks: Spot-On's `trackedPar` and u-track's `tracksFinal`.

use crate::find::{Column, Table, Values};
use crate::matrix::{Array, Value};
use puncta_sdk::Element;
use puncta_shared_records::names::Raw;

fn column(name: &str, unit: &str, source: &str, values: Values) -> Column {
    let element = match values {
        Values::Whole(_) => Element::I64,
        _ => Element::F64,
    };
    let raw = Raw::new(source, name, unit, element);
    Column { raw, values }
}

fn frames(source: &str, values: Vec<i64>) -> Column {
    let mut frames = column("t", "frame", source, Values::Whole(values));
    frames.raw = frames.raw.from_one();
    frames
}

fn track(values: Vec<i64>) -> Column {
    let mut track = column("track", "1", "track", Values::Whole(values));
    track.raw = track.raw.described("Track, from 0");
    track
}

/// Structures of an array, each with the values of the named fields.
fn each<'v, const N: usize>(
    value: &'v Value,
    fields: [&str; N],
) -> Option<impl Iterator<Item = [&'v Array; N]>> {
    let Value::Struct { names, values } = value else {
        return None;
    };
    let mut places = [0; N];
    for (place, field) in places.iter_mut().zip(fields) {
        *place = names.iter().position(|name| name == field)?;
    }
    let elements = values.chunks_exact(names.len().max(1));
    Some(elements.filter_map(move |element| {
        let arrays: Vec<&Array> = places
            .iter()
            .filter_map(|place| element.get(*place)?.array())
            .collect();
        <[&Array; N]>::try_from(arrays).ok()
    }))
}

/// `trackedPar`: positions in um, frames from 1, times in s.
pub fn spot_on(value: &Value) -> Option<Table> {
    let (mut x, mut y, mut t, mut time) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut number = Vec::new();
    let mut skipped = 0;
    for (track, [xy, frame]) in each(value, ["xy", "Frame"])?.enumerate() {
        let (Some(places), Some(frames)) = (xy.values(), frame.values()) else {
            skipped += 1;
            continue;
        };
        let rows = frames.len();
        if places.len() < 2 * rows {
            skipped += 1;
            continue;
        }
        x.extend_from_slice(&places[..rows]);
        y.extend_from_slice(&places[rows..2 * rows]);
        #[allow(clippy::cast_possible_truncation)]
        t.extend(frames.iter().map(|frame| *frame as i64));
        number.extend(std::iter::repeat_n(track as i64, rows));
    }
    if let Some(times) = each(value, ["TimeStamp"]) {
        time.extend(times.filter_map(|[time]| time.values()).flatten());
    }
    let rows = t.len();
    let mut columns = vec![
        column("x", "um", "xy(:,1)", Values::Gathered(x)),
        column("y", "um", "xy(:,2)", Values::Gathered(y)),
        frames("Frame", t),
        track(number),
    ];
    if time.len() == rows {
        columns.push(column("time", "s", "TimeStamp", Values::Gathered(time)));
    }
    Some(table("Spot-On mat", rows, columns, skipped))
}

/// `tracksFinal`: eight numbers a frame (x y z A and their errors) for each segment, NaN in gaps;
/// the first column of `seqOfEvents` has the frames, from 1.
pub fn u_track(value: &Value) -> Option<Table> {
    const NAMES: [&str; 8] = [
        "x", "y", "z", "A", "error_x", "error_y", "error_z", "error_A",
    ];
    let mut values: [Vec<f64>; 8] = Default::default();
    let (mut t, mut number, mut track_number) = (Vec::new(), Vec::new(), 0);
    let mut skipped = 0;
    for [coordinates, events] in each(value, ["tracksCoordAmpCG", "seqOfEvents"])? {
        let (Some(numbers), Some(events)) = (coordinates.values(), events.values()) else {
            skipped += 1;
            continue;
        };
        let segments = coordinates.sizes.first().copied().unwrap_or(0);
        let count = coordinates.sizes.get(1).copied().unwrap_or(0) / 8;
        let starts = events.iter().take(events.len() / 4).copied();
        let first = starts.fold(f64::INFINITY, f64::min);
        if !first.is_finite() || numbers.len() != segments * count * 8 {
            skipped += 1;
            continue;
        }
        for segment in 0..segments {
            for frame in 0..count {
                let at = |part: usize| numbers[(frame * 8 + part) * segments + segment];
                if at(0).is_nan() {
                    continue;
                }
                for (part, column) in values.iter_mut().enumerate() {
                    column.push(at(part));
                }
                #[allow(clippy::cast_possible_truncation)]
                t.push(first as i64 + frame as i64);
                number.push(track_number);
            }
            track_number += 1;
        }
    }
    let rows = t.len();
    let one = |(name, values): (&str, Vec<f64>)| {
        let unit = if name.ends_with('A') { "" } else { "px" };
        let source = format!("tracksCoordAmpCG({name})");
        column(name, unit, &source, Values::Gathered(values))
    };
    let mut columns: Vec<Column> = NAMES.into_iter().zip(values).map(one).collect();
    columns.push(frames("seqOfEvents", t));
    columns.push(track(number));
    Some(table("u-track mat", rows, columns, skipped))
}

fn table(format: &'static str, rows: usize, columns: Vec<Column>, skipped: usize) -> Table {
    let mut table = Table {
        format,
        confidence: 1.0,
        rows,
        columns,
        tracks: true,
        ..Table::default()
    };
    if skipped > 0 {
        let sentence = format!("{skipped} tracks do not have the numbers that they announce.");
        table.notes.push(sentence);
    }
    table
}
