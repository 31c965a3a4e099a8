//! Exact derivatives against differences that are extrapolated (Richardson), and the same bits however they are computed.

use crate::support::{fails, load_with, moving, options};
use lanesim::cloud::{Follow, Method, Scheme, Solving, Target, Transition, accurate};
use lanesim::rows::{Rows, Strided, Values};
use lanesim::{Backend, Field, Model, Options, Parameter, Precision, Rollout, Worlds};

const EXACT: Scheme = Scheme { method: Method::Exact, eps: 1e-6, centred: true, sensors: false };

/// By differences of two lengths, of which the error of second order is taken away; and the columns in which they differ so much that
/// they go across a kink.
fn extrapolated(worlds: &mut Worlds, eps: f64) -> (Transition, Vec<bool>) {
    let near = worlds.transition(&Scheme { eps, ..Scheme::default() }).expect("derivatives");
    let far = worlds.transition(&Scheme { eps: 2.0 * eps, ..Scheme::default() }).expect("derivatives");
    let of = |near: &[f64], far: &[f64]| near.iter().zip(far).map(|(a, b)| (4.0 * a - b) / 3.0).collect();
    let found = Transition { a: of(&near.a, &far.a), b: of(&near.b, &far.b), ..near.clone() };
    let columns = Columns::new(&near, worlds.nworld());
    let kinked = columns.each(|world, column| {
        let differ = |row| (columns.get(&near, world, row, column) - columns.get(&far, world, row, column)).abs();
        let kink = near.changed[world * columns.all + column] + far.changed[world * columns.all + column];
        kink != 0.0 || (0..columns.rows).any(|row| differ(row) > 1e-5 * columns.size(&near, world, column))
    });
    (found, kinked)
}

/// Where a column's numbers are.
struct Columns {
    nworld: usize,
    rows: usize,
    all: usize,
}

impl Columns {
    fn new(of: &Transition, nworld: usize) -> Columns {
        let rows = (0..).find(|n| n * n * nworld >= of.a.len()).expect("a square");
        Columns { nworld, rows, all: of.changed.len() / nworld }
    }

    fn each<T>(&self, f: impl Fn(usize, usize) -> T) -> Vec<T> {
        (0..self.nworld * self.all).map(|n| f(n / self.all, n % self.all)).collect()
    }

    fn get(&self, of: &Transition, world: usize, row: usize, column: usize) -> f64 {
        let row = world * self.rows + row;
        match column.checked_sub(self.rows) {
            None => of.a[row * self.rows + column],
            Some(control) => of.b[row * (self.all - self.rows) + control],
        }
    }

    /// Largest number of a column, or 1.
    fn size(&self, of: &Transition, world: usize, column: usize) -> f64 {
        (0..self.rows).map(|row| self.get(of, world, row, column).abs()).fold(1.0, f64::max)
    }
}

/// Largest relative error of the columns that do not go across a kink, and which part of all those are.
fn error(found: &Transition, (expected, kinked): &(Transition, Vec<bool>), nworld: usize) -> (f64, f64) {
    let columns = Columns::new(found, nworld);
    let errors = columns.each(|world, column| {
        let error = |row| (columns.get(found, world, row, column) - columns.get(expected, world, row, column)).abs();
        let most = (0..columns.rows).map(error).fold(0.0, |most: f64, x| if x.is_nan() { x } else { most.max(x) });
        most / columns.size(expected, world, column)
    });
    let smooth = errors.iter().zip(kinked).filter(|(_, kinked)| !**kinked).map(|(error, _)| *error);
    let worst =
        smooth.clone().fold(0.0, |most: f64, x| if x.is_nan() || most.is_nan() { f64::NAN } else { most.max(x) });
    (worst, smooth.count() as f64 / kinked.len() as f64)
}

