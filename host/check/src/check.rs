//! The checks: what each asks, from which strictness on, and what must hold before it means anything.

use serde::{Deserialize, Serialize};

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// It holds.
    Passed,
    /// It does not hold.
    Failed,
    /// The process of the check died, or did not come back in time.
    Crashed,
    /// It holds, but somebody should look at it.
    Warning,
    /// There was nothing to ask, or what it builds on failed.
    Skipped,
}

/// What a check found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Id of the check.
    pub check: String,
    /// How it ended.
    pub status: Status,
    /// What was found, as one sentence without a full stop; empty if it passed without remark.
    #[serde(default)]
    pub sentence: String,
    /// Time that it took.
    pub seconds: f64,
}

macro_rules! checks {
    ($($check:ident $id:literal $level:literal [$($need:ident),*] $sentence:literal;)*) => {
        /// One thing that is asked of a plugin.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Check {
            $(#[doc = $sentence] $check,)*
        }

        impl Check {
            /// All checks, in the order in which they run.
            pub const ALL: &'static [Check] = &[$(Check::$check),*];

            /// Id, for `--only`.
            #[must_use]
            pub fn id(self) -> &'static str {
                match self { $(Check::$check => $id,)* }
            }

            /// What it asks, as one sentence.
            #[must_use]
            pub fn sentence(self) -> &'static str {
                match self { $(Check::$check => $sentence,)* }
            }

            /// The least strictness that includes it.
            #[must_use]
            pub fn level(self) -> u8 {
                match self { $(Check::$check => $level,)* }
            }

            /// What must hold before it means anything.
            #[must_use]
            pub fn needs(self) -> &'static [Check] {
                match self { $(Check::$check => &[$(Check::$need),*],)* }
            }
        }
    };
}

