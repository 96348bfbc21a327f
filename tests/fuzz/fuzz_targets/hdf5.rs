//! HDF5 files: any bytes are read or refused, with memory bounded by the file's size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use puncta_plugin_hdf5::ReadHdf5;
use puncta_testkit::Call;

fuzz_target!(|data: &[u8]| {
    let path = std::env::temp_dir().join(format!("puncta-fuzz-{}.h5", std::process::id()));
    if std::fs::write(&path, data).is_ok() {
        let _ = Call::of::<ReadHdf5>().file(&path).threads(1).run();
    }
});
