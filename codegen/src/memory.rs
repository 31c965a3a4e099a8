//! Memory for code: written first, then made executable, never both at once.

use memmap2::{Mmap, MmapMut};

/// Pages of code that can be executed and not written.
pub(crate) struct ExecutableMemory {
    pages: Mmap,
    len: usize,
}

impl ExecutableMemory {
    /// Maps pages with the code.
    ///
    /// # Errors
    ///
    /// If the system refuses memory, or to make it executable.
    pub fn new(code: &[u8]) -> std::io::Result<Self> {
        let mut pages = MmapMut::map_anon(code.len().max(1))?;
        pages[..code.len()].copy_from_slice(code);
        Ok(ExecutableMemory { pages: pages.make_exec()?, len: code.len() })
    }

    /// The code.
    pub fn code(&self) -> &[u8] {
        &self.pages[..self.len]
    }
}
