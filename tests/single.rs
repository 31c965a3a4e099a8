//! Single precision keeps what matters: time, small steps far from zero, small bodies, what stands. Arithmetic that is exact,
//! mechanics and double precision say what is right.

use crate::support::{load, options, parse};
use lanesim::{Backend, Field, Model, Precision, Worlds};

const BACKENDS: [Backend; 3] = [Backend::Auto, Backend::Wide, Backend::Scalar];
const INTEGRATORS: [&str; 5] = ["Euler", "RK4", "implicit", "implicitfast", "discrete"];

fn worlds(model: &Model, precision: Precision) -> Worlds {
    Worlds::new(model, 1, &options(precision, Backend::Auto)).expect("a batch")
}

fn field(worlds: &Worlds, field: Field) -> Vec<f64> {
    worlds.get(field, 0).expect("a field")
}

/// Largest difference of two lists.
fn off(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// A sum of a million rounded steps would be 18 s late.
#[test]
fn time_of_a_million_steps_is_their_number_times_the_timestep() {
    let model = parse("<mujoco><worldbody><body><joint/><geom size='0.1'/></body></worldbody></mujoco>");
    let mut single = worlds(&model, Precision::F32);
    let mut worst = 0.0_f64;
    for thousands in 1..=1000 {
        single.step(1000).expect("steps");
        let (time, exact) = (field(&single, Field::Time)[0], 2.0 * f64::from(thousands));
        assert_eq!(time as f32, exact as f32, "after {thousands} thousand steps");
        worst = worst.max((time - exact).abs());
    }
    println!("off by {worst:.1e} s at most");
    assert!(worst < 1e-6, "{worst:e}");
    let mut double = worlds(&model, Precision::F64);
    double.step(1_000_000).expect("steps");
    let sum = (0..1_000_000).fold(0.0, |sum, _| sum + 0.002);
    assert_eq!(field(&double, Field::Time)[0], sum, "as the reference has it");
}

/// A time that is set counts, whole or as part of a state, and so do keyframes and resets.
#[test]
fn time_goes_on_from_where_it_is_set() {
    for integrator in INTEGRATORS {
        let model = parse(&format!(
            "<mujoco><option integrator='{integrator}'/><worldbody><body><joint/><geom size='0.1'/></body></worldbody>
             <keyframe><key time='1000.3'/></keyframe></mujoco>"
        ));
        let mut single = worlds(&model, Precision::F32);
        let check = |single: &mut Worlds, start: f64| {
            single.step(3333).expect("steps");
            let (time, exact) = (field(single, Field::Time)[0], start + 0.002 * 3333.0);
            assert!((time - exact).abs() < 1e-8, "{integrator}: {time} instead of {exact}");
        };
        check(&mut single, 0.0);
        single.set(Field::Time, 0, &[500.1]).expect("a time");
        check(&mut single, 500.1);
        single.reset(0, Some(0)).expect("a reset");
        check(&mut single, 1000.3);
        single.reset(0, None).expect("a reset");
        assert_eq!(field(&single, Field::Time), [0.0]);
    }
}

/// A state that is taken from a world is the same state in another: both go on with the same bits.
#[test]
fn states_that_are_set_again_keep_what_is_beyond_single_precision() {
    let model = load("zoo/quadruped");
    let mut first = worlds(&model, Precision::F32);
    first.set(Field::Qpos, 0, &at(&model, 1000.3)).expect("positions");
    let mut second = worlds(&model, Precision::F32);
    for _ in 0..20 {
        first.step(25).expect("steps");
        for field in [Field::Time, Field::Qpos, Field::Qvel, Field::Act, Field::Ctrl, Field::QaccWarmstart] {
            second.set(field, 0, &first.get(field, 0).expect("a field")).expect("a field");
        }
        assert_eq!(first.state_hash(), second.state_hash());
        [&mut first, &mut second].into_iter().for_each(|worlds| worlds.step(25).expect("steps"));
        assert_eq!(first.state_hash(), second.state_hash());
    }
}

/// Positions of a model's first keyframe, moved along x.
fn at(model: &Model, x: f64) -> Vec<f64> {
    let mut qpos = model.keys()[0].qpos.clone();
    qpos[0] += x;
    qpos
}

/// At 100 m, a step at 1 mm/s is a quarter of the last digit of single precision.
#[test]
fn slow_motion_far_from_the_origin_moves() {
    for integrator in INTEGRATORS {
        let model = parse(&format!(
            "<mujoco><option gravity='0 0 0' integrator='{integrator}'/><worldbody>
               <body pos='100 0 0'><freejoint/><geom size='0.1'/></body>
               <body pos='0 1 0'><joint type='slide'/><geom size='0.1'/></body></worldbody></mujoco>"
        ));
        let hashes = BACKENDS.map(|backend| {
            let mut worlds = Worlds::new(&model, 20, &options(Precision::F32, backend)).expect("a batch");
            for world in 0..20 {
                let mut qpos = worlds.get(Field::Qpos, world).expect("positions");
                qpos[7] = 100.0;
                worlds.set(Field::Qpos, world, &qpos).expect("positions");
                worlds.set(Field::Qvel, world, &[1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3]).expect("speeds");
            }
            worlds.step(500).expect("steps");
            let qpos = worlds.get(Field::Qpos, 19).expect("positions");
            for x in [qpos[0], qpos[7]] {
                assert!((x - 100.0 - 1e-3).abs() < 1e-6, "{integrator} {backend:?}: {x}");
            }
            worlds.state_hash()
        });
        assert!(hashes.iter().all(|hash| *hash == hashes[0]), "{integrator}: {hashes:x?}");
    }
}

/// A rotation of 20 nrad a step is beyond the digits of a quaternion.
#[test]
fn slow_rotation_turns() {
    for integrator in INTEGRATORS {
        let model = parse(&format!(
            "<mujoco><option gravity='0 0 0' integrator='{integrator}'/><worldbody>
               <body euler='10 20 30'><freejoint/><geom type='box' size='0.1 0.1 0.1'/></body></worldbody></mujoco>"
        ));
        let mut single = worlds(&model, Precision::F32);
        let start = field(&single, Field::Qpos);
        single.set(Field::Qvel, 0, &[0.0, 0.0, 0.0, 0.0, 0.0, 1e-5]).expect("speeds");
        single.step(5000).expect("steps");
        let end = field(&single, Field::Qpos);
        // The third component of start⁻¹ ∘ end.
        let sine = start[3] * end[6] - start[6] * end[3] - start[4] * end[5] + start[5] * end[4];
        let length = end[3..].iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((2.0 * sine - 1e-4).abs() < 1e-7, "{integrator}: {sine}");
        assert!((length - 1.0).abs() < 4.0 * f64::from(f32::EPSILON), "{integrator}: {length}");
    }
}

/// The boxes of the stack are where they are at x = 0, but for what single precision has there as well.
#[test]
fn a_stack_far_from_the_origin_stands_as_at_the_origin() {
    let stack = |x: f64| {
        let body = |z: f64, yaw: f64| {
            format!("<body pos='{x} 0 {z}' euler='0 0 {yaw}'><freejoint/><geom type='box' size='0.1 0.1 0.1'/></body>")
        };
        let bodies = [body(0.1, 10.0), body(0.3, 33.0), body(0.5, 60.0)].concat();
        let model =
            parse(&format!("<mujoco><worldbody><geom type='plane' size='5 5 1'/>{bodies}</worldbody></mujoco>"));
        let mut single = worlds(&model, Precision::F32);
        single.step(2500).expect("steps");
        assert!(!single.any_lost());
        let mut qpos = field(&single, Field::Qpos);
        (0..3).for_each(|body| qpos[7 * body] -= x);
        qpos
    };
    let near = stack(0.0);
    for (x, bound) in [(1.0, 1e-5), (100.0, 1e-5), (1e3, 1e-5), (1e4, 1e-4)] {
        let far = stack(x);
        let apart = (0..3).map(|body| off(&near[7 * body..][..3], &far[7 * body..][..3])).fold(0.0, f64::max);
        println!("at {x} m: {apart:.1e} m");
        assert!(apart < bound, "at {x} m: {apart:e}");
    }
}

/// A box of 2 mm and 1 mg turns, falls and rests as in double precision, and no pivot of it is called singular.
#[test]
fn a_box_of_a_milligram_moves_as_in_double_precision() {
    let text = |floor: &str, height: f64| {
        format!(
            "<mujoco><worldbody>{floor}<body pos='0 0 {height}'><freejoint/>
               <geom type='box' size='0.001 0.0015 0.0008' mass='1e-6'/></body></worldbody></mujoco>"
        )
    };
    let floor = "<geom type='plane' size='1 1 1'/>";
    for (name, text, spin, torque, steps) in [
        ("falls and turns", text("", 1.0), [3.0, -2.0, 5.0], 0.0, 100),
        ("is driven", text("", 1.0), [3.0, -2.0, 5.0], 1e-11, 100),
        ("rests", text(floor, 0.0008), [0.0; 3], 0.0, 500),
    ] {
        let model = parse(&text);
        let [double, single] = [Precision::F64, Precision::F32].map(|precision| {
            let mut worlds = worlds(&model, precision);
            worlds.set(Field::Qvel, 0, &[0.0, 0.0, 0.0, spin[0], spin[1], spin[2]]).expect("speeds");
            worlds.set(Field::QfrcApplied, 0, &[0.0, 0.0, 0.0, torque, -torque, torque]).expect("forces");
            worlds.step(steps).expect("steps");
            assert_eq!(worlds.status(0).expect("a world"), Default::default(), "{name}, {precision:?}");
            [field(&worlds, Field::Qpos), field(&worlds, Field::Qvel)]
        });
        let errors = [0, 1].map(|i| off(&double[i], &single[i]));
        println!("{name}: positions off by {:.1e}, velocities by {:.1e}", errors[0], errors[1]);
        assert!(errors.iter().all(|error| *error < 1e-4), "{name}: {errors:?}");
    }
}

/// What its servos hold stays where it stands.
#[test]
fn a_standing_quadruped_does_not_drift() {
    let model = load("zoo/quadruped");
    let mut single = worlds(&model, Precision::F32);
    single.reset(0, Some(0)).expect("a reset");
    single.step(5_000).expect("steps");
    let settled = field(&single, Field::Qpos);
    for _ in 0..4 {
        single.step(25_000).expect("steps");
        let now = field(&single, Field::Qpos);
        println!("{:.2e} m, {:.2e} in all", off(&settled[..3], &now[..3]), off(&settled, &now));
    }
    let drift = off(&settled[..3], &field(&single, Field::Qpos)[..3]);
    assert!(drift < 1e-5, "{drift:e} m in 1e5 steps");
}

/// What is welded so stiffly that double precision has to find its acceleration follows a mocap body where that is, not where it was at
/// first.
#[test]
fn stiff_welds_follow_mocap_bodies() {
    let model = parse(
        "<mujoco><option gravity='0 0 0'/><worldbody>
           <body name='hand' mocap='true' pos='0 0 1'><geom size='0.01' contype='0' conaffinity='0'/></body>
           <body name='held' pos='0 0 1'><freejoint/><geom type='box' size='0.1 0.05 0.02' contype='0' conaffinity='0'/></body>
         </worldbody><equality><weld body1='hand' body2='held' solref='0.01 1' solimp='0.999 0.9999'/></equality></mujoco>",
    );
    let [single, double] = [Precision::F32, Precision::F64].map(|precision| {
        let mut worlds = worlds(&model, precision);
        worlds.set(Field::MocapPos, 0, &[0.03, -0.02, 1.05]).expect("a place");
        worlds.set(Field::MocapQuat, 0, &[0.9987502603949663, 0.0, 0.04997916927067833, 0.0]).expect("a turn");
        worlds.step(1).expect("a step");
        field(&worlds, Field::Qvel)
    });
    let size = double.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    assert!(size > 0.1 && off(&single, &double) < 1e-4 * size, "{single:?} {double:?}");
}
