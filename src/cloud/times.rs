//! Kinds of columns of a cloud, and what these take.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Columns that a cloud goes through together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Position,
    Velocity,
    /// Activations, then controls.
    Actuation,
    /// Accelerations, of inverse dynamics.
    Acceleration,
}

/// Adds up what threads spend on columns of each kind, and on the states themselves.
#[derive(Debug, Default)]
pub struct Times {
    /// By kind, states first: how many there were, and nanoseconds.
    spent: [[AtomicU64; 2]; 5],
}

/// What one of them takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Time {
    /// Of which kind: `state`, `position`, `velocity`, `actuation` (activations and controls), `acceleration`.
    pub kind: &'static str,
    /// How many there were.
    pub count: u64,
    /// What all of them took together, s.
    pub seconds: f64,
}

impl Time {
    /// What one of them takes, s.
    pub fn each(&self) -> f64 {
        self.seconds / self.count as f64
    }
}

impl Times {
    /// Of so many columns of a kind, or states.
    pub(crate) fn add(&self, kind: Option<Kind>, count: usize, took: Duration) {
        let place = match kind {
            None => 0,
            Some(Kind::Position) => 1,
            Some(Kind::Velocity) => 2,
            Some(Kind::Actuation) => 3,
            Some(Kind::Acceleration) => 4,
        };
        let [counted, spent] = &self.spent[place];
        counted.fetch_add(count as u64, Ordering::Relaxed);
        spent.fetch_add(u64::try_from(took.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }

    /// By kind, without those of which there were none.
    pub fn all(&self) -> Vec<Time> {
        let kinds = ["state", "position", "velocity", "actuation", "acceleration"];
        let rows = kinds.into_iter().zip(&self.spent).map(|(kind, numbers)| {
            let [count, nanoseconds] = [0, 1].map(|i: usize| numbers[i].load(Ordering::Relaxed));
            Time { kind, count, seconds: nanoseconds as f64 * 1e-9 }
        });
        rows.filter(|time| time.count > 0).collect()
    }
}
