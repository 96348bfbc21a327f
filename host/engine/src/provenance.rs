//! Provenance: what a saved file was made of and how, in `<file>.puncta.json` beside it.

use crate::engine::{Converted, Engine, ReadFile, Written};
use crate::files;
use crate::job::Progress;
use puncta_documents::{Failure, Map};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Format of [`Provenance`].
pub const PROVENANCE: &str = "puncta.provenance/1";
/// What a file's name gets to become the name of its provenance.
pub const SUFFIX: &str = ".puncta.json";

/// How a file came to be. Format `puncta.provenance/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of the host that wrote the file.
    pub host: String,
    /// The file.
    pub file: FileRecord,
    /// Files that the writer put beside it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<FileRecord>,
    /// What it holds: an input, a step, or `step.output`.
    pub object: String,
    /// Which one, from 0, where the output has several objects.
    #[serde(default, skip_serializing_if = "is_first")]
    pub number: usize,
    /// Where it was computed: results may differ in their last bits between processors.
    #[serde(default)]
    pub platform: Platform,
    /// The call that wrote it; absent for a figure or report that the host wrote as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub writer: Option<CallRecord>,
    /// Files that it was made from, by name.
    #[serde(default)]
    pub inputs: BTreeMap<String, Vec<InputRecord>>,
    /// Steps that it was made by, each after those that it needs.
    #[serde(default)]
    pub steps: Vec<StepRecord>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_first(number: &usize) -> bool {
    *number == 0
}

/// System and processor, as far as results can depend on them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Platform {
    /// System and architecture, such as `linux-x86_64`.
    pub system: String,
    /// Instruction sets of the processor that libraries choose by.
    #[serde(default)]
    pub features: Vec<String>,
}

impl Platform {
    /// This machine.
    #[must_use]
    pub fn here() -> Platform {
        Platform {
            system: format!("{}-{}", std::env::consts::OS, std::env::consts::ARCH),
            features: features(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
fn features() -> Vec<String> {
    let all = [
        ("avx", std::is_x86_feature_detected!("avx")),
        ("avx2", std::is_x86_feature_detected!("avx2")),
        ("avx512f", std::is_x86_feature_detected!("avx512f")),
        ("fma", std::is_x86_feature_detected!("fma")),
    ];
    all.into_iter()
        .filter(|(_, there)| *there)
        .map(|(name, _)| name.to_owned())
        .collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn features() -> Vec<String> {
    Vec::new()
}

/// What a saved object was made of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lineage {
    /// The object: an input, a step, or `step.output`.
    pub object: String,
    /// Which one, from 0, where the output has several objects.
    pub number: usize,
    /// Files, by name of the input.
    pub inputs: BTreeMap<String, Vec<InputRecord>>,
    /// Steps, each after those that it needs.
    pub steps: Vec<StepRecord>,
}

/// A file as it was when it was read or written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRecord {
    /// Name without folder.
    pub name: String,
    /// Where it was; absent for files that were written, which may be moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<String>,
    /// Bytes.
    pub bytes: u64,
    /// BLAKE3 of its content.
    pub blake3: String,
}

/// A call: operation, plugin, parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CallRecord {
    /// Operation id with revision.
    pub operation: String,
    /// The plugin that has it.
    pub plugin: PluginRecord,
    /// Parameters after defaults, in the schema's units; the seed is among them.
    pub parameters: Map,
}

/// A plugin.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PluginRecord {
    /// Id.
    pub id: String,
    /// Version.
    pub version: String,
    /// BLAKE3 of its library.
    pub library: String,
}

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputRecord {
    /// The file.
    #[serde(flatten)]
    pub file: FileRecord,
    /// Format that the reader recognised.
    pub format: String,
    /// Object of the file that was used.
    pub object: String,
    /// The call that read it.
    pub reader: CallRecord,
}

/// A step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Name.
    pub name: String,
    /// The call.
    #[serde(flatten)]
    pub call: CallRecord,
    /// What was bound to each port: inputs, steps, or `step.output`.
    pub inputs: BTreeMap<String, Vec<String>>,
    /// Columns that were converted for it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub converted: Vec<ConversionRecord>,
}

