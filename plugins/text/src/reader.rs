//! The reader as an operation.

use crate::columns::{ColumnMut, TextMut};
use crate::flavours::Flavour;
use crate::notes;
use crate::options::{Delimiter, Options};
use crate::piece;
use crate::read::Stop;
use crate::schema::{ColumnPlan, Kind, Plan as TablePlan};
use crate::table::Table;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Committer, output};
use puncta_shared_import::MappingParams;
use puncta_shared_import::mapping::parts;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

const EXAMPLE: &str = concat!(
    "\"id\",\"frame\",\"x [nm]\",\"y [nm]\",\"sigma [nm]\",\"intensity [photon]\",",
    "\"uncertainty_xy [nm]\"\n",
    "1,1,1200.5,840.25,130.1,1520,9.4\n",
    "2,1,2210.75,400.5,128.4,980,11.8\n",
    "3,2,1201.1,841,131.2,1433,9.7\n",
);
const SUFFIXES: &[&str] = &[
    ".csv", ".tsv", ".txt", ".xls", ".xyz", ".trxyt", ".malk", ".2d", ".3d", ".2dlp", ".3dlp",
];
const FORMATS: &[&str] = &[
    "ThunderSTORM csv",
    "PYME text",
    "vLUME text",
    "Zeiss ELYRA text",
    "SMLM challenge text",
    "SMAP text",
    "rapidSTORM text",
    "N-STORM text",
    "ONI Nanoimager text",
    "Vutara text",
    "VISP text",
    "MALK text",
    "DECODE csv text",
    "Micro-Manager spots text",
    "LEB text",
    "MOSAIC text",
    "TrackMate csv text",
    "evalSPT text",
    "trxyt text",
    "Spot-On text",
    "saspt text",
    "pyMINFLUX text",
    "Puncta text",
    "csv",
    "tsv",
];
/// How often the plan may change while a file is read, for each of its columns.
const CHANGES: usize = 4;

/// Reads a table of localisations from text with named columns.
#[derive(Debug, Params)]
pub struct ReadText {
    #[param(flatten)]
    mapping: MappingParams,
    /// Kind of file, where the file does not say it itself.
    #[param(default = Flavour::Auto)]
    dialect: Flavour,
    /// Columns that hold words even where they look like numbers, separated by commas.
    #[param(default = "")]
    text: String,
    /// What stands between values.
    #[param(default = Separator::Auto)]
    delimiter: Separator,
    /// Lines to leave out at the start of the file.
    #[param(default = 0, max = 1e9)]
    skip_rows: u64,
}

/// What stands between values.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// Reading: found out from the file. Writing: by its suffix.
    Auto,
    /// A comma.
    Comma,
    /// A tab.
    Tab,
    /// A semicolon.
    Semicolon,
    /// A vertical bar.
    Bar,
    /// Any run of blanks and tabs.
    Space,
}

impl Separator {
    /// The delimiter, if one is said.
    pub fn delimiter(self) -> Option<Delimiter> {
        Some(match self {
            Separator::Auto => return None,
            Separator::Comma => Delimiter::Byte(b','),
            Separator::Tab => Delimiter::Byte(b'\t'),
            Separator::Semicolon => Delimiter::Byte(b';'),
            Separator::Bar => Delimiter::Byte(b'|'),
            Separator::Space => Delimiter::Blanks,
        })
    }
}

impl ReadText {
    fn options(&self) -> Result<Options, Failure> {
        Ok(Options {
            mapping: self.mapping.mapping()?,
            dialect: self.dialect,
            text: parts(&self.text),
            delimiter: self.delimiter.delimiter(),
            skip_rows: self.skip_rows,
        })
    }
}

impl Operation for ReadText {
    const ID: &'static str = "puncta.text.read/1";

