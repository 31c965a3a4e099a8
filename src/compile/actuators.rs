//! Actuators and what they add to the joints that they act on.

use lanesim_kernels::actuation::{self, Actuation};
use lanesim_kernels::model::{
    Actuator, Control, Controller, Dynamics, Instance, Joint, JointKind, Model, MomentDof, Motor, Mount, Muscle, NONE,
    Servo, Span, Transmission,
};
use lanesim_kernels::position::{self, Position};
use lanesim_kernels::tendon;

use super::bounds;
use super::derived::Derived;
use super::equality::between;
use super::joints::Reflected;
use super::lengthrange;
use super::links::Links;
use super::names::label;
use super::order::Scene;
use super::pose::row_major;
use super::response::Responses;
use super::tendons::Tendons;
use crate::diagnostics::Diagnostics;
use crate::model::ElementNames;
use crate::spec::{self, Bias, Gain, Input, Spec, is_limited};

const MINVAL: f64 = 1e-15;

/// What an actuator acts on, in MuJoCo's numbering: a joint, a tendon, a body, or sites.
pub(crate) enum Target {
    Joint(usize),
    Tendon(usize),
    Body(usize),
    Sites(Vec<usize>),
}

impl Target {
    /// The joint.
    pub fn joint(&self) -> Option<usize> {
        match self {
            Target::Joint(joint) => Some(*joint),
            Target::Tendon(_) | Target::Body(_) | Target::Sites(_) => None,
        }
    }
}

/// What every actuator acts on. Names have been checked.
pub(crate) fn targets(spec: &Spec, names: &ElementNames) -> Vec<Target> {
    let target = |a: &spec::Actuator| match (a.transmission.joint(), a.transmission.tendon()) {
        (Some(name), _) => names.joints.id(name).map(Target::Joint),
        (_, Some(name)) => names.tendons.id(name).map(Target::Tendon),
        _ if a.transmission.body().is_some() => {
            a.transmission.body().and_then(|name| names.bodies.id(name)).map(Target::Body)
        }
        _ => {
            let sites = a.transmission.sites();
            Some(Target::Sites(sites.into_iter().filter_map(|(_, name)| names.sites.id(name)).collect()))
        }
    };
    spec.actuators.iter().filter_map(target).collect()
}

/// What actuators add to each joint: their own armature and damping times the square of the first gear.
pub(crate) fn reflected(spec: &Spec, targets: &[Target], njnt: usize) -> Vec<Reflected> {
    let mut out = vec![Reflected::default(); njnt];
    for (actuator, target) in spec.actuators.iter().zip(targets) {
        let Some(joint) = target.joint() else { continue };
        let squared = actuator.gear[0] * actuator.gear[0];
        out[joint].armature += actuator.armature * squared;
        for (sum, x) in out[joint].damping.iter_mut().zip(actuator.damping) {
            *sum += x * squared;
        }
    }
    out
}

/// The same for each tendon.
pub(crate) fn reflected_on_tendons(spec: &Spec, targets: &[Target]) -> Vec<Reflected> {
    let mut out = vec![Reflected::default(); spec.tendons.len()];
    for (actuator, target) in spec.actuators.iter().zip(targets) {
        let Target::Tendon(tendon) = target else { continue };
        let squared = actuator.gear[0] * actuator.gear[0];
        out[*tendon].armature += actuator.armature * squared;
        for (sum, x) in out[*tendon].damping.iter_mut().zip(actuator.damping) {
            *sum += x * squared;
        }
    }
    out
}

/// The actuators' tables.
#[derive(Default)]
pub(crate) struct Actuators {
    pub table: Vec<Actuator<f64>>,
    pub mounts: Vec<Mount<f64>>,
    pub moment_dofs: Vec<MomentDof>,
    /// Control ranges, infinite ones as they are, and whether they are in force; and those of activations.
    pub ctrl_ranges: Vec<([f64; 2], bool)>,
    pub act_ranges: Vec<[f64; 2]>,
    /// Which of them are each actuator's.
    pub rows: Vec<Span>,
    pub servos: Vec<Servo<f64>>,
    /// Controls, and which are whose.
    pub controls: Vec<Control<f64>>,
    pub told: Vec<Span>,
    pub controllers: Vec<Controller<f64>>,
    pub motors: Vec<Motor<f64>>,
    /// Activations.
    pub na: usize,
}

