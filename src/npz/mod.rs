//! NumPy archives (`.npz`): named arrays in and out.
//!
//! An archive may come from anywhere, so nothing in it is believed: an array's memory is allocated as its bytes arrive,
//! never from the shape that its header claims, and every problem is an error that names the array. `npyz` would serve
//! here, but its archive support needs a C compiler (zstd, bzip2) and its header parser recurses on hostile text; a NumPy
//! header is one flat dictionary, which `npy` reads in a page.

mod array;
mod npy;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

pub use array::{Array, Data};

/// Most bytes that the compressed arrays of one archive may expand to. Uncompressed ones need no bound: they are as large
/// as the file.
const INFLATED_MAX: u64 = 4 << 30;

/// Entries above this size need the ZIP64 format.
const ZIP64_FROM: u64 = u32::MAX as u64 - (1 << 16);

/// Why an archive could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file could not be opened, read or written.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The file as a whole is not a readable archive.
    #[error("not a NumPy archive (.npz): {0}")]
    Archive(String),
    /// One array of it cannot be used.
    #[error("array `{name}`: {message}")]
    Array {
        /// Its name.
        name: String,
        /// What is wrong, and the remedy if there is one.
        message: String,
    },
}

impl From<zip::result::ZipError> for Error {
    fn from(e: zip::result::ZipError) -> Self {
        match e {
            zip::result::ZipError::Io(e) => Error::Io(e),
            e => Error::Archive(e.to_string()),
        }
    }
}

/// All arrays of the archive at `path`, by name.
pub fn read(path: &Path) -> Result<BTreeMap<String, Array>, Error> {
    read_from(BufReader::new(File::open(path)?))
}

/// All arrays of an archive. Entries that NumPy would not take for arrays (no `.npy` ending) are passed over.
pub fn read_from(reader: impl Read + Seek) -> Result<BTreeMap<String, Array>, Error> {
    let mut archive = ZipArchive::new(reader)?;
    let mut arrays = BTreeMap::new();
    let mut inflated = 0;
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i)?;
        let Some(name) = entry.name()?.strip_suffix(".npy").map(str::to_owned) else { continue };
        let limit = match entry.compression() {
            CompressionMethod::Stored => entry.compressed_size(),
            _ => INFLATED_MAX - inflated,
        };
        let array = npy::read(&mut (&mut entry).take(limit.saturating_add(1)))
            .map_err(|message| Error::Array { name: name.clone(), message })?;
        if entry.compression() != CompressionMethod::Stored {
            inflated = (inflated + array.bytes()).min(INFLATED_MAX);
        }
        if arrays.insert(name.clone(), array).is_some() {
            return Err(Error::Array { name, message: "is in the archive twice".into() });
        }
    }
    Ok(arrays)
}

/// Writes an archive of `arrays` to `path`, uncompressed as `numpy.savez` does.
pub fn write(path: &Path, arrays: &[(String, Array)]) -> Result<(), Error> {
    let mut file = BufWriter::new(File::create(path)?);
    write_to(&mut file, arrays)?;
    file.flush()?;
    Ok(())
}

/// Writes an archive of `arrays`.
pub fn write_to(writer: impl Write + Seek, arrays: &[(String, Array)]) -> Result<(), Error> {
    let mut archive = ZipWriter::new(writer);
    for (name, array) in arrays {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(array.bytes() >= ZIP64_FROM);
        archive.start_file(format!("{name}.npy"), options)?;
        npy::write(&mut archive, array)?;
    }
    archive.finish()?;
    Ok(())
}
