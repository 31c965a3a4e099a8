//! Names of generated code for Linux's `perf`, which looks for a map of them by process in the directory for temporary files.

use std::fs::OpenOptions;
use std::io::Write;

/// Environment variable that asks for the names.
const VARIABLE: &str = "LANESIM_PERF_MAP";

/// Notes what the code is called, if the environment asks for it. A profile without names is no error.
pub(crate) fn note(name: &str, code: &[u8]) {
    if std::env::var_os(VARIABLE).is_none() {
        return;
    }
    let path = std::env::temp_dir().join(format!("perf-{}.map", std::process::id()));
    if let Ok(mut file) = OpenOptions::new().create(true).append(true).open(path) {
        let (start, len, name) = (code.as_ptr().addr(), code.len(), name.replace(' ', "_"));
        let _ = writeln!(file, "{start:x} {len:x} {name}");
    }
}