/// A column that was converted to the unit that an operation needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConversionRecord {
    /// Port.
    pub port: String,
    /// Column.
    pub column: String,
    /// Unit that it had.
    pub from: String,
    /// Unit that it was converted to.
    pub to: String,
    /// What its values were multiplied with.
    pub factor: f64,
}

impl From<&Converted> for ConversionRecord {
    fn from(one: &Converted) -> ConversionRecord {
        ConversionRecord {
            port: one.port.clone(),
            column: one.column.clone(),
            from: one.from.clone(),
            to: one.to.clone(),
            factor: one.factor,
        }
    }
}

impl FileRecord {
    /// Reads a file to its end; `with_path` tells where it is as well.
    ///
    /// # Errors
    /// When it cannot be read, or `progress` says that the person stopped it.
    pub fn of(
        path: &Path,
        with_path: bool,
        progress: &dyn Progress,
    ) -> Result<FileRecord, Failure> {
        let failed = |error: &std::io::Error| Failure::io("read", path, error);
        let mut file = std::fs::File::open(path).map_err(|error| failed(&error))?;
        let mut hasher = blake3::Hasher::new();
        let mut buffer = vec![0; 1 << 20];
        let mut bytes = 0;
        loop {
            if progress.cancelled() {
                return Err(Failure::cancelled());
            }
            let count = match file.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => count,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(failed(&error)),
            };
            hasher.update(buffer.get(..count).unwrap_or_default());
            bytes += count as u64;
        }
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let place = with_path.then(|| std::path::absolute(path).unwrap_or_else(|_| path.into()));
        Ok(FileRecord {
            name,
            path: place.map(|path| path.display().to_string()),
            bytes,
            blake3: hasher.finalize().to_hex().to_string(),
        })
    }
}

impl Engine {
    /// The record of a call of an installed operation.
    ///
    /// # Errors
    /// When the operation is not installed.
    pub fn call_record(&self, operation: &str, parameters: &Map) -> Result<CallRecord, Failure> {
        let (plugin, operation) = self.operation(operation)?;
        let packed = &plugin.packed;
        Ok(CallRecord {
            operation: operation.id.clone(),
            plugin: PluginRecord {
                id: packed.manifest.id.clone(),
                version: packed.manifest.version.clone(),
                library: packed.hash.clone(),
            },
            parameters: parameters.clone(),
        })
    }

    /// The record of a file that was read, for its object `object`.
    ///
    /// # Errors
    /// When the file cannot be read again.
    pub fn input_record(
        &self,
        path: &Path,
        read: &ReadFile,
        object: &str,
        progress: &dyn Progress,
    ) -> Result<InputRecord, Failure> {
        Ok(InputRecord {
            file: FileRecord::of(path, true, progress)?,
            format: read.format.clone(),
            object: object.to_owned(),
            reader: self.call_record(&read.reader, &read.options)?,
        })
    }

    /// Writes the provenance of a file that was written, beside it. Returns the path.
    ///
    /// # Errors
    /// When the file cannot be read again, or its provenance cannot be written.
    pub fn write_provenance(
        &self,
        written: &Written,
        made: Lineage,
        progress: &dyn Progress,
    ) -> Result<PathBuf, Failure> {
        let missing = || Failure::internal("a writer that wrote nothing");
        let (main, beside) = written.files.split_first().ok_or_else(missing)?;
        let beside: Result<Vec<FileRecord>, Failure> = beside
            .iter()
            .map(|path| FileRecord::of(path, false, progress))
            .collect();
        let writer = match written.writer.as_str() {
            "" => None,
            writer => Some(self.call_record(writer, &written.parameters)?),
        };
        let provenance = Provenance {
            host: env!("CARGO_PKG_VERSION").into(),
            file: FileRecord::of(main, false, progress)?,
            beside: beside?,
            object: made.object,
            number: made.number,
            platform: Platform::here(),
            writer,
            inputs: made.inputs,
            steps: made.steps,
            rest: Map::new(),
        };
        let path = path_of(main);
        files::write_whole(&path, text(&provenance).as_bytes())?;
        Ok(path)
    }
}

