//! The project's kernels, recorded and compiled, give the bits that they give over `wide` lanes, but for signs of zeros.

mod support;

use std::path::Path;

use lanesim::Model;
use lanesim::mjcf::LoadOptions;
use lanesim_codegen::{FieldSlice, Float, Fragment, Program, Recorder, Recording, Scratch};
use lanesim_kernels::acceleration::{self, Acceleration};
use lanesim_kernels::actuation::{self, Actuation};
use lanesim_kernels::fields::FieldView;
use lanesim_kernels::inertia::{self, Inertia};
use lanesim_kernels::integration::{self, Integration};
use lanesim_kernels::lane::{Lane, LaneQuery, Real};
use lanesim_kernels::model::{Cast, Model as Tables};
use lanesim_kernels::passive::{self, Passive};
use lanesim_kernels::position::{self, Position};
use lanesim_kernels::state::State;
use lanesim_kernels::tendon::{self, Tendons};
use lanesim_kernels::velocity::{self, Velocity};
use support::{Random, assert_same, instruction_sets};

/// What a step computes where nothing is in contact.
struct Stages<L: Lane> {
    position: Position<L>,
    tendons: Tendons<L>,
    inertia: Inertia<L>,
    velocity: Velocity<L>,
    passive: Passive<L>,
    actuation: Actuation<L>,
    acceleration: Acceleration<L>,
    integration: Integration<L>,
}

/// A field, with the name of its stage and its own.
type Named<L> = (String, Vec<L>);

impl<L: Lane> Stages<L> {
    /// The step, from positions, velocities and controls; returns the lanes with a singular inertia, and with bad controls.
    fn run(model: &Tables<L::Real>, [qpos, qvel, ctrl]: [&[L]; 3]) -> (Self, [L::Mask; 2]) {
        let sizes = &model.sizes;
        let mut s = Stages {
            position: Position::new(sizes),
            tendons: Tendons::new(sizes),
            inertia: Inertia::new(sizes),
            velocity: Velocity::new(sizes),
            passive: Passive::new(sizes),
            actuation: Actuation::new(sizes),
            acceleration: Acceleration::new(sizes),
            integration: Integration::new(sizes),
        };
        position::kinematics(model.into(), qpos.into(), &mut s.position);
        tendon::tendons(model, &s.position, qpos, qvel, &mut s.tendons);
        inertia::crb(model.into(), &s.position, &s.tendons, &mut s.inertia);
        velocity::rne(model.into(), (&s.position, &s.tendons, &s.inertia), qvel, &mut s.velocity);
        let moving = passive::Stages { position: &s.position, tendons: &s.tendons, velocity: &s.velocity };
        let (qpos, qvel, ctrl) = (qpos.to_vec(), qvel.to_vec(), ctrl.to_vec());
        let state = State { qpos, qvel, ctrl, ..State::new(sizes) };
        passive::passive(model.into(), moving, &state, &mut s.passive);
        let State { qvel, .. } = &state;
        let bad = actuation::actuation(model.into(), &state, (&s.position, &s.tendons, &s.passive), &mut s.actuation);
        let a = &mut s.acceleration;
        acceleration::smooth_force(model, &s.position, &s.velocity, &s.passive, &s.actuation, None, a);
        let singular = acceleration::smooth_acceleration(model.into(), (&s.position, &s.tendons, &s.inertia), None, a);
        let forces = [&a.qfrc_smooth[..], &vec![L::zero(); sizes.nv]];
        integration::euler(
            model.into(),
            (&s.position, &s.inertia),
            state.positions(),
            qvel,
            &a.qacc_smooth,
            forces,
            &mut s.integration,
        );
        (s, [singular, bad])
    }

    /// The next state, or every field of every stage.
    fn fields(mut self, every: bool) -> Vec<Named<L>> {
        let mut all = vec![];
        let mut add = |stage: &str, f: FieldView<'_, L>| all.push((format!("{stage}.{}", f.name), f.data.to_vec()));
        if !every {
            self.integration.for_each(&mut |f| add("integration", f));
            all.retain(|(name, _)| ["integration.qpos", "integration.qvel"].contains(&name.as_str()));
            return all;
        }
        self.position.for_each(&mut |f| add("position", f));
        self.inertia.for_each(&mut |f| add("inertia", f));
        self.velocity.for_each(&mut |f| add("velocity", f));
        self.passive.for_each(&mut |f| add("passive", f));
        self.actuation.for_each(&mut |f| add("actuation", f));
        self.acceleration.for_each(&mut |f| add("acceleration", f));
        self.integration.for_each(&mut |f| add("integration", f));
        all
    }
}

