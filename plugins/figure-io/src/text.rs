//! Texts of a picture: runs with raised digits, their widths, lines, and outlines.

use ttf_parser::{Face, OutlineBuilder};

/// A part of a text in one size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Characters.
    pub text: String,
    /// Raised and smaller.
    pub raised: bool,
}

/// Size of raised characters, relative to the others.
pub const RAISED_SIZE: f64 = 0.72;
/// How far they are raised, relative to the size of the others.
pub const RAISED_BY: f64 = 0.36;

/// Splits at exponents: `1/nm^2` has a raised 2, and `um` begins with a micro sign as a unit.
pub fn pieces(text: &str) -> Vec<Piece> {
    let mut out: Vec<Piece> = Vec::new();
    let mut push = |text: String, raised| {
        if !text.is_empty() {
            out.push(Piece { text, raised });
        }
    };
    let (mut plain, mut rest) = (String::new(), text);
    while let Some((before, after)) = rest.split_once('^') {
        let sign = usize::from(after.starts_with(['-', '+', '\u{2212}']));
        let digits = |c: &char| c.is_ascii_digit() || *c == '.' || *c == '/';
        let count = sign + after.chars().skip(sign).take_while(digits).count();
        plain.push_str(before);
        if count == sign {
            plain.push('^');
            rest = after;
            continue;
        }
        push(std::mem::take(&mut plain), false);
        let raised: String = after.chars().take(count).collect();
        push(raised.replace('-', "\u{2212}"), true);
        rest = &after[after.char_indices().nth(count).map_or(after.len(), |c| c.0)..];
    }
    plain.push_str(rest);
    push(plain, false);
    out
}

/// The unit as people write it; empty for pure numbers and unknown units.
pub fn unit(unit: &str) -> String {
    let one = |word: &str| match word {
        "um" => "\u{b5}m".into(),
        "us" => "\u{b5}s".into(),
        "1" if unit.trim() == "1" => String::new(),
        "photon" if unit == "photon" => "photons".into(),
        "frame" if unit == "frame" => "frames".into(),
        word => word.to_owned(),
    };
    if matches!(unit.trim(), "" | "1" | "unknown") {
        return String::new();
    }
    let mut out = String::new();
    let mut word = String::new();
    for c in unit.chars().chain([' ']) {
        if c.is_alphanumeric() {
            word.push(c);
            continue;
        }
        out.push_str(&one(&std::mem::take(&mut word)));
        out.push(if c == '*' { '\u{b7}' } else { c });
    }
    out.trim_end().to_owned()
}

/// The font that pictures are measured with and PNG files are drawn with.
pub struct Font {
    faces: Vec<Face<'static>>,
}

impl Font {
    /// Ubuntu Light; characters that it lacks come from Hack.
    pub fn new() -> Font {
        let files = [
            epaint_default_fonts::UBUNTU_LIGHT,
            epaint_default_fonts::HACK_REGULAR,
        ];
        let faces = files.iter().filter_map(|file| Face::parse(file, 0).ok());
        Font {
            faces: faces.collect(),
        }
    }

    fn glyph(&self, c: char) -> Option<(&Face<'static>, ttf_parser::GlyphId)> {
        let found = self
            .faces
            .iter()
            .find_map(|face| Some((face, face.glyph_index(c)?)));
        found.or_else(|| Some((self.faces.first()?, ttf_parser::GlyphId(0))))
    }

    /// Whether there is a glyph for a character.
    #[cfg(test)]
    pub fn has(&self, c: char) -> bool {
        self.faces.iter().any(|face| face.glyph_index(c).is_some())
    }

    /// Width of a text in units of its size.
    fn advance(&self, text: &str) -> f64 {
        let one = |c| {
            let (face, glyph) = self.glyph(c)?;
            let advance = face.glyph_hor_advance(glyph)?;
            Some(f64::from(advance) / f64::from(face.units_per_em()))
        };
        text.chars().filter_map(one).sum()
    }

    /// Width of a text with exponents.
    pub fn width(&self, text: &str, size: f64) -> f64 {
        let one = |piece: &Piece| {
            self.advance(&piece.text) * if piece.raised { RAISED_SIZE } else { 1.0 }
        };
        size * pieces(text).iter().map(one).sum::<f64>()
    }

