//! What happens to a world stays in that world: bad states, policies, statuses, memory that nobody has.

use crate::support;
use crate::support::{load, load_with, options, parse};
use lanesim::outputs::Output;
use lanesim::status::{Element, Status};
use lanesim::{Backend, Controls, Error, Field, Model, OnDiverge, Options, Precision, Rollout, StatusEvent, Worlds};

/// Worlds of a batch: two full blocks and a half, in f64.
const WORLDS: usize = 20;
/// The world that is disturbed.
const VICTIM: usize = 10;
const POLICIES: [OnDiverge; 3] = [OnDiverge::Freeze, OnDiverge::Reset { key: None }, OnDiverge::Error];

fn batch(model: &Model, on_diverge: OnDiverge) -> Worlds {
    let options = Options { on_diverge, threads: Some(2), ..options(Precision::F64, Backend::Auto) };
    Worlds::new(model, WORLDS, &options).expect("a batch")
}

fn run(worlds: &mut Worlds, nstep: usize) -> Result<(), Error> {
    worlds
        .rollout(&Rollout { nstep, controls: Controls::Noise { seed: 5, scale: 1.0 }, ..Rollout::default() })
        .map(|_| ())
}

/// Bits of everything that a world keeps.
fn bits(worlds: &Worlds, world: usize) -> Vec<u64> {
    let fields = Field::ALL.iter().flat_map(|(field, _)| worlds.get(*field, world).expect("a field"));
    fields.map(f64::to_bits).collect()
}

fn detail(worlds: &Worlds, world: usize) -> Vec<StatusEvent> {
    worlds.status_detail(world).expect("a world")
}

#[test]
fn neighbours_of_a_bad_world_keep_their_bits() {
    let model = load("zoo/ant");
    let mut clean = batch(&model, OnDiverge::Freeze);
    run(&mut clean, 15).expect("a rollout");
    for policy in POLICIES {
        for (field, name) in Field::ALL {
            for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
                let mut worlds = batch(&model, policy);
                let values = vec![x; field.len(&model)];
                worlds.set_unchecked(field, VICTIM, &values).expect("a world");
                let result = run(&mut worlds, 15);
                assert!(policy == OnDiverge::Error || result.is_ok());
                for world in (0..WORLDS).filter(|world| *world != VICTIM) {
                    assert_eq!(bits(&worlds, world), bits(&clean, world), "{policy:?}: {x} in {name}, world {world}");
                    assert_eq!(worlds.status(world).expect("a world"), Status::default());
                }
            }
        }
    }
}

/// The longest of capsules, whose inertia single precision cannot tell from singular: the accelerations are not numbers, and
/// which of them code has folded away is no matter of the event.
#[test]
fn events_of_a_singular_inertia_are_those_of_every_backend() {
    let model = parse(
        "<mujoco><worldbody><geom type='plane' size='5 5 .1' pos='1 -2 .5' euler='15 -10 0'/>
        <body pos='1.1 -2 .8' euler='15 25 35'><freejoint/><geom type='capsule' size='.06 150000'/></body>
        </worldbody></mujoco>",
    );
    let of = |backend| {
        let mut worlds = Worlds::new(&model, 3, &options(Precision::F32, backend)).expect("a batch");
        worlds.step(2).expect("frozen worlds are no error");
        detail(&worlds, 1)
    };
    let expected = of(Backend::Scalar);
    assert_eq!(expected.iter().map(|event| event.element).collect::<Vec<_>>(), [Element::Dof(5); 3], "{expected:?}");
    for backend in [Backend::Native, Backend::Wide] {
        assert_eq!(of(backend), expected, "{backend:?}");
    }
}

#[test]
fn the_first_occurrence_is_kept_with_its_element() {
    let model = load("zoo/ant");
    let nv = Field::Qvel.len(&model);
    let mut worlds = batch(&model, OnDiverge::Freeze);
    run(&mut worlds, 7).expect("a rollout");
    let mut qvel = worlds.get(Field::Qvel, VICTIM).expect("a field");
    qvel[nv - 1] = f64::NAN;
    worlds.set_unchecked(Field::Qvel, VICTIM, &qvel).expect("a world");
    run(&mut worlds, 3).expect("a rollout");
    let events = detail(&worlds, VICTIM);
    assert_eq!(events.len(), 2, "{events:?}");
    assert_eq!((events[0].status, events[0].step), (Status::NON_FINITE_VEL, 7));
    assert_eq!(events[0].element, Element::Dof(nv as u32 - 1));
    let joint = model.names().joints.name(model.tables().joints.len() - 1);
    let text = events[0].to_string();
    assert!(text.starts_with("NonFiniteVel at step 7, dof 13 of joint 8") && text.contains(joint), "{text}");
    assert_eq!((events[1].status, worlds.lost()), (Status::FROZEN, 1));
    assert!(detail(&worlds, VICTIM + 1).is_empty());
    // Later steps add nothing, a reset clears everything.
    run(&mut worlds, 3).expect("a rollout");
    assert_eq!(detail(&worlds, VICTIM), events);
    worlds.reset(VICTIM, None).expect("a world");
    assert!(detail(&worlds, VICTIM).is_empty());
}

