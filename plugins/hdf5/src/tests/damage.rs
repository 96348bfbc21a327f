//! Truncated, altered and hostile files: an error or values, never a crash or a long wait.

use std::path::Path;
use std::time::{Duration, Instant};

use puncta_sdk::Failure;

use super::call;
use super::write::{Packing, h5r, picasso};

/// Plans, and reads everything that a file offers; gives the first failure.
fn read_all(path: &Path) -> Result<(), Failure> {
    for output in call(path).prepare()?.outputs {
        let rows = output.header.rows();
        assert!(rows < 10_000_000, "{rows} rows are believed");
    }
    call(path).threads(1).run().map(drop)
}

/// Reads a damaged copy; at most 2 s on a quiet machine, and failures are one sentence.
fn survive(path: &Path, bytes: &[u8], what: &str) -> bool {
    std::fs::write(path, bytes).unwrap();
    let start = Instant::now();
    let outcome = read_all(path);
    assert!(
        start.elapsed() < Duration::from_secs(8),
        "{what} took {:?}",
        start.elapsed()
    );
    if let Err(failure) = &outcome {
        let said = failure.to_string();
        assert!(
            said.contains("damaged.h5") && failure.remedy.is_some(),
            "{what}: {said}"
        );
        assert!(
            said.lines().count() == 1 && said.len() < 500,
            "{what}: {said}"
        );
    }
    outcome.is_ok()
}

fn fixtures() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let mut files = vec![std::fs::read(picasso(folder.path(), 300, None)).unwrap()];
    for packing in [
        Packing::ShuffledDeflated,
        Packing::Checked,
        Packing::Lzf,
        Packing::Blosc,
    ] {
        files.push(std::fs::read(h5r(folder.path(), 300, packing)).unwrap());
    }
    files
}

#[test]
fn truncated_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.h5");
    for (file, bytes) in fixtures().iter().enumerate() {
        assert!(survive(&path, bytes, "the whole file"));
        for place in 0..64 {
            let cut = bytes.len() * place / 64;
            let what = format!("file {file} cut at {cut}");
            assert!(!survive(&path, &bytes[..cut], &what), "{what} was read");
        }
    }
}

#[test]
fn altered_bytes_never_crash() {
    alter(200, 0x2545_f491_4f6c_dd1d);
}

#[test]
#[ignore = "slow: some minutes"]
fn many_altered_bytes_never_crash() {
    alter(10_000, 0x9e37_79b9_7f4a_7c15);
}

fn alter(flips: usize, mut state: u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.h5");
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize
    };
    let files = fixtures();
    let mut refused = 0;
    for flip in 0..flips {
        let mut bytes = files[flip % files.len()].clone();
        // Half of the changes go to the structures at the head of the file.
        let reach = if flip % 2 == 0 {
            bytes.len()
        } else {
            bytes.len().min(4096)
        };
        let at = random() % reach;
        let value = [0x00, 0xff, bytes[at] ^ 1, bytes[at] ^ 0x80, random() as u8][flip % 5];
        bytes[at] = value;
        refused += usize::from(!survive(
            &path,
            &bytes,
            &format!("flip {flip} at {at} to {value}"),
        ));
    }
    assert!(refused > 10, "the changes must hit something: {refused}");
}

/// Replaces each little-endian `from` in the file.
fn replace(bytes: &[u8], from: u64, to: u64) -> (Vec<u8>, usize) {
    let (from, to, mut out, mut count) = (from.to_le_bytes(), to.to_le_bytes(), bytes.to_vec(), 0);
    for at in 0..bytes.len().saturating_sub(8) {
        if bytes[at..at + 8] == from {
            out[at..at + 8].copy_from_slice(&to);
            count += 1;
        }
    }
    (out, count)
}

#[test]
fn more_rows_than_bytes_are_refused_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.h5");
    for (file, bytes) in fixtures().iter().enumerate() {
        for rows in [1 << 60, 1 << 40, u64::MAX / 36, 50_000_000, 20_000] {
            let (hostile, count) = replace(bytes, 300, rows);
            assert!(count > 0);
            assert!(!survive(
                &path,
                &hostile,
                &format!("file {file} with {rows} rows")
            ));
        }
    }
}
