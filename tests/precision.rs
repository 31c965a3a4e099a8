//! Single precision where numbers are far apart: low friction, stiff contacts, small bodies. Double precision, MuJoCo's figures
//! and mechanics say what is right.

use crate::support::{Random, load, load_with, options, parse};
use lanesim::status::Status;
use lanesim::{Backend, Controls, Field, Model, Parameter, Precision, Rollout, Worlds};

const WORLDS: usize = 20;
const BACKENDS: [Backend; 3] = [Backend::Auto, Backend::Wide, Backend::Scalar];

/// Three boxes on a plane and on one another, with all friction that contacts can have. Lengths are exact in single precision:
/// rounding decides which of two aligned faces contacts belong to.
fn boxes(cone: &str, dim: u32, friction: f64) -> Model {
    parse(&format!(
        r#"<mujoco>
             <option timestep="0.004" gravity="0 0 -10" cone="{cone}"/>
             <default><geom type="box" size="0.125 0.125 0.125" condim="{dim}" friction="{friction} 0.005 0.0001"/></default>
             <worldbody>
               <geom type="plane" size="5 5 1"/>
               <body pos="0 0 0.125"><freejoint/><geom/></body>
               <body pos="0 0.001 0.375"><freejoint/><geom/></body>
               <body pos="0 0.002 0.625"><freejoint/><geom/></body>
             </worldbody>
           </mujoco>"#
    ))
}

fn worlds(model: &Model, precision: Precision, backend: Backend) -> Worlds {
    Worlds::new(model, WORLDS, &options(precision, backend)).expect("a batch")
}

/// No world has anything to say.
#[track_caller]
fn assert_sound(worlds: &Worlds, place: &str) {
    for world in 0..worlds.nworld() {
        let status = worlds.status(world).expect("a world");
        assert_eq!(status, Status::default(), "{place}: world {world}");
    }
}

/// Differences of velocities after a step from states of a rollout in double precision, ascending.
fn step_errors(model: &Model, friction: Option<f64>) -> Vec<f64> {
    let [mut exact, mut single] = [Precision::F64, Precision::F32].map(|precision| {
        let mut worlds = worlds(model, precision, Backend::Auto);
        if let Some(friction) = friction {
            rub(model, &mut worlds, |_| friction);
        }
        worlds
    });
    let mut random = Random(5);
    let nv = exact.get(Field::Qvel, 0).expect("speeds").len();
    for world in 0..WORLDS {
        let speeds: Vec<f64> = (0..nv).map(|_| random.uniform(-0.05, 0.05)).collect();
        exact.set(Field::Qvel, world, &speeds).expect("speeds");
    }
    let mut errors = Vec::new();
    for round in 0..12 {
        let controls = Controls::Noise { seed: round, scale: 0.3 };
        exact.rollout(&Rollout { nstep: 25, controls, ..Rollout::default() }).expect("a rollout");
        for world in 0..WORLDS {
            for field in [Field::Qpos, Field::Qvel, Field::Ctrl, Field::QaccWarmstart] {
                let numbers = exact.get(field, world).expect("a field");
                let rounded: Vec<f64> = numbers.iter().map(|x| f64::from(*x as f32)).collect();
                exact.set(field, world, &rounded).expect("a field");
                single.set(field, world, &rounded).expect("a field");
            }
        }
        exact.step(1).expect("a step");
        single.step(1).expect("a step");
        for world in 0..WORLDS {
            let [a, b] = [&exact, &single].map(|worlds| worlds.get(Field::Qvel, world).expect("speeds"));
            errors.push(a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max));
        }
    }
    assert_sound(&single, "a step");
    errors.sort_by(f64::total_cmp);
    errors
}

/// Sets the friction of every geom of a world.
fn rub(model: &Model, worlds: &mut Worlds, friction: impl Fn(usize) -> f64) {
    for world in 0..worlds.nworld() {
        let mut numbers = Parameter::GeomFriction.of(model).to_vec();
        numbers.iter_mut().step_by(3).for_each(|x| *x = friction(world));
        worlds.set_parameter(Parameter::GeomFriction, world, &numbers).expect("friction");
    }
}

