//! What a command prints: results, notes, progress.

use std::io::{self, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use lanesim::{Model, StatusEvent};
use serde_json::{Value, json};

use super::failure::Failure;

/// Prints one JSON value on one line.
pub fn json(value: &Value) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    writeln!(out, "{value}")?;
    Ok(out.flush()?)
}

/// Prints a text.
pub fn text(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    write!(out, "{text}")?;
    Ok(out.flush()?)
}

/// An event as JSON.
pub fn event(event: &StatusEvent) -> Value {
    json!({ "status": event.status.names(), "step": event.step, "place": event.place })
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

/// Prints what a lenient load left out; where many elements were left out for one reason, their number.
pub fn losses(model: &Model) {
    notes("left out", &brief(&model.report().losses));
}

/// Losses by their reason, what follows the last colon: those of a frequent one as a single line.
fn brief(losses: &[String]) -> Vec<String> {
    const SHOWN: usize = 3;
    let reason = |loss: &String| loss.rsplit(": ").next().unwrap_or_default().to_owned();
    let mut kinds: Vec<(String, Vec<&String>)> = Vec::new();
    for loss in losses {
        let reason = reason(loss);
        match kinds.iter_mut().find(|(kind, _)| *kind == reason) {
            Some((_, list)) => list.push(loss),
            None => kinds.push((reason, vec![loss])),
        }
    }
    let mut lines = Vec::new();
    for (reason, list) in kinds {
        if list.len() <= SHOWN {
            lines.extend(list.into_iter().cloned());
        } else {
            let first = list[0].strip_suffix(&reason).unwrap_or_default().trim_end_matches(": ");
            lines.push(format!(
                "{} elements, from {first} on: {reason} (`lanesim info --lenient` lists them)",
                list.len()
            ));
        }
    }
    lines
}

/// Prints remarks to standard error.
pub fn notes(kind: &str, lines: &[String]) {
    let mut err = io::stderr().lock();
    for line in lines {
        // A closed standard error only loses the remark.
        let _ = writeln!(err, "{kind}: {line}");
    }
}

/// A progress bar over steps of worlds or the like, with rate and time to go; absent where nobody watches. Workers only add to a
/// counter, a thread of its own draws.
pub struct Progress {
    counter: Arc<AtomicU64>,
    drawing: Option<(Arc<AtomicBool>, JoinHandle<()>)>,
}

impl Progress {
    /// A bar over `total` of `units`, unless `quiet` or standard error is not a terminal.
    pub fn new(what: &'static str, units: &'static str, total: u64, quiet: bool) -> Progress {
        let counter = Arc::new(AtomicU64::new(0));
        let watched = !quiet && io::stderr().is_terminal();
        let drawing = watched.then(|| {
            let (done, count) = (Arc::new(AtomicBool::new(false)), counter.clone());
            let stop = done.clone();
            (done, std::thread::spawn(move || draw((what, units), total, &count, &stop)))
        });
        Progress { counter, drawing }
    }

    /// Where workers add what is finished.
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

fn draw((what, units): (&'static str, &'static str), total: u64, count: &AtomicU64, stop: &AtomicBool) {
    let template = format!("{{msg:>9}} {{bar:30}} {{human_pos}}/{{human_len}} {units}, {{per_sec}}, {{eta}} left");
    let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_losses_are_one_line() {
        let sensor = |n: usize| format!("a.xml:{n}: gyro \"g{n}\": sensors are not supported, left out");
        let mesh = "a.xml:3: mesh \"m\": meshes are not supported, left out".to_owned();
        let mut losses: Vec<String> = (5..38).map(sensor).collect();
        losses.push(mesh.clone());
        let lines = brief(&losses);
        assert_eq!(lines.len(), 2);
        let start = "33 elements, from a.xml:5: gyro \"g5\" on: sensors are not supported, left out (";
        assert!(lines[0].starts_with(start), "{}", lines[0]);
        assert_eq!(lines[1], mesh);
        assert_eq!(brief(&losses[..3]), losses[..3]);
    }
}
