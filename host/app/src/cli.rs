//! The command line's fixed part; what depends on the installed plugins is added in `flags`.

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Name of the program in messages.
pub const NAME: &str = "puncta";
const ABOUT: &str = "Single-molecule localisation microscopy, by plugins";
const AFTER: &str = "\
Exit codes: 0 all done, 1 failed, 2 wrong usage, 3 some steps of a recipe failed, 130 stopped.";

/// The arguments.
#[derive(Debug, Parser)]
#[command(name = NAME, version, about = ABOUT, after_help = AFTER, max_term_width = 110)]
#[command(subcommand_help_heading = "Commands", disable_help_subcommand = true)]
pub struct Cli {
    #[command(flatten)]
    pub global: Global,
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// Options of every command.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Global options")]
pub struct Global {
    /// Folder with plugins, looked into before the others; may be given several times
    #[arg(long, global = true, value_name = "DIR")]
    pub plugins: Vec<PathBuf>,
    /// Threads for calculations; as many as the machine has if not given
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Run every plugin in a process of its own
    #[arg(long, global = true, conflicts_with = "in_process")]
    pub isolated: bool,
    /// Run every plugin in this process; one that insists on a process of its own is refused
    #[arg(long, global = true)]
    pub in_process: bool,
    /// Write the result, or the error, as JSON to the standard output
    #[arg(long, global = true)]
    pub json: bool,
    /// No progress and no notes
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what a file holds: objects, columns with units, ranges and sums, metadata
    Info(Info),
    /// Write an object of a file into another file; the suffix chooses the writer
    Convert(Convert),
    /// List the installed operations, readers and writers, or describe one
    Ops(Ops),
    /// Run one operation
    Op(Op),
    /// Run a recipe
    Run(Run),
    /// Check a recipe, show what would run, draw its graph
    #[command(subcommand)]
    Recipe(Recipe),
    /// Run a recipe on each of many files
    Batch(Batch),
    /// Make a saved file again from its provenance, and compare the bytes
    Replay(Replay),
    /// List plugins, trust them, switch them on and off, choose where they run, pack them
    #[command(subcommand)]
    Plugins(Plugins),
    /// Choose the reader of files that several readers know
    #[command(subcommand)]
    Readers(Readers),
    /// Serve calls over a socket on standard input
    #[command(hide = true)]
    Worker,
    /// Do one check of a library in this process
    #[command(hide = true)]
    CheckOne(CheckOne),
}

#[derive(Args, Debug)]
pub struct CheckOne {
    pub check: String,
    pub library: PathBuf,
    pub folder: PathBuf,
    pub strictness: u8,
    pub answer: PathBuf,
}

#[derive(Args, Debug)]
pub struct Info {
    /// File to read
    pub file: PathBuf,
    /// Reader to use; chosen by the file if not given
    #[arg(long, value_name = "ID")]
    pub reader: Option<String>,
}

#[derive(Args, Debug)]
pub struct Convert {
    /// File to read
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// File to write
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    /// Reader to use; chosen by the file if not given
    #[arg(long, value_name = "ID")]
    pub reader: Option<String>,
    /// Writer to use; chosen by the suffix if not given
    #[arg(long, value_name = "ID")]
    pub writer: Option<String>,
    /// Object to write, of a file that holds several; the first if not given
    #[arg(long, value_name = "NAME")]
    pub object: Option<String>,
    /// Replace OUT if it exists
    #[arg(long)]
    pub overwrite: bool,
}

#[derive(Args, Debug)]
pub struct Ops {
    /// Id of the one to describe; the newest revision if it has none
    pub name: Option<String>,
}

#[derive(Args, Debug)]
pub struct Op {
    /// Id of the operation; the newest revision if it has none
    pub name: String,
    /// Inputs: FILE, FILE:OBJECT or PORT=FILE; without PORT in the order of the ports
    #[arg(value_name = "INPUT")]
    pub inputs: Vec<String>,
    /// File for an output: OUT for the first, or PORT=OUT; may be given several times
    #[arg(long, short, value_name = "[PORT=]OUT")]
    pub output: Vec<String>,
    /// Parameter, also one whose name is that of another option
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// Reader to use for all inputs; chosen by the file if not given
    #[arg(long, value_name = "ID")]
    pub reader: Option<String>,
    /// Writer to use for all outputs; chosen by the suffix if not given
    #[arg(long, value_name = "ID")]
    pub writer: Option<String>,
    /// Replace outputs that exist
    #[arg(long)]
    pub overwrite: bool,
}

#[derive(Args, Clone, Debug)]
pub struct Run {
    /// The recipe
    pub recipe: PathBuf,
    /// File for an input of the recipe; may be given several times
    #[arg(long, short, value_name = "NAME=FILE")]
    pub input: Vec<String>,
    /// Parameter of a step for this run; may be given several times
    #[arg(long, value_name = "STEP.PARAM=VALUE")]
    pub set: Vec<String>,
    /// Folder for the files that the recipe writes; made if it is not there
    #[arg(long, short, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
    /// Replace files that exist
    #[arg(long)]
    pub overwrite: bool,
    /// Run again whenever the recipe, an input or a plugin changes, until it is stopped
    #[arg(long)]
    pub watch: bool,
}

#[derive(Debug, Subcommand)]
pub enum Recipe {
    /// Say everything that is wrong with a recipe, without running it
    Check {
        /// The recipe
        recipe: PathBuf,
    },
    /// Show what would run, in order, with all parameters
    Show {
        /// The recipe
        recipe: PathBuf,
    },
    /// Show what comes from what, as text or as an SVG
    Graph {
        /// The recipe
        recipe: PathBuf,
        /// SVG file to write
        #[arg(long, short, value_name = "OUT")]
        output: Option<PathBuf>,
        /// Replace OUT if it exists
        #[arg(long)]
        overwrite: bool,
    },
}

#[derive(Args, Debug)]
pub struct Batch {
    /// The recipe
    pub recipe: PathBuf,
    /// Files, each of which goes through the recipe by itself
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The input that the files are for; the only one that has no file if not given
    #[arg(long, value_name = "NAME")]
    pub each: Option<String>,
    /// File for another input, the same for all; may be given several times
    #[arg(long, short, value_name = "NAME=FILE")]
    pub input: Vec<String>,
    /// Parameter of a step; may be given several times
    #[arg(long, value_name = "STEP.PARAM=VALUE")]
    pub set: Vec<String>,
    /// Folder for results, record and report; made if it is not there
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Write one table of what the recipe writes as OUTPUT for each file, with a column for the file
    #[arg(long, value_name = "FILE=OUTPUT")]
    pub collect: Vec<String>,
    /// Files at once; each waits for memory as its plans ask for it
    #[arg(long, short, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub jobs: u8,
    /// Go on with a batch: leave out the files that are done and have not changed
    #[arg(long)]
    pub resume: bool,
    /// Replace files that exist
    #[arg(long)]
    pub overwrite: bool,
}

#[derive(Args, Debug)]
pub struct Replay {
    /// The file, with its provenance beside it
    pub file: PathBuf,
    /// File for an input, instead of the one on record; may be given several times
    #[arg(long, short, value_name = "NAME=FILE")]
    pub input: Vec<String>,
    /// Compute it also with inputs or plugins that are not as they were, and compare the values
    #[arg(long)]
    pub anyway: bool,
}

#[derive(Debug, Subcommand)]
pub enum Readers {
    /// List the choices
    List,
    /// Use a reader for a format
    Set {
        /// Name of the format as `info` shows it, or a suffix such as .csv
        format: String,
        /// Id of the reader
        reader: String,
    },
    /// Forget the choice for a format
    Clear {
        /// Name of the format, or a suffix
        format: String,
    },
}

#[derive(Debug, Subcommand)]
pub enum Plugins {
    /// List the installed plugins, what waits for consent, and what was refused with the reason
    List,
    /// Consent to a library that does not belong to this program, as it is now
    Trust {
        /// The library, or the id of a plugin that waits for consent
        #[arg(value_name = "PATH|ID")]
        what: String,
    },
    /// Use a plugin again
    Enable {
        /// Id of the plugin
        id: String,
    },
    /// Do not use a plugin
    Disable {
        /// Id of the plugin
        id: String,
    },
    /// Choose where the calls of a plugin run
    Mode {
        /// Id of the plugin
        id: String,
        /// A process of its own, this process, or as the host decides
        mode: Where,
    },
    /// Describe a library and write plugin.json beside it
    Pack {
        /// Libraries
        #[arg(required = true, value_name = "LIB")]
        libraries: Vec<PathBuf>,
    },
    /// Check a built library from outside: its tables, what it says of itself, and what its calls
    /// do with good, odd and hostile data; this runs its code
    Check(Check),
    /// Start a project for a plugin, with the SDK's sources in it
    New(New),
    /// Replace the SDK's sources in a plugin's project by those of this program
    UpdateSdk {
        /// The project's folder
        #[arg(value_name = "DIR", default_value = ".")]
        project: PathBuf,
    },
}

#[derive(Args, Debug)]
pub struct Check {
    /// The library, or a folder with one
    #[arg(value_name = "PATH", required_unless_present = "list")]
    pub path: Option<PathBuf>,
    /// How much is asked
    #[arg(long, value_name = "1..10", default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=10))]
    pub strictness: u8,
    /// Only this check and what it builds on; may be given several times
    #[arg(long, value_name = "TEST")]
    pub only: Vec<String>,
    /// List the checks
    #[arg(long)]
    pub list: bool,
}

#[derive(Args, Debug)]
pub struct New {
    /// Name of the plugin, such as nearest-neighbours; or its id, such as lab.nearest-neighbours
    pub name: String,
    /// What it begins with
    #[arg(long, default_value = "operation")]
    pub kind: ProjectKind,
    /// Language
    #[arg(long, default_value = "rust")]
    pub language: Language,
    /// Folder for the project; a folder of its name here if not given
    #[arg(long, value_name = "DIR")]
    pub to: Option<PathBuf>,
}

/// What a project begins with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ProjectKind {
    Operation,
    Reader,
    Writer,
}

/// Language of a project.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Language {
    Rust,
    C,
}

/// Where the calls of a plugin run.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum Where {
    Worker,
    InProcess,
    Default,
}
