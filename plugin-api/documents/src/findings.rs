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
    /// Column name, or numbers. Of a band: its lower end.
    pub y: Value,
    /// Bands: the upper end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<Value>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl Series {
    /// Two columns of the table that the same step puts out on the port `table`.
    pub fn columns(label: &str, style: &str, table: &str, x: &str, y: &str) -> Series {
        Series {
            label: label.into(),
            style: style.into(),
            table: Some(table.into()),
            x: x.into(),
            y: y.into(),
            upper: None,
            rest: Map::new(),
        }
    }

    /// Numbers that the figure holds itself, at most [`MAX_INLINE`] in all.
    pub fn numbers(label: &str, style: &str, x: &[f64], y: &[f64]) -> Series {
        let array = |values: &[f64]| {
            values
                .iter()
                .map(|value| number::to_value(*value))
                .collect()
        };
        Series {
            label: label.into(),
            style: style.into(),
            table: None,
            x: array(x),
            y: array(y),
            upper: None,
            rest: Map::new(),
        }
    }

    /// Makes it a band up to the column `upper`.
    #[must_use]
    pub fn up_to(mut self, upper: &str) -> Series {
        self.style = "band".into();
        self.upper = Some(upper.into());
        self
    }
}

/// A plot as a document. Format `puncta.figure/1`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// What was done with which parameters, for the reader of the figure.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub caption: String,
    /// Axes with a logarithmic scale: `x`, `y`, `xy`; linear if empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub logarithmic: String,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl Figure {
    /// A figure without curves for an output port; axes as `[label, unit]`.
    pub fn new(output: &str, title: &str, x: [&str; 2], y: [&str; 2]) -> Figure {
        Figure {
            output: output.into(),
            title: title.into(),
            x: x.map(Into::into),
            y: y.map(Into::into),
            ..Figure::default()
        }
    }

    /// Adds a curve.
    #[must_use]
    pub fn with(mut self, series: Series) -> Figure {
        self.series.push(series);
        self
    }

    /// Checks the size of what the figure holds inline.
    ///
    /// # Errors
    /// A sentence for the plugin's author.
    pub fn check(&self) -> Result<(), String> {
        let count = |value: &Value| value.as_array().map_or(0, Vec::len);
        let all =
            |one: &Series| count(&one.x) + count(&one.y) + one.upper.as_ref().map_or(0, count);
        let inline: usize = self.series.iter().map(all).sum();
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
