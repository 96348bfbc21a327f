//! Which of the readers that know a file reads it.

use crate::settings::Settings;
use puncta_documents::{Failure, FailureCode};
use std::path::Path;

/// From this confidence on a reader says yes; below it cannot tell.
pub const YES: f64 = 0.5;

/// A reader that did not refuse a file.
pub struct Able<C> {
    /// Its id.
    pub id: String,
    /// The format that it saw.
    pub format: String,
    /// How sure it is, 0 to 1.
    pub confidence: f64,
    /// What reads the file.
    pub call: C,
}

/// Chooses among the readers of a file: the person's choice for its format; else the only one that
/// says yes; else, where none does, the one that is surest.
///
/// # Errors
/// Where several say yes, or none does and several are equally unsure: the sentence lists them with
/// the option that names one. Where there is none, what was refused.
pub fn choose<C>(
    path: &Path,
    mut able: Vec<Able<C>>,
    settings: &Settings,
    refused: Option<Failure>,
) -> Result<C, Failure> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let formats = able.iter().map(|one| one.format.as_str());
    if let Some(id) = settings.reader(&name, formats).map(str::to_owned)
        && let Some(at) = able.iter().position(|one| is(&one.id, &id))
    {
        return Ok(able.swap_remove(at).call);
    }
    able.sort_by(|a, b| b.confidence.total_cmp(&a.confidence).then(a.id.cmp(&b.id)));
    let highest = able.first().map_or(0.0, |one| one.confidence);
    let rivals = able
        .iter()
        .take_while(|one| one.confidence >= YES.min(highest))
        .count();
    if rivals > 1 {
        able.truncate(rivals);
        return Err(several(path, &able));
    }
    match able.into_iter().next() {
        Some(one) => Ok(one.call),
        None => Err(refused.unwrap_or_else(|| {
            let message = format!("no reader knows {}", path.display());
            Failure::new(FailureCode::NotMine, message)
        })),
    }
}

/// Whether an id is the one that is meant, with or without its revision.
pub fn is(id: &str, meant: &str) -> bool {
    id == meant || id.split('/').next() == Some(meant)
}

fn several<C>(path: &Path, able: &[Able<C>]) -> Failure {
    let known: Vec<String> = able
        .iter()
        .map(|one| match one.format.as_str() {
            "" => one.id.clone(),
            format => format!("{} as {format}", one.id),
        })
        .collect();
    let message = format!(
        "several readers know {}: {}",
        path.display(),
        known.join(", ")
    );
    let ids: Vec<String> = able
        .iter()
        .map(|one| format!("--reader {}", one.id))
        .collect();
    let first = able.first();
    let format = first.map_or("", |one| one.format.as_str());
    let id = first.map_or("", |one| one.id.as_str());
    Failure::new(FailureCode::BadParameter, message).remedy(format!(
        "choose one with {}, or for good with puncta readers set \"{format}\" {id}",
        ids.join(" or ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn able(list: &[(&str, &str, f64)]) -> Vec<Able<&'static str>> {
        list.iter()
            .map(|(id, format, confidence)| Able {
                id: (*id).to_owned(),
                format: (*format).to_owned(),
                confidence: *confidence,
                call: ["a", "b"][usize::from(id.starts_with("b."))],
            })
            .collect()
    }

    fn chosen(
        list: &[(&str, &str, f64)],
        readers: &[(&str, &str)],
    ) -> Result<&'static str, String> {
        let readers = readers
            .iter()
            .map(|(k, v)| ((*k).to_owned(), (*v).to_owned()));
        let settings = Settings {
            readers: readers.collect(),
            ..Settings::default()
        };
        choose(Path::new("d/f.CSV"), able(list), &settings, None).map_err(|f| f.to_string())
    }

    #[test]
    fn one_yes_wins_over_any_number_that_cannot_tell() {
        let list = [("a.r/1", "A", 0.4), ("b.r/1", "B", 0.5)];
        assert_eq!(chosen(&list, &[]), Ok("b"));
        assert_eq!(
            chosen(&[("a.r/1", "A", 0.2), ("b.r/1", "B", 0.3)], &[]),
            Ok("b")
        );
        assert_eq!(chosen(&[("a.r/1", "", 0.0)], &[]), Ok("a"));
        assert!(
            chosen(&[], &[])
                .unwrap_err()
                .contains("no reader knows d/f.CSV")
        );
    }

    #[test]
    fn two_that_say_yes_need_the_person() {
        let list = [("a.r/1", "A csv", 0.95), ("b.r/2", "B csv", 0.6)];
        assert_eq!(
            chosen(&list, &[]).unwrap_err(),
            "several readers know d/f.CSV: a.r/1 as A csv, b.r/2 as B csv; choose one with \
             --reader a.r/1 or --reader b.r/2, or for good with puncta readers set \"A csv\" a.r/1"
        );
        assert!(chosen(&[("a.r/1", "A", 0.2), ("b.r/1", "B", 0.2)], &[]).is_err());
        assert_eq!(chosen(&list, &[("A csv", "b.r/2")]), Ok("b"));
        assert_eq!(chosen(&list, &[(".csv", "b.r")]), Ok("b"));
        assert_eq!(
            chosen(&list, &[(".csv", "b.r"), ("B csv", "a.r/1")]),
            Ok("a")
        );
        assert!(chosen(&list, &[(".csv", "c.r/1"), (".tsv", "a.r/1")]).is_err());
    }
}
