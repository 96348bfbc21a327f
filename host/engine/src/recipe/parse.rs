//! Recipe text to [`Recipe`]: what each part says, and in which line it is wrong.

use super::closest::closest;
use super::layout::Layout;
use super::place::{Lines, Place, Problem, Subject};
use super::values::{self, BadValue};
use super::{MAX_ENTRIES, MAX_TEXT, RECIPE, Recipe};
use puncta_documents::{Failure, FailureCode, Map};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};

/// Problems after which the rest is not looked for.
const MOST_PROBLEMS: usize = 64;
/// What the TOML parser says of a name that stands twice.
const DUPLICATE: &str = "duplicate key";
/// Longest name of an input or step, in characters.
const LONGEST_NAME: usize = 64;

pub(crate) type Value<'a> = Spanned<DeValue<'a>>;

/// Reads a recipe. Nothing in it needs to be installed.
///
/// # Errors
/// Everything that is wrong with the text, in the order of the lines.
pub fn parse(text: &str) -> Result<Recipe, Vec<Problem>> {
    if text.len() > MAX_TEXT {
        let message = format!(
            "the recipe has {} MB, more than the {} MB that a recipe may have",
            text.len() >> 20,
            MAX_TEXT >> 20
        );
        let failure = Failure::bad_file(message).remedy("put large tables into files of their own");
        return Err(vec![Problem::new(
            Place { line: 1, column: 1 },
            Subject::Recipe,
            failure,
        )]);
    }
    let (table, errors) = DeTable::parse_recoverable(text);
    let mut parser = Parser {
        text,
        lines: Lines::new(text),
        problems: Vec::new(),
    };
    if !errors.is_empty() {
        parser.syntax(&errors);
    } else if let Some(recipe) = parser.recipe(table.get_ref())
        && parser.problems.is_empty()
    {
        return Ok(recipe);
    }
    parser.problems.sort_by_key(|problem| problem.place);
    parser.problems.dedup();
    Err(parser.problems)
}

/// Whether an input or a step may have this name.
pub(crate) fn check_name(what: &str, name: &str) -> Result<(), Failure> {
    let good = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    if name.is_empty() || !name.chars().all(good) || name.chars().count() > LONGEST_NAME {
        return Err(
            Failure::bad_file(format!("{name:?} cannot be the name of {what}")).remedy(format!(
                "use up to {LONGEST_NAME} letters, digits, _ and -, without dots and spaces"
            )),
        );
    }
    Ok(())
}

pub(crate) struct Parser<'a> {
    text: &'a str,
    pub(crate) lines: Lines<'a>,
    problems: Vec<Problem>,
}