#[test]
fn a_bad_control_is_named() {
    let model = load("zoo/ant");
    let mut worlds = batch(&model, OnDiverge::Freeze);
    let mut ctrl = vec![0.5; 8];
    ctrl[3] = f64::NAN;
    worlds.set_unchecked(Field::Ctrl, VICTIM, &ctrl).expect("a world");
    let mut still = batch(&model, OnDiverge::Freeze);
    worlds.step(2).expect("steps");
    still.step(2).expect("steps");
    assert_eq!(worlds.get(Field::Qpos, VICTIM).expect("a field"), still.get(Field::Qpos, VICTIM).expect("a field"));
    let events = detail(&worlds, VICTIM);
    assert_eq!((events[0].status, events[0].element), (Status::BAD_CTRL, Element::Actuator(3)));
}

#[test]
fn quaternions_that_are_none_are_flagged() {
    let model = load("zoo/ant");
    for (scale, expected) in [(0.0, Some(Status::QUAT_ZERO)), (1.01, Some(Status::QUAT_FAR)), (1.0 + 1e-4, None)] {
        let mut worlds = batch(&model, OnDiverge::Freeze);
        let mut qpos = worlds.get(Field::Qpos, VICTIM).expect("a field");
        qpos[3..7].iter_mut().for_each(|x| *x *= scale);
        worlds.set(Field::Qpos, VICTIM, &qpos).expect("a state");
        worlds.step(2).expect("steps");
        let flags = detail(&worlds, VICTIM);
        assert_eq!(flags.first().map(|event| event.status), expected, "{scale}");
        assert!(flags.iter().all(|event| event.element == Element::Joint(0) && event.step == 0), "{flags:?}");
        assert_eq!(worlds.lost(), 0);
        let qpos = worlds.get(Field::Qpos, VICTIM).expect("a field");
        assert!((qpos[3..7].iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn an_overflow_of_contacts_names_a_pair() {
    let model = load("zoo/ant");
    let options = Options { max_contacts: 1, ..options(Precision::F64, Backend::Auto) };
    let mut worlds = Worlds::new(&model, 2, &options).expect("a batch");
    worlds.step(400).expect("steps");
    let events = detail(&worlds, 1);
    let overflow = events.iter().find(|event| event.status == Status::CONTACT_OVERFLOW).expect("an overflow");
    assert!(matches!(overflow.element, Element::Pair(_)) && overflow.place.contains("geom"), "{overflow}");
}

#[test]
fn a_diverged_world_starts_again_from_nothing() {
    let model = load("zoo/ant");
    let mut worlds = batch(&model, OnDiverge::Reset { key: None });
    for (field, _) in Field::ALL.iter().filter(|(field, _)| !matches!(field, Field::Qpos | Field::Qvel)) {
        let some: Vec<f64> = worlds.get(*field, VICTIM).expect("a field").iter().map(|x| x + 0.01).collect();
        worlds.set(*field, VICTIM, &some).expect("a state");
    }
    worlds.set_unchecked(Field::Qvel, VICTIM, &[f64::INFINITY; 14]).expect("a world");
    worlds.step(10).expect("steps");
    // What came from outside is looked at before the first step: all ten are those of a new world.
    let mut fresh = batch(&model, OnDiverge::Freeze);
    fresh.step(10).expect("steps");
    assert_eq!(bits(&worlds, VICTIM), bits(&fresh, 0));
    let status = worlds.status(VICTIM).expect("a world");
    assert_eq!((status.names(), worlds.lost()), (vec!["NonFiniteVel"], 0));
    assert_eq!(detail(&worlds, VICTIM).len(), 1);
}

#[test]
fn worlds_start_again_from_a_keyframe() {
    let model = parse(
        "<mujoco><worldbody><body><joint type='slide'/><geom size='.1'/></body></worldbody>\
         <keyframe><key time='2' qpos='3' qvel='4'/></keyframe></mujoco>",
    );
    let mut worlds = batch(&model, OnDiverge::Reset { key: Some(0) });
    worlds.set_unchecked(Field::Qpos, VICTIM, &[f64::NAN]).expect("a world");
    worlds.step(1).expect("steps");
    let mut fresh = batch(&model, OnDiverge::Freeze);
    fresh.reset_all(None, Some(0)).expect("a keyframe");
    fresh.step(1).expect("steps");
    assert_eq!(bits(&worlds, VICTIM), bits(&fresh, VICTIM));
    assert!(worlds.get(Field::Time, VICTIM).expect("a field")[0] > 2.0);
    let missing = Options { on_diverge: OnDiverge::Reset { key: Some(1) }, ..Options::default() };
    assert!(matches!(Worlds::new(&model, 1, &missing), Err(Error::Unknown(_))));
}

#[test]
fn an_error_names_the_first_world() {
    let model = load("zoo/ant");
    let mut worlds = batch(&model, OnDiverge::Error);
    for world in [VICTIM + 5, VICTIM] {
        worlds.set_unchecked(Field::Qvel, world, &[1e300; 14]).expect("a world");
    }
    let error = run(&mut worlds, 15).expect_err("two worlds diverge");
    let text = error.to_string();
    assert!(text.starts_with("world 10 diverged: ") && text.contains(" at step 0, dof 0 of joint 0"), "{text}");
    let Error::Diverged { world, event } = error else { panic!("another error") };
    assert_eq!((world, event.step), (VICTIM, 0));
    // Until it is reset.
    assert!(run(&mut worlds, 1).is_err());
    for world in [VICTIM + 5, VICTIM] {
        worlds.reset(world, None).expect("a world");
    }
    run(&mut worlds, 5).expect("all worlds are good");
}

#[test]
fn frozen_worlds_are_the_same_in_any_company() {
    let model = load("zoo/ant");
    let names = ["qpos", "xpos", "qM", "ncon", "actuator_force", "status"];
    let outputs = names.map(|name| Output::named(name).expect("an output"));
    let record = |victims: &[usize], outputs: &[Output]| {
        let mut worlds = batch(&model, OnDiverge::Freeze);
        for world in victims {
            worlds.set(Field::Qvel, *world, &[1e12; 14]).expect("a state");
        }
        let run =
            Rollout { nstep: 4, controls: Controls::Noise { seed: 2, scale: 1.0 }, outputs, ..Rollout::default() };
        let result = worlds.rollout(&run).expect("a rollout");
        assert_eq!(worlds.lost(), victims.len());
        let share = |all: &Vec<f64>| -> Vec<u64> {
            let row = &all[VICTIM * all.len() / WORLDS..(VICTIM + 1) * all.len() / WORLDS];
            row.iter().map(|x| x.to_bits()).collect()
        };
        (result.outputs.iter().map(share).collect::<Vec<_>>(), bits(&worlds, VICTIM))
    };
    let everyone: Vec<usize> = (0..WORLDS).collect();
    let alone = record(&[VICTIM], &outputs);
    assert_eq!(record(&everyone, &outputs), alone);
    // Its state stays; of what follows from it nothing is said, and its status says why.
    let [qpos, xpos, qm, ncon, force, status] = &alone.0[..] else { panic!("six outputs") };
    assert!(qpos.iter().all(|x| f64::from_bits(*x).is_finite()));
    assert!([xpos, qm, force].into_iter().flatten().all(|x| f64::from_bits(*x).is_nan()));
    assert!(ncon.iter().all(|x| *x == 0));
    let expected = f64::from(Status::HUGE_VALUE.0 | Status::FROZEN.0).to_bits();
    assert!(status.iter().all(|x| *x == expected));
    // Without derived outputs the block is passed over.
    let (recorded, state) = record(&everyone, &outputs[..1]);
    assert_eq!((&recorded[0], state), (&alone.0[0], alone.1));
}

#[test]
fn memory_that_nobody_has_is_an_error() {
    let model = load("zoo/ant");
    for nworld in [1 << 42, usize::MAX / 2, usize::MAX] {
        for precision in [Precision::F64, Precision::F32] {
            let error = Worlds::new(&model, nworld, &options(precision, Backend::Auto)).err().expect("no memory");
            assert!(matches!(error, Error::Memory { .. }), "{error}");
            assert!(error.to_string().contains("the worlds would take"), "{error}");
        }
    }
    let outputs = [Output::named("qpos").expect("an output")];
    let mut worlds = Worlds::new(&model, 3, &Options::default()).expect("a batch");
    for nstep in [1 << 44, usize::MAX] {
        let error = worlds.rollout(&Rollout { nstep, outputs: &outputs, ..Rollout::default() }).expect_err("no memory");
        assert!(matches!(error, Error::Memory { .. }), "{error}");
        let controls = Controls::Given(&[0.0; 24]);
        assert!(worlds.rollout(&Rollout { nstep, controls, ..Rollout::default() }).is_err());
    }
    worlds.step(1).expect("the batch is as good as before");
}

#[test]
fn residuals_say_how_well_a_solver_has_done() {
    let residual = [Output::named("solver_residual").expect("an output")];
    for (solver, tolerance, bound) in [("Newton", "1e-10", 1e-10), ("CG", "1e-9", 1e-9), ("PGS", "1e-14", 1e-4)] {
        let model = load_with("zoo/ant", &[("solver", solver), ("tolerance", tolerance), ("iterations", "2000")]);
        let mut worlds = Worlds::new(&model, 9, &options(Precision::F64, Backend::Auto)).expect("a batch");
        let controls = Controls::Noise { seed: 1, scale: 1.0 };
        let run = Rollout { nstep: 120, controls, outputs: &residual, statistics: true, ..Rollout::default() };
        let result = worlds.rollout(&run).expect("a rollout");
        let (most, statistics) = (support::largest(&result.outputs[0]), result.statistics);
        assert!(most > 0.0 && most <= bound, "{solver}: {most}");
        assert_eq!(most, statistics.largest_residual);
        assert!(statistics.most_iterations >= 1.0 && statistics.residuals > 0.0);
    }
}
