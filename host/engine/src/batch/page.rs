//! The report of a batch as a page for people, `batch.html`: no scripts, nothing from the network.

use super::record::{BatchRecord, Entry, State};
use crate::markup::escaped;
use std::fmt::Write;

/// Name of the page in the output folder.
pub const PAGE: &str = "batch.html";

const STYLE: &str = "\
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; \
color: #1b1b1b; background: #fff }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; vertical-align: top; padding: .35rem .8rem .35rem 0; \
border-bottom: 1px solid #ddd }
td.number { text-align: right; white-space: nowrap }
.done { color: #1a6b2b } .failed, .partly { color: #a8201a } .other { color: #666 }
@media (prefers-color-scheme: dark) { body { color: #e6e6e6; background: #161616 } \
th, td { border-color: #333 } a { color: #8ab4f8 } .done { color: #7bd88f } \
.failed, .partly { color: #ff8a80 } .other { color: #999 } }";

/// The page of a record.
#[must_use]
pub fn page(record: &BatchRecord) -> String {
    let mut out = String::new();
    let counts = [
        State::Done,
        State::Partly,
        State::Failed,
        State::Stopped,
        State::Running,
        State::Waiting,
    ];
    let counts = counts.map(|state| (record.count(state), state.word()));
    let counts: Vec<String> = counts
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, word)| format!("{count} {word}"))
        .collect();
    let title = format!("{} files: {}", record.files.len(), counts.join(", "));
    let _ = write!(
        out,
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{title}</title>\n\
         <style>{STYLE}</style>\n<h1>{title}</h1>\n"
    );
    if !record.collected.is_empty() {
        let all: Vec<String> = record.collected.iter().map(|path| link(path)).collect();
        let _ = writeln!(out, "<p>Collected: {}</p>", all.join(", "));
    }
    out.push_str("<table>\n<tr><th>File</th><th>State</th><th>Seconds</th><th>Outputs</th></tr>\n");
    // What needs a look comes first.
    let bad = |entry: &&Entry| entry.state != State::Done;
    let order = record.files.iter().filter(bad);
    for entry in order.chain(record.files.iter().filter(|entry| !bad(entry))) {
        row(&mut out, entry);
    }
    out.push_str("</table>\n</html>\n");
    out
}

fn row(out: &mut String, entry: &Entry) {
    let class = match entry.state {
        State::Done => "done",
        State::Failed => "failed",
        State::Partly => "partly",
        _ => "other",
    };
    let errors: String = entry
        .errors
        .iter()
        .map(|error| format!("<br>{}", escaped(error)))
        .collect();
    let outputs: Vec<String> = entry.outputs.iter().map(|one| link(&one.path)).collect();
    let _ = writeln!(
        out,
        "<tr><td>{}</td><td class=\"{class}\">{}{errors}</td><td class=\"number\">{:.1}</td>\
         <td>{}</td></tr>",
        escaped(&entry.path),
        entry.state.word(),
        entry.seconds,
        outputs.join("<br>")
    );
}

fn link(path: &str) -> String {
    // A browser takes percent signs and question marks in a path for something else.
    let mut target = String::new();
    for byte in path.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'/' => {
                target.push(char::from(byte));
            }
            _ => {
                let _ = write!(target, "%{byte:02X}");
            }
        }
    }
    // A first part with a colon would be a scheme; "./" before it makes it a path.
    format!("<a href=\"./{target}\">{}</a>", escaped(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::record::OutputEntry;

    #[test]
    fn what_failed_comes_first_and_names_cannot_be_markup() {
        let entry = |path: &str, state| Entry {
            path: path.into(),
            state,
            ..Entry::default()
        };
        let mut bad = entry("<b>&.csv", State::Failed);
        bad.errors.push("row 3 is <short>".into());
        let mut good = entry("good.csv", State::Done);
        good.outputs.push(OutputEntry {
            path: "a b%.tif".into(),
            ..OutputEntry::default()
        });
        let record = BatchRecord {
            files: vec![good, bad],
            ..BatchRecord::default()
        };
        let page = page(&record);
        assert!(page.contains("2 files: 1 done, 1 failed"), "{page}");
        assert!(page.contains("&lt;b&gt;&amp;.csv") && page.contains("&lt;short&gt;"));
        assert!(page.contains("href=\"./a%20b%25.tif\""));
        let place = |text: &str| page.find(text).unwrap();
        assert!(place("&lt;b&gt;") < place("good.csv"));
    }
}
