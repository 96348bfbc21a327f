//! TIFF files and NumPy arrays: any bytes are read or refused.
#![no_main]

use libfuzzer_sys::fuzz_target;
use puncta_plugin_image_io::{NpyRead, TiffRead};
use puncta_testkit::Call;

fuzz_target!(|data: &[u8]| {
    let path = std::env::temp_dir().join(format!("puncta-fuzz-{}.image", std::process::id()));
    if std::fs::write(&path, data).is_ok() {
        let _ = Call::of::<TiffRead>().file(&path).threads(1).run();
        let _ = Call::of::<NpyRead>().file(&path).threads(1).run();
    }
});
