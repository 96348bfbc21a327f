//! Objects as tests make and read them.

use crate::memory::Memory;
use puncta_sdk::documents::{self, ColumnInfo, Element};
use puncta_sdk::serde_json::Value;
use puncta_sdk::{Failure, Figure, Header, Kind};

/// An object: a header and the memory of its columns.
#[derive(Clone, Debug)]
pub struct Object {
    /// What it is.
    pub header: Header,
    pub(crate) memory: Vec<Vec<Memory>>,
}

macro_rules! numbers {
    ($($name:ident: $type:ty, $element:ident;)*) => {
        $(
            /// Numbers of a column of the first part.
            ///
            /// # Errors
            /// When there is no such column, or it has another type.
            pub fn $name(&self, name: &str) -> Result<Vec<$type>, Failure> {
                self.numbers(0, name, Element::$element, <$type>::from_ne_bytes)
            }
        )*
    };
}

impl Object {
    numbers! {
        f64: f64, F64;
        f32: f32, F32;
        u32: u32, U32;
        i32: i32, I32;
        i64: i64, I64;
        u64: u64, U64;
        u16: u16, U16;
    }

    /// Bytes of a column of u8 or bool of the first part.
    ///
    /// # Errors
    /// When there is no such column.
    pub fn bytes(&self, name: &str) -> Result<Vec<u8>, Failure> {
        let (info, memory, rows) = self.find(0, name)?;
        let mut bytes = memory.bytes();
        bytes.truncate(rows * info.type_.row_bytes());
        Ok(bytes)
    }

    /// Numbers of a column of any part.
    ///
    /// # Errors
    /// When there is no such column, or it has another type.
    pub fn numbers<T, const N: usize>(
        &self,
        part: usize,
        name: &str,
        element: Element,
        read: fn([u8; N]) -> T,
    ) -> Result<Vec<T>, Failure> {
        let (info, memory, rows) = self.find(part, name)?;
        if info.type_.element != element {
            return Err(Failure::internal(format!(
                "column {name} is {}",
                info.type_
            )));
        }
        let count = rows * info.type_.width as usize;
        let bytes = memory.bytes();
        let (chunks, _) = bytes.as_chunks::<N>();
        Ok(chunks
            .iter()
            .take(count)
            .map(|chunk| read(*chunk))
            .collect())
    }

    /// Texts of a column of the first part.
    ///
    /// # Errors
    /// When there is no such column, or it holds numbers.
    pub fn texts(&self, name: &str) -> Result<Vec<String>, Failure> {
        let (info, memory, rows) = self.find(0, name)?;
        let text = |i: usize| -> String {
            let place = |i: usize| memory.offsets.get(i).map_or(0, |place| *place as usize);
            let bytes = memory.text.get(place(i)..place(i + 1)).unwrap_or(&[]);
            String::from_utf8_lossy(bytes).into_owned()
        };
        match info.type_.element {
            Element::Utf8 => Ok((0..rows).map(text).collect()),
            Element::Dictionary => {
                let codes = self.numbers(0, name, Element::Dictionary, u32::from_ne_bytes)?;
                Ok(codes.into_iter().map(|code| text(code as usize)).collect())
            }
            _ => Err(Failure::internal(format!(
                "column {name} is {}",
                info.type_
            ))),
        }
    }

    fn find(&self, part: usize, name: &str) -> Result<(&ColumnInfo, &Memory, usize), Failure> {
        let missing = || Failure::internal(format!("no column {name} in {}", self.header.name));
        let group = self.header.parts.get(part).ok_or_else(missing)?;
        let place = group
            .columns
            .iter()
            .position(|c| c.name == name)
            .ok_or_else(missing)?;
        let memory = self
            .memory
            .get(part)
            .and_then(|m| m.get(place))
            .ok_or_else(missing)?;
        Ok((
            &group.columns[place],
            memory,
            usize::try_from(group.rows).unwrap_or(0),
        ))
    }

    /// A figure with the tables that its series name, by output port.
    #[must_use]
    pub fn figure(figure: &Figure, tables: Vec<(&str, Object)>) -> Object {
        let mut header = Header::new(Kind::Figure, figure.output.clone());
        let text = documents::write(figure, documents::findings::FIGURE);
        header.document = puncta_sdk::serde_json::from_str(&text).ok();
        let mut memory = Vec::new();
        for (port, mut table) in tables {
            if !table.header.parts.is_empty() {
                let mut part = table.header.parts.swap_remove(0);
                part.name = port.into();
                header.parts.push(part);
                memory.push(table.memory.swap_remove(0));
            }
        }
        Object { header, memory }
    }

