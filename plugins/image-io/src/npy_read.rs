//! The reader of NumPy arrays, `puncta.image.npy.read/1`.

use crate::options::ImageOptions;
use crate::store::{Numbers, Stored};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::Read;
use std::path::Path;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Bytes of a header.
const MOST: usize = 1 << 20;
/// Bytes that are converted at a time.
const CHUNK: usize = 1 << 20;

/// Reads an image from a NumPy array.
#[derive(Debug, Params)]
pub struct NpyRead {
    #[param(flatten)]
    options: ImageOptions,
}

/// What the head of a file says.
#[derive(Debug, PartialEq)]
struct Npy {
    stored: Stored,
    big_endian: bool,
    /// The last axis is the slowest.
    fortran: bool,
    shape: Vec<u64>,
    /// Where the numbers start.
    start: u64,
}

impl Npy {
    fn numbers(&self) -> Option<u64> {
        self.shape.iter().try_fold(1_u64, |n, s| n.checked_mul(*s))
    }

    /// All numbers of these bytes.
    fn all<'a>(&self, bytes: &'a [u8]) -> Numbers<'a> {
        Numbers {
            bytes,
            stored: self.stored,
            big_endian: self.big_endian,
            step: 1,
            first: 0,
            linear: None,
        }
    }
}

fn open(path: &Path, name: &str) -> Result<(File, Npy), Failure> {
    let io = |e: &std::io::Error| Failure::io("read", path, e);
    let mut file = File::open(path).map_err(|e| io(&e))?;
    let length = file.metadata().map_err(|e| io(&e))?.len();
    let mut head = Vec::new();
    file.by_ref()
        .take(MOST as u64)
        .read_to_end(&mut head)
        .map_err(|e| io(&e))?;
    let npy = parse(&head, name)?;
    let bytes = npy
        .numbers()
        .and_then(|n| n.checked_mul(npy.stored.size() as u64));
    let end = bytes.and_then(|bytes| bytes.checked_add(npy.start));
    if end.is_none_or(|end| end > length) {
        let shape: Vec<String> = npy.shape.iter().map(u64::to_string).collect();
        let message = format!(
            "{name} is cut short: an array of {} numbers is announced, but the file has {length} bytes",
            shape.join(" x ")
        );
        return Err(Failure::bad_file(message).remedy("copy it again from its source"));
    }
    Ok((file, npy))
}

/// The type of numbers that NumPy calls so.
fn number(kind: &str) -> Option<Stored> {
    Some(match kind {
        "u1" | "b1" => Stored::U8,
        "i1" => Stored::I8,
        "u2" => Stored::U16,
        "i2" => Stored::I16,
        "u4" => Stored::U32,
        "i4" => Stored::I32,
        "u8" => Stored::U64,
        "i8" => Stored::I64,
        "f2" => Stored::F16,
        "f4" => Stored::F32,
        "f8" => Stored::F64,
        _ => return None,
    })
}

/// Reads the head: the magic, the version, and a Python dictionary of three plain values.
fn parse(head: &[u8], name: &str) -> Result<Npy, Failure> {
    let foreign = |what: &str| {
        let message = format!("{name} is no image: {what}");
        Failure::new(FailureCode::NotMine, message).remedy("open it with the reader of its format")
    };
    let damaged = || Failure::bad_file(format!("the header of {name} is damaged"));
    let rest = head
        .strip_prefix(MAGIC)
        .ok_or_else(|| foreign("it is no NumPy array"))?;
    let (version, rest) = rest.split_at_checked(2).ok_or_else(damaged)?;
    let wide = version.first().is_some_and(|v| *v > 1);
    let (length, rest) = rest
        .split_at_checked(if wide { 4 } else { 2 })
        .ok_or_else(damaged)?;
    let length = length
        .iter()
        .rev()
        .fold(0_usize, |n, b| n << 8 | usize::from(*b));
    let text = rest.get(..length).ok_or_else(damaged)?;
    let text = std::str::from_utf8(text).map_err(|_| damaged())?;
    let start = (head.len() - rest.len() + length) as u64;
    let value = |key: &str| {
        let at = text.find(key)? + key.len();
        Some(text.get(at..)?.trim_start().strip_prefix(':')?.trim_start())
    };
    let descr = value("'descr'").ok_or_else(damaged)?;
    let Some(descr) = descr.strip_prefix('\'') else {
        return Err(foreign("it holds records"));
    };
    let descr = descr.split('\'').next().unwrap_or_default();
    let (order, kind) = descr.split_at_checked(1).ok_or_else(damaged)?;
    let stored = number(kind);
    let stored =
        stored.ok_or_else(|| foreign(&format!("its numbers are of the type {descr:?}")))?;
    let shape = value("'shape'").and_then(|v| v.strip_prefix('(')?.split(')').next());
    let shape: Option<Vec<u64>> = shape
        .ok_or_else(damaged)?
        .split(',')
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .map(|part| part.parse().ok())
        .collect();
    let shape = shape.ok_or_else(damaged)?;
    if !(2..=5).contains(&shape.len()) {
        return Err(foreign(&format!("it has {} dimensions", shape.len())));
    }
    if shape.contains(&0) {
        return Err(foreign("it holds no number"));
    }
    Ok(Npy {
        stored,
        big_endian: order == ">",
        fortran: value("'fortran_order'").is_some_and(|v| v.starts_with("True")),
        shape,
        start,
    })
}

