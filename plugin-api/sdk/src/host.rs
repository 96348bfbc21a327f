//! The host's functions as safe methods.
#![allow(unsafe_code)]

use crate::run::Cancelled;
use crate::shim::{PanicText, last_panic};
use puncta_abi as abi;
use puncta_abi::Str;
use puncta_documents::call::OUTPUT;
use puncta_documents::failure::FAILURE;
use puncta_documents::{Failure, FailureCode, Output};
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Mutex, PoisonError};

/// The host's tables, and the number of the call they are used for.
#[derive(Clone, Copy, Debug)]
pub struct HostCalls {
    pub(crate) job: u64,
    pub(crate) data: &'static abi::Data1,
    pub(crate) jobs: &'static abi::Job1,
}

impl HostCalls {
    /// The host's functions for the call `job`.
    #[must_use]
    pub fn new(job: u64, data: &'static abi::Data1, jobs: &'static abi::Job1) -> HostCalls {
        HostCalls { job, data, jobs }
    }

    fn check(status: u32, what: &str) -> Result<(), Failure> {
        match status {
            abi::STATUS_OK => Ok(()),
            abi::STATUS_CANCELLED => Err(Failure::cancelled()),
            abi::STATUS_NO_MEMORY => Err(Failure::new(
                FailureCode::Resources,
                format!("there is not enough memory to {what}"),
            )),
            _ => Err(Failure::internal(format!("the host refused to {what}"))),
        }
    }

    pub(crate) fn columns(
        &self,
        object: u64,
        part: usize,
        wanted: usize,
    ) -> Result<Vec<abi::Column>, Failure> {
        const EMPTY: abi::Column = abi::Column {
            data: std::ptr::null_mut(),
            offsets: std::ptr::null_mut(),
            text: std::ptr::null_mut(),
            rows: 0,
            entries: 0,
            text_bytes: 0,
            kind: 0,
            width: 1,
        };
        let what = "give columns";
        let function = self.data.columns.ok_or_else(|| missing("columns"))?;
        let mut out = vec![EMPTY; wanted];
        let mut count = 0_u32;
        let (part, capacity) = (number(part)?, number(wanted)?);
        // SAFETY: `out` has room for `capacity` columns.
        let status = unsafe {
            function(
                self.job,
                object,
                part,
                out.as_mut_ptr(),
                capacity,
                &raw mut count,
            )
        };
        Self::check(status, what)?;
        if count as usize != wanted {
            return Err(Failure::internal(format!(
                "the host gave {count} columns, not {wanted}"
            )));
        }
        Ok(out)
    }

    pub(crate) fn begin(&self, output: &Output) -> Result<u64, Failure> {
        let function = self.data.begin.ok_or_else(|| missing("begin"))?;
        let document = puncta_documents::write(output, OUTPUT);
        let mut object = 0;
        // SAFETY: the document outlives the call.
        let status = unsafe { function(self.job, Str::new(&document), &raw mut object) };
        Self::check(status, &format!("hold the output {}", output.output))?;
        Ok(object)
    }

    pub(crate) fn grow(&self, object: u64, part: usize, rows: u64) -> Result<(), Failure> {
        let function = self.data.grow.ok_or_else(|| missing("grow"))?;
        // SAFETY: numbers only.
        Self::check(
            unsafe { function(self.job, object, number(part)?, rows) },
            "hold more rows",
        )
    }

    pub(crate) fn commit(&self, object: u64, part: usize, rows: u64) -> Result<(), Failure> {
        let function = self.data.commit.ok_or_else(|| missing("commit"))?;
        // SAFETY: numbers only.
        Self::check(
            unsafe { function(self.job, object, number(part)?, rows) },
            "hold more rows",
        )
    }

