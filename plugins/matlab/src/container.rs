//! The container of MAT files of level 5 (MATLAB's "MAT-File Format"): elements with a type and a
//! size, compressed or not.

use crate::matrix::{Array, Data, Value};
use flate2::read::ZlibDecoder;
use puncta_sdk::{Failure, Run};
use puncta_shared_records::archive::DEFLATE_EXPANSION;
use puncta_shared_records::{Number, Stored, damaged, not_mine};
use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::rc::Rc;

/// Bytes of arrays that are kept in memory; larger ones stay in the file.
const KEPT: u64 = 64 << 10;
/// Bytes of texts that are kept.
const MOST_TEXT: u64 = 64 << 10;
const DEEPEST: usize = 32;
/// Variables that are looked at.
const MOST_VARIABLES: usize = 10_000;

/// A variable of the file.
#[derive(Debug)]
pub struct Variable {
    /// Its name.
    pub name: String,
    /// What it is.
    pub value: Value,
    /// Where its compressed bytes are, if they are.
    pub packed: Option<(u64, u64)>,
}

/// A stream of elements.
struct Cursor<'a> {
    from: &'a mut dyn Read,
    at: u64,
    big: bool,
    run: &'a dyn Run,
    elements: u64,
}

/// Reads the variables of a file of `length` bytes.
pub fn variables(
    name: &str,
    file: &File,
    length: u64,
    head: &[u8],
    run: &dyn Run,
) -> Result<Vec<Variable>, Failure> {
    let big = byte_order(name, head)?;
    let mut file = BufReader::with_capacity(1 << 16, file);
    let mut all = Vec::new();
    let mut at = 128;
    while at < length && all.len() < MOST_VARIABLES {
        file.seek(SeekFrom::Start(at))
            .map_err(|error| fault(name, at, &error))?;
        let mut cursor = Cursor {
            from: &mut file,
            at,
            big,
            run,
            elements: 0,
        };
        let (kind, size) = cursor.tag().map_err(|error| fault(name, at, &error))?;
        let begin = cursor.at;
        let end = begin.checked_add(size).filter(|end| *end <= length);
        let end = end.ok_or_else(|| {
            damaged(format!(
                "{name}: the variable at byte {at} goes beyond the end of the file"
            ))
        })?;
        let place = all.len() + 1;
        let told = |error: io::Error| match error.kind() {
            ErrorKind::Interrupted if run.cancelled() => Failure::cancelled(),
            _ => damaged(format!("{name}: variable {place} is damaged: {error}")),
        };
        match kind {
            14 => {
                if let Some((name, value)) = cursor.matrix(size, 0).map_err(told)? {
                    all.push(Variable {
                        name,
                        value,
                        packed: None,
                    });
                }
            }
            15 => {
                let mut inner = ZlibDecoder::new((&mut file).take(size));
                let mut cursor = Cursor {
                    from: &mut inner,
                    at: 0,
                    big,
                    run,
                    elements: 0,
                };
                let (kind, bytes) = cursor.tag().map_err(told)?;
                if kind != 14 || bytes > size.saturating_mul(DEFLATE_EXPANSION) + 64 {
                    let what = "the decompressed element is none";
                    return Err(damaged(format!(
                        "{name}: variable {place} is damaged: {what}"
                    )));
                }
                if let Some((name, value)) = cursor.matrix(bytes, 0).map_err(told)? {
                    all.push(Variable {
                        name,
                        value,
                        packed: Some((begin, size)),
                    });
                }
            }
            _ => {
                return Err(damaged(format!(
                    "{name}: there is no variable at byte {at}"
                )));
            }
        }
        at = end;
        run.progress(0.0, "looking")?;
    }
    Ok(all)
}

fn fault(name: &str, at: u64, error: &io::Error) -> Failure {
    damaged(format!("{name} cannot be read at byte {at}: {error}"))
}

fn byte_order(name: &str, head: &[u8]) -> Result<bool, Failure> {
    let foreign = || not_mine(name, "MATLAB file of version 5 to 7");
    let (Some(version), Some(order)) = (head.get(124..126), head.get(126..128)) else {
        return Err(foreign());
    };
    match (version, order) {
        ([0, 1], b"IM") => Ok(false),
        ([1, 0], b"MI") => Ok(true),
        ([0, 2], b"IM") => Err(not_mine(
            name,
            "MATLAB file of version 5 to 7, but of 7.3 (HDF5)",
        )),
        _ => Err(foreign()),
    }
}

fn wrong(what: &str) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, what)
}

