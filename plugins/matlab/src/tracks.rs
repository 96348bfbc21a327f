//! Tracks: Spot-On's `trackedPar` and u-track's `tracksFinal`.

use crate::find::{Column, Table};
use crate::matrix::{Array, Value};
use puncta_sdk::{ColumnInfo, Element};

fn place(name: &str, unit: &str, source: &str) -> ColumnInfo {
    ColumnInfo::new(name, Element::F64, unit)
        .role("position")
        .source(source)
}

fn track() -> ColumnInfo {
    ColumnInfo::new("track", Element::I64, "1")
        .role("group")
        .description("Track, from 0")
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
        x.extend(places[..rows].iter().map(|x| x * 1e3));
        y.extend(places[rows..2 * rows].iter().map(|y| y * 1e3));
        #[allow(clippy::cast_possible_truncation)]
        t.extend(frames.iter().map(|frame| *frame as i64 - 1));
        number.extend(std::iter::repeat_n(track as i64, rows));
    }
    if let Some(times) = each(value, ["TimeStamp"]) {
        time.extend(times.filter_map(|[time]| time.values()).flatten());
    }
    let frame = ColumnInfo::new("t", Element::I64, "frame")
        .role("time")
        .source("Frame");
    let mut columns = vec![
        Column::Gathered(place("x", "nm", "xy(:,1)"), x),
        Column::Gathered(place("y", "nm", "xy(:,2)"), y),
    ];
    let rows = t.len();
    columns.push(Column::Whole(frame, t));
    columns.push(Column::Whole(track(), number));
    if time.len() == rows {
        let info = ColumnInfo::new("time", Element::F64, "s").source("TimeStamp");
        columns.push(Column::Gathered(info, time));
    }
    Some(table("Spot-On mat", rows, columns, skipped))
}

/// `tracksFinal`: eight numbers a frame (x y z A and their errors) for each segment, NaN in gaps;
/// the first column of `seqOfEvents` has the frames, from 1.
pub fn u_track(value: &Value, pixel_size: Option<f64>) -> Option<Table> {
    const NAMES: [&str; 8] = [
        "x", "y", "z", "A", "error_x", "error_y", "error_z", "error_A",
    ];
    let factor = pixel_size.unwrap_or(1.0);
    let mut values: [Vec<f64>; 8] = Default::default();
    let (mut t, mut number, mut track_number) = (Vec::new(), Vec::new(), 0);
    let mut skipped = 0;
    for [coordinates, events] in each(value, ["tracksCoordAmpCG", "seqOfEvents"])? {
        let (Some(numbers), Some(events)) = (coordinates.values(), events.values()) else {
            skipped += 1;
            continue;
        };
        let segments = coordinates.sizes.first().copied().unwrap_or(0);
        let frames = coordinates.sizes.get(1).copied().unwrap_or(0) / 8;
        let first = events
            .iter()
            .take(events.len() / 4)
            .copied()
            .fold(f64::INFINITY, f64::min);
        if !first.is_finite() || numbers.len() != segments * frames * 8 {
            skipped += 1;
            continue;
        }
        for segment in 0..segments {
            for frame in 0..frames {
                let at = |part: usize| numbers[(frame * 8 + part) * segments + segment];
                if at(0).is_nan() {
                    continue;
                }
                for (part, column) in values.iter_mut().enumerate() {
                    column.push(if part % 4 == 3 {
                        at(part)
                    } else {
                        at(part) * factor
                    });
                }
                #[allow(clippy::cast_possible_truncation)]
                t.push(first as i64 - 1 + frame as i64);
                number.push(track_number);
            }
            track_number += 1;
        }
    }
    let rows = t.len();
    let unit = if pixel_size.is_some() {
        "nm"
    } else {
        "unknown"
    };
    let column = |(name, values): (&str, Vec<f64>)| {
        let mut info = place(name, unit, "tracksCoordAmpCG");
        if name.ends_with('A') {
            (info.unit, info.role) = ("unknown".into(), None);
        } else if name.starts_with("error") {
            info.role = Some("error".into());
        }
        if pixel_size.is_none() && !name.ends_with('A') {
            info = info.description("In camera pixels");
        }
        Column::Gathered(info, values)
    };
    let mut columns: Vec<Column> = NAMES.into_iter().zip(values).map(column).collect();
    let frame = ColumnInfo::new("t", Element::I64, "frame")
        .role("time")
        .source("seqOfEvents");
    columns.push(Column::Whole(frame, t));
    columns.push(Column::Whole(track(), number));
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
