//! Files in and out: only regular ones are read, and one that is written appears whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Opens a regular file, and gives its length. To open a pipe would wait for a writer, and a device may never end.
pub fn open(path: &Path) -> io::Result<(File, u64)> {
    regular(&fs::metadata(path)?)?;
    let file = File::open(path)?;
    // Once more, of what is open now.
    let metadata = file.metadata()?;
    regular(&metadata)?;
    Ok((file, metadata.len()))
}

fn regular(metadata: &fs::Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let what = if metadata.is_dir() { "a folder" } else { "a pipe or a device" };
    Err(io::Error::other(format!("not a regular file but {what}; give the name of a file on disk")))
}

/// Where an output goes, checked before anything is computed.
#[derive(Debug)]
enum Target {
    /// A file, new or replaced, after links are followed.
    File(PathBuf),
    /// A device such as `/dev/null`, which cannot be replaced.
    Device(PathBuf),
}

fn target(path: &Path) -> io::Result<Target> {
    match fs::metadata(path) {
        Ok(metadata) if metadata.is_file() => {
            if metadata.permissions().readonly() {
                return Err(io::Error::other("is there and must not be written; choose another name"));
            }
            // A link stays a link: what it points to is replaced.
            Ok(Target::File(fs::canonicalize(path)?))
        }
        Ok(metadata) if is_device(&metadata) => Ok(Target::Device(path.to_owned())),
        Ok(metadata) => regular(&metadata).map(|()| Target::File(path.to_owned())),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(Target::File(path.to_owned())),
        Err(e) => Err(e),
    }
}

#[cfg(unix)]
fn is_device(metadata: &fs::Metadata) -> bool {
    std::os::unix::fs::FileTypeExt::is_char_device(&metadata.file_type())
}

#[cfg(not(unix))]
fn is_device(_: &fs::Metadata) -> bool {
    false
}

/// A file beside the one to be written; removed again unless it takes its place.
struct Temporary {
    file: File,
    path: PathBuf,
    kept: bool,
}

impl Temporary {
    fn beside(path: &Path) -> io::Result<Temporary> {
        let Some(name) = path.file_name() else { return Err(io::Error::other("is not the name of a file")) };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // A name of its own; of a long name the end is left out, for names have a limit.
        let short: String = name.to_string_lossy().chars().take(32).collect();
        for attempt in 0..1000 {
            let path = folder.join(format!(".{short}.{}-{attempt}.tmp", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => return Ok(Temporary { file, path, kept: false }),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => {
                    return Err(io::Error::new(e.kind(), format!("cannot write to {}: {e}", folder.display())));
                }
            }
        }
        Err(io::Error::other(format!("{} is full of temporary files of this name", folder.display())))
    }

    fn replace(mut self, path: &Path) -> io::Result<()> {
        if let Ok(old) = fs::metadata(path) {
            self.file.set_permissions(old.permissions())?;
        }
        self.file.sync_all()?;
        fs::rename(&self.path, path)?;
        self.kept = true;
        // The new name itself; a system that cannot do that has still replaced the file.
        if let Some(folder) = path.parent().and_then(|folder| File::open(folder).ok()) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.kept {
            // What cannot be removed stays under its own name.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// An error if `path` could not be written: found before a long run rather than after it.
pub fn check_writable(path: &Path) -> io::Result<()> {
    match target(path)? {
        Target::File(path) => Temporary::beside(&path).map(|_| ()),
        Target::Device(path) => OpenOptions::new().write(true).open(path).map(|_| ()),
    }
}

/// Writes a file that appears whole or not at all: `contents` go to a temporary file beside it, which takes its place
/// when everything is on disk. What was there before stays until then.
pub fn write(path: &Path, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let fill = |file: &File| {
        let mut writer = BufWriter::with_capacity(1 << 16, file);
        contents(&mut writer)?;
        writer.flush()
    };
    match target(path)? {
        Target::Device(path) => fill(&OpenOptions::new().write(true).open(path)?),
        Target::File(path) => {
            let temporary = Temporary::beside(&path)?;
            fill(&temporary.file)?;
            temporary.replace(&path)
        }
    }
}
