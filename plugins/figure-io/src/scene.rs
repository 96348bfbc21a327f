//! A picture as a list of marks, which become SVG or pixels. Lengths are CSS pixels (1/96 inch), y
//! down.

/// A colour with its opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paint {
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// Opacity, 0 to 1.
    pub alpha: f64,
}

impl Paint {
    /// An opaque colour.
    pub const fn solid(rgb: [u8; 3]) -> Paint {
        Paint { rgb, alpha: 1.0 }
    }

    /// The colour with another opacity.
    pub const fn alpha(self, alpha: f64) -> Paint {
        Paint { alpha, ..self }
    }
}

/// How a line is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Pen {
    /// Colour.
    pub paint: Paint,
    /// Width.
    pub width: f64,
    /// Lengths of dashes and gaps; solid if empty.
    pub dashes: Vec<f64>,
}

impl Pen {
    /// A solid line.
    pub const fn solid(paint: Paint, width: f64) -> Pen {
        Pen {
            paint,
            width,
            dashes: Vec::new(),
        }
    }
}

/// Where a text lies relative to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// Its middle is there.
    Middle,
    /// It ends there.
    End,
}

/// A text.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Characters; `^2` raises the 2.
    pub text: String,
    /// Point on the base line.
    pub at: [f64; 2],
    /// Where it lies.
    pub anchor: Anchor,
    /// Size of the font.
    pub size: f64,
    /// Heavier.
    pub bold: bool,
    /// Colour.
    pub paint: Paint,
    /// A quarter turn to the left about its point.
    pub upright: bool,
}

/// Something to draw.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// Lines through points, several as one.
    Lines(Vec<Vec<[f64; 2]>>, Pen),
    /// Filled polygons, several as one.
    Areas(Vec<Vec<[f64; 2]>>, Paint),
    /// Rectangles: left, top, right, bottom.
    Bars(Vec<[f64; 4]>, Paint),
    /// Discs of one radius.
    Dots(Vec<[f64; 2]>, f64, Paint),
    /// A text.
    Label(Label),
}

/// A picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// Title for those who cannot see it.
    pub title: String,
    /// Description for those who cannot see it.
    pub description: String,
    /// Marks, those behind first.
    pub marks: Vec<Mark>,
}
