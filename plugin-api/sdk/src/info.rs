//! What an operation is, as its author writes it down.

use crate::{Operation, OutputForm};
use puncta_documents::manifest::Step;
use puncta_documents::{ColumnNeed, Example, FileRule, Kind, Map, OperationKind, Port};
use serde_json::Value;

/// What an operation is: title, description, ports, files, example.
#[derive(Clone, Debug)]
pub struct Info {
    pub(crate) operation: puncta_documents::Operation,
}

impl Info {
    fn new(kind: OperationKind, title: &str) -> Info {
        Info {
            operation: puncta_documents::Operation {
                id: String::new(),
                kind,
                title: title.into(),
                description: String::new(),
                inputs: Vec::new(),
                outputs: Vec::new(),
                parameters: Vec::new(),
                file: None,
                example: None,
                citations: Vec::new(),
                tolerance: puncta_documents::TOLERANCE,
                rest: Map::new(),
            },
        }
    }

    /// An operation from inputs to outputs.
    #[must_use]
    pub fn operation(title: &str) -> Info {
        Info::new(OperationKind::Operation, title)
    }

    /// A reader of files with these lower-case suffixes (with the dot).
    #[must_use]
    pub fn reader(title: &str, suffixes: &[&str]) -> Info {
        Info::new(OperationKind::Reader, title).suffixes(suffixes)
    }

    /// A writer of files with these lower-case suffixes (with the dot).
    #[must_use]
    pub fn writer(title: &str, suffixes: &[&str]) -> Info {
        Info::new(OperationKind::Writer, title).suffixes(suffixes)
    }

    fn suffixes(mut self, suffixes: &[&str]) -> Info {
        let suffixes = suffixes.iter().map(|&suffix| suffix.into()).collect();
        self.operation.file = Some(FileRule {
            suffixes,
            ..FileRule::default()
        });
        self
    }

    /// One sentence, then more.
    #[must_use]
    pub fn description(mut self, text: &str) -> Info {
        self.operation.description = text.into();
        self
    }

    /// Adds an input.
    #[must_use]
    pub fn input(mut self, port: Ports) -> Info {
        self.operation.inputs.push(port.0);
        self
    }

    /// Adds an output.
    #[must_use]
    pub fn output(mut self, port: Ports) -> Info {
        self.operation.outputs.push(port.0);
        self
    }

