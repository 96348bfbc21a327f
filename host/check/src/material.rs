//! What the calls of a check work on: the examples of the plugin, made once and kept in a folder.

use crate::item::{Cells, Item};
use crate::setting::Setting;
use puncta_engine::documents::manifest::{ExampleFile, Step};
use puncta_engine::documents::{
    ColumnInfo, Element, Failure, FileRef, Header, ImageInfo, Kind, Manifest, Map, Operation,
    OperationKind, Port, schema,
};
use puncta_engine::engine::{Invocation, Options};
use puncta_engine::plugins::catalogue::Folder;
use puncta_engine::{Engine, Isolation, Object, Progress, Unwatched};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows of a table that no example describes.
const ROWS: u64 = 1000;
const FILE: &str = "material.json";

/// What the example of one operation is.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Example {
    /// Parameters in their canonical form.
    pub parameters: Map,
    /// Files of inputs by port.
    pub inputs: Vec<(String, PathBuf)>,
    /// Readers: the file.
    pub file: Option<PathBuf>,
    /// Why there is none.
    pub trouble: Option<String>,
    /// What had to be made up.
    pub note: Option<String>,
}

/// The examples of a plugin.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Material {
    /// By operation.
    pub examples: BTreeMap<String, Example>,
    /// Files of formats of other plugins.
    pub others: Vec<PathBuf>,
}

/// The engine's options for looking at one library, which comes first, and is trusted for this time.
///
/// # Errors
/// When the library cannot be described, or there is no room for temporary files.
pub fn options(usual: &Options, folder: &Path, library: &Path) -> Result<Options, Failure> {
    let options = again(usual, folder, library);
    let config = folder.join("config");
    std::fs::create_dir_all(&config).map_err(|error| Failure::io("create", &config, &error))?;
    // Other libraries that the person trusts may make inputs for examples.
    let kept = usual
        .config
        .as_ref()
        .map(|config| config.join("settings.json"));
    if let Some(kept) = kept.filter(|kept| kept.is_file()) {
        let copy = config.join("settings.json");
        std::fs::copy(&kept, &copy).map_err(|error| Failure::io("copy", &kept, &error))?;
    }
    Engine::open(options.clone())?.trust(&library.display().to_string())?;
    Ok(options)
}

/// As [`options`], once the library is trusted.
#[must_use]
pub fn again(usual: &Options, folder: &Path, library: &Path) -> Options {
    let mut options = usual.clone();
    let path = library.parent().unwrap_or(folder).to_path_buf();
    options.folders.insert(
        0,
        Folder {
            path,
            bundled: false,
        },
    );
    options.config = Some(folder.join("config"));
    options.state = None;
    options.cache = folder.join("cache");
    options.isolation = Isolation::Always;
    options.threads = 2;
    options
}

struct Maker<'a> {
    engine: &'a Engine,
    folder: &'a Path,
    made: BTreeMap<String, Result<PathBuf, String>>,
    watch: Arc<dyn Progress>,
}

