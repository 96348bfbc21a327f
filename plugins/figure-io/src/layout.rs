//! Where the parts of a picture lie: title, legend, plot, axes, caption.

use crate::axis::{Axis, Range};
use crate::colours::{GRID, INK, Look, QUIET, RULE};
use crate::data::{Curve, Style};
use crate::scene::{Anchor, Label, Mark, Paint, Pen, Scene};
use crate::text::{self, Font};
use puncta_sdk::Figure;

/// Space around the picture.
const MARGIN: f64 = 14.0;
/// Sizes of fonts: title, labels of axes, legend, ticks, caption.
const TITLE: f64 = 14.0;
const AXIS: f64 = 12.0;
const LEGEND: f64 = 11.0;
const TICKS: f64 = 10.5;
const CAPTION: f64 = 10.0;
/// Height of a line of text relative to its size.
const LEADING: f64 = 1.35;
/// Length of ticks, and the gap to their labels.
const TICK: f64 = 4.0;
const GAP: f64 = 4.0;
/// Length of a sample in the legend.
const SAMPLE: f64 = 20.0;
/// Smallest plot.
const LEAST: [f64; 2] = [80.0, 60.0];
/// Fonts of viewers may be wider than the one that is measured with.
const ROOM: f64 = 1.12;

/// What the person chose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Width of the picture in CSS pixels.
    pub width: f64,
    /// Height without the caption.
    pub height: f64,
    /// With the title.
    pub title: bool,
    /// With the caption below.
    pub caption: bool,
}

/// The plot: its rectangle and axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Left, top, right, bottom.
    pub rect: [f64; 4],
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
}

impl Plot {
    /// The point of the picture for values.
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let [left, top, right, bottom] = self.rect;
        [
            left + self.x.place(x) * (right - left),
            bottom - self.y.place(y) * (bottom - top),
        ]
    }
}

/// Ranges of the values of the curves.
#[derive(Clone, Copy, Debug)]
pub struct Ranges {
    /// Along both axes.
    pub xy: [Range; 2],
    /// Logarithmic axes.
    pub log: [bool; 2],
}

