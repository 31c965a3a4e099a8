//! Impedance of constraints; joint limits and dry friction.

use lanesim_kernels::model::{FrictionLoss, Impedance, Limit};
use lanesim_kernels::options::Options;

use super::bounds;
use super::check::dof_count;
use super::order::Scene;
use crate::spec::is_limited;

const MINVAL: f64 = 1e-15;
const MINIMP: f64 = 1e-4;
const MAXIMP: f64 = 0.9999;

/// Impedance and reference from `solref` and `solimp`, clamped to what they may be.
pub(crate) fn impedance(options: &Options, solref: [f64; 2], solimp: [f64; 5]) -> Impedance<f64> {
    let [dmin, dmax, width, midpoint, power] = solimp;
    let dmax = dmax.clamp(MINIMP, MAXIMP);
    let [time, damping] = safe(options, solref);
    let k = if time > 0.0 { 1.0 / (dmax * dmax * time * time * damping * damping) } else { -time / (dmax * dmax) };
    let b = if damping > 0.0 { 2.0 / (dmax * time) } else { -damping / dmax };
    let dmin = dmin.clamp(MINIMP, MAXIMP);
    let (width, midpoint, power) = (width.max(0.0), midpoint.clamp(MINIMP, MAXIMP), power.max(1.0));
    let flat = dmin == dmax || width <= MINVAL;
    Impedance {
        flat,
        small_power: if power == 1.0 || power == 2.0 { power as u8 } else { 0 },
        k,
        b,
        dmin,
        dmax,
        inverse_width: if flat { 0.0 } else { 1.0 / width },
        midpoint,
        power,
        low: midpoint.powf(1.0 - power),
        high: (1.0 - midpoint).powf(1.0 - power),
    }
}

/// `solref` with the time constant raised to what the time step can follow.
fn safe(options: &Options, solref: [f64; 2]) -> [f64; 2] {
    if raised(options, solref) { [2.0 * options.timestep, solref[1]] } else { solref }
}

/// Whether the flag `refsafe` changes `solref`.
pub(crate) fn raised(options: &Options, solref: [f64; 2]) -> bool {
    options.flags.refsafe && solref[0] > 0.0 && solref[0] < 2.0 * options.timestep
}

/// Impedance at zero violation.
fn at_zero(i: &Impedance<f64>) -> f64 {
    if i.flat { 0.5 * (i.dmin + i.dmax) } else { i.dmin }
}

/// The joint limits in force, in the order of joints.
pub(crate) fn limits(options: &Options, scene: &Scene, dof_invweight0: &[f64]) -> Vec<Limit<f64>> {
    if !options.flags.limit || !options.flags.constraint {
        return Vec::new();
    }
    let limited = |(index, j): (usize, &super::order::Joint)| {
        let spec = j.spec;
        let kind = spec.kind;
        let boundless = bounds::are_none(spec.range.unwrap_or_default());
        if kind == crate::spec::JointKind::Free || !is_limited(spec.range, spec.limited) || boundless {
            return None;
        }
        Some(Limit {
            joint: index as u32,
            dof: j.dof as u32,
            qpos: j.qpos as u32,
            ball: kind == crate::spec::JointKind::Ball,
            range: range_of(spec),
            margin: spec.margin,
            impedance: impedance(options, spec.solreflimit, spec.solimplimit),
            invweight: dof_invweight0[j.dof],
        })
    };
    scene.joints.iter().enumerate().filter_map(limited).collect()
}

/// The range of a limit: of a ball joint, 0 and an angle.
fn range_of(joint: &crate::spec::Joint) -> [f64; 2] {
    let [lo, hi] = bounds::of_limit(joint.range.unwrap_or_default());
    if joint.kind == crate::spec::JointKind::Ball { [0.0, hi.max(0.0)] } else { [lo, hi] }
}

/// Dry friction in force, in the order of dofs.
pub(crate) fn friction_losses(options: &Options, scene: &Scene, dof_invweight0: &[f64]) -> Vec<FrictionLoss<f64>> {
    if !options.flags.frictionloss || !options.flags.constraint {
        return Vec::new();
    }
    let mut losses = Vec::new();
    for j in scene.joints.iter().filter(|j| j.spec.frictionloss > 0.0) {
        let i = impedance(options, j.spec.solreffriction, j.spec.solimpfriction);
        let d = at_zero(&i);
        for dof in j.dof..j.dof + dof_count(j.spec.kind) {
            losses.push(FrictionLoss {
                dof: dof as u32,
                bound: j.spec.frictionloss,
                r: ((1.0 - d) / d * dof_invweight0[dof]).max(MINVAL),
                b: i.b,
            });
        }
    }
    losses
}

/// Stiffness and damping of each joint with `springdamper`, by joint: (joint, stiffness, damping).
pub(crate) fn springdampers(scene: &Scene, dof_invweight0: &[f64]) -> Vec<(usize, f64, f64)> {
    let mut out = Vec::new();
    for (index, j) in scene.joints.iter().enumerate() {
        let [time, ratio] = j.spec.springdamper;
        if time > 0.0 && ratio > 0.0 {
            let n = dof_count(j.spec.kind);
            let weights = &dof_invweight0[j.dof..j.dof + n];
            let mass = n as f64 / weights.iter().sum::<f64>().max(MINVAL);
            out.push((index, mass / (time * ratio).powi(2), 2.0 * mass / time));
        }
    }
    out
}
