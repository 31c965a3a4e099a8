//! The project's kernels, recorded and compiled, give the bits that they give over `wide` lanes, but for signs of zeros.

mod support;

use std::path::Path;

use lanesim::Model;
use lanesim::mjcf::LoadOptions;
use lanesim_codegen::{FieldSlice, Float, Fragment, Program, Recorder, Recording, Scratch};
use lanesim_kernels::inertia::{self, Inertia};
use lanesim_kernels::lane::{Lane, LaneQuery, Real};
use lanesim_kernels::math::ldl;
use lanesim_kernels::model::{Cast, Model as Tables};
use lanesim_kernels::position::{Position, kinematics};
use lanesim_kernels::velocity::{Velocity, rne};
use support::{Random, assert_same, instruction_sets};

/// What smooth dynamics computes.
struct Smooth<L: Lane> {
    position: Position<L>,
    inertia: Inertia<L>,
    velocity: Velocity<L>,
    inverse: Vec<L>,
    qacc: Vec<L>,
    singular: L::Mask,
}

impl<L: Lane> Smooth<L> {
    fn new(model: &Tables<L::Real>) -> Self {
        let sizes = &model.sizes;
        Smooth {
            position: Position::new(sizes),
            inertia: Inertia::new(sizes),
            velocity: Velocity::new(sizes),
            inverse: vec![L::zero(); sizes.nv],
            qacc: vec![L::zero(); sizes.nv],
            singular: L::zero().lt(L::zero()),
        }
    }

    /// M qacc = force - bias, with the factor in place of M.
    fn run(&mut self, model: &Tables<L::Real>, qpos: &[L], qvel: &[L], force: &[L]) {
        kinematics(model, qpos, &mut self.position);
        inertia::crb(model, &self.position, &mut self.inertia);
        rne(model, &self.position, &self.inertia, qvel, &mut self.velocity);
        let mut multipliers = vec![L::zero(); model.sizes.nv];
        let (rows, pattern) = (&model.rows, &model.tree_pattern);
        self.singular = ldl::factor(rows, pattern, &mut self.inertia.m, &mut self.inverse, &mut multipliers);
        for (x, (f, bias)) in self.qacc.iter_mut().zip(force.iter().zip(&self.velocity.qfrc_bias)) {
            *x = *f - *bias;
        }
        ldl::solve(rows, pattern, &self.inertia.m, &self.inverse, &mut self.qacc);
    }

    /// The fields, all of them or the acceleration only.
    fn fields(&self, all: bool) -> Vec<Vec<L>> {
        if !all {
            return vec![self.qacc.clone()];
        }
        vec![
            self.qacc.clone(),
            self.position.pos.as_flattened().to_vec(),
            self.position.rot.as_flattened().to_vec(),
            self.position.cdof.as_flattened().to_vec(),
            self.inertia.composite.as_flattened().to_vec(),
            self.inertia.m.clone(),
            self.velocity.qfrc_bias.clone(),
            self.inverse.clone(),
        ]
    }
}

/// Smooth dynamics as a program: positions, velocities and forces are fields 0 to 2, then come the outputs.
fn record<T: Float>(model: &Tables<T>, all: bool) -> Program<T> {
    let mut recording = Recording::<T>::new();
    let qpos = recording.input(0, model.sizes.nq);
    let [qvel, force] = [1, 2].map(|field| recording.input(field, model.sizes.nv));
    let mut smooth = Smooth::<Recorder<T>>::new(model);
    smooth.run(model, &qpos, &qvel, &force);
    for (i, field) in smooth.fields(all).iter().enumerate() {
        recording.output(3 + i, field);
    }
    recording.mask_output(smooth.singular);
    recording.finish()
}

/// Random positions, velocities and forces of a block.
fn inputs<L: LaneQuery>(model: &Tables<L::Real>, random: &mut Random) -> [Vec<L>; 3] {
    let mut lanes = |centre: &[L::Real], spread: f64| -> Vec<L> {
        centre
            .iter()
            .map(|c| {
                let mut lane = L::zero();
                (0..L::WIDTH)
                    .for_each(|i| lane.set(i, L::Real::from_f64(c.to_f64() + random.uniform(-spread, spread))));
                lane
            })
            .collect()
    };
    let zero = vec![L::Real::from_f64(0.0); model.sizes.nv];
    [lanes(&model.qpos0, 0.5), lanes(&zero, 2.0), lanes(&zero, 30.0)]
}