/// What MuJoCo's arrays have of the reference configuration.
#[derive(Default)]
pub(crate) struct Constants {
    /// Norm of the acceleration that a unit force causes.
    pub acc0: Vec<f64>,
    pub length0: Vec<f64>,
    /// Ranges of lengths.
    pub length_ranges: Vec<[f64; 2]>,
}

/// Compiles the actuators in their order, but for what follows from the reference configuration.
pub(crate) fn actuators(
    spec: &Spec,
    (scene, links, tendons): (&Scene, &Links, &Tendons),
    targets: &[Target],
    joints: &[Joint<f64>],
    dofs: &[lanesim_kernels::model::Dof<f64>],
) -> Actuators {
    let mut out = Actuators::default();
    for (actuator, target) in spec.actuators.iter().zip(targets) {
        let mut compiled = actuator_table(spec, actuator, target, joints);
        compiled.id = out.told.len() as u32;
        let mut ctrl_range = actuator.ctrlrange.unwrap_or_default();
        let mut act_range = actuator.actrange.unwrap_or_default();
        let inherited = match target {
            Target::Joint(joint) => scene.joints[*joint].spec.range,
            Target::Tendon(tendon) => spec.tendons[*tendon].range,
            Target::Body(_) | Target::Sites(_) => None,
        };
        if let (Some([lo, hi]), true) = (inherited, actuator.inheritrange > 0.0) {
            let (mean, half) = (0.5 * (lo + hi), 0.5 * (hi - lo) * actuator.inheritrange);
            let range = [mean - half, mean + half];
            if actuator.dynamics == spec::Dynamics::Integrator {
                act_range = range;
                set_act_range(&mut compiled, range, actuator.actlimited);
            } else {
                ctrl_range = range;
            }
        }
        out.add_controls(actuator, ctrl_range, &mut compiled);
        out.act_ranges.push(act_range);
        out.rows.push(Span { start: out.table.len() as u32, len: actuator.outputs() as u32 });
        out.add_states(actuator, spec.option.timestep, &mut compiled);
        let moves: Vec<MomentDof> = match target {
            Target::Joint(joint) => {
                let first = joints[*joint].dof;
                let n = dofs[first as usize..].iter().take_while(|dof| dof.joint as usize == *joint).count() as u32;
                (first..first + n).map(|dof| MomentDof { dof, moves: [true, false] }).collect()
            }
            Target::Tendon(tendon) => {
                let dofs = tendons.dofs_of(*tendon).iter();
                dofs.map(|entry| MomentDof { dof: entry.dof, moves: [true, false] }).collect()
            }
            // Whatever moves may touch it.
            Target::Body(_) => (0..dofs.len() as u32).map(|dof| MomentDof { dof, moves: [true, false] }).collect(),
            Target::Sites(sites) => {
                let mounts: Vec<Mount<f64>> = sites.iter().map(|site| mount(scene, links, *site)).collect();
                let ends = [0, 1].map(|k| mounts.get(k).map_or(NONE, |mount| mount.link));
                compiled.mounts = Span { start: out.mounts.len() as u32, len: mounts.len() as u32 };
                out.mounts.extend(mounts);
                // What moves both moves neither against the other.
                let apart = between(dofs, links, ends).into_iter().filter(|entry| entry.moves != [true; 2]);
                apart.map(|entry| MomentDof { dof: entry.dof, moves: entry.moves }).collect()
            }
        };
        if actuator.gain == Gain::So3 {
            out.add_servo(actuator, &moves, compiled);
            continue;
        }
        compiled.moments = Span { start: out.moment_dofs.len() as u32, len: moves.len() as u32 };
        out.moment_dofs.extend(moves);
        out.table.push(compiled);
    }
    out
}

