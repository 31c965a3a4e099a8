//! Where results are written: checked before anything runs, and whole or not at all.

use std::path::{Path, PathBuf};

use clap::{ArgAction, Args, ValueHint};
use lanesim::npz::{self, Array};
use lanesim::outputs::Output;

use super::failure::Failure;

/// Which file a command writes.
#[derive(Args)]
pub struct Destination {
    /// File to write: one array per output, by its name. It appears when all is done, whole or not at all; a file that
    /// was there before stays until then
    #[arg(short = 'o', long = "output", value_name = "OUT.npz", value_hint = ValueHint::FilePath, required = true,
          action = ArgAction::Append)]
    files: Vec<PathBuf>,
}

impl Destination {
    /// The file, if it can be written.
    pub fn check(&self) -> Result<&Path, Failure> {
        if let Some(names) = self.files.iter().find_map(|file| names_of_outputs(file)) {
            return Err(Failure::Usage(format!("--output {names} would be a file; did you mean --outputs {names}?")));
        }
        let [file] = &*self.files else {
            return Err(Failure::Usage("--output is given twice; results go to one file".into()));
        };
        npz::check_writable(file).map_err(|e| Failure::file(file, e))?;
        Ok(file)
    }

    /// Writes the arrays.
    pub fn write(&self, arrays: &[(String, Array)]) -> Result<(), Failure> {
        self.files.iter().try_for_each(|file| npz::write(file, arrays).map_err(|e| Failure::file(file, e)))
    }

    /// For people and for JSON, where names that are not UTF-8 cannot be.
    pub fn shown(&self) -> String {
        self.files.first().map_or(String::new(), |file| file.display().to_string())
    }
}

/// The text of a path that is really a list of outputs.
fn names_of_outputs(file: &Path) -> Option<&str> {
    let text = file.to_str()?;
    text.split(',').any(|name| Output::named(name.trim()).is_ok()).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(files: &[&str]) -> String {
        match (Destination { files: files.iter().map(PathBuf::from).collect() }).check() {
            Err(Failure::Usage(message) | Failure::Input(message)) => message,
            Err(_) => "another failure".into(),
            Ok(_) => "none".into(),
        }
    }

    #[test]
    fn outputs_are_not_files() {
        let words = "--output qpos,xpos would be a file; did you mean --outputs qpos,xpos?";
        assert_eq!(message(&["qpos,xpos"]), words);
        assert_eq!(message(&["out.npz", "qpos,xpos"]), words);
        assert_eq!(message(&["a.npz", "b.npz"]), "--output is given twice; results go to one file");
        assert!(message(&["no/such/folder/qpos"]).contains("no/such/folder"));
        assert!(message(&["/"]).contains("not a regular file"));
    }
}