fn assert_exact(name: &str, integrator: &str, eps: f64, tolerance: f64) {
    const NWORLD: usize = 9;
    let model = accurate(&load_with(name, &[("integrator", integrator)])).expect("a model");
    let mut worlds = moving(&model, NWORLD, 0.5, &options(Precision::F64, Backend::Native));
    let found = worlds.transition(&EXACT).expect("derivatives");
    let (expected, mut kinked) = extrapolated(&mut worlds, eps);
    // Where a row is about to begin to act, differences go across the kink whatever their length.
    kinked.iter_mut().zip(&found.changed).for_each(|(kinked, edges)| *kinked |= *edges != 0.0);
    let (worst, part) = error(&found, &(expected, kinked), NWORLD);
    assert!(worst <= tolerance, "{name} {integrator}: {worst:e}");
    assert!(part > 0.9, "{name} {integrator}: only {part} of the columns are without kinks");
}

#[test]
fn smooth_models_have_the_limit_of_differences() {
    for name in ["zoo/cartpole", "zoo/arm", "zoo/pendulums", "zoo/quadruped", "zoo/chain31"] {
        for integrator in ["Euler", "implicitfast", "implicit"] {
            assert_exact(name, integrator, 1e-4, 1e-9);
        }
    }
}

#[test]
fn models_in_contact_have_the_limit_of_differences() {
    for name in
        ["zoo/hopper", "zoo/walker", "zoo/cheetah", "zoo/ant", "zoo/humanoid27", "zoo/humanoid18", "zoo/capsule_pile"]
    {
        for integrator in ["Euler", "implicitfast", "implicit"] {
            assert_exact(name, integrator, 1e-7, 2e-6);
        }
    }
}

#[test]
fn everything_else_has_the_limit_of_differences() {
    for name in ["zoo/four_bar", "zoo/stewart", "zoo/closed_chain", "zoo/hand32"] {
        assert_exact(name, "Euler", 2e-6, 1e-6);
    }
    for name in "activation actuator_ball_free actuator_limits actuator_refsite actuator_slidercrank ball_limit equality_joint equality_weld \
        fluid fluid_ellipsoid frictionloss gravcomp muscle springs tendon_actuators tendon_armature tendon_forces tendon_wrap"
        .split_whitespace()
    {
        for integrator in ["Euler", "implicitfast", "implicit"] {
            assert_exact(&format!("unit/{name}"), integrator, 1e-6, 1e-6);
        }
    }
}

#[test]
fn pairs_without_a_formula_have_the_limit_of_differences() {
    for name in ["zoo/box_stack", "zoo/balls_in_box"] {
        assert_exact(name, "Euler", 2e-6, 1e-7);
    }
}

/// Derivatives of another target, all matrices one after the other.
fn of(worlds: &mut Worlds, target: &Target<'_>, scheme: &Scheme) -> Vec<f64> {
    let arrays = target.arrays(worlds.model(), false);
    let (count, matrices) = (worlds.nworld(), arrays.len() - 3);
    let size = |dims: &[usize]| count * dims.iter().product::<usize>();
    let mut found: Vec<Vec<f64>> = arrays.iter().map(|(_, dims, _)| vec![0.0; size(dims)]).collect();
    let rows = found.iter_mut().map(|rows| Rows::F64(rows)).collect();
    worlds.derivatives_into(target, scheme, Solving::Accurate, rows, Follow::default()).expect("derivatives");
    found.truncate(matrices);
    found.concat()
}