impl Actuators {
    /// Gives an actuator its controls; the first has a range of its own, or one that it inherits.
    fn add_controls(&mut self, written: &spec::Actuator, first: [f64; 2], compiled: &mut Actuator<f64>) {
        let (start, count) = (self.controls.len() as u32, written.controls());
        compiled.ctrl = if count == 0 { NONE } else { start };
        self.told.push(Span { start, len: count as u32 });
        let several = matches!(written.gain, Gain::Pid);
        for k in 0..count {
            let own = |range: Option<[f64; 2]>| (range.unwrap_or_default(), is_limited(range, spec::Tri::Auto));
            let (range, limited) = match written.inputs.get(k) {
                Some(Input::Vel) if several => own(written.velrange),
                Some(Input::FeedForward) if several => own(written.ffrange),
                _ => (first, is_limited(Some(first), written.ctrllimited)),
            };
            self.ctrl_ranges.push((range, limited));
            let limited = limited && !bounds::are_none(range);
            self.controls.push(Control { actuator: compiled.id, limited, range: bounds::of_clamp(range) });
        }
    }

    /// Gives an actuator its activations, and what it does with them.
    fn add_states(&mut self, written: &spec::Actuator, timestep: f64, compiled: &mut Actuator<f64>) {
        let states = written.states().map(|is| {
            let place = if is { self.na as u32 } else { NONE };
            self.na += usize::from(is);
            place
        });
        if compiled.dynamics != Dynamics::None {
            compiled.act = states[0];
        }
        let motor = written.gain == Gain::DcMotor;
        let input = |input: Input| {
            written.inputs.iter().position(|own| *own == input).map_or(NONE, |place| compiled.ctrl + place as u32)
        };
        let inputs = [Input::Pos, Input::Vel, Input::FeedForward].map(input);
        if written.gain == Gain::Pid || motor && inputs != [NONE; 3] {
            compiled.controller = self.controllers.len() as u32;
            self.controllers.push(controller(written, inputs, [states[0], states[1]], timestep));
        }
        if motor {
            compiled.motor = self.motors.len() as u32;
            let [_, _, temperature, bristle, current] = states;
            let own = motor_table(written, timestep);
            self.motors.push(Motor { voltage: input(Input::Voltage), temperature, bristle, current, ..own });
        }
    }
}

impl Actuators {
    /// The three actuators of a servo on an orientation, which `moves` say what moves.
    fn add_servo(&mut self, written: &spec::Actuator, moves: &[MomentDof], compiled: Actuator<f64>) {
        let most = written.forcerange.map_or(f64::INFINITY, |range| range[1]);
        let bounded = is_limited(written.forcerange, written.forcelimited) && most.is_finite();
        let (first, ctrl) = (self.table.len() as u32, compiled.ctrl);
        let quaternion = written.quaternion;
        let most = if bounded { most } else { 0.0 };
        self.servos.push(Servo { first, ctrl, quaternion, bounded, most });
        for axis in 0..3 {
            // A ball's dofs are its child's axes.
            let own = if compiled.transmission == Transmission::Turn { &moves[axis..=axis] } else { moves };
            let moments = Span { start: self.moment_dofs.len() as u32, len: own.len() as u32 };
            self.moment_dofs.extend_from_slice(own);
            let act = if compiled.act == NONE { NONE } else { compiled.act + axis as u32 };
            let ctrl = if quaternion { NONE } else { ctrl + axis as u32 };
            let servo = self.servos.len() as u32 - 1;
            self.table.push(Actuator { moments, act, ctrl, servo, force_limited: false, ..compiled.clone() });
        }
    }
}

/// What an actuator does with several controls.
fn controller(a: &spec::Actuator, inputs: [u32; 3], [slew, integral]: [u32; 2], timestep: f64) -> Controller<f64> {
    let [windup, slew_rate] = match a.gain {
        Gain::DcMotor => [a.dynprm[8], a.dynprm[7]],
        _ => [a.dynprm[0], a.dynprm[1]],
    };
    let (ki, gains) = match a.gain {
        Gain::DcMotor => (a.gainprm[5], [a.gainprm[4], a.gainprm[6]]),
        _ => (a.gainprm[0], [0.0; 2]),
    };
    let winds = windup > 0.0;
    Controller { inputs, slew, integral, winds, slew_step: slew_rate * timestep, slew_rate, windup, ki, gains }
}

