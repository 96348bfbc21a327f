//! Operations for tests: a result is a number that tells everything it was computed from.

use super::flight::lock;
use super::{Call, Catalogue, Checked, Conversion, Inputs, Key, PluginRef, Runner, check, parse};
use crate::job::Progress;
use puncta_documents::{
    ColumnInfo, ColumnNeed, Element, Failure, FailureCode, FileRule, Header, Kind, Operation,
    OperationKind, Parameter, ParameterKind, Port,
};
use serde_json::json;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

#[derive(Clone, Debug, PartialEq)]
pub struct Thing {
    pub header: Arc<Header>,
    pub value: u64,
    pub bytes: u64,
}

impl Thing {
    pub fn table(value: u64, x_unit: &str) -> Thing {
        let mut columns = vec![ColumnInfo::new("x", Element::F64, x_unit)];
        columns.push(ColumnInfo::new("t", Element::F64, "frame"));
        columns.push(ColumnInfo::new("label", Element::Utf8, "1"));
        Thing {
            header: Arc::new(Header::table("locs", 3, columns)),
            value,
            bytes: 100,
        }
    }

    fn of(kind: Kind, value: u64) -> Thing {
        if kind == Kind::Table {
            return Thing::table(value, "nm");
        }
        Thing {
            header: Arc::new(Header::new(kind, "thing")),
            value,
            bytes: 100,
        }
    }
}

