//! Figures and reports: results that are documents.

use crate::{Map, number};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Format of [`Figure`].
pub const FIGURE: &str = "puncta.figure/1";
/// Format of [`Report`].
pub const REPORT: &str = "puncta.report/1";
/// Numbers that a figure may hold itself; larger series name columns of a table.
pub const MAX_INLINE: usize = 4096;

/// One curve, histogram or set of points of a figure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// Label in the legend.
    pub label: String,
    /// `line`, `points`, `bars` or `band`.
    pub style: String,
    /// Output port of the same step whose table holds the numbers; inline if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<String>,
    /// Column name, or numbers.
    pub x: Value,
    /// Column name, or numbers.
    pub y: Value,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// A plot as a document. Format `puncta.figure/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// Output port.
    pub output: String,
    /// Title.
    pub title: String,
    /// Label and unit of the horizontal axis.
    pub x: [String; 2],
    /// Label and unit of the vertical axis.
    pub y: [String; 2],
    /// Curves.
    pub series: Vec<Series>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl Figure {
    /// Checks the size of what the figure holds inline.
    ///
    /// # Errors
    /// A sentence for the plugin's author.
    pub fn check(&self) -> Result<(), String> {
        let count = |value: &Value| value.as_array().map_or(0, Vec::len);
        let inline: usize = self
            .series
            .iter()
            .map(|one| count(&one.x) + count(&one.y))
            .sum();
        if inline > MAX_INLINE {
            return Err(format!(
                "figure \"{}\" holds {inline} numbers itself, more than {MAX_INLINE}; put them \
                 into a table and name its columns",
                self.title
            ));
        }
        Ok(())
    }
}

/// A named value of a report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReportValue {
    /// Name.
    pub name: String,
    /// A number, or a text.
    pub value: Value,
    /// Unit.
    pub unit: String,
    /// Lower and upper end of its interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<[Value; 2]>,
    /// One line: what it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
}

/// Named values. Format `puncta.report/1`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Output port.
    pub output: String,
    /// Values in order.
    pub values: Vec<ReportValue>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl Report {
    /// An empty report for an output port.
    pub fn new(output: impl Into<String>) -> Report {
        Report {
            output: output.into(),
            ..Report::default()
        }
    }

    /// Adds a number with its unit.
    pub fn number(&mut self, name: &str, value: f64, unit: &str) -> &mut ReportValue {
        self.values.push(ReportValue {
            name: name.into(),
            value: number::to_value(value),
            unit: unit.into(),
            interval: None,
            description: None,
        });
        let last = self.values.len() - 1;
        &mut self.values[last]
    }
}
