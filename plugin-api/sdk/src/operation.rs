//! Operations, readers and writers.

use crate::{Failure, Info, Job, Params, Plan};
use puncta_documents::manifest::Operation as Document;
use puncta_documents::{Output, OutputForm, Read, Request};

/// An operation, a reader or a writer: a struct of parameters that can be run.
pub trait Operation: Params + Send + 'static {
    /// Id with revision. The meaning of a parameter never changes under one id.
    const ID: &'static str;

    /// Title, description, ports, example.
    fn info() -> Info;

    /// Checks the request and plans the call, without heavy work. Unless it is written anew, the
    /// plan reads the columns that the inputs' ports name.
    ///
    /// # Errors
    /// What is wrong with a parameter, an input or a file.
    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(default_plan::<Self>(request))
    }

    /// Does it.
    ///
    /// # Errors
    /// What went wrong.
    fn run(&self, job: &Job) -> Result<(), Failure>;
}

/// The plan that reads the columns which the inputs' ports name.
#[must_use]
pub fn default_plan<O: Operation>(request: &Request) -> Plan {
    let document = Info::document::<O>();
    let mut plan = Plan {
        interruptible: true,
        ..Plan::default()
    };
    for (place, input) in request.inputs.iter().enumerate() {
        let Some(port) = document.inputs.iter().find(|port| port.name == input.port) else {
            continue;
        };
        let mut columns: Vec<String> = Vec::new();
        for need in &port.columns {
            let name = match need.name.strip_prefix('$') {
                Some(parameter) => request.parameters.get(parameter).and_then(|v| v.as_str()),
                None => Some(need.name.as_str()),
            };
            if let Some(name) = name
                && !columns.iter().any(|known| known == name)
            {
                columns.push(name.into());
            }
        }
        if !columns.is_empty() {
            plan.read.push(Read {
                input: place,
                part: 0,
                columns,
            });
        }
    }
    plan.outputs = document
        .outputs
        .iter()
        .filter_map(|port| selection(port, request))
        .collect();
    plan
}

fn selection(port: &puncta_documents::Port, request: &Request) -> Option<Output> {
    if port.form != OutputForm::Selection {
        return None;
    }
    let of = request
        .inputs
        .iter()
        .position(|input| Some(&input.port) == port.of.as_ref())?;
    let header = crate::output::selection_header(&port.name, request.inputs[of].header.rows());
    Some(Output {
        output: port.name.clone(),
        form: OutputForm::Selection,
        of: Some(of),
        header,
    })
}

/// An operation as the plugin's list of operations holds it.
pub struct Registration {
    pub(crate) id: &'static str,
    pub(crate) document: fn() -> Document,
    pub(crate) prepare: fn(&Request) -> Result<Ready, Failure>,
}

/// A prepared call.
pub trait Prepared: Send + Sync {
    /// Does it.
    ///
    /// # Errors
    /// What went wrong.
    fn run(&self, job: &Job) -> Result<(), Failure>;
}

/// A plan, and the call that it is for.
pub type Ready = (Plan, Box<dyn Prepared>);

struct Bound<O>(O);

impl<O: Operation + Sync> Prepared for Bound<O> {
    fn run(&self, job: &Job) -> Result<(), Failure> {
        self.0.run(job)
    }
}

impl Registration {
    /// The registration of an operation.
    #[must_use]
    pub const fn of<O: Operation + Sync>() -> Registration {
        Registration {
            id: O::ID,
            document: Info::document::<O>,
            prepare: prepare::<O>,
        }
    }

    /// The operation's part of the manifest.
    #[must_use]
    pub fn document(&self) -> Document {
        (self.document)()
    }

    /// Prepares a call.
    ///
    /// # Errors
    /// What is wrong with a parameter, an input or a file.
    pub fn prepare(&self, request: &Request) -> Result<Ready, Failure> {
        (self.prepare)(request)
    }

    /// The id.
    #[must_use]
    pub fn id(&self) -> &'static str {
        self.id
    }
}

fn prepare<O: Operation + Sync>(request: &Request) -> Result<Ready, Failure> {
    let operation = O::from_values(&request.parameters)?;
    let plan = operation.prepare(request)?;
    Ok((plan, Box::new(Bound(operation))))
}

inventory::collect!(Registration);

/// All operations of this plugin, sorted by id: the linker's order is arbitrary.
#[must_use]
pub fn registrations() -> Vec<&'static Registration> {
    let mut all: Vec<_> = inventory::iter::<Registration>.into_iter().collect();
    all.sort_by_key(|one| one.id);
    all
}
