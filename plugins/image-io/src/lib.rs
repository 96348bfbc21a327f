//! Image files: TIFF of ImageJ and OME both ways, NumPy arrays, and PNG with a colour map.

mod calibration;
#[cfg(test)]
mod expected_tests;
mod imagej;
mod levels;
mod limits;
mod lut;
mod npy_read;
mod options;
mod pixels;
mod png_write;
mod store;
mod tiff_pages;
mod tiff_read;
mod tiff_write;

pub use lut::Lut;
pub use npy_read::NpyRead;
pub use png_write::PngWrite;
pub use tiff_read::TiffRead;
pub use tiff_write::TiffWrite;

puncta_sdk::plugin! {
    id: "puncta.image",
    title: "Image files",
    description: "TIFF of ImageJ and OME both ways, NumPy arrays, and PNG with a colour map.",
    isolation: "none",
    reentrant: true,
}
