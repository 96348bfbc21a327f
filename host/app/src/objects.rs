//! Objects as JSON and as text: what `info` prints, and operations whose output is not saved.

use crate::output::{count, number, plain, short, table};
use puncta_engine::Object;
use puncta_engine::documents::{
    ColumnInfo, Failure, Header, Kind, Map, number as documents_number,
};
use puncta_engine::summary::{Summary, summary};
use serde_json::{Value, json};

/// Metadata lines that the text shows.
const MOST_METADATA: usize = 16;
/// Characters of a metadata value that the text shows.
const MOST_TEXT: usize = 60;

/// An object with the summaries of its columns.
pub struct Described {
    name: String,
    header: Header,
    summaries: Vec<Vec<Option<Summary>>>,
}

impl Described {
    /// Summarises the columns of an object, on the threads of the current pool.
    pub fn of(name: &str, object: &Object) -> Result<Described, Failure> {
        let mut header = object.header().clone();
        if header.kind == Kind::Figure {
            // The tables that its series name are outputs of their own.
            header.parts.clear();
        }
        let mut summaries = Vec::with_capacity(header.parts.len());
        for part in 0..header.parts.len() {
            let columns = object.columns(part).iter();
            let all: Result<Vec<_>, Failure> =
                columns.map(|one| Ok(summary(one.column()?))).collect();
            summaries.push(all?);
        }
        Ok(Described {
            name: name.to_owned(),
            header,
            summaries,
        })
    }

    fn columns(&self, part: usize) -> impl Iterator<Item = (&ColumnInfo, Option<&Summary>)> {
        let infos = self
            .header
            .parts
            .get(part)
            .map_or(&[][..], |part| &part.columns);
        let summaries = self.summaries.get(part).map_or(&[][..], |all| all);
        infos.iter().zip(summaries.iter().map(Option::as_ref))
    }

    /// The object as JSON.
    pub fn json(&self) -> Value {
        let header = &self.header;
        let columns = |part| self.columns(part).map(column).collect::<Vec<Value>>();
        let mut out = json!({
            "name": self.name,
            "kind": header.kind,
            "rows": header.rows(),
            "columns": columns(0),
            "metadata": header.metadata,
        });
        if header.parts.len() > 1 {
            let part = |(place, part): (usize, &puncta_engine::documents::Part)| json!({"name": part.name, "rows": part.rows, "columns": columns(place)});
            out["parts"] = header.parts.iter().enumerate().map(part).collect();
        }
        if let Some(shape) = &header.shape {
            out["shape"] = shape.as_str().into();
        }
        if let Some(image) = &header.image {
            out["image"] = serde_json::to_value(image).unwrap_or_default();
        }
        if let Some(document) = &header.document {
            out["document"] = document.clone();
        }
        out
    }

    /// The object as text.
    pub fn text(&self) -> String {
        let header = &self.header;
        let mut out = format!("{}: {}", plain(&self.name), header.kind);
        if let Some(shape) = &header.shape {
            out.push_str(&format!(" of {}", plain(shape)));
        }
        match (header.kind, &header.image) {
            (Kind::Image, Some(image)) => out.push_str(&size(image)),
            (Kind::Figure | Kind::Report, _) => {}
            _ => {
                for part in &header.parts {
                    out.push_str(&format!(", {} {}", count(part.rows), plain(&part.name)));
                }
            }
        }
        out.push('\n');
        for part in 0..header.parts.len() {
            out.push_str(&self.part(part));
        }
        if let Some(document) = &header.document {
            out.push_str(&self::document(header.kind, document));
        }
        out.push_str(&metadata(&header.metadata));
        out
    }

    fn part(&self, part: usize) -> String {
        let missing = |found: Option<&Summary>| found.map_or(0, |found| found.missing);
        let any = self.columns(part).any(|(_, found)| missing(found) > 0);
        let mut rows = vec![vec!["column", "type", "unit", "min", "max", "sum"]];
        if any {
            rows[0].push("missing");
        }
        let mut rows: Vec<Vec<String>> = rows
            .into_iter()
            .map(|row| row.into_iter().map(String::from).collect())
            .collect();
        for (info, found) in self.columns(part) {
            let range = found.and_then(|found| found.range);
            let shown = |value: Option<f64>| value.map_or_else(|| "-".into(), number);
            let mut row = vec![
                plain(&info.name),
                info.type_.to_string(),
                plain(&info.unit),
                shown(range.map(|range| range.0)),
                shown(range.map(|range| range.1)),
                shown(found.map(|found| found.sum)),
            ];
            if any {
                row.push(count(missing(found)));
            }
            rows.push(row);
        }
        table(&rows, &[false, false, false, true, true, true, true], 2)
    }
}

fn column((info, found): (&ColumnInfo, Option<&Summary>)) -> Value {
    let range = found.and_then(|found| found.range);
    let value = |value: Option<f64>| value.map_or(Value::Null, documents_number::to_value);
    json!({
        "name": info.name,
        "type": info.type_,
        "unit": info.unit,
        "min": value(range.map(|range| range.0)),
        "max": value(range.map(|range| range.1)),
        "sum": value(found.map(|found| found.sum)),
    })
}

