//! A plugin that leaves a trace when it is loaded: a file named by `PUNCTA_TEST_CANARY`, with a
//! line for each time that a process opened the library.

use puncta_sdk::prelude::*;

puncta_sdk::plugin! {
    id: "test.canary",
    title: "Canary",
    description: "Leaves a trace when it is loaded.",
    isolation: "none",
    reentrant: true,
}

extern "C" fn loaded() {
    use std::io::Write;
    let Some(path) = std::env::var_os("PUNCTA_TEST_CANARY") else {
        return;
    };
    let mut options = std::fs::File::options();
    if let Ok(mut file) = options.create(true).append(true).open(path) {
        // The test sees what is missing.
        let _ = writeln!(file, "{}", std::process::id());
    }
}

// The loader calls what stands in this section before anything else of the library.
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
#[used]
#[unsafe(link_section = ".init_array")]
static LOADED: extern "C" fn() = loaded;

/// Sings.
#[derive(Params)]
struct Sing {
    /// How long.
    #[param(default = 1.0, unit = "s", min = 0.0)]
    time: f64,
}

impl Operation for Sing {
    const ID: &'static str = "test.canary.sing/1";

    fn info() -> Info {
        Info::operation("Sing")
            .output(Ports::table("song"))
            .example(puncta_sdk::serde_json::json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let columns = vec![ColumnInfo::new("x", Element::F64, "nm").role("position")];
        let mut out = job.begin("song", Header::table("song", 1, columns))?;
        out.f64_mut("x")?.fill(self.time);
        out.finish()
    }
}

puncta_sdk::register!(Sing);