/// FNV-1a of what a call sees.
pub fn value(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The number that a call gives as one of its outputs.
pub fn result(op: &str, parameters: &str, inputs: &[(String, u64)], output: &str) -> u64 {
    value(&format!("{op} {parameters} {inputs:?} {output}"))
}

pub struct Mock {
    operations: HashMap<String, Operation>,
    pub library: [u8; 32],
}

fn port(name: &str, kind: Kind) -> Port {
    serde_json::from_value(json!({"name": name, "kind": kind})).unwrap()
}

fn operation(id: &str, inputs: Vec<Port>, outputs: Vec<Port>) -> Operation {
    let mut amount = Parameter::new("amount", ParameterKind::Number);
    amount.default = Some(json!(1));
    amount.unit = Some("nm".into());
    amount.max = Some(1000.0);
    let mut operation: Operation =
        serde_json::from_value(json!({"id": id, "kind": "operation", "title": id})).unwrap();
    operation.parameters.push(amount);
    operation.inputs = inputs;
    operation.outputs = outputs;
    operation
}

fn file(id: &str, kind: OperationKind, of: Kind, suffixes: &[&str]) -> Operation {
    let mut operation = operation(id, Vec::new(), Vec::new());
    operation.kind = kind;
    let suffixes = suffixes.iter().map(ToString::to_string).collect();
    operation.file = Some(FileRule {
        suffixes,
        ..FileRule::default()
    });
    match kind {
        OperationKind::Reader => operation.outputs.push(port("object", of)),
        _ => operation.inputs.push(port("object", of)),
    }
    operation
}

impl Mock {
    pub fn new() -> Mock {
        let list = offers().into_iter().chain(files());
        let operations = list.map(|one| (one.id.clone(), one)).collect();
        Mock {
            operations,
            library: [7; 32],
        }
    }
}

fn files() -> Vec<Operation> {
    use Kind::{Image, Table};
    vec![
        file("mock.csv.read/1", OperationKind::Reader, Table, &[".csv"]),
        file(
            "mock.csv.write/1",
            OperationKind::Writer,
            Table,
            &[".csv", ".txt"],
        ),
        file("mock.tif.write/1", OperationKind::Writer, Image, &[".tif"]),
        file(
            "mock.any.write/1",
            OperationKind::Writer,
            Table,
            &[".tif", ".any"],
        ),
    ]
}

fn offers() -> Vec<Operation> {
    use Kind::{Image, Table};
    let table = || port("table", Table);
    let other = Port {
        optional: true,
        ..port("other", Table)
    };
    let several = Port {
        many: true,
        ..port("tables", Table)
    };
    let need = |name: &str| ColumnNeed {
        name: name.into(),
        unit: Some("nm".into()),
    };
    let measured = Port {
        columns: vec![need("x"), need("$column")],
        ..table()
    };
    let mut range = operation("mock.range/1", vec![table()], vec![table()]);
    range
        .parameters
        .push(Parameter::new("ranges", ParameterKind::Ranges));
    let mut measure = operation("mock.measure/1", vec![measured], vec![table()]);
    let mut column = Parameter::new("column", ParameterKind::Column);
    column.optional = true;
    measure.parameters.push(column);
    let maybe = Port {
        optional: true,
        ..port("maybe", Table)
    };
    vec![
        operation("mock.add/1", vec![table(), other], vec![table()]),
        operation("mock.join/1", vec![several.clone()], vec![table()]),
        operation(
            "mock.split/1",
            vec![table()],
            vec![port("left", Table), port("right", Table)],
        ),
        operation(
            "mock.parts/1",
            vec![table()],
            vec![Port {
                name: "parts".into(),
                ..several
            }],
        ),
        operation("mock.image/1", vec![table()], vec![port("image", Image)]),
        operation("mock.maybe/1", vec![table()], vec![table(), maybe]),
        operation("mock.fail/1", vec![table()], vec![table()]),
        operation("mock.crash/1", vec![table()], vec![table()]),
        operation("mock.lie/1", vec![table()], vec![table()]),
        operation("mock.wait/1", vec![table()], vec![table()]),
        range,
        measure,
    ]
}

impl Catalogue for Mock {
    fn operation(&self, id: &str) -> Option<&Operation> {
        self.operations.get(id)
    }

    fn plugin(&self, id: &str) -> Option<PluginRef> {
        self.operation(id)?;
        Some(PluginRef {
            id: "mock".into(),
            version: "1.2.3".into(),
            library: self.library,
        })
    }

    fn operations(&self) -> Vec<&Operation> {
        self.operations.values().collect()
    }
}

/// Runs the mock operations and remembers which.
#[derive(Default)]
pub struct MockRunner {
    pub calls: Mutex<Vec<String>>,
    pub converted: Mutex<Vec<Conversion>>,
    /// Lets `mock.wait/1` go on.
    pub open: AtomicBool,
    /// Calls of `mock.wait/1` that were stopped.
    pub stopped: Mutex<Vec<String>>,
    /// Whether `mock.fail/1` and `mock.crash/1` work after all.
    pub healed: AtomicBool,
}

impl MockRunner {
    /// The steps called since the last question, sorted.
    pub fn called(&self) -> Vec<String> {
        let mut calls = std::mem::take(&mut *lock(&self.calls));
        calls.sort();
        calls
    }
}

impl Runner for MockRunner {
    type Object = Thing;

    fn header(object: &Thing) -> &Header {
        &object.header
    }

    fn bytes(object: &Thing) -> u64 {
        object.bytes
    }

    fn call(
        &self,
        call: &Call<'_, Thing>,
        job: &dyn Progress,
    ) -> Result<Vec<(String, Thing)>, Failure> {
        lock(&self.calls).push(call.step.to_owned());
        let healed = self.healed.load(Ordering::SeqCst);
        match call.operation.id.as_str() {
            "mock.wait/1" => {
                while !self.open.load(Ordering::SeqCst) {
                    if job.cancelled() {
                        lock(&self.stopped).push(call.step.to_owned());
                        return Err(Failure::cancelled());
                    }
                    job.progress(0.5, "waiting");
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
            "mock.fail/1" if !healed => return Err(Failure::bad_input("the table is empty")),
            "mock.crash/1" if !healed => {
                return Err(Failure::new(FailureCode::Crashed, "the worker ended"));
            }
            "mock.lie/1" => return Ok(vec![("table".into(), Thing::of(Kind::Image, 0))]),
            _ => {}
        }
        let parameters = serde_json::to_string(call.parameters).unwrap();
        let inputs: Vec<(String, u64)> = call
            .inputs
            .iter()
            .map(|(port, thing)| ((*port).to_owned(), thing.value))
            .collect();
        let mut outputs = Vec::new();
        for port in call
            .operation
            .outputs
            .iter()
            .filter(|port| port.name != "maybe")
        {
            let value = result(&call.operation.id, &parameters, &inputs, &port.name);
            for extra in 0..if port.many { 3 } else { 1 } {
                outputs.push((
                    port.name.clone(),
                    Thing::of(port.kind, value.wrapping_add(extra)),
                ));
            }
        }
        Ok(outputs)
    }

    fn convert(
        &self,
        object: &Thing,
        conversions: &[Conversion],
        _: &dyn Progress,
    ) -> Result<Thing, Failure> {
        lock(&self.converted).extend(conversions.iter().cloned());
        let mut header = (*object.header).clone();
        for conversion in conversions {
            for column in &mut header.parts[conversion.part].columns {
                if column.name == conversion.column {
                    column.unit.clone_from(&conversion.to);
                }
            }
        }
        Ok(Thing {
            header: Arc::new(header),
            ..object.clone()
        })
    }
}

pub fn plan(text: &str) -> Checked {
    let recipe = parse(text).unwrap_or_else(|problems| panic!("{problems:?}\n{text}"));
    check(&recipe, &Mock::new())
}

/// A plan without problems.
pub fn good(text: &str) -> Checked {
    let plan = plan(text);
    assert!(plan.problems.is_empty(), "{:?}", plan.problems);
    plan
}

pub fn key(byte: u8) -> Key {
    Key::from_bytes([byte; 32])
}

/// One table as the input `locs`.
pub fn inputs() -> Inputs<Thing> {
    Inputs::from([("locs".to_owned(), vec![(key(1), Thing::table(1, "nm"))])])
}