impl NpyRead {
    fn grid(&self, npy: &Npy, name: &str, notes: &mut Vec<String>) -> ImageInfo {
        let mut info = ImageInfo::plane(1, 1, 0.0, 0.0, 0.0);
        let given = npy.shape.len();
        match npy.shape.as_slice() {
            [planes, y, x] => {
                info.size = [1, 1, 1, *y, *x];
                if let Some(size) = info.size.get_mut(self.options.axis()) {
                    *size = *planes;
                }
                if !self.options.says_planes() {
                    notes.push(format!(
                        "The {planes} planes of {name} are taken as z; --planes t or c says otherwise."
                    ));
                }
            }
            shape => {
                for (axis, size) in shape.iter().enumerate() {
                    if let Some(place) = info.size.get_mut(5 - given + axis) {
                        *place = *size;
                    }
                }
            }
        }
        self.options.apply(&mut info, name, notes);
        info
    }
}

/// The whole array in memory is needed where the last axis is the slowest.
fn memory(npy: &Npy) -> u64 {
    let bytes = npy.numbers().unwrap_or(0) * npy.stored.size() as u64;
    if npy.fortran { bytes } else { CHUNK as u64 }
}

impl Operation for NpyRead {
    const ID: &'static str = "puncta.image.npy.read/1";

    fn info() -> Info {
        let mut example = b"\x93NUMPY\x01\x00\x3a\x00".to_vec();
        let head = "{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3)}\n";
        example.extend_from_slice(head.as_bytes());
        example.extend_from_slice(&[0, 1, 2, 3, 4, 5]);
        Info::reader("NumPy image", &[".npy"])
            .description(
                "Reads an image from a NumPy array of two to five dimensions: y x, z y x, c z y x or \
                 t c z y x. The file says no size of pixels: give it here.",
            )
            .formats(&[MAGIC], &["NumPy image"])
            .output(Ports::image("image"))
            .example(json!({ "pixel_size": 100 }))
            .example_bytes("image.npy", &example)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let file = request.file.as_ref();
        let file = file.ok_or_else(|| Failure::internal("the call has no file"))?;
        let (_, npy) = open(Path::new(&file.path), &file.name)?;
        let mut plan = Plan {
            interruptible: true,
            memory: memory(&npy),
            ..Plan::default()
        };
        let info = self.grid(&npy, &file.name, &mut plan.notes);
        let header = Header::image("image", info, npy.stored.element(), "1");
        plan.outputs.push(Output {
            output: "image".into(),
            form: OutputForm::Object,
            of: None,
            header,
        });
        // A narrow matrix may as well be a table.
        let narrow = npy.shape.last().is_some_and(|width| *width < 8);
        plan.probe = Some(Probe {
            format: "NumPy image".into(),
            confidence: if narrow { 0.3 } else { 0.8 },
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let reference = job.file()?;
        let path = Path::new(&reference.path);
        let (mut file, npy) = open(path, &reference.name)?;
        let info = self.grid(&npy, &reference.name, &mut Vec::new());
        let count = npy.numbers().unwrap_or(0);
        let mut out = job.begin(
            "image",
            Header::image("image", info, npy.stored.element(), "1"),
        )?;
        out.commit(0, count)?;
        let mut columns = out.columns_mut(0)?;
        let Some(column) = columns.first_mut() else {
            return Err(Failure::internal("an image without a column"));
        };
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        let io = |e: &std::io::Error| Failure::io("read", path, e);
        use std::io::{Seek, SeekFrom};
        file.seek(SeekFrom::Start(npy.start)).map_err(|e| io(&e))?;
        let size = npy.stored.size();
        if npy.fortran {
            let mut bytes = vec![0; count * size];
            file.read_exact(&mut bytes).map_err(|e| io(&e))?;
            fortran(&npy, npy.all(&bytes), column, job)?;
        } else {
            let mut bytes = vec![0; CHUNK];
            let each = CHUNK / size;
            for from in (0..count).step_by(each) {
                job.progress(from as f64 / count as f64, "reading")?;
                let part = each.min(count - from);
                let bytes = bytes.get_mut(..part * size).unwrap_or_default();
                file.read_exact(bytes).map_err(|e| io(&e))?;
                npy.all(bytes).put(column, from, part)?;
            }
        }
        drop(columns);
        out.finish()
    }
}

/// Rows along x are strewn over the array.
fn fortran(
    npy: &Npy,
    numbers: Numbers<'_>,
    column: &mut puncta_sdk::output::ColumnMut<'_>,
    run: &dyn Run,
) -> Result<(), Failure> {
    let shape: Vec<usize> = npy
        .shape
        .iter()
        .map(|s| usize::try_from(*s).unwrap_or(0))
        .collect();
    let Some((width, outer)) = shape.split_last() else {
        return Ok(());
    };
    let step: usize = outer.iter().product();
    let rows: usize = outer.iter().product();
    for row in 0..rows {
        if row % 1024 == 0 {
            run.progress(row as f64 / rows as f64, "reading")?;
        }
        // The place of the row in the outer axes, counted the other way round.
        let (mut rest, mut first, mut stride) = (row, 0, 1);
        let mut strides: Vec<usize> = Vec::with_capacity(outer.len());
        for size in outer {
            strides.push(stride);
            stride *= size;
        }
        for (size, stride) in outer.iter().zip(&strides).rev() {
            first += rest % size * stride;
            rest /= size;
        }
        Numbers {
            step,
            first,
            ..numbers
        }
        .put(column, row * width, *width)?;
    }
    Ok(())
}

register!(NpyRead);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::Call;

    fn file(descr: &str, fortran: &str, shape: &str, bytes: &[u8]) -> Vec<u8> {
        let head =
            format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend_from_slice(&(head.len() as u16).to_le_bytes());
        file.extend_from_slice(head.as_bytes());
        file.extend_from_slice(bytes);
        file
    }

    fn read(bytes: &[u8]) -> Result<puncta_testkit::Object, Failure> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        std::fs::write(&path, bytes).unwrap();
        let done = Call::of::<NpyRead>().file(&path).run()?;
        Ok(done.output("image").unwrap().clone())
    }

