//! What a command prints: results, notes, progress.

use std::io::{self, IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
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

/// A progress bar over `total` steps of worlds, with rate and time to go; hidden where nobody watches.
pub fn progress(what: &'static str, total: u64, quiet: bool) -> ProgressBar {
    let hidden = quiet || !io::stderr().is_terminal();
    let target = if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
    let style = ProgressStyle::with_template("{msg:>9} {bar:30} {human_pos}/{human_len} steps, {per_sec}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::with_draw_target(Some(total), target).with_style(style).with_message(what);
    if !hidden {
        bar.enable_steady_tick(Duration::from_millis(200));
    }
    bar
}

/// A number with three digits after the leading one and a unit prefix: 1234567 is `1.235 M`.
pub fn human(x: f64) -> String {
    for (scale, unit) in [(1e9, "G"), (1e6, "M"), (1e3, "k")] {
        if x.abs() >= scale {
            return format!("{:.3} {unit}", x / scale);
        }
    }
    format!("{x:.4}")
}
