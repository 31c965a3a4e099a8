//! Why a command failed.

use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use lanesim::Diagnostics;

/// Why a command failed, in words for the user.
pub enum Failure {
    /// The model was rejected.
    Model(Diagnostics),
    /// Anything else that was wrong with what was given, or with a file.
    Input(String),
    /// The arguments contradict each other or the model: exit status 2, like any other mistake on the command line.
    Usage(String),
    /// Whoever read our output has left; nobody wants to hear of it.
    BrokenPipe,
}

impl Failure {
    /// A failure that concerns a file.
    pub fn file(path: &Path, error: impl std::fmt::Display) -> Failure {
        Failure::Input(format!("{}: {error}", path.display()))
    }

    /// Prints the reason to standard error and gives the exit status.
    pub fn report(self) -> ExitCode {
        let mut hint = None;
        let (message, status) = match self {
            Failure::Model(diagnostics) => {
                let lenient = diagnostics.0.iter().any(|d| d.remedy.contains("lenient"));
                hint = lenient.then_some("hint: --lenient leaves out what can be left out, and lists it");
                (diagnostics.to_string(), 1)
            }
            Failure::Input(message) => (message, 1),
            Failure::Usage(message) => (message, 2),
            Failure::BrokenPipe => return ExitCode::SUCCESS,
        };
        let mut stderr = io::stderr().lock();
        for line in message.lines() {
            // A closed standard error is no reason to fail differently.
            let _ = writeln!(stderr, "error: {line}");
        }
        if let Some(hint) = hint {
            let _ = writeln!(stderr, "{hint}");
        }
        ExitCode::from(status)
    }
}

impl From<io::Error> for Failure {
    fn from(e: io::Error) -> Self {
        match e.kind() {
            io::ErrorKind::BrokenPipe => Failure::BrokenPipe,
            _ => Failure::Input(format!("cannot write the result: {e}")),
        }
    }
}

impl From<lanesim::Error> for Failure {
    fn from(e: lanesim::Error) -> Self {
        match e {
            lanesim::Error::Model(diagnostics) => Failure::Model(diagnostics),
            lanesim::Error::Options(message) | lanesim::Error::Unknown(message) => Failure::Usage(message),
            e => Failure::Input(e.to_string()),
        }
    }
}

impl From<Diagnostics> for Failure {
    fn from(d: Diagnostics) -> Self {
        Failure::Model(d)
    }
}