fn run<T: Float>(
    fragment: &Fragment<T>,
    scratch: &mut Scratch,
    inputs: &[Vec<T::Block>; 3],
    outputs: &mut [Vec<T::Block>],
) -> u32 {
    let mut fields: Vec<FieldSlice<'_, T>> = inputs.iter().map(|x| FieldSlice::read(x)).collect();
    fields.extend(outputs.iter_mut().map(|x| FieldSlice::write(x)));
    let mut singular = [0];
    fragment.run(scratch, &mut fields, &[], &mut singular);
    singular[0]
}

/// A model of the repository.
fn load(name: &str) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../models/zoo/{name}.xml"));
    Model::from_xml_path(&path, &LoadOptions::default()).unwrap()
}

fn check<T: Float>(name: &str, tables: &Tables<T>) {
    let mut random = Random::new(5);
    let inputs = inputs::<T::Block>(tables, &mut random);
    let mut expected = Smooth::<T::Block>::new(tables);
    expected.run(tables, &inputs[0], &inputs[1], &inputs[2]);
    for (isa, all) in instruction_sets().into_iter().flat_map(|isa| [(isa, true), (isa, false)]) {
        let program = record(tables, all);
        let fragment = program.compile(isa).unwrap();
        let mut got: Vec<Vec<T::Block>> =
            expected.fields(all).iter().map(|f| vec![T::Block::of(7.0); f.len()]).collect();
        let singular = run(&fragment, &mut Scratch::new(), &inputs, &mut got);
        let what = format!("{name} {} {:?} all {all}", isa.name(), T::PRECISION);
        assert_eq!(singular, T::Block::bits(expected.singular), "{what}: singular");
        for (i, (got, expected)) in got.iter().zip(&expected.fields(all)).enumerate() {
            assert_same(&format!("{what} field {i}"), got, expected);
        }
        let s = fragment.statistics();
        println!(
            "{what}: {} nodes, {} operations, {} instructions, {} spills, {} reloads, {} slots, {} bytes, {:?}, {:?}",
            program.nodes(),
            s.total_operations(),
            s.instructions,
            s.spills,
            s.reloads,
            s.slots,
            s.bytes,
            s.order,
            s.compile_time
        );
    }
}

#[test]
fn smooth_dynamics() {
    for name in [
        "humanoid18",
        "humanoid27",
        "humanoid29",
        "hand32",
        "chain31",
        "isolated34",
        "quadruped",
        "arm",
        "balls_in_box",
    ] {
        let model = load(name);
        check::<f64>(name, model.tables());
        check::<f32>(name, &model.tables().cast());
    }
}

#[test]
#[ignore = "a measurement"]
fn speed() {
    for name in ["humanoid18", "humanoid27", "hand32", "chain31", "isolated34"] {
        let model = load(name);
        measure::<f32>(name, &model.tables().cast());
        measure::<f64>(name, model.tables());
    }
}

fn measure<T: Float>(name: &str, tables: &Tables<T>) {
    let inputs = inputs::<T::Block>(tables, &mut Random::new(5));
    let time = |f: &mut dyn FnMut()| {
        let best = (0..100).map(|_| {
            let start = std::time::Instant::now();
            (0..100).for_each(|_| f());
            start.elapsed().as_secs_f64() / 100.0
        });
        best.fold(f64::MAX, f64::min) * 1e9 / T::Block::WIDTH as f64
    };
    let mut wide = Smooth::<T::Block>::new(tables);
    let ns = time(&mut || wide.run(tables, &inputs[0], &inputs[1], &inputs[2]));
    println!("{name} {:?} wide: {ns:.1} ns/world", T::PRECISION);
    for isa in instruction_sets() {
        let program = record(tables, false);
        let fragment = program.compile(isa).unwrap();
        let mut out = vec![T::Block::zero(); tables.sizes.nv];
        let mut scratch = Scratch::new();
        let mut fields: Vec<FieldSlice<'_, T>> = inputs.iter().map(|x| FieldSlice::read(x)).collect();
        fields.push(FieldSlice::write(&mut out));
        let mut singular = [0];
        let ns = time(&mut || fragment.run(&mut scratch, &mut fields, &[], &mut singular));
        let compile = (0..20).map(|_| program.compile(isa).unwrap().statistics().compile_time).min().unwrap();
        let s = fragment.statistics();
        let operations = s.total_operations();
        println!(
            "{name} {:?} {}: {ns:.1} ns/world, {:.2} M/s, {operations} ops, {} instr, {} spills, {} reloads, {} bytes, {:?} {:?}",
            T::PRECISION, isa.name(), 1e3 / ns, s.instructions, s.spills, s.reloads, s.bytes, s.order, compile
        );
    }
}
