//! The map: worlds lost, by time step and severity, for every integrator.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use lanesim::Rollout;
use plotters::prelude::*;
use serde_json::{Value, json};

use super::super::RunArgs;
use super::super::engine;
use super::super::failure::Failure;
use super::super::{KeyArgs, ModelArgs};
use super::wild::Wildness;

/// What is asked for.
pub struct Map<'a> {
    /// The model.
    pub model: &'a ModelArgs,
    /// How it is stepped.
    pub run: &'a RunArgs,
    /// Where worlds start.
    pub start: &'a KeyArgs,
    /// Worlds of a cell.
    pub worlds: usize,
    /// Simulated time, s.
    pub seconds: f64,
    /// Integrators.
    pub integrators: &'a [String],
    /// Time steps, s.
    pub timesteps: &'a [f64],
    /// Severities, and how wild worlds are at each.
    pub severities: Vec<(f64, Wildness)>,
}

/// Worlds lost with an integrator, `[timestep][severity]`, or why there are no figures.
pub struct Sheet {
    /// The integrator.
    pub integrator: String,
    /// Worlds lost.
    pub lost: Result<Vec<Vec<usize>>, String>,
}

impl Map<'_> {
    /// The number of cells.
    pub fn cells(&self) -> usize {
        self.integrators.len() * self.timesteps.len() * self.severities.len()
    }

    /// Runs all cells.
    pub fn measure(&self, done: &AtomicU64) -> Result<Vec<Sheet>, Failure> {
        let sheet = |integrator: &String| {
            let rows = self.timesteps.iter().map(|dt| self.row(integrator, *dt, done));
            let lost = match rows.collect::<Result<Vec<_>, _>>() {
                Ok(rows) => Ok(rows),
                // An integrator that the model cannot have is no reason to leave out the others.
                Err(Failure::Model(why)) => Err(why.to_string()),
                Err(other) => return Err(other),
            };
            Ok(Sheet { integrator: integrator.clone(), lost })
        };
        self.integrators.iter().map(sheet).collect()
    }

    fn row(&self, integrator: &str, timestep: f64, done: &AtomicU64) -> Result<Vec<usize>, Failure> {
        let dt = format!("{timestep:?}");
        let model = engine::load_with(self.model, &[("timestep", &dt), ("integrator", integrator)])?.model;
        let key = self.start.find(&model)?;
        let mut worlds = self.run.worlds(&model, self.worlds, key)?;
        let mut row = Vec::new();
        for (_, wildness) in &self.severities {
            wildness.start(&mut worlds, key)?;
            let held = wildness.held(timestep);
            let intervals = (self.seconds / (timestep * held as f64)).ceil() as u64;
            for interval in 0..intervals {
                wildness.drive(&mut worlds, interval)?;
                worlds.rollout(&Rollout { nstep: held, ..Rollout::default() })?;
                if worlds.lost() == self.worlds {
                    break;
                }
            }
            row.push(worlds.lost());
            done.fetch_add(1, Ordering::Relaxed);
        }
        Ok(row)
    }

    /// The figures as a record.
    pub fn json(&self, sheets: &[Sheet]) -> Value {
        let sheet = |sheet: &Sheet| {
            json!({
                "integrator": sheet.integrator,
                "lost": sheet.lost.as_ref().ok(),
                "refused": sheet.lost.as_ref().err(),
            })
        };
        json!({
            "worlds": self.worlds,
            "seconds": self.seconds,
            "timesteps": self.timesteps,
            "severities": self.severities.iter().map(|(severity, _)| severity).collect::<Vec<_>>(),
            "sheets": sheets.iter().map(sheet).collect::<Vec<_>>(),
        })
    }

    /// The figures as tables.
    pub fn text(&self, sheets: &[Sheet]) -> String {
        let mut text = format!("worlds lost of {}, after {} s\n", self.worlds, self.seconds);
        for sheet in sheets {
            text += &format!("\n{:12}", sheet.integrator);
            let rows = match &sheet.lost {
                Ok(rows) => rows,
                Err(why) => {
                    text += &format!("  not run: {}\n", why.lines().next().unwrap_or_default());
                    continue;
                }
            };
            text += &self.severities.iter().map(|(s, _)| format!("{:>8}", format!("x{s}"))).collect::<String>();
            for (dt, row) in self.timesteps.iter().zip(rows) {
                let cells: String = row.iter().map(|lost| format!("{lost:8}")).collect();
                text += &format!("\n{:>12}{cells}", format!("{} ms", shown_ms(*dt)));
            }
            text += "\n";
        }
        text
    }

    /// The figures as a picture: a panel per integrator, a cell per time step and severity, the darker the more are lost.
    pub fn picture(&self, file: &Path, sheets: &[Sheet]) -> Result<(), Box<dyn std::error::Error>> {
        const CELL: (i32, i32) = (52, 34);
        const EDGE: (i32, i32) = (74, 58);
        let (columns, rows) = (self.severities.len() as i32, self.timesteps.len() as i32);
        let shown: Vec<_> = sheets.iter().filter_map(|s| Some((&s.integrator, s.lost.as_ref().ok()?))).collect();
        let panel = EDGE.0 + CELL.0 * columns + 20;
        let size = (panel * shown.len().max(1) as i32, EDGE.1 + CELL.1 * rows + 50);
        let area = SVGBackend::new(file, (size.0 as u32, size.1 as u32)).into_drawing_area();
        area.fill(&WHITE)?;
        let (head, small) = (("sans-serif", 17).into_font(), ("sans-serif", 13).into_font());
        for (p, (integrator, lost)) in shown.iter().enumerate() {
            let left = panel * p as i32 + EDGE.0;
            area.draw(&Text::new(format!("{integrator}: lost of {}", self.worlds), (left, 12), head.clone()))?;
            for (c, (severity, _)) in self.severities.iter().enumerate() {
                let x = left + CELL.0 * c as i32;
                area.draw(&Text::new(format!("x{severity}"), (x + 12, EDGE.1 - 20), small.clone()))?;
            }
            for (r, dt) in self.timesteps.iter().enumerate() {
                let y = EDGE.1 + CELL.1 * r as i32;
                area.draw(&Text::new(format!("{} ms", shown_ms(*dt)), (left - 62, y + 9), small.clone()))?;
                for (c, n) in lost[r].iter().enumerate() {
                    let x = left + CELL.0 * c as i32;
                    let share = *n as f64 / self.worlds as f64;
                    let colour = shade(share);
                    area.draw(&Rectangle::new([(x, y), (x + CELL.0 - 2, y + CELL.1 - 2)], colour.filled()))?;
                    let ink = if share > 0.5 { WHITE } else { BLACK };
                    area.draw(&Text::new(n.to_string(), (x + 10, y + 9), small.clone().color(&ink)))?;
                }
            }
            let foot = (left, EDGE.1 + CELL.1 * rows + 14);
            area.draw(&Text::new("severity across, time step down", foot, small.clone()))?;
        }
        Ok(area.present()?)
    }
}

fn shown_ms(seconds: f64) -> f64 {
    (1e9 * seconds).round() * 1e-6
}

/// From green, nothing lost, by yellow to dark red.
fn shade(share: f64) -> RGBColor {
    if share == 0.0 {
        return RGBColor(196, 230, 200);
    }
    let mix = |a: f64, b: f64| (a + (b - a) * share) as u8;
    RGBColor(mix(250.0, 130.0), mix(225.0, 20.0), mix(150.0, 30.0))
}
