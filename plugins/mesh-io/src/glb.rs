//! glTF 2.0, binary (glb): for viewers.

use crate::sheet::{Sheet, Values};
use crate::unit::in_nm;
use puncta_sdk::Run;
use puncta_sdk::serde_json::{Value, json};
use std::io::{self, Write};

/// A part of the binary chunk, with what its accessor says.
struct Part {
    bytes: Vec<u8>,
    target: u32,
    accessor: Value,
    stride: Option<u32>,
}

/// Writes triangles with their columns: `red`, `green`, `blue` (u8) become the colour, all other
/// columns attributes `_NAME` of f32. Positions are stored relative to the middle of the box, and a
/// node scales them to metres, which glTF asks for.
///
/// # Errors
/// What the disk says, or more than the 4 GiB that a glb holds.
pub fn write(out: &mut dyn Write, sheet: &Sheet, unit: &str, run: &dyn Run) -> io::Result<()> {
    let (parts, attributes, middle) = parts(sheet, run)?;
    let mut binary = Vec::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    for (i, part) in parts.into_iter().enumerate() {
        let mut view = json!({
            "buffer": 0,
            "byteOffset": binary.len(),
            "byteLength": part.bytes.len(),
            "target": part.target,
        });
        if let Some(stride) = part.stride {
            view["byteStride"] = stride.into();
        }
        views.push(view);
        let mut accessor = part.accessor;
        accessor["bufferView"] = i.into();
        accessors.push(accessor);
        binary.extend(part.bytes);
        binary.resize(binary.len().next_multiple_of(4), 0);
    }
    let scale = in_nm(unit).map_or(1.0, |nm| nm * 1e-9);
    let mut json = json!({
        "asset": { "version": "2.0", "generator": "Puncta" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{
            "mesh": 0,
            "scale": [scale, scale, scale],
            "translation": middle.map(|x| x * scale),
            "extras": { "unit": unit },
        }],
    });
    if !sheet.triangles.is_empty() {
        let indices = accessors.len() - 1;
        json["meshes"] =
            json!([{ "primitives": [{ "attributes": attributes, "indices": indices }] }]);
        json["accessors"] = accessors.into();
        json["bufferViews"] = views.into();
        json["buffers"] = json!([{ "byteLength": binary.len() }]);
    } else if let Some(node) = json["nodes"][0].as_object_mut() {
        node.remove("mesh");
        binary.clear();
    }
    chunks(out, json.to_string().into_bytes(), &binary)
}

fn chunks(out: &mut dyn Write, mut text: Vec<u8>, binary: &[u8]) -> io::Result<()> {
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = if binary.is_empty() {
        0
    } else {
        8 + binary.len()
    };
    let length = u32::try_from(20 + text.len() + rest);
    let length = length.map_err(|_| io::Error::other("a glb file holds at most 4 GiB"))?;
    out.write_all(b"glTF")?;
    for number in [2, length, text.len() as u32] {
        out.write_all(&number.to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(&text)?;
    if !binary.is_empty() {
        out.write_all(&(binary.len() as u32).to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        out.write_all(binary)?;
    }
    Ok(())
}

const ARRAY: u32 = 34962;
const ELEMENTS: u32 = 34963;
const FLOAT: u32 = 5126;

fn floats(values: impl Iterator<Item = f64>) -> Vec<u8> {
    values
        .flat_map(|value| (value as f32).to_le_bytes())
        .collect()
}

fn parts(sheet: &Sheet, run: &dyn Run) -> io::Result<(Vec<Part>, Value, [f64; 3])> {
    let count = sheet.positions.len();
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for place in &sheet.positions {
        for axis in 0..3 {
            low[axis] = low[axis].min(place[axis]);
            high[axis] = high[axis].max(place[axis]);
        }
    }
    let middle = [0, 1, 2].map(|i: usize| f64::midpoint(low[i], high[i]));
    let middle = middle.map(|x| if x.is_finite() { x } else { 0.0 });
    let near =
        |place: &[f64; 3]| [0, 1, 2].map(|i: usize| f64::from((place[i] - middle[i]) as f32));
    let mut parts = vec![Part {
        bytes: floats(sheet.positions.iter().flat_map(near)),
        target: ARRAY,
        accessor: json!({
            "componentType": FLOAT, "count": count, "type": "VEC3",
            "min": near(&low), "max": near(&high),
        }),
        stride: None,
    }];
    let mut attributes = json!({ "POSITION": 0 });
    if let Some(colours) = colours(sheet) {
        attributes["COLOR_0"] = parts.len().into();
        parts.push(colours);
    }
    for column in &sheet.columns {
        crate::writer::poll(run, 0)?;
        let name = format!("_{}", column.name.to_uppercase());
        attributes[name] = parts.len().into();
        parts.push(Part {
            bytes: floats((0..count).map(|i| column.values.get(i))),
            target: ARRAY,
            accessor: json!({ "componentType": FLOAT, "count": count, "type": "SCALAR" }),
            stride: None,
        });
    }
    let corners = sheet.triangles.as_flattened();
    parts.push(Part {
        bytes: corners
            .iter()
            .flat_map(|corner| corner.to_le_bytes())
            .collect(),
        target: ELEMENTS,
        accessor: json!({ "componentType": 5125, "count": corners.len(), "type": "SCALAR" }),
        stride: None,
    });
    Ok((parts, attributes, middle))
}

fn colours(sheet: &Sheet) -> Option<Part> {
    let channel = |name: &str| {
        let column = sheet.columns.iter().find(|column| column.name == name)?;
        match &column.values {
            Values::U8(values) => Some(values),
            _ => None,
        }
    };
    let (red, green, blue) = (channel("red")?, channel("green")?, channel("blue")?);
    let pixels = red.iter().zip(green).zip(blue);
    Some(Part {
        bytes: pixels.flat_map(|((&r, &g), &b)| [r, g, b, 255]).collect(),
        target: ARRAY,
        accessor: json!({
            "componentType": 5121, "normalized": true, "count": red.len(), "type": "VEC4",
        }),
        stride: Some(4),
    })
}
