//! Objects: immutable columns with a header, shared between the objects that are made from them.

use super::gather;
use super::region::Region;
use super::segment::Segment;
use puncta_documents::{ColumnInfo, ColumnType, Failure, Header, Kind};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Memory of one column: plain, contiguous, sealed.
#[derive(Clone, Debug)]
pub struct ColumnData {
    /// Type.
    pub type_: ColumnType,
    /// Number of rows.
    pub rows: u64,
    /// Numbers or codes.
    pub data: Option<Region>,
    /// Offsets of texts.
    pub offsets: Option<Region>,
    /// Text bytes.
    pub text: Option<Region>,
    /// Entries of a dictionary.
    pub entries: u64,
}

impl ColumnData {
    /// Bytes of all its regions.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let regions = [&self.data, &self.offsets, &self.text];
        regions.into_iter().flatten().map(Region::bytes).sum()
    }
}

/// Row numbers of another table, strictly increasing.
#[derive(Clone, Debug)]
pub struct Selection {
    rows: Region,
    count: u64,
}

impl Selection {
    /// Takes a finished column of u32.
    ///
    /// # Errors
    /// When the numbers do not increase strictly or reach `rows` of the table that they select from.
    pub fn new(column: &ColumnData, of: u64) -> Result<Selection, Failure> {
        let region = column
            .data
            .clone()
            .ok_or_else(|| Failure::internal("an empty selection"))?;
        let rows = region.slice::<u32>();
        let ordered = rows.windows(2).all(|pair| pair[0] < pair[1]);
        if !ordered || rows.last().is_some_and(|last| u64::from(*last) >= of) {
            return Err(Failure::internal(
                "the selection's row numbers do not increase, or leave the table",
            ));
        }
        Ok(Selection {
            count: rows.len() as u64,
            rows: region,
        })
    }

    /// The row numbers.
    #[must_use]
    pub fn rows(&self) -> &[u32] {
        self.rows.slice()
    }

    /// How many.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }
}

/// A column of an object: memory, perhaps seen through a selection.
#[derive(Debug)]
pub struct Stored {
    /// Memory of all rows.
    data: ColumnData,
    /// Which of them this object has.
    via: Option<Arc<Selection>>,
    /// The selected rows, once somebody asked for them.
    gathered: OnceLock<ColumnData>,
    gathering: Mutex<()>,
}

impl Stored {
    /// A column of all rows of its memory.
    #[must_use]
    pub fn whole(data: ColumnData) -> Arc<Stored> {
        Stored::new(data, None)
    }

    fn new(data: ColumnData, via: Option<Arc<Selection>>) -> Arc<Stored> {
        Arc::new(Stored {
            data,
            via,
            gathered: OnceLock::new(),
            gathering: Mutex::new(()),
        })
    }

    /// Plain contiguous memory of the object's rows; gathered once if it is a selection.
    ///
    /// # Errors
    /// When there is no memory for it.
    pub fn column(&self) -> Result<&ColumnData, Failure> {
        let Some(selection) = &self.via else {
            return Ok(&self.data);
        };
        if let Some(column) = self.gathered.get() {
            return Ok(column);
        }
        let _one = self
            .gathering
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some(column) = self.gathered.get() {
            return Ok(column);
        }
        let column = gather::gather(&self.data, selection)?;
        Ok(self.gathered.get_or_init(|| column))
    }

    /// Bytes that the gathered copy takes; 0 before anybody asked for it.
    #[must_use]
    pub fn gathered_bytes(&self) -> u64 {
        self.gathered.get().map_or(0, ColumnData::bytes)
    }

    fn segments<'a>(&'a self, into: &mut BTreeMap<u64, &'a Arc<Segment>>) {
        let columns = [Some(&self.data), self.gathered.get()];
        for column in columns.into_iter().flatten() {
            for region in [&column.data, &column.offsets, &column.text]
                .into_iter()
                .flatten()
            {
                into.insert(region.segment().id(), region.segment());
            }
        }
        if let Some(selection) = &self.via {
            into.insert(selection.rows.segment().id(), selection.rows.segment());
        }
    }
}

/// A table, image, mesh, figure or report. Immutable; clones share the columns.
#[derive(Clone, Debug)]
pub struct Object {
    header: Arc<Header>,
    parts: Vec<Vec<Arc<Stored>>>,
}

impl Object {
    /// An object of columns.
    ///
    /// # Errors
    /// When header and columns do not agree.
    pub fn new(header: Header, parts: Vec<Vec<Arc<Stored>>>) -> Result<Object, Failure> {
        let fits = header.parts.len() == parts.len()
            && header
                .parts
                .iter()
                .zip(&parts)
                .all(|(p, c)| p.columns.len() == c.len());
        if !fits {
            return Err(Failure::internal(format!(
                "{} does not fit its header",
                header.name
            )));
        }
        Ok(Object {
            header: Arc::new(header),
            parts,
        })
    }

    /// A figure or a report.
    #[must_use]
    pub fn document(kind: Kind, name: &str, document: serde_json::Value) -> Object {
        let mut header = Header::new(kind, name);
        header.document = Some(document);
        Object {
            header: Arc::new(header),
            parts: Vec::new(),
        }
    }

