//! The events of the XML, column by column. Entities that a file declares are never expanded: a
//! file with a document type is refused.

use puncta_sdk::{Failure, Run};
use puncta_shared_records::{damaged, not_mine, unsupported};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::HashMap;
use std::io::BufRead;

/// Columns that spots may have.
const MOST_COLUMNS: usize = 512;

/// What kind of file it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `<TrackMate>` with all spots and the links between them.
    Model,
    /// `<Tracks>` with the detections of each particle.
    Simple,
}

/// A feature as the model declares it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Feature {
    /// Such as POSITION, LENGTH, TIME, NONE.
    pub dimension: String,
    /// Whole numbers.
    pub whole: bool,
    /// In words.
    pub label: String,
}

/// A column.
#[derive(Debug)]
pub struct Column {
    /// Name of the attribute.
    pub name: String,
    /// A value a row; NaN where there is none.
    pub values: Vec<f64>,
}

/// What a file holds.
#[derive(Debug)]
pub struct Parsed {
    /// Its kind.
    pub kind: Kind,
    /// Columns in the order in which they came up.
    pub columns: Vec<Column>,
    /// Rows.
    pub rows: usize,
    /// The track of each row; -1 for spots without one.
    pub tracks: Vec<i64>,
    /// Tracks there are.
    pub count: i64,
    /// Declared features by attribute.
    pub features: HashMap<String, Feature>,
    /// Unit of lengths.
    pub space: String,
    /// Unit of times.
    pub time: String,
    /// Attributes of the root.
    pub root: Vec<(String, String)>,
    /// Spots with values that are no numbers.
    pub odd: u64,
}

struct Parse<'a> {
    name: &'a str,
    parsed: Parsed,
    /// The track of a spot, by its id.
    linked: HashMap<i64, i64>,
    track: i64,
    spots_only: bool,
}

/// Reads a file. With `most`, reading ends after so many rows.
pub fn parse(
    name: &str,
    from: impl BufRead,
    most: Option<usize>,
    run: &dyn Run,
) -> Result<Parsed, Failure> {
    let mut reader = Reader::from_reader(from);
    let mut buffer = Vec::new();
    let mut state: Option<Parse<'_>> = None;
    let (mut depth, mut events) = (0_usize, 0_u64);
    loop {
        buffer.clear();
        events += 1;
        if events.is_multiple_of(4096) && run.cancelled() {
            return Err(Failure::cancelled());
        }
        let at = reader.buffer_position();
        let event = reader.read_event_into(&mut buffer);
        let event = event.map_err(|error| match &state {
            Some(_) => damaged(format!("{name} is no valid XML at byte {at}: {error}")),
            None => not_mine(name, "TrackMate file"),
        })?;
        match event {
            Event::DocType(_) => {
                let message = format!("{name} declares entities, which are not read");
                return Err(unsupported(message, "export it from TrackMate again"));
            }
            Event::Start(ref tag) | Event::Empty(ref tag) => {
                match &mut state {
                    None => state = Some(begin(name, tag)?),
                    Some(state) => state.open(tag)?,
                }
                if matches!(event, Event::Start(_)) {
                    depth += 1;
                }
            }
            Event::End(_) => depth = depth.saturating_sub(1),
            Event::Eof => break,
            _ => {}
        }
        if let Some(state) = &state
            && most.is_some_and(|most| state.parsed.rows >= most)
        {
            depth = 0;
            break;
        }
    }
    let state = state.ok_or_else(|| not_mine(name, "TrackMate file"))?;
    if depth > 0 {
        return Err(damaged(format!("{name} ends too early")));
    }
    Ok(state.finish())
}

fn begin<'a>(name: &'a str, tag: &BytesStart<'_>) -> Result<Parse<'a>, Failure> {
    let kind = match tag.name().as_ref() {
        "TrackMate" => Kind::Model,
        "Tracks" => Kind::Simple,
        _ => return Err(not_mine(name, "TrackMate file")),
    };
    let mut root = Vec::new();
    for attribute in tag.attributes() {
        let attribute = attribute.map_err(|error| damaged(format!("{name}: {error}")))?;
        let value = attribute.value.chars().take(1000).collect();
        root.push((attribute.key.as_ref().to_owned(), value));
    }
    let said = |key: &str| {
        let found = root
            .iter()
            .find(|(known, _): &&(String, String)| known == key);
        found.map_or_else(String::new, |(_, value)| value.clone())
    };
    let parsed = Parsed {
        kind,
        columns: Vec::new(),
        rows: 0,
        tracks: Vec::new(),
        count: 0,
        features: HashMap::new(),
        space: said("spaceUnits"),
        time: said("timeUnits"),
        root,
        odd: 0,
    };
    Ok(Parse {
        name,
        parsed,
        linked: HashMap::new(),
        track: -1,
        spots_only: true,
    })
}

