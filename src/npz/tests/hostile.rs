//! Archives that lie, expand or repeat themselves, and files that are none. What each must say is in the test.

use super::*;

/// A member as bytes: what the directory and the local header say may differ from what is there.
#[derive(Clone)]
struct Raw {
    name: &'static [u8],
    flags: u16,
    method: u16,
    size: u32,
    external: u32,
    /// Another member's bytes instead of its own.
    shares: Option<usize>,
    bytes: Vec<u8>,
    crc: u32,
}

impl Raw {
    fn new(name: &'static str, bytes: Vec<u8>) -> Raw {
        let (size, crc) = (bytes.len() as u32, crc32fast::hash(&bytes));
        Raw { name: name.as_bytes(), flags: 0, method: 0, size, external: 0, shares: None, bytes, crc }
    }

    fn numbers(name: &'static str) -> Raw {
        Raw::new(name, entry("{'descr': '|u1', 'fortran_order': False, 'shape': (3,)}", &[1, 2, 3]))
    }
}

fn pack(members: &[Raw]) -> Vec<u8> {
    let (mut out, mut directory, mut places) = (Vec::new(), Vec::new(), Vec::new());
    for m in members {
        let common = |out: &mut Vec<u8>| {
            for n in [20, m.flags, m.method, 0, 0x21] {
                out.extend(n.to_le_bytes());
            }
            for n in [m.crc, m.bytes.len() as u32, m.size] {
                out.extend(n.to_le_bytes());
            }
            out.extend([m.name.len() as u16, 0].map(u16::to_le_bytes).concat());
        };
        let place = m.shares.map_or(out.len(), |other| places[other]);
        places.push(place);
        if m.shares.is_none() {
            out.extend(0x0403_4b50u32.to_le_bytes());
            common(&mut out);
            out.extend(m.name);
            out.extend(&m.bytes);
        }
        directory.extend(0x0201_4b50u32.to_le_bytes());
        directory.extend((3u16 << 8 | 20).to_le_bytes());
        common(&mut directory);
        directory.extend([0; 6]);
        directory.extend([m.external, place as u32].map(u32::to_le_bytes).concat());
        directory.extend(m.name);
    }
    let start = out.len() as u32;
    out.extend(&directory);
    out.extend(0x0605_4b50u32.to_le_bytes());
    out.extend([0; 4]);
    out.extend([members.len() as u16; 2].map(u16::to_le_bytes).concat());
    out.extend([directory.len() as u32, start].map(u32::to_le_bytes).concat());
    out.extend([0; 2]);
    out
}

/// Parts one after the other, compressed.
fn deflated<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> Vec<u8> {
    let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
    parts.into_iter().for_each(|part| encoder.write_all(part).unwrap());
    encoder.finish().unwrap()
}

/// Counts the bytes that are read.
struct Counted<'a, R> {
    inner: R,
    read: &'a mut usize,
}

impl<R: Read> Read for Counted<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(buffer)?;
        *self.read += n;
        Ok(n)
    }
}

impl<R: Seek> Seek for Counted<'_, R> {
    fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
        self.inner.seek(to)
    }
}

/// A folder for a test's files, removed at its end.
#[cfg(unix)]
struct Folder(std::path::PathBuf);

#[cfg(unix)]
impl Folder {
    fn new(test: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("lanesim-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
}

#[cfg(unix)]
impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn refused(members: &[Raw]) -> String {
    read_bytes(&pack(members)).unwrap_err().to_string()
}

#[test]
fn members_that_share_bytes_are_refused() {
    let first = Raw::numbers("a.npy");
    assert_eq!(read_bytes(&pack(std::slice::from_ref(&first))).unwrap()["a"].to_f64().as_ref(), [1.0, 2.0, 3.0]);
    let second = Raw { shares: Some(0), ..Raw::numbers("b.npy") };
    let message = refused(&[first, second]);
    assert!(message.contains("array `b`: shares bytes of the file with \"a.npy\""), "{message}");
}

#[test]
fn members_of_one_name_are_refused() {
    assert_eq!(refused(&[Raw::numbers("a.npy"), Raw::numbers("a.npy")]), "array `a`: is in the archive twice");
}

#[test]
fn an_archive_that_expands_by_thousands_is_refused_unread() {
    // 300 MB of zeros in 3 MB, of which each number would take 8 bytes.
    let n = 300_000_000u32;
    let text = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({n},)}}");
    let (header, zeros) = (entry(&text, &[]), vec![0; 1_000_000]);
    let size = header.len() as u32 + n;
    let bytes = deflated(std::iter::once(&*header).chain(std::iter::repeat_n(&*zeros, 300)));
    let bomb = Raw { method: 8, size, ..Raw::new("qpos.npy", bytes) };
    let archive = pack(&[bomb]);
    let mut read = 0;
    let message =
        Archive::new(Counted { inner: Cursor::new(&archive), read: &mut read }, None).err().unwrap().to_string();
    assert!(message.contains("array `qpos`") && message.contains("2.40 GB"), "{message}");
    assert!(message.contains("above the limit of 0.29 GB") && message.contains("--input-limit"), "{message}");
    // The directory, which is sought in the last 64 kB, and the start of the member.
    assert!(read < 200_000 && archive.len() > 1_000_000, "{read} bytes of {} were read", archive.len());
    // The limit can be raised: then only the checksum, which nobody computed here, is wrong.
    let raised = Archive::new(Cursor::new(&archive), Some(3_000_000_000)).unwrap();
    assert_eq!(raised.shape("qpos"), Some(&[300_000_000][..]));
}

