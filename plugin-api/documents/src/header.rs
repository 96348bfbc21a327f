//! What an object is: kind, columns with types and units, voxel sizes, metadata.

use crate::{ColumnType, Element, Map};
use serde::{Deserialize, Serialize};
use std::fmt;

/// The five kinds of object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Columns of equal length; a row is usually a localisation.
    Table,
    /// A regular grid, axes t c z y x, x fastest.
    Image,
    /// Triangles: part 0 the vertices, part 1 the triangles.
    Mesh,
    /// A plot as a document whose series name columns.
    Figure,
    /// Named values with units and intervals.
    Report,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Kind::Table => "table",
            Kind::Image => "image",
            Kind::Mesh => "mesh",
            Kind::Figure => "figure",
            Kind::Report => "report",
        })
    }
}

/// A column: name, type, unit and what it stands for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColumnInfo {
    /// Name, unique in its part.
    pub name: String,
    /// Type.
    #[serde(rename = "type")]
    pub type_: ColumnType,
    /// Unit; `1` for pure numbers, `unknown` where the source does not say.
    #[serde(default = "unknown_unit")]
    pub unit: String,
    /// `position`, `error`, `time`, `group`, `probability:<channel>`, `vector`, `label`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub role: Option<String>,
    /// Name in the file that it was read from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// One line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Outputs with text: room for text bytes (all rows, or all dictionary entries).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text_bytes: Option<u64>,
    /// Dictionary: entries there are (finished), or room for entries (planned).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub entries: Option<u64>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

fn unknown_unit() -> String {
    "unknown".into()
}

impl ColumnInfo {
    /// A column of scalars.
    pub fn new(name: impl Into<String>, element: Element, unit: impl Into<String>) -> ColumnInfo {
        ColumnInfo {
            name: name.into(),
            type_: ColumnType::scalar(element),
            unit: unit.into(),
            role: None,
            source: None,
            description: None,
            text_bytes: None,
            entries: None,
            rest: Map::new(),
        }
    }

    /// Sets the role.
    #[must_use]
    pub fn role(mut self, role: impl Into<String>) -> ColumnInfo {
        self.role = Some(role.into());
        self
    }

    /// Sets the name in the source file.
    #[must_use]
    pub fn source(mut self, source: impl Into<String>) -> ColumnInfo {
        self.source = Some(source.into());
        self
    }

    /// Sets the one-line description.
    #[must_use]
    pub fn description(mut self, description: impl Into<String>) -> ColumnInfo {
        self.description = Some(description.into());
        self
    }

    /// Makes each row a list of `width` numbers.
    #[must_use]
    pub fn width(mut self, width: u32) -> ColumnInfo {
        self.type_.width = width;
        self
    }

    /// Sets the room for text bytes.
    #[must_use]
    pub fn text_bytes(mut self, bytes: u64) -> ColumnInfo {
        self.text_bytes = Some(bytes);
        self
    }
}

/// A group of columns of equal length. Tables and images have one, meshes two.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// `rows`, `voxels`, `vertices` or `triangles`.
    pub name: String,
    /// Rows there are; in a plan, the largest number that there may be.
    pub rows: u64,
    /// Columns.
    pub columns: Vec<ColumnInfo>,
}

impl Part {
    /// The column with this name.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&ColumnInfo> {
        self.columns.iter().find(|column| column.name == name)
    }
}

/// Grid of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageInfo {
    /// Number of pixels along t, c, z, y, x.
    pub size: [u64; 5],
    /// Voxel size along z, y, x in nm; 0 where an axis has no size.
    pub voxel: [f64; 3],
    /// World position in nm of the low corner of voxel 0, along z, y, x.
    #[serde(default)]
    pub origin: [f64; 3],
    /// Time between frames in s, 0 if unknown.
    #[serde(default)]
    pub frame_time: f64,
    /// Names of the channels; empty if they have none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<String>,
    /// Whether the integers are labels of regions.
    #[serde(default)]
    pub labels: bool,
}

impl ImageInfo {
    /// A single plane of `width` x `height` square pixels.
    #[must_use]
    pub fn plane(width: u64, height: u64, pixel_size: f64, origin_x: f64, origin_y: f64) -> Self {
        ImageInfo {
            size: [1, 1, 1, height, width],
            voxel: [0.0, pixel_size, pixel_size],
            origin: [0.0, origin_y, origin_x],
            frame_time: 0.0,
            channels: Vec::new(),
            labels: false,
        }
    }

    /// Number of voxels; `None` if it does not fit 64 bits.
    #[must_use]
    pub fn voxels(&self) -> Option<u64> {
        self.size
            .iter()
            .try_fold(1_u64, |product, size| product.checked_mul(*size))
    }
}