/// The step as a program: positions, velocities and controls are fields 0 to 2, then come the outputs.
fn record<T: Float>(model: &Tables<T>, every: bool) -> Program<T> {
    let mut recording = Recording::<T>::new();
    let sizes = &model.sizes;
    let [qpos, qvel, ctrl] = [(0, sizes.nq), (1, sizes.nv), (2, sizes.nu)].map(|(i, n)| recording.input(i, n));
    let (stages, masks) = Stages::<Recorder<T>>::run(model, [&qpos, &qvel, &ctrl]);
    for (i, (_, field)) in stages.fields(every).iter().enumerate() {
        recording.output(3 + i, field);
    }
    for mask in masks {
        recording.mask_output(mask);
    }
    recording.finish()
}

/// Random positions, velocities and controls of a block.
fn inputs<L: LaneQuery>(model: &Tables<L::Real>, random: &mut Random) -> [Vec<L>; 3] {
    let mut lane = |centre: f64, spread: f64| {
        let mut lane = L::zero();
        (0..L::WIDTH).for_each(|i| lane.set(i, L::Real::from_f64(centre + random.uniform(-spread, spread))));
        lane
    };
    let qpos = model.qpos0.iter().map(|q| lane(q.to_f64(), 0.5)).collect();
    let qvel = (0..model.sizes.nv).map(|_| lane(0.0, 2.0)).collect();
    let ctrl = (0..model.sizes.nu).map(|_| lane(0.0, 1.0)).collect();
    [qpos, qvel, ctrl]
}

/// Fields and masks that the code leaves.
fn run<T: Float>(fragment: &Fragment<T>, inputs: &[Vec<T::Block>; 3]) -> (Vec<Vec<T::Block>>, [u32; 2]) {
    let garbage = T::Block::of(7.0);
    let mut outputs: Vec<_> = fragment.fields()[3..].iter().map(|field| vec![garbage; field.len]).collect();
    let mut fields: Vec<FieldSlice<'_, T>> = inputs.iter().map(|x| FieldSlice::read(x)).collect();
    fields.extend(outputs.iter_mut().map(|x| FieldSlice::write(x)));
    let mut masks = [0; 2];
    fragment.run(&mut Scratch::new(), &mut fields, &[], &mut masks);
    (outputs, masks)
}

fn check<T: Float>(name: &str, model: &Tables<T>) {
    let mut inputs = inputs::<T::Block>(model, &mut Random::new(5));
    if let Some(ctrl) = inputs[2].first_mut() {
        ctrl.set(1, T::from_f64(f64::NAN));
    }
    for every in [true, false] {
        let program = record(model, every);
        let (stages, masks) = Stages::run(model, inputs.each_ref().map(Vec::as_slice));
        let expected = stages.fields(every);
        for isa in instruction_sets() {
            let (got, got_masks) = run(&program.compile(isa).unwrap(), &inputs);
            assert_eq!(got.len(), expected.len());
            for (got, (field, expected)) in got.iter().zip(&expected) {
                assert_same(&format!("{name} {} {:?} {field}", isa.name(), T::PRECISION), got, expected);
            }
            assert_eq!(got_masks, masks.map(T::Block::bits), "{name}: masks");
        }
    }
}

/// Checks a model of the repository in both precisions.
fn check_model(name: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../models/zoo/{name}.xml"));
    let model = Model::from_xml_path(&path, &LoadOptions::default()).unwrap();
    check::<f64>(name, model.tables());
    check::<f32>(name, &model.tables().cast());
}

#[test]
fn humanoids() {
    ["humanoid18", "humanoid27", "humanoid29"].into_iter().for_each(check_model);
}

#[test]
fn chains_and_hands() {
    ["chain31", "hand32", "arm", "pendulums", "cartpole"].into_iter().for_each(check_model);
}

#[test]
fn many_trees() {
    ["isolated34", "balls_in_box", "box_stack"].into_iter().for_each(check_model);
}

#[test]
fn runners() {
    ["ant", "cheetah", "hopper", "quadruped", "walker"].into_iter().for_each(check_model);
}
