//! The command line: what can be asked, and where it is answered.
//!
//! Every command reads its model and its arrays completely, and checks them, before anything runs. Results go to standard
//! output, everything else to standard error.

mod accuracy;
mod arrays;
mod bench;
mod check;
mod clock;
mod clouds;
mod destination;
mod engine;
mod eval;
mod failure;
mod fd;
mod info;
mod inverse;
mod measure;
mod memory;
mod mujoco;
mod optimise;
mod output;
mod rollout;
mod states;
mod stress;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand, ValueEnum, ValueHint};
use lanesim::Model;
use lanesim::outputs::Output;

use failure::Failure;

const EXAMPLES: &str = "\
Examples:
  lanesim check models/zoo/ant.xml --steps 1000
  lanesim info models/zoo/ant.xml --json
  lanesim rollout models/zoo/ant.xml --worlds 256 --steps 500 --noise --outputs qpos,qvel -o ant.npz
  lanesim eval models/zoo/ant.xml --input states.npz --output fields.npz --outputs qM,qacc
  lanesim inverse models/zoo/ant.xml --states motion.npz -o forces.npz
  lanesim fd models/zoo/ant.xml --states motion.npz --centred -o derivatives.npz
  lanesim optimise cartpole -o swing-up
  lanesim bench models/zoo/humanoid18.xml --worlds 4096 --steps 100 --precision f32

Exit status: 0 success, 1 the model or an input was rejected, 2 the command line is wrong.";

/// Simulate thousands of copies of one MuJoCo model side by side.
#[derive(Parser)]
#[command(name = "lanesim", version, propagate_version = true, max_term_width = 100, after_help = EXAMPLES)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Print a model's sizes, options and memory per world
    Info(info::Info),
    /// Compile a model, step it, and report what it flags
    Check(check::Check),
    /// Step many worlds and write their trajectories
    Rollout(rollout::Rollout),
    /// Measure speed, and the error that comes with it
    Bench(bench::Bench),
    /// Measure clouds of states and their derivatives as in MuJoCo's paper of 2012
    BenchClouds(clouds::BenchClouds),
    /// Measure error against run time over scenarios, beside MuJoCo
    Accuracy(accuracy::Accuracy),
    /// Count the worlds that are lost, by time step, severity and integrator
    Stress(stress::Stress),
    /// Compute named quantities at given states
    Eval(eval::Eval),
    /// Compute the forces for which given states have given accelerations
    Inverse(inverse::Inverse),
    /// Compute the derivatives of steps by state and controls
    Fd(fd::Fd),
    /// Search the controls of an optimal motion
    Optimise(optimise::Optimise),
}

/// Which model, and how it is read.
#[derive(Args)]
struct ModelArgs {
    /// Model in MuJoCo's XML format (MJCF)
    #[arg(value_name = "MODEL", value_hint = ValueHint::FilePath)]
    model: PathBuf,
    /// Leave out unsupported elements that can be left out, and list them
    #[arg(long)]
    lenient: bool,
    /// Override an attribute of MJCF's `option`, such as timestep=0.005 or integrator=Euler; repeatable
    #[arg(long = "option", value_name = "NAME=VALUE", value_parser = name_value)]
    options: Vec<(String, String)>,
}

/// Where worlds start.
#[derive(Args)]
struct KeyArgs {
    /// Keyframe from which worlds start, by its name or its number counted from 0
    #[arg(long, value_name = "NAME|N")]
    keyframe: Option<String>,
}

impl KeyArgs {
    /// The keyframe's number, if one is given.
    fn find(&self, model: &Model) -> Result<Option<usize>, Failure> {
        self.keyframe.as_ref().map(|text| engine::keyframe(model, text)).transpose()
    }
}

/// What is read of archives.
#[derive(Args)]
struct InputArgs {
    /// Most memory that the arrays of an input file may take, such as 500M or 8G, 8 bytes per number [default: 256 MiB or
    /// 100 times the file's size, whichever is more]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    input_limit: Option<usize>,
}

