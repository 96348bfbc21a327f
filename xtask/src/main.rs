//! `cargo xtask`: builds the bundle, runs the tests, the demonstration and the benchmarks.

mod abi;
mod args;
mod bench;
mod build;
mod demo;
mod files;
mod layout;
mod package;
mod process;
mod sdk;
mod test;
mod tools;
mod workspace;

use std::process::ExitCode;

use process::{complain, say};

const HELP: &str = "\
Usage: cargo xtask COMMAND

Commands:
  demo [--release]        build the bundle, simulate an endoplasmic reticulum, filter it and render it
  test [--all]            formatting, lints, build, bundle and every test (--all: the slow ones too)
  build [--release]       lay the movable bundle in target/puncta
  bench [--compare ...]   build in release mode and run the benchmarks; arguments are passed on
  package                 a release bundle as target/package/puncta-VERSION-PLATFORM.tar.gz
  sdk DIR                 lay the SDK of plugin authors alone
  abi                     rewrite the snapshot of the plugin ABI and its C header, and say what changed

The bundle needs CMake 3.26 or newer; where there is none, one is installed under target/tools with pip.
";

/// What the command line asks for; anything that is not a command is answered with the help.
const USAGE_ERROR: u8 = 2;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args_os()
        .skip(1)
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    let Some((command, rest)) = arguments.split_first() else {
        complain(HELP.trim_end());
        return ExitCode::from(USAGE_ERROR);
    };
    let outcome = match command.as_str() {
        "demo" => demo::run(rest),
        "test" => test::run(rest),
        "build" => build::run(rest),
        "bench" => bench::run(rest),
        "package" => package::run(rest),
        "abi" => abi::run(rest),
        "sdk" => sdk::run(rest),
        "help" | "--help" | "-h" => {
            say(HELP.trim_end());
            Ok(())
        }
        other => Err(args::Usage::error(format!("there is no command '{other}'"))),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<args::Usage>() => {
            complain(&format!("xtask: {error}\n\n{}", HELP.trim_end()));
            ExitCode::from(USAGE_ERROR)
        }
        Err(error) => {
            complain(&format!("xtask: {error:#}"));
            ExitCode::FAILURE
        }
    }
}
