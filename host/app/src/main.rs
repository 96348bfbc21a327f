//! Puncta's command line.

mod cli;
mod commands;
mod context;
mod early;
mod exit;
mod flags;
mod grammar;
mod objects;
mod output;
mod page;
mod saved;
mod usage;
mod watch;

use cli::{Cli, Command, NAME};
use context::Context;
use early::Early;
use exit::Ended;
use output::Output;
use puncta_engine::Engine;
use puncta_engine::documents::Failure;
use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;

fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    let early = early::look(&arguments);
    let code = match run(arguments, &early) {
        Ok(ended) => ended.code(),
        Err(failure) => exit::report(&failure, early.json, &Output::default()),
    };
    ExitCode::from(code)
}

fn run(arguments: Vec<OsString>, early: &Early) -> Result<Ended, Failure> {
    let grammar = grammar::grammar(early)?;
    let words = std::iter::once(OsString::from(NAME))
        .chain(arguments)
        .collect();
    let words = flags::join_switches(words, &grammar.switches);
    let parsed = grammar.command.try_get_matches_from(words);
    let (cli, matches) = match parsed.and_then(|mut matches| {
        let kept = matches.clone();
        Ok((
            <Cli as clap::FromArgMatches>::from_arg_matches_mut(&mut matches)?,
            kept,
        ))
    }) {
        Ok(read) => read,
        Err(error) => {
            Output::default().text(&usage::refused(&error)?)?;
            return Ok(Ended::Done);
        }
    };
    let Some(command) = cli.command else {
        return welcome();
    };
    if let Command::Worker = command {
        watch::leave_interrupts_to_the_host();
        puncta_engine::worker::serve(cli.global.threads.map_or(1, usize::from))?;
        return Ok(Ended::Done);
    }
    let mut options = context::options(&cli.global)?;
    if let Command::Replay(_) = command {
        // A result that was kept proves nothing.
        options.results = 0;
    }
    if let Command::CheckOne(one) = &command {
        return commands::check_one(one, options);
    }
    let watch = watch::Watch::new(watch::signals(), cli.global.quiet);
    let context = Context {
        engine: Arc::new(Engine::open(options)?),
        output: Output::default(),
        watch: Arc::new(watch),
        json: cli.global.json,
    };
    tell_of_crashes(&context);
    let matches = matches.subcommand().map(|(_, matches)| matches);
    commands::run(
        &context,
        &command,
        matches.unwrap_or(&clap::ArgMatches::default()),
    )
}

/// Says once that earlier sessions ended inside a plugin.
fn tell_of_crashes(context: &Context) {
    let Context { engine, watch, .. } = context;
    if let Some(failure) = engine.crash_trouble() {
        watch.note(&failure.to_string());
    }
    let news = engine.crashes().filter(|crash| !crash.told);
    let news: Vec<String> = news.map(|crash| crash.sentence()).collect();
    if watch.quiet() || news.is_empty() {
        return;
    }
    news.iter().for_each(|text| watch.note(text));
    if let Err(failure) = engine.told_of_crashes() {
        watch.note(&failure.to_string());
    }
}

/// Without a command: what there is.
fn welcome() -> Result<Ended, Failure> {
    let help = <Cli as clap::CommandFactory>::command().render_help();
    let viewer = "The viewer is not in this version.";
    Output::default().text(&format!("{help}\n{viewer}\n"))?;
    Ok(Ended::Done)
}