/// How worlds are stepped.
#[derive(Args)]
struct RunArgs {
    /// Number type of the simulation: f64 agrees with MuJoCo to about 1e-10, f32 is faster
    #[arg(long, value_enum, default_value_t = Precision::F64)]
    precision: Precision,
    /// Code that steps the worlds
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    backend: Backend,
    /// Instruction set of machine code made for the model [default: the best that this machine has]
    #[arg(long, value_enum, value_name = "SET")]
    instructions: Option<Instructions>,
    /// Threads [default: all that this process may use]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    threads: Option<u32>,
    /// Tie threads to processors, for a machine that does nothing else: one for every processor that this process may use
    #[arg(long, overrides_with = "no_pin")]
    pin: bool,
    /// Leave threads free to move [default]
    #[arg(long, overrides_with = "pin")]
    no_pin: bool,
    /// Most memory for worlds and threads, and for outputs, such as 500M or 8G [default: three quarters of what is available]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_memory: Option<usize>,
    /// What is done about a world whose state becomes non-finite or huge
    #[arg(long, value_enum, default_value_t = OnDiverge::Freeze, value_name = "POLICY")]
    on_diverge: OnDiverge,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum OnDiverge {
    /// It keeps its last good state and is stepped no more
    Freeze,
    /// It starts again from where the command starts worlds: the keyframe, or else the reference configuration
    Reset,
    /// The command fails once all other worlds are done, and names it
    Error,
}

#[derive(Clone, Copy, ValueEnum)]
enum Precision {
    F32,
    F64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Backend {
    /// Machine code made for the model where this machine can run it, else SIMD lanes
    Auto,
    /// The same
    Native,
    /// SIMD lanes: 8 worlds (f64) or 16 (f32) at a time
    Wide,
    /// One world at a time: the reference, same bits
    Scalar,
}

#[derive(Clone, Copy, ValueEnum)]
enum Instructions {
    /// 16 vector registers of 32 bytes
    Avx2,
    /// 32 vector registers of 64 bytes
    Avx512,
}

/// Most worlds and most steps of one call: beyond any memory or patience, but small enough for exact arithmetic.
const COUNT_MAX: i64 = 1 << 31;

/// A number of bytes, or of thousands (k), millions (M), billions (G) or billions of thousands (T) of them.
fn bytes(text: &str) -> Result<usize, String> {
    let plain = text.trim_end_matches(['b', 'B']);
    let units = [("k", 1e3), ("m", 1e6), ("g", 1e9), ("t", 1e12)];
    let digits = plain.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = plain[digits.len()..].to_ascii_lowercase();
    let size = units.iter().find(|(name, _)| *name == unit).map(|(_, size)| *size);
    let size = size.or(unit.is_empty().then_some(1.0));
    let number = digits.trim().parse::<f64>().ok().zip(size);
    let all = number.map(|(number, size)| number * size).ok_or("expected a number of bytes, such as 500M or 8G")?;
    if (1.0..1e18).contains(&all) { Ok(all as usize) } else { Err("must be from 1 to 1e18 bytes".into()) }
}

fn count(text: &str) -> Result<usize, String> {
    let n: i64 = text.parse().map_err(|e| format!("{e}"))?;
    if (1..=COUNT_MAX).contains(&n) { Ok(n as usize) } else { Err(format!("must be from 1 to {COUNT_MAX}")) }
}

/// A share from 0 to 1.
fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        Ok(_) => Err("must be from 0 to 1".into()),
        Err(_) => Err("must be a number from 0 to 1; if this is the model, put it first".into()),
    }
}

fn name_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim().to_owned(), value.trim().to_owned())),
        _ => Err("expected NAME=VALUE, for example timestep=0.005".into()),
    }
}

/// The end of a command's long help: examples, and what can be asked for.
fn with_outputs(examples: &str) -> String {
    let width = Output::all().map(|output| output.name.len()).max().unwrap_or(0);
    let lines: String = Output::all().map(|o| format!("  {:<width$}  {}\n", o.name, o.meaning)).collect();
    format!(
        "{examples}\n\nOutputs (all but those of contacts and constraint rows have the same length in every world):\n{lines}"
    )
}

/// Runs a command; the exit status is documented in the help.
pub fn run(cli: Cli) -> ExitCode {
    let result = match cli.command {
        Command::Info(c) => c.run(),
        Command::Check(c) => c.run(),
        Command::Rollout(c) => c.run(),
        Command::Bench(c) => c.run(),
        Command::BenchClouds(c) => c.run(),
        Command::Accuracy(c) => c.run(),
        Command::Stress(c) => c.run(),
        Command::Eval(c) => c.run(),
        Command::Inverse(c) => c.run(),
        Command::Fd(c) => c.run(),
        Command::Optimise(c) => c.run(),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn options_are_names_with_values() {
        assert_eq!(name_value("timestep=0.1"), Ok(("timestep".into(), "0.1".into())));
        assert_eq!(name_value(" gravity = 0 0 -1 "), Ok(("gravity".into(), "0 0 -1".into())));
        assert!(name_value("timestep").is_err());
        assert!(name_value("=3").is_err());
    }

    #[test]
    fn shares_have_bounds() {
        assert_eq!(["0", "0.25", "1"].map(share), [Ok(0.0), Ok(0.25), Ok(1.0)]);
        for bad in ["-0.1", "1.01", "nan", "inf", "all"] {
            assert!(share(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(
            ["12", "3k", "500M", "8GB", "1g"].map(bytes),
            [12, 3_000, 500_000_000, 8_000_000_000, 1_000_000_000].map(Ok)
        );
        for bad in ["", "G", "-1", "0", "1X", "1GiB", "99999999999T", "1é"] {
            assert!(bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn counts_have_bounds() {
        assert_eq!(count("1"), Ok(1));
        for bad in ["0", "-1", "1e3", "99999999999", "99999999999999999999"] {
            assert!(count(bad).is_err(), "{bad}");
        }
    }
}
