//! Ranges of actuators' lengths, as MuJoCo finds them: the model, with nothing but its limits, is pulled to either side.

use lanesim_kernels::actuation;
use lanesim_kernels::collision::{Body, ConvexCollider, Outline, Point};
use lanesim_kernels::inertia;
use lanesim_kernels::lane::{Lane, LaneQuery};
use lanesim_kernels::math::ldl;
use lanesim_kernels::model::{Instance, Model};
use lanesim_kernels::part::Kernels;
use lanesim_kernels::pipeline::{Run, Stages};
use lanesim_kernels::position;
use lanesim_kernels::state::{Applied, BlockStatus, State};
use lanesim_kernels::step::step;
use lanesim_kernels::tendon;
use lanesim_kernels::workspace::Workspace;

use super::names::label;
use wide::f64x8;

use crate::diagnostics::Diagnostics;
use crate::spec::{self, Bias, Gain, JointKind, LengthRange, LengthRangeMode, Spec, is_limited};

type L = f64x8;
const MINVAL: f64 = 1e-15;
/// Most steps of a pull.
pub(super) const MOST_STEPS: f64 = 1e5;

/// The ranges of all actuators, 0 0 of those that need none.
pub(super) fn ranges(spec: &Spec, tables: &Model<f64>, diagnostics: &mut Diagnostics) -> Vec<[f64; 2]> {
    let options = &spec.compiler.lengthrange;
    let mut out: Vec<[f64; 2]> = spec.actuators.iter().map(|a| a.lengthrange.unwrap_or_default()).collect();
    let mut pulled = Vec::new();
    for (a, actuator) in spec.actuators.iter().enumerate().filter(|(_, actuator)| needed(options, actuator)) {
        if options.useexisting && out[a][0] < out[a][1] {
            continue;
        }
        match limits(spec, actuator).filter(|_| options.uselimit) {
            Some(range) => out[a] = range,
            None => pulled.push(a),
        }
    }
    if pulled.is_empty() || tables.sizes.nv == 0 {
        return out;
    }
    match super::compile(&bare(spec)) {
        Ok(model) => {
            let row = |a: &usize| spec.actuators[..*a].iter().map(spec::Actuator::outputs).sum();
            let rows: Vec<usize> = pulled.iter().map(row).collect();
            let ends = pull_all(model.tables(), options, &rows);
            for (a, sides) in pulled.into_iter().zip(ends.chunks_exact(2)) {
                out[a] = judge(spec, options, a, [sides[0], sides[1]], diagnostics);
            }
        }
        Err(problems) => diagnostics.0.extend(problems.0),
    }
    out
}

fn needed(options: &LengthRange, actuator: &spec::Actuator) -> bool {
    match options.mode {
        LengthRangeMode::None => false,
        LengthRangeMode::Muscle => actuator.gain == Gain::Muscle || actuator.bias == Bias::Muscle,
        LengthRangeMode::All => actuator.gain != Gain::So3,
    }
}

/// The range of the joint or tendon on which an actuator acts, if it is limited.
fn limits(spec: &Spec, actuator: &spec::Actuator) -> Option<[f64; 2]> {
    if let Some(name) = actuator.transmission.tendon() {
        let tendon = spec.tendons.iter().find(|tendon| tendon.name == name)?;
        return tendon.range.filter(|range| is_limited(Some(*range), tendon.limited));
    }
    let name = actuator.transmission.joint()?;
    let joint = spec.bodies.iter().flat_map(|body| &body.joints).find(|joint| joint.name == name)?;
    let scalar = matches!(joint.kind, JointKind::Hinge | JointKind::Slide);
    joint.range.filter(|range| scalar && is_limited(Some(*range), joint.limited))
}

/// The model with nothing but its limits and equality constraints.
fn bare(spec: &Spec) -> Spec {
    let mut bare = spec.clone();
    bare.compiler.lengthrange.mode = LengthRangeMode::None;
    let options = &mut bare.option;
    let flags = &mut options.flags;
    (flags.constraint, flags.limit, flags.equality) = (true, true, true);
    (flags.contact, flags.frictionloss, flags.spring, flags.damper) = (false, false, false, false);
    (flags.gravity, flags.actuation) = (false, false);
    if spec.compiler.lengthrange.timestep > 0.0 {
        options.timestep = spec.compiler.lengthrange.timestep;
    }
    // What does not act need not be compiled.
    bare.keys.clear();
    bare
}

/// An actuator's length at the end of a pull, and the least and the largest of its last part.
#[derive(Clone, Copy, Debug)]
struct End {
    last: f64,
    least: f64,
    most: f64,
}

/// Pulls every actuator to both sides, eight pulls at a time.
fn pull_all(tables: &Model<f64>, options: &LengthRange, actuators: &[usize]) -> Vec<End> {
    let pulls: Vec<(usize, f64)> = actuators.iter().flat_map(|a| [(*a, -1.0), (*a, 1.0)]).collect();
    pulls.chunks(L::WIDTH).flat_map(|pulls| pull(tables, options, pulls)).collect()
}

/// No geoms touch.
struct Apart;