/// A stack stays a stack, whatever its friction, and all backends leave the same bits.
#[test]
fn f32_low_friction_keeps_boxes_stacked() {
    for friction in [0.1, 0.02, 0.01, 1e-3, 1e-4, 1e-5, 0.0] {
        for (cone, dim) in [("pyramidal", 3), ("pyramidal", 4), ("pyramidal", 6), ("elliptic", 3), ("elliptic", 6)] {
            let (model, place) = (boxes(cone, dim, friction), format!("{cone} {dim} {friction}"));
            let hashes = BACKENDS.map(|backend| {
                let mut worlds = worlds(&model, Precision::F32, backend);
                worlds.step(200).expect("steps");
                assert_sound(&worlds, &place);
                for world in 0..WORLDS {
                    let qpos = worlds.get(Field::Qpos, world).expect("positions");
                    for (z, expected) in [qpos[2], qpos[9], qpos[16]].into_iter().zip([0.125, 0.375, 0.625]) {
                        assert!((z - expected).abs() < 1e-3, "{place}: {z} instead of {expected}");
                    }
                }
                worlds.state_hash()
            });
            assert!(hashes.iter().all(|hash| *hash == hashes[0]), "{place}: {hashes:x?}");
        }
    }
}

/// A step's velocities are those of double precision as nearly at low friction as at high. What rounding of the inputs moves
/// between contacts that hold the same body moves friction, and grows with it.
#[test]
fn f32_low_friction_is_exact() {
    for (name, model) in [("boxes", boxes("pyramidal", 3, 1.0))]
        .into_iter()
        .chain(["ant", "hopper", "humanoid18"].map(|name| (name, load_with(&format!("zoo/{name}"), &[]))))
    {
        for friction in [1.0, 0.1, 0.03, 0.02, 0.01, 3e-3, 1e-3, 1e-4, 1e-5] {
            let errors = step_errors(&model, Some(friction));
            let at = |part: f64| errors[((errors.len() - 1) as f64 * part) as usize];
            println!("{name} {friction}: median {:.1e}, 99 % {:.1e}, worst {:.1e}", at(0.5), at(0.99), at(1.0));
            assert!(at(0.5) < 5e-6, "{name} {friction}: median {:.1e}", at(0.5));
            assert!(at(0.99) < 1e-4, "{name} {friction}: 99th percentile {:.1e}", at(0.99));
        }
    }
}

/// Worlds with friction of their own, from usual to none, side by side: none is lost, backends agree, and each has the bits of
/// a world alone.
#[test]
fn f32_friction_zero_in_all_backends() {
    let model = load("zoo/ant");
    let friction = |world: usize| if world == 7 { 0.0 } else { 10.0_f64.powf(-0.35 * world as f64) };
    let run = |mut worlds: Worlds| {
        let controls = Controls::Noise { seed: 3, scale: 0.3 };
        worlds.rollout(&Rollout { nstep: 300, controls, ..Rollout::default() }).expect("a rollout");
        worlds
    };
    let all = BACKENDS.map(|backend| {
        let mut worlds = worlds(&model, Precision::F32, backend);
        rub(&model, &mut worlds, friction);
        run(worlds)
    });
    all.iter().for_each(|worlds| assert_sound(worlds, "ant"));
    assert!(all.iter().all(|worlds| worlds.state_hash() == all[0].state_hash()), "backends differ");
    // All with the friction of one: the same world among other neighbours.
    for world in [0, 7, 11] {
        let mut others = worlds(&model, Precision::F32, Backend::Wide);
        rub(&model, &mut others, |_| friction(world));
        let others = run(others);
        let [own, other] = [&all[1], &others].map(|worlds| worlds.get(Field::Qpos, world).expect("positions"));
        assert_eq!(own, other, "world {world}");
    }
}

/// Impedance near 1 is as stiff as low friction.
#[test]
fn f32_stiff_impedance_is_exact() {
    let text = |solimp: &str| {
        format!(
            r#"<mujoco><default><geom type="box" size="0.1 0.12 0.1" solimp="{solimp}"/></default><worldbody>
                 <geom type="plane" size="5 5 1"/><body pos="0 0 0.0999" euler="0 0 20"><freejoint/><geom/></body>
               </worldbody></mujoco>"#
        )
    };
    for solimp in ["0.9 0.95 0.001", "0.99 0.999 0.001", "0.999 0.9999 0.001"] {
        let errors = step_errors(&parse(&text(solimp)), None);
        let worst = errors[errors.len() - 1];
        println!("{solimp}: {worst:.1e}");
        assert!(worst < 1e-4, "{solimp}: {worst:.1e}");
    }
}

