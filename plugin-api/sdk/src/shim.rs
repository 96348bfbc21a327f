//! The functions that a plugin exports. Each catches panics, so that none reaches the host.
#![allow(unsafe_code)]

use crate::Job;
use crate::host::HostCalls;
use crate::operation::{Prepared, registrations};
use puncta_abi as abi;
use puncta_abi::Str;
use puncta_documents::call::{PLAN, REQUEST};
use puncta_documents::manifest::PLUGIN;
use puncta_documents::{Failure, FailureCode, Manifest, Map, Plan, Request};
use puncta_door::DoorRef;
use puncta_door::abi_stable::library::{CheckTypeLayout, LibHeader, RootModuleResult};
use std::any::Any;
use std::cell::RefCell;
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Once, OnceLock};

/// The exported table.
#[must_use]
pub const fn table(
    describe: extern "C" fn(*mut Str) -> u32,
    get: extern "C" fn(Str) -> *const c_void,
) -> abi::Plugin {
    abi::Plugin {
        size: size_of::<abi::Plugin>() as u32,
        major: 0,
        minor: 1,
        number: abi::ABI_NUMBER,
        describe: Some(describe),
        create: Some(create),
        destroy: Some(destroy),
        get: Some(get),
    }
}

/// The door's loader record.
#[must_use]
pub const fn header(load: extern "C" fn() -> RootModuleResult) -> LibHeader {
    // SAFETY: `load` gives a `DoorRef`, which is what `abi_stable`'s own attribute would write.
    unsafe { LibHeader::from_constructor::<DoorRef>(load, CheckTypeLayout::Yes) }
}

/// Fails to compile when the macro's literal is not the ABI's symbol.
pub const fn assert_symbol(name: &str) {
    let (name, symbol) = (name.as_bytes(), abi::SYMBOL.as_bytes());
    assert!(
        name.len() == symbol.len(),
        "plugin! exports another symbol than the ABI's"
    );
    let mut i = 0;
    while i < name.len() {
        assert!(
            name[i] == symbol[i],
            "plugin! exports another symbol than the ABI's"
        );
        i += 1;
    }
}

/// The manifest of the registered operations.
#[must_use]
pub fn manifest(
    id: &str,
    title: &str,
    version: &str,
    license: &str,
    description: &str,
) -> Manifest {
    Manifest {
        id: id.into(),
        title: title.into(),
        version: version.into(),
        description: description.into(),
        license: (!license.is_empty()).then(|| license.into()),
        sdk: Some(crate::VERSION.into()),
        isolation: "worker".into(),
        reentrant: false,
        needs: vec![abi::DATA_1.into(), abi::JOB_1.into()],
        operations: registrations()
            .into_iter()
            .map(|one| one.document())
            .collect(),
        rest: Map::new(),
    }
}

/// Writes the manifest to `out`, a place for one [`Str`] that the host gives, or null.
#[allow(clippy::not_unsafe_ptr_arg_deref)]
pub fn describe(
    store: &'static OnceLock<String>,
    out: *mut Str,
    make: impl FnOnce() -> Manifest,
) -> u32 {
    if out.is_null() {
        return abi::STATUS_MISUSE;
    }
    let make = AssertUnwindSafe(|| store.get_or_init(|| puncta_documents::write(&make(), PLUGIN)));
    match catch_unwind(make) {
        Ok(text) => {
            // SAFETY: non-null; the host gives a place for one `Str`.
            unsafe { out.write(Str::new(text)) };
            abi::STATUS_OK
        }
        Err(_) => abi::STATUS_PANICKED,
    }
}

struct Instance {
    data: &'static abi::Data1,
    jobs: &'static abi::Job1,
}

struct PlanState {
    request: Arc<Request>,
    plan: Arc<Plan>,
    document: String,
    prepared: Box<dyn Prepared>,
}

unsafe extern "C" fn create(host: *const abi::Host, out: *mut u64) -> u32 {
    install_panic_hook();
    if host.is_null() || out.is_null() {
        return abi::STATUS_MISUSE;
    }
    // SAFETY: the host gives a valid table.
    let Some(get) = (unsafe { (*host).get }) else {
        return abi::STATUS_MISUSE;
    };
    // SAFETY: the ids outlive the calls; a table is valid until the process ends, and starts with
    // its size.
    let (data, jobs) = unsafe {
        (
            get(Str::new(abi::DATA_1)).cast::<abi::Data1>().as_ref(),
            get(Str::new(abi::JOB_1)).cast::<abi::Job1>().as_ref(),
        )
    };
    let (Some(data), Some(jobs)) = (data, jobs) else {
        return abi::STATUS_FAILED;
    };
    let known =
        size_of::<abi::Data1>() as u32 <= data.size && size_of::<abi::Job1>() as u32 <= jobs.size;
    if !known {
        return abi::STATUS_FAILED;
    }
    let instance = Box::into_raw(Box::new(Instance { data, jobs }));
    // SAFETY: non-null; the host gives a place for one number.
    unsafe { out.write(instance as u64) };
    abi::STATUS_OK
}

unsafe extern "C" fn destroy(instance: u64) {
    let instance = instance as *mut Instance;
    if !instance.is_null() {
        // SAFETY: the host passes back what `create` gave it, once.
        drop(unsafe { Box::from_raw(instance) });
    }
}

