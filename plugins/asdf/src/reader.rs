//! The reader as an operation.

use crate::block::{self, Block, MAGIC};
use crate::tree;
use flate2::read::ZlibDecoder;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::{self, Value, json};
use puncta_shared_import::{Mapping, MappingParams};
use puncta_shared_records::names::{self, Raw};
use puncta_shared_records::{
    Field, Number, Opened, Pass, Source, Stored, damaged, fill, not_mine, open, unsupported,
};
use std::io::{BufReader, Read, Seek, SeekFrom};

const PORT: &str = "localisations";
const EXAMPLE: &[u8] = include_bytes!("../data/example.asdf");
const BEGIN: &[u8] = b"#ASDF";
/// Bytes of a tree.
const MOST_TREE: usize = 16 << 20;
const MOST_COLUMNS: u64 = 4096;

/// Reads localisations from an .asdf file of locan.
#[derive(Debug, Params)]
pub struct ReadAsdf {
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

/// How the array lies in its block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Rows,
    Columns,
}

/// The array of a file.
struct Found {
    opened: Opened,
    tree: Map,
    block: Block,
    offset: u64,
    rows: u64,
    columns: Vec<String>,
    stored: Stored,
    order: Order,
}

fn find(request: &Request) -> Result<Found, Failure> {
    let mut opened = open(request, 16)?;
    if !opened.head.starts_with(BEGIN) {
        return Err(not_mine(&opened.name, "ASDF file"));
    }
    let fault = |error| Failure::io("read", &opened.path, &error);
    let mut bytes = Vec::new();
    opened.file.seek(SeekFrom::Start(0)).map_err(fault)?;
    let mut start = (&opened.file).take(MOST_TREE as u64);
    start.read_to_end(&mut bytes).map_err(fault)?;
    let name = opened.name.clone();
    let end = bytes
        .windows(MAGIC.len())
        .position(|window| window == MAGIC);
    let text = std::str::from_utf8(&bytes[..end.unwrap_or(bytes.len())]);
    let text = text.map_err(|_| damaged(format!("the tree of {name} is no text")))?;
    let tree = tree::parse(text);
    let tree = tree.map_err(|why| damaged(format!("the tree of {name} is damaged: {why}")))?;
    let Value::Object(mut tree) = tree else {
        return Err(damaged(format!("the tree of {name} has no members")));
    };
    let (Some(columns), Some(data)) = (tree.get("columns").cloned(), tree.remove("data")) else {
        return Err(not_mine(&name, "ASDF file of locan (columns and data)"));
    };
    let columns: Option<Vec<String>> = columns
        .as_array()
        .map(|all| all.iter().map(text_of).collect());
    let broken = |what: &str| damaged(format!("the array of {name} {what}"));
    let columns = columns.ok_or_else(|| broken("has no columns"))?;
    let number = |key: &str| data.get(key).and_then(Value::as_u64);
    let (Some(source), Some(at)) = (number("source"), end) else {
        let message = format!("the array of {name} is not in a block of the same file");
        return Err(unsupported(message, "save it with its array inside"));
    };
    let shape: Vec<u64> = whole(data.get("shape")).ok_or_else(|| broken("has no shape"))?;
    let [rows, width] = *shape else {
        return Err(broken("has not two dimensions"));
    };
    if width != columns.len() as u64 || width == 0 || width > MOST_COLUMNS {
        return Err(broken("has another number of columns than the tree names"));
    }
    let type_ = data.get("datatype").and_then(Value::as_str).unwrap_or("");
    let stored = Stored {
        number: Number::from_name(type_).ok_or_else(|| broken("has an unknown type"))?,
        big_endian: data.get("byteorder").and_then(Value::as_str) == Some("big"),
    };
    let size = stored.number.bytes() as u64;
    let order = match data.get("strides") {
        None => Order::Rows,
        strides => match whole(strides).as_deref() {
            Some([a, b]) if *a == width * size && *b == size => Order::Rows,
            Some([a, b]) if *a == size && Some(*b) == rows.checked_mul(size) => Order::Columns,
            _ => {
                return Err(unsupported(
                    format!("{name} has gaps in its array"),
                    "save it again",
                ));
            }
        },
    };
    let block = block::find(&name, &opened.file, opened.length, at as u64, source)?;
    let offset = number("offset").unwrap_or(0);
    let needed = rows
        .checked_mul(width * size)
        .and_then(|bytes| bytes.checked_add(offset));
    if needed.is_none_or(|needed| needed > block.size) {
        return Err(broken("announces more rows than its block holds"));
    }
    Ok(Found {
        opened,
        tree,
        block,
        offset,
        rows,
        columns,
        stored,
        order,
    })
}

fn text_of(value: &Value) -> String {
    value
        .as_str()
        .map_or_else(|| value.to_string(), str::to_owned)
}

fn whole(list: Option<&Value>) -> Option<Vec<u64>> {
    list?.as_array()?.iter().map(Value::as_u64).collect()
}

