//! image-io
