//! Reading files and splicing includes.

use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::document::{Asset, Document, Include, Record};
use super::report::{Report, file_problem, quoted};
use super::scan::MOST_BYTES;
use super::tree::Tree;
use crate::diagnostics::Diagnostics;
use crate::spec::Source;
use crate::suggest::did_you_mean;

/// What a path is relative to.
const INCLUDE_PATHS: &str = "paths are relative to the main file, or to the file that includes";

/// Most bytes of meshes, all files together.
const MOST_MESHES: usize = 1 << 30;

/// Where included files come from.
pub(super) enum Files<'a> {
    /// The folder of the main file, that file itself, and whether it is UTF-8.
    Disk { folder: PathBuf, main: PathBuf, utf8: bool },
    /// By name.
    Memory(&'a BTreeMap<String, Vec<u8>>),
    /// Texts as an earlier load found them.
    Recorded(&'a Document),
}

/// Parses the main text and everything that it includes.
pub(super) fn read(
    text: &str,
    file: Option<&Arc<str>>,
    files: &Files,
    report: &mut Report,
    record: Option<&mut Record>,
) -> Result<Tree, Diagnostics> {
    let mut tree = Tree::default();
    check_size(text.len(), file)?;
    tree.append(text, file)?;
    let mut loader = Loader { files, seen: HashSet::new(), bytes: text.len(), record };
    if let Files::Disk { main, utf8, .. } = files {
        loader.seen.insert(identity(main));
        if !utf8 {
            note_encoding(&main.display().to_string(), report);
        }
    }
    // Elements of included files are appended, so this loop reaches their includes too; each file comes once, so it ends.
    let mut roots = vec![None; tree.elements.len()];
    let mut index = 0;
    while index < tree.elements.len() {
        if tree[index].tag == "include" {
            roots[index] = loader.load(&mut tree, index, report)?;
            roots.resize(tree.elements.len(), None);
        }
        index += 1;
    }
    splice(&mut tree, &roots);
    Ok(tree)
}

/// Where a file is that is named in the file `by`, and its text; the error is a message and a remedy.
pub(super) fn fetch(
    files: &Files,
    name: &str,
    by: Option<&str>,
    report: &mut Report,
) -> (PathBuf, Result<String, (String, String)>) {
    let (path, text) = match files {
        Files::Memory(texts) => match given(texts, name) {
            Some((key, bytes)) => (PathBuf::from(key), Ok(decode(bytes.clone()).text)),
            None => {
                let near = report.seek(|| did_you_mean(name, texts.keys().map(String::as_str)));
                (PathBuf::from(name), Err(format!("no such file among those given {near}").trim_end().to_string()))
            }
        },
        Files::Recorded(document) => match document.find(by, name) {
            Some(include) => (PathBuf::from(&include.path), Ok(include.text.clone())),
            None => (PathBuf::from(name), Err("no such file among those recorded".to_string())),
        },
        Files::Disk { folder, .. } => {
            let path = find(name, folder, by);
            let text = read_text(&path);
            if text.as_ref().is_ok_and(|text| !text.utf8) {
                note_encoding(&path.display().to_string(), report);
            }
            (path, text.map(|text| text.text))
        }
    };
    let text = text.map_err(|message| {
        let near = match files {
            Files::Disk { .. } => report.seek(|| neighbour(&path)),
            Files::Memory(_) | Files::Recorded(_) => String::new(),
        };
        (format!("file {}: {message}", quoted(name)), format!("{near}{INCLUDE_PATHS}"))
    });
    (path, text)
}

struct Loader<'a> {
    files: &'a Files<'a>,
    seen: HashSet<PathBuf>,
    bytes: usize,
    record: Option<&'a mut Record>,
}

impl Loader<'_> {
    /// Loads the file that an `include` names; returns the index of its root.
    fn load(&mut self, tree: &mut Tree, include: usize, report: &mut Report) -> Result<Option<usize>, Diagnostics> {
        let element = &tree[include];
        let Some(name) = element.get("file").filter(|name| !name.is_empty()).map(str::to_string) else {
            report.error(element, "attribute \"file\" is missing", "");
            return Ok(None);
        };
        if let Some((other, _)) = element.attributes.iter().find(|(attribute, _)| attribute != "file") {
            report.error(element, format!("unknown attribute {}", quoted(other)), "valid: file");
        }
        if !element.children.is_empty() {
            report.error(element, "include must be empty", "");
        }
        let (path, text) = fetch(self.files, &name, element.source.file.as_deref(), report);
        let text = match text {
            Ok(text) => text,
            Err((message, remedy)) => {
                report.error(element, message, remedy);
                return Ok(None);
            }
        };
        let known = match self.files {
            Files::Disk { .. } => identity(&path),
            Files::Memory(_) | Files::Recorded(_) => path.clone(),
        };
        if !self.seen.insert(known) {
            report.error(element, format!("file {} was already included", quoted(&name)), "include each file once");
            return Ok(None);
        }
        if let Some(record) = &mut self.record {
            let (by, path) = (element.source.file.as_deref().map(str::to_string), path.display().to_string());
            record.includes.push(Include { by, name, path, text: text.clone() });
        }
        self.bytes += text.len();
        let file: Arc<str> = path.display().to_string().into();
        check_size(self.bytes, Some(&file))?;
        tree.append(&text, Some(&file)).map(Some)
    }
}