/// Lays out everything but the curves, which belong into the plot.
pub fn layout(
    figure: &Figure,
    curves: &[Curve<'_>],
    looks: &[Look],
    ranges: &Ranges,
    frame: &Frame,
    font: &Font,
) -> (Scene, Plot) {
    let mut scene = Scene {
        width: frame.width,
        height: frame.height,
        title: figure.title.clone(),
        description: figure.caption.clone(),
        marks: Vec::new(),
    };
    let inner = frame.width - 2.0 * MARGIN;
    let mut top = MARGIN;
    if frame.title && !figure.title.trim().is_empty() {
        for line in font.wrap(&figure.title, TITLE, inner / ROOM) {
            top += TITLE * LEADING;
            scene.marks.push(label(
                line,
                [MARGIN, top - 0.3 * TITLE],
                Anchor::Start,
                TITLE,
                true,
                INK,
            ));
        }
        top += 6.0;
    }
    let plot_top = legend(&mut scene, curves, looks, top, inner, font) + 8.0;
    let below = TICK + GAP + TICKS + 8.0 + AXIS * LEADING + MARGIN;
    scene.height = frame.height.max(plot_top + LEAST[1] + below);
    let bottom = scene.height - below;
    let plot = axes(
        figure,
        ranges,
        frame.width,
        [plot_top, bottom],
        curves,
        font,
    );
    draw_axes(&mut scene, figure, &plot, font);
    if frame.caption && !figure.caption.trim().is_empty() {
        for line in font.wrap(&figure.caption, CAPTION, inner / ROOM) {
            scene.height += CAPTION * LEADING;
            let at = [MARGIN, scene.height - MARGIN - 0.3 * CAPTION + 4.0];
            scene
                .marks
                .push(label(line, at, Anchor::Start, CAPTION, false, QUIET));
        }
        scene.height += 4.0;
    }
    (scene, plot)
}

fn label(text: String, at: [f64; 2], anchor: Anchor, size: f64, bold: bool, paint: Paint) -> Mark {
    Mark::Label(Label {
        text,
        at,
        anchor,
        size,
        bold,
        paint,
        upright: false,
    })
}

/// The legend in rows from `top`; gives where they end.
fn legend(
    scene: &mut Scene,
    curves: &[Curve<'_>],
    looks: &[Look],
    top: f64,
    inner: f64,
    font: &Font,
) -> f64 {
    let named = || {
        curves
            .iter()
            .zip(looks)
            .filter(|(curve, _)| !curve.label.trim().is_empty())
    };
    if curves.len() < 2 || named().next().is_none() {
        return top;
    }
    let (mut x, mut middle) = (MARGIN, top + 0.5 * LEGEND * LEADING);
    for (curve, look) in named() {
        let most = inner - SAMPLE - 6.0;
        let mut text = curve.label.clone();
        while font.width(&text, LEGEND) * ROOM > most && text.chars().count() > 2 {
            text.pop();
            text.pop();
            text.push('\u{2026}');
        }
        let width = SAMPLE + 6.0 + font.width(&text, LEGEND) * ROOM;
        if x > MARGIN && x + width > MARGIN + inner {
            (x, middle) = (MARGIN, middle + LEGEND * LEADING + 2.0);
        }
        sample(scene, curve.style, look, x, middle);
        let at = [x + SAMPLE + 6.0, middle + 0.36 * LEGEND];
        scene
            .marks
            .push(label(text, at, Anchor::Start, LEGEND, false, INK));
        x += width + 16.0;
    }
    middle + 0.5 * LEGEND * LEADING + 4.0
}

fn sample(scene: &mut Scene, style: Style, look: &Look, x: f64, y: f64) {
    scene.marks.push(match style {
        Style::Line => Mark::Lines(vec![vec![[x, y], [x + SAMPLE, y]]], look.pen.clone()),
        Style::Points => Mark::Dots(vec![[x + 0.5 * SAMPLE, y]], 3.0, look.area.alpha(1.0)),
        Style::Bars | Style::Band => Mark::Bars(
            vec![[x + 3.0, y - 4.5, x + SAMPLE - 1.0, y + 4.5]],
            look.area,
        ),
    });
}

/// The axes between the top and bottom of the plot, with room for their labels.
fn axes(
    figure: &Figure,
    ranges: &Ranges,
    width: f64,
    [top, bottom]: [f64; 2],
    curves: &[Curve<'_>],
    font: &Font,
) -> Plot {
    let has = |style| curves.iter().any(|curve| curve.style == style);
    // Curves and bars fill the plot from side to side, points keep off its edges.
    let padding = if has(Style::Points) { 0.03 } else { 0.0 };
    let rows = ((bottom - top) / 38.0) as usize;
    let y = Axis::new(ranges.xy[1], ranges.log[1], 0.05, true, rows.min(8));
    let widest = |axis: &Axis| {
        let widths = axis.ticks.iter().map(|tick| font.width(&tick.label, TICKS));
        ROOM * widths.fold(0.0, f64::max)
    };
    let title = if figure.y.iter().all(|text| text.trim().is_empty()) {
        0.0
    } else {
        AXIS * LEADING + 4.0
    };
    let left = MARGIN + title + widest(&y) + GAP + TICK;
    let mut right = width - MARGIN;
    let mut room = 9;
    loop {
        let x = Axis::new(ranges.xy[0], ranges.log[0], padding, false, room);
        let wide = widest(&x);
        // The last label may stand out by half its width.
        let shown = x.ticks.iter().rev().find(|tick| !tick.label.is_empty());
        let end = shown.map_or(0.0, |tick| left + x.place(tick.value) * (right - left));
        let out = end + 0.5 * wide - (width - 0.5 * MARGIN);
        if out > 0.5 {
            right = (right - out).max(left + LEAST[0]);
        }
        let least = spacing(&x) * (right - left);
        if room <= 2 || wide + 12.0 <= least {
            return Plot {
                rect: [left, top, right.max(left + LEAST[0]), bottom],
                x,
                y,
            };
        }
        room -= 1;
    }
}

/// Smallest distance of two labelled ticks, as a share of the axis.
fn spacing(axis: &Axis) -> f64 {
    let shown = axis.ticks.iter().filter(|tick| !tick.label.is_empty());
    let places: Vec<f64> = shown.map(|tick| axis.place(tick.value)).collect();
    places
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(1.0, f64::min)
}

fn draw_axes(scene: &mut Scene, figure: &Figure, plot: &Plot, font: &Font) {
    let [left, top, right, bottom] = plot.rect;
    let place = |axis: &Axis, value| axis.place(value).clamp(0.0, 1.0);
    let across = |value| left + place(&plot.x, value) * (right - left);
    let down = |value| bottom - place(&plot.y, value) * (bottom - top);
    let (mut grid, mut ticks, mut labels) = (Vec::new(), Vec::new(), Vec::new());
    for tick in &plot.x.ticks {
        let (x, length) = (
            across(tick.value),
            if tick.label.is_empty() {
                0.6 * TICK
            } else {
                TICK
            },
        );
        ticks.push(vec![[x, bottom], [x, bottom + length]]);
        if !tick.label.is_empty() {
            grid.push(vec![[x, top], [x, bottom]]);
            let at = [x, bottom + TICK + GAP + 0.8 * TICKS];
            labels.push(label(
                tick.label.clone(),
                at,
                Anchor::Middle,
                TICKS,
                false,
                INK,
            ));
        }
    }
    for tick in &plot.y.ticks {
        let (y, length) = (
            down(tick.value),
            if tick.label.is_empty() {
                0.6 * TICK
            } else {
                TICK
            },
        );
        ticks.push(vec![[left - length, y], [left, y]]);
        if !tick.label.is_empty() {
            grid.push(vec![[left, y], [right, y]]);
            let at = [left - TICK - GAP, y + 0.35 * TICKS];
            labels.push(label(
                tick.label.clone(),
                at,
                Anchor::End,
                TICKS,
                false,
                INK,
            ));
        }
    }
    scene.marks.push(Mark::Lines(grid, Pen::solid(GRID, 0.8)));
    if plot.y.low < 0.0 && plot.y.high > 0.0 {
        let y = down(0.0);
        scene.marks.push(Mark::Lines(
            vec![vec![[left, y], [right, y]]],
            Pen::solid(RULE, 1.0),
        ));
    }
    ticks.push(vec![[left, top], [left, bottom], [right, bottom]]);
    scene.marks.push(Mark::Lines(ticks, Pen::solid(INK, 1.0)));
    scene.marks.append(&mut labels);
    let fitted =
        |text: &str, room: f64| AXIS.min(AXIS * room / (ROOM * font.width(text, AXIS)).max(1.0));
    let text = title(&figure.x, &plot.x);
    let at = [
        0.5 * (left + right),
        bottom + TICK + GAP + TICKS + 8.0 + 0.85 * AXIS,
    ];
    let size = fitted(&text, right - left);
    scene
        .marks
        .push(label(text, at, Anchor::Middle, size, false, INK));
    let text = title(&figure.y, &plot.y);
    let size = fitted(&text, bottom - top + 8.0);
    let at = [MARGIN + 0.85 * AXIS, 0.5 * (top + bottom)];
    let (anchor, paint) = (Anchor::Middle, INK);
    scene.marks.push(Mark::Label(Label {
        text,
        at,
        anchor,
        size,
        bold: false,
        paint,
        upright: true,
    }));
}

/// `label (10^6 unit)`.
fn title([label, unit]: &[String; 2], axis: &Axis) -> String {
    let mut unit = text::unit(unit);
    if unit == label.to_lowercase() {
        // "photons (photons)" says no more than "photons".
        unit.clear();
    }
    let power = if axis.exponent == 0 {
        String::new()
    } else {
        format!("10^{}", axis.exponent)
    };
    match (power.is_empty(), unit.is_empty()) {
        (true, true) => label.clone(),
        (true, false) => format!("{label} ({unit})"),
        (false, true) => format!("{label} ({power})"),
        (false, false) => format!("{label} ({power} {unit})"),
    }
}