#[test]
fn parameters_of_a_world_count() {
    for name in ["zoo/ant", "zoo/hopper"] {
        let model = accurate(&load_with(name, &[("integrator", "Euler")])).expect("a model");
        let mut worlds = moving(&model, 3, 0.5, &options(Precision::F64, Backend::Native));
        let same = worlds.transition(&EXACT).expect("derivatives");
        for parameter in [Parameter::BodyMass, Parameter::DofDamping, Parameter::GeomFriction] {
            let own: Vec<f64> = parameter.of(&model).iter().map(|x| 1.2 * x).collect();
            worlds.set_parameter(parameter, 1, &own).expect("a parameter");
        }
        let found = worlds.transition(&EXACT).expect("derivatives");
        let (worst, part) = error(&found, &extrapolated(&mut worlds, 1e-7), 3);
        assert!(worst < 2e-6 && part > 0.9, "{name}: {worst:e} of {part}");
        let width = found.a.len() / 3;
        assert_eq!(found.a[..width], same.a[..width], "{name}: the others are as they were");
        assert_ne!(found.a[width..2 * width], same.a[width..2 * width], "{name}");
    }
}

#[test]
fn accelerations_and_inverse_dynamics_have_the_limit_of_differences() {
    for name in ["zoo/ant", "zoo/arm", "zoo/four_bar", "unit/activation"] {
        let model = accurate(&load_with(name, &[("integrator", "Euler")])).expect("a model");
        let mut worlds = moving(&model, 3, 0.5, &options(Precision::F64, Backend::Native));
        let nv = model.tables().sizes.nv;
        let qacc: Vec<f64> = (0..3 * nv).map(|i| (i as f64 * 0.7).sin()).collect();
        let inverse = Target::Inverse(Strided { values: Values::F64(&qacc), offset: 0, stride: nv });
        for target in [Target::Acceleration, inverse] {
            let found = of(&mut worlds, &target, &EXACT);
            let expected = of(&mut worlds, &target, &Scheme { eps: 1e-7, ..Scheme::default() });
            let size = expected.iter().fold(1.0f64, |most, x| most.max(x.abs()));
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-6 * size, "{name} {target:?}: {found} {expected}, of {size}");
            }
        }
    }
}

#[test]
fn a_pendulum_has_the_derivative_of_its_formula() {
    let xml = "<mujoco><option timestep='.01' gravity='0 0 -10'/><worldbody><body><joint axis='0 1 0' armature='0'/>
        <inertial pos='0 0 -.5' mass='2' diaginertia='.1 .1 .1'/></body></worldbody></mujoco>";
    let model = Model::from_xml_string(xml, &Default::default()).expect("a model");
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("a batch");
    worlds.set(Field::Qpos, 0, &[0.7]).expect("a world");
    let found = worlds.transition(&EXACT).expect("derivatives");
    // (.1 + m l²) a = -m g l sin q
    let (h, slope) = (0.01, -10.0 * 0.7f64.cos() / 0.6);
    for (x, expected) in found.a.iter().zip([1.0 + h * h * slope, h, h * slope, 1.0]) {
        assert!((x - expected).abs() < 1e-14, "{x} {expected}");
    }
}

#[test]
fn a_ball_at_its_springs_rest_has_the_springs_stiffness() {
    let xml = "<mujoco><option timestep='.01' gravity='0 0 0'/><worldbody><body><joint type='ball' stiffness='3'/>
        <inertial pos='0 0 0' mass='2' diaginertia='.1 .2 .3'/></body></worldbody></mujoco>";
    let model = Model::from_xml_string(xml, &Default::default()).expect("a model");
    let found = Worlds::new(&model, 1, &Options::default()).expect("a batch").transition(&EXACT).expect("derivatives");
    for (i, inertia) in [0.1, 0.2, 0.3].into_iter().enumerate() {
        let slope = found.a[6 * (3 + i) + i];
        assert!((slope + 0.01 * 3.0 / inertia).abs() < 1e-14, "{slope}");
    }
}

