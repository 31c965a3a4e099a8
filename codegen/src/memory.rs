//! Memory for code: written first, then made executable, never both at once.

use std::sync::atomic::{AtomicUsize, Ordering};

use memmap2::{Mmap, MmapMut};

/// Bytes after which the sets of an instruction cache repeat, and bytes of its lines.
const PAGE: usize = 4096;
const LINE: usize = 64;

/// Pages of code that can be executed and not written.
pub(crate) struct ExecutableMemory {
    pages: Mmap,
    start: usize,
    len: usize,
}

impl ExecutableMemory {
    /// Maps pages with the code. Within its page it starts where the code made before it ended: small pieces of code that all
    /// began at the start of a page would crowd into a few sets of the instruction caches.
    ///
    /// # Errors
    ///
    /// If the system refuses memory, or to make it executable.
    pub fn new(code: &[u8]) -> std::io::Result<Self> {
        static END: AtomicUsize = AtomicUsize::new(0);
        let len = code.len();
        let start = END.fetch_add(len.next_multiple_of(LINE), Ordering::Relaxed) % PAGE;
        let mut pages = MmapMut::map_anon(start + len.max(1))?;
        pages[start..start + len].copy_from_slice(code);
        Ok(ExecutableMemory { pages: pages.make_exec()?, start, len })
    }

    /// The code.
    pub fn code(&self) -> &[u8] {
        &self.pages[self.start..self.start + self.len]
    }
}
