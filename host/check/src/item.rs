//! Objects as plain bytes: what inputs are made of and what outputs are compared as.

use crate::memory::{Around, Block};
use puncta_abi::Column;
use puncta_engine::Object;
use puncta_engine::documents::{ColumnInfo, Element, Failure, Header};
use puncta_engine::store::{ColumnData, Layout, Region, Segment, Stored, region};
use std::io::{self, Read, Write};
use std::path::Path;

/// The content of one column.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cells {
    /// Numbers or codes.
    pub data: Vec<u8>,
    /// Offsets of texts as bytes.
    pub offsets: Vec<u8>,
    /// Text bytes.
    pub text: Vec<u8>,
    /// Entries of a dictionary.
    pub entries: u64,
}

/// An object.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// What it is.
    pub header: Header,
    /// Columns by part.
    pub parts: Vec<Vec<Cells>>,
}

impl Item {
    /// The content of an object of the engine.
    ///
    /// # Errors
    /// When there is no memory to gather it.
    pub fn of(object: &Object) -> Result<Item, Failure> {
        let bytes = |region: &Option<puncta_engine::store::Region>| {
            region
                .as_ref()
                .map_or_else(Vec::new, |region| region.slice::<u8>().to_vec())
        };
        let mut parts = Vec::new();
        for part in 0..object.header().parts.len() {
            let mut columns = Vec::new();
            for stored in object.columns(part) {
                let column = stored.column()?;
                columns.push(Cells {
                    data: bytes(&column.data),
                    offsets: bytes(&column.offsets),
                    text: bytes(&column.text),
                    entries: column.entries,
                });
            }
            parts.push(columns);
        }
        Ok(Item {
            header: object.header().clone(),
            parts,
        })
    }

    /// An object of the engine with this content.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn object(&self) -> Result<Object, Failure> {
        let mut header = self.header.clone();
        let groups = header.parts.iter_mut().zip(&self.parts);
        for (group, columns) in groups {
            for (info, cells) in group.columns.iter_mut().zip(columns) {
                info.text_bytes = Some(cells.text.len() as u64);
                if info.type_.element == Element::Dictionary {
                    info.entries = Some(cells.entries);
                }
            }
        }
        let layout = Layout::of(&header)?;
        let segment = Segment::create(layout.bytes)?;
        let put = |offset: u64, bytes: &[u8]| {
            // SAFETY: a fresh segment with room for the layout, which nothing else uses.
            #[allow(unsafe_code)]
            let room = unsafe { region::writable::<u8>(segment.base(), offset, bytes.len()) };
            room.copy_from_slice(bytes);
        };
        let places = layout.parts.iter().flatten();
        for (place, cells) in places.zip(self.parts.iter().flatten()) {
            put(place.data, &cells.data);
            put(place.offsets, &cells.offsets);
            put(place.text, &cells.text);
        }
        let segment = segment.seal(layout.bytes)?;
        let mut parts = Vec::new();
        for (places, (group, columns)) in layout
            .parts
            .iter()
            .zip(self.header.parts.iter().zip(&self.parts))
        {
            let mut stored = Vec::new();
            for (place, (info, cells)) in places.iter().zip(group.columns.iter().zip(columns)) {
                let piece = |offset: u64, bytes: &[u8], there: bool| {
                    there
                        .then(|| Region::new(&segment, offset, bytes.len() as u64))
                        .transpose()
                };
                let element = info.type_.element;
                stored.push(Stored::whole(ColumnData {
                    type_: info.type_,
                    rows: group.rows,
                    data: piece(place.data, &cells.data, element != Element::Utf8)?,
                    offsets: piece(place.offsets, &cells.offsets, element.is_text())?,
                    text: piece(place.text, &cells.text, element.is_text())?,
                    entries: cells.entries,
                }));
            }
            parts.push(stored);
        }
        Object::new(self.header.clone(), parts)
    }

    /// Writes it to a file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        let mut file = io::BufWriter::new(std::fs::File::create(path)?);
        let mut block = |bytes: &[u8]| -> io::Result<()> {
            file.write_all(&(bytes.len() as u64).to_le_bytes())?;
            file.write_all(bytes)
        };
        block(&serde_json::to_vec(&self.header)?)?;
        for cells in self.parts.iter().flatten() {
            for bytes in [&cells.data, &cells.offsets, &cells.text] {
                block(bytes)?;
            }
            block(&cells.entries.to_le_bytes())?;
        }
        file.flush()
    }

    /// Reads what [`Item::save`] wrote.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn load(path: &Path) -> io::Result<Item> {
        let mut file = io::BufReader::new(std::fs::File::open(path)?);
        let mut block = || -> io::Result<Vec<u8>> {
            let mut size = [0; 8];
            file.read_exact(&mut size)?;
            let size = usize::try_from(u64::from_le_bytes(size)).map_err(io::Error::other)?;
            let mut bytes = vec![0; size];
            file.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        let header: Header = serde_json::from_slice(&block()?)?;
        let mut parts = Vec::new();
        for part in &header.parts {
            let mut columns = Vec::new();
            for _ in &part.columns {
                let (data, offsets, text, entries) = (block()?, block()?, block()?, block()?);
                let entries = entries.try_into().map_or(0, u64::from_le_bytes);
                columns.push(Cells {
                    data,
                    offsets,
                    text,
                    entries,
                });
            }
            parts.push(columns);
        }
        Ok(Item { header, parts })
    }

    /// Rows of the first part.
    pub fn rows(&self) -> u64 {
        self.header.rows()
    }
}

