//! The text by which ImageJ knows the size, order and calibration of the planes of a TIFF file.
//!
//! It stands in the ImageDescription of the first page: `name=value` lines, read by Java's
//! `Properties`, so that characters beyond ASCII are written `\uXXXX`. With more than one plane
//! ImageJ reads the first page only and takes the planes as following each other in the file
//! without a gap, channel fastest, then slice, then frame.

use puncta_sdk::prelude::*;
use std::fmt::Write as _;

/// What the description says beside the grid.
#[derive(Clone, Debug, Default)]
pub(crate) struct Description<'a> {
    /// Stored numbers that are shown black and white.
    pub(crate) display: [f64; 2],
    /// Value = first + second * stored number, where that is not the number itself.
    pub(crate) linear: Option<[f64; 2]>,
    /// Unit of the values.
    pub(crate) unit: &'a str,
    /// A text of the person.
    pub(crate) comment: Option<&'a str>,
}

impl Description<'_> {
    /// The text for an image with this grid.
    pub(crate) fn text(&self, info: &ImageInfo) -> String {
        let mut lines = Lines(String::new());
        lines.planes(info);
        lines.space(info);
        if info.frame_time > 0.0 {
            lines.add("finterval", info.frame_time);
            lines.add("tunit", "sec");
        }
        if let Some([offset, step]) = self.linear {
            lines.add("cf", 0);
            lines.add("c0", offset);
            lines.add("c1", step);
            let unit = if self.unit == "1" { "value" } else { self.unit };
            lines.add("vunit", escaped(unit));
        }
        lines.add("min", self.display[0]);
        lines.add("max", self.display[1]);
        for (i, name) in info.channels.iter().enumerate() {
            lines.add(&format!("channel{}", i + 1), escaped(name));
        }
        if let Some(comment) = self.comment {
            lines.add("comment", escaped(comment));
        }
        lines.0
    }
}

/// The lines of a description.
struct Lines(String);

impl Lines {
    fn add(&mut self, name: &str, value: impl std::fmt::Display) {
        // Writing to a text does not fail.
        let _ = writeln!(self.0, "{name}={value}");
    }

    /// Number and order of the planes.
    fn planes(&mut self, info: &ImageInfo) {
        let [frames, channels, slices, ..] = info.size;
        let images = frames * channels * slices;
        self.add("ImageJ", "1.11a");
        self.add("images", images);
        let axes = [
            ("channels", channels),
            ("slices", slices),
            ("frames", frames),
        ];
        for (name, count) in axes.into_iter().filter(|(_, count)| *count > 1) {
            self.add(name, count);
        }
        if images > 1 {
            self.add("hyperstack", true);
            let mode = if channels > 1 {
                "composite"
            } else {
                "grayscale"
            };
            self.add("mode", mode);
            self.add("loop", false);
        }
    }

    /// Size and place of the voxels.
    fn space(&mut self, info: &ImageInfo) {
        let ([z, y, x], [origin_z, origin_y, origin_x]) = (info.voxel, info.origin);
        if x > 0.0 {
            self.add("unit", "nm");
        }
        if z > 0.0 {
            self.add("spacing", z);
        }
        let origins = [
            ("xorigin", x, origin_x),
            ("yorigin", y, origin_y),
            ("zorigin", z, origin_z),
        ];
        // In pixels, where the world's zero lies.
        for (name, size, origin) in origins {
            if size > 0.0 && origin != 0.0 {
                self.add(name, -origin / size);
            }
        }
    }
}

/// One line of ASCII, as `Properties` reads it back.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for unit in text.encode_utf16() {
        match char::from_u32(unit.into()) {
            Some('\n') => out.push_str("\\n"),
            Some('\\') => out.push_str("\\\\"),
            Some(c @ ' '..='~') => out.push(c),
            _ => {
                let _ = write!(out, "\\u{unit:04x}");
            }
        }
    }
    out
}

/// Pixels per nm as a fraction of two u32, from the size of a pixel in nm: the continued fraction
/// as far as it fits, exact for sizes of up to nine digits. None where there is no size.
pub(crate) fn resolution(size: f64) -> Option<(u32, u32)> {
    if !(size.is_finite() && size > 0.0) {
        return None;
    }
    // Convergents of size = denominator / numerator of the resolution.
    let (mut p, mut q, mut last_p, mut last_q) = (1.0_f64, 0.0_f64, 0.0_f64, 1.0_f64);
    let mut rest = size;
    let mut best = None;
    for _ in 0..40 {
        let whole = rest.floor();
        (p, last_p) = (whole * p + last_p, p);
        (q, last_q) = (whole * q + last_q, q);
        let fits = p <= f64::from(u32::MAX) && q <= f64::from(u32::MAX);
        if !fits {
            break;
        }
        if p >= 1.0 && q >= 1.0 {
            best = Some((q as u32, p as u32));
        }
        if (p / q - size).abs() <= 1e-15 * size || rest == whole {
            break;
        }
        rest = 1.0 / (rest - whole);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resolutions_are_exact_for_decimal_sizes() {
        for (size, fraction) in [
            (5.0, (1, 5)),
            (10.35, (20, 207)),
            (0.1, (10, 1)),
            (130.0, (1, 130)),
            (1e9, (1, 1_000_000_000)),
            (1e-6, (1_000_000, 1)),
        ] {
            assert_eq!(resolution(size), Some(fraction), "{size}");
        }
        for size in [std::f64::consts::PI, 1.0 / 3.0, 97.123_456_789, 5e-4] {
            let (n, d) = resolution(size).unwrap();
            assert!(
                (f64::from(d) / f64::from(n) / size - 1.0).abs() < 1e-14,
                "{size} {n} {d}"
            );
        }
        for size in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e20, 1e-20] {
            assert_eq!(resolution(size), None, "{size}");
        }
    }

    #[test]
    fn the_text_of_a_hyperstack() {
        let info = ImageInfo {
            size: [4, 2, 3, 10, 20],
            voxel: [50.0, 10.0, 10.0],
            origin: [-100.0, 0.0, 25.0],
            frame_time: 0.02,
            channels: vec!["µ".into(), "b".into()],
            labels: false,
        };
        let description = Description {
            display: [0.0, 12.5],
            linear: Some([-1.0, 0.5]),
            unit: "nm",
            comment: Some("a\nb"),
        };
        let text = description.text(&info);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "ImageJ=1.11a");
        for line in [
            "images=24",
            "channels=2",
            "slices=3",
            "frames=4",
            "hyperstack=true",
            "mode=composite",
            "unit=nm",
            "spacing=50",
            "xorigin=-2.5",
            "zorigin=2",
            "finterval=0.02",
            "c0=-1",
            "c1=0.5",
            "vunit=nm",
            "max=12.5",
            "channel1=\\u00b5",
            "comment=a\\nb",
        ] {
            assert!(lines.contains(&line), "{line} in {text}");
        }
        assert!(text.is_ascii() && !text.contains("yorigin"));
    }
}
