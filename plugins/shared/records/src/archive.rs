//! Members of zip archives, within bounds.

use crate::file::{damaged, unsupported};
use puncta_sdk::Failure;
use std::fs::File;
use std::io::{BufReader, Read};
use zip::ZipArchive;
use zip::result::ZipError;

/// Deflate cannot expand beyond 1032 to 1 (two bits a 258-byte match).
pub const DEFLATE_EXPANSION: u64 = 1032;
/// Members that are looked at.
const MOST_MEMBERS: usize = 10_000;

/// An archive.
pub struct Archive {
    name: String,
    zip: ZipArchive<BufReader<File>>,
    /// Its members.
    pub members: Vec<Member>,
}

/// A file in an archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Its name with folders.
    pub name: String,
    /// Bytes, no more than its compression could have made smaller.
    pub size: u64,
    /// Where it begins in the file, if it is not compressed.
    pub stored_at: Option<u64>,
    place: usize,
}

impl Archive {
    /// Opens the archive that the person knows as `name`, and lists its members.
    ///
    /// # Errors
    /// When its directory is damaged or a member says an impossible size.
    pub fn open(name: &str, file: &File) -> Result<Archive, Failure> {
        let copy = file.try_clone();
        let copy = copy.map_err(|error| damaged(format!("{name} cannot be read: {error}")))?;
        let mut zip =
            ZipArchive::new(BufReader::new(copy)).map_err(|error| refuse(name, &error))?;
        let mut members = Vec::new();
        for place in 0..zip.len().min(MOST_MEMBERS) {
            let member = zip
                .by_index_raw(place)
                .map_err(|error| refuse(name, &error))?;
            let stored = member.compression() == zip::CompressionMethod::Stored;
            let expansion = if stored { 1 } else { DEFLATE_EXPANSION };
            let most = member
                .compressed_size()
                .saturating_mul(expansion)
                .saturating_add(64);
            if member.size() > most {
                let inner = name_of(&member.name());
                return Err(damaged(format!(
                    "{name} says an impossible size of {inner}"
                )));
            }
            let whole = stored && !member.encrypted() && member.size() == member.compressed_size();
            members.push(Member {
                name: name_of(&member.name()),
                size: member.size(),
                stored_at: member.data_start().filter(|_| whole),
                place,
            });
        }
        Ok(Archive {
            name: name.into(),
            zip,
            members,
        })
    }

    /// The member of that name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<&Member> {
        self.members.iter().find(|member| member.name == name)
    }

    /// The bytes of a member, one after the other; never more than its size.
    ///
    /// # Errors
    /// When it is damaged, encrypted, or compressed in a way that is not read.
    pub fn stream(&mut self, member: &Member) -> Result<impl Read + '_, Failure> {
        let name = &self.name;
        let stream = self
            .zip
            .by_index(member.place)
            .map_err(|error| refuse(name, &error))?;
        Ok(stream.take(member.size))
    }

    /// A whole member of at most `most` bytes.
    ///
    /// # Errors
    /// As [`Archive::stream`], or when it is larger.
    pub fn bytes(&mut self, member: &Member, most: u64) -> Result<Vec<u8>, Failure> {
        let name = self.name.clone();
        let inner = &member.name;
        if member.size > most {
            let message = format!(
                "{inner} in {name} has {} bytes, more than {most}",
                member.size
            );
            return Err(unsupported(message, "take it out of the archive"));
        }
        let mut bytes = Vec::new();
        let read = self.stream(member)?.read_to_end(&mut bytes);
        match read {
            Ok(read) if read as u64 == member.size => Ok(bytes),
            _ => Err(damaged(format!("{inner} in {name} is damaged"))),
        }
    }
}

/// A name as text; empty if it is none, so that nothing looks for it.
fn name_of<E>(name: &Result<std::borrow::Cow<'_, str>, E>) -> String {
    name.as_ref()
        .map_or_else(|_| String::new(), ToString::to_string)
}

fn refuse(name: &str, error: &ZipError) -> Failure {
    match error {
        ZipError::UnsupportedArchive(what) => unsupported(
            format!("{name} cannot be read: {what}"),
            "pack it again as plain zip",
        ),
        _ => damaged(format!("{name} is a damaged zip archive")),
    }
}
