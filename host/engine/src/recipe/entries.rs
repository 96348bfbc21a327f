//! One input, step or output file of a recipe's text.

use super::parse::{Parser, Value, check_name};
use super::place::Subject;
use super::{Binding, Input, MAX_ENTRIES, OutputFile, Reference, Step};
use puncta_documents::{Kind, Map};
use toml::Spanned;
use toml::de::DeTable;

impl Parser<'_> {
    pub(crate) fn input(&mut self, name: &str, at: usize, value: &Value<'_>) -> Option<Input> {
        let subject = Subject::Input(name.into());
        if let Err(failure) = check_name("an input", name) {
            self.report(at, &subject, failure);
        }
        let what = format!("the input {name}");
        let table = self.table(&what, value, &subject)?;
        self.known(
            &what,
            table,
            &["kind", "many", "reader", "options", "object"],
            &subject,
        );
        let kinds = "one of \"table\", \"image\", \"mesh\", \"figure\", \"report\"";
        let kind = match self.text(table, "kind", &subject) {
            Some(text) => kind(&text),
            None if table.contains_key("kind") => return None,
            None => {
                let remedy = format!("add kind = {kinds}");
                self.refuse(
                    at..at,
                    &subject,
                    format!("{what} does not say its kind"),
                    &remedy,
                );
                return None;
            }
        };
        if kind.is_none() {
            let span = table.get("kind").map_or(at..at, Spanned::span);
            self.refuse(
                span,
                &subject,
                format!("{what} has an unknown kind"),
                &format!("use {kinds}"),
            );
        }
        let many = table
            .get("many")
            .map(|value| (value.span(), value.get_ref().as_bool()));
        if let Some((span, None)) = &many {
            let message = format!("many of {what} is neither true nor false");
            self.refuse(
                span.clone(),
                &subject,
                message,
                "write many = true for several files",
            );
        }
        Some(Input {
            name: name.into(),
            kind: kind?,
            many: many.and_then(|(_, many)| many).unwrap_or(false),
            reader: self.text(table, "reader", &subject),
            options: self.values(table, "options", &subject),
            object: self.text(table, "object", &subject),
            place: self.lines.place(at),
        })
    }

    pub(crate) fn step(&mut self, name: &str, at: usize, value: &Value<'_>) -> Option<Step> {
        let subject = Subject::Step(name.into());
        if let Err(failure) = check_name("a step", name) {
            self.report(at, &subject, failure);
        }
        let what = format!("the step {name}");
        let table = self.table(&what, value, &subject)?;
        self.known(&what, table, &["op", "in", "set"], &subject);
        if !table.contains_key("op") {
            let remedy = "add op = \"ID\"; `puncta ops` lists the ids";
            self.refuse(
                at..at,
                &subject,
                format!("{what} does not say its operation"),
                remedy,
            );
        }
        let op = self.text(table, "op", &subject);
        let inputs = self.bindings(table, &what, &subject);
        let set = self.values(table, "set", &subject);
        let places = table
            .get("set")
            .and_then(|set| set.get_ref().as_table())
            .map(|set| {
                let place = |key: &Spanned<_>| self.lines.place(key.span().start);
                set.keys()
                    .map(|key| (key.get_ref().to_string(), place(key)))
                    .collect()
            });
        Some(Step {
            name: name.into(),
            op: op?,
            op_place: self
                .lines
                .place(table.get("op").map_or(at, |op| op.span().start)),
            inputs,
            set,
            set_places: places.unwrap_or_default(),
            place: self.lines.place(at),
        })
    }

    fn bindings(&mut self, step: &DeTable<'_>, what: &str, subject: &Subject) -> Vec<Binding> {
        let Some(table) = step
            .get("in")
            .and_then(|ports| self.table("in", ports, subject))
        else {
            return Vec::new();
        };
        let mut bindings = Vec::with_capacity(table.len());
        for (port, value) in table.iter() {
            let single = std::slice::from_ref(value);
            let list = value.get_ref().as_array().map_or(single, |list| &list[..]);
            let from = list.iter().take(MAX_ENTRIES);
            let port_name = port.get_ref();
            let from = from
                .filter_map(|one| self.reference(one, &format!("{port_name} of {what}"), subject))
                .collect();
            let place = self.lines.place(port.span().start);
            bindings.push(Binding {
                port: port_name.to_string(),
                place,
                from,
            });
        }
        bindings.sort_by_key(|binding| binding.place);
        bindings
    }

    fn reference(&mut self, value: &Value<'_>, what: &str, subject: &Subject) -> Option<Reference> {
        let text = value.get_ref().as_str().unwrap_or("");
        let (source, output) = match text.split_once('.') {
            Some((source, output)) => (source, Some(output.to_owned())),
            None => (text, None),
        };
        if source.is_empty() || output.as_deref() == Some("") {
            let message = format!("{what} names no input, step or \"step.output\"");
            self.refuse(
                value.span(),
                subject,
                message,
                "write the name in double quotes",
            );
            return None;
        }
        let place = self.lines.place(value.span().start);
        Some(Reference {
            source: source.into(),
            output,
            place,
        })
    }

    pub(crate) fn output(
        &mut self,
        file: &str,
        at: usize,
        value: &Value<'_>,
    ) -> Option<OutputFile> {
        let subject = Subject::Output(file.into());
        if let Err(failure) = super::files::check_file(file) {
            self.report(at, &subject, failure);
        }
        let what = format!("the output file {file:?}");
        let place = self.lines.place(at);
        let Some(table) = value.get_ref().as_table() else {
            let from = self.reference(value, &what, &subject)?;
            return Some(OutputFile {
                file: file.into(),
                from,
                writer: None,
                set: Map::new(),
                place,
            });
        };
        self.known(&what, table, &["from", "writer", "set"], &subject);
        let Some(from) = table.get("from") else {
            let remedy = "add from = \"STEP\"";
            self.refuse(
                at..at,
                &subject,
                format!("{what} does not say what is written"),
                remedy,
            );
            return None;
        };
        let from = self.reference(from, &what, &subject);
        let writer = self.text(table, "writer", &subject);
        let set = self.values(table, "set", &subject);
        Some(OutputFile {
            file: file.into(),
            from: from?,
            writer,
            set,
            place,
        })
    }
}

fn kind(text: &str) -> Option<Kind> {
    use Kind::{Figure, Image, Mesh, Report, Table};
    [Table, Image, Mesh, Figure, Report]
        .into_iter()
        .find(|kind| kind.to_string() == text)
}
