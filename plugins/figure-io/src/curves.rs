//! Curves as marks: gaps where there is nothing to draw, and no more points than can be seen.

use crate::axis::{Range, drawable};
use crate::colours::{INK, Look};
use crate::data::{Curve, Style};
use crate::layout::{Plot, Ranges};
use crate::scene::{Anchor, Label, Mark, Scene};
use puncta_sdk::{Cancelled, Run};
use std::collections::HashSet;

/// Points between two looks at cancel.
const BATCH: usize = 1 << 16;
/// Width of the columns in which a line keeps its first, lowest, highest and last point.
const COLUMN: f64 = 0.5;
/// Gap between bars that are wide enough for one.
const BAR_GAP: f64 = 0.6;

/// Ranges of the curves, and the number of values that a logarithmic axis cannot show.
///
/// # Errors
/// When the call is cancelled.
pub fn ranges(
    curves: &[Curve<'_>],
    log: [bool; 2],
    run: &dyn Run,
) -> Result<(Ranges, u64), Cancelled> {
    let (mut xy, mut hidden) = ([Range::EMPTY; 2], 0);
    for curve in curves {
        let uppers = curve.upper.as_deref().unwrap_or(&curve.y);
        for (i, ((x, y), upper)) in curve.x.iter().zip(&*curve.y).zip(uppers).enumerate() {
            if i % BATCH == 0 && run.cancelled() {
                return Err(Cancelled);
            }
            let known = x.is_finite() && y.is_finite() && upper.is_finite();
            let seen = drawable(*x, log[0]) && drawable(*y, log[1]) && drawable(*upper, log[1]);
            hidden += u64::from(known && !seen);
            if seen {
                xy[0].add(*x, log[0]);
                xy[1].add(*y, log[1]);
                xy[1].add(*upper, log[1]);
            }
        }
        if curve.style == Style::Bars {
            for bar in bars(curve, log) {
                xy[0].add(bar.0, log[0]);
                xy[0].add(bar.1, log[0]);
                xy[1].add(0.0, log[1]);
            }
        }
    }
    Ok((Ranges { xy, log }, hidden))
}

/// Draws the curves into the plot: areas first, points last.
///
/// # Errors
/// When the call is cancelled.
pub fn draw(
    scene: &mut Scene,
    plot: &Plot,
    curves: &[Curve<'_>],
    looks: &[Look],
    run: &dyn Run,
) -> Result<(), Cancelled> {
    let before = scene.marks.len();
    for style in [Style::Band, Style::Bars, Style::Line, Style::Points] {
        let these = curves
            .iter()
            .zip(looks)
            .filter(|(curve, _)| curve.style == style);
        for (curve, look) in these {
            match style {
                Style::Band => band(scene, plot, curve, look, run)?,
                Style::Bars => bar_marks(scene, plot, curve, look),
                Style::Line => line(scene, plot, curve, look, run)?,
                Style::Points => points(scene, plot, curve, look, run)?,
            }
        }
    }
    if scene.marks.len() == before {
        let [left, top, right, bottom] = plot.rect;
        scene.marks.push(Mark::Label(Label {
            text: "no data".into(),
            at: [0.5 * (left + right), 0.5 * (top + bottom)],
            anchor: Anchor::Middle,
            size: 12.0,
            bold: false,
            paint: INK.alpha(0.6),
            upright: false,
        }));
    }
    Ok(())
}

/// Runs of points between gaps, in the picture.
fn runs(plot: &Plot, x: &[f64], y: &[f64], run: &dyn Run) -> Result<Vec<Vec<[f64; 2]>>, Cancelled> {
    let (mut out, mut thin) = (Vec::new(), Thin::default());
    for (i, (x, y)) in x.iter().zip(y).enumerate() {
        if i % BATCH == 0 && run.cancelled() {
            return Err(Cancelled);
        }
        if drawable(*x, plot.x.log) && drawable(*y, plot.y.log) {
            thin.add(plot.at(*x, *y));
        } else {
            out.extend(thin.take());
        }
    }
    out.extend(thin.take());
    Ok(out)
}

/// A line without points that change no pixel: of those in one column of the picture in a row, the
/// first, lowest, highest and last are kept (Jugel et al., VLDB 2014).
#[derive(Default)]
struct Thin {
    kept: Vec<[f64; 2]>,
    column: i64,
    /// First, lowest, highest, last with their numbers.
    seen: Option<[(usize, [f64; 2]); 4]>,
    count: usize,
}

impl Thin {
    fn add(&mut self, point: [f64; 2]) {
        let column = (point[0] / COLUMN).floor() as i64;
        if column != self.column {
            self.flush();
        }
        self.column = column;
        let one = (self.count, point);
        self.count += 1;
        match &mut self.seen {
            None => self.seen = Some([one; 4]),
            Some([_, low, high, last]) => {
                if point[1] > low.1[1] {
                    *low = one;
                }
                if point[1] < high.1[1] {
                    *high = one;
                }
                *last = one;
            }
        }
    }

    fn flush(&mut self) {
        if let Some(mut seen) = self.seen.take() {
            seen.sort_by_key(|one| one.0);
            let mut last = None;
            for (number, point) in seen {
                if last != Some(number) {
                    self.kept.push(point);
                }
                last = Some(number);
            }
        }
    }

    fn take(&mut self) -> Option<Vec<[f64; 2]>> {
        self.flush();
        self.count = 0;
        let run = std::mem::take(&mut self.kept);
        (!run.is_empty()).then_some(run)
    }
}

fn line(
    scene: &mut Scene,
    plot: &Plot,
    curve: &Curve<'_>,
    look: &Look,
    run: &dyn Run,
) -> Result<(), Cancelled> {
    let (single, lines): (Vec<_>, Vec<_>) = runs(plot, &curve.x, &curve.y, run)?
        .into_iter()
        .partition(|run| run.len() == 1);
    if !lines.is_empty() {
        scene.marks.push(Mark::Lines(lines, look.pen.clone()));
    }
    // A point between two gaps is no line, but must be seen.
    if !single.is_empty() {
        let dots = single.into_iter().flatten().collect();
        scene
            .marks
            .push(Mark::Dots(dots, 1.2 * look.pen.width, look.pen.paint));
    }
    Ok(())
}

fn points(
    scene: &mut Scene,
    plot: &Plot,
    curve: &Curve<'_>,
    look: &Look,
    run: &dyn Run,
) -> Result<(), Cancelled> {
    let radius = match curve.x.len() {
        0..=120 => 3.0,
        121..=1000 => 2.2,
        1001..=10_000 => 1.4,
        _ => 0.9,
    };
    // Discs that cover each other are drawn once.
    let cell = 0.4 * radius;
    let (mut taken, mut dots) = (HashSet::new(), Vec::new());
    for (i, (x, y)) in curve.x.iter().zip(&*curve.y).enumerate() {
        if i % BATCH == 0 && run.cancelled() {
            return Err(Cancelled);
        }
        if drawable(*x, plot.x.log) && drawable(*y, plot.y.log) {
            let at = plot.at(*x, *y);
            if taken.insert(at.map(|v| (v / cell).round() as i32)) {
                dots.push(at);
            }
        }
    }
    if !dots.is_empty() {
        scene.marks.push(Mark::Dots(dots, radius, look.area));
    }
    Ok(())
}

fn band(
    scene: &mut Scene,
    plot: &Plot,
    curve: &Curve<'_>,
    look: &Look,
    run: &dyn Run,
) -> Result<(), Cancelled> {
    let uppers = curve.upper.as_deref().unwrap_or(&curve.y);
    // Where one end is missing, so is the band.
    let both = |one: &f64, other: &f64| {
        if drawable(*other, plot.y.log) {
            *one
        } else {
            f64::NAN
        }
    };
    let low: Vec<f64> = curve
        .y
        .iter()
        .zip(uppers)
        .map(|(y, u)| both(y, u))
        .collect();
    let high: Vec<f64> = uppers
        .iter()
        .zip(&*curve.y)
        .map(|(u, y)| both(u, y))
        .collect();
    let lows = runs(plot, &curve.x, &low, run)?;
    let highs = runs(plot, &curve.x, &high, run)?;
    let mut areas = Vec::new();
    for (mut area, back) in lows.into_iter().zip(highs) {
        if let [[x, low]] = area[..] {
            let high = back[0][1];
            areas.push(vec![
                [x - 1.0, low],
                [x + 1.0, low],
                [x + 1.0, high],
                [x - 1.0, high],
            ]);
            continue;
        }
        area.extend(back.into_iter().rev());
        areas.push(area);
    }
    if !areas.is_empty() {
        scene.marks.push(Mark::Areas(areas, look.area));
    }
    Ok(())
}

/// Left and right edge and height of each bar: the edges lie midway between neighbours.
fn bars(curve: &Curve<'_>, log: [bool; 2]) -> Vec<(f64, f64, f64)> {
    let to = |v: f64| if log[0] { v.ln() } else { v };
    let from = |v: f64| if log[0] { v.exp() } else { v };
    let places = curve
        .x
        .iter()
        .zip(&*curve.y)
        .filter(|(x, _)| drawable(**x, log[0]));
    let mut places: Vec<(f64, f64)> = places.map(|(x, y)| (to(*x), *y)).collect();
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut different: Vec<f64> = places.iter().map(|place| place.0).collect();
    different.dedup();
    let steps = different.windows(2).map(|pair| pair[1] - pair[0]);
    let least = steps.fold(f64::INFINITY, f64::min);
    let bar = |&(x, y): &(f64, f64)| {
        let place = different.partition_point(|one| *one < x);
        let alone = if least.is_finite() {
            least
        } else if x == 0.0 || log[0] {
            1.0
        } else {
            0.1 * x.abs()
        };
        let before = place
            .checked_sub(1)
            .and_then(|p| different.get(p))
            .map(|p| x - p);
        let after = different.get(place + 1).map(|p| p - x);
        let left = before.or(after).unwrap_or(alone);
        let right = after.or(before).unwrap_or(alone);
        (from(x - 0.5 * left), from(x + 0.5 * right), y)
    };
    places.iter().map(bar).collect()
}

fn bar_marks(scene: &mut Scene, plot: &Plot, curve: &Curve<'_>, look: &Look) {
    let floor = plot.rect[3];
    let mut out = Vec::new();
    for (left, right, y) in bars(curve, [plot.x.log, plot.y.log]) {
        if !drawable(y, plot.y.log) || (y == 0.0 && !plot.y.log) {
            continue;
        }
        let ([mut l, top], [mut r, _]) = (plot.at(left, y), plot.at(right, y));
        let base = if plot.y.log {
            floor
        } else {
            plot.at(left, 0.0)[1]
        };
        if r - l > 8.0 * BAR_GAP {
            (l, r) = (l + 0.5 * BAR_GAP, r - 0.5 * BAR_GAP);
        }
        out.push([l, top.min(base), r, top.max(base)]);
    }
    if !out.is_empty() {
        scene.marks.push(Mark::Bars(out, look.area));
    }
}