/// Reads the files of meshes.
pub(super) struct Assets<'a, 'b> {
    files: &'a Files<'a>,
    /// The folder of meshes, as `compiler` names it.
    folder: String,
    /// Whether only the last part of a file's name counts.
    strip: bool,
    /// Bytes read so far.
    bytes: usize,
    record: Option<&'b mut Record>,
}

impl<'a, 'b> Assets<'a, 'b> {
    /// For the compiler settings of a model whose own files are in the folder `base`.
    pub fn new(tree: &Tree, files: &'a Files<'a>, base: &str, record: Option<&'b mut Record>) -> Self {
        let (mut folder, mut strip) = (["", ""], false);
        for index in tree.sections("compiler") {
            for (place, name) in folder.iter_mut().zip(["assetdir", "meshdir"]) {
                *place = tree[index].get(name).unwrap_or(place);
            }
            strip = tree[index].get("strippath").map_or(strip, |value| value == "true");
        }
        let [assets, meshes] = folder;
        let folder = if meshes.is_empty() { assets } else { meshes };
        let folder = if folder.starts_with('/') { folder.to_string() } else { format!("{base}{folder}") };
        Assets { files, folder, strip, bytes: 0, record }
    }

    /// The bytes of a mesh's file, which the file `by` names if that was included: where there is none in the folder of meshes, it may be
    /// beside that. The error is a message and a remedy.
    pub fn mesh(&mut self, name: &str, by: Option<&str>) -> Result<Vec<u8>, (String, String)> {
        let name = name.replace('\\', "/");
        let last = if self.strip { name.rsplit('/').next().unwrap_or_default() } else { &name };
        let mut name = match self.folder.replace('\\', "/") {
            folder if folder.is_empty() || last.starts_with('/') => last.to_string(),
            folder => format!("{}/{last}", folder.trim_end_matches('/')),
        };
        let beside = by.and_then(|file| Path::new(file).parent()).map(|folder| folder.join(last));
        let (path, bytes) = match self.files {
            Files::Memory(files) => match given(files, &name) {
                Some((key, bytes)) => (key.clone(), Ok(bytes.clone())),
                None => (name.clone(), Err("no such file among those given".to_string())),
            },
            Files::Recorded(document) => match document.asset(&name, beside.as_deref()) {
                Some(asset) => {
                    name.clone_from(&asset.name);
                    (asset.path.clone(), Ok(asset.bytes.to_vec()))
                }
                None => (name.clone(), Err("no such file among those recorded".to_string())),
            },
            Files::Disk { folder, .. } => {
                let mut path = folder.join(&name);
                if let Some(beside) = beside.filter(|beside| !path.exists() && beside.exists()) {
                    name = beside.display().to_string();
                    path = beside;
                }
                (path.display().to_string(), read_bytes(&path, MOST_MESHES))
            }
        };
        let problem = |message: String| (format!("file {}: {message}", quoted(&name)), String::new());
        let bytes = bytes.map_err(|message| match self.files {
            Files::Disk { .. } => {
                let near = neighbour(Path::new(&path));
                let remedy = format!("{near}paths are relative to the main file and to meshdir");
                (format!("file {}: {message}", quoted(&path)), remedy)
            }
            _ => problem(message),
        })?;
        self.bytes += bytes.len();
        if self.bytes > MOST_MESHES {
            return Err(problem(format!("meshes have more than {} MiB in all", MOST_MESHES >> 20)));
        }
        if let Some(record) = self.record.as_deref_mut().filter(|record| record.assets.iter().all(|a| a.name != name)) {
            record.assets.push(Asset { name, path, bytes: bytes.as_slice().into() });
        }
        Ok(bytes)
    }
}

