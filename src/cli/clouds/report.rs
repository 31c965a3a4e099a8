//! The three tables.

use serde_json::{Value, json};

/// What is evaluated.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Dynamics {
    Forward,
    Inverse,
}

impl Dynamics {
    const ALL: [Dynamics; 2] = [Dynamics::Forward, Dynamics::Inverse];

    fn name(self) -> &'static str {
        match self {
            Dynamics::Forward => "forward",
            Dynamics::Inverse => "inverse",
        }
    }
}

/// What an engine did.
pub struct Row {
    pub dynamics: Dynamics,
    /// Contacts that were wanted, and those that were found on average.
    pub contacts: usize,
    pub found: f64,
    /// `f64`, `f32` or `MuJoCo`.
    pub engine: &'static str,
    pub threads: usize,
    /// States of the clouds: cost, gradient, Hessian.
    pub states: [usize; 3],
    /// Of these clouds, and of the last with whole evaluations.
    pub seconds: [f64; 4],
    /// Errors, the median and the largest, of the states that were judged.
    pub gradient: Option<[f64; 2]>,
    pub hessian: Option<[f64; 2]>,
    pub judged: usize,
}

impl Row {
    /// Whole evaluations per second.
    fn rate(&self) -> f64 {
        self.states[2] as f64 / self.seconds[3]
    }

    pub fn json(&self) -> Value {
        let [cost, gradient, hessian, whole] = self.seconds;
        json!({
            "dynamics": self.dynamics.name(),
            "contacts": self.contacts,
            "contacts_found": self.found,
            "engine": self.engine,
            "threads": self.threads,
            "states": { "cost": self.states[0], "gradient": self.states[1], "hessian": self.states[2] },
            "seconds": { "cost": cost, "gradient": gradient, "hessian": hessian, "hessian_whole": whole },
            "evaluations_per_second": self.rate(),
            "gradient_error": self.gradient,
            "hessian_error": self.hessian,
            "states_judged": self.judged,
        })
    }
}

/// Rows by what they are about: dynamics, contacts and threads.
fn groups<'a>(rows: &'a [Row], threads: &'a [usize]) -> impl Iterator<Item = Vec<&'a Row>> {
    let mut contacts: Vec<usize> = rows.iter().map(|row| row.contacts).collect();
    contacts.sort_unstable_by(|a, b| b.cmp(a));
    contacts.dedup();
    let keys = Dynamics::ALL.into_iter().flat_map(move |dynamics| {
        let contacts = contacts.clone();
        contacts.into_iter().flat_map(move |contacts| threads.iter().map(move |n| (dynamics, contacts, *n)))
    });
    keys.map(|key| rows.iter().filter(|row| (row.dynamics, row.contacts, row.threads) == key).collect())
}

/// All tables, in Markdown.
pub fn tables(rows: &[Row], threads: &[usize], version: Option<&str>) -> String {
    let mujoco = version.map_or(String::new(), |version| format!("; MuJoCo {version}"));
    let mut text = format!("Table 1: thousands of evaluations per second, each as a whole{mujoco}\n\n");
    text += "| dynamics | contacts | threads | f64 | f32 | MuJoCo | f64 / MuJoCo | f32 / MuJoCo |\n";
    text += "|---|---|---|---|---|---|---|---|\n";
    for group in groups(rows, threads) {
        let rate = |engine: &str| group.iter().find(|row| row.engine == engine).map(|row| row.rate());
        let k = |rate: Option<f64>| rate.map_or("-".to_owned(), |rate| format!("{:.0}", 1e-3 * rate));
        let ratio = |engine: &str| match (rate(engine), rate("MuJoCo")) {
            (Some(ours), Some(theirs)) => format!("{:.1}", ours / theirs),
            _ => "-".to_owned(),
        };
        text += &format!("| {} | {} | {} | {} | ", about(&group), k(rate("f64")), k(rate("f32")), k(rate("MuJoCo")));
        text += &format!("{} | {} |\n", ratio("f64"), ratio("f32"));
    }
    text += &seconds(rows, threads);
    text += &errors(rows, threads);
    text
}

/// Dynamics, contacts, threads.
fn about(group: &[&Row]) -> String {
    let row =
        |row: &&Row| format!("{} | {} ({:.1} found) | {}", row.dynamics.name(), row.contacts, row.found, row.threads);
    group.first().map_or(String::new(), row)
}

fn seconds(rows: &[Row], threads: &[usize]) -> String {
    let states = rows.first().map_or([0; 3], |row| row.states);
    let mut text =
        "\nTable 2: milliseconds for all 30 time steps\n\n| dynamics | contacts | threads | engine |".to_owned();
    for (what, states) in ["cost", "gradient", "Hessian"].iter().zip(states) {
        text += &format!(" {what}, {states} states |");
    }
    text += "\n|---|---|---|---|---|---|---|\n";
    for group in groups(rows, threads) {
        for row in &group {
            let [cost, gradient, hessian, _] = row.seconds.map(|s| 1e3 * s);
            text += &format!("| {} | {} | {cost:.4} | {gradient:.3} | {hessian:.2} |\n", about(&group), row.engine);
        }
    }
    text
}

fn errors(rows: &[Row], threads: &[usize]) -> String {
    let mut text = "\nTable 3: relative errors of derivatives, median and largest\n\n".to_owned();
    text += "| dynamics | contacts | engine | gradient | Hessian | states |\n|---|---|---|---|---|---|\n";
    for group in groups(rows, &threads[..1]) {
        for row in &group {
            let pair = |error: &Option<[f64; 2]>| match error {
                Some([median, most]) => format!("{median:.1e}, {most:.1e}"),
                None => "-".to_owned(),
            };
            let (gradient, hessian) = (pair(&row.gradient), pair(&row.hessian));
            let (dynamics, contacts, judged) = (row.dynamics.name(), row.contacts, row.judged);
            text += &format!("| {dynamics} | {contacts} | {} | {gradient} | {hessian} | {judged} |\n", row.engine);
        }
    }
    text
}