impl Parser<'_> {
    pub(crate) fn report(&mut self, offset: usize, subject: &Subject, failure: Failure) {
        if self.problems.len() < MOST_PROBLEMS {
            let place = self.lines.place(offset);
            self.problems
                .push(Problem::new(place, subject.clone(), failure));
        }
    }

    pub(crate) fn refuse(
        &mut self,
        span: Range<usize>,
        subject: &Subject,
        message: String,
        remedy: &str,
    ) {
        let failure = Failure::new(FailureCode::BadFile, message).remedy(remedy);
        self.report(span.start, subject, failure);
    }

    fn syntax(&mut self, errors: &[Error]) {
        let layout = Layout::scan(self.text);
        let again = |error: &Error| error.message() == DUPLICATE;
        let firsts = if errors.iter().any(again) {
            layout.repeated()
        } else {
            HashMap::new()
        };
        // A section that stands twice makes each of its keys stand twice: one message is enough.
        let mut section = 0..0;
        for error in errors {
            let span = error.span().unwrap_or(0..0);
            if self.problems.len() == MOST_PROBLEMS {
                return;
            }
            if !again(error) {
                let message = format!("this is no valid TOML: {}", error.message());
                self.refuse(span, &Subject::Recipe, message, remedy(error.message()));
            } else if !section.contains(&span.start) {
                section = layout.section_at(span.start).unwrap_or(0..0);
                let name = self.text.get(span.clone()).unwrap_or("");
                let first = firsts.get(&span.start).map_or_else(String::new, |at| {
                    format!(", first in line {}", self.lines.place(*at).line)
                });
                let message = format!("the name {name} stands twice{first}");
                self.refuse(
                    span,
                    &Subject::Recipe,
                    message,
                    "rename or remove one of the two",
                );
            }
        }
    }

    fn recipe(&mut self, root: &DeTable<'_>) -> Option<Recipe> {
        self.format(root)?;
        let subject = Subject::Recipe;
        self.known(
            "the recipe",
            root,
            &["format", "inputs", "steps", "outputs"],
            &subject,
        );
        let mut recipe = Recipe::default();
        for (name, at, value) in self.entries(root, "inputs") {
            recipe.inputs.extend(self.input(name, at, value));
        }
        for (name, at, value) in self.entries(root, "steps") {
            recipe.steps.extend(self.step(name, at, value));
        }
        let inputs: BTreeMap<&str, Place> = recipe
            .inputs
            .iter()
            .map(|input| (input.name.as_str(), input.place))
            .collect();
        for step in &recipe.steps {
            if let Some(first) = inputs.get(step.name.as_str()) {
                let message = format!(
                    "the step {} has the name of the input in line {}",
                    step.name, first.line
                );
                let failure = Failure::bad_file(message).remedy("rename one of the two");
                let subject = Subject::Step(step.name.clone());
                self.problems
                    .push(Problem::new(step.place, subject, failure));
            }
        }
        self.outputs(root, &mut recipe);
        Some(recipe)
    }

    fn outputs(&mut self, root: &DeTable<'_>, recipe: &mut Recipe) {
        // Some file systems do not tell capitals from small letters.
        let mut seen: BTreeMap<String, usize> = BTreeMap::new();
        for (file, at, value) in self.entries(root, "outputs") {
            if let Some(first) = seen.insert(file.to_lowercase(), at) {
                let line = self.lines.place(first).line;
                self.refuse(
                    at..at,
                    &Subject::Output(file.into()),
                    format!("the output file \"{file}\" differs from that in line {line} in capitals only"),
                    "rename one of the two",
                );
            }
            recipe.outputs.extend(self.output(file, at, value));
        }
    }

    /// A recipe of another format is not looked into.
    fn format(&mut self, root: &DeTable<'_>) -> Option<()> {
        let remedy = format!("the first line has to be format = \"{RECIPE}\"");
        let (span, message) = match root.get("format") {
            None => (0..0, "this is no recipe".to_owned()),
            Some(value) => match value.get_ref().as_str() {
                Some(RECIPE) => return Some(()),
                Some(other) if other.starts_with("puncta.recipe/") => {
                    let message = format!("the recipe has the format {other:?} of another version");
                    self.refuse(value.span(), &Subject::Recipe, message, "update Puncta");
                    return None;
                }
                _ => (
                    value.span(),
                    "the format is not that of a recipe".to_owned(),
                ),
            },
        };
        self.refuse(span, &Subject::Recipe, message, &remedy);
        None
    }

    /// The members of a table of the root, in the order of the text.
    fn entries<'t, 'v>(
        &mut self,
        root: &'t DeTable<'v>,
        name: &str,
    ) -> Vec<(&'t str, usize, &'t Value<'v>)> {
        let Some(value) = root.get(name) else {
            return Vec::new();
        };
        let Some(table) = value.get_ref().as_table() else {
            let message = format!("{name} is no table");
            let remedy = format!("write it as a section [{name}] or [{name}.NAME]");
            self.refuse(value.span(), &Subject::Recipe, message, &remedy);
            return Vec::new();
        };
        let mut list: Vec<_> = table
            .iter()
            .map(|(key, value)| (key.get_ref().as_ref(), key.span().start, value))
            .collect();
        list.sort_by_key(|(_, at, _)| *at);
        if let Some((_, at, _)) = list.get(MAX_ENTRIES) {
            let message = format!("there are {} {name}, more than {MAX_ENTRIES}", list.len());
            self.refuse(
                *at..*at,
                &Subject::Recipe,
                message,
                "split the recipe into several",
            );
            list.truncate(MAX_ENTRIES);
        }
        list
    }

    pub(crate) fn known(
        &mut self,
        what: &str,
        table: &DeTable<'_>,
        known: &[&str],
        subject: &Subject,
    ) {
        for key in table.keys() {
            let name = key.get_ref().as_ref();
            if !known.contains(&name) {
                let remedy = match closest(name, known.iter().copied()) {
                    Some(near) => format!("did you mean {near}?"),
                    None => format!("there are {}", known.join(", ")),
                };
                self.refuse(
                    key.span(),
                    subject,
                    format!("{what} has no key {name:?}"),
                    &remedy,
                );
            }
        }
    }

    pub(crate) fn table<'t, 'v>(
        &mut self,
        what: &str,
        value: &'t Value<'v>,
        subject: &Subject,
    ) -> Option<&'t DeTable<'v>> {
        let table = value.get_ref().as_table();
        if table.is_none() {
            let message = format!("{what} is no table");
            self.refuse(
                value.span(),
                subject,
                message,
                "write name = value pairs in { }",
            );
        }
        table
    }

    /// An optional text of a table.
    pub(crate) fn text(
        &mut self,
        table: &DeTable<'_>,
        key: &str,
        subject: &Subject,
    ) -> Option<String> {
        let value = table.get(key)?;
        let text = value.get_ref().as_str();
        if text.is_none() {
            let message = format!("{key} is no text");
            self.refuse(value.span(), subject, message, "put it into double quotes");
        }
        text.map(str::to_owned)
    }

    /// An optional table of values.
    pub(crate) fn values(&mut self, table: &DeTable<'_>, key: &str, subject: &Subject) -> Map {
        let Some(value) = table.get(key) else {
            return Map::new();
        };
        let Some(table) = self.table(key, value, subject) else {
            return Map::new();
        };
        values::to_map(table).unwrap_or_else(
            |BadValue {
                 span,
                 message,
                 remedy,
             }| {
                self.refuse(span, subject, message, remedy);
                Map::new()
            },
        )
    }
}

/// What to do about an error of the TOML parser.
fn remedy(message: &str) -> &'static str {
    let found = |word: &str| message.contains(word);
    if found("string") || found("quot") {
        "put texts into double quotes"
    } else if found("array") || found("]") {
        "close every [ with ], with commas between"
    } else if found("inline table") || found("}") {
        "close every { with }, with commas between"
    } else {
        "write lines as name = value, below headers such as [steps.NAME]"
    }
}

#[cfg(test)]
#[path = "parse_tests.rs"]
mod tests;
