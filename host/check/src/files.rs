//! Checks of readers and writers.

use crate::check::Check;
use crate::child::{Case, Found, Ground, Verdict, survives};
use crate::host::Session;
use crate::material::{noise, reference};
use crate::plugin::Instance;
use crate::setting::Setting;
use puncta_abi as abi;
use puncta_engine::documents::{FileRule, OperationKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A check of one operation.
type One = fn(&Ground, &Instance, &Case<'_>) -> Result<(), String>;

pub fn find(check: Check, ground: &Ground) -> Option<Found> {
    let (kind, one): (_, One) = match check {
        Check::Probes => (OperationKind::Reader, probes),
        Check::OthersFiles => (OperationKind::Reader, others_files),
        Check::DamagedFiles => (OperationKind::Reader, damaged_files),
        Check::WriterWrites => (OperationKind::Writer, writer_writes),
        Check::WriterFails => (OperationKind::Writer, writer_fails),
        _ => return None,
    };
    Some(ground.instance().and_then(|instance| {
        let mut operations = instance.manifest.operations.iter();
        if !operations.any(|operation| operation.kind == kind) {
            return Ok(Verdict::Skipped(match kind {
                OperationKind::Writer => "it has no writer",
                _ => "it has no reader",
            }));
        }
        ground.each(&instance, |case| {
            if case.operation.kind != kind {
                return Ok(());
            }
            one(ground, &instance, case)
        })
    }))
}

fn probes(_: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let session = Arc::new(Session::new(&case.full));
    let prepared = instance.prepare(&session, &case.full);
    let prepared = prepared.map_err(|ended| ended.how())?;
    let probe = prepared.plan.probe.clone();
    instance.drop(prepared);
    let probe = probe.ok_or("its plan does not say what the file is")?;
    if probe.format.trim().is_empty() {
        return Err("its plan does not name the format".into());
    }
    if !(0.0..=1.0).contains(&probe.confidence) {
        return Err(format!(
            "it is certain by {}, which is not between 0 and 1",
            probe.confidence
        ));
    }
    Ok(())
}

/// Beginnings of files of widespread formats: name, content, and whether it is text.
fn samples() -> Vec<(&'static str, Vec<u8>, bool)> {
    let padded = |head: &[u8]| {
        let mut bytes = head.to_vec();
        bytes.resize(600, 0);
        bytes
    };
    let random = (0..600).map(|i| (256.0 * noise(i)) as u8).collect();
    let utf16 = "x,y\n1,2\n".encode_utf16().flat_map(u16::to_le_bytes);
    vec![
        ("a.png", padded(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"), false),
        ("a.jpg", padded(b"\xff\xd8\xff\xe0\0\x10JFIF\0"), false),
        ("a.tif", padded(b"II*\0\x08\0\0\0\x01\0"), false),
        ("a.h5", padded(b"\x89HDF\r\n\x1a\n"), false),
        ("a.zip", padded(b"PK\x03\x04\x14\0"), false),
        ("a.gz", padded(b"\x1f\x8b\x08\0"), false),
        ("a.pdf", padded(b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n"), false),
        ("a.npy", padded(b"\x93NUMPY\x01\0v\0{'descr': '<f8'"), false),
        ("a.sqlite", padded(b"SQLite format 3\0"), false),
        ("a.elf", padded(b"\x7fELF\x02\x01\x01\0"), false),
        ("zeros.bin", vec![0; 600], false),
        ("random.bin", random, false),
        ("empty.bin", Vec::new(), false),
        ("utf16.txt", utf16.collect(), true),
        (
            "a.json",
            b"{\"name\": [1, 2, {\"a\": null}]}\n".to_vec(),
            true,
        ),
        (
            "a.xml",
            b"<?xml version=\"1.0\"?>\n<root><a b=\"1\"/></root>\n".to_vec(),
            true,
        ),
        (
            "a.txt",
            b"It was a bright cold day in April.\nAnd so on.\n".to_vec(),
            true,
        ),
    ]
}

fn has_magic(rule: &FileRule, bytes: &[u8]) -> bool {
    let head: String = bytes
        .iter()
        .take(64)
        .map(|byte| format!("{byte:02x}"))
        .collect();
    rule.magic
        .iter()
        .any(|magic| head.starts_with(&magic.to_lowercase()))
}

fn others_files(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let rule = case.operation.file.clone().unwrap_or_default();
    let folder = ground.scratch();
    let own = rule.suffixes.first().cloned().unwrap_or_default();
    let mut foreign: Vec<(String, Vec<u8>, bool)> = samples()
        .into_iter()
        .map(|(name, bytes, text)| (name.to_owned(), bytes, text))
        .collect();
    for path in &ground.material.others {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let name = name.into_owned();
        let bytes = std::fs::read(path).unwrap_or_default();
        // Another reader of the same files is no stranger.
        if rule
            .suffixes
            .iter()
            .any(|suffix| name.to_lowercase().ends_with(suffix.as_str()))
        {
            continue;
        }
        let text = std::str::from_utf8(&bytes).is_ok_and(|text| !text.contains('\0'));
        foreign.push((name, bytes, text));
    }
    for (name, bytes, text) in foreign {
        if has_magic(&rule, &bytes) || (rule.generic && text) {
            continue;
        }
        for shown in [name.clone(), format!("{name}{own}")] {
            let path = folder.join(&shown);
            std::fs::write(&path, &bytes).map_err(|error| error.to_string())?;
            ground.doing(&format!("{} of {shown}", case.operation.id));
            says_no(instance, &case.full, &path)?;
        }
    }
    Ok(())
}

fn says_no(instance: &Instance, base: &Setting, path: &Path) -> Result<(), String> {
    let mut setting = base.clone();
    setting.file = Some(reference(path));
    let session = Arc::new(Session::new(&setting));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    match instance.prepare(&session, &setting) {
        Err(ended) if ended.status == abi::STATUS_NOT_MINE => Ok(()),
        Err(ended) => ended.decent().map_err(|why| format!("{name}: {why}")),
        Ok(prepared) => {
            let certain = prepared
                .plan
                .probe
                .as_ref()
                .map_or(1.0, |one| one.confidence);
            instance.drop(prepared);
            if certain > 0.0 {
                return Err(format!("it takes {name} for a file of its own"));
            }
            Ok(())
        }
    }
}

fn damaged_files(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let Some(file) = &case.full.file else {
        return Ok(());
    };
    let whole = std::fs::read(&file.path).map_err(|error| error.to_string())?;
    let size = whole.len();
    let mut damaged: Vec<(String, Vec<u8>)> = Vec::new();
    for part in [0, 1, 2, 4, 8, size / 4, size / 2, size.saturating_sub(1)] {
        let part = part.min(size);
        damaged.push((format!("the first {part} bytes"), whole[..part].to_vec()));
    }
    for at in 0..24_u64 {
        let place = (noise(at) * size as f64) as usize;
        let mut bytes = whole.clone();
        if let Some(byte) = bytes.get_mut(place) {
            *byte = [0xff, 0, b'9', b'\n'][at as usize % 4];
            damaged.push((format!("another byte at {place}"), bytes));
        }
    }
    let path: PathBuf = ground.scratch().join(&file.name);
    for (what, bytes) in damaged {
        std::fs::write(&path, bytes).map_err(|error| error.to_string())?;
        let mut setting = case.full.clone();
        setting.file = Some(reference(&path));
        ground.doing(&format!("{} with {what}", case.operation.id));
        survives(instance, &setting, &format!("with {what}"))?;
    }
    Ok(())
}

fn writer_writes(_: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let Some(file) = &case.full.file else {
        return Ok(());
    };
    instance.call(&case.full).good()?;
    match std::fs::metadata(&file.path) {
        Ok(found) if found.len() > 0 => Ok(()),
        Ok(_) => Err("it leaves an empty file".into()),
        Err(_) => Err("it does not write the file that it was told to write".into()),
    }
}

fn writer_fails(ground: &Ground, instance: &Instance, case: &Case<'_>) -> Result<(), String> {
    let Some(file) = &case.full.file else {
        return Ok(());
    };
    let mut setting = case.full.clone();
    let path = ground.scratch().join("no such folder").join(&file.name);
    setting.file = Some(reference(&path));
    ground.doing(&format!("{} into no folder", case.operation.id));
    let ended = survives(instance, &setting, "into a folder that is not there")?;
    if ended.ok() {
        return Err("it says that it wrote into a folder that is not there".into());
    }
    Ok(())
}
