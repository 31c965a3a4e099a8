//! NumPy archives (`.npz`): named arrays in and out.
//!
//! An archive may come from anywhere, so nothing in it is believed: the directory is checked as a whole, an array's header
//! is read and held against its member's size before its numbers are, memory is allocated as bytes arrive, and every
//! problem is an error that names the array. `npyz` would serve here, but its archive support needs a C compiler (zstd,
//! bzip2) and its header parser recurses on hostile text; a NumPy header is one flat dictionary, which `npy` reads in a page.

mod archive;
mod array;
mod file;
mod npy;
#[cfg(test)]
mod tests;
mod zip;

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, Write};
use std::path::Path;

pub use archive::Archive;
pub use array::{Array, Data};
pub use file::check_writable;

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

/// All arrays of the archive at `path`, by name.
pub fn read(path: &Path) -> Result<BTreeMap<String, Array>, Error> {
    Archive::open(path, None)?.read_all()
}

/// All arrays of an archive. Entries that NumPy would not take for arrays (no `.npy` ending) are passed over.
pub fn read_from(reader: impl Read + Seek) -> Result<BTreeMap<String, Array>, Error> {
    Archive::new(reader, None)?.read_all()
}

/// Writes an archive of `arrays` to `path`, uncompressed as `numpy.savez` does. The file appears whole or not at all.
pub fn write(path: &Path, arrays: &[(String, Array)]) -> Result<(), Error> {
    Ok(file::write(path, |writer| archive::write(writer, arrays))?)
}

/// Writes an archive of `arrays`.
pub fn write_to(writer: impl Write, arrays: &[(String, Array)]) -> Result<(), Error> {
    Ok(archive::write(writer, arrays)?)
}
