//! Inputs against an operation's ports: kinds, columns, units.

use crate::recipe::check_units;
use crate::store::Object;
use puncta_documents::{Failure, Map, Operation, Port};

/// A column that was converted to the unit that an operation needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Converted {
    /// Input port.
    pub port: String,
    /// Column.
    pub column: String,
    /// Unit that it had.
    pub from: String,
    /// Unit that it has now.
    pub to: String,
    /// What its values were multiplied with.
    pub factor: f64,
}

/// Objects by port, in the order of the ports, and what was converted for them.
pub type Bound = (Vec<(String, Object)>, Vec<Converted>);

/// Checks the inputs of a call, puts them into the order of the ports, and converts columns to the
/// units that the ports need.
///
/// # Errors
/// When a port is unknown, empty or bound wrongly, a column is missing, or its unit does not convert.
pub fn inputs(
    operation: &Operation,
    parameters: &Map,
    given: &[(String, Object)],
    pool: &rayon::ThreadPool,
) -> Result<Bound, Failure> {
    let mut bound = Vec::new();
    let mut converted = Vec::new();
    for (name, _) in given {
        if !operation.inputs.iter().any(|port| &port.name == name) {
            let names: Vec<&str> = operation
                .inputs
                .iter()
                .map(|port| port.name.as_str())
                .collect();
            let remedy = match names.as_slice() {
                [] => "it takes none".to_owned(),
                names => format!("its inputs are {}", names.join(", ")),
            };
            let message = format!("{} has no input {name}", operation.id);
            return Err(Failure::bad_input(message).remedy(remedy));
        }
    }
    for port in &operation.inputs {
        let mut count = 0;
        for (name, object) in given.iter().filter(|(name, _)| name == &port.name) {
            count += 1;
            let object = fit(operation, port, parameters, object, (&mut converted, pool))?;
            bound.push((name.clone(), object));
        }
        let wrong = match count {
            0 if !port.optional => Some("needs"),
            0 | 1 => None,
            _ if port.many => None,
            _ => Some("takes only one"),
        };
        if let Some(what) = wrong {
            let message = format!("{} {what} {} as {}", operation.id, port.kind, port.name);
            return Err(Failure::bad_input(message));
        }
    }
    Ok((bound, converted))
}

fn fit(
    operation: &Operation,
    port: &Port,
    parameters: &Map,
    object: &Object,
    (converted, pool): (&mut Vec<Converted>, &rayon::ThreadPool),
) -> Result<Object, Failure> {
    let header = object.header();
    if header.kind != port.kind {
        let message = format!(
            "{} takes {} {} as {}, not {} {}",
            operation.id,
            article(port.kind),
            port.kind,
            port.name,
            article(header.kind),
            header.kind
        );
        return Err(Failure::bad_input(message));
    }
    let conversions =
        check_units(port, parameters, header).map_err(|failure| failure.context(&operation.id))?;
    let mut object = object.clone();
    for one in conversions {
        object = pool.install(|| object.converted(&one.column, one.factor, &one.to))?;
        converted.push(Converted {
            port: port.name.clone(),
            column: one.column,
            from: one.from,
            to: one.to,
            factor: one.factor,
        });
    }
    Ok(object)
}

fn article(kind: puncta_documents::Kind) -> &'static str {
    if kind == puncta_documents::Kind::Image {
        "an"
    } else {
        "a"
    }
}
