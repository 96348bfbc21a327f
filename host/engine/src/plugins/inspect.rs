//! Looking at a library without running anything of it.

use object::{Object as _, ObjectSymbol as _};
use puncta_abi::{ABI_NUMBER, SYMBOL, SYMBOL_PREFIX};
use puncta_documents::{Failure, FailureCode};
use puncta_door::DOOR_SYMBOL;
use std::path::Path;

/// What a library's bytes say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Inspected {
    /// BLAKE3 of the bytes.
    pub hash: [u8; 32],
    /// Whether it has the door, as plugins in Rust do.
    pub door: bool,
}

/// Hash as text.
#[must_use]
pub fn hex(hash: &[u8; 32]) -> String {
    blake3::Hash::from_bytes(*hash).to_hex().to_string()
}

/// Checks that the bytes are a whole library for this machine that exports a plugin.
///
/// # Errors
/// One sentence: what the file is instead, and what to do.
pub fn inspect(path: &Path, bytes: &[u8]) -> Result<Inspected, Failure> {
    let shown = path.display();
    let refuse = |why: String, remedy: &str| {
        Failure::new(FailureCode::Unsupported, format!("{shown} {why}")).remedy(remedy)
    };
    let again = "copy or build it again";
    if bytes.is_empty() {
        return Err(refuse("is empty".into(), again));
    }
    let file = object::File::parse(bytes)
        .map_err(|_| refuse("is no library, or only a part of one".into(), again))?;
    check_machine(&file).map_err(|why| refuse(why, "build it for this system"))?;
    if !whole(bytes, &file) {
        return Err(refuse("is only a part of a library".into(), again));
    }
    let symbols: Vec<&str> = file
        .dynamic_symbols()
        .filter(|symbol| symbol.is_definition())
        .filter_map(|symbol| symbol.name().ok())
        .collect();
    // Mach-O puts an underscore before each name.
    let has = |name: &str| {
        symbols
            .iter()
            .any(|s| *s == name || s.strip_prefix('_') == Some(name))
    };
    if has(SYMBOL) {
        let hash = *blake3::hash(bytes).as_bytes();
        return Ok(Inspected {
            hash,
            door: has(DOOR_SYMBOL),
        });
    }
    let other = symbols.iter().find_map(|symbol| {
        symbol
            .trim_start_matches('_')
            .strip_prefix(SYMBOL_PREFIX)?
            .strip_prefix("0_")
    });
    Err(match other {
        Some(number) => refuse(
            format!("was built for ABI number {number}, and this host has {ABI_NUMBER}"),
            "build it with this host's SDK",
        ),
        None => refuse(
            "is a library, but no Puncta plugin".into(),
            "choose a plugin",
        ),
    })
}

fn check_machine(file: &object::File<'_>) -> Result<(), String> {
    let expected = match std::env::consts::ARCH {
        "x86_64" => object::Architecture::X86_64,
        "aarch64" => object::Architecture::Aarch64,
        _ => return Ok(()),
    };
    let found = file.architecture();
    if found != expected {
        return Err(format!(
            "was built for {found:?}, and this is {}",
            std::env::consts::ARCH
        ));
    }
    let format = match std::env::consts::OS {
        "macos" => object::BinaryFormat::MachO,
        "windows" => object::BinaryFormat::Pe,
        _ => object::BinaryFormat::Elf,
    };
    if file.format() != format {
        return Err(format!(
            "was built for another system than {}",
            std::env::consts::OS
        ));
    }
    if !matches!(file.kind(), object::ObjectKind::Dynamic) {
        return Err("is a program or an object file, not a dynamic library".into());
    }
    Ok(())
}

/// Whether every segment that the loader would map lies in the file: mapping past the end kills
/// the process.
fn whole(bytes: &[u8], file: &object::File<'_>) -> bool {
    use object::ObjectSegment as _;
    file.segments().all(|segment| {
        let (offset, size) = segment.file_range();
        offset
            .checked_add(size)
            .is_some_and(|end| end <= bytes.len() as u64)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_plugin_is_named() {
        let path = Path::new("x.so");
        let text = |bytes: &[u8]| inspect(path, bytes).unwrap_err().to_string();
        assert!(text(b"").contains("is empty"));
        assert!(text(b"hello").contains("no library"));
        let own = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        assert!(text(&own).contains("no Puncta plugin") || text(&own).contains("not a dynamic"));
        assert!(text(&own[..own.len() / 2]).contains("part of"));
    }
}