impl Found {
    /// The unit of a column, if locan's metadata have it.
    fn unit<'m>(&self, meta: &'m Value, column: &str) -> Option<&'m str> {
        let list = meta.get("unit").or(meta.get("units"))?.as_array()?;
        let said = |one: &&Value| one.get("property").and_then(Value::as_str) == Some(column);
        list.iter().find(said)?.get("unit")?.as_str()
    }

    /// The columns, what the tree says besides, and notes.
    fn fields(&self, mapping: &Mapping) -> Result<(Vec<Field>, Map, Vec<String>), Failure> {
        let mut tree = self.tree.clone();
        for key in ["columns", "asdf_library", "history"] {
            tree.remove(key);
        }
        // locan keeps its metadata as JSON in a text.
        let meta = tree.get("meta").and_then(Value::as_str);
        let meta: Option<Value> = meta.and_then(|text| serde_json::from_str(text).ok());
        let size = self.stored.number.bytes();
        let (mut raw, mut fields) = (Vec::new(), Vec::new());
        for (place, column) in self.columns.iter().enumerate() {
            let stated = meta.as_ref().and_then(|meta| self.unit(meta, column));
            let element = self.stored.number.element();
            raw.push(Raw::named(column, element, stated));
            let info = ColumnInfo::new(column, element, "");
            fields.push(Field::new(info, self.stored, place * size));
        }
        let (fields, notes) = names::fields(&self.opened.name, mapping, &raw, &fields)?;
        if let Some(meta) = meta {
            tree.insert("meta".into(), meta);
        }
        Ok((fields, tree, notes))
    }

    fn header(&self, mapping: &Mapping) -> Result<(Vec<Field>, Header, Vec<String>), Failure> {
        let (fields, tree, notes) = self.fields(mapping)?;
        let infos = fields.iter().map(|field| field.info.clone());
        let mut header = Header::table(PORT, self.rows, infos.collect());
        header.metadata.insert("format".into(), "locan asdf".into());
        header.metadata.insert("asdf".into(), tree.into());
        Ok((fields, header, notes))
    }

    /// The decompressed block from the array's column `place` on.
    fn unpack(&self, place: u64) -> Result<impl Read + '_, Failure> {
        let name = &self.opened.name;
        let broken = |_| damaged(format!("the block of {name} is damaged"));
        let mut file = BufReader::with_capacity(1 << 18, &self.opened.file);
        file.seek(SeekFrom::Start(self.block.begin))
            .map_err(broken)?;
        let mut stream = ZlibDecoder::new(file.take(self.block.used)).take(self.block.size);
        let before = self.offset + place * self.rows * self.stored.number.bytes() as u64;
        let mut before = stream.by_ref().take(before);
        std::io::copy(&mut before, &mut std::io::sink()).map_err(broken)?;
        Ok(stream)
    }
}

impl Operation for ReadAsdf {
    const ID: &'static str = "puncta.asdf.read/1";

    fn info() -> Info {
        Info::reader("ASDF files of locan", &[".asdf"])
            .description(
                "Reads localisations from the .asdf files of locan.\nNames and, where they are, \
                 units come from the tree; a unit that the file does not state stays unknown.",
            )
            .formats(&[BEGIN], &["locan asdf"])
            .output(Ports::table(PORT).description("One row a localisation."))
            .example(json!({ "units": "nm" }))
            .example_bytes("example.asdf", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let found = find(request)?;
        let (_, header, notes) = found.header(&self.mapping.mapping()?)?;
        let mut plan = Plan {
            interruptible: true,
            memory: 64 << 20,
            notes,
            ..Plan::default()
        };
        plan.outputs.push(Output {
            output: PORT.into(),
            form: OutputForm::Object,
            of: None,
            header,
        });
        plan.probe = Some(Probe {
            format: "locan asdf".into(),
            confidence: 1.0,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let found = find(job.request())?;
        let (fields, header, _) = found.header(&self.mapping.mapping()?)?;
        let mut out = job.begin(PORT, header)?;
        let committer = out.committer();
        let (size, block) = (found.stored.number.bytes(), found.block);
        let mut targets = out.columns_mut(0)?;
        let mut pass = Pass {
            name: &found.opened.name,
            rows: found.rows,
            record: size * found.columns.len(),
            fields: &fields,
            select: None,
        };
        let begin = block.begin + found.offset;
        if found.order == Order::Rows {
            let mut commit = |rows| committer.commit(0, rows);
            if block.packed {
                let mut stream = found.unpack(0)?;
                fill(
                    Source::Stream(&mut stream),
                    &pass,
                    &mut targets,
                    &mut commit,
                    job,
                )?;
            } else {
                let source = Source::File(&found.opened.file, begin);
                fill(source, &pass, &mut targets, &mut commit, job)?;
            }
            drop(targets);
            return out.finish();
        }
        pass.record = size;
        committer.commit(0, found.rows)?;
        let mut unpacked = None;
        for (field, target) in fields.iter().zip(targets) {
            let place = (field.at / size) as u64;
            let column = [Field {
                at: 0,
                ..field.clone()
            }];
            let pass = Pass {
                fields: &column,
                ..pass
            };
            let mut targets = [target];
            if !block.packed {
                let source =
                    Source::File(&found.opened.file, begin + place * found.rows * size as u64);
                fill(source, &pass, &mut targets, &mut |_| Ok(()), job)?;
                continue;
            }
            // The next column is where the last one ended, unless the mapping left one out.
            let mut stream = match unpacked.take() {
                Some((next, stream)) if next == place => stream,
                _ => found.unpack(place)?,
            };
            fill(
                Source::Stream(&mut stream),
                &pass,
                &mut targets,
                &mut |_| Ok(()),
                job,
            )?;
            unpacked = Some((place + 1, stream));
        }
        out.finish()
    }
}
