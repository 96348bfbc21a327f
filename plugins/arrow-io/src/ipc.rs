//! Messages of Arrow IPC: where they are, what they announce, and their batches.
//!
//! A file is a stream between two magic words; its footer repeats what the stream says, so that
//! both are read as a stream.

use crate::guard::decode;
use arrow_array::RecordBatch;
use arrow_buffer::Buffer;
use arrow_ipc::convert::try_fb_to_schema;
use arrow_ipc::reader::FileDecoder;
use arrow_ipc::{
    Block, CompressionType, Message, MessageHeader, MetadataVersion, RecordBatch as Announced,
    root_as_message,
};
use arrow_schema::{DataType, Schema};
use puncta_sdk::{Failure, Run, run};
use puncta_shared_records::{damaged, not_mine, read_at, unsupported};
use std::fs::File;
use std::sync::Arc;

const MAGIC: &[u8] = b"ARROW1";
const CONTINUES: u32 = 0xffff_ffff;
/// Bytes of a message's description.
const MOST_METADATA: u64 = 256 << 20;
/// Bytes of batches that are decoded at a time.
const GROUP: u64 = 32 << 20;

/// A message with a body.
#[derive(Clone, Copy, Debug)]
struct Part {
    block: Block,
    rows: u64,
    dictionary: bool,
}

/// A file, as far as its messages say what it holds.
#[derive(Debug)]
pub struct Ipc {
    name: String,
    file: File,
    /// The fields.
    pub schema: Arc<Schema>,
    version: MetadataVersion,
    parts: Vec<Part>,
    /// Rows of all batches.
    pub rows: u64,
    /// Missing values of each field.
    pub missing: Vec<u64>,
}

/// A message's place and description.
struct Found {
    at: u64,
    prefix: u64,
    metadata: Vec<u8>,
}

impl Ipc {
    /// Looks at all messages of a file of `length` bytes that begins with `head`.
    pub fn open(name: &str, file: File, length: u64, head: &[u8]) -> Result<Ipc, Failure> {
        let (begin, end) = bounds(name, &file, length, head)?;
        let first = message(name, &file, begin, end)?;
        let first = first.ok_or_else(|| not_mine(name, "Arrow IPC"))?;
        let foreign = |_| not_mine(name, "Arrow IPC");
        let whole = root_as_message(&first.metadata).map_err(foreign)?;
        let described = whole.header_as_schema();
        let described = described.ok_or_else(|| not_mine(name, "Arrow IPC"))?;
        if described.endianness() == arrow_ipc::Endianness::Big {
            return Err(unsupported(
                format!("{name} has its numbers in big-endian order"),
                "write it on another computer",
            ));
        }
        let schema = decode(name, || try_fb_to_schema(described))?;
        let mut ipc = Ipc {
            name: name.into(),
            file,
            missing: vec![0; schema.fields().len()],
            schema: Arc::new(schema),
            version: whole.version(),
            parts: Vec::new(),
            rows: 0,
        };
        let mut at = first.at + first.prefix + first.metadata.len() as u64;
        while let Some(found) = message(name, &ipc.file, at, end)? {
            at = ipc.add(&found, end)?;
        }
        Ok(ipc)
    }

    /// Takes a message in; returns where the next one begins.
    fn add(&mut self, found: &Found, end: u64) -> Result<u64, Failure> {
        let name = &self.name;
        let broken = |what: &str| damaged(format!("{name}, byte {}: {what}", found.at));
        let message = root_as_message(&found.metadata)
            .map_err(|_| broken("the description of a message is broken"))?;
        let body = found.at + found.prefix + found.metadata.len() as u64;
        let bytes = u64::try_from(message.bodyLength()).ok();
        let next = bytes.and_then(|bytes| body.checked_add(bytes));
        let next = next.filter(|next| *next <= end);
        let next = next.ok_or_else(|| broken("a batch goes beyond the end of the file"))?;
        let dictionary = message.header_as_dictionary_batch();
        let data = dictionary.and_then(|batch| batch.data());
        let Some(batch) = data.or_else(|| message.header_as_record_batch()) else {
            return Err(broken("a message is neither a batch nor a dictionary"));
        };
        let rows = u64::try_from(batch.length());
        let rows = rows.map_err(|_| broken("a batch has fewer rows than none"))?;
        let metadata = i32::try_from(found.prefix + found.metadata.len() as u64);
        let metadata = metadata.map_err(|_| broken("the description of a message is too long"))?;
        let part = Part {
            block: Block::new(
                i64::try_from(found.at).unwrap_or(0),
                metadata,
                message.bodyLength(),
            ),
            rows,
            dictionary: message.header_type() == MessageHeader::DictionaryBatch,
        };
        if !part.dictionary {
            let most = (next - body).saturating_mul(8 * expansion(&batch));
            if rows > most {
                return Err(broken("a batch announces more rows than it has room for"));
            }
            self.rows += rows;
            count_missing(&self.schema, &batch, &mut self.missing)
                .ok_or_else(|| broken("a batch does not describe all columns"))?;
        }
        self.parts.push(part);
        Ok(next)
    }