    #[test]
    fn both_orders_and_byte_orders() {
        let rows = [1_u8, 2, 3, 4, 5, 6];
        let plain = read(&file("'|u1'", "False", "(2, 3)", &rows)).unwrap();
        assert_eq!(plain.header.image.as_ref().unwrap().size, [1, 1, 1, 2, 3]);
        let values = |image: &puncta_testkit::Object| {
            image
                .numbers(0, "value", Element::U8, u8::from_ne_bytes)
                .unwrap()
        };
        assert_eq!(values(&plain), rows);
        let columns = [1_u8, 4, 2, 5, 3, 6];
        let turned = read(&file("'|u1'", "True", "(2, 3)", &columns)).unwrap();
        assert_eq!(values(&turned), rows);
        let cube: Vec<u8> = (0..24).collect();
        let mut strewn = vec![0; 24];
        for (k, place) in cube.iter().zip(0_usize..) {
            let (a, b, c) = (place / 12, place / 4 % 3, place % 4);
            strewn[a + 2 * b + 6 * c] = *k;
        }
        assert_eq!(
            values(&read(&file("'|u1'", "True", "(2, 3, 4)", &strewn)).unwrap()),
            cube
        );
        let big = read(&file("'>i2'", "False", "(1, 2)", &[0xff, 0xfe, 1, 0])).unwrap();
        assert_eq!(big.i32("value").unwrap(), [-2, 256]);
    }

    #[test]
    fn what_is_no_image() {
        let code = |bytes: &[u8]| read(bytes).unwrap_err().code;
        let foreign = FailureCode::NotMine;
        assert_eq!(
            code(&file("[('x', '<f8')]", "False", "(2,)", &[0; 16])),
            foreign
        );
        assert_eq!(code(&file("'<f8'", "False", "(2,)", &[0; 16])), foreign);
        assert_eq!(code(&file("'|O'", "False", "(2, 2)", &[0; 16])), foreign);
        assert_eq!(code(b"no array"), foreign);
        let bad = FailureCode::BadFile;
        assert_eq!(code(&file("'<f8'", "False", "(200, 200)", &[0; 16])), bad);
        let huge = "(4294967296, 4294967296, 4294967296)";
        assert_eq!(code(&file("'<f8'", "False", huge, &[0; 16])), bad);
    }

    #[test]
    fn damage_is_survived() {
        let whole = file("'<u2'", "False", "(4, 5, 6)", &[7; 240]);
        for cut in 0..64 {
            let _ = read(&whole[..whole.len() * cut / 64]);
        }
        let mut state = 5_u64;
        for _ in 0..200 {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            let mut bytes = whole.clone();
            let at = (state >> 33) as usize % bytes.len();
            bytes[at] = (state >> 20) as u8;
            let _ = read(&bytes);
        }
    }
}