    fn info() -> Info {
        Info::reader("Text tables", SUFFIXES)
            .description(
                "Reads localisations and tracks from text: the tables of the field's programs, and \
                 any csv, tsv or blank-separated table with or without names.\n\
                 Names and units come from the header (`x [nm]`, `x (um)`, `x_nm`) and the kind of \
                 file; lengths become nm and frames count from 0. A unit that nobody says stays \
                 unknown until it is said here. A row that cannot be read is an error with its \
                 line; none is dropped.",
            )
            .formats(&[], FORMATS)
            .generic()
            .output(Ports::table("localisations").description("One row a line of the file."))
            .cite("10.1093/bioinformatics/btu202")
            .example(json!({}))
            .example_text("thunderstorm.csv", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let file = request.file.as_ref();
        let file = file.ok_or_else(|| Failure::internal("the call has no file"))?;
        let table = Table::open(Path::new(&file.path), &file.name, &self.options()?)?;
        let mut plan = Plan {
            interruptible: true,
            memory: table.copied_bytes() + 16 * piece::SIZE as u64,
            ..Plan::default()
        };
        plan.outputs.push(Output {
            output: "localisations".into(),
            form: OutputForm::Object,
            of: None,
            header: header(&table),
        });
        plan.probe = Some(Probe {
            format: format(&table),
            confidence: confidence(&table),
        });
        plan.notes = notes::notes(&table);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let file = job.file()?;
        let mut table = Table::open(Path::new(&file.path), &file.name, &self.options()?)?;
        for _ in 0..=CHANGES * table.plan.columns.len() {
            let mut out = job.begin("localisations", header(&table))?;
            let ahead = Ahead::new(out.committer(), &table.plan);
            ahead.reach(0)?;
            let read = {
                let columns = out.columns_mut(0)?.into_iter().map(column);
                let mut columns: Vec<ColumnMut<'_>> = columns.collect::<Result<_, _>>()?;
                table.read(&mut columns, job, &|rows| ahead.reach(rows))
            };
            match read {
                Ok(rows) => {
                    ahead.reach(rows)?;
                    return out.finish_rows(&[rows]);
                }
                Err(Stop::Failed(failure)) => return Err(failure),
                Err(Stop::Replan(change)) => table.plan.apply(&change),
            }
        }
        Err(Failure::internal("the types of the columns do not settle"))
    }
}

/// A column of the host as the core fills it.
fn column(column: output::ColumnMut<'_>) -> Result<ColumnMut<'_>, Failure> {
    Ok(match column {
        output::ColumnMut::F64(s) => ColumnMut::F64(s),
        output::ColumnMut::F32(s) => ColumnMut::F32(s),
        output::ColumnMut::I64(s) => ColumnMut::I64(s),
        output::ColumnMut::I32(s) => ColumnMut::I32(s),
        output::ColumnMut::I16(s) => ColumnMut::I16(s),
        output::ColumnMut::I8(s) => ColumnMut::I8(s),
        output::ColumnMut::U64(s) => ColumnMut::U64(s),
        output::ColumnMut::U32(s) => ColumnMut::U32(s),
        output::ColumnMut::U16(s) => ColumnMut::U16(s),
        output::ColumnMut::U8(s) | output::ColumnMut::Bool(s) => ColumnMut::U8(s),
        output::ColumnMut::Utf8(texts) => ColumnMut::Text(TextMut::new(texts.offsets, texts.bytes)),
        output::ColumnMut::Dictionary(..) => {
            return Err(Failure::internal("a dictionary was not asked for"));
        }
    })
}

fn header(table: &Table) -> Header {
    let info = |plan: &ColumnPlan| {
        let element = Element::from_name(plan.kind.name()).unwrap_or(Element::F64);
        let mut info = ColumnInfo::new(&plan.name, element, &plan.unit).source(&plan.source);
        info.role.clone_from(&plan.role);
        if let Some(remedy) = &plan.remedy {
            info.rest.insert("remedy".into(), remedy.clone().into());
        }
        if !plan.description.is_empty() {
            info = info.description(&plan.description);
        }
        if plan.kind == Kind::Text {
            info = info.text_bytes(table.text_room());
        }
        info
    };
    let columns = table.plan.columns.iter().map(info).collect();
    let mut header = Header::table("localisations", table.plan.max_rows, columns);
    header
        .metadata
        .insert("format".into(), format(table).into());
    if table.dialect.flavour.tracks() && table.has("track") {
        header.shape = Some("tracks".into());
    }
    if !table.settings().is_empty() {
        let settings = table.settings().iter();
        let settings: Map = settings
            .map(|(name, value)| (name.clone(), value.clone().into()))
            .collect();
        header.metadata.insert("settings".into(), settings.into());
    }
    if !table.dialect.comments.is_empty() {
        header
            .metadata
            .insert("comments".into(), table.dialect.comments.clone().into());
    }
    header
}

fn format(table: &Table) -> String {
    let tab = table.dialect.delimiter == Delimiter::Byte(b'\t');
    match table.dialect.flavour {
        Flavour::Auto if tab => "tsv".into(),
        Flavour::Auto => "csv".into(),
        Flavour::Thunderstorm => "ThunderSTORM csv".into(),
        other => format!("{} text", other.label()),
    }
}

fn confidence(table: &Table) -> f64 {
    match table.dialect.flavour {
        // Below a half: it cannot be told.
        _ if table.dialect.assumed => 0.4,
        Flavour::Auto if table.dialect.nameless => 0.2,
        Flavour::Auto if table.has("x") && table.has("y") => 0.6,
        Flavour::Auto => 0.3,
        _ => 0.95,
    }
}

/// Commits memory a little ahead of the rows that are complete: a full machine is told in time, and
/// no thread waits for the memory of the whole table.
struct Ahead<'j> {
    committer: Committer<'j>,
    step: u64,
    room: u64,
    committed: Mutex<u64>,
}

impl<'j> Ahead<'j> {
    fn new(committer: Committer<'j>, plan: &TablePlan) -> Ahead<'j> {
        Ahead {
            committer,
            step: (plan.expected_rows / 16).clamp(1 << 12, 1 << 20),
            room: plan.max_rows,
            committed: Mutex::new(0),
        }
    }

    fn reach(&self, rows: u64) -> Result<(), Failure> {
        let mut committed = self
            .committed
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let wanted = rows.saturating_add(self.step).min(self.room);
        if wanted >= committed.saturating_add(self.step / 2) || rows > *committed {
            self.committer.commit(0, wanted - *committed)?;
            *committed = wanted;
        }
        Ok(())
    }
}

register!(ReadText);