    /// Bytes of the largest batch, which is decoded at once.
    pub fn largest(&self) -> u64 {
        let bytes = self
            .parts
            .iter()
            .map(|part| part.block.bodyLength().unsigned_abs());
        bytes.max().unwrap_or(0)
    }

    /// Calls `take` with each batch of the named fields, in order. Batches are decoded on all
    /// threads.
    pub fn batches(
        &self,
        fields: &[usize],
        run: &dyn Run,
        take: &mut dyn FnMut(&RecordBatch) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let mut decoder = FileDecoder::new(Arc::clone(&self.schema), self.version)
            .with_projection(fields.to_vec());
        let mut at = 0;
        let mut done = 0;
        while let Some(first) = self.parts.get(at) {
            if run.cancelled() {
                return Err(Failure::cancelled());
            }
            if first.dictionary {
                let bytes = self.load(first)?;
                decode(&self.name, || decoder.read_dictionary(&first.block, &bytes))?;
                at += 1;
                continue;
            }
            let mut size = 0;
            let group = self.parts[at..].iter().take_while(|part| {
                let room = size < GROUP;
                size += part.block.bodyLength().unsigned_abs();
                room && !part.dictionary
            });
            let count = group.count().max(1);
            let group = &self.parts[at..at + count];
            let batches = run::map(run, count, &|i| self.batch(&decoder, &group[i]));
            for (batch, part) in batches.into_iter().zip(group) {
                take(&batch?)?;
                done += part.rows;
            }
            run.progress(done as f64 / self.rows.max(1) as f64, "reading")?;
            at += count;
        }
        Ok(())
    }

    fn batch(&self, decoder: &FileDecoder, part: &Part) -> Result<RecordBatch, Failure> {
        let bytes = self.load(part)?;
        let batch = decode(&self.name, || {
            decoder.read_record_batch(&part.block, &bytes)
        })?;
        batch
            .filter(|batch| batch.num_rows() as u64 == part.rows)
            .ok_or_else(|| damaged(format!("{} has a batch without its rows", self.name)))
    }

    /// A message with its body, after its buffers have been found to lie within it.
    fn load(&self, part: &Part) -> Result<Buffer, Failure> {
        let size = u64::from(part.block.metaDataLength().unsigned_abs())
            + part.block.bodyLength().unsigned_abs();
        let size = usize::try_from(size)
            .map_err(|_| damaged(format!("{} has a batch that is too large", self.name)))?;
        let mut bytes = vec![0; size];
        read_at(&self.file, part.block.offset().unsigned_abs(), &mut bytes)
            .map_err(|error| damaged(format!("{} cannot be read on: {error}", self.name)))?;
        let (metadata, body) = bytes.split_at(part.block.metaDataLength().unsigned_abs() as usize);
        sound(metadata, body).ok_or_else(|| {
            damaged(format!(
                "{} has a batch that lies about its size",
                self.name
            ))
        })?;
        Ok(Buffer::from_vec(bytes))
    }
}

/// Whether all buffers of a batch lie in its body and do not expand beyond their compression.
fn sound(metadata: &[u8], body: &[u8]) -> Option<()> {
    let message = parse(metadata)?;
    let batch = match message.header_as_dictionary_batch() {
        Some(dictionary) => dictionary.data()?,
        None => message.header_as_record_batch()?,
    };
    let most = expansion(&batch);
    for buffer in batch.buffers()?.iter() {
        let begin = usize::try_from(buffer.offset()).ok()?;
        let end = begin.checked_add(usize::try_from(buffer.length()).ok()?)?;
        let stored = body.get(begin..end)?;
        if batch.compression().is_some()
            && let Some((length, stored)) = stored.split_first_chunk::<8>()
        {
            let length = i64::from_le_bytes(*length);
            let room = (stored.len() as u64)
                .saturating_mul(most)
                .saturating_add(1 << 17);
            if length != -1 && u64::try_from(length).ok()? > room {
                return None;
            }
        }
    }
    Some(())
}

fn parse(metadata: &[u8]) -> Option<Message<'_>> {
    let length = u32::from_le_bytes(*metadata.first_chunk()?);
    let skip = if length == CONTINUES { 8 } else { 4 };
    root_as_message(metadata.get(skip..)?).ok()
}

