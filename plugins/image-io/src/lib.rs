//! Image files: TIFF with the calibration that ImageJ reads, and PNG with a colour map.

mod imagej;
mod levels;
mod limits;
mod lut;
mod pixels;
mod png_write;
mod tiff_write;

pub use lut::Lut;
pub use png_write::PngWrite;
pub use tiff_write::TiffWrite;

puncta_sdk::plugin! {
    id: "puncta.image",
    title: "Image files",
    description: "TIFF with the calibration that ImageJ reads, and PNG with a colour map.",
    isolation: "none",
    reentrant: true,
}
