//! The few switches that the commands take.

use std::fmt;

/// A command line that cannot be understood; it is answered with the help text and exit code 2.
#[derive(Debug)]
pub struct Usage(String);

impl Usage {
    pub fn error(text: String) -> anyhow::Error {
        anyhow::Error::new(Self(text))
    }
}

impl fmt::Display for Usage {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.0)
    }
}

impl std::error::Error for Usage {}

/// Whether `name`, the only switch that `command` knows, was given.
pub fn switch(command: &str, name: &str, words: &[String]) -> anyhow::Result<bool> {
    match words.iter().find(|word| *word != name) {
        Some(word) => Err(Usage::error(format!("'{command}' does not take '{word}'"))),
        None => Ok(!words.is_empty()),
    }
}

/// An error for a command without switches that was given some.
pub fn none(command: &str, words: &[String]) -> anyhow::Result<()> {
    match words.first() {
        Some(word) => Err(Usage::error(format!("'{command}' does not take '{word}'"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(String::from).collect()
    }

    #[test]
    fn a_switch_is_read_and_everything_else_is_refused() -> anyhow::Result<()> {
        assert!(!switch("build", "--release", &[])?);
        assert!(switch("build", "--release", &words("--release"))?);
        let error = switch("build", "--release", &words("--release --fast"));
        assert!(error.is_err_and(|e| e.is::<Usage>() && e.to_string().contains("--fast")));
        assert!(none("package", &words("x")).is_err());
        Ok(())
    }
}
