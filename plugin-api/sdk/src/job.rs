//! A running call, as its operation sees it.

use crate::host::HostCalls;
use crate::input::{Input, InputPart};
use crate::output::{OutputObject, selection_header};
use crate::raw::RawColumn;
use crate::run::{Cancelled, Run};
use crate::{Failure, Header, Report};
use puncta_documents::call::FileRef;
use puncta_documents::findings::{FIGURE, REPORT};
use puncta_documents::{ColumnInfo, Figure, Output, OutputForm, Plan, Request};
use std::sync::Arc;

/// A running call: inputs, outputs, progress, cancel, threads and messages.
#[derive(Debug)]
pub struct Job {
    host: HostCalls,
    request: Arc<Request>,
    plan: Arc<Plan>,
    inputs: Vec<Vec<InputPart>>,
}

impl Job {
    /// The call that `host` stands for.
    ///
    /// # Errors
    /// When the host does not give the columns that the plan names.
    #[doc(hidden)]
    pub fn new(host: HostCalls, request: Arc<Request>, plan: Arc<Plan>) -> Result<Job, Failure> {
        let mut inputs: Vec<Vec<InputPart>> = request
            .inputs
            .iter()
            .map(|input| {
                let part = |part: &puncta_documents::Part| InputPart {
                    rows: part.rows,
                    ..InputPart::default()
                };
                input.header.parts.iter().map(part).collect()
            })
            .collect();
        for read in &plan.read {
            let columns = host.columns(read.input as u64, read.part, read.columns.len())?;
            let slot = inputs
                .get_mut(read.input)
                .and_then(|parts| parts.get_mut(read.part));
            if let Some(part) = slot {
                part.names.clone_from(&read.columns);
                part.columns = columns.into_iter().map(RawColumn).collect();
            }
        }
        Ok(Job {
            host,
            request,
            plan,
            inputs,
        })
    }

    pub(crate) fn host(&self) -> &HostCalls {
        &self.host
    }

    /// What the host asked for.
    #[must_use]
    pub fn request(&self) -> &Request {
        &self.request
    }

    /// What was planned.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The file to read or to write.
    ///
    /// # Errors
    /// When the call has none.
    pub fn file(&self) -> Result<&FileRef, Failure> {
        self.request
            .file
            .as_ref()
            .ok_or_else(|| Failure::internal("the call has no file"))
    }

    /// The input on a port.
    ///
    /// # Errors
    /// When nothing is bound to it.
    pub fn input(&self, port: &str) -> Result<Input<'_>, Failure> {
        self.inputs(port)
            .next()
            .ok_or_else(|| Failure::bad_input(format!("nothing is bound to the input {port}")))
    }

    /// All inputs on a port.
    pub fn inputs(&self, port: &str) -> impl Iterator<Item = Input<'_>> {
        let named = self.request.inputs.iter().zip(&self.inputs);
        named
            .filter(move |(input, _)| input.port == port)
            .map(|(input, parts)| Input {
                header: &input.header,
                parts,
            })
    }

    /// Begins a new object.
    ///
    /// # Errors
    /// When the host has no room for it, or the header cannot be used.
    pub fn begin(&self, output: &str, header: Header) -> Result<OutputObject<'_>, Failure> {
        let output = Output {
            output: output.into(),
            form: OutputForm::Object,
            of: None,
            header,
        };
        OutputObject::begin(self, output)
    }

    /// Begins columns that are added to the input table of the same name as the output port, or
    /// replace columns of the same name.
    ///
    /// # Errors
    /// When the host has no room, or nothing is bound to the input.
    pub fn add_columns(
        &self,
        port: &str,
        columns: impl Into<Vec<ColumnInfo>>,
    ) -> Result<OutputObject<'_>, Failure> {
        self.add_columns_to(port, port, columns)
    }

    /// As [`Job::add_columns`], with the names of the output and the input port.
    ///
    /// # Errors
    /// When the host has no room, or nothing is bound to the input.
    pub fn add_columns_to(
        &self,
        output: &str,
        input: &str,
        columns: impl Into<Vec<ColumnInfo>>,
    ) -> Result<OutputObject<'_>, Failure> {
        let (of, rows) = self.place(input)?;
        let header = Header::table(output, rows, columns.into());
        let form = OutputForm::Columns;
        OutputObject::begin(
            self,
            Output {
                output: output.into(),
                form,
                of: Some(of),
                header,
            },
        )
    }

    /// Begins a selection of the input table of the same name as the output port. Write strictly
    /// increasing row numbers into its column `row`, then `finish_rows` with their number.
    ///
    /// # Errors
    /// When the host has no room, or nothing is bound to the input.
    pub fn select(&self, port: &str) -> Result<OutputObject<'_>, Failure> {
        self.select_from(port, port)
    }

    /// As [`Job::select`], with the names of the output and the input port.
    ///
    /// # Errors
    /// When the host has no room, or nothing is bound to the input.
    pub fn select_from(&self, output: &str, input: &str) -> Result<OutputObject<'_>, Failure> {
        let (of, rows) = self.place(input)?;
        let header = selection_header(output, rows);
        let form = OutputForm::Selection;
        OutputObject::begin(
            self,
            Output {
                output: output.into(),
                form,
                of: Some(of),
                header,
            },
        )
    }

    fn place(&self, port: &str) -> Result<(usize, u64), Failure> {
        let place = self
            .request
            .inputs
            .iter()
            .position(|input| input.port == port);
        let place = place
            .ok_or_else(|| Failure::bad_input(format!("nothing is bound to the input {port}")))?;
        Ok((place, self.request.inputs[place].header.rows()))
    }

    /// Gives a report.
    ///
    /// # Errors
    /// When the host does not take it.
    pub fn report(&self, report: &Report) -> Result<(), Failure> {
        self.host.emit(&puncta_documents::write(report, REPORT))
    }

    /// Gives a figure.
    ///
    /// # Errors
    /// When it holds too many numbers itself, or the host does not take it.
    pub fn figure(&self, figure: &Figure) -> Result<(), Failure> {
        figure.check().map_err(Failure::internal)?;
        self.host.emit(&puncta_documents::write(figure, FIGURE))
    }

    /// Tells the person something that does not stop the call.
    pub fn warn(&self, message: &str) {
        self.host.log(2, message);
    }

    /// Tells the log what is being done.
    pub fn log(&self, message: &str) {
        self.host.log(3, message);
    }
}

impl Run for Job {
    fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        self.host.parallel(count, task);
    }

    fn threads(&self) -> usize {
        self.host.threads()
    }

    fn progress(&self, fraction: f64, phase: &str) -> Result<(), Cancelled> {
        self.host.progress(fraction, phase)
    }

    fn cancelled(&self) -> bool {
        self.host.cancelled()
    }
}
