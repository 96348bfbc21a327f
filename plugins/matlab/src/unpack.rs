//! Bytes of arrays that stayed in the file.

use crate::container::Variable;
use crate::matrix::{Array, Data};
use flate2::read::ZlibDecoder;
use puncta_sdk::Failure;
use puncta_shared_records::{damaged, unsupported};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

/// The bytes of an array of a variable, from the file.
pub fn load(
    name: &str,
    file: &File,
    variable: &Variable,
    array: &Array,
) -> Result<Vec<u8>, Failure> {
    let Data::At(at) = &array.data else {
        return match &array.data {
            Data::Kept(bytes) => Ok(bytes.to_vec()),
            Data::At(_) => Ok(Vec::new()),
        };
    };
    let size = array.count() * array.stored.number.bytes();
    let mut bytes = Vec::new();
    let mut stream = stream(name, file, variable, *at)?;
    let read = stream.by_ref().take(size as u64).read_to_end(&mut bytes);
    match read {
        Ok(read) if read == size => Ok(bytes),
        _ => Err(damaged(format!(
            "{name}: the variable {} is damaged",
            variable.name
        ))),
    }
}

/// A variable's bytes from a place on.
pub fn stream<'f>(
    name: &str,
    file: &'f File,
    variable: &Variable,
    at: u64,
) -> Result<Box<dyn Read + 'f>, Failure> {
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let broken = |_| damaged(format!("{name}: the variable {} is damaged", variable.name));
    let Some((begin, size)) = variable.packed else {
        reader.seek(SeekFrom::Start(at)).map_err(broken)?;
        return Ok(Box::new(reader));
    };
    reader.seek(SeekFrom::Start(begin)).map_err(broken)?;
    let mut inner = ZlibDecoder::new(reader.take(size));
    io::copy(&mut inner.by_ref().take(at), &mut io::sink()).map_err(broken)?;
    Ok(Box::new(inner))
}

/// A file without a table.
pub fn nothing(name: &str, variables: &[Variable]) -> Failure {
    let names: Vec<&str> = variables
        .iter()
        .take(8)
        .map(|one| one.name.as_str())
        .collect();
    let message = format!(
        "{name} holds no localisations, tracks or vectors of equal length ({})",
        names.join(", ")
    );
    unsupported(
        message,
        "save x, y and the frames as vectors of equal length",
    )
}
