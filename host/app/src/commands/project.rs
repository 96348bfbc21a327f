//! `puncta plugins new` and `puncta plugins update-sdk`: projects with the SDK's sources in them.

use crate::cli::{Language, New, ProjectKind};
use crate::context::Context;
use crate::exit::Ended;
use puncta_engine::documents::{Failure, FailureCode};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};

/// Folder of the SDK's sources in a project.
const VENDORED: &str = "puncta-sdk";
/// Folder of the SDK in the bundle.
const SDK: &str = "sdk";
/// Folder of the templates in the SDK.
const TEMPLATE: &str = "template";

/// What the template calls things, and what the project calls them.
struct Names {
    id: String,
    name: String,
}

impl Names {
    fn of(given: &str) -> Result<Names, Failure> {
        let id = if given.contains('.') {
            given.to_owned()
        } else {
            format!("lab.{given}")
        };
        let word = |word: &str| {
            word.starts_with(|first: char| first.is_ascii_lowercase())
                && !word.ends_with('-')
                && word
                    .chars()
                    .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
        };
        let name = id.rsplit('.').next().unwrap_or(&id).to_owned();
        if !id.split('.').all(word) || id.len() > 80 {
            let message = format!("{given:?} is no name for a plugin");
            let remedy = "use lower-case words with hyphens, such as nearest-neighbours";
            return Err(Failure::bad_parameter("name", message).remedy(remedy));
        }
        if ["core", "std", "alloc", "test", "puncta-sdk"].contains(&name.as_str()) {
            let message = format!("{name} is the name of a library that plugins use");
            return Err(Failure::bad_parameter("name", message).remedy("choose another name"));
        }
        Ok(Names { id, name })
    }

    fn title(&self) -> String {
        let mut title = self.name.replace('-', " ");
        if let Some(first) = title.get_mut(..1) {
            first.make_ascii_uppercase();
        }
        title
    }

    /// Text of the template with the project's names.
    fn apply(&self, text: &str) -> String {
        text.replace("lab.my-plugin", &self.id)
            .replace("my-plugin", &self.name)
            .replace("my_plugin", &self.name.replace('-', "_"))
            .replace("My plugin", &self.title())
    }
}

/// The SDK beside the program.
fn sdk(context: &Context) -> Result<PathBuf, Failure> {
    let program = &context.engine.options().program;
    let folder = program.parent().unwrap_or(program).join(SDK);
    if folder.join("sdk").join("Cargo.toml").is_file() {
        return Ok(folder);
    }
    let message = format!("the SDK is not in {}", folder.display());
    Err(Failure::new(FailureCode::Io, message).remedy("unpack the whole bundle again"))
}

pub fn new(context: &Context, order: &New) -> Result<Ended, Failure> {
    let names = Names::of(&order.name)?;
    let project = order
        .to
        .clone()
        .unwrap_or_else(|| names.name.clone().into());
    let sdk = sdk(context)?;
    if project.exists() {
        let message = format!("{} exists already", project.display());
        return Err(Failure::new(FailureCode::Io, message).remedy("choose another with --to"));
    }
    let language = match order.language {
        Language::Rust => "rust",
        Language::C => "c",
    };
    let kind = match order.kind {
        ProjectKind::Operation => "operation",
        ProjectKind::Reader => "reader",
        ProjectKind::Writer => "writer",
    };
    let template = sdk.join(TEMPLATE).join(language);
    for part in ["common", kind] {
        copy(&template.join(part), &project, &|text| names.apply(text))?;
    }
    vendor(&sdk, &project, order.language)?;
    if order.language == Language::Rust {
        let lock = sdk.join("Cargo.lock");
        let to = project.join("Cargo.lock");
        fs::copy(&lock, &to).map_err(|error| Failure::io("write", &to, &error))?;
    }
    let shown = project.display().to_string();
    if context.json {
        let made = json!({ "project": shown, "id": names.id, "kind": kind, "language": language });
        context.output.json(&json!({ "made": made }))?;
        return Ok(Ended::Done);
    }
    let text = format!(
        "{shown}: {}, {kind} in {language}; README.md says what next\n",
        names.id
    );
    context.output.text(&text)?;
    Ok(Ended::Done)
}

pub fn update(context: &Context, project: &Path) -> Result<Ended, Failure> {
    let sdk = sdk(context)?;
    let place = project.join(VENDORED);
    if !place.is_dir() {
        let message = format!("{} has no folder {VENDORED}", project.display());
        let remedy = "name the folder of a project that puncta plugins new made";
        return Err(Failure::bad_parameter("project", message).remedy(remedy));
    }
    let language = if project.join("Cargo.toml").is_file() {
        Language::Rust
    } else {
        Language::C
    };
    // The old copy stays until the new one is whole.
    let old = project.join(format!("{VENDORED}.old"));
    fs::rename(&place, &old).map_err(|error| Failure::io("move", &place, &error))?;
    if let Err(failure) = vendor(&sdk, project, language) {
        let _ = fs::remove_dir_all(&place);
        fs::rename(&old, &place).map_err(|error| Failure::io("move", &old, &error))?;
        return Err(failure);
    }
    fs::remove_dir_all(&old).map_err(|error| Failure::io("remove", &old, &error))?;
    let shown = project.display().to_string();
    if context.json {
        context.output.json(&json!({ "updated": shown }))?;
    } else {
        let text = format!("{shown}: the SDK is this program's now; build and test again\n");
        context.output.text(&text)?;
    }
    Ok(Ended::Done)
}

/// Copies what a project in a language needs of the SDK.
fn vendor(sdk: &Path, project: &Path, language: Language) -> Result<(), Failure> {
    let to = project.join(VENDORED);
    let same = |text: &str| text.to_owned();
    if language == Language::C {
        return copy(&sdk.join("abi").join("include"), &to, &same);
    }
    for package in ["abi", "derive", "documents", "door", "sdk", "testkit"] {
        copy(&sdk.join(package), &to.join(package), &same)?;
    }
    Ok(())
}

/// Copies a folder of text files. Names that begin with `dot-` are hidden in the project.
fn copy(from: &Path, to: &Path, change: &dyn Fn(&str) -> String) -> Result<(), Failure> {
    fs::create_dir_all(to).map_err(|error| Failure::io("create", to, &error))?;
    let entries = fs::read_dir(from).map_err(|error| Failure::io("read", from, &error))?;
    for entry in entries {
        let entry = entry.map_err(|error| Failure::io("read", from, &error))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let name = match name.strip_prefix("dot-") {
            Some(rest) => format!(".{rest}"),
            None => name,
        };
        let (source, place) = (entry.path(), to.join(change(&name)));
        if source.is_dir() {
            copy(&source, &place, change)?;
            continue;
        }
        let text = fs::read_to_string(&source);
        let text = text.map_err(|error| Failure::io("read", &source, &error))?;
        fs::write(&place, change(&text)).map_err(|error| Failure::io("write", &place, &error))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_spread_over_the_template() {
        let names = Names::of("nearest-neighbours").unwrap();
        let text = names.apply("lab.my-plugin.run my_plugin My plugin my-plugin");
        assert_eq!(
            text,
            "lab.nearest-neighbours.run nearest_neighbours Nearest neighbours nearest-neighbours"
        );
        assert_eq!(Names::of("ucl.spt.dwell").unwrap().name, "dwell");
        for wrong in ["", "Nearest", "a b", "../x", "a..b", "core", "x-", "9a"] {
            assert!(Names::of(wrong).is_err(), "{wrong}");
        }
    }
}
