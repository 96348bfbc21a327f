//! Where the bytes of a table come from, and their encoding.

use std::borrow::Cow;
use std::fs::File;
use std::io;

/// Bytes of known length that several threads read at once.
pub trait Source: Sync {
    /// The number of bytes.
    fn len(&self) -> u64;
    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Fills as much of `buffer` as there is from `offset`; returns the number of bytes.
    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize>;
}

/// A file on disk; its length is taken once.
#[derive(Debug)]
pub struct FileSource {
    file: File,
    len: u64,
}

impl FileSource {
    /// Takes an open file.
    pub fn new(file: File) -> io::Result<FileSource> {
        let len = file.metadata()?.len();
        Ok(FileSource { file, len })
    }

    #[cfg(unix)]
    fn read_some(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        std::os::unix::fs::FileExt::read_at(&self.file, buffer, offset)
    }

    #[cfg(windows)]
    fn read_some(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        std::os::windows::fs::FileExt::seek_read(&self.file, buffer, offset)
    }
}

impl Source for FileSource {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        let mut done = 0;
        while let Some(rest) = buffer.get_mut(done..).filter(|r| !r.is_empty()) {
            match self.read_some(offset + done as u64, rest) {
                Ok(0) => break,
                Ok(n) => done += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        Ok(done)
    }
}

impl Source for Vec<u8> {
    fn len(&self) -> u64 {
        self.as_slice().len() as u64
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        let rest = usize::try_from(offset)
            .ok()
            .and_then(|o| self.get(o..))
            .unwrap_or(&[]);
        let n = rest.len().min(buffer.len());
        if let (Some(to), Some(from)) = (buffer.get_mut(..n), rest.get(..n)) {
            to.copy_from_slice(from);
        }
        Ok(n)
    }
}

/// The encoding of a file's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// UTF-8, or single bytes that are taken as Latin-1 where they are no UTF-8.
    Bytes,
    /// UTF-16, little endian.
    Utf16Little,
    /// UTF-16, big endian.
    Utf16Big,
}

/// The encoding by the mark at the start, or by every other byte being NUL; and the mark's length.
pub fn detect(head: &[u8]) -> (Encoding, usize) {
    match head {
        [0xef, 0xbb, 0xbf, ..] => return (Encoding::Bytes, 3),
        [0xff, 0xfe, ..] => return (Encoding::Utf16Little, 2),
        [0xfe, 0xff, ..] => return (Encoding::Utf16Big, 2),
        _ => {}
    }
    let pairs: Vec<(bool, bool)> = head.chunks_exact(2).take(512).map(zeros).collect();
    let all = |want: (bool, bool)| pairs.len() >= 4 && pairs.iter().all(|p| *p == want);
    if all((false, true)) {
        (Encoding::Utf16Little, 0)
    } else if all((true, false)) {
        (Encoding::Utf16Big, 0)
    } else {
        (Encoding::Bytes, 0)
    }
}

fn zeros(pair: &[u8]) -> (bool, bool) {
    (pair.first() == Some(&0), pair.last() == Some(&0))
}

/// UTF-16 as UTF-8; lone surrogates become U+FFFD.
pub fn from_utf16(bytes: &[u8], encoding: Encoding) -> Vec<u8> {
    let units = bytes
        .chunks_exact(2)
        .filter_map(|c| c.first_chunk::<2>())
        .map(|c| match encoding {
            Encoding::Utf16Big => u16::from_be_bytes(*c),
            _ => u16::from_le_bytes(*c),
        });
    let letters = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER));
    letters.collect::<String>().into_bytes()
}

/// Text of a field: UTF-8, otherwise Latin-1.
pub fn text(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|b| char::from(*b)).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_and_utf16_without_a_mark() {
        let little: Vec<u8> = "x,y\n1,2\n"
            .encode_utf16()
            .flat_map(u16::to_le_bytes)
            .collect();
        let big: Vec<u8> = "x,µ\n1,2\n"
            .encode_utf16()
            .flat_map(u16::to_be_bytes)
            .collect();
        assert_eq!(detect(&little), (Encoding::Utf16Little, 0));
        assert_eq!(detect(b"\xef\xbb\xbfx,y"), (Encoding::Bytes, 3));
        assert_eq!(detect(b"\xff\xfex\0"), (Encoding::Utf16Little, 2));
        assert_eq!(detect(b"x,y\n1,2\n"), (Encoding::Bytes, 0));
        assert_eq!(detect(&[0; 64]), (Encoding::Bytes, 0));
        assert_eq!(from_utf16(&little, Encoding::Utf16Little), b"x,y\n1,2\n");
        assert_eq!(
            from_utf16(&big, Encoding::Utf16Big),
            "x,µ\n1,2\n".as_bytes()
        );
    }

    #[test]
    fn latin_1_where_it_is_no_utf8() {
        assert_eq!(text(b"x [\xb5m]"), "x [µm]");
        assert_eq!(text("x [µm]".as_bytes()), "x [µm]");
    }
}