fn size(image: &puncta_engine::documents::ImageInfo) -> String {
    let axes = ["t", "c", "z", "y", "x"];
    let sizes = axes
        .iter()
        .zip(image.size)
        .filter(|(axis, size)| *size != 1 || "xy".contains(**axis));
    let sizes: Vec<String> = sizes
        .rev()
        .map(|(axis, size)| format!("{axis} {size}"))
        .collect();
    let [z, y, x] = image.voxel;
    let depth = if z == 0.0 {
        String::new()
    } else {
        format!(" x {}", number(z))
    };
    format!(
        ", {}; voxel {} x {}{depth} nm",
        sizes.join(", "),
        number(x),
        number(y)
    )
}

/// A report as lines, a figure as the list of its curves.
fn document(kind: Kind, document: &Value) -> String {
    let text = |value: Option<&Value>| match value {
        Some(Value::String(text)) => plain(text),
        Some(Value::Number(found)) => number(found.as_f64().unwrap_or(f64::NAN)),
        Some(other) => short(&other.to_string(), MOST_TEXT).into_owned(),
        None => String::new(),
    };
    let list = |name: &str| {
        document
            .get(name)
            .and_then(Value::as_array)
            .map_or(&[][..], |list| list)
    };
    let rows: Vec<Vec<String>> = match kind {
        Kind::Report => list("values")
            .iter()
            .map(|one| {
                let unit = text(one.get("unit"));
                let unit = if unit == "1" { String::new() } else { unit };
                let interval = match one
                    .get("interval")
                    .and_then(Value::as_array)
                    .map(Vec::as_slice)
                {
                    Some([low, high]) => format!("{} to {}", text(Some(low)), text(Some(high))),
                    _ => String::new(),
                };
                vec![
                    text(one.get("name")),
                    text(one.get("value")),
                    unit,
                    interval,
                ]
            })
            .collect(),
        _ => std::iter::once(vec![text(document.get("title")), String::new()])
            .chain(
                list("series")
                    .iter()
                    .map(|one| vec![text(one.get("label")), text(one.get("style"))]),
            )
            .collect(),
    };
    table(&rows, &[false, kind == Kind::Report], 2)
}

fn metadata(map: &Map) -> String {
    if map.is_empty() {
        return String::new();
    }
    let value = |value: &Value| match value {
        Value::String(text) => plain(&short(text, MOST_TEXT)),
        Value::Array(list) if list.iter().any(|one| one.is_array() || one.is_object()) => {
            format!("{} entries", list.len())
        }
        Value::Object(map) => format!("{} entries", map.len()),
        other => short(&other.to_string(), MOST_TEXT).into_owned(),
    };
    let rows: Vec<Vec<String>> = map
        .iter()
        .take(MOST_METADATA)
        .map(|(name, found)| vec![plain(&short(name, MOST_TEXT)), value(found)])
        .collect();
    let mut out = format!("  metadata\n{}", table(&rows, &[], 4));
    if map.len() > MOST_METADATA {
        out.push_str(&format!(
            "    and {} more (--json shows all)\n",
            map.len() - MOST_METADATA
        ));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_engine::documents::{Element, ImageInfo};

    fn described() -> Described {
        let columns = vec![
            ColumnInfo::new("x", Element::F64, "nm"),
            ColumnInfo::new("na\u{1b}me", Element::Utf8, "1"),
        ];
        let mut header = Header::table("locs", 3, columns);
        header.metadata.insert("camera".into(), json!({"gain": 3}));
        header.metadata.insert("who".into(), "someone".into());
        let found = Summary {
            range: Some((0.5, 2.0)),
            sum: f64::INFINITY,
            missing: 1,
        };
        Described {
            name: "locs".into(),
            header,
            summaries: vec![vec![Some(found), None]],
        }
    }

    #[test]
    fn json_has_the_promised_members() {
        let expected = json!({
            "name": "locs", "kind": "table", "rows": 3,
            "columns": [
                {"name": "x", "type": "f64", "unit": "nm", "min": 0.5, "max": 2, "sum": "inf"},
                {"name": "na\u{1b}me", "type": "utf8", "unit": "1", "min": null, "max": null,
                 "sum": null}
            ],
            "metadata": {"camera": {"gain": 3}, "who": "someone"}
        });
        assert_eq!(described().json(), expected);
    }

    #[test]
    fn text_is_aligned() {
        let expected = "\
locs: table, 3 rows
  column      type  unit  min  max  sum  missing
  x           f64   nm    0.5    2  inf        1
  na\\u{1b}me  utf8  1       -    -    -        0
  metadata
    camera  1 entries
    who     someone
";
        assert_eq!(described().text(), expected);
    }

    #[test]
    fn images_and_reports_say_what_matters() {
        let mut image = ImageInfo::plane(20, 10, 5.0, 0.0, 0.0);
        assert_eq!(size(&image), ", x 20, y 10; voxel 5 x 5 nm");
        image.size[2] = 3;
        image.voxel[0] = 50.0;
        assert_eq!(size(&image), ", x 20, y 10, z 3; voxel 5 x 5 x 50 nm");
        let report = json!({"values": [
            {"name": "resolution", "value": 31.25, "unit": "nm", "interval": [30, 33]},
            {"name": "method", "value": "FRC", "unit": "1"}
        ]});
        assert_eq!(
            document(Kind::Report, &report),
            "  resolution  31.25  nm  30 to 33\n  method        FRC\n"
        );
    }
}