/// Bodies from 1 µg to 1 t, free and driven, turn as Newton and Euler say: steadily about an axis of inertia, and with a torque's
/// share. No pivot of theirs is small for its row.
#[test]
fn small_masses_turn_in_single_precision() {
    for (mass, half) in [(1e-9_f64, 2e-3_f64), (1e-6, 1e-3), (1e-3, 5e-3), (1.0, 0.05), (1e3, 0.5)] {
        let inertia = mass * 2.0 * half * half / 3.0;
        let torque = 10.0 * inertia;
        let model = parse(&format!(
            r#"<mujoco><option gravity="0 0 0"/><worldbody>
                 <body><freejoint/><geom type="box" size="{half} {half} {half}" mass="{mass}"/></body>
                 <body pos="3 0 0"><joint name="hinge" axis="0 0 1"/>
                   <geom type="box" size="{half} {half} {half}" mass="{mass}"/></body>
               </worldbody><actuator><motor joint="hinge" gear="{torque}"/></actuator></mujoco>"#
        ));
        for (precision, backend) in
            BACKENDS.map(|backend| (Precision::F32, backend)).into_iter().chain([(Precision::F64, Backend::Auto)])
        {
            let mut worlds = worlds(&model, precision, backend);
            for world in 0..WORLDS {
                worlds.set(Field::Qvel, world, &[0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0]).expect("speeds");
                worlds.set(Field::Ctrl, world, &[1.0]).expect("controls");
            }
            worlds.step(100).expect("steps");
            assert_sound(&worlds, &format!("{mass} kg, {precision:?} {backend:?}"));
            let qvel = worlds.get(Field::Qvel, 3).expect("speeds");
            // 10 rad/s² for 100 steps of 2 ms.
            for (found, expected) in qvel.iter().zip([0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 2.0]) {
                let close = (found - expected).abs() < 1e-5;
                assert!(close, "{mass} kg, {precision:?} {backend:?}: {qvel:?}");
            }
        }
    }
}

/// The same of a chain long enough to be accelerated without the inertia matrix.
#[test]
fn small_masses_hang_in_single_precision() {
    for (mass, length) in [(1e-6_f64, 4e-3_f64), (1e-3, 0.02), (1.0, 0.2), (1e3, 1.0)] {
        let radius = 0.3 * length;
        let link = format!(
            r#"<body pos="0 0 -{length}"><joint axis="0 1 0"/>
               <geom type="capsule" fromto="0 0 0 0 0 -{length}" size="{radius}" mass="{mass}"/>"#
        );
        let text = format!(
            r#"<mujoco><option timestep="0.0005"><flag contact="disable"/></option><worldbody>{}{}</worldbody></mujoco>"#,
            link.repeat(24),
            "</body>".repeat(24)
        );
        let model = parse(&text);
        let speeds = [Precision::F64, Precision::F32].map(|precision| {
            let mut worlds = worlds(&model, precision, Backend::Auto);
            for world in 0..WORLDS {
                worlds.set(Field::Qpos, world, &[0.1; 24]).expect("positions");
            }
            worlds.step(1).expect("a step");
            assert_sound(&worlds, &format!("{mass} kg, {precision:?}"));
            worlds.get(Field::Qvel, 3).expect("speeds")
        });
        let largest = speeds[0].iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        for (exact, single) in speeds[0].iter().zip(&speeds[1]) {
            assert!((exact - single).abs() < 1e-3 * largest, "{mass} kg: {exact} {single}");
        }
    }
}

/// Small bodies touch: a box of a milligram lies on the floor.
#[test]
fn small_masses_rest_in_single_precision() {
    for (mass, half) in [(1e-6_f64, 1e-3_f64), (1e-3, 5e-3), (1e3, 0.5)] {
        let model = parse(&format!(
            r#"<mujoco><worldbody><geom type="plane" size="1 1 1"/>
                 <body pos="0 0 {half}"><freejoint/><geom type="box" size="{half} {half} {half}" mass="{mass}"/></body>
               </worldbody></mujoco>"#
        ));
        let heights = [Precision::F64, Precision::F32].map(|precision| {
            let mut worlds = worlds(&model, precision, Backend::Auto);
            worlds.step(500).expect("steps");
            assert_sound(&worlds, &format!("{mass} kg, {precision:?}"));
            let qpos = worlds.get(Field::Qpos, 3).expect("positions");
            assert!(qpos[3] > 0.9999, "{mass} kg, {precision:?}: {qpos:?}");
            qpos[2]
        });
        assert!((heights[0] - heights[1]).abs() < 1e-2 * half, "{mass} kg: {heights:?}");
    }
}