impl Parse<'_> {
    fn open(&mut self, tag: &BytesStart<'_>) -> Result<(), Failure> {
        match (self.parsed.kind, tag.name().as_ref()) {
            (Kind::Simple, "particle") => {
                self.track = self.parsed.count;
                self.parsed.count += 1;
            }
            (Kind::Simple, "detection") => {
                self.row(tag)?;
                self.parsed.tracks.push(self.track);
            }
            (Kind::Model, "Model") => {
                self.parsed.space = self.text(tag, "spatialunits")?;
                self.parsed.time = self.text(tag, "timeunits")?;
            }
            (Kind::Model, "Feature") if self.spots_only => self.feature(tag)?,
            (Kind::Model, "EdgeFeatures" | "TrackFeatures") => self.spots_only = false,
            (Kind::Model, "Spot") => self.row(tag)?,
            (Kind::Model, "Track") => {
                let number = self.text(tag, "TRACK_ID")?;
                self.track = number.parse().unwrap_or(self.parsed.count);
                self.parsed.count += 1;
            }
            (Kind::Model, "Edge") => {
                for end in ["SPOT_SOURCE_ID", "SPOT_TARGET_ID"] {
                    if let Ok(spot) = self.text(tag, end)?.parse() {
                        self.linked.insert(spot, self.track);
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn text(&self, tag: &BytesStart<'_>, name: &str) -> Result<String, Failure> {
        let value = tag.try_get_attribute(name);
        let value = value.map_err(|error| damaged(format!("{}: {error}", self.name)))?;
        Ok(value.map_or_else(String::new, |value| {
            value.value.chars().take(1000).collect()
        }))
    }

    fn feature(&mut self, tag: &BytesStart<'_>) -> Result<(), Failure> {
        if self.parsed.features.len() < MOST_COLUMNS {
            let feature = Feature {
                dimension: self.text(tag, "dimension")?,
                whole: self.text(tag, "isint")? == "true",
                label: self.text(tag, "name")?,
            };
            self.parsed
                .features
                .insert(self.text(tag, "feature")?, feature);
        }
        Ok(())
    }

    /// Adds the attributes of a spot as a row.
    fn row(&mut self, tag: &BytesStart<'_>) -> Result<(), Failure> {
        let row = self.parsed.rows;
        let columns = &mut self.parsed.columns;
        for (guess, attribute) in tag.attributes().with_checks(false).enumerate() {
            let attribute = attribute
                .map_err(|error| damaged(format!("{}: {error}", self.name)).row(row as u64 + 1))?;
            let key = attribute.key.as_ref();
            if key == "name" {
                continue;
            }
            // Spots have their attributes in the same order, but for the name.
            let near = guess.saturating_sub(1)..(guess + 1).min(columns.len());
            let known = near.clone().find(|at| columns[*at].name == key);
            let known = known.or_else(|| columns.iter().position(|column| column.name == key));
            let place = match known {
                Some(place) => place,
                None if columns.len() < MOST_COLUMNS => {
                    columns.push(Column {
                        name: key.to_owned(),
                        values: vec![f64::NAN; row],
                    });
                    columns.len() - 1
                }
                None => continue,
            };
            let value = attribute.value.trim().parse().unwrap_or_else(|_| {
                self.parsed.odd += 1;
                f64::NAN
            });
            let values = &mut columns[place].values;
            values.truncate(row);
            values.push(value);
        }
        self.parsed.rows += 1;
        for column in columns {
            column.values.resize(row + 1, f64::NAN);
        }
        Ok(())
    }

    fn finish(mut self) -> Parsed {
        if self.parsed.kind == Kind::Model {
            let ids = self
                .parsed
                .columns
                .iter()
                .find(|column| column.name == "ID");
            let ids = ids.map_or(&[][..], |column| &column.values);
            #[allow(clippy::cast_possible_truncation)]
            let track = |id: &f64| self.linked.get(&(*id as i64)).copied().unwrap_or(-1);
            self.parsed.tracks = ids.iter().map(track).collect();
            self.parsed.tracks.resize(self.parsed.rows, -1);
        }
        self.parsed
    }
}
