//! Names of the files that a recipe writes: always below the output folder, on every system.

use puncta_documents::{Failure, FailureCode};
use std::path::PathBuf;

/// What stands for the name of the recipe's first input file.
const INPUT: &str = "{input}";
/// Characters that some system has no room for in a file name.
const FORBIDDEN: &[char] = &['\\', ':', '*', '?', '"', '<', '>', '|'];

/// The path, below the output folder, of an output named `file`; `{input}` becomes `input`, the
/// name of the first input file without its suffix.
///
/// # Errors
/// A sentence, when the path would not stay below the folder or is no file name everywhere.
pub fn output_path(file: &str, input: &str) -> Result<PathBuf, Failure> {
    // A name that some other system allows must not make this one climb out of the folder.
    let safe = |c: char| {
        if c == '/' || c.is_control() || FORBIDDEN.contains(&c) {
            '_'
        } else {
            c
        }
    };
    let input: String = input.chars().map(safe).collect();
    let input = if input.trim_matches(['.', ' ']).is_empty() {
        "input"
    } else {
        &input
    };
    let path = file.replace(INPUT, input);
    check_path(&path)?;
    Ok(path.split('/').collect())
}

/// Whether a name in `[outputs]` can be used.
pub(crate) fn check_file(file: &str) -> Result<(), Failure> {
    check_path(&file.replace(INPUT, "input"))
}

fn check_path(path: &str) -> Result<(), Failure> {
    let refuse = |why: &str, remedy: &str| {
        let message = format!("the output file \"{}\" {why}", path.escape_debug());
        Err(Failure::new(FailureCode::BadFile, message).remedy(remedy))
    };
    let inside = "give a name below the output folder, such as \"images/cells.tif\"";
    if path.contains(['{', '}']) {
        return refuse("has braces that mean nothing", "only {input} is replaced");
    }
    if let Some(bad) = path
        .chars()
        .find(|c| c.is_control() || FORBIDDEN.contains(c))
    {
        let why = format!("has the character {bad:?}, which not every system allows");
        return refuse(&why, "use letters, digits, _ and - (and / for folders)");
    }
    if path.starts_with('/') {
        return refuse("is an absolute path", inside);
    }
    for part in path.split('/') {
        match part {
            "" => return refuse("has an empty part", inside),
            "." | ".." => return refuse("leaves the output folder", inside),
            _ if part.ends_with(['.', ' ']) => {
                return refuse("has a part that ends with a dot or space", "leave it out");
            }
            _ if part.len() > 240 => return refuse("has too long a part", "shorten it"),
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_below_the_folder() {
        for good in [
            "a.tif",
            "images/a.tif",
            "{input}.tif",
            "{input}/{input}-b.csv",
            ".hidden",
        ] {
            assert!(check_file(good).is_ok(), "{good}");
        }
        for bad in [
            "",
            "/etc/x",
            "../x",
            "a/../../x",
            "a//b",
            "./x",
            "a/",
            "C:x",
            "a\\..\\b",
            "x\0",
            "{locs}",
            "..",
            "a/.. /b",
            "x.",
        ] {
            assert!(check_file(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_input_name_cannot_climb_out() {
        let path = |file, input| output_path(file, input).map(|path| path.display().to_string());
        assert_eq!(path("{input}-er.tif", "cell 1"), Ok("cell 1-er.tif".into()));
        assert_eq!(path("{input}/x.tif", ".."), Ok("input/x.tif".into()));
        assert_eq!(path("{input}.tif", "../../etc"), Ok(".._.._etc.tif".into()));
        assert_eq!(path("{input}.tif", ""), Ok("input.tif".into()));
        assert!(path("{input}.tif", "{input}").is_err());
    }
}
