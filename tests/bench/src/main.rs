//! Timings of the product: `cargo xtask bench [CASE...] [--peers FILE] [--compare] [--save]`.
//!
//! Each case runs in a process of its own, after a warm-up, on files that other programs can read
//! too (`BENCH_DATA`, else a simulated set that the bench makes). `--peers FILE` takes lines
//! `name program seconds megabytes digest ...` and prints ratios; `--save` writes the figures to
//! `tests/bench/figures.json`, `--compare` shows the change against that file.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::unwrap_used,
    clippy::expect_used
)]

mod calls;
mod cases;
mod data;
mod figures;
mod surfaces;

use figures::Figure;
use std::process::Command;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, name] = arguments.as_slice()
        && flag == "--case"
    {
        let figure = cases::run(name);
        println!("{}", figure.to_json());
        return;
    }
    let mut wanted = Vec::new();
    let (mut compare, mut save, mut peers) = (false, false, None);
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        match argument.as_str() {
            "--compare" => compare = true,
            "--save" => save = true,
            "--peers" => peers = rest.next().cloned(),
            name => wanted.push(name.to_owned()),
        }
    }
    let mut figures = Vec::new();
    for name in cases::names() {
        let chosen = wanted.is_empty() || wanted.iter().any(|part| name.contains(part.as_str()));
        if !chosen {
            continue;
        }
        let program = std::env::current_exe().expect("the bench's own path");
        let output = Command::new(program)
            .args(["--case", name])
            .output()
            .expect("a process");
        let text = String::from_utf8_lossy(&output.stdout);
        match Figure::from_json(text.trim()) {
            Some(figure) => {
                println!("{figure}");
                figures.push(figure);
            }
            None => eprintln!(
                "{name} failed: {}",
                String::from_utf8_lossy(&output.stderr).trim()
            ),
        }
    }
    if let Some(path) = peers {
        figures::print_ratios(&figures, &path);
    }
    if compare {
        figures::print_change(&figures);
    }
    if save {
        figures::save(&figures);
    }
}