    /// Breaks a text into lines of at most `width`, at spaces where there are any.
    pub fn wrap(&self, text: &str, size: f64, width: f64) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for paragraph in text.lines() {
            let mut line = String::new();
            for word in paragraph.split_whitespace() {
                let longer = if line.is_empty() {
                    word.to_owned()
                } else {
                    format!("{line} {word}")
                };
                if self.width(&longer, size) <= width {
                    line = longer;
                    continue;
                }
                if !line.is_empty() {
                    lines.push(std::mem::take(&mut line));
                }
                // A word that is wider than a line is cut.
                for c in word.chars() {
                    line.push(c);
                    if line.chars().count() > 1 && self.width(&line, size) > width {
                        line.pop();
                        lines.push(std::mem::replace(&mut line, c.into()));
                    }
                }
            }
            lines.push(line);
        }
        lines
    }

    /// Draws the glyphs of a text into `out`, from the origin along x, y down, at a size.
    pub fn outline(&self, text: &str, size: f64, out: &mut dyn Outline) {
        let mut x = 0.0;
        for piece in pieces(text) {
            let (size, y) = match piece.raised {
                true => (size * RAISED_SIZE, -size * RAISED_BY),
                false => (size, 0.0),
            };
            for (face, glyph) in piece.text.chars().filter_map(|c| self.glyph(c)) {
                let scale = size / f64::from(face.units_per_em());
                face.outline_glyph(glyph, &mut Placed { scale, x, y, out });
                x += scale * f64::from(face.glyph_hor_advance(glyph).unwrap_or(0));
            }
        }
    }
}

/// Takes outlines.
pub trait Outline {
    /// Begins a contour.
    fn move_to(&mut self, x: f64, y: f64);
    /// A straight line.
    fn line_to(&mut self, x: f64, y: f64);
    /// A curve of second degree.
    fn quad_to(&mut self, x1: f64, y1: f64, x: f64, y: f64);
    /// A curve of third degree: two control points and its end.
    fn cubic_to(&mut self, points: [f64; 6]);
    /// Ends a contour.
    fn close(&mut self);
}

/// A glyph in its place.
struct Placed<'a> {
    scale: f64,
    x: f64,
    y: f64,
    out: &'a mut dyn Outline,
}

impl Placed<'_> {
    fn at(&self, x: f32, y: f32) -> (f64, f64) {
        (
            self.x + self.scale * f64::from(x),
            self.y - self.scale * f64::from(y),
        )
    }
}

impl OutlineBuilder for Placed<'_> {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.out.move_to(x, y);
    }
    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.out.line_to(x, y);
    }
    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.out.quad_to(x1, y1, x, y);
    }
    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2)) = (self.at(x1, y1), self.at(x2, y2));
        let (x, y) = self.at(x, y);
        self.out.cubic_to([x1, y1, x2, y2, x, y]);
    }
    fn close(&mut self) {
        self.out.close();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn exponents_are_raised() {
        let piece = |text: &str, raised| Piece {
            text: text.into(),
            raised,
        };
        assert_eq!(
            pieces("K (nm^2)"),
            [piece("K (nm", false), piece("2", true), piece(")", false)]
        );
        assert_eq!(
            pieces("10^-3"),
            [piece("10", false), piece("\u{2212}3", true)]
        );
        assert_eq!(pieces("a ^ b^"), [piece("a ^ b^", false)]);
        assert!(pieces("").is_empty());
    }

    #[test]
    fn units_read_well() {
        assert_eq!(unit("1"), "");
        assert_eq!(unit("1/um^2"), "1/\u{b5}m^2");
        assert_eq!(unit("um"), "\u{b5}m");
        assert_eq!(unit("photon"), "photons");
        assert_eq!(unit("unknown"), "");
    }

    #[test]
    fn the_font_has_what_figures_need() {
        let font = Font::new();
        for c in "aZ09 .,()[]/%+-\u{2212}\u{b5}\u{b7}\u{b1}\u{d7}\u{2264}\u{3c3}\u{3bc}\u{3bb}\u{3b1}\u{c5}\u{b0}\u{2026}\u{2013}".chars() {
            assert!(font.has(c), "{c}");
        }
    }

    #[test]
    fn lines_keep_every_word_and_fit() {
        let font = Font::new();
        let text =
            "Ripley's K of 10000 points with a window of 40 um x 40 um and averyveryverylongword";
        let lines = font.wrap(text, 10.0, 80.0);
        assert!(lines.len() > 4);
        assert!(lines.iter().all(|line| font.width(line, 10.0) <= 80.0));
        let joined: String = lines.concat().replace(' ', "");
        assert_eq!(joined, text.replace(' ', ""));
    }
}
