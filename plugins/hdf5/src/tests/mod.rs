//! Tests on whole files.

mod damage;
mod expected;
mod formats;
mod others;
mod packed;
mod real;
mod write;
mod written;

use std::path::{Path, PathBuf};

use puncta_sdk::{Failure, Plan};
use puncta_testkit::{Call, Done, Object};

use crate::ReadHdf5;

/// A call that reads `path` with default parameters.
fn call(path: &Path) -> Call {
    Call::of::<ReadHdf5>().file(path)
}

/// The plan and the localisations of a file that is read.
fn localisations(path: &Path) -> (Plan, Object) {
    let plan = call(path).prepare().unwrap();
    (plan, output(&call(path).run().unwrap(), "localisations"))
}

fn output(done: &Done, port: &str) -> Object {
    done.output(port).unwrap().clone()
}

/// Why a file is not read.
fn failure(path: &Path) -> Failure {
    call(path).prepare().unwrap_err()
}

/// Any numeric column as f64.
fn numbers(table: &Object, name: &str) -> Vec<f64> {
    use puncta_sdk::Element::{F32, F64, I16, I32, I64, U32};
    match table.header.column(name).expect(name).type_.element {
        F64 => table.f64(name).unwrap(),
        F32 => table
            .f32(name)
            .unwrap()
            .into_iter()
            .map(f64::from)
            .collect(),
        U32 => table
            .u32(name)
            .unwrap()
            .into_iter()
            .map(f64::from)
            .collect(),
        I32 => table
            .i32(name)
            .unwrap()
            .into_iter()
            .map(f64::from)
            .collect(),
        I16 => table
            .numbers(0, name, I16, i16::from_ne_bytes)
            .unwrap()
            .into_iter()
            .map(f64::from)
            .collect(),
        I64 => {
            let values = table.numbers(0, name, I64, i64::from_ne_bytes).unwrap();
            values.into_iter().map(|v| v as f64).collect()
        }
        other => panic!("{name} is {}", other.name()),
    }
}

/// The shared data folder beside the workspace, where there is one.
fn shared(file: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Some(root.join("../shared/data").join(file)).filter(|path| path.exists())
}
