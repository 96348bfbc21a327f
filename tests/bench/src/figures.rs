//! Figures: printing, saving, comparing.

use serde_json::{Map, Value, json};
use std::fmt;
use std::path::PathBuf;

/// What a case measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Case, named as the other programs' measurement is.
    pub name: String,
    /// Median wall time in seconds.
    pub seconds: f64,
    /// Fastest and slowest.
    pub range: [f64; 2],
    /// Peak memory of the process in MB.
    pub megabytes: f64,
    /// What was computed, to compare with the other programs.
    pub digest: String,
}

impl Figure {
    pub fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "seconds": self.seconds,
            "range": self.range,
            "megabytes": self.megabytes,
            "digest": self.digest,
        })
    }

    pub fn from_json(text: &str) -> Option<Figure> {
        let value: Value = serde_json::from_str(text).ok()?;
        Some(Figure {
            name: value.get("name")?.as_str()?.into(),
            seconds: value.get("seconds")?.as_f64()?,
            range: [
                value.get("range")?.get(0)?.as_f64()?,
                value.get("range")?.get(1)?.as_f64()?,
            ],
            megabytes: value.get("megabytes")?.as_f64()?,
            digest: value.get("digest")?.as_str()?.into(),
        })
    }
}

fn time(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => format!("{:.2} us", s * 1e6),
        s if s < 1.0 => format!("{:.2} ms", s * 1e3),
        s => format!("{s:.3} s"),
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.range;
        write!(
            f,
            "{:<28} {:>11}  ({} to {})  {:>6.0} MB  {}",
            self.name,
            time(self.seconds),
            time(low),
            time(high),
            self.megabytes,
            self.digest
        )
    }
}

fn path() -> PathBuf {
    puncta_tests::root().join("tests/bench/figures.json")
}

fn saved() -> Map<String, Value> {
    let text = std::fs::read_to_string(path()).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// Prints what changed against the committed figures.
pub fn print_change(figures: &[Figure]) {
    let saved = saved();
    for figure in figures {
        let before = saved
            .get(&figure.name)
            .and_then(|one| one.get("seconds")?.as_f64());
        match before {
            Some(before) => println!(
                "{:<28} {} -> {} ({:+.0} %)",
                figure.name,
                time(before),
                time(figure.seconds),
                (figure.seconds / before - 1.0) * 100.0
            ),
            None => println!("{:<28} is new", figure.name),
        }
    }
}

/// Writes the figures beside those that were not measured this time.
pub fn save(figures: &[Figure]) {
    let mut saved = saved();
    for figure in figures {
        saved.insert(figure.name.clone(), figure.to_json());
    }
    let text = serde_json::to_string_pretty(&Value::Object(saved)).unwrap_or_default();
    if let Err(error) = std::fs::write(path(), text + "\n") {
        eprintln!("cannot write {}: {error}", path().display());
    }
}

/// Prints ratios to other programs' measurements of the same name.
pub fn print_ratios(figures: &[Figure], path: &str) {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) => {
            eprintln!("cannot read {path}: {error}");
            return;
        }
    };
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [name, program, seconds, megabytes, digest, ..] = words.as_slice() else {
            continue;
        };
        let (Ok(seconds), Ok(megabytes)) = (seconds.parse::<f64>(), megabytes.parse::<f64>())
        else {
            continue;
        };
        for figure in figures.iter().filter(|figure| figure.name == *name) {
            println!(
                "{name}: {:.2} of {program}'s {} and {:.2} of its {megabytes} MB; digests {} | {}",
                figure.seconds / seconds,
                time(seconds),
                figure.megabytes / megabytes,
                figure.digest,
                digest
            );
        }
    }
}
