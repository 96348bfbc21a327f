use super::*;

fn operation() -> Operation {
    serde_json::from_value(json!({
        "id": "a.b/1", "kind": "operation", "title": "B",
        "inputs": [
            {"name": "table", "kind": "table"},
            {"name": "others", "kind": "table", "many": true, "optional": true}
        ],
        "outputs": [{"name": "image", "kind": "image"}, {"name": "report", "kind": "report"}]
    }))
    .unwrap()
}

fn texts(line: &str) -> Vec<String> {
    line.split_whitespace().map(String::from).collect()
}

#[test]
fn files_go_to_ports() {
    let operation = operation();
    let bind = |line: &str| {
        let bound = bind(&operation, &texts(line)).map_err(|failure| failure.to_string())?;
        let pair = |one: &Input| format!("{}={}", one.port, one.file.display());
        Ok::<_, String>(bound.iter().map(pair).collect::<Vec<_>>().join(" "))
    };
    assert_eq!(bind("a b c").unwrap(), "table=a others=b others=c");
    assert_eq!(bind("others=a b=1.csv").unwrap(), "others=a table=b=1.csv");
    assert!(
        bind("others=a")
            .unwrap_err()
            .contains("a.b/1 needs a table as table; add a file")
    );
    let mut one = operation.clone();
    one.inputs.truncate(1);
    let failure = super::bind(&one, &texts("a b")).unwrap_err().to_string();
    assert!(
        failure.contains("no input for b; the inputs of a.b/1 are table"),
        "{failure}"
    );
}

#[test]
fn an_object_is_named_behind_a_colon() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.h5");
    std::fs::write(&file, "x").unwrap();
    let text = |end: &str| PathBuf::from(format!("{}{end}", file.display()));
    assert_eq!(split_object(text("")), (file.clone(), None));
    assert_eq!(
        split_object(text(":events")),
        (file.clone(), Some("events".into()))
    );
    let strange = text(":odd");
    std::fs::write(&strange, "x").unwrap();
    assert_eq!(split_object(strange.clone()), (strange, None));
    assert_eq!(split_object("no:file".into()), ("no:file".into(), None));
}

#[test]
fn outputs_go_to_files() {
    let operation = operation();
    let shown = |line: &str| {
        let found = targets(&operation, &texts(line)).map_err(|failure| failure.to_string())?;
        let pair = |(port, path): &(&Port, PathBuf)| format!("{}={}", port.name, path.display());
        Ok::<_, String>(found.iter().map(pair).collect::<Vec<_>>().join(" "))
    };
    assert_eq!(shown("a.tif").unwrap(), "image=a.tif");
    assert_eq!(
        shown("report=r.json a.tif").unwrap(),
        "report=r.json image=a.tif"
    );
    assert!(
        shown("a b c")
            .unwrap_err()
            .contains("no output for c; the outputs of a.b/1 are image")
    );
    assert!(
        shown("a report=a")
            .unwrap_err()
            .contains("two outputs go to a")
    );
    assert_eq!(
        numbered(Path::new("d/a.b.csv"), 2),
        Path::new("d/a-2.b.csv")
    );
}
