//! A picture as pixels.

use crate::scene::{Anchor, Label, Mark, Paint, Pen, Scene};
use crate::text::{Font, Outline};
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Path, PathBuilder, Pixmap, Stroke, StrokeDash, Transform,
};

/// Outlines of letters are drawn around as well, since the font is light; relative to its size.
const WEIGHT: f32 = 0.022;
/// The same for bold letters.
const BOLD: f32 = 0.075;

/// The picture with `scale` pixels to a CSS pixel; None when it is too large.
pub fn raster(scene: &Scene, font: &Font, scale: f64) -> Option<Pixmap> {
    let side = |length: f64| (length * scale).ceil().clamp(1.0, 1e6) as u32;
    let mut pixmap = Pixmap::new(side(scene.width), side(scene.height))?;
    pixmap.fill(Color::WHITE);
    let to = Transform::from_scale(scale as f32, scale as f32);
    for mark in &scene.marks {
        draw(mark, font, &mut pixmap, to);
    }
    Some(pixmap)
}

fn draw(mark: &Mark, font: &Font, out: &mut Pixmap, to: Transform) {
    match mark {
        Mark::Lines(lines, pen) => stroke(path(lines, false), pen, out, to),
        Mark::Areas(areas, paint) => fill(path(areas, true), paint, out, to),
        Mark::Bars(bars, paint) => {
            let corners = |[l, t, r, b]: &[f64; 4]| vec![[*l, *t], [*r, *t], [*r, *b], [*l, *b]];
            let areas: Vec<_> = bars.iter().map(corners).collect();
            fill(path(&areas, true), paint, out, to);
        }
        Mark::Dots(dots, radius, paint) => {
            let mut builder = PathBuilder::new();
            for [x, y] in dots {
                builder.push_circle(*x as f32, *y as f32, *radius as f32);
            }
            fill(builder.finish(), paint, out, to);
        }
        Mark::Label(label) => text(label, font, out, to),
    }
}

fn path(lines: &[Vec<[f64; 2]>], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for line in lines {
        for (i, [x, y]) in line.iter().enumerate() {
            match i {
                0 => builder.move_to(*x as f32, *y as f32),
                _ => builder.line_to(*x as f32, *y as f32),
            }
        }
        if closed {
            builder.close();
        }
    }
    builder.finish()
}

fn ink(paint: &Paint) -> tiny_skia::Paint<'static> {
    let mut ink = tiny_skia::Paint::default();
    let [r, g, b] = paint.rgb;
    ink.set_color_rgba8(r, g, b, (paint.alpha * 255.0).round() as u8);
    ink.anti_alias = true;
    ink
}

fn fill(path: Option<Path>, paint: &Paint, out: &mut Pixmap, to: Transform) {
    if let Some(path) = path {
        out.fill_path(&path, &ink(paint), FillRule::Winding, to, None);
    }
}

fn stroke(path: Option<Path>, pen: &Pen, out: &mut Pixmap, to: Transform) {
    let Some(path) = path else {
        return;
    };
    let dashes: Vec<f32> = pen.dashes.iter().map(|dash| *dash as f32).collect();
    let stroke = Stroke {
        width: pen.width as f32,
        line_cap: if dashes.is_empty() {
            LineCap::Round
        } else {
            LineCap::Butt
        },
        line_join: LineJoin::Round,
        dash: StrokeDash::new(dashes, 0.0),
        ..Stroke::default()
    };
    out.stroke_path(&path, &ink(&pen.paint), &stroke, to, None);
}

fn text(label: &Label, font: &Font, out: &mut Pixmap, to: Transform) {
    let width = font.width(&label.text, label.size);
    let before = match label.anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => 0.5 * width,
        Anchor::End => width,
    };
    let mut glyphs = Glyphs(PathBuilder::new());
    font.outline(&label.text, label.size, &mut glyphs);
    let Some(path) = glyphs.0.finish() else {
        return;
    };
    let [x, y] = label.at.map(|v| v as f32);
    let turned = match label.upright {
        true => Transform::from_row(0.0, -1.0, 1.0, 0.0, x, y),
        false => Transform::from_translate(x, y),
    };
    let to = turned.pre_translate(-before as f32, 0.0).post_concat(to);
    out.fill_path(&path, &ink(&label.paint), FillRule::Winding, to, None);
    let around = Stroke {
        width: label.size as f32 * if label.bold { BOLD } else { WEIGHT },
        line_join: LineJoin::Round,
        ..Stroke::default()
    };
    out.stroke_path(&path, &ink(&label.paint), &around, to, None);
}

struct Glyphs(PathBuilder);

impl Outline for Glyphs {
    fn move_to(&mut self, x: f64, y: f64) {
        self.0.move_to(x as f32, y as f32);
    }
    fn line_to(&mut self, x: f64, y: f64) {
        self.0.line_to(x as f32, y as f32);
    }
    fn quad_to(&mut self, x1: f64, y1: f64, x: f64, y: f64) {
        self.0.quad_to(x1 as f32, y1 as f32, x as f32, y as f32);
    }
    fn cubic_to(&mut self, points: [f64; 6]) {
        let [x1, y1, x2, y2, x, y] = points.map(|v| v as f32);
        self.0.cubic_to(x1, y1, x2, y2, x, y);
    }
    fn close(&mut self) {
        self.0.close();
    }
}