#[test]
fn the_same_bits_whatever_is_beside() {
    for name in ["zoo/ant", "zoo/four_bar", "zoo/box_stack"] {
        let model = accurate(&load_with(name, &[("integrator", "implicitfast")])).expect("a model");
        let choose = |backend, threads| Options { threads: Some(threads), ..options(Precision::F64, backend) };
        let mut worlds = moving(&model, 11, 0.5, &choose(Backend::Native, 2));
        let all = worlds.transition(&EXACT).expect("derivatives");
        for (id, backend) in [(0, Backend::Scalar), (6, Backend::Wide), (10, Backend::Native)] {
            let mut alone = Worlds::new(&model, 1, &choose(backend, 1)).expect("a batch");
            for (field, _) in Field::ALL {
                alone.set(field, 0, &worlds.get(field, id).expect("a field")).expect("a world");
            }
            let found = alone.transition(&EXACT).expect("derivatives");
            let part = all.a.len() / 11;
            for (x, expected) in found.a.iter().zip(&all.a[part * id..]) {
                assert_eq!(x.to_bits(), expected.to_bits(), "{name} {backend:?}: {x} {expected}");
            }
        }
    }
}

#[test]
fn a_contact_that_only_just_touches_is_at_an_edge() {
    let xml = "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 .1'><freejoint/><geom size='.1'/></body></worldbody></mujoco>";
    let model = accurate(&Model::from_xml_string(xml, &Default::default()).expect("a model")).expect("a model");
    let mut worlds = Worlds::new(&model, 2, &Options::default()).expect("a batch");
    let place = |worlds: &mut Worlds, world: usize, speed: f64| {
        worlds.set(Field::Qpos, world, &[0.0, 0.0, 0.099, 1.0, 0.0, 0.0, 0.0]).expect("a world");
        worlds.set(Field::Qvel, world, &[0.0, 0.0, speed, 0.0, 0.0, 0.0]).expect("a world");
    };
    // How fast it must leave for nothing to push: the push is linear in the speed below that.
    let push = |speed: f64| {
        let mut alone = Worlds::new(&model, 1, &Options::default()).expect("a batch");
        place(&mut alone, 0, speed);
        alone.rollout(&Rollout { nstep: 1, ..Rollout::default() }).expect("a step");
        (alone.get(Field::Qvel, 0).expect("a field")[2] - speed) / 0.002 + 9.81
    };
    let [first, second] = [push(0.0), push(0.001)];
    place(&mut worlds, 0, 0.001 * first / (first - second));
    place(&mut worlds, 1, 0.0);
    let found = worlds.transition(&EXACT).expect("derivatives");
    let columns = found.changed.len() / 2;
    assert!(found.changed[0] >= 1.0, "an edge where nothing pushes any more");
    assert_eq!(found.changed[columns], 0.0, "no edge where it pushes");
    assert!(found.sides.iter().all(|side| *side == 0.0));
}

#[test]
fn what_has_no_exact_derivatives_says_so() {
    let refused = |name: &str, integrator: &str, scheme: Scheme, precision| {
        let model = load_with(name, &[("integrator", integrator)]);
        let mut worlds = Worlds::new(&model, 1, &options(precision, Backend::Native)).expect("a batch");
        worlds.transition(&scheme)
    };
    let double = Precision::F64;
    fails(
        refused("zoo/ant", "RK4", EXACT, double),
        "Runge-Kutta steps have no exact derivatives yet: take them by differences",
    );
    fails(refused("zoo/ant", "midpoint", EXACT, double), "midpoint steps have no exact derivatives yet");
    let model = load_with("zoo/ant", &[("integrator", "implicitfast"), ("invdiscrete", "enable")]);
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("a batch");
    let qacc = vec![0.0; model.tables().sizes.nv];
    let target = Target::Inverse(Strided { values: Values::F64(&qacc), offset: 0, stride: qacc.len() });
    let found = worlds.derivatives_into(&target, &EXACT, Solving::Accurate, vec![], Follow::default());
    fails(found, "inverse dynamics of implicit steps (invdiscrete) have no exact derivatives yet");
    fails(refused("zoo/ant", "Euler", EXACT, Precision::F32), "exact derivatives are of double precision");
    fails(
        refused("zoo/ant", "Euler", Scheme { sensors: true, ..EXACT }, double),
        "sensors have no exact derivatives yet",
    );
}