/// Memory of one column of a call.
#[derive(Debug)]
pub struct Live {
    data: Block,
    offsets: Block,
    text: Block,
    entries: u64,
}

/// Texts that a column has room for.
fn texts(info: &ColumnInfo, rows: u64) -> u64 {
    match info.type_.element {
        Element::Utf8 => rows + 1,
        Element::Dictionary => info.entries.unwrap_or(0) + 1,
        _ => 0,
    }
}

impl Live {
    /// A column with this content.
    pub fn of(cells: &Cells, around: Around) -> Option<Live> {
        Some(Live {
            data: Block::of(&cells.data, around)?,
            offsets: Block::of(&cells.offsets, around)?,
            text: Block::of(&cells.text, around)?,
            entries: cells.entries,
        })
    }

    /// Room for so many rows.
    pub fn room(info: &ColumnInfo, rows: u64, fill: u8, around: Around) -> Option<Live> {
        let bytes = rows.checked_mul(info.type_.row_bytes() as u64)?;
        let count = texts(info, rows);
        let text = if count > 0 {
            info.text_bytes.unwrap_or(0)
        } else {
            0
        };
        let block = |bytes: u64| Block::new(usize::try_from(bytes).ok()?, fill, around);
        let offsets = block(count.checked_mul(8)?)?;
        if count > 0 {
            // SAFETY: room for at least one offset, which the ABI says is 0.
            #[allow(unsafe_code)]
            unsafe {
                offsets.pointer().cast::<u64>().write(0);
            }
        }
        Some(Live {
            data: block(bytes)?,
            offsets,
            text: block(text)?,
            entries: info.entries.unwrap_or(0),
        })
    }

    /// As the ABI shows it.
    pub fn column(&self, info: &ColumnInfo, rows: u64) -> Column {
        let element = info.type_.element;
        let at = |block: &Block, there: bool| {
            if there {
                block.pointer()
            } else {
                std::ptr::null_mut()
            }
        };
        Column {
            data: at(&self.data, element != Element::Utf8),
            offsets: at(&self.offsets, element.is_text()).cast(),
            text: at(&self.text, element.is_text()),
            rows,
            entries: self.entries,
            text_bytes: self.text.content().len() as u64,
            kind: element.code(),
            width: info.type_.width,
        }
    }

    /// The first `rows` rows.
    ///
    /// # Errors
    /// What is wrong with its texts or codes.
    pub fn take(&self, info: &ColumnInfo, rows: u64, entries: u64) -> Result<Cells, String> {
        let first = |block: &Block, bytes: u64| {
            let all = block.content();
            all.get(..usize::try_from(bytes).unwrap_or(usize::MAX))
                .unwrap_or(all)
                .to_vec()
        };
        let mut cells = Cells {
            data: first(&self.data, rows * info.type_.row_bytes() as u64),
            ..Cells::default()
        };
        let element = info.type_.element;
        if element.is_text() && rows > 0 {
            let count = if element == Element::Utf8 {
                rows
            } else {
                entries
            };
            cells.entries = if element == Element::Utf8 { 0 } else { entries };
            cells.offsets = first(&self.offsets, (count + 1) * 8);
            let places = numbers(&cells.offsets);
            let end = places.last().copied().unwrap_or(0);
            let ordered = places.windows(2).all(|pair| pair[0] <= pair[1]);
            if places.len() as u64 != count + 1
                || !ordered
                || places.first() != Some(&0)
                || end > self.text.content().len() as u64
            {
                return Err(format!(
                    "the offsets of the texts of {} are wrong",
                    info.name
                ));
            }
            cells.text = first(&self.text, end);
            if std::str::from_utf8(&cells.text).is_err() {
                return Err(format!("the texts of {} are no UTF-8", info.name));
            }
        }
        if element == Element::Dictionary {
            let (codes, _) = cells.data.as_chunks::<4>();
            if codes
                .iter()
                .any(|code| u64::from(u32::from_le_bytes(*code)) >= entries)
            {
                return Err(format!("a code of {} points behind its texts", info.name));
            }
        }
        Ok(cells)
    }

    /// Copies the content of a smaller one.
    pub fn copy_from(&mut self, old: &Live) {
        for (to, from) in [
            (&self.data, &old.data),
            (&self.offsets, &old.offsets),
            (&self.text, &old.text),
        ] {
            let count = to.content().len().min(from.content().len());
            // SAFETY: both blocks are that long, and they differ.
            #[allow(unsafe_code)]
            unsafe {
                std::ptr::copy_nonoverlapping(from.pointer(), to.pointer(), count);
            }
        }
    }

    /// Whether nothing was written around it.
    pub fn whole(&self) -> bool {
        self.data.whole() && self.offsets.whole() && self.text.whole()
    }

    /// Whether it still has this content.
    pub fn is(&self, cells: &Cells) -> bool {
        self.data.content() == cells.data
            && self.offsets.content() == cells.offsets
            && self.text.content() == cells.text
    }

    /// Makes every write to it end the process.
    pub fn protect(&self) {
        for block in [&self.data, &self.offsets, &self.text] {
            block.protect();
        }
    }
}

/// Bytes as u64.
pub fn numbers(bytes: &[u8]) -> Vec<u64> {
    let (chunks, _) = bytes.as_chunks::<8>();
    chunks
        .iter()
        .map(|chunk| u64::from_le_bytes(*chunk))
        .collect()
}
