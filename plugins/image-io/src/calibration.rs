//! What the texts in image files say of the grid: ImageJ's lines, and the attributes of OME-XML.

use puncta_sdk::documents::ImageInfo;

/// What a description says.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Calibration {
    /// Number of planes along t, c, z; 0 where nothing is said.
    pub(crate) planes: [u64; 3],
    /// The axes of the planes, the fastest first, such as `CZT`.
    pub(crate) order: String,
    /// Voxel size along z, y, x in nm; 0 where nothing is said.
    pub(crate) voxel: [f64; 3],
    /// nm of one unit, for sizes that stand in the resolution tags.
    pub(crate) unit: Option<f64>,
    /// Where the world's zero lies along z, y, x in voxels.
    pub(crate) zero: [f64; 3],
    /// Position of the low corner along z, y, x in nm.
    pub(crate) corner: Option<[f64; 3]>,
    /// Seconds between frames.
    pub(crate) frame_time: f64,
    /// Value = first + second x stored number.
    pub(crate) linear: Option<[f64; 2]>,
    /// Unit of the values.
    pub(crate) value_unit: Option<String>,
    pub(crate) channels: Vec<String>,
    /// All planes follow the first one in the file.
    pub(crate) contiguous: bool,
}

/// nm of a unit of length.
fn length(unit: &str) -> Option<f64> {
    Some(match unit.trim() {
        "nm" | "nanometer" | "nanometre" => 1.0,
        "um" | "µm" | "μm" | "\\u00B5m" | "\\u00b5m" | "micron" | "microns" | "micrometer" => 1e3,
        "mm" => 1e6,
        "cm" => 1e7,
        "m" => 1e9,
        "pm" => 1e-3,
        "Å" | "angstrom" => 0.1,
        "inch" => 2.54e7,
        _ => return None,
    })
}

fn seconds(unit: &str) -> f64 {
    match unit.trim() {
        "ms" | "msec" => 1e-3,
        "us" | "µs" => 1e-6,
        "min" => 60.0,
        _ => 1.0,
    }
}

/// Reads ImageJ's lines; `None` for another text.
pub(crate) fn imagej(text: &str) -> Option<Calibration> {
    if !text.starts_with("ImageJ=") {
        return None;
    }
    let line = |name: &str| {
        let mut lines = text.lines();
        lines.find_map(|line| line.strip_prefix(name)?.strip_prefix('='))
    };
    let number = |name: &str| {
        line(name)?
            .trim()
            .parse::<f64>()
            .ok()
            .filter(|v| v.is_finite())
    };
    let count = |name: &str| line(name).and_then(|v| v.trim().parse::<u64>().ok());
    let images = count("images").unwrap_or(1).max(1);
    let (channels, frames) = (count("channels").unwrap_or(1), count("frames").unwrap_or(1));
    let rest = channels
        .checked_mul(frames)
        .filter(|n| *n > 0 && images % n == 0);
    let slices = count("slices").or(rest.map(|n| images / n)).unwrap_or(1);
    let unit = line("unit").and_then(length);
    let nm = unit.unwrap_or(0.0);
    let linear = (line("cf") == Some("0"))
        .then(|| Some([number("c0")?, number("c1")?]))
        .flatten();
    Some(Calibration {
        planes: [frames, channels, slices],
        order: "CZT".to_owned(),
        voxel: [number("spacing").map_or(0.0, |v| v.abs() * nm), 0.0, 0.0],
        unit,
        zero: ["zorigin", "yorigin", "xorigin"].map(|name| number(name).unwrap_or(0.0)),
        corner: None,
        frame_time: number("finterval").unwrap_or(0.0) * seconds(line("tunit").unwrap_or("sec")),
        linear,
        value_unit: line("vunit").filter(|u| *u != "value").map(unescaped),
        channels: (1..=channels.min(64))
            .map_while(|k| line(&format!("channel{k}")).map(unescaped))
            .collect(),
        contiguous: true,
    })
}

/// Undoes the escapes of Java's `Properties`.
fn unescaped(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text.chars();
    while let Some(c) = rest.next() {
        match (c, c == '\\') {
            (_, true) => match rest.next() {
                Some('u') => {
                    let digits: String = rest.by_ref().take(4).collect();
                    let code = u32::from_str_radix(&digits, 16)
                        .ok()
                        .and_then(char::from_u32);
                    out.push(code.unwrap_or(char::REPLACEMENT_CHARACTER));
                }
                Some('n') => out.push('\n'),
                Some(other) => out.push(other),
                None => {}
            },
            (c, _) => out.push(c),
        }
    }
    out
}

