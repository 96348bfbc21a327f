//! The localisations of each channel of an image, from one or more tables.

use crate::parameters::{ChannelRule, Channels};
use puncta_sdk::documents::{Header, Read, units};
use puncta_sdk::job::Job;
use puncta_sdk::prelude::*;
use std::borrow::Cow;

/// Prefix of columns with the probability of a channel.
const PREFIX: &str = "p_";
/// Most channels of an image.
const MOST: usize = 64;

/// The localisations of a channel: the wanted columns in their order.
pub(crate) struct Channel<'a> {
    pub(crate) name: String,
    pub(crate) columns: Vec<Cow<'a, [f64]>>,
}

/// A column that is wanted.
pub(crate) struct Want {
    pub(crate) name: String,
    /// Parameter that named it.
    pub(crate) parameter: Option<&'static str>,
    /// Unit to which it is brought; None: as it is.
    pub(crate) unit: Option<&'static str>,
}

impl Want {
    /// A position.
    pub(crate) fn position(name: &str) -> Want {
        Want {
            name: name.into(),
            parameter: None,
            unit: Some("nm"),
        }
    }

    /// A column that a parameter names.
    pub(crate) fn named(name: &str, parameter: &'static str, unit: Option<&'static str>) -> Want {
        Want {
            name: name.into(),
            parameter: Some(parameter),
            unit,
        }
    }

    /// Factor that brings the column of a table to the wanted unit.
    fn factor(&self, header: &Header) -> Result<f64, Failure> {
        let blame = |failure: Failure| match self.parameter {
            Some(parameter) => failure.parameter(parameter),
            None => failure,
        };
        let info = header.column(&self.name).ok_or_else(|| {
            let message = format!("there is no column {} in {}", self.name, header.name);
            let remedy = match self.parameter {
                Some("sigma_x" | "sigma_y" | "sigma_z") => {
                    "name a column in it, or give one width for all in sigma"
                }
                Some(_) => "name another, or leave it out",
                None => "choose a table that has it",
            };
            blame(Failure::bad_input(message)).remedy(remedy)
        })?;
        let Some(unit) = self.unit else {
            return Ok(1.0);
        };
        units::conversion(&info.unit, unit).map_err(|why| {
            let kind = if self.parameter.is_some_and(|p| p.starts_with("sigma")) {
                "width"
            } else {
                "length"
            };
            blame(Failure::bad_input(format!(
                "column {} cannot be a {kind}: {why}",
                self.name
            )))
        })
    }
}

/// The columns that a call reads of each input: what it wants, and the probabilities.
///
/// # Errors
/// When a table lacks one, or it has no fitting unit; when there are no channels, or too many.
pub(crate) fn reads(
    request: &Request,
    channels: &Channels,
    wants: impl Fn(&Header) -> Result<Vec<Want>, Failure>,
) -> Result<Vec<Read>, Failure> {
    let mut out = Vec::new();
    for (input, bound) in request.inputs.iter().enumerate() {
        let mut columns: Vec<String> = Vec::new();
        let probabilities = match channels.channels {
            ChannelRule::Inputs => Vec::new(),
            ChannelRule::Probability => probabilities(&bound.header),
        };
        for want in wants(&bound.header)? {
            want.factor(&bound.header)?;
            if !columns.contains(&want.name) {
                columns.push(want.name);
            }
        }
        for name in probabilities {
            if !columns.contains(&name) {
                columns.push(name);
            }
        }
        out.push(Read {
            input,
            part: 0,
            columns,
        });
    }
    let headers: Vec<&Header> = request.inputs.iter().map(|input| &input.header).collect();
    let count = names(channels, &headers).len();
    if count == 0 && !headers.is_empty() {
        let message = "no table has a column p_<channel>";
        return Err(Failure::bad_input(message)
            .parameter("channels")
            .remedy("make one channel per input"));
    }
    if count > MOST {
        let message = format!("the image would have {count} channels, more than {MOST}");
        return Err(Failure::bad_input(message).remedy("render fewer at a time"));
    }
    Ok(out)
}