/// Where the provenance of a file is.
#[must_use]
pub fn path_of(file: &Path) -> PathBuf {
    let mut name = file.file_name().unwrap_or_default().to_os_string();
    name.push(SUFFIX);
    file.with_file_name(name)
}

/// The document as text with one member a line.
#[must_use]
pub fn text(provenance: &Provenance) -> String {
    let compact = puncta_documents::write(provenance, PROVENANCE);
    let value: Result<serde_json::Value, _> = serde_json::from_str(&compact);
    value.map_or(compact, |value| format!("{value:#}\n"))
}

/// Reads a provenance file.
///
/// # Errors
/// When there is none, or it is damaged.
pub fn read(path: &Path) -> Result<Provenance, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::io("read", path, &error))?;
    let mut read: Provenance = puncta_documents::parse(&text, PROVENANCE)
        .map_err(|why| Failure::bad_file(format!("{} is {why}", path.display())))?;
    // It is written anew with every document.
    read.rest.remove("format");
    Ok(read)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::{Cancel, Unwatched};
    use serde_json::json;

    fn call(operation: &str) -> CallRecord {
        CallRecord {
            operation: operation.into(),
            plugin: PluginRecord {
                id: "a.b".into(),
                version: "1.0".into(),
                library: "00".repeat(32),
            },
            parameters: json!({"seed": "7", "x": [0, "inf"]})
                .as_object()
                .cloned()
                .unwrap(),
        }
    }

    #[test]
    fn documents_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("er.tif");
        std::fs::write(&file, b"abc").unwrap();
        let record = FileRecord::of(&file, false, &Unwatched).unwrap();
        // The test vector of the three letters, from the BLAKE3 program b3sum.
        assert!(
            record
                .blake3
                .starts_with("6437b3ac38465133ffb63b75273a8db5"),
            "{record:?}"
        );
        assert_eq!((record.bytes, record.path.as_ref()), (3, None));
        let input = InputRecord {
            file: FileRecord::of(&file, true, &Unwatched).unwrap(),
            format: "csv".into(),
            object: "localisations".into(),
            reader: call("a.b.read/1"),
        };
        assert!(input.file.path.as_deref().unwrap().ends_with("er.tif"));
        let converted = ConversionRecord {
            port: "table".into(),
            column: "x".into(),
            from: "um".into(),
            to: "nm".into(),
            factor: 1000.0,
        };
        let step = StepRecord {
            name: "good".into(),
            call: call("a.b.good/1"),
            inputs: BTreeMap::from([("table".into(), vec!["locs".into()])]),
            converted: vec![converted],
        };
        let mut provenance = Provenance {
            host: "0.1.0".into(),
            file: record.clone(),
            beside: vec![record],
            object: "good.table".into(),
            number: 2,
            platform: Platform::here(),
            writer: Some(call("a.b.write/1")),
            inputs: BTreeMap::from([("locs".into(), vec![input])]),
            steps: vec![step],
            rest: Map::new(),
        };
        provenance.rest.insert("later".into(), json!(1));
        let path = path_of(&file);
        assert!(path.ends_with("er.tif.puncta.json"));
        std::fs::write(&path, text(&provenance)).unwrap();
        assert_eq!(read(&path).unwrap(), provenance);
        std::fs::write(&path, "{}").unwrap();
        assert!(
            read(&path)
                .unwrap_err()
                .to_string()
                .contains("puncta.provenance/1")
        );
    }

    #[test]
    fn hashing_can_be_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        std::fs::write(&file, b"abc").unwrap();
        let stop = Cancel::default();
        stop.cancel();
        assert!(
            FileRecord::of(&file, false, &stop)
                .unwrap_err()
                .is_cancelled()
        );
    }
}