/// What an object is. Format `puncta.header/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Kind.
    pub kind: Kind,
    /// Name within its set, such as `localisations`.
    #[serde(default)]
    pub name: String,
    /// Tables: `points` (default), `tracks`, `boxes` or `outline`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<String>,
    /// Groups of columns.
    #[serde(default)]
    pub parts: Vec<Part>,
    /// Grid, for images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<ImageInfo>,
    /// What the source says about the data, as a tree.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub metadata: Map,
    /// Figures and reports: the document itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub document: Option<serde_json::Value>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// Format of [`Header`].
pub const HEADER: &str = "puncta.header/1";
/// Most parts of an object.
pub const MAX_PARTS: usize = 4096;
/// Most columns of an object, all parts together.
pub const MAX_COLUMNS: usize = 16_384;

impl Header {
    /// A header without columns.
    pub fn new(kind: Kind, name: impl Into<String>) -> Header {
        Header {
            kind,
            name: name.into(),
            shape: None,
            parts: Vec::new(),
            image: None,
            metadata: Map::new(),
            document: None,
            rest: Map::new(),
        }
    }

    /// A table with these columns.
    pub fn table(name: impl Into<String>, rows: u64, columns: Vec<ColumnInfo>) -> Header {
        let mut header = Header::new(Kind::Table, name);
        header.parts.push(Part {
            name: "rows".into(),
            rows,
            columns,
        });
        header
    }

    /// An image whose values have this element and unit.
    pub fn image(name: &str, image: ImageInfo, element: Element, unit: &str) -> Header {
        let mut header = Header::new(Kind::Image, name);
        header.parts.push(Part {
            name: "voxels".into(),
            rows: image.voxels().unwrap_or(u64::MAX),
            columns: vec![ColumnInfo::new("value", element, unit)],
        });
        header.image = Some(image);
        header
    }

    /// A mesh: vertices with columns x, y, z (f64, nm) first, triangles with a, b, c (u32).
    pub fn mesh(name: &str, vertices: Vec<ColumnInfo>, rows: u64, triangles: u64) -> Header {
        let mut header = Header::new(Kind::Mesh, name);
        header.parts.push(Part {
            name: "vertices".into(),
            rows,
            columns: vertices,
        });
        let corners = ["a", "b", "c"].map(|corner| ColumnInfo::new(corner, Element::U32, "1"));
        header.parts.push(Part {
            name: "triangles".into(),
            rows: triangles,
            columns: corners.into(),
        });
        header
    }

    /// Checks the number of parts and columns, and that no part has two columns of a name.
    ///
    /// # Errors
    /// A part of a sentence that says what is wrong.
    pub fn check(&self) -> Result<(), String> {
        if self.parts.len() > MAX_PARTS {
            let count = self.parts.len();
            return Err(format!(
                "{count} parts are more than the {MAX_PARTS} that an object may have"
            ));
        }
        let count: usize = self.parts.iter().map(|part| part.columns.len()).sum();
        if count > MAX_COLUMNS {
            return Err(format!(
                "{count} columns are more than the {MAX_COLUMNS} that an object may have"
            ));
        }
        for part in &self.parts {
            let mut names = std::collections::HashSet::new();
            let again = part
                .columns
                .iter()
                .find(|one| !names.insert(one.name.as_str()));
            if let Some(column) = again {
                return Err(format!("two columns are named {}", column.name));
            }
        }
        Ok(())
    }

    /// Rows of the first part.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.parts.first().map_or(0, |part| part.rows)
    }

    /// A column of the first part.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&ColumnInfo> {
        self.parts.first().and_then(|part| part.column(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_columns_has_a_limit() {
        let column = |i: usize| ColumnInfo::new(format!("c{i}"), Element::F32, "1");
        let table = |count: usize| Header::table("t", 1, (0..count).map(column).collect());
        assert!(table(MAX_COLUMNS).check().is_ok());
        let why = table(MAX_COLUMNS + 1).check().unwrap_err();
        assert!(why.contains("16385 columns"), "{why}");
        let mut header = table(2);
        header.parts[0].columns[1].name = "c0".into();
        assert!(
            header
                .check()
                .unwrap_err()
                .contains("two columns are named c0")
        );
        header.parts = vec![header.parts[0].clone(); MAX_PARTS + 1];
        assert!(header.check().unwrap_err().contains("4097 parts"));
    }

    #[test]
    fn unknown_members_are_kept() {
        let text = r#"{"format":"puncta.header/1","kind":"table","name":"a","future":[1],
            "parts":[{"name":"rows","rows":2,"columns":[{"name":"x","type":"f64","unit":"nm","later":1}]}]}"#;
        let header: Header = crate::parse(text, HEADER).unwrap();
        let again = crate::write(&header, HEADER);
        assert!(
            again.contains("\"future\":[1]") && again.contains("\"later\":1"),
            "{again}"
        );
        assert_eq!(again.matches("\"format\"").count(), 1);
    }
}