/// Where a file is: relative to the main file or, if there is none, to the file that includes it. The path may be written
/// as on Windows.
fn find(name: &str, folder: &Path, including: Option<&str>) -> PathBuf {
    let beside = including.and_then(|file| Path::new(file).parent());
    let slashes = name.replace('\\', "/");
    let names = [name, slashes.as_str()];
    let places =
        names.iter().flat_map(|name| [Some(folder), beside].into_iter().flatten().map(move |at| at.join(name)));
    places.into_iter().find(|path| path.exists()).unwrap_or_else(|| folder.join(slashes.as_str()))
}

/// The file beside one that is missing that was probably meant.
fn neighbour(path: &Path) -> String {
    const MOST: usize = 1000;
    let (Some(folder), Some(name)) = (path.parent().filter(|_| !path.exists()), path.file_name()) else {
        return String::new();
    };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let files = std::fs::read_dir(folder).into_iter().flatten().take(MOST).flatten();
    let mut names: Vec<String> = files.filter_map(|file| file.file_name().into_string().ok()).collect();
    names.sort_unstable();
    match did_you_mean(&name.to_string_lossy(), names.iter().map(String::as_str)) {
        near if near.is_empty() => near,
        near => format!("{near} "),
    }
}

/// A file by its name, written with slashes of either kind, or else by the last part of the name.
fn given<'a>(texts: &'a BTreeMap<String, Vec<u8>>, name: &str) -> Option<(&'a String, &'a Vec<u8>)> {
    let slashes = |name: &str| name.replace('\\', "/");
    let last = |name: &str| slashes(name).rsplit('/').next().map(str::to_string);
    texts
        .get_key_value(name)
        .or_else(|| texts.iter().find(|(key, _)| slashes(key) == slashes(name)))
        .or_else(|| texts.iter().find(|(key, _)| last(key) == last(name)))
}

fn check_size(bytes: usize, file: Option<&Arc<str>>) -> Result<(), Diagnostics> {
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let source = Source { file: file.cloned(), line: 0 };
    Err(file_problem(&source, format!("the model is longer than {} MiB", MOST_BYTES >> 20), "split the model"))
}

/// What makes two names the same file.
fn identity(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf())
}

/// Reads a regular file as text, never more than a model may hold.
pub(super) fn read_text(path: &Path) -> Result<Text, String> {
    let bytes = read_bytes(path, MOST_BYTES)?;
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err("is UTF-16, but must be UTF-8: save it as that".into());
    }
    Ok(decode(bytes))
}

/// Reads a regular file, never more than a byte beyond `most`.
pub(super) fn read_bytes(path: &Path, most: usize) -> Result<Vec<u8>, String> {
    let read = || -> std::io::Result<Vec<u8>> {
        // Asked before opening: to open a pipe would wait for a writer.
        if !std::fs::metadata(path)?.is_file() {
            return Err(std::io::Error::other("not a regular file"));
        }
        let mut bytes = Vec::new();
        File::open(path)?.take(most as u64 + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    read().map_err(|error| format!("cannot be read: {error}"))
}

/// The text of bytes in UTF-8 or, if they are not that, in an encoding with one byte per character, read as ISO-8859-1.
/// Whatever is declared, MJCF's own words are the same in these encodings; only names and comments may look otherwise.
fn decode(bytes: Vec<u8>) -> Text {
    match String::from_utf8(bytes) {
        Ok(text) => Text { text, utf8: true },
        Err(error) => Text { text: error.as_bytes().iter().copied().map(char::from).collect(), utf8: false },
    }
}

/// The text of a file.
pub(super) struct Text {
    pub text: String,
    /// Whether it was UTF-8.
    pub utf8: bool,
}

/// Says that a file was not UTF-8.
fn note_encoding(file: &str, report: &mut Report) {
    report.note(format!("{file}: is not UTF-8 and was read as ISO-8859-1: names may look otherwise"));
}

/// Replaces every `include` by the children of its file's root.
fn splice(tree: &mut Tree, roots: &[Option<usize>]) {
    for index in 0..tree.elements.len() {
        if !tree[index].children.iter().any(|&child| tree[child].tag == "include") {
            continue;
        }
        let mut pending: Vec<usize> = std::mem::take(&mut tree.elements[index].children);
        pending.reverse();
        let mut children = Vec::new();
        while let Some(child) = pending.pop() {
            if tree[child].tag != "include" {
                children.push(child);
            } else if let Some(root) = roots[child] {
                pending.extend(tree[root].children.iter().rev());
            }
        }
        tree.elements[index].children = children;
    }
}