impl Cursor<'_> {
    fn bytes(&mut self, to: &mut [u8]) -> io::Result<()> {
        self.from.read_exact(to)?;
        self.at += to.len() as u64;
        Ok(())
    }

    fn skip(&mut self, mut count: u64) -> io::Result<()> {
        let mut sink = [0; 16 << 10];
        while count > 0 {
            if self.run.cancelled() {
                return Err(ErrorKind::Interrupted.into());
            }
            let step = count.min(sink.len() as u64);
            self.bytes(&mut sink[..usize::try_from(step).unwrap_or(0)])?;
            count -= step;
        }
        Ok(())
    }

    fn word(&mut self) -> io::Result<u32> {
        let mut bytes = [0; 4];
        self.bytes(&mut bytes)?;
        Ok(if self.big {
            u32::from_be_bytes(bytes)
        } else {
            u32::from_le_bytes(bytes)
        })
    }

    /// The type and bytes of an element that is not small.
    fn tag(&mut self) -> io::Result<(u32, u64)> {
        let kind = self.word()?;
        if kind >> 16 != 0 {
            return Err(wrong("a small element where a large one must be"));
        }
        Ok((kind, self.word()?.into()))
    }

    /// The type of an element and its bytes, of which there are no more than `most`.
    fn element(&mut self, most: u64) -> io::Result<(u32, Vec<u8>)> {
        let (kind, size, small) = self.begin()?;
        if size > most {
            return Err(wrong("an element is larger than it can be"));
        }
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(0)];
        self.bytes(&mut bytes)?;
        self.pad(size, small)?;
        Ok((kind, bytes))
    }

    /// Type, bytes, and whether it is small.
    fn begin(&mut self) -> io::Result<(u32, u64, bool)> {
        let first = self.word()?;
        match first >> 16 {
            0 => Ok((first, self.word()?.into(), false)),
            size @ 1..=4 => Ok((first & 0xffff, size.into(), true)),
            _ => Err(wrong("an element of an unknown kind")),
        }
    }

    fn pad(&mut self, size: u64, small: bool) -> io::Result<()> {
        let unit = if small { 4 } else { 8 };
        let rest = size % unit;
        if rest > 0 {
            self.skip(unit - rest)
        } else {
            Ok(())
        }
    }

    /// A matrix of `size` bytes: its name and value.
    fn matrix(&mut self, size: u64, depth: usize) -> io::Result<Option<(String, Value)>> {
        let end = self.at + size;
        self.elements += 1;
        if self.elements.is_multiple_of(4096) && self.run.cancelled() {
            return Err(ErrorKind::Interrupted.into());
        }
        if size == 0 {
            return Ok(None);
        }
        if depth > DEEPEST {
            return Err(wrong("it is nested too deeply"));
        }
        let (kind, flags) = self.element(64)?;
        let (6, Some(flags)) = (kind, flags.first_chunk::<4>()) else {
            return Err(wrong("a matrix without flags"));
        };
        let flags = if self.big {
            u32::from_be_bytes(*flags)
        } else {
            u32::from_le_bytes(*flags)
        };
        let (class, complex, logical) = (flags & 0xff, flags & 0x800 != 0, flags & 0x200 != 0);
        if !(1..=15).contains(&class) {
            // Objects of newer kinds do not go on like others.
            self.to(end)?;
            return Ok(Some((String::new(), Value::Other)));
        }
        let (_, sizes) = self.element(256)?;
        let sizes = self.sizes(&sizes)?;
        let (_, name) = self.element(4096)?;
        let name = String::from_utf8_lossy(&name).into_owned();
        let room = end.saturating_sub(self.at);
        let value = match class {
            1 => self.cell(&sizes, room, depth)?,
            2 => self.structure(&sizes, room, depth)?,
            4 => self.text(room)?,
            6..=15 if !complex => self.numbers(sizes, class, logical, room)?,
            _ => Value::Other,
        };
        self.to(end)?;
        Ok(Some((name, value)))
    }

    fn to(&mut self, end: u64) -> io::Result<()> {
        let rest = end.checked_sub(self.at);
        self.skip(rest.ok_or_else(|| wrong("a matrix goes beyond its end"))?)
    }

    fn sizes(&self, bytes: &[u8]) -> io::Result<Box<[usize]>> {
        let (words, _) = bytes.as_chunks::<4>();
        let sizes = words.iter().map(|word| {
            let size = if self.big {
                i32::from_be_bytes(*word)
            } else {
                i32::from_le_bytes(*word)
            };
            usize::try_from(size).map_err(|_| wrong("a matrix with a negative size"))
        });
        let sizes = sizes.collect::<io::Result<Vec<_>>>()?;
        let product = sizes
            .iter()
            .try_fold(1_usize, |all, size| all.checked_mul(*size));
        product.ok_or_else(|| wrong("a matrix with an impossible size"))?;
        Ok(sizes.into())
    }

    /// So many matrices, one after the other, in `room` bytes.
    fn many(&mut self, count: usize, room: u64, depth: usize) -> io::Result<Vec<Value>> {
        if count as u64 > room / 8 {
            return Err(wrong("there are fewer elements than announced"));
        }
        let end = self.at + room;
        let mut all = Vec::with_capacity(count.min(1 << 16));
        for _ in 0..count {
            let (kind, size) = self.tag()?;
            if kind != 14 || size > end.saturating_sub(self.at) {
                return Err(wrong("an element is no matrix"));
            }
            let inner = self.matrix(size, depth + 1)?;
            all.push(inner.map_or(Value::Other, |(_, value)| value));
        }
        Ok(all)
    }

    fn cell(&mut self, sizes: &[usize], room: u64, depth: usize) -> io::Result<Value> {
        // Nothing is read from cells, but that they are sound.
        self.many(sizes.iter().product(), room, depth)?;
        Ok(Value::Other)
    }

    fn structure(&mut self, sizes: &[usize], room: u64, depth: usize) -> io::Result<Value> {
        let end = self.at + room;
        let (_, length) = self.element(8)?;
        let length = length.first_chunk::<4>().map_or(0, |word| {
            if self.big {
                u32::from_be_bytes(*word)
            } else {
                u32::from_le_bytes(*word)
            }
        });
        let (_, names) = self.element(room.min(4 << 20))?;
        let length = usize::try_from(length).unwrap_or(0);
        if length == 0 && !names.is_empty() || length > 4096 {
            return Err(wrong("a structure with names of an impossible length"));
        }
        let text = |bytes: &[u8]| {
            let end = bytes
                .iter()
                .position(|byte| *byte == 0)
                .unwrap_or(bytes.len());
            String::from_utf8_lossy(&bytes[..end]).into_owned()
        };
        let names: Rc<[String]> = names.chunks_exact(length.max(1)).map(text).collect();
        let count = sizes.iter().product::<usize>().checked_mul(names.len());
        let count = count.ok_or_else(|| wrong("a structure of an impossible size"))?;
        let values = self.many(count, end.saturating_sub(self.at), depth)?;
        Ok(Value::Struct { names, values })
    }

    fn text(&mut self, room: u64) -> io::Result<Value> {
        let (kind, size, small) = self.begin()?;
        if size > MOST_TEXT || size > room {
            return Ok(Value::Other);
        }
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(0)];
        self.bytes(&mut bytes)?;
        self.pad(size, small)?;
        let text = match kind {
            4 | 17 => {
                let units = bytes.as_chunks::<2>().0.iter().map(|unit| {
                    if self.big {
                        u16::from_be_bytes(*unit)
                    } else {
                        u16::from_le_bytes(*unit)
                    }
                });
                String::from_utf16_lossy(&units.collect::<Vec<_>>())
            }
            2 | 1 => bytes.iter().map(|byte| char::from(*byte)).collect(),
            _ => String::from_utf8_lossy(&bytes).into_owned(),
        };
        Ok(Value::Text(text))
    }

    fn numbers(
        &mut self,
        sizes: Box<[usize]>,
        class: u32,
        logical: bool,
        room: u64,
    ) -> io::Result<Value> {
        let count = sizes.iter().product::<usize>() as u64;
        let (kind, size, small) = self.begin()?;
        let number = stored(kind).ok_or_else(|| wrong("numbers of an unknown kind"))?;
        if size != count.saturating_mul(number.bytes() as u64) || size > room {
            return Err(wrong(
                "an array has more or fewer numbers than its sizes say",
            ));
        }
        let number = if logical && number.bytes() == 1 {
            Number::Bool
        } else {
            number
        };
        let data = if size <= KEPT {
            let mut bytes = vec![0; usize::try_from(size).unwrap_or(0)];
            self.bytes(&mut bytes)?;
            Data::Kept(bytes.into())
        } else {
            let at = self.at;
            self.skip(size)?;
            Data::At(at)
        };
        // The last element of a variable need not be padded.
        if !small && size < room {
            self.pad(size, small).or_else(|error| match error.kind() {
                ErrorKind::UnexpectedEof => Ok(()),
                _ => Err(error),
            })?;
        } else if small {
            self.pad(size, small)?;
        }
        let stored = Stored {
            number,
            big_endian: self.big,
        };
        let class = if logical {
            Number::Bool
        } else {
            self::class(class)
        };
        Ok(Value::Numbers(Array {
            sizes,
            stored,
            class,
            data,
        }))
    }
}

fn stored(kind: u32) -> Option<Number> {
    Some(match kind {
        1 => Number::I8,
        2 => Number::U8,
        3 => Number::I16,
        4 => Number::U16,
        5 => Number::I32,
        6 => Number::U32,
        7 => Number::F32,
        9 => Number::F64,
        12 => Number::I64,
        13 => Number::U64,
        _ => return None,
    })
}

fn class(class: u32) -> Number {
    match class {
        7 => Number::F32,
        8 => Number::I8,
        9 => Number::U8,
        10 => Number::I16,
        11 => Number::U16,
        12 => Number::I32,
        13 => Number::U32,
        14 => Number::I64,
        15 => Number::U64,
        _ => Number::F64,
    }
}