/// The tags of an XML text that are called so, with their attributes. Entities other than the five
/// of XML itself, and declarations, mean nothing here.
fn tags<'a>(text: &'a str, name: &str) -> Vec<&'a str> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(at) = rest.find('<') {
        rest = rest.get(at + 1..).unwrap_or("");
        let end = rest.find('>').unwrap_or(rest.len());
        let tag = rest.get(..end).unwrap_or("");
        let own = tag.split([' ', '\n', '\t', '\r', '/']).next().unwrap_or("");
        if own.rsplit(':').next() == Some(name) {
            found.push(tag);
        }
        if found.len() > 4096 {
            break;
        }
    }
    found
}

fn attribute(tag: &str, name: &str) -> Option<String> {
    let mut from = 0;
    loop {
        let at = from + tag.get(from..)?.find(name)?;
        from = at + name.len();
        let before = tag.get(..at)?.chars().last()?;
        let rest = tag.get(from..)?.trim_start().strip_prefix('=');
        let Some(rest) = rest.filter(|_| before.is_whitespace()) else {
            continue;
        };
        let rest = rest.trim_start();
        let quote = rest.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        let value = rest.get(1..)?.split(quote).next()?;
        let plain = value
            .replace("&lt;", "<")
            .replace("&gt;", ">")
            .replace("&quot;", "\"");
        let plain = references(&plain.replace("&apos;", "'"));
        return Some(plain.replace("&amp;", "&"));
    }
}

/// Replaces references to letters by their number.
fn references(text: &str) -> String {
    let mut parts = text.split("&#");
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let letter = part.split_once(';').and_then(|(number, rest)| {
            let number = match number.strip_prefix('x') {
                Some(hex) => u32::from_str_radix(hex, 16).ok()?,
                None => number.parse().ok()?,
            };
            Some((char::from_u32(number)?, rest))
        });
        match letter {
            Some((letter, rest)) => {
                out.push(letter);
                out.push_str(rest);
            }
            None => {
                out.push_str("&#");
                out.push_str(part);
            }
        }
    }
    out
}

/// Reads the first image of OME-XML; `None` for another text.
pub(crate) fn ome(text: &str) -> Option<Calibration> {
    if !text.contains("<OME") && !text.contains(":OME") {
        return None;
    }
    let pixels = *tags(text, "Pixels").first()?;
    let count = |name: &str| attribute(pixels, name).and_then(|v| v.parse::<u64>().ok());
    let number = |tag: &str, name: &str| {
        let value = attribute(tag, name)?.parse::<f64>().ok()?;
        value.is_finite().then_some(value)
    };
    let size = |axis: &str| {
        let unit = attribute(pixels, &format!("PhysicalSize{axis}Unit"));
        let nm = length(unit.as_deref().unwrap_or("µm")).unwrap_or(0.0);
        number(pixels, &format!("PhysicalSize{axis}")).map_or(0.0, |v| v * nm)
    };
    let order = attribute(pixels, "DimensionOrder").unwrap_or_default();
    let mut order: String = order.chars().filter(|c| "CZT".contains(*c)).collect();
    if order.len() != 3 {
        order = "CZT".to_owned();
    }
    let unit = attribute(pixels, "TimeIncrementUnit");
    let first_plane = tags(text, "Plane").first().copied();
    let corner = first_plane.and_then(|plane| {
        let position = |axis: &str| {
            let unit = attribute(plane, &format!("Position{axis}Unit"));
            Some(number(plane, &format!("Position{axis}"))? * length(unit.as_deref()?)?)
        };
        Some([position("Z").unwrap_or(0.0), position("Y")?, position("X")?])
    });
    let channels = tags(text, "Channel");
    Some(Calibration {
        planes: ["SizeT", "SizeC", "SizeZ"].map(|name| count(name).unwrap_or(1)),
        order,
        voxel: ["Z", "Y", "X"].map(size),
        unit: None,
        zero: [0.0; 3],
        corner,
        frame_time: number(pixels, "TimeIncrement").unwrap_or(0.0)
            * seconds(unit.as_deref().unwrap_or("s")),
        linear: None,
        value_unit: None,
        channels: channels
            .iter()
            .filter_map(|tag| attribute(tag, "Name"))
            .collect(),
        contiguous: false,
    })
}

/// Text inside XML.
fn escaped(text: &str) -> String {
    let text = text
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    text.replace('"', "&quot;")
}

