//! Arrow IPC: any bytes are read or refused, with memory bounded by the file's size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use puncta_plugin_arrow_io::ReadIpc;
use puncta_testkit::Call;

fuzz_target!(|data: &[u8]| {
    let path = std::env::temp_dir().join(format!("puncta-fuzz-{}.arrow", std::process::id()));
    if std::fs::write(&path, data).is_ok() {
        let _ = Call::of::<ReadIpc>().file(&path).threads(1).run();
    }
});