    /// This figure with the tables that its series name as parts, each named by its output port.
    /// `table` finds the table of a port; no column is copied.
    #[must_use]
    pub fn with_tables<'a>(&self, table: impl Fn(&str) -> Option<&'a Object>) -> Object {
        let (mut header, mut parts) = ((*self.header).clone(), self.parts.clone());
        let series = header.document.as_ref().and_then(|d| d.get("series"));
        let series = series.and_then(serde_json::Value::as_array).cloned();
        let ports = series.iter().flatten().filter_map(|one| one.get("table"));
        for port in ports.filter_map(serde_json::Value::as_str) {
            if header.parts.iter().any(|part| part.name == port) {
                continue;
            }
            let Some(object) = table(port).filter(|one| one.header.kind == Kind::Table) else {
                continue;
            };
            if let (Some(group), Some(columns)) =
                (object.header.parts.first(), object.parts.first())
            {
                let mut group = group.clone();
                port.clone_into(&mut group.name);
                header.parts.push(group);
                parts.push(columns.clone());
            }
        }
        Object {
            header: Arc::new(header),
            parts,
        }
    }

    /// What it is.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The header, shared.
    #[must_use]
    pub fn shared_header(&self) -> Arc<Header> {
        Arc::clone(&self.header)
    }

    /// Columns of a part.
    #[must_use]
    pub fn columns(&self, part: usize) -> &[Arc<Stored>] {
        self.parts.get(part).map_or(&[], |columns| columns)
    }

    /// A column of a part by name; every table has a virtual column `row`, its row numbers.
    ///
    /// # Errors
    /// When there is none of that name (the sentence lists those that there are), or no memory.
    pub fn column(&self, part: usize, name: &str) -> Result<ColumnData, Failure> {
        let missing = || {
            let names: Vec<&str> = self
                .header
                .parts
                .get(part)
                .map(|p| p.columns.iter().map(|c| c.name.as_str()).collect())
                .unwrap_or_default();
            let message = format!("{} has no column {name}", self.name());
            Failure::bad_input(message).remedy(format!("it has {}", names.join(", ")))
        };
        let group = self.header.parts.get(part).ok_or_else(missing)?;
        match group.columns.iter().position(|column| column.name == name) {
            Some(place) => self.parts[part][place].column().cloned(),
            None if name == "row" && matches!(self.header.kind, Kind::Table | Kind::Figure) => {
                gather::row_numbers(group.rows)
            }
            None => Err(missing()),
        }
    }

    fn name(&self) -> &str {
        if self.header.name.is_empty() {
            "the object"
        } else {
            &self.header.name
        }
    }

    /// This table with columns added, or replaced where the name is the same.
    ///
    /// # Errors
    /// When the numbers of rows differ.
    pub fn with_columns(&self, columns: Vec<(ColumnInfo, Arc<Stored>)>) -> Result<Object, Failure> {
        let mut header = (*self.header).clone();
        let mut parts = self.parts.clone();
        let (Some(group), Some(stored)) = (header.parts.first_mut(), parts.first_mut()) else {
            return Err(Failure::internal(
                "columns are added to an object without rows",
            ));
        };
        for (info, column) in columns {
            let rows = column
                .via
                .as_ref()
                .map_or(column.data.rows, |selection| selection.count());
            if rows != group.rows {
                let message = format!("column {} has {rows} rows, not {}", info.name, group.rows);
                return Err(Failure::internal(message));
            }
            match group
                .columns
                .iter()
                .position(|known| known.name == info.name)
            {
                Some(place) => {
                    group.columns[place] = info;
                    stored[place] = column;
                }
                None => {
                    group.columns.push(info);
                    stored.push(column);
                }
            }
        }
        Ok(Object {
            header: Arc::new(header),
            parts,
        })
    }

    /// The selected rows of this table. No column is copied.
    ///
    /// # Errors
    /// When selections of selections do not compose, for lack of memory.
    pub fn select(&self, selection: &Arc<Selection>) -> Result<Object, Failure> {
        let mut header = (*self.header).clone();
        let group = header
            .parts
            .first_mut()
            .ok_or_else(|| Failure::internal("a selection of an object without rows"))?;
        group.rows = selection.count();
        // Columns that came through the same selection share the composed one.
        let mut composed: Vec<(*const Selection, Arc<Selection>)> = Vec::new();
        let mut columns = Vec::with_capacity(group.columns.len());
        for stored in &self.parts[0] {
            let via = match &stored.via {
                None => Arc::clone(selection),
                Some(first) => {
                    let known = composed
                        .iter()
                        .find(|(of, _)| std::ptr::eq(*of, &raw const **first));
                    if let Some((_, both)) = known {
                        Arc::clone(both)
                    } else {
                        let both = Arc::new(gather::compose(first, selection)?);
                        composed.push((Arc::as_ptr(first), Arc::clone(&both)));
                        both
                    }
                }
            };
            columns.push(Stored::new(stored.data.clone(), Some(via)));
        }
        Ok(Object {
            header: Arc::new(header),
            parts: vec![columns],
        })
    }

    /// This object with one column in another unit.
    ///
    /// # Errors
    /// When there is no such column of numbers, or no memory.
    pub fn converted(&self, name: &str, factor: f64, unit: &str) -> Result<Object, Failure> {
        let info = self
            .header
            .column(name)
            .ok_or_else(|| Failure::bad_input(format!("{} has no column {name}", self.name())))?;
        let column = gather::scaled(&self.column(0, name)?, factor)?;
        let mut info = info.clone();
        info.type_ = column.type_;
        unit.clone_into(&mut info.unit);
        self.with_columns(vec![(info, Stored::whole(column))])
    }

    /// This object under another header of the same columns.
    #[must_use]
    pub fn with_header(&self, change: impl FnOnce(&mut Header)) -> Object {
        let mut header = (*self.header).clone();
        change(&mut header);
        Object {
            header: Arc::new(header),
            parts: self.parts.clone(),
        }
    }

    /// Bytes of all memory that it holds alive, shared or not.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let mut segments = BTreeMap::new();
        for stored in self.parts.iter().flatten() {
            stored.segments(&mut segments);
        }
        segments.values().map(|segment| segment.bytes()).sum()
    }
}
