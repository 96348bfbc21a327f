//! What the person should know about the columns of a file.

use crate::flavours::Flavour;
use crate::schema::ColumnPlan;
use crate::table::Table;
use puncta_shared_import::UNKNOWN;

/// Sentences with the exact option for each thing that the file does not say.
pub fn notes(table: &Table) -> Vec<String> {
    let mut notes = Vec::new();
    let file = &table.dialect.file;
    let label = table.dialect.flavour.label();
    if table.dialect.assumed {
        let names = names(table.plan.columns.iter());
        notes.push(format!(
            "{file} has no names; by its values it is {label}, so its columns are {names}, without \
             units. Give --dialect {} to have its units too, or --columns to name them otherwise.",
            option(table.dialect.flavour)
        ));
    } else if table.dialect.nameless && table.dialect.positions.is_none() {
        let count = table.plan.fields;
        notes.push(format!(
            "The {count} columns of {file} have no names; name them in order, such as --columns \
             \"{}\", with units such as --units nm.",
            ["x", "y", "t"].get(..count.min(3)).unwrap_or(&[]).join(",")
        ));
    } else if !(table.has("x") && table.has("y")) {
        notes.push(format!(
            "{file} has no columns x and y, so it is a table without positions; name them, such as \
             --columns \"Position X=x, Position Y=y\"."
        ));
    }
    let bare = |c: &&ColumnPlan| c.role.as_deref() == Some("position") && c.unit == UNKNOWN;
    let bare: Vec<&ColumnPlan> = table.plan.columns.iter().filter(bare).collect();
    if !bare.is_empty() && !table.dialect.assumed {
        let pixels = |c: &&ColumnPlan| c.description.contains("camera pixels");
        let remedy = if bare.iter().any(pixels) {
            "--pixel_size, the camera's pixel in nm"
        } else {
            "--units, such as --units nm or --units um"
        };
        notes.push(format!(
            "The unit of {} in {file} is unknown; give {remedy}.",
            names(bare.into_iter())
        ));
    }
    if table.plan.columns.iter().any(|c| c.base_guessed) {
        notes.push(format!(
            "Frames of {label} files count from 1; here they count from 0."
        ));
    }
    notes
}

fn names<'a>(columns: impl Iterator<Item = &'a ColumnPlan>) -> String {
    columns
        .map(|c| c.name.as_str())
        .collect::<Vec<_>>()
        .join(", ")
}

fn option(flavour: Flavour) -> &'static str {
    match flavour {
        Flavour::Evalspt => "evalspt",
        _ => "trxyt",
    }
}