#[test]
fn sizes_that_cannot_be_are_refused() {
    let impossible = Raw { method: 8, size: u32::MAX - 1, ..Raw::new("a.npy", vec![0; 100]) };
    assert!(refused(&[impossible]).contains("array `a`: cannot expand from 100 bytes to 4294967294"));
    let stored = Raw { size: 1000, ..Raw::numbers("a.npy") };
    assert!(refused(&[stored]).contains("are said to be 1000"));
    // A size that is too small, and a checksum that is wrong.
    let whole = entry("{'descr': '|u1', 'fortran_order': False, 'shape': (3,)}", &[1, 2, 3, 4]);
    let mut lying = Raw { method: 8, size: whole.len() as u32 - 1, ..Raw::new("a.npy", deflated([&*whole])) };
    assert!(refused(std::slice::from_ref(&lying)).contains("more bytes than its shape says"));
    lying.size += 1;
    assert!(refused(&[lying]).contains("has more bytes than its shape [3] says"));
    let damaged = Raw { crc: 1, ..Raw::numbers("a.npy") };
    assert!(refused(&[damaged]).contains("checksum"));
}

#[test]
fn what_is_no_plain_member_is_refused() {
    let numbers = Raw::numbers("a.npy");
    for (raw, words) in [
        (Raw { flags: 1, ..numbers.clone() }, "is encrypted"),
        (Raw { method: 14, ..numbers.clone() }, "compressed by method 14; write the archive with numpy.savez"),
        (Raw { external: 0o120_777 << 16, ..numbers.clone() }, "is a symbolic link"),
        (Raw { name: b"a\xff.npy", ..numbers.clone() }, "not UTF-8"),
    ] {
        let message = refused(&[raw]);
        assert!(message.starts_with("array `a") && message.contains(words), "{message}");
    }
    // What NumPy would not take for an array is passed over.
    assert!(read_bytes(&pack(&[Raw::new("notes.txt", b"hello".to_vec())])).unwrap().is_empty());
}

/// Our archives are read by an implementation that is not ours.
#[test]
fn the_zip_crate_reads_what_we_write() {
    let arrays = [("a".to_owned(), Array::vector(vec![1.0, 2.0])), ("b/c".to_owned(), Array::vector(vec![]))];
    let mut bytes = Vec::new();
    write_to(&mut bytes, &arrays).unwrap();
    let mut archive = ::zip::ZipArchive::new(Cursor::new(&bytes)).unwrap();
    assert_eq!(archive.len(), 2);
    let mut found = Vec::new();
    archive.by_name("a.npy").unwrap().read_to_end(&mut found).unwrap();
    assert!(found.starts_with(b"\x93NUMPY") && found.ends_with(&2f64.to_le_bytes()));
    let twice = [arrays[0].clone(), arrays[0].clone()];
    assert!(write_to(&mut Vec::new(), &twice).unwrap_err().to_string().contains("twice"));
}

#[cfg(unix)]
#[test]
fn only_regular_files_are_read() {
    let guard = Folder::new("regular");
    let folder = &guard.0;
    let pipe = folder.join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [&**folder, &*pipe, Path::new("/dev/zero"), Path::new("/dev/null")] {
        let message = read(path).unwrap_err().to_string();
        assert!(message.contains("not a regular file"), "{message}");
    }
    // A link to a file is as good as the file; one to nowhere, or to itself, is an error.
    let (file, link, around) = (folder.join("a.npz"), folder.join("link.npz"), folder.join("around"));
    write(&file, &[]).unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    std::os::unix::fs::symlink(&around, &around).unwrap();
    assert!(read(&link).unwrap().is_empty());
    assert!(read(&around).is_err() && read(&folder.join("none")).is_err());
}

#[cfg(unix)]
#[test]
fn a_file_that_is_there_survives_a_failure() {
    let guard = Folder::new("survives");
    let folder = &guard.0;
    let path = folder.join("out.npz");
    let old = [("old".to_owned(), Array::vector(vec![1.0]))];
    write(&path, &old).unwrap();
    // The second array of one name is found when the first is written.
    let twice = [("a".to_owned(), Array::vector(vec![1.0])), ("a".to_owned(), Array::vector(vec![2.0]))];
    assert!(write(&path, &twice).is_err());
    assert_eq!(read(&path).unwrap()["old"].to_f64().as_ref(), [1.0]);
    let listed: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(listed, ["out.npz"]);
    // A link stays one, and what it points to is replaced. A device is written, not replaced.
    let link = folder.join("link.npz");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    write(&link, &[]).unwrap();
    assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink() && read(&path).unwrap().is_empty());
    write(Path::new("/dev/null"), &old).unwrap();
    if cfg!(target_os = "linux") {
        let full = write(Path::new("/dev/full"), &old).unwrap_err().to_string();
        assert!(full.contains("No space left"), "{full}");
    }
    assert!(write(folder, &old).unwrap_err().to_string().contains("not a regular file"));
}