impl Material {
    /// Makes the examples of a plugin and keeps them in a folder.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn make(engine: &Engine, manifest: &Manifest, folder: &Path) -> Result<Material, Failure> {
        let mut maker = Maker {
            engine,
            folder,
            made: BTreeMap::new(),
            watch: Arc::new(Unwatched),
        };
        let mut material = Material::default();
        for operation in &manifest.operations {
            let example = maker.example(operation)?;
            material.examples.insert(operation.id.clone(), example);
        }
        let others = folder.join("others");
        std::fs::create_dir_all(&others).map_err(|error| Failure::io("create", &others, &error))?;
        for (plugin, operation) in engine.catalogue().operations() {
            let file = operation.example.as_ref().and_then(|one| one.file.as_ref());
            if plugin.packed.manifest.id == manifest.id || operation.kind != OperationKind::Reader {
                continue;
            }
            if let Some((file, bytes)) = file.and_then(|file| Some((file, content(file)?))) {
                let path = others.join(format!("{}-{}", material.others.len(), plain(&file.name)));
                std::fs::write(&path, bytes).map_err(|e| Failure::io("write", &path, &e))?;
                material.others.push(path);
            }
        }
        let path = folder.join(FILE);
        let text = serde_json::to_vec(&material).unwrap_or_default();
        std::fs::write(&path, text).map_err(|error| Failure::io("write", &path, &error))?;
        Ok(material)
    }

    /// What [`Material::make`] kept; nothing if it was not made.
    pub fn load(folder: &Path) -> Material {
        let text = std::fs::read(folder.join(FILE)).unwrap_or_default();
        serde_json::from_slice(&text).unwrap_or_default()
    }

    /// The call of an operation's example; writers write into `scratch`.
    ///
    /// # Errors
    /// Why there is none.
    pub fn setting(&self, operation: &Operation, scratch: &Path) -> Result<Setting, String> {
        let example = self
            .examples
            .get(&operation.id)
            .ok_or("its example was not made")?;
        if let Some(trouble) = &example.trouble {
            return Err(trouble.clone());
        }
        let mut setting = Setting::new(&operation.id, example.parameters.clone());
        for (port, path) in &example.inputs {
            let item = Item::load(path).map_err(|error| format!("its example is lost: {error}"))?;
            setting.inputs.push((port.clone(), Arc::new(item)));
        }
        setting.file = match operation.kind {
            OperationKind::Reader => example.file.as_deref().map(reference),
            OperationKind::Writer => {
                let rule = operation.file.as_ref();
                let suffix = rule.and_then(|rule| rule.suffixes.first());
                let suffix = suffix.map_or("", String::as_str);
                Some(reference(&scratch.join(format!("written{suffix}"))))
            }
            OperationKind::Operation => None,
        };
        Ok(setting)
    }
}

/// A file of a call.
pub fn reference(path: &Path) -> FileRef {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    FileRef {
        path: path.display().to_string(),
        name: name.into_owned(),
        size: path.metadata().ok().map(|found| found.len()),
    }
}