impl ConvexCollider for Apart {
    fn collide(
        &self,
        _: [Outline<'_>; 2],
        _: [&Body<f64>; 2],
        _: f64,
        _: usize,
        _: &mut [f64; 3],
        _: &mut dyn FnMut(Point<f64>),
    ) {
    }
}

fn pull(tables: &Model<f64>, options: &LengthRange, pulls: &[(usize, f64)]) -> Vec<End> {
    let (h, sizes) = (tables.options.timestep, &tables.sizes);
    let (mut ws, mut state) = (Workspace::<L>::new(tables), State::<L>::initial(tables));
    let mut applied = Applied::<L>::new(sizes);
    let mut status = BlockStatus { alive: (1 << pulls.len()) - 1, ..BlockStatus::default() };
    let fading = L::of((-h / options.timeconst.max(0.01)).exp());
    // As MuJoCo counts it, rounding included.
    let mut time = 0.0;
    let mut ends = vec![End { last: 0.0, least: f64::INFINITY, most: f64::NEG_INFINITY }; pulls.len()];
    while time < options.inttotal && status.alive != 0 {
        time += h;
        state.qvel.iter_mut().for_each(|v| *v *= fading);
        prepare(tables, &state, &mut ws);
        apply(tables, options, pulls, &ws, &mut applied);
        for (lane, ((a, _), end)) in pulls.iter().zip(&mut ends).enumerate() {
            end.last = ws.actuation.length[*a].get(lane);
            if time > options.inttotal - options.interval {
                (end.least, end.most) = (end.least.min(end.last), end.most.max(end.last));
            }
        }
        let mut run = Run {
            applied: Some(&applied),
            varied: None,
            clock: None,
            max_contacts: 0,
            convex: &Apart,
            stages: Stages::STEP,
            residual: false,
            executor: &mut Kernels,
            keep: true,
        };
        step(tables, &mut state, &mut run, &mut status, &mut ws);
    }
    // A world that was lost has no length.
    let lost = |lane: usize| status.alive >> lane & 1 == 0;
    ends.iter_mut().enumerate().filter(|(lane, _)| lost(*lane)).for_each(|(_, end)| end.last = f64::NAN);
    ends
}

/// Lengths, moments and the factor of M at the state.
fn prepare(tables: &Model<f64>, state: &State<L>, ws: &mut Workspace<L>) {
    let model = Instance::from(tables);
    position::kinematics(model, (&state.qpos[..]).into(), &mut ws.position);
    tendon::tendons(tables, &ws.position, &state.qpos, &state.qvel, &mut ws.tendons);
    inertia::crb(model, &ws.position, &ws.tendons, &mut ws.inertia);
    actuation::lengths(model, (&state.qpos[..]).into(), (&ws.position, &ws.tendons), &mut ws.actuation);
    let acceleration = &mut ws.acceleration;
    acceleration.factor.copy_from_slice(&ws.inertia.m);
    let (factor, inverse) = (&mut acceleration.factor, &mut acceleration.inverse);
    ldl::factor(&tables.rows, &tables.tree_pattern, factor, inverse, &mut acceleration.multipliers);
}

/// A force along the moments, so large that the acceleration has the norm that is asked for.
fn apply(
    tables: &Model<f64>,
    options: &LengthRange,
    pulls: &[(usize, f64)],
    ws: &Workspace<L>,
    applied: &mut Applied<L>,
) {
    let force = &mut applied.qfrc_applied;
    force.fill(L::zero());
    for (lane, (a, _)) in pulls.iter().enumerate() {
        for k in tables.actuators[*a].moments.range() {
            let dof = tables.moment_dofs[k].dof as usize;
            let moment = ws.actuation.moment[k].get(lane);
            force[dof].set(lane, moment);
        }
    }
    let norm = |x: &[L]| x.iter().fold(L::zero(), |sum, x| x.mul_add(*x, sum)).sqrt().max(L::of(MINVAL));
    let mut response = force.clone();
    let acceleration = &ws.acceleration;
    ldl::solve(&tables.rows, &tables.tree_pattern, &acceleration.factor, &acceleration.inverse, &mut response);
    let mut scale = L::of(options.accel) / norm(&response);
    if options.maxforce > 0.0 {
        scale = scale.min(L::of(options.maxforce) / norm(force));
    }
    let mut signed = scale;
    for (lane, (_, side)) in pulls.iter().enumerate() {
        signed.set(lane, side * scale.get(lane));
    }
    force.iter_mut().for_each(|f| *f *= signed);
}

/// The range, if the pulls came to rest.
fn judge(spec: &Spec, options: &LengthRange, a: usize, ends: [End; 2], diagnostics: &mut Diagnostics) -> [f64; 2] {
    let range = ends.map(|end| end.last);
    let width = range[1] - range[0];
    let still = ends.iter().all(|end| end.most - end.least <= options.tolrange * width);
    if !(width > 0.0 && still) {
        let actuator = &spec.actuators[a];
        let side = |end: &End| format!("{:.4} to {:.4}", end.least, end.most);
        let sides: Vec<String> = ends.iter().map(side).collect();
        let message = format!(
            "the range of its lengths was not found: pulled to either side, its length still went from {} at the end",
            sides.join(" and from ")
        );
        let remedy = "give lengthrange, or limit the joints that it moves";
        diagnostics.push(&actuator.source, label("actuator", &actuator.name, a), message, remedy);
    }
    range
}
