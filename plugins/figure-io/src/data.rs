//! What the series of a figure hold, from the document or from the tables of its step.

use puncta_sdk::documents::call::Read;
use puncta_sdk::documents::findings::FIGURE;
use puncta_sdk::documents::{self, Header, number};
use puncta_sdk::input::Input;
use puncta_sdk::serde_json::Value;
use puncta_sdk::{Failure, Figure, Series};
use std::borrow::Cow;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// A line through the points.
    Line,
    /// Discs.
    Points,
    /// Bars from zero, `x` in their middle.
    Bars,
    /// The area between two curves.
    Band,
}

/// The numbers of a series.
#[derive(Clone, Debug)]
pub struct Curve<'a> {
    /// Label in the legend.
    pub label: String,
    /// How it is drawn.
    pub style: Style,
    /// Horizontal positions.
    pub x: Cow<'a, [f64]>,
    /// Vertical positions; of a band, its lower end.
    pub y: Cow<'a, [f64]>,
    /// Of a band, its upper end.
    pub upper: Option<Cow<'a, [f64]>>,
    /// Label of the series whose colour it shares.
    pub of: Option<String>,
}

/// The figure of an input.
///
/// # Errors
/// When its document is none of this version.
pub fn figure(header: &Header) -> Result<Figure, Failure> {
    let document = header.document.as_ref();
    let document = document.ok_or_else(|| Failure::bad_input("the input has no figure"))?;
    documents::parse(&document.to_string(), FIGURE).map_err(|why| {
        let message = format!("the figure {} cannot be understood: {why}", header.name);
        Failure::bad_input(message).remedy("make it again, or update the plugin figure-io")
    })
}

/// The columns that the series of a figure name, each once.
///
/// # Errors
/// When a series names a table or a column that did not come with the figure.
pub fn columns(figure: &Figure, header: &Header) -> Result<Vec<Read>, Failure> {
    let mut reads: Vec<Read> = Vec::new();
    for series in figure.series.iter().filter(|series| series.table.is_some()) {
        let part = part(series, header)?;
        for name in [Some(&series.x), Some(&series.y), series.upper.as_ref()]
            .into_iter()
            .flatten()
        {
            let Some(name) = name.as_str() else {
                continue;
            };
            if name != "row" && header.parts[part].column(name).is_none() {
                let message = format!(
                    "the series \"{}\" of the figure names the column {name}, which the table {} \
                     has not",
                    series.label, header.parts[part].name
                );
                return Err(Failure::bad_input(message).remedy("correct the plugin that made it"));
            }
            let read = match reads.iter().position(|read| read.part == part) {
                Some(place) => &mut reads[place],
                None => {
                    let columns = Vec::new();
                    reads.push(Read {
                        input: 0,
                        part,
                        columns,
                    });
                    let last = reads.len() - 1;
                    &mut reads[last]
                }
            };
            if read.columns.iter().all(|known| known != name) {
                read.columns.push(name.into());
            }
        }
    }
    Ok(reads)
}

fn part(series: &Series, header: &Header) -> Result<usize, Failure> {
    let table = series.table.as_deref().unwrap_or_default();
    let found = header.parts.iter().position(|part| part.name == table);
    found.ok_or_else(|| {
        let message = format!(
            "the series \"{}\" of the figure names the table {table}, which did not come with it",
            series.label
        );
        Failure::bad_input(message).remedy("run the step that gives both again")
    })
}

/// All series with their numbers.
///
/// # Errors
/// When a column is not one of numbers, or a member is neither a name nor numbers.
pub fn curves<'a>(figure: &Figure, input: &Input<'a>) -> Result<Vec<Curve<'a>>, Failure> {
    figure
        .series
        .iter()
        .map(|series| curve(series, input))
        .collect()
}

fn curve<'a>(series: &Series, input: &Input<'a>) -> Result<Curve<'a>, Failure> {
    let style = match series.style.as_str() {
        "line" => Style::Line,
        "points" => Style::Points,
        "bars" => Style::Bars,
        "band" => Style::Band,
        other => {
            let message = format!(
                "the series \"{}\" of the figure has the style \"{other}\", not line, points, bars \
                 or band",
                series.label
            );
            return Err(Failure::bad_input(message).remedy("update the plugin figure-io"));
        }
    };
    let values = |value: &Value| numbers(value, series, input);
    let (x, y) = (values(&series.x)?, values(&series.y)?);
    let upper = series.upper.as_ref().map(values).transpose()?;
    if (style == Style::Band) != upper.is_some() {
        let message = format!(
            "the series \"{}\" of the figure is a band without an upper end, or \
            has one and is no band",
            series.label
        );
        return Err(Failure::bad_input(message).remedy("correct the plugin that made it"));
    }
    let same = x.len() == y.len() && upper.as_ref().is_none_or(|upper| upper.len() == x.len());
    if !same {
        let message = format!(
            "the series \"{}\" of the figure has columns of different lengths",
            series.label
        );
        return Err(Failure::bad_input(message).remedy("correct the plugin that made it"));
    }
    let of = series
        .rest
        .get("of")
        .and_then(Value::as_str)
        .map(String::from);
    Ok(Curve {
        label: series.label.clone(),
        style,
        x,
        y,
        upper,
        of,
    })
}

fn numbers<'a>(
    value: &Value,
    series: &Series,
    input: &Input<'a>,
) -> Result<Cow<'a, [f64]>, Failure> {
    match (value, &series.table) {
        (Value::String(name), Some(_)) => input.f64_of(part(series, input.header())?, name),
        (Value::Array(values), _) => {
            let one = |value: &Value| number::from_value(value).unwrap_or(f64::NAN);
            Ok(values.iter().map(one).collect())
        }
        _ => {
            let message = format!(
                "the series \"{}\" of the figure has neither columns nor numbers",
                series.label
            );
            Err(Failure::bad_input(message).remedy("correct the plugin that made it"))
        }
    }
}