    pub(crate) fn finish(&self, object: u64, rows: &[u64], header: &str) -> Result<(), Failure> {
        let function = self.data.finish.ok_or_else(|| missing("finish"))?;
        let parts = number(rows.len())?;
        // SAFETY: `rows` has `parts` numbers, and the header outlives the call.
        let status = unsafe { function(self.job, object, rows.as_ptr(), parts, Str::new(header)) };
        Self::check(status, "finish an output")
    }

    pub(crate) fn emit(&self, document: &str) -> Result<(), Failure> {
        let function = self.data.emit.ok_or_else(|| missing("emit"))?;
        // SAFETY: the document outlives the call.
        Self::check(
            unsafe { function(self.job, Str::new(document)) },
            "take a figure or report",
        )
    }

    pub(crate) fn progress(&self, fraction: f64, phase: &str) -> Result<(), Cancelled> {
        let Some(function) = self.jobs.progress else {
            return Ok(());
        };
        // SAFETY: the text outlives the call.
        match unsafe { function(self.job, fraction, Str::new(phase)) } {
            abi::STATUS_CANCELLED => Err(Cancelled),
            _ => Ok(()),
        }
    }

    pub(crate) fn cancelled(&self) -> bool {
        // SAFETY: numbers only.
        self.jobs
            .cancelled
            .is_some_and(|function| unsafe { function(self.job) } != abi::STATUS_OK)
    }

    pub(crate) fn fail(&self, failure: &Failure) {
        if let Some(function) = self.jobs.fail {
            let document = puncta_documents::write(failure, FAILURE);
            // SAFETY: the document outlives the call.
            unsafe { function(self.job, Str::new(&document)) }
        }
    }

    pub(crate) fn log(&self, level: u32, message: &str) {
        if let Some(function) = self.jobs.log {
            // SAFETY: the text outlives the call.
            unsafe { function(self.job, level, Str::new(message)) }
        }
    }

    pub(crate) fn threads(&self) -> usize {
        // SAFETY: numbers only.
        self.jobs
            .threads
            .map_or(1, |function| unsafe { function(self.job) }.max(1) as usize)
    }

    pub(crate) fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        struct Context<'t> {
            task: &'t (dyn Fn(usize) + Sync),
            panic: Mutex<Option<PanicText>>,
        }
        unsafe extern "C" fn call(context: *mut c_void, begin: u64, end: u64) -> u32 {
            // SAFETY: the host passes back the pointer that `parallel` gave it, before that returns.
            let context = unsafe { &*context.cast::<Context<'_>>() };
            let work = || {
                #[allow(clippy::cast_possible_truncation)]
                (begin..end).for_each(|i| (context.task)(i as usize));
            };
            match catch_unwind(AssertUnwindSafe(work)) {
                Ok(()) => abi::STATUS_OK,
                Err(payload) => {
                    let text = last_panic(payload.as_ref());
                    let mut slot = context.panic.lock().unwrap_or_else(PoisonError::into_inner);
                    slot.get_or_insert(text);
                    abi::STATUS_PANICKED
                }
            }
        }
        let Some(function) = self.jobs.parallel_for.filter(|_| count > 1) else {
            (0..count).for_each(task);
            return;
        };
        let context = Context {
            task,
            panic: Mutex::new(None),
        };
        let pointer = std::ptr::from_ref(&context).cast_mut().cast::<c_void>();
        // SAFETY: `context` outlives the call, `call` takes it for what it is.
        let status = unsafe { function(self.job, count as u64, 1, Some(call), pointer) };
        if let Some(text) = context
            .panic
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
        {
            resume_unwind(Box::new(text));
        }
        if status == abi::STATUS_MISUSE {
            // A host that cannot spread the work: do it here, it must be done.
            (0..count).for_each(task);
        }
    }
}

fn missing(function: &str) -> Failure {
    Failure::internal(format!("the host lacks the function {function}"))
}

fn number(count: usize) -> Result<u32, Failure> {
    u32::try_from(count).map_err(|_| Failure::internal("a number is too large for the host"))
}