/// The attributes for the size of a voxel and the time between frames.
fn sizes(info: &ImageInfo) -> String {
    let mut out = String::new();
    for (axis, size) in ["Z", "Y", "X"].iter().zip(info.voxel) {
        if size > 0.0 {
            out.push_str(&format!(
                " PhysicalSize{axis}=\"{size}\" PhysicalSize{axis}Unit=\"nm\""
            ));
        }
    }
    if info.frame_time > 0.0 {
        let time = info.frame_time;
        out.push_str(&format!(
            " TimeIncrement=\"{time}\" TimeIncrementUnit=\"s\""
        ));
    }
    out
}

/// OME-XML for an image whose planes lie channel fastest, then z, then t.
pub(crate) fn ome_text(
    info: &ImageInfo,
    pixel_type: &str,
    unit: &str,
    comment: Option<&str>,
) -> String {
    let [t, c, z, y, x] = info.size;
    let mut out = "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME \
         xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" Creator=\"Puncta\"><Image \
         ID=\"Image:0\">"
        .to_owned();
    let described = [
        comment.unwrap_or_default(),
        if unit == "1" { "" } else { unit },
    ];
    if let Some(text) = described.iter().find(|text| !text.is_empty()) {
        out.push_str(&format!("<Description>{}</Description>", escaped(text)));
    }
    out.push_str(&format!(
        "<Pixels ID=\"Pixels:0\" DimensionOrder=\"XYCZT\" Type=\"{pixel_type}\" SizeX=\"{x}\" \
         SizeY=\"{y}\" SizeZ=\"{z}\" SizeC=\"{c}\" SizeT=\"{t}\" BigEndian=\"{}\"",
        cfg!(target_endian = "big")
    ));
    out.push_str(&sizes(info));
    out.push('>');
    for channel in 0..c {
        let name = usize::try_from(channel)
            .ok()
            .and_then(|k| info.channels.get(k));
        let name = name.map_or(String::new(), |name| format!(" Name=\"{}\"", escaped(name)));
        out.push_str(&format!(
            "<Channel ID=\"Channel:0:{channel}\" SamplesPerPixel=\"1\"{name}/>"
        ));
    }
    out.push_str("<TiffData/>");
    if info.origin != [0.0; 3] {
        let [z, y, x] = info.origin;
        out.push_str(&format!(
            "<Plane TheZ=\"0\" TheT=\"0\" TheC=\"0\" PositionX=\"{x}\" PositionXUnit=\"nm\" \
             PositionY=\"{y}\" PositionYUnit=\"nm\" PositionZ=\"{z}\" PositionZUnit=\"nm\"/>"
        ));
    }
    out.push_str("</Pixels></Image></OME>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imagej_lines() {
        let text = "ImageJ=1.53\nimages=24\nchannels=2\nslices=3\nframes=4\nunit=\\u00B5m\n\
                    spacing=0.05\nxorigin=-2.5\nfinterval=20\ntunit=ms\ncf=0\nc0=-1\nc1=0.5\n\
                    channel1=\\u00b5a\nchannel2=b\n";
        let found = imagej(text).unwrap();
        assert_eq!(found.planes, [4, 2, 3]);
        assert_eq!(found.unit, Some(1e3));
        assert_eq!(
            (found.voxel[0], found.zero[2], found.frame_time),
            (50.0, -2.5, 0.02)
        );
        assert_eq!(found.linear, Some([-1.0, 0.5]));
        assert_eq!(found.channels, ["µa", "b"]);
        let stack = imagej("ImageJ=1.53\nimages=7\n").unwrap();
        assert_eq!((stack.planes, stack.unit), ([1, 1, 7], None));
        assert_eq!(imagej("images=7\n"), None);
    }

    #[test]
    fn ome_there_and_back() {
        let info = ImageInfo {
            size: [4, 2, 3, 10, 20],
            voxel: [50.0, 10.5, 10.0],
            origin: [-100.0, 0.0, 25.5],
            frame_time: 0.02,
            channels: vec!["a<\"b\"".into(), "c & d".into()],
            labels: false,
        };
        let text = ome_text(&info, "float", "nm", Some("a > b"));
        let found = ome(&text).unwrap();
        assert_eq!((found.planes, found.order.as_str()), ([4, 2, 3], "CZT"));
        assert_eq!((found.voxel, found.corner), (info.voxel, Some(info.origin)));
        assert_eq!((found.frame_time, &found.channels), (0.02, &info.channels));
        for odd in [
            "<OME",
            "<OME><Pixels",
            "<OME><Pixels SizeX=",
            "<OME>&x;<Pixels SizeZ='9'/>",
            "<a>",
        ] {
            let _ = ome(odd);
        }
        assert_eq!(
            ome("<a:OME><a:Pixels SizeZ='9'/>").unwrap().planes,
            [1, 1, 9]
        );
    }
}
