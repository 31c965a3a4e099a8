//! What a command prints: results, notes, progress.

use std::io::{self, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;

use super::failure::Failure;

/// Prints one JSON value on one line.
pub fn json(value: &Value) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    writeln!(out, "{value}")?;
    Ok(out.flush()?)
}

/// Prints rows of a label and a value, aligned.
pub fn table(rows: &[(&str, String)]) -> Result<(), Failure> {
    let width = rows.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    let mut out = io::stdout().lock();
    for (label, value) in rows {
        writeln!(out, "{label:<width$}  {value}")?;
    }
    Ok(out.flush()?)
}

/// Prints remarks to standard error.
pub fn notes(kind: &str, lines: &[String]) {
    let mut err = io::stderr().lock();
    for line in lines {
        // A closed standard error only loses the remark.
        let _ = writeln!(err, "{kind}: {line}");
    }
}

/// A progress bar over steps of worlds, with rate and time to go; absent where nobody watches. Workers only add to a
/// counter, a thread of its own draws.
pub struct Progress {
    counter: Arc<AtomicU64>,
    drawing: Option<(Arc<AtomicBool>, JoinHandle<()>)>,
}

impl Progress {
    /// A bar over `total` world steps, unless `quiet` or standard error is not a terminal.
    pub fn new(what: &'static str, total: u64, quiet: bool) -> Progress {
        let counter = Arc::new(AtomicU64::new(0));
        let watched = !quiet && io::stderr().is_terminal();
        let drawing = watched.then(|| {
            let (done, count) = (Arc::new(AtomicBool::new(false)), counter.clone());
            let stop = done.clone();
            (done, std::thread::spawn(move || draw(what, total, &count, &stop)))
        });
        Progress { counter, drawing }
    }

    /// Where workers add finished world steps.
    pub fn counter(&self) -> &AtomicU64 {
        &self.counter
    }

    /// Removes the bar.
    pub fn finish(self) {
        if let Some((done, thread)) = self.drawing {
            done.store(true, Ordering::Relaxed);
            thread.thread().unpark();
            // A bar that could not be drawn is no reason to fail.
            let _ = thread.join();
        }
    }
}

fn draw(what: &'static str, total: u64, count: &AtomicU64, stop: &AtomicBool) {
    let style = ProgressStyle::with_template("{msg:>9} {bar:30} {human_pos}/{human_len} steps, {per_sec}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(total).with_style(style).with_message(what);
    while !stop.load(Ordering::Relaxed) {
        bar.set_position(count.load(Ordering::Relaxed));
        std::thread::park_timeout(Duration::from_millis(100));
    }
    bar.finish_and_clear();
}

/// A number with four digits and a unit prefix: 1234567 is `1.235 M`.
pub fn human(x: f64) -> String {
    for (scale, unit) in [(1e9, "G"), (1e6, "M"), (1e3, "k")] {
        if x.abs() >= scale {
            return format!("{:.3} {unit}", x / scale);
        }
    }
    format!("{x:.1} ")
}
