//! All the text of a model: what must be kept to load it again without its files.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::include::{self, Files};
use super::report::file_problem;
use super::{LoadOptions, read};
use crate::diagnostics::Diagnostics;
use crate::spec::{Source, Spec};

/// A model's text and that of every file that it includes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Document {
    /// Path of the file, if it was read from one.
    pub file: Option<String>,
    /// Its text.
    pub text: String,
    /// What it includes, in the order of loading.
    pub includes: Vec<Include>,
    /// Files of its meshes, likewise.
    pub assets: Vec<Asset>,
}

impl Document {
    /// A file that is not MJCF, by its name, or else by where it would be beside the file that includes its element.
    pub(super) fn asset(&self, name: &str, beside: Option<&Path>) -> Option<&Asset> {
        let named = |name: &str| self.assets.iter().find(|asset| asset.name == name);
        named(name).or_else(|| named(&beside?.display().to_string()))
    }
}

/// An included file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Include {
    /// Path of the file that includes it, if that one has a path.
    pub by: Option<String>,
    /// Its name there.
    pub name: String,
    /// Where it was found.
    pub path: String,
    /// Its text.
    pub text: String,
}

/// A file that is not MJCF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asset {
    /// Its name in the model, with the folder that `compiler` names.
    pub name: String,
    /// Where it was found.
    pub path: String,
    /// What it holds.
    pub bytes: Arc<[u8]>,
}

/// The files that a load reads beside the main one.
#[derive(Debug, Default)]
pub(super) struct Record {
    pub includes: Vec<Include>,
    pub assets: Vec<Asset>,
}

impl Document {
    /// Loads a model from a file, and keeps its text. Files that it includes are found relative to it.
    pub fn load(path: &Path, options: &LoadOptions) -> Result<(Document, Spec), Diagnostics> {
        let file: Arc<str> = path.display().to_string().into();
        let source = Source { file: Some(file.clone()), line: 0 };
        let text =
            include::read_text(path).map_err(|message| file_problem(&source, format!("the file {message}"), ""))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let files = Files::Disk { folder, main: path.to_path_buf(), utf8: text.utf8 };
        let text = text.text;
        let mut record = Record::default();
        let spec = read(&text, Some(&file), &files, options, Some(&mut record))?;
        let Record { includes, assets } = record;
        Ok((Document { file: Some(file.to_string()), text, includes, assets }, spec))
    }

    /// Parses a model from text, and keeps it; the files that it reads are given by name.
    pub fn parse(
        text: &str,
        files: &BTreeMap<String, Vec<u8>>,
        options: &LoadOptions,
    ) -> Result<(Document, Spec), Diagnostics> {
        let mut record = Record::default();
        let spec = read(text, None, &Files::Memory(files), options, Some(&mut record))?;
        let Record { includes, assets } = record;
        Ok((Document { file: None, text: text.to_string(), includes, assets }, spec))
    }

    /// Loads the model from the text that was kept: the same spec, to the places in its messages.
    pub fn spec(&self, options: &LoadOptions) -> Result<Spec, Diagnostics> {
        let file = self.file.as_deref().map(Arc::from);
        read(&self.text, file.as_ref(), &Files::Recorded(self), options, None)
    }

    /// The file that `by` includes as `name`.
    pub(super) fn find(&self, by: Option<&str>, name: &str) -> Option<&Include> {
        self.includes.iter().find(|include| include.by.as_deref() == by && include.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAIN: &str = "<mujoco><include file='sub/arm.xml'/><include file='keys.xml'/></mujoco>";
    const ARM: &str = "<mujoco><worldbody><include file='link.xml'/><light/></worldbody></mujoco>";
    const LINK: &str = "<mujoco><body><joint/><geom type='sdf'/><geom size='.1'/></body></mujoco>";
    const KEYS: &str = "<mujoco><keyframe><key name='up' qpos='1'/></keyframe></mujoco>";

    #[test]
    fn a_model_is_loaded_again_without_its_files() {
        let folder = std::env::temp_dir().join(format!("lanesim-document-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("sub")).unwrap();
        for (name, text) in [("main.xml", MAIN), ("sub/arm.xml", ARM), ("sub/link.xml", LINK), ("keys.xml", KEYS)] {
            std::fs::write(folder.join(name), text).unwrap();
        }
        let options = LoadOptions { lenient: true, ..LoadOptions::default() };
        let (document, spec) = Document::load(&folder.join("main.xml"), &options).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(document.includes.len(), 3);
        let again = document.spec(&options).unwrap();
        assert_eq!(format!("{spec:?}"), format!("{again:?}"));
        assert_eq!(again.losses.len(), 1, "the distance field");
    }

    #[test]
    fn from_text() {
        let files = [("sub/arm.xml", ARM), ("link.xml", LINK), ("keys.xml", KEYS), ("unused.xml", "")];
        let files = files.map(|(name, text)| (name.to_string(), text.as_bytes().to_vec())).into();
        let options = LoadOptions { lenient: true, ..LoadOptions::default() };
        let (document, spec) = Document::parse(MAIN, &files, &options).unwrap();
        assert_eq!(document.includes.len(), 3, "what is not included is not kept");
        assert_eq!(format!("{spec:?}"), format!("{:?}", document.spec(&options).unwrap()));
    }
}