/// Number of channels of a call.
pub(crate) fn count(request: &Request, channels: &Channels) -> usize {
    let headers: Vec<&Header> = request.inputs.iter().map(|input| &input.header).collect();
    names(channels, &headers).len().max(1)
}

fn probabilities(header: &Header) -> Vec<String> {
    let columns = header.parts.first().map_or(&[][..], |part| &part.columns);
    let named = columns
        .iter()
        .filter(|column| column.name.len() > PREFIX.len());
    named
        .filter(|c| c.name.starts_with(PREFIX))
        .map(|c| c.name.clone())
        .collect()
}

/// Names of the channels: those of the tables, told apart by numbers, or what follows `p_`.
fn names(channels: &Channels, headers: &[&Header]) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for header in headers {
        match channels.channels {
            ChannelRule::Inputs => {
                let base = if header.name.is_empty() {
                    "channel"
                } else {
                    &header.name
                };
                let mut name = base.to_owned();
                let mut number = 2;
                while out.contains(&name) {
                    name = format!("{base} {number}");
                    number += 1;
                }
                out.push(name);
            }
            ChannelRule::Probability => {
                for name in probabilities(header) {
                    let name = name[PREFIX.len()..].to_owned();
                    if !out.contains(&name) {
                        out.push(name);
                    }
                }
            }
        }
    }
    out
}

/// The localisations of each channel.
///
/// # Errors
/// When a column holds texts; when cancelled.
pub(crate) fn load<'a>(
    job: &'a Job,
    channels: &Channels,
    wants: impl Fn(&Header) -> Result<Vec<Want>, Failure>,
) -> Result<Vec<Channel<'a>>, Failure> {
    let inputs: Vec<_> = job.inputs("table").collect();
    let headers: Vec<&Header> = inputs.iter().map(|input| input.header()).collect();
    let names = names(channels, &headers);
    let mut tables = Vec::with_capacity(inputs.len());
    for input in &inputs {
        let mut columns = Vec::new();
        for want in wants(input.header())? {
            let factor = want.factor(input.header())?;
            let mut values = input.f64(&want.name)?;
            if factor != 1.0 {
                values.to_mut().iter_mut().for_each(|v| *v *= factor);
            }
            columns.push(values);
        }
        tables.push(columns);
    }
    if channels.channels == ChannelRule::Inputs {
        let pairs = names.into_iter().zip(tables);
        return Ok(pairs
            .map(|(name, columns)| Channel { name, columns })
            .collect());
    }
    let mut out: Vec<Channel<'a>> = Vec::new();
    for name in names {
        let mut all: Vec<Vec<f64>> = Vec::new();
        for (input, columns) in inputs.iter().zip(&tables) {
            all.resize(columns.len(), Vec::new());
            job.progress(0.0, "choosing localisations of the channels")?;
            let own = format!("{PREFIX}{name}");
            let others = probabilities(input.header());
            if !others.contains(&own) {
                continue;
            }
            let mut keep: Vec<bool> = input
                .f64(&own)?
                .iter()
                .map(|p| *p >= channels.p_dye)
                .collect();
            for other in others.iter().filter(|other| **other != own) {
                let values = input.f64(other)?;
                keep.iter_mut()
                    .zip(&*values)
                    .for_each(|(k, p)| *k &= *p < channels.p_other);
            }
            for (all, column) in all.iter_mut().zip(columns) {
                all.extend(
                    column
                        .iter()
                        .zip(&keep)
                        .filter(|(_, keep)| **keep)
                        .map(|(v, _)| *v),
                );
            }
        }
        let columns = all.into_iter().map(Cow::Owned).collect();
        out.push(Channel { name, columns });
    }
    Ok(out)
}