/// A motor, but for its control and its activations.
fn motor_table(a: &spec::Actuator, timestep: f64) -> Motor<f64> {
    let [resistance, constant, warming, told_at, _, _, _, most_voltage, ..] = a.gainprm;
    let [time, most_rise, lost, capacity, air, stiffness, damping, ..] = a.dynprm;
    let [amplitude, periods, phase, moving, still, fades, ..] = a.biasprm;
    let inverse = |x: f64| if x > 0.0 { 1.0 / x } else { 0.0 };
    Motor {
        voltage: NONE,
        temperature: NONE,
        bristle: NONE,
        current: NONE,
        saturates: most_voltage > 0.0,
        rises: most_rise > 0.0,
        cogs: amplitude != 0.0,
        resistance,
        constant,
        warming: [warming, air - told_at],
        heating: [inverse(capacity), inverse(lost * capacity)],
        most_voltage,
        electric: [inverse(time), -time * (-timestep * inverse(time)).exp_m1()],
        most_rise,
        cogging: [amplitude, periods, phase],
        bristles: [stiffness, damping],
        friction: [moving, still - moving, inverse(fades)],
    }
}

/// Refuses what discrete steps do not have: a metric that joins branches.
pub(crate) fn check_discrete(spec: &Spec, tables: &Model<f64>, diagnostics: &mut Diagnostics) {
    let integrator = tables.options.integrator;
    if !integrator.has_metric() {
        return;
    }
    let above = |two: &[MomentDof]| {
        let runs = tables.tree_pattern.row(two[1].dof as usize);
        runs.iter().any(|run| run.range().contains(&(two[0].dof as usize)))
    };
    for actuator in &tables.actuators {
        let (i, written) = (actuator.id as usize, &spec.actuators[actuator.id as usize]);
        let branches = !tables.moment_dofs[actuator.moments.range()].windows(2).all(above);
        if branches && actuator.follows() {
            let message = format!(
                "its force follows the motion of several branches, which is not supported under integrator {integrator}"
            );
            let label = label("actuator", &written.name, i);
            diagnostics.push(&written.source, label, message, "set integrator=\"implicitfast\"");
        }
    }
}

/// A site as a frame on which an actuator acts.
fn mount(scene: &Scene, links: &Links, site: usize) -> Mount<f64> {
    let site = &scene.sites[site];
    let pose = links.body_pose[site.body].then(&site.pose);
    Mount {
        link: links.body_link[site.body],
        pos: pose.pos.to_array(),
        rot: row_major(pose.rotation()),
        quat: pose.wxyz(),
    }
}

/// Finds what follows from the reference configuration, and puts it into the tables.
pub(crate) fn constants(
    spec: &Spec,
    derived: &Derived,
    tables: &mut Model<f64>,
    diagnostics: &mut Diagnostics,
) -> Constants {
    let mut out = Constants { length_ranges: lengthrange::ranges(spec, tables, diagnostics), ..Constants::default() };
    if tables.actuators.is_empty() {
        return out;
    }
    let (mut position, mut actuation) = (Position::new(&tables.sizes), Actuation::new(&tables.sizes));
    let instance = Instance::from(&*tables);
    let mut tendons = tendon::Tendons::new(&tables.sizes);
    position::kinematics(instance, (&tables.qpos0[..]).into(), &mut position);
    tendon::tendons(tables, &position, &tables.qpos0, &vec![0.0; tables.sizes.nv], &mut tendons);
    actuation::lengths(instance, (&tables.qpos0[..]).into(), (&position, &tendons), &mut actuation);
    let responses = Responses::new(&derived.hinges);
    let Model { actuators, servos, moment_dofs, muscles, .. } = tables;
    let mut along = 0.0;
    for (a, compiled) in actuators.iter_mut().enumerate() {
        let (id, actuator) = (compiled.id as usize, &spec.actuators[compiled.id as usize]);
        let moments = compiled.moments.range();
        let response = derived
            .heavy_response(&moment_dofs[moments.clone()], &actuation.moment[moments.clone()])
            .unwrap_or_else(|| responses.to(&moment_dofs[moments.clone()], &actuation.moment[moments]));
        out.acc0.push(response.norm);
        out.length0.push(actuation.length[a]);
        let of_servo = servos.get(compiled.servo as usize).map(|servo| a - servo.first as usize);
        along = if of_servo.is_some_and(|axis| axis > 0) { along + response.along } else { response.along };
        if actuator.dampratio > 0.0 {
            // All axes of a servo hold as one does to which they are on average.
            let mass = actuator.outputs() as f64 / along.max(1e-15);
            let stiffness = if actuator.gain == Gain::Pid { -compiled.bias[1] } else { compiled.gain[0] };
            compiled.bias[2] = -2.0 * actuator.dampratio * (stiffness.max(0.0) * mass).sqrt();
            compiled.bias_affine = true;
        }
        let mut muscle = |prm: &[f64; 10]| {
            muscles.push(muscle(prm, out.length_ranges[id], response.norm));
            muscles.len() as u32 - 1
        };
        if actuator.gain == Gain::Muscle {
            compiled.muscle_gain = muscle(&actuator.gainprm);
        }
        if actuator.bias == Bias::Muscle {
            compiled.muscle_bias = muscle(&actuator.biasprm);
        }
    }
    // Of a servo, the last axis knows what all hold against.
    for servo in servos.iter() {
        let first = servo.first as usize;
        let hold = actuators[first + 2].bias[2];
        actuators[first..first + 2].iter_mut().for_each(|own| own.bias[2] = hold);
    }
    out
}

