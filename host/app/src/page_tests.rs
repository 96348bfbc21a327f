use super::*;
use puncta_engine::plugins::catalogue::Packed;
use serde_json::json;

fn installed() -> Installed {
    let packed: Packed = serde_json::from_value(json!({
        "library": "libx.so", "hash": "00", "door": true,
        "manifest": {
            "id": "lab.render", "title": "Rendering", "version": "1.2.0", "isolation": "none",
            "operations": [
                {
                    "id": "lab.render.blobs/2", "kind": "operation", "title": "Blobs",
                    "description": "Draws each localisation as a blob.\nOverlapping blobs add up.",
                    "inputs": [
                        {"name": "table", "kind": "table", "description": "Localisations",
                         "columns": [{"name": "x", "unit": "nm"}, {"name": "$sigma", "unit": "nm"},
                                     {"name": "t"}]},
                        {"name": "frame", "kind": "image", "optional": true}
                    ],
                    "outputs": [
                        {"name": "image", "kind": "image", "description": "The picture"},
                        {"name": "used", "kind": "table", "form": "selection", "of": "table",
                         "optional": true}
                    ],
                    "parameters": [
                        {"name": "pixel_size", "kind": "number", "help": "Edge of a pixel.",
                         "unit": "nm", "default": 5, "min": 0.1, "max": 10000},
                        {"name": "sigma", "kind": "column", "help": "Width of each blob.",
                         "default": "error_x"},
                        {"name": "limits", "kind": "ranges", "help": "What to draw.",
                         "default": {}, "advanced": true},
                        {"name": "shape", "kind": "choice", "help": "Form.", "default": "round",
                         "choices": [{"value": "round", "help": "A disc"}, {"value": "square"}]},
                        {"name": "top", "kind": "number", "help": "Clip.", "optional": true,
                         "unit": "1", "min": 0},
                        {"name": "count", "kind": "integer", "help": "How many."}
                    ],
                    "example": {"parameters": {"count": 3, "limits": {"t": [500, "inf"]},
                                               "title": "a 'b'"}},
                    "citations": ["doi:10.0000/none"]
                },
                {
                    "id": "lab.render.read/1", "kind": "reader", "title": "Blob files",
                    "outputs": [{"name": "blobs", "kind": "table"}],
                    "file": {"suffixes": [".blob"], "formats": ["Blob 1"]}
                }
            ]
        }
    }))
    .unwrap();
    Installed {
        packed,
        library: "libx.so".into(),
        bundled: true,
        trusted: None,
    }
}

#[test]
fn the_list_is_a_table() {
    let plugin = installed();
    let all = plugin
        .packed
        .manifest
        .operations
        .iter()
        .map(|operation| (&plugin, operation));
    assert_eq!(
        list(all),
        "lab.render.blobs/2  operation  Blobs       lab.render\n\
         lab.render.read/1   reader     Blob files  lab.render\n"
    );
    assert_eq!(list(std::iter::empty()), "");
}

#[test]
fn a_page_says_everything() {
    let plugin = installed();
    let suffix = |kind: Kind| format!(".{kind}");
    let expected = "\
lab.render.blobs/2 - Blobs
operation of lab.render 1.2.0

Draws each localisation as a blob.
Overlapping blobs add up.

Inputs
  table  table: x (nm), the column sigma (nm), t  Localisations
  frame  image: optional

Outputs
  image  image                           The picture
  used   table: rows of table; optional

Parameters
  --pixel_size  number, nm, 0.1 to 10000, default 5  Edge of a pixel.
  --sigma       column, default error_x              Width of each blob.
  --limits      limits by column, default none       What to draw. (advanced)
  --shape       round|square, default round          Form.
                  round                              A disc
  --top         number, from 0, optional             Clip.
  --count       whole number, required               How many.

Example
  puncta op lab.render.blobs table=table.table --count 3 --limits t=500.. --title 'a '\\''b'\\''' -o out.image

Sources
  doi:10.0000/none
";
    assert_eq!(
        full(&plugin, &plugin.packed.manifest.operations[0], &suffix),
        expected
    );
    let expected = "\
lab.render.read/1 - Blob files
reader of lab.render 1.2.0

Files
  suffixes  .blob
  formats   Blob 1

Outputs
  blobs  table

Example
  puncta info FILE.blob
";
    assert_eq!(
        full(&plugin, &plugin.packed.manifest.operations[1], &suffix),
        expected
    );
}
