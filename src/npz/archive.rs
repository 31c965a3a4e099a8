//! An archive: its directory and the headers of its arrays at once, their numbers when they are asked for.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

use flate2::read::DeflateDecoder;

use super::array::Array;
use super::npy::{self, Header};
use super::zip::{self, Member, Method};
use super::{Error, file};

/// What arrays of an archive may take in memory if the caller does not say: so many bytes,
const LIMIT: u64 = 256 << 20;
/// or so many times the archive's size, whichever is more.
const EXPANSION: u64 = 100;

/// An archive that is open for reading.
pub struct Archive<R> {
    reader: R,
    members: BTreeMap<String, (Member, Header)>,
}

impl Archive<BufReader<File>> {
    /// The archive in a regular file. `limit`: most bytes that its arrays may take in memory, 8 per number; `None`:
    /// 256 MiB or 100 times the file's size.
    ///
    /// # Errors
    /// If the file cannot be read, is no archive, or one of its arrays cannot be used.
    pub fn open(path: &Path, limit: Option<u64>) -> Result<Self, Error> {
        let (file, _) = file::open(path)?;
        Archive::new(BufReader::new(file), limit)
    }
}

impl<R: Read + Seek> Archive<R> {
    /// The same from any reader.
    pub fn new(mut reader: R, limit: Option<u64>) -> Result<Self, Error> {
        let length = reader.seek(SeekFrom::End(0))?;
        let limit = limit.unwrap_or_else(|| LIMIT.max(length.saturating_mul(EXPANSION)));
        let mut archive = Archive { reader, members: BTreeMap::new() };
        let mut total = 0u64;
        for member in zip::directory(&mut archive.reader, length)? {
            let Some(name) = member.name.strip_suffix(".npy").map(str::to_owned) else { continue };
            let wrong = |message| Error::Array { name: name.clone(), message };
            let header = archive.numbers(&member, |source| npy::read_header(source)).map_err(wrong)?;
            header.check(member.size).map_err(wrong)?;
            total = total.saturating_add(header.entries().saturating_mul(8));
            if total > limit {
                return Err(wrong(too_large(total, limit, length)));
            }
            archive.members.insert(name, (member, header));
        }
        Ok(archive)
    }

    /// Names of the arrays, in alphabetical order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.members.keys().map(String::as_str)
    }

    /// Shape of an array.
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.members.get(name).map(|(_, header)| &*header.shape)
    }

    /// Passes over an array.
    pub fn remove(&mut self, name: &str) {
        self.members.remove(name);
    }

    /// Reads an array and takes it from the list; `None` if there is none of that name.
    pub fn take(&mut self, name: &str) -> Result<Option<Array>, Error> {
        let Some((member, header)) = self.members.remove(name) else { return Ok(None) };
        let read = |source: &mut dyn Read| {
            let header_again = npy::read_header(source)?;
            if header_again != header {
                return Err("changed while it was read".to_owned());
            }
            let array = npy::read_data(source, header)?;
            // Whatever follows is read too, for the sake of the checksum.
            match io::copy(source, &mut io::sink()) {
                Ok(0) => Ok(array),
                Ok(_) => Err("has more bytes than its shape says; the file is damaged".into()),
                Err(e) => Err(format!("cannot be read: {e}")),
            }
        };
        let array = self.numbers(&member, read).map_err(|message| Error::Array { name: name.to_owned(), message })?;
        Ok(Some(array))
    }

    /// All arrays that are left, by name.
    pub fn read_all(mut self) -> Result<BTreeMap<String, Array>, Error> {
        let mut arrays = BTreeMap::new();
        while let Some(name) = self.members.keys().next().cloned() {
            arrays.extend(self.take(&name)?.map(|array| (name, array)));
        }
        Ok(arrays)
    }

    /// Hands a member's expanded bytes to `f`; once these are all read, their checksum is held against the directory's.
    fn numbers<T>(&mut self, member: &Member, f: impl FnOnce(&mut dyn Read) -> Result<T, String>) -> Result<T, String> {
        self.reader.seek(SeekFrom::Start(member.start)).map_err(|e| format!("cannot be read: {e}"))?;
        let packed = (&mut self.reader).take(member.packed);
        let source: Box<dyn Read + '_> = match member.method {
            Method::Stored => Box::new(packed),
            Method::Deflated => Box::new(DeflateDecoder::new(packed)),
        };
        // One byte more than the directory says, to find that it lies.
        let mut source =
            Checked { source: source.take(member.size.saturating_add(1)), hasher: crc32fast::Hasher::new(), count: 0 };
        let out = f(&mut source)?;
        if source.count == member.size && source.hasher.finalize() != member.crc {
            return Err("does not have the checksum that the archive says; the file is damaged".into());
        }
        Ok(out)
    }
}

fn too_large(total: u64, limit: u64, length: u64) -> String {
    let gb = |bytes: u64| bytes as f64 / 1e9;
    format!(
        "would bring the arrays of this file of {length} bytes to {:.2} GB of memory, above the limit of {:.2} GB; \
         if they are meant to be so large, raise it (--input-limit {}G)",
        gb(total),
        gb(limit),
        total.div_ceil(1_000_000_000)
    )
}

/// Counts and hashes what passes.
struct Checked<R> {
    source: R,
    hasher: crc32fast::Hasher,
    count: u64,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let n = self.source.read(out)?;
        self.hasher.update(&out[..n]);
        self.count += n as u64;
        Ok(n)
    }
}

/// Hashes and counts what would be written: a member's header comes before its bytes.
#[derive(Default)]
struct Measure {
    hasher: crc32fast::Hasher,
    count: u64,
}

impl Write for Measure {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.hasher.update(bytes);
        self.count += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes an archive of `arrays`, uncompressed.
pub(super) fn write(writer: impl Write, arrays: &[(String, Array)]) -> io::Result<()> {
    let mut archive = zip::Writer::new(writer);
    for (i, (name, array)) in arrays.iter().enumerate() {
        if arrays[..i].iter().any(|(other, _)| other == name) {
            return Err(io::Error::other(format!("array `{name}` would be in the archive twice")));
        }
        let mut measure = Measure::default();
        npy::write(&mut measure, array)?;
        archive.member(&format!("{name}.npy"), measure.count, measure.hasher.finalize())?;
        npy::write(&mut archive, array)?;
    }
    archive.finish()
}
