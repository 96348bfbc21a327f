//! A picture as SVG 1.1 with texts as text.

use crate::scene::{Anchor, Label, Mark, Paint, Pen, Scene};
use crate::text::{RAISED_BY, RAISED_SIZE, pieces};
use std::fmt::Write;

/// Fonts that are nearly everywhere, the best first.
const FONTS: &str = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif";

/// The picture as the text of a file.
pub fn svg(scene: &Scene) -> String {
    let mut out = String::new();
    let (w, h) = (number(scene.width), number(scene.height));
    let (mm_w, mm_h) = (
        number(scene.width * 25.4 / 96.0),
        number(scene.height * 25.4 / 96.0),
    );
    // Writing into a text cannot fail.
    let _ = writeln!(
        out,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" \
         version=\"1.1\" width=\"{mm_w}mm\" height=\"{mm_h}mm\" viewBox=\"0 0 {w} {h}\" role=\"img\" \
         font-family=\"{FONTS}\">"
    );
    if !scene.title.is_empty() {
        let _ = writeln!(out, "<title>{}</title>", escaped(&scene.title));
    }
    if !scene.description.is_empty() {
        let _ = writeln!(out, "<desc>{}</desc>", escaped(&scene.description));
    }
    let _ = writeln!(out, "<rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>");
    for mark in &scene.marks {
        draw(mark, &mut out);
    }
    out.push_str("</svg>\n");
    out
}

fn draw(mark: &Mark, out: &mut String) {
    let _ = match mark {
        Mark::Lines(lines, pen) => {
            writeln!(
                out,
                "<path d=\"{}\" fill=\"none\"{}/>",
                path(lines, ""),
                stroke(pen)
            )
        }
        Mark::Areas(areas, paint) => {
            writeln!(out, "<path d=\"{}\"{}/>", path(areas, "Z"), fill(paint))
        }
        Mark::Bars(bars, paint) => {
            let corners = |[l, t, r, b]: &[f64; 4]| vec![[*l, *t], [*r, *t], [*r, *b], [*l, *b]];
            let areas: Vec<_> = bars.iter().map(corners).collect();
            writeln!(out, "<path d=\"{}\"{}/>", path(&areas, "Z"), fill(paint))
        }
        Mark::Dots(dots, radius, paint) => {
            // Lines of no length with round ends are the shortest way to write discs.
            let lines: Vec<_> = dots.iter().map(|dot| vec![*dot, *dot]).collect();
            let pen = Pen::solid(*paint, 2.0 * radius);
            writeln!(
                out,
                "<path d=\"{}\" fill=\"none\"{}/>",
                path(&lines, ""),
                stroke(&pen)
            )
        }
        Mark::Label(label) => writeln!(out, "{}", text(label)),
    };
}

fn path(lines: &[Vec<[f64; 2]>], end: &str) -> String {
    let mut out = String::new();
    for line in lines {
        for (i, [x, y]) in line.iter().enumerate() {
            out.push(match i {
                0 => 'M',
                1 => 'L',
                _ => ' ',
            });
            let _ = write!(out, "{} {}", number(*x), number(*y));
        }
        out.push_str(end);
    }
    out
}

fn fill(paint: &Paint) -> String {
    format!(
        " fill=\"{}\"{}",
        colour(paint),
        opacity("fill-opacity", paint)
    )
}

fn stroke(pen: &Pen) -> String {
    let mut out = format!(
        " stroke=\"{}\"{} stroke-width=\"{}\" stroke-linejoin=\"round\"",
        colour(&pen.paint),
        opacity("stroke-opacity", &pen.paint),
        number(pen.width)
    );
    if pen.dashes.is_empty() {
        out.push_str(" stroke-linecap=\"round\"");
    } else {
        let dashes: Vec<String> = pen.dashes.iter().map(|dash| number(*dash)).collect();
        let _ = write!(out, " stroke-dasharray=\"{}\"", dashes.join(" "));
    }
    out
}

fn text(label: &Label) -> String {
    let [x, y] = label.at.map(number);
    let anchor = match label.anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    let turn = if label.upright {
        format!(" transform=\"rotate(-90 {x} {y})\"")
    } else {
        String::new()
    };
    let weight = if label.bold {
        " font-weight=\"bold\""
    } else {
        ""
    };
    let mut inner = String::new();
    let mut raised = false;
    for piece in pieces(&label.text) {
        let up = label.size * RAISED_BY;
        let step = match (raised, piece.raised) {
            (false, true) => format!(" dy=\"{}\"", number(-up)),
            (true, false) => format!(" dy=\"{}\"", number(up)),
            _ => String::new(),
        };
        raised = piece.raised;
        let size = match raised {
            true => format!(" font-size=\"{}\"", number(label.size * RAISED_SIZE)),
            false => String::new(),
        };
        let text = escaped(&piece.text);
        if step.is_empty() && size.is_empty() {
            inner.push_str(&text);
        } else {
            let _ = write!(inner, "<tspan{step}{size}>{text}</tspan>");
        }
    }
    format!(
        "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" font-size=\"{}\"{weight}{}{turn}>{inner}</text>",
        number(label.size),
        fill(&label.paint)
    )
}

fn colour(paint: &Paint) -> String {
    let [r, g, b] = paint.rgb;
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn opacity(name: &str, paint: &Paint) -> String {
    if paint.alpha < 1.0 {
        format!(" {name}=\"{}\"", number(paint.alpha))
    } else {
        String::new()
    }
}

/// With two decimals at most, which is a hundredth of a pixel.
fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

/// Text as XML allows it: without control characters, markup escaped.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\u{fffe}' | '\u{ffff}' => {}
            c if c.is_control() && c != '\n' => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_texts_is_escaped() {
        let label = Label {
            text: "a<b & \"c\"\u{7}^2".into(),
            at: [1.0, 2.0],
            anchor: Anchor::Start,
            size: 10.0,
            bold: false,
            paint: Paint::solid([0, 0, 0]),
            upright: false,
        };
        let text = text(&label);
        assert!(text.contains("a&lt;b &amp; &quot;c&quot; <tspan"), "{text}");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [number(1.0), number(-0.001), number(2.504)],
            ["1", "0", "2.5"]
        );
    }
}