fn actuator_table(spec: &Spec, a: &spec::Actuator, target: &Target, joints: &[Joint<f64>]) -> Actuator<f64> {
    let joint = target.joint().map(|joint| &joints[joint]);
    let in_parent = matches!(a.transmission, spec::Transmission::JointInParent(_));
    let transmission = match (&a.transmission, joint.map(|joint| (joint.kind, in_parent))) {
        (spec::Transmission::SliderCrank { .. }, _) => Transmission::SliderCrank,
        (spec::Transmission::Site { .. }, _) if a.gain == Gain::So3 => Transmission::TurnBetween,
        (spec::Transmission::Joint(_), _) if a.gain == Gain::So3 => Transmission::Turn,
        (spec::Transmission::Site { reference: Some(_), .. }, _) => Transmission::Relative,
        (spec::Transmission::Site { .. }, _) => Transmission::Site,
        (spec::Transmission::Tendon(_), _) => Transmission::Tendon,
        (spec::Transmission::Body(_), _) => Transmission::Body,
        (_, Some((JointKind::Ball, false))) => Transmission::Ball,
        (_, Some((JointKind::Ball, true))) => Transmission::BallInParent,
        (_, Some((JointKind::Free, false))) => Transmission::Free,
        (_, Some((JointKind::Free, true))) => Transmission::FreeInParent,
        _ => Transmission::Scalar,
    };
    let first = |prm: &[f64; 10]| [prm[0], prm[1], prm[2]];
    let gain = match a.gain {
        Gain::Fixed | Gain::So3 => [a.gainprm[0], 0.0, 0.0],
        Gain::Affine => first(&a.gainprm),
        Gain::Muscle | Gain::Pid | Gain::DcMotor => [0.0; 3],
    };
    let bias = match a.bias {
        Bias::None | Bias::Muscle | Bias::DcMotor => [0.0; 3],
        Bias::Affine | Bias::So3 => first(&a.biasprm),
    };
    let groups = spec.option.actuatorgroupdisable;
    let force_range = a.forcerange.unwrap_or_default();
    let mut compiled = Actuator {
        transmission,
        joint: target.joint().map_or(NONE, |joint| joint as u32),
        tendon: if let Target::Tendon(tendon) = target { *tendon as u32 } else { NONE },
        body: if let Target::Body(body) = target { *body as u32 } else { NONE },
        qpos: joint.map_or(0, |joint| joint.qpos),
        mounts: Span::default(),
        moments: Span::default(),
        turns: a.gear[3..] != [0.0; 3],
        gain_affine: gain[1..] != [0.0; 2],
        bias_affine: bias != [0.0; 3],
        ctrl: NONE,
        controller: NONE,
        id: 0,
        servo: NONE,
        motor: NONE,
        force_limited: is_limited(a.forcerange, a.forcelimited) && !bounds::are_none(force_range),
        disabled: u32::try_from(a.group).ok().and_then(|g| groups.checked_shr(g)).is_some_and(|g| g & 1 == 1),
        gear: a.gear,
        rod: if let spec::Transmission::SliderCrank { rod, .. } = a.transmission { rod } else { 0.0 },
        gain,
        bias,
        force_range: bounds::of_clamp(force_range),
        turning: turns(a, transmission),
        dynamics: Dynamics::None,
        act: NONE,
        act_limited: false,
        early: a.actearly && a.gain != Gain::DcMotor,
        smooth: false,
        muscle_gain: NONE,
        muscle_bias: NONE,
        times: [0.0; 3],
        reach: spec.option.timestep,
        act_range: [0.0; 2],
    };
    set_dynamics(&mut compiled, a, spec.option.timestep);
    set_act_range(&mut compiled, a.actrange.unwrap_or_default(), a.actlimited);
    compiled
}