    /// An image of f32 values, x fastest.
    #[must_use]
    pub fn image(name: &str, image: puncta_sdk::ImageInfo, values: &[f32]) -> Object {
        let header = Header::image(name, image, Element::F32, "1");
        let mut memory = Memory::room(&header.parts[0].columns[0], values.len());
        fill(&mut memory.data, values, f32::to_ne_bytes);
        Object {
            header,
            memory: vec![vec![memory]],
        }
    }
}

fn fill<T: Copy, const N: usize>(words: &mut [u64], values: &[T], write: fn(T) -> [u8; N]) {
    let bytes: Vec<u8> = values.iter().flat_map(|value| write(*value)).collect();
    for (word, chunk) in words.iter_mut().zip(bytes.chunks(8)) {
        let mut whole = [0; 8];
        whole[..chunk.len()].copy_from_slice(chunk);
        *word = u64::from_ne_bytes(whole);
    }
}

/// A table, built column by column.
#[derive(Clone, Debug)]
pub struct Table(Object);

macro_rules! columns {
    ($($name:ident: $type:ty, $element:ident;)*) => {
        $(
            /// Adds a column.
            #[must_use]
            pub fn $name(self, name: &str, unit: &str, values: &[$type]) -> Table {
                let info = ColumnInfo::new(name, Element::$element, unit);
                self.add(info, values, <$type>::to_ne_bytes)
            }
        )*
    };
}

impl Table {
    /// A table without columns.
    #[must_use]
    pub fn new(name: &str) -> Table {
        Table(Object {
            header: Header::table(name, 0, Vec::new()),
            memory: vec![Vec::new()],
        })
    }

    columns! {
        f64: f64, F64;
        f32: f32, F32;
        u32: u32, U32;
        i32: i32, I32;
        i64: i64, I64;
        u64: u64, U64;
        u16: u16, U16;
        u8: u8, U8;
    }

    /// Adds a column of texts.
    #[must_use]
    pub fn texts(mut self, name: &str, values: &[&str]) -> Table {
        let bytes: usize = values.iter().map(|text| text.len()).sum();
        let info = ColumnInfo::new(name, Element::Utf8, "1").text_bytes(bytes as u64);
        let mut memory = Memory::room(&info, values.len());
        memory.text.clear();
        for (i, text) in values.iter().enumerate() {
            memory.text.extend_from_slice(text.as_bytes());
            memory.offsets[i + 1] = memory.text.len() as u64;
        }
        self.0.header.parts[0].rows = values.len() as u64;
        self.0.header.parts[0].columns.push(info);
        self.0.memory[0].push(memory);
        self
    }

    fn add<T: Copy, const N: usize>(
        mut self,
        info: ColumnInfo,
        values: &[T],
        write: fn(T) -> [u8; N],
    ) -> Table {
        let mut memory = Memory::room(&info, values.len());
        fill(&mut memory.data, values, write);
        self.0.header.parts[0].rows = values.len() as u64;
        self.0.header.parts[0].columns.push(info);
        self.0.memory[0].push(memory);
        self
    }

    /// Sets a member of the metadata.
    #[must_use]
    pub fn metadata(mut self, name: &str, value: impl Into<Value>) -> Table {
        self.0.header.metadata.insert(name.into(), value.into());
        self
    }

    /// The header, to be changed.
    pub fn header_mut(&mut self) -> &mut Header {
        &mut self.0.header
    }
}

impl From<Table> for Object {
    fn from(table: Table) -> Object {
        table.0
    }
}

/// What a call gave.
#[derive(Clone, Debug, Default)]
pub struct Done {
    /// Finished outputs, in the order in which they were finished.
    pub outputs: Vec<(String, Object)>,
    /// Figures and reports.
    pub documents: Vec<Value>,
    /// Messages for the log: level and text.
    pub messages: Vec<(u32, String)>,
}

impl Done {
    /// The output of a port.
    ///
    /// # Errors
    /// When it was not finished.
    pub fn output(&self, port: &str) -> Result<&Object, Failure> {
        self.outputs
            .iter()
            .find(|(name, _)| name == port)
            .map(|(_, object)| object)
            .ok_or_else(|| Failure::internal(format!("the call finished no output {port}")))
    }

    /// The entry of this name in the reports, if there is one.
    #[must_use]
    pub fn reported(&self, name: &str) -> Option<&Value> {
        let values = self.documents.iter().filter_map(|one| one.get("values"));
        let mut entries = values.filter_map(Value::as_array).flatten();
        entries.find(|entry| entry.get("name").is_some_and(|known| known == name))
    }

    /// The number of this name in the reports, if there is one; NaN if it is none.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<f64> {
        let entry = self.reported(name)?;
        let number = entry.get("value").and_then(Value::as_f64);
        Some(number.unwrap_or(f64::NAN))
    }

    /// All figures and reports, as text.
    #[must_use]
    pub fn text(&self) -> String {
        self.documents.iter().map(ToString::to_string).collect()
    }
}
