//! A fuzzer that knows MJCF, options, archives and command lines. No part of the program may panic, abort, hang or take the
//! machine's memory, whatever it is given.
//!
//!     cargo test --profile ci --test fuzz -- --seconds 60
//!     cargo test --profile ci --test fuzz -- --executions 2000000 --jobs 2 --seed 7
//!     cargo test --profile ci --test fuzz -- --seed 7 --show 1234      # one execution: its input, and what it does
//!
//! Every execution follows from the seed and its number. Executions run in child processes with 2 GB of memory; one that
//! takes more than ten seconds of the processor ends its process, and the parent names it and goes on behind it. What is found is made
//! small by hand and kept in `tests/fuzz/corpus`, all of which is run first. Without arguments, as in `cargo test`, a few
//! thousand executions are run.

mod archive;
mod arguments;
#[allow(dead_code, unused_imports)]
#[path = "../../src/cli/mod.rs"]
mod cli;
mod execution;
mod model;
mod random;
mod schema;

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use execution::Fuzzer;

/// Longest that an execution may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// Most address space of a child, in kilobytes.
const MEMORY: &str = "2000000";
/// Executions of a child, after which a new one is started.
const BATCH: u64 = 50_000;
/// Findings after which a run ends.
const MOST_FINDINGS: usize = 20;

/// Options that only the fuzzer has.
const OURS: [&str; 7] = ["--executions", "--seconds", "--seed", "--first", "--jobs", "--show", "--help"];

/// What to run.
#[derive(Clone, Parser)]
#[command(name = "fuzz")]
struct Arguments {
    /// Executions, of all jobs together
    #[arg(long)]
    executions: Option<u64>,
    /// Time after which no new execution is started
    #[arg(long)]
    seconds: Option<u64>,
    /// Seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of the first execution
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Child processes at a time
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1024))]
    jobs: u64,
    /// Print the input of this execution and run it here, without a child
    #[arg(long)]
    show: Option<u64>,
    /// Be a child: the file in which the present execution is noted
    #[arg(long, hide = true)]
    note: Option<PathBuf>,
}

fn main() -> ExitCode {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let mut arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if given.iter().any(|word| OURS.iter().any(|own| word.starts_with(own))) => error.exit(),
        // `cargo test` hands its filters and flags to every test program.
        Err(_) if given.iter().any(|word| word == "--list") => return ExitCode::SUCCESS,
        Err(_) if given.iter().any(|word| !word.starts_with('-') && !"fuzz".contains(&**word)) => {
            return ExitCode::SUCCESS;
        }
        Err(_) => Arguments::parse_from(["fuzz"]),
    };
    if let Some(index) = arguments.show {
        Fuzzer::new().execute(arguments.seed, index, true);
        return ExitCode::SUCCESS;
    }
    if let Some(note) = &arguments.note {
        return child(&arguments, note);
    }
    if arguments.executions.is_none() && arguments.seconds.is_none() {
        arguments.executions = Some(3000);
    }
    Run::new(arguments).all()
}

/// A stretch of executions, in this process.
fn child(arguments: &Arguments, note: &PathBuf) -> ExitCode {
    let started = Instant::now();
    let watch = &*Box::leak(Box::new((AtomicU64::new(0), AtomicU64::new(0))));
    std::thread::spawn(move || guard(started, watch));
    std::panic::set_hook(Box::new(|info| {
        let text = info.to_string().replace('\n', " ");
        println!("panic {text}");
    }));
    let fuzzer = Fuzzer::new();
    let mut note = File::create(note).expect("a note");
    if arguments.first == 0 {
        fuzzer.run_corpus();
    }
    let end = arguments.first + arguments.executions.unwrap_or(BATCH);
    for index in arguments.first..end {
        if arguments.seconds.is_some_and(|seconds| started.elapsed().as_secs() >= seconds) {
            break;
        }
        write_note(&mut note, index);
        watch.0.store(index + 1, Ordering::Relaxed);
        watch.1.store(started.elapsed().as_millis() as u64, Ordering::Relaxed);
        if catch_unwind(AssertUnwindSafe(|| fuzzer.execute(arguments.seed, index, false))).is_err() {
            println!("at {index}");
        }
    }
    println!("done");
    ExitCode::SUCCESS
}

fn write_note(note: &mut File, index: u64) {
    use std::io::Seek;
    note.rewind().and_then(|()| note.write_all(&index.to_le_bytes())).expect("a note");
}

/// Ends the process when an execution takes too long: of the processor, as others may use it too, or by the clock.
fn guard(started: Instant, watch: &(AtomicU64, AtomicU64)) {
    let (mut seen, mut since) = (0, cpu_seconds());
    loop {
        std::thread::sleep(Duration::from_millis(500));
        let present = watch.0.load(Ordering::Relaxed);
        if present != seen {
            (seen, since) = (present, cpu_seconds());
        }
        let elapsed = started.elapsed().as_millis() as u64 - watch.1.load(Ordering::Relaxed);
        let spent = cpu_seconds() - since;
        if present > 0 && (spent > PATIENCE || Duration::from_millis(elapsed) > 10 * PATIENCE) {
            println!("hang");
            std::process::exit(3);
        }
    }
}