/// A name of the plugin's that cannot lead out of a folder.
fn plain(name: &str) -> String {
    let name = Path::new(name).file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

fn content(file: &ExampleFile) -> Option<Vec<u8>> {
    if let Some(text) = &file.text {
        return Some(text.as_bytes().to_vec());
    }
    let (pairs, _) = file.hex.as_ref()?.as_bytes().as_chunks::<2>();
    let byte = |pair: &[u8; 2]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    pairs.iter().map(byte).collect()
}

impl Maker<'_> {
    fn example(&mut self, operation: &Operation) -> Result<Example, Failure> {
        let declared = operation.example.clone().unwrap_or_default();
        let mut example = Example::default();
        match schema::canonical(&operation.parameters, &declared.parameters) {
            Ok(parameters) => example.parameters = parameters,
            Err(failure) => example.trouble = Some(failure.to_string()),
        }
        for port in &operation.inputs {
            let made = match declared.inputs.get(&port.name) {
                Some(step) => self.made(step).or_else(|why| {
                    example.note = Some(format!("{} had to be made up: {why}", port.name));
                    self.generated(port, &example.parameters)
                }),
                None if port.optional => continue,
                None => self.generated(port, &example.parameters),
            };
            match made {
                Ok(path) => example.inputs.push((port.name.clone(), path)),
                Err(why) => {
                    let what = format!("the example's input {} cannot be made: {why}", port.name);
                    example.trouble = Some(what);
                }
            }
        }
        if let Some(file) = &declared.file
            && operation.kind == OperationKind::Reader
        {
            let folder = self
                .folder
                .join("files")
                .join(plain(&operation.id.replace('/', "-")));
            std::fs::create_dir_all(&folder).map_err(|e| Failure::io("create", &folder, &e))?;
            let path = folder.join(plain(&file.name));
            match content(file) {
                Some(bytes) => {
                    std::fs::write(&path, bytes).map_err(|e| Failure::io("write", &path, &e))?;
                    example.file = Some(path);
                }
                None => example.trouble = Some("the example's file has no content".into()),
            }
        } else if operation.kind == OperationKind::Reader {
            example.trouble = Some("its example has no file".into());
        }
        Ok(example)
    }

    fn made(&mut self, step: &Step) -> Result<PathBuf, String> {
        let key = serde_json::to_string(step).unwrap_or_default();
        if let Some(made) = self.made.get(&key) {
            return made.clone();
        }
        let made = self.step(step).and_then(|object| self.keep(&object));
        self.made.insert(key, made.clone());
        made
    }

    fn keep(&self, object: &Object) -> Result<PathBuf, String> {
        let item = Item::of(object).map_err(|failure| failure.to_string())?;
        self.save(&item)
    }

    fn save(&self, item: &Item) -> Result<PathBuf, String> {
        let count = std::fs::read_dir(self.folder).map_or(0, Iterator::count);
        let path = self.folder.join(format!("{count}.item"));
        item.save(&path).map_err(|error| error.to_string())?;
        Ok(path)
    }

    fn step(&self, step: &Step) -> Result<Object, String> {
        let mut invocation = Invocation {
            operation: step.op.clone(),
            parameters: step.parameters.clone(),
            ..Invocation::default()
        };
        for (port, inner) in &step.inputs {
            invocation.inputs.push((port.clone(), self.step(inner)?));
        }
        let called = self.engine.call(&invocation, &self.watch);
        let outputs = called.map_err(|failure| failure.to_string())?.outputs;
        let wanted = step.output.as_deref();
        let mut outputs = outputs.into_iter();
        outputs
            .find(|(port, _)| wanted.is_none_or(|name| name == port))
            .map(|(_, object)| object)
            .ok_or_else(|| format!("{} gives no such output", step.op))
    }

    /// An input for a port whose operation declares no example for it.
    fn generated(&self, port: &Port, parameters: &Map) -> Result<PathBuf, String> {
        let item = match port.kind {
            Kind::Table => table(port, parameters),
            Kind::Image => image(),
            kind => return Err(format!("its example has no {kind} for it")),
        };
        self.save(&item)
    }
}

/// Numbers that look random, between 0 and 1.
pub fn noise(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A table with the columns that a port needs.
fn table(port: &Port, parameters: &Map) -> Item {
    let mut columns: Vec<ColumnInfo> = Vec::new();
    for need in &port.columns {
        let name = match need.name.strip_prefix('$') {
            Some(parameter) => parameters.get(parameter).and_then(|value| value.as_str()),
            None => Some(need.name.as_str()),
        };
        if let Some(name) = name
            && !columns.iter().any(|column| column.name == name)
        {
            let unit = need.unit.as_deref().unwrap_or("1");
            columns.push(ColumnInfo::new(name, Element::F64, unit));
        }
    }
    if columns.is_empty() {
        let usual = [("x", "nm"), ("y", "nm"), ("t", "frame"), ("A", "photon")];
        columns.extend(usual.map(|(name, unit)| ColumnInfo::new(name, Element::F64, unit)));
    }
    let cells = columns.iter().enumerate().map(|(at, column)| {
        let value = |row: u64| match column.unit.as_str() {
            "frame" => row as f64,
            _ => 1000.0 * noise(row * 31 + at as u64),
        };
        Cells {
            data: (0..ROWS).flat_map(|row| value(row).to_le_bytes()).collect(),
            ..Cells::default()
        }
    });
    let cells = cells.collect();
    Item {
        header: Header::table(&port.name, ROWS, columns),
        parts: vec![cells],
    }
}

fn image() -> Item {
    let info = ImageInfo::plane(64, 64, 10.0, 0.0, 0.0);
    let value = |i: u64| (100.0 * noise(i)) as f32;
    let data = (0..64 * 64).flat_map(|i| value(i).to_le_bytes()).collect();
    Item {
        header: Header::image("image", info, Element::F32, "1"),
        parts: vec![vec![Cells {
            data,
            ..Cells::default()
        }]],
    }
}