    /// Readers: what the first bytes are (several alternatives), and names of the formats.
    #[must_use]
    pub fn formats(mut self, magic: &[&[u8]], names: &[&str]) -> Info {
        let rule = self.operation.file.get_or_insert_default();
        let hex = |bytes: &&[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        rule.magic = magic.iter().map(hex).collect();
        rule.formats = names.iter().map(|&name| name.into()).collect();
        self
    }

    /// Readers: asked only after those that know the format.
    #[must_use]
    pub fn generic(mut self) -> Info {
        self.operation.file.get_or_insert_default().generic = true;
        self
    }

    /// Adds a paper: DOI or full reference.
    #[must_use]
    pub fn cite(mut self, reference: &str) -> Info {
        self.operation.citations.push(reference.into());
        self
    }

    /// How far results may be from those of another build or processor, as a share of the largest
    /// magnitude of a column; 1e-9 if it is not stated.
    #[must_use]
    pub fn tolerance(mut self, share: f64) -> Info {
        self.operation.tolerance = share;
        self
    }

    /// The example: parameters that differ from the defaults.
    #[must_use]
    pub fn example(mut self, parameters: Value) -> Info {
        self.operation.example.get_or_insert_default().parameters = object(parameters);
        self
    }

    /// The example's input on a port: an operation without inputs and its parameters.
    #[must_use]
    pub fn example_input(mut self, port: &str, op: &str, parameters: Value) -> Info {
        let step = Step {
            op: op.into(),
            parameters: object(parameters),
            ..Step::default()
        };
        self.operation
            .example
            .get_or_insert_default()
            .inputs
            .insert(port.into(), step);
        self
    }

    /// The example's input on a port, made by a step with inputs of its own.
    #[must_use]
    pub fn example_step(mut self, port: &str, step: Step) -> Info {
        self.operation
            .example
            .get_or_insert_default()
            .inputs
            .insert(port.into(), step);
        self
    }

    /// Readers: the example's file as text.
    #[must_use]
    pub fn example_text(mut self, name: &str, text: &str) -> Info {
        let example: &mut Example = self.operation.example.get_or_insert_default();
        let file = example.file.get_or_insert_default();
        file.name = name.into();
        file.text = Some(text.into());
        self
    }

    /// Readers: the example's file as bytes.
    #[must_use]
    pub fn example_bytes(mut self, name: &str, bytes: &[u8]) -> Info {
        let example: &mut Example = self.operation.example.get_or_insert_default();
        let file = example.file.get_or_insert_default();
        file.name = name.into();
        file.hex = Some(bytes.iter().map(|byte| format!("{byte:02x}")).collect());
        self
    }

    pub(crate) fn document<O: Operation>() -> puncta_documents::Operation {
        let mut operation = O::info().operation;
        operation.id = O::ID.into();
        operation.parameters = O::schema();
        operation
    }
}

fn object(value: Value) -> Map {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

/// A port, built step by step.
#[derive(Clone, Debug)]
pub struct Ports(Port);

impl Ports {
    fn new(name: &str, kind: Kind) -> Ports {
        Ports(Port {
            name: name.into(),
            kind,
            description: String::new(),
            form: OutputForm::Object,
            of: None,
            columns: Vec::new(),
            optional: false,
            many: false,
        })
    }

    /// A table.
    #[must_use]
    pub fn table(name: &str) -> Ports {
        Ports::new(name, Kind::Table)
    }

    /// An image.
    #[must_use]
    pub fn image(name: &str) -> Ports {
        Ports::new(name, Kind::Image)
    }

    /// A mesh.
    #[must_use]
    pub fn mesh(name: &str) -> Ports {
        Ports::new(name, Kind::Mesh)
    }

    /// A figure.
    #[must_use]
    pub fn figure(name: &str) -> Ports {
        Ports::new(name, Kind::Figure)
    }

    /// A report.
    #[must_use]
    pub fn report(name: &str) -> Ports {
        Ports::new(name, Kind::Report)
    }

    /// An output: the input table `of` with columns added or replaced.
    #[must_use]
    pub fn columns(name: &str, of: &str) -> Ports {
        let mut port = Ports::table(name);
        port.0.form = OutputForm::Columns;
        port.0.of = Some(of.into());
        port
    }

    /// An output: rows of the input table `of`.
    #[must_use]
    pub fn selection(name: &str, of: &str) -> Ports {
        let mut port = Ports::table(name);
        port.0.form = OutputForm::Selection;
        port.0.of = Some(of.into());
        port
    }

    /// Needs a column in a unit. A name with a leading `$` is that of a column parameter.
    #[must_use]
    pub fn column(mut self, name: &str, unit: &str) -> Ports {
        self.0.columns.push(ColumnNeed {
            name: name.into(),
            unit: Some(unit.into()),
        });
        self
    }

    /// Needs a column in whatever unit it has.
    #[must_use]
    pub fn any_column(mut self, name: &str) -> Ports {
        self.0.columns.push(ColumnNeed {
            name: name.into(),
            unit: None,
        });
        self
    }

    /// One line of meaning.
    #[must_use]
    pub fn description(mut self, text: &str) -> Ports {
        self.0.description = text.into();
        self
    }

    /// May be left out.
    #[must_use]
    pub fn optional(mut self) -> Ports {
        self.0.optional = true;
        self
    }

    /// Several objects.
    #[must_use]
    pub fn many(mut self) -> Ports {
        self.0.many = true;
        self
    }
}