/// Processor time that this process has used, where the system says so.
fn cpu_seconds() -> Duration {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // After the name, which may hold anything: the state is field 3, the times in hundredths are fields 14 and 15.
    let fields: Vec<&str> = text.rsplit(')').next().unwrap_or_default().split_ascii_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|t| t.parse::<u64>().ok()).unwrap_or(0);
    Duration::from_millis(10 * (ticks(11) + ticks(12)))
}

/// A run of all children.
struct Run {
    arguments: Arguments,
    started: Instant,
    next: AtomicU64,
    done: AtomicU64,
    findings: Mutex<Vec<String>>,
}

impl Run {
    fn new(arguments: Arguments) -> Run {
        let next = AtomicU64::new(arguments.first);
        Run { arguments, started: Instant::now(), next, done: AtomicU64::new(0), findings: Mutex::new(Vec::new()) }
    }

    fn all(&self) -> ExitCode {
        std::thread::scope(|scope| {
            (0..self.arguments.jobs).for_each(|job| drop(scope.spawn(move || self.job(job))));
        });
        let (done, seconds) = (self.done.load(Ordering::Relaxed), self.started.elapsed().as_secs_f64());
        let findings = self.findings.lock().expect("findings");
        let rate = done as f64 / seconds / self.arguments.jobs as f64;
        println!(
            "fuzz: {done} executions, {} findings, seed {}, {seconds:.0} s, {rate:.0} executions/s per job",
            findings.len(),
            self.arguments.seed
        );
        if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
    }

    /// Seconds that are left, if they are counted.
    fn left(&self) -> Option<u64> {
        self.arguments.seconds.map(|seconds| seconds.saturating_sub(self.started.elapsed().as_secs()))
    }

    /// Children one after another, until everything has been run.
    fn job(&self, job: u64) {
        let note = std::env::temp_dir().join(format!("lanesim-fuzz-{}-{job}", std::process::id()));
        let end = self.arguments.executions.map(|n| self.arguments.first + n);
        while self.left() != Some(0) && self.findings.lock().expect("findings").len() < MOST_FINDINGS {
            let first = self.next.fetch_add(BATCH, Ordering::Relaxed);
            let last = end.map_or(first + BATCH, |end| end.min(first + BATCH));
            if first >= last {
                break;
            }
            self.stretch(first, last, &note);
        }
        // Nothing is lost with it.
        let _ = std::fs::remove_file(&note);
    }

    /// Executions `first` to `last`, with a new child behind each that ends one.
    fn stretch(&self, first: u64, last: u64, note: &PathBuf) {
        let mut at = first;
        while at < last {
            let left = self.left();
            if left == Some(0) {
                return;
            }
            let mut child = self.start(at, last - at, left, note);
            let (lines, died) = self.listen(&mut child);
            let bytes = std::fs::read(note).unwrap_or_default();
            let noted = bytes.first_chunk().map_or(at, |bytes| u64::from_le_bytes(*bytes));
            self.done.fetch_add(noted + 1 - at, Ordering::Relaxed);
            let Some(how) = died else { return };
            let why = if lines.iter().any(|line| line == "hang") { "took too long".to_owned() } else { how };
            self.find(format!("execution {noted}: {why}"));
            at = noted + 1;
        }
    }

    fn start(&self, first: u64, executions: u64, seconds: Option<u64>, note: &PathBuf) -> Child {
        let program = std::env::current_exe().expect("this program");
        let script = format!("ulimit -v {MEMORY}; ulimit -c 0; exec \"$0\" \"$@\"");
        let mut command = Command::new("sh");
        command.args(["-c", &script]).arg(program).arg("--note").arg(note);
        for (name, value) in [
            ("--seed", Some(self.arguments.seed)),
            ("--first", Some(first)),
            ("--executions", Some(executions)),
            ("--seconds", seconds),
        ] {
            command.args(value.map(|value| format!("{name}={value}")));
        }
        command.env("RUST_BACKTRACE", "0").stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().expect("a child")
    }

    /// What a child says, and how it ended if that was not well.
    fn listen(&self, child: &mut Child) -> (Vec<String>, Option<String>) {
        let (mut lines, mut panic) = (Vec::new(), String::new());
        let errors = child.stderr.take().map(|stream| {
            std::thread::spawn(move || BufReader::new(stream).lines().map_while(Result::ok).last().unwrap_or_default())
        });
        for line in BufReader::new(child.stdout.take().expect("a pipe")).lines().map_while(Result::ok) {
            if let Some(text) = line.strip_prefix("panic ") {
                panic = text.to_owned();
            } else if let Some(index) = line.strip_prefix("at ") {
                self.find(format!("execution {index}: {panic}"));
            }
            lines.push(line);
        }
        let status = child.wait().expect("a child");
        let said = errors.and_then(|thread| thread.join().ok()).unwrap_or_default();
        let well = status.success() && lines.last().is_some_and(|line| line == "done");
        (lines, (!well).then(|| format!("{status} {said} {panic}")))
    }

    fn find(&self, what: String) {
        println!("finding: seed {} {what}", self.arguments.seed);
        self.findings.lock().expect("findings").push(what);
    }
}