/// Whether setpoints are rotations, of which those that are turns apart are the same.
fn turns(a: &spec::Actuator, transmission: Transmission) -> bool {
    let rotation = match transmission {
        Transmission::Ball | Transmission::BallInParent => true,
        Transmission::Relative => a.gear[..3] == [0.0; 3] && a.gear[3..] != [0.0; 3],
        _ => false,
    };
    let follows = matches!(a.dynamics, spec::Dynamics::None | spec::Dynamics::Integrator);
    rotation && follows && a.gain == Gain::Fixed && a.bias == Bias::Affine
}

/// By what times an activation follows its control: see [`Actuator::times`].
pub(crate) fn times(dynamics: spec::Dynamics, dynprm: &[f64]) -> [f64; 3] {
    match dynamics {
        spec::Dynamics::Filter | spec::Dynamics::FilterExact => [1.0 / dynprm[0].max(MINVAL), 0.0, 0.0],
        spec::Dynamics::Muscle => {
            let smooth = if dynprm[2] >= MINVAL { 1.0 / dynprm[2] } else { 0.0 };
            [dynprm[0], dynprm[1], smooth]
        }
        _ => [0.0; 3],
    }
}

/// How the activation follows the control; steps take `timestep`.
fn set_dynamics(compiled: &mut Actuator<f64>, a: &spec::Actuator, timestep: f64) {
    let time = a.dynprm[0].max(MINVAL);
    compiled.dynamics = match a.dynamics {
        spec::Dynamics::None | spec::Dynamics::Pid | spec::Dynamics::DcMotor => Dynamics::None,
        spec::Dynamics::Integrator => Dynamics::Integrator,
        spec::Dynamics::Filter | spec::Dynamics::FilterExact => Dynamics::Filter,
        spec::Dynamics::Muscle => Dynamics::Muscle,
    };
    compiled.times = times(a.dynamics, &a.dynprm);
    compiled.smooth = compiled.dynamics == Dynamics::Muscle && compiled.times[2] > 0.0;
    if a.dynamics == spec::Dynamics::FilterExact {
        compiled.reach = -time * (-timestep / time).exp_m1();
    }
}

/// What a muscle does, by the parameters of its gain or bias, the range of its actuator's lengths, and the acceleration that a unit of
/// its force causes.
fn muscle(prm: &[f64; 10], range: [f64; 2], acc0: f64) -> Muscle<f64> {
    let [from, to, force, scale, lmin, lmax, vmax, fpmax, fvmax, _] = *prm;
    let unit = (range[1] - range[0]) / (to - from).max(MINVAL);
    let knees = [0.5 * (lmin + 1.0), 0.5 * (1.0 + lmax)];
    let widths = [knees[0] - lmin, 1.0 - knees[0], knees[1] - 1.0, lmax - knees[1]];
    Muscle {
        start: range[0],
        low: from,
        scale: 1.0 / unit.max(MINVAL),
        speed: 1.0 / (unit * vmax).max(MINVAL),
        force: if force < 0.0 { scale / acc0.max(MINVAL) } else { force },
        reach: [lmin, lmax],
        knees,
        arcs: widths.map(|width| 1.0 / width.max(MINVAL)),
        fvmax,
        fpmax,
    }
}

/// Whether an actuator is a muscle whose peak force follows from inertias.
pub(crate) fn is_scaled_muscle(a: &spec::Actuator) -> bool {
    a.gain == Gain::Muscle && a.gainprm[2] < 0.0 || a.bias == Bias::Muscle && a.biasprm[2] < 0.0
}

/// Gives an actuator a range of activation, which is in force if the flag says so.
fn set_act_range(compiled: &mut Actuator<f64>, range: [f64; 2], flag: spec::Tri) {
    compiled.act_range = bounds::of_clamp(range);
    compiled.act_limited = is_limited(Some(range), flag) && !bounds::are_none(range);
}