/// The most that a batch's compression can expand.
fn expansion(batch: &Announced<'_>) -> u64 {
    match batch.compression().map(|compression| compression.codec()) {
        None => 1,
        Some(CompressionType::LZ4_FRAME) => 256,
        // 128 KiB of one byte in four bytes.
        Some(_) => 33_000,
    }
}

/// Where the messages are.
fn bounds(name: &str, file: &File, length: u64, head: &[u8]) -> Result<(u64, u64), Failure> {
    if head.starts_with(b"FEA1") {
        return Err(unsupported(
            format!("{name} is a Feather file of version 1"),
            "write it again as version 2",
        ));
    }
    if !head.starts_with(MAGIC) {
        return Ok((0, length));
    }
    let mut tail = [0; 10];
    let whole = length >= 24 && read_at(file, length - 10, &mut tail).is_ok();
    let [size @ .., _, _, _, _, _, _] = tail;
    let footer = u64::from(u32::from_le_bytes(size));
    let end = (length.saturating_sub(10)).checked_sub(footer);
    match end.filter(|end| whole && tail.ends_with(MAGIC) && *end >= 8) {
        Some(end) => Ok((first_message(file, end), end)),
        None => Err(damaged(format!("{name} is an Arrow file without its end"))),
    }
}

/// Writers pad the first magic word to 8 bytes or more.
fn first_message(file: &File, end: u64) -> u64 {
    let mut at = 8;
    let mut word = [0; 8];
    while at < end.min(4096) && read_at(file, at, &mut word).is_ok() && word == [0; 8] {
        at += 8;
    }
    at
}

/// The message at a place; none where the stream ends.
fn message(name: &str, file: &File, at: u64, end: u64) -> Result<Option<Found>, Failure> {
    if at == end {
        return Ok(None);
    }
    let broken = |what: &str| damaged(format!("{name}, byte {at}: {what}"));
    let mut head = [0; 8];
    if end - at < 8 {
        let rest = usize::try_from(end - at).unwrap_or(0);
        let read = read_at(file, at, &mut head[..rest]).is_ok();
        return match read && rest == 4 && head == [0; 8] {
            true => Ok(None),
            false => Err(broken("a message is cut off")),
        };
    }
    read_at(file, at, &mut head).map_err(|error| broken(&error.to_string()))?;
    let [a, b, c, d, w, x, y, z] = head;
    let first = u32::from_le_bytes([a, b, c, d]);
    let (prefix, size) = match first {
        CONTINUES => (8, u32::from_le_bytes([w, x, y, z])),
        // Before version 0.15 there was no mark.
        size => (4, size),
    };
    if size == 0 {
        return Ok(None);
    }
    let size = u64::from(size);
    if size > MOST_METADATA || size > end - at - prefix {
        let foreign = at == 0;
        return Err(match foreign {
            true => not_mine(name, "Arrow IPC"),
            false => broken("a message is cut off"),
        });
    }
    let mut metadata = vec![0; usize::try_from(size).unwrap_or(0)];
    read_at(file, at + prefix, &mut metadata).map_err(|error| broken(&error.to_string()))?;
    Ok(Some(Found {
        at,
        prefix,
        metadata,
    }))
}

/// Adds the missing values that a batch announces, field by field.
fn count_missing(schema: &Schema, batch: &Announced<'_>, missing: &mut [u64]) -> Option<()> {
    let nodes = batch.nodes()?;
    let mut node = 0;
    for (field, missing) in schema.fields().iter().zip(missing) {
        if node >= nodes.len() {
            return None;
        }
        *missing += u64::try_from(nodes.get(node).null_count()).ok()?;
        node += count_nodes(field.data_type(), 0);
    }
    Some(())
}

fn count_nodes(type_: &DataType, depth: usize) -> usize {
    if depth > 64 {
        return 1;
    }
    let below = |type_: &DataType| count_nodes(type_, depth + 1);
    1 + match type_ {
        DataType::List(field)
        | DataType::LargeList(field)
        | DataType::ListView(field)
        | DataType::LargeListView(field)
        | DataType::FixedSizeList(field, _)
        | DataType::Map(field, _) => below(field.data_type()),
        DataType::Struct(fields) => fields.iter().map(|field| below(field.data_type())).sum(),
        DataType::Union(fields, _) => fields
            .iter()
            .map(|(_, field)| below(field.data_type()))
            .sum(),
        DataType::RunEndEncoded(ends, values) => {
            below(ends.data_type()) + below(values.data_type())
        }
        _ => 0,
    }
}
