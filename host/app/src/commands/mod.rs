//! The commands.

mod batch;
mod check;
mod convert;
mod info;
mod op;
mod ops;
mod plugins;
mod project;
mod readers;
mod recipe;
mod replay;
mod run;

pub use check::one as check_one;

use crate::cli::Command;
use crate::context::Context;
use crate::exit::Ended;
use crate::flags::{self, Owner};
use crate::grammar;
use clap::ArgMatches;
use puncta_engine::Engine;
use puncta_engine::documents::{Failure, Map, Operation, OperationKind};

/// Runs a command. `matches` holds what was given for flags that come from schemas.
pub fn run(context: &Context, command: &Command, matches: &ArgMatches) -> Result<Ended, Failure> {
    match command {
        Command::Info(info) => {
            info::run(context, info, &options(context, matches, Owner::Operation))
        }
        Command::Convert(convert) => {
            let given = convert::Given {
                either: options(context, matches, Owner::Either),
                reader: options(context, matches, Owner::Reader),
                writer: options(context, matches, Owner::Writer),
            };
            convert::run(context, convert, given)
        }
        Command::Ops(ops) => ops::run(context, ops),
        Command::Op(op) => {
            let operation = operation(&context.engine, &op.name)?;
            let given = op::Given {
                parameters: flags::given(matches, &operation.parameters, Owner::Operation),
                reader: options(context, matches, Owner::Reader),
                writer: options(context, matches, Owner::Writer),
            };
            op::run(context, op, operation, given)
        }
        Command::Run(run) => run::run(context, run),
        Command::Recipe(recipe) => recipe::run(context, recipe),
        Command::Batch(batch) => batch::run(context, batch),
        Command::Replay(replay) => replay::run(context, replay),
        Command::Readers(readers) => readers::run(context, readers),
        Command::Plugins(plugins) => plugins::run(context, plugins),
        Command::Worker | Command::CheckOne(_) => Ok(Ended::Done),
    }
}

/// The operation with this id, or whose id ends so.
fn operation<'a>(engine: &'a Engine, id: &str) -> Result<&'a Operation, Failure> {
    match grammar::find(engine.catalogue(), id)? {
        Some(operation) => Ok(operation),
        None => engine.operation(id).map(|(_, operation)| operation),
    }
}

/// What was given for options of readers and writers.
fn options(context: &Context, matches: &ArgMatches, owner: Owner) -> Map {
    let all = || {
        context
            .engine
            .catalogue()
            .operations()
            .map(|(_, operation)| operation)
    };
    let of = |kind| flags::union(all().filter(move |operation| operation.kind == kind));
    let parameters = match owner {
        Owner::Operation | Owner::Reader => of(OperationKind::Reader),
        Owner::Writer => of(OperationKind::Writer),
        Owner::Either => grammar::either(&of(OperationKind::Reader), &of(OperationKind::Writer)),
    };
    flags::given(matches, &parameters, owner)
}