checks! {
    Whole "whole" 1 []
        "The file is a whole dynamic library for this system and this processor.";
    Symbol "symbol" 1 [Whole]
        "The library exports the symbol of this host's ABI number, and of no other.";
    SymbolKind "symbol-kind" 2 [Symbol]
        "The exported symbol is data with room for the table, not a function.";
    Opens "opens" 1 [Symbol]
        "The system opens the library and finds every other library that it needs.";
    Tables "tables" 1 [Opens]
        "The exported table has the size and the ABI number of this host's.";
    Functions "functions" 1 [Tables]
        "The functions describe, create, destroy and get are all there.";
    Door "door" 1 [Opens]
        "A plugin in Rust was built with the same layout of every table as this host.";
    Describe "describe" 1 [Functions, Door]
        "The plugin describes itself by a valid document.";
    Needs "needs" 1 [Describe]
        "The plugin needs no table that this host does not have.";
    Create "create" 1 [Needs]
        "An instance can be made, and the table call/1 is there if there are operations.";
    DescribeAgain "describe-again" 2 [Create]
        "The plugin describes itself by the same text each time, also after it has run.";
    QuickToOpen "quick-to-open" 3 [Create]
        "Opening the library and describing it takes less than a second.";
    PluginId "plugin-id" 1 [Describe]
        "The plugin's id is lower-case words with dots between them.";
    OperationIds "operation-ids" 1 [Describe]
        "Every operation's id is lower-case, begins with the plugin's and ends with a revision, as /1.";
    Sorted "sorted" 2 [Describe]
        "Operations stand in the manifest once each, sorted by id.";
    Titles "titles" 2 [Describe]
        "The plugin and each operation have a title and a description.";
    Help "help" 3 [Describe]
        "Each parameter and each value of a choice has one line of help.";
    Version "version" 2 [Describe]
        "The version is three numbers, and there is a licence.";
    Isolation "isolation" 1 [Describe]
        "The isolation is none or worker.";
    PortNames "port-names" 1 [Describe]
        "Ports have different names in lower case, and outputs that belong to an input name one that there is.";
    PortsOfKind "ports-of-kind" 1 [Describe]
        "Readers have no inputs, writers one input and no outputs, operations an output.";
    Units "units" 1 [Describe]
        "Every unit of a port or a parameter is one that the host knows.";
    ParameterNames "parameter-names" 1 [Describe]
        "Parameters of an operation have different names in snake_case.";
    Limits "limits" 1 [Describe]
        "Limits of parameters are in order, kinds are known, and choices have values.";
    Defaults "defaults" 1 [Describe, Limits]
        "Every default is a value that the parameter itself allows.";
    ColumnNeeds "column-needs" 1 [Describe]
        "A port that takes a column's name from a parameter names a column parameter that there is.";
    FileRules "file-rules" 1 [Describe]
        "Readers and writers name their suffixes in lower case with the dot, and first bytes as hexadecimal digits.";
    Examples "examples" 1 [Defaults]
        "Every operation declares an example with parameters that it allows and inputs that it has.";
    GetUnknown "get-unknown" 2 [Create]
        "A table that the plugin does not have, and a name that only begins like one, is answered with null.";
    GetAgain "get-again" 3 [Create]
        "A table has the same address each time that it is asked for.";
    NullPlaces "null-places" 6 [Create]
        "Places that are null are refused instead of written to.";
    CreateAgain "create-again" 3 [Create]
        "A second instance beside the first can be made and ended.";
    PoorHost "poor-host" 4 [Create]
        "A host without the tables that the plugin needs is refused and not followed.";
    FutureHost "future-host" 2 [Create]
        "A host of a later version with a longer table and further tables is accepted.";
    Plans "plans" 1 [Create, Defaults, Examples, ColumnNeeds]
        "The example's request is answered with a plan that reads columns which there are.";
    ExampleRuns "example-runs" 1 [Plans]
        "The example runs and gives its outputs.";
    OutputsDeclared "outputs-declared" 2 [ExampleRuns]
        "What a call gives is what the manifest declares: ports, kinds and forms.";
    OutputsValid "outputs-valid" 2 [ExampleRuns]
        "Outputs have known units, whole texts, ascending selections, and documents that can be read.";
    ProgressRange "progress" 3 [ExampleRuns]
        "Progress is reported as a fraction between 0 and 1.";
    UnknownOperation "unknown-operation" 3 [Create]
        "An operation that the plugin does not have is refused.";
    FutureRequest "future-request" 2 [ExampleRuns]
        "A request with members of a later version is planned like one without.";
    AtLimits "at-limits" 4 [ExampleRuns]
        "Each parameter at its least and greatest value and each choice works or is refused with a reason.";
    BeyondLimits "beyond-limits" 5 [ExampleRuns]
        "Parameters beyond their limits, of a wrong type or missing are planned or refused, and nothing else.";
    EmptyTable "empty-table" 3 [ExampleRuns]
        "A table without rows works or is refused with a reason.";
    OneRow "one-row" 3 [ExampleRuns]
        "A table of one row works or is refused with a reason.";
    NotANumber "not-a-number" 4 [ExampleRuns]
        "Columns full of NaN, and with some NaN, work or are refused with a reason.";
    Infinite "infinite" 4 [ExampleRuns]
        "Infinite, huge and tiny values work or are refused with a reason.";
    MissingColumns "missing-columns" 3 [ExampleRuns]
        "A table without a column that is needed is refused with a reason.";
    OptionalInputs "optional-inputs" 3 [ExampleRuns]
        "Inputs that may be left out may be left out.";
    Reasons "reasons" 5 [BeyondLimits, EmptyTable, MissingColumns]
        "A call that fails says why in one sentence that the person can use.";
    BadRequests "bad-requests" 5 [UnknownOperation, AtLimits, BeyondLimits, MissingColumns, OptionalInputs]
        "Random and damaged requests are refused or planned, and nothing else.";
    LargeTable "large-table" 4 [ExampleRuns]
        "Ten million rows, or as many as half a second allows, work.";
    PrepareQuick "prepare-quick" 4 [Plans]
        "A plan for a billion rows is made in less than a second, so that recipes can be checked.";
    PlanAgain "plan-again" 4 [ExampleRuns]
        "A plan can be run more than once, or dropped without being run.";
    AnyThread "any-thread" 4 [ExampleRuns]
        "A call may be prepared, run and dropped on different threads.";
    ReadsWithin "reads-within" 5 [ExampleRuns]
        "Nothing is read outside the input columns.";
    WrongTypes "wrong-types" 5 [ReadsWithin]
        "Columns of other number types are read as what they are, or refused with a reason.";
    InputsUnchanged "inputs-unchanged" 2 [ExampleRuns]
        "Inputs are never written to.";
    WritesWithin "writes-within" 3 [ExampleRuns]
        "Nothing is written outside the output columns: neither into their padding nor beyond.";
    SameAgain "same-again" 3 [ExampleRuns]
        "A second run gives the same bits.";
    WritesAll "writes-all" 4 [SameAgain]
        "Every value of an output is written, whatever its memory held before.";
    SameWithThreads "same-with-threads" 4 [SameAgain]
        "One, two and three threads give the same bits.";
    SameInWorker "same-in-worker" 4 [AnyThread, SameAgain, InputsUnchanged]
        "The engine gets the same bits from a worker process.";
    Reentrant "reentrant" 5 [SameAgain]
        "A plugin that says it is reentrant gives the same bits from two calls at once.";
    CancelSoon "cancel-soon" 4 [LargeTable]
        "A call that says it can be interrupted is back soon after it was cancelled.";
    CancelSaid "cancel-said" 4 [ExampleRuns]
        "A cancelled call says that it was cancelled, or that it was already done.";
    NoMemory "no-memory" 5 [ExampleRuns]
        "A host that has no memory for an output is a reason to fail, not to crash.";
    PanicContained "panic-contained" 3 [UnknownOperation]
        "A panic of the plugin reaches the host as a status: the library was built to unwind.";
    MemoryReturned "memory-returned" 6 [ExampleRuns]
        "Memory does not grow with the number of calls.";
    NothingOpen "nothing-open" 5 [ExampleRuns]
        "No file, thread or process is left over after the calls.";
    NoLateCalls "no-late-calls" 6 [ExampleRuns]
        "The host is not called for a call that has returned.";
    Quiet "quiet" 5 [ExampleRuns]
        "Nothing is written to the standard output and the standard error.";
    ProcessKept "process-kept" 5 [ExampleRuns]
        "The process's folder, environment, signals and rounding of numbers are as they were.";
    Probes "probes" 2 [ExampleRuns]
        "A reader names the format of its own example and how certain it is, from 0 to 1.";
    OthersFiles "others-files" 3 [Create]
        "A reader says no to files of every other format.";
    DamagedFiles "damaged-files" 5 [ExampleRuns]
        "A reader survives its own file cut short and with wrong bytes.";
    WriterWrites "writer-writes" 2 [ExampleRuns]
        "A writer writes the file that it was told to write.";
    WriterFails "writer-fails" 4 [WriterWrites]
        "A writer that cannot write says so.";
}

impl Check {
    /// The check with this id.
    #[must_use]
    pub fn of(id: &str) -> Option<Check> {
        Check::ALL.iter().copied().find(|check| check.id() == id)
    }

    /// Seconds after which its process is ended.
    #[must_use]
    pub fn seconds(self) -> u64 {
        match self {
            Check::Whole | Check::Symbol | Check::SymbolKind => 10,
            Check::LargeTable | Check::ExampleRuns => 120,
            _ => 60,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checks_are_told_apart_and_build_on_earlier_ones() {
        assert!(Check::ALL.len() >= 40);
        for (place, check) in Check::ALL.iter().enumerate() {
            assert_eq!(Check::of(check.id()), Some(*check));
            assert!(check.sentence().ends_with('.') && !check.sentence().contains('\n'));
            assert!((1..=10).contains(&check.level()));
            for need in check.needs() {
                let earlier = Check::ALL.iter().position(|one| one == need);
                assert!(earlier.is_some_and(|earlier| earlier < place), "{check:?}");
                assert!(need.level() <= check.level(), "{check:?} needs {need:?}");
            }
        }
    }
}
