//! The command line: `lanesim COMMAND --help` describes it.

mod cli;
mod floor;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    if let Some(missing) = floor::missing() {
        return floor::refuse(missing);
    }
    cli::run(cli::Cli::parse())
}
