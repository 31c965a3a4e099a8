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
    /// The file, if it can be written and is none of those that are read.
    pub fn check<'a>(&self, inputs: impl IntoIterator<Item = &'a PathBuf>) -> Result<&Path, Failure> {
        if let Some(names) = self.files.iter().find_map(|file| names_of_outputs(file)) {
            return Err(Failure::Usage(format!("--output {names} would be a file; did you mean --outputs {names}?")));
        }
        let [file] = &*self.files else {
            return Err(Failure::Usage("--output is given twice; results go to one file".into()));
        };
        let same = |input: &&PathBuf| matches!((file.canonicalize(), input.canonicalize()), (Ok(a), Ok(b)) if a == b);
        if let Some(input) = inputs.into_iter().find(same) {
            let (file, input) = (file.display(), input.display());
            return Err(Failure::Usage(format!("--output {file} would replace the input {input}; give another name")));
        }
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
        let inputs = [PathBuf::from("Cargo.toml")];
        match (Destination { files: files.iter().map(PathBuf::from).collect() }).check(&inputs) {
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

    #[test]
    fn an_input_is_never_replaced() {
        let words = |file: &str| format!("--output {file} would replace the input Cargo.toml; give another name");
        for file in ["Cargo.toml", "src/../Cargo.toml"] {
            assert_eq!(message(&[file]), words(file));
        }
    }
}