/// The table `id` of this plugin: `call/1`, else what one of `more` gives, or null.
#[allow(clippy::not_unsafe_ptr_arg_deref)]
pub fn get(id: Str, more: &[fn(&str) -> *const c_void]) -> *const c_void {
    static CALL: abi::Call1 = abi::Call1 {
        size: size_of::<abi::Call1>() as u32,
        reserved: 0,
        prepare: Some(prepare),
        run: Some(run),
        drop: Some(drop_plan),
    };
    // SAFETY: the host's text outlives the call.
    match unsafe { id.as_str() } {
        Some(abi::CALL_1) => std::ptr::from_ref(&CALL).cast(),
        Some(id) => {
            let found = || {
                more.iter()
                    .map(|one| one(id))
                    .find(|table| !table.is_null())
            };
            catch_unwind(found)
                .ok()
                .flatten()
                .unwrap_or(std::ptr::null())
        }
        None => std::ptr::null(),
    }
}

/// Runs `work` for a call; a failure or a panic goes to the host.
fn guarded(host: HostCalls, work: impl FnOnce() -> Result<(), Failure>) -> u32 {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => abi::STATUS_OK,
        Ok(Err(failure)) if failure.is_cancelled() => abi::STATUS_CANCELLED,
        Ok(Err(failure)) => {
            host.fail(&failure);
            match failure.code {
                FailureCode::NotMine => abi::STATUS_NOT_MINE,
                _ => abi::STATUS_FAILED,
            }
        }
        Err(payload) => {
            let PanicText(text) = last_panic(payload.as_ref());
            host.fail(&Failure::new(
                FailureCode::Crashed,
                format!("the plugin panicked: {text}"),
            ));
            abi::STATUS_PANICKED
        }
    }
}

/// An operation that no plugin has: whoever asks for it wants to see that a panic is caught.
const SELF_TEST: &str = "puncta.self-test.panic/1";

unsafe extern "C" fn prepare(instance: u64, job: u64, request: Str, plan: *mut abi::Plan) -> u32 {
    // SAFETY: the host passes back what `create` gave it.
    let Some(instance) = (unsafe { (instance as *const Instance).as_ref() }) else {
        return abi::STATUS_MISUSE;
    };
    if plan.is_null() {
        return abi::STATUS_MISUSE;
    }
    let host = HostCalls::new(job, instance.data, instance.jobs);
    guarded(host, || {
        // SAFETY: the host's text outlives the call.
        let text = unsafe { request.as_str() }
            .ok_or_else(|| Failure::internal("the host's request is no UTF-8"))?;
        let request: Request = puncta_documents::parse(text, REQUEST)
            .map_err(|why| Failure::internal(format!("the host's request is {why}")))?;
        if request.operation == SELF_TEST {
            panic!("this panic was asked for");
        }
        let registered = registrations();
        let operation = registered
            .iter()
            .find(|one| one.id() == request.operation)
            .ok_or_else(|| {
                let message = format!("this plugin has no operation {}", request.operation);
                Failure::new(FailureCode::Unsupported, message)
            })?;
        let (planned, prepared) = operation.prepare(&request)?;
        let document = puncta_documents::write(&planned, PLAN);
        let state = Box::new(PlanState {
            request: Arc::new(request),
            plan: Arc::new(planned),
            document,
            prepared,
        });
        let document = Str::new(&state.document);
        let handle = Box::into_raw(state) as u64;
        // SAFETY: non-null; the text lives in the boxed state until `drop`.
        unsafe { plan.write(abi::Plan { handle, document }) };
        Ok(())
    })
}

unsafe extern "C" fn run(instance: u64, job: u64, plan: u64) -> u32 {
    // SAFETY: the host passes back what `create` and `prepare` gave it.
    let (instance, state) = unsafe {
        match (
            (instance as *const Instance).as_ref(),
            (plan as *const PlanState).as_ref(),
        ) {
            (Some(instance), Some(state)) => (instance, state),
            _ => return abi::STATUS_MISUSE,
        }
    };
    let host = HostCalls::new(job, instance.data, instance.jobs);
    guarded(host, || {
        let job = Job::new(host, Arc::clone(&state.request), Arc::clone(&state.plan))?;
        state.prepared.run(&job)
    })
}

unsafe extern "C" fn drop_plan(_instance: u64, plan: u64) {
    let plan = plan as *mut PlanState;
    if !plan.is_null() {
        // SAFETY: the host passes back what `prepare` gave it, once.
        let state = unsafe { Box::from_raw(plan) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(state)));
    }
}

/// Text of a panic with its place.
#[derive(Debug)]
pub(crate) struct PanicText(pub(crate) String);

thread_local! {
    static LAST_PANIC: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Text of the panic that was just caught on this thread.
pub(crate) fn last_panic(payload: &(dyn Any + Send)) -> PanicText {
    if let Some(PanicText(text)) = payload.downcast_ref() {
        return PanicText(text.clone());
    }
    let text = LAST_PANIC
        .with(|slot| slot.borrow_mut().take())
        .or_else(|| {
            let plain = payload
                .downcast_ref::<&str>()
                .map(|text| (*text).to_owned());
            plain.or_else(|| payload.downcast_ref::<String>().cloned())
        });
    PanicText(text.unwrap_or_else(|| "without a message".into()))
}

/// A library has a standard library of its own, so that this hook sees this plugin's panics only.
fn install_panic_hook() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        std::panic::set_hook(Box::new(|info| {
            let text = info.payload_as_str().unwrap_or("without a message");
            let text = match info.location() {
                Some(place) => format!("{text} (at {}:{})", place.file(), place.line()),
                None => text.to_owned(),
            };
            LAST_PANIC.with(|slot| *slot.borrow_mut() = Some(text));
        }));
    });
}
