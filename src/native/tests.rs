//! Every part of every model of the repository, on numbers of which nothing is known to fit: code leaves the bits of the kernel, and
//! the kernel over lanes those of one world alone.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lanesim_codegen::{Block, Float, InstructionSet};
use lanesim_kernels::lane::{Lane, LaneQuery, Real};
use lanesim_kernels::model::{Instance, Model as Tables, Quantities, Quantity, Varied};
use lanesim_kernels::part::{Executor, Item, Kernels, Lanes, Name, Op, Part, Step};
use lanesim_kernels::pipeline::Run;
use lanesim_kernels::solver;
use lanesim_kernels::stage::{Stage, Stages};
use lanesim_kernels::state::{Applied, BlockStatus, State};
use lanesim_kernels::workspace::Workspace;
use wide::{f32x16, f64x8};

use lanesim_kernels::step;

use super::library::ModelCode;
use super::record::workspace;
use super::{Codes, Native};
use crate::Model;
use crate::convex::SupportCollider;
use crate::mjcf::LoadOptions;

/// SplitMix64.
struct Random(u64);

impl Random {
    fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn unit(&mut self) -> f64 {
        (self.word() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn fill<L: LaneQuery>(&mut self, lanes: &mut [L]) {
        for x in lanes {
            (0..L::WIDTH).for_each(|lane| x.set(lane, L::Real::from_f64(self.unit())));
        }
    }
}

/// All models of the repository but the scenes of `accuracy`: their mechanisms are those of the others, and some are too large for code.
fn models() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    let entries = |path: &Path| std::fs::read_dir(path).expect("models").map(|entry| entry.expect("a model").path());
    let folders: Vec<PathBuf> = entries(&root).filter(|path| path.is_dir() && !path.ends_with("accuracy")).collect();
    let mut all: Vec<PathBuf> = folders.iter().flat_map(|folder| entries(folder)).collect();
    all.retain(|path| path.extension().is_some_and(|extension| extension == "xml"));
    all.sort();
    all
}

/// What a part finds: fields and masks.
#[derive(Clone)]
struct Scene<L: Lane> {
    state: State<L>,
    applied: Applied<L>,
    ws: Workspace<L>,
}

impl<L: LaneQuery> Scene<L> {
    fn step<'a>(&'a mut self, tables: &'a Tables<L::Real>, applied: bool) -> Step<'a, L> {
        let Scene { state, applied: forces, ws } = self;
        let (model, stages) = (Instance::from(tables), Stages::STEP | Stages::up_to(Stage::Energy));
        Step { model, state, applied: applied.then_some(&*forces), ws, stages, clock: None }
    }

    /// The scene of one world.
    fn alone(&mut self, tables: &Tables<L::Real>, mut alone: Scene<L::Real>, lane: usize) -> Scene<L::Real>
    where
        L::Real: LaneQuery<Real = L::Real>,
    {
        let mut all: Vec<Vec<L::Real>> = vec![];
        self.applied.for_each(&mut |field| all.push(field.data.iter().map(|x| x.get(lane)).collect()));
        let mut of = all.iter();
        alone.applied.for_each(&mut |field| field.data.copy_from_slice(of.next().expect("a field")));
        // By their numbers, of which models without some stages leave out some.
        let mut all: BTreeMap<usize, Vec<L::Real>> = BTreeMap::new();
        self.step(tables, true).lend_all(&mut |field, _, lanes| {
            let lanes: &[L] = match &lanes {
                Lanes::Read(lanes) => lanes,
                Lanes::Write(lanes) => lanes,
            };
            all.insert(field, lanes.iter().map(|x| x.get(lane)).collect());
        });
        alone.step(tables, true).lend_all(&mut |field, _, lanes| {
            if let Lanes::Write(lanes) = lanes {
                lanes.copy_from_slice(&all[&field]);
            }
        });
        alone
    }

    /// Bits of the fields that a part leaves, name by name, of a lane; of a number that is none, nothing.
    fn left(&mut self, part: Part, tables: &Tables<L::Real>, lane: usize) -> Vec<(Name, Vec<Option<u64>>)> {
        let (changes, mut all) = (part.changes(tables), vec![]);
        let zero = L::Real::from_f64(0.0);
        self.step(tables, false).lend_all(&mut |_, name, lanes| {
            let changed = |change: &&str| *change == name[0] || **change == format!("{}.{}", name[0], name[1]);
            if let (Lanes::Write(lanes), true) = (lanes, changes.iter().any(changed)) {
                let bits = |x: &L| {
                    let x = x.get(lane);
                    x.to_f64().is_finite().then(|| (x + zero).bits())
                };
                all.push((name, lanes.iter().map(bits).collect()));
            }
        });
        all
    }
}

/// A workspace after a few steps from a random state.
fn stepped<L: LaneQuery>(tables: &Tables<L::Real>, random: &mut Random) -> (State<L>, Workspace<L>) {
    let (mut state, mut ws) = (State::<L>::initial(tables), Workspace::new(tables));
    let mut start = |lanes: &mut [L], from: &[L::Real], size: f64| {
        for (i, x) in lanes.iter_mut().enumerate() {
            let from = from.get(i).map_or(0.0, |x| x.to_f64());
            (0..L::WIDTH).for_each(|lane| x.set(lane, L::Real::from_f64(size.mul_add(random.unit(), from))));
        }
    };
    start(&mut state.qpos, &tables.qpos0, 0.2);
    start(&mut state.qvel, &[], 1.0);
    start(&mut state.ctrl, &[], 1.0);
    let mut status = BlockStatus { alive: ((1_u64 << L::WIDTH) - 1) as u32, ..BlockStatus::default() };
    for _ in 0..3 {
        let mut run = Run {
            applied: None,
            varied: None,
            clock: None,
            max_contacts: 1024,
            convex: &SupportCollider,
            stages: Stages::up_to(Stage::Energy),
            residual: false,
            executor: &mut Kernels,
            keep: true,
        };
        step::step(tables, &mut state, &mut run, &mut status, &mut ws);
    }
    (state, ws)
}

/// A scene for a part: geometry as a step left it, and of smooth stages that begin later all that is before them, all else at random, and not
/// a number where the part's code does not look.
fn scene<L: Block>(
    code: &Arc<ModelCode<L::Float>>,
    part: Part,
    item: &Item<'_>,
    (state, from): (&State<L>, &mut Workspace<L>),
    random: &mut Random,
) -> Scene<L> {
    let tables = &*code.tables;
    let coded = code.get(code, part).expect("code");
    let pattern = solver::fullest_pattern(tables);
    let ws = workspace(tables, item, &from.collision.groups.clone(), pattern.as_ref());
    let mut scene = Scene { state: state.clone(), applied: Applied::new(&tables.sizes), ws };
    scene.applied.for_each(&mut |field| random.fill(field.data));
    let mut geometry: BTreeMap<usize, Vec<L>> = BTreeMap::new();
    let mut own = state.clone();
    let model = Instance::from(tables);
    let mut step = Step { model, state: &mut own, applied: None, ws: from, stages: Stages::STEP, clock: None };
    step.lend_all(&mut |field, _, lanes| {
        let lanes = match lanes {
            Lanes::Read(lanes) => lanes.to_vec(),
            Lanes::Write(lanes) => lanes.to_vec(),
        };
        geometry.insert(field, lanes);
    });
    let nan = L::of(f64::NAN);
    let later = part.op == Op::Smooth && part.of >> 2 != 0;
    scene.step(tables, false).lend_all(&mut |field, [stage, name], lanes| {
        let Lanes::Write(lanes) = lanes else { return };
        let kept = matches!(stage, "state" | "position" | "inertia" | "velocity")
            || later && matches!(stage, "tendon" | "passive" | "acceleration")
            || matches!((stage, name), ("collision", "qpos") | ("solver", "metric"));
        let left = geometry.get(&field).filter(|left| kept && left.len() == lanes.len());
        if let Some(left) = left {
            lanes.copy_from_slice(left);
        } else if coded.sources.iter().any(|source| source.field == field) {
            random.fill(lanes);
        } else {
            lanes.fill(nan);
        }
    });
    if let Some(structure) = code.structure_of(part.op) {
        scene.step(tables, false).lend_all(&mut |_, name, lanes| {
            if let Lanes::Write(lanes) = lanes {
                let dead = (0..lanes.len()).filter(|entry| structure.is_dead(name, *entry));
                dead.collect::<Vec<_>>().into_iter().for_each(|entry| lanes[entry] = L::zero());
            }
        });
    }
    scene
}

fn run<L: LaneQuery>(
    executor: &mut dyn Executor<L>,
    (part, item): (Part, &Item<'_>),
    given: u32,
    scene: &mut Scene<L>,
    tables: &Tables<L::Real>,
) -> Vec<u32> {
    let group = if part.op == Op::Near { scene.ws.collision.groups[part.of as usize].len() } else { 0 };
    let mut returned = vec![0; part.op.masks()[1].max(group)];
    let mut step = scene.step(tables, part.op == Op::Smooth && part.of & 1 != 0);
    match item {
        Item::Whole => executor.run(part, given, &mut returned, &mut step),
        item => executor.each(part, &mut std::iter::once(*item), given, &mut step),
    }
    returned
}

/// Holds some parts of a model against each other; returns how many had code.
fn check<T>(name: &str, tables: &Arc<Tables<T>>, isa: InstructionSet, of: &[Op]) -> usize
where
    T: Float + LaneQuery<Real = T>,
{
    let code = match Codes::<T>::default().get(tables, Some(isa)) {
        Err(why) if why.contains("too large") => return 0, // a heap whose solver has room for every pair
        code => code.expect("code"),
    };
    let mut native = Native::new(code.clone());
    let mut random = Random(7);
    let (state, mut ws) = stepped::<T::Block>(tables, &mut random);
    let all = ((1_u64 << T::Block::WIDTH) - 1) as u32;
    let mut count = 0;
    for part in of.iter().flat_map(|op| code.common.parts(*op)) {
        if code.get(&code, part).is_none() {
            continue;
        }
        count += 1;
        let what = format!("{name} {} {} {isa:?}", code.common.name(tables, part), <T as Real>::NAME);
        let item = code.common.item(part);
        let given = random.word() as u32 & all;
        let mut coded = scene::<T::Block>(&code, part, &item, (&state, &mut ws), &mut random);
        let mut start = coded.clone();
        let mut wide = coded.clone();
        let masks = run(&mut native, (part, &item), given, &mut coded, tables);
        let expected_masks = run(&mut Kernels, (part, &item), given, &mut wide, tables);
        let masks = masks.iter().map(|mask| mask & all).collect::<Vec<_>>();
        assert_eq!(masks, expected_masks, "{what}: masks");
        for lane in 0..T::Block::WIDTH {
            let expected = wide.left(part, tables, lane);
            for ((field, got), (_, expected)) in coded.left(part, tables, lane).iter().zip(&expected) {
                for (i, (got, expected)) in got.iter().zip(expected).enumerate() {
                    let dead = code.structure_of(part.op).is_some_and(|structure| structure.is_dead(*field, i));
                    let same = got == expected || expected.is_none() || dead;
                    assert!(same, "{what}: {field:?}[{i}] of lane {lane} is {got:x?} instead of {expected:x?}");
                }
            }
            if lane % 3 == 0 {
                let (pattern, groups) = (solver::fullest_pattern(&**tables), wide.ws.collision.groups.clone());
                let ws = workspace::<T>(tables, &item, &groups, pattern.as_ref());
                let fresh = Scene { state: State::new(&tables.sizes), applied: Applied::new(&tables.sizes), ws };
                let mut alone = start.alone(tables, fresh, lane);
                let masks = run(&mut Kernels, (part, &item), given >> lane, &mut alone, tables);
                let of_lane: Vec<u32> = expected_masks.iter().map(|mask| mask >> lane & 1).collect();
                assert_eq!(masks, of_lane, "{what}: masks of lane {lane} alone");
                for ((field, got), (_, expected)) in alone.left(part, tables, 0).iter().zip(&expected) {
                    assert!(got == expected, "{what}: {field:?} of lane {lane} alone is not what it is among others");
                }
            }
        }
    }
    count
}

fn check_all<T>(tables: fn(&Model) -> &Arc<Tables<T>>, overrides: &[(&str, &str)], of: &[Op], least: usize)
where
    T: Float + LaneQuery<Real = T>,
{
    let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
    let sets = [InstructionSet::Avx512, InstructionSet::Avx2].into_iter().filter(|isa| isa.check().is_ok());
    let mut count = 0;
    for (isa, path) in sets.flat_map(|isa| models().into_iter().map(move |path| (isa, path))) {
        let options = LoadOptions { lenient: true, overrides: overrides.iter().map(owned).collect() };
        let Ok(model) = Model::from_xml_path(&path, &options) else { continue };
        count += check(&path.display().to_string(), tables(&model), isa, of);
    }
    assert!(count == 0 || count > least, "only {count} parts");
}

#[test]
fn every_part_is_its_kernel_f64() {
    check_all::<f64>(Model::tables, &[], Op::ALL, 2000);
}

#[test]
fn every_part_is_its_kernel_f32() {
    check_all::<f32>(Model::tables_f32, &[], Op::ALL, 2000);
}

/// What only some options need.
const SWEPT: [(&str, &str); 3] = [("solver", "PGS"), ("noslip_iterations", "3"), ("integrator", "RK4")];
const OF_SWEPT: [Op; 4] = [Op::Sweep, Op::Push, Op::Hold, Op::Combine];

/// What of a discrete step depends on its metric.
const DISCRETE: [(&str, &str); 1] = [("integrator", "discrete")];
const OF_DISCRETE: [Op; 6] = [Op::Smooth, Op::Depart, Op::Turn, Op::Descend, Op::Polish, Op::Integrate];

#[test]
fn every_part_of_discrete_steps_is_its_kernel_f64() {
    check_all::<f64>(Model::tables, &DISCRETE, &OF_DISCRETE, 300);
}

#[test]
fn every_part_of_discrete_steps_is_its_kernel_f32() {
    check_all::<f32>(Model::tables_f32, &DISCRETE, &OF_DISCRETE, 300);
}

/// What of midpoint steps, and of a guard, differs from others.
const KICKED: [(&str, &str); 2] = [("integrator", "midpoint"), ("guard", "enable")];
const OF_KICKED: [Op; 2] = [Op::Smooth, Op::Integrate];

#[test]
fn every_part_of_midpoint_steps_is_its_kernel_f64() {
    check_all::<f64>(Model::tables, &KICKED, &OF_KICKED, 300);
}

#[test]
fn every_part_of_midpoint_steps_is_its_kernel_f32() {
    check_all::<f32>(Model::tables_f32, &KICKED, &OF_KICKED, 300);
}

#[test]
fn every_part_of_sweeps_is_its_kernel_f64() {
    check_all::<f64>(Model::tables, &SWEPT, &OF_SWEPT, 500);
}

#[test]
fn every_part_of_sweeps_is_its_kernel_f32() {
    check_all::<f32>(Model::tables_f32, &SWEPT, &OF_SWEPT, 500);
}

/// A block of worlds with what their steps need, at fixed addresses.
struct Bench {
    state: State<f64x8>,
    workspace: Workspace<f64x8>,
}

impl Bench {
    /// Positions after some steps from the reference configuration.
    fn run(&mut self, model: &Model, native: &mut Native<f64>, varied: Option<&Varied<f64x8>>) -> Vec<u64> {
        self.state.for_each(&mut |field| field.data.fill(f64x8::splat(0.0)));
        for (q, q0) in self.state.qpos.iter_mut().zip(&model.tables().qpos0) {
            *q = f64x8::splat(*q0);
        }
        let mut status = BlockStatus { alive: 0xff, ..BlockStatus::default() };
        for _ in 0..30 {
            let mut run = Run {
                applied: None,
                varied,
                clock: None,
                max_contacts: 100,
                convex: &SupportCollider,
                stages: Stages::STEP,
                residual: false,
                executor: native,
                keep: false,
            };
            step::step(model.tables(), &mut self.state, &mut run, &mut status, &mut self.workspace);
        }
        assert_eq!(status.alive, 0xff);
        self.state.qpos.iter().map(|q| q.get(3).to_bits()).collect()
    }
}

/// Newton's iteration keeps its calls from step to step: not beyond the code that they call, in which masses were folded.
#[test]
fn code_that_is_swapped_leaves_no_calls_behind() {
    let text = "<mujoco><worldbody><geom type='plane' size='3 3 1'/><body pos='0 0 .1'><freejoint/>
        <geom type='box' size='.1 .1 .1'/></body></worldbody></mujoco>";
    let model = Model::from_xml_string(text, &Default::default()).expect("a model");
    let Ok(isa) = InstructionSet::detect() else { return };
    let Ok(code) = ModelCode::new(model.tables(), isa).map(Arc::new) else { return };
    let set = Quantities::of(&[Quantity::Link]);
    let mut varied = Varied::<f64x8>::new(model.tables(), set);
    varied.lanes_mut(Quantity::Link).iter_mut().for_each(|x| *x *= f64x8::splat(3.0));
    let bench = || Bench { state: State::new(&model.tables().sizes), workspace: Workspace::new(model.tables()) };

    let mut fresh = Native::new(code.clone());
    Executor::<f64x8>::vary(&mut fresh, model.tables(), set);
    let expected = bench().run(&model, &mut fresh, Some(&varied));

    let (mut used, mut place) = (Native::new(code), bench());
    let light = place.run(&model, &mut used, None);
    Executor::<f64x8>::vary(&mut used, model.tables(), set);
    assert_eq!(place.run(&model, &mut used, Some(&varied)), expected);
    assert_ne!(light, expected);
}

/// Steps of a block from a random state by the kernels: bits of the last one's positions and accelerations, and whether trees touched.
fn bits_of<L: LaneQuery>(tables: &Tables<L::Real>) -> (Vec<u64>, bool) {
    let (mut state, mut ws) = stepped::<L>(tables, &mut Random(11));
    let mut status = BlockStatus { alive: ((1_u64 << L::WIDTH) - 1) as u32, ..BlockStatus::default() };
    let mut touched = false;
    for _ in 0..60 {
        let mut run = Run {
            applied: None,
            varied: None,
            clock: None,
            max_contacts: 1024,
            convex: &SupportCollider,
            stages: Stages::STEP,
            residual: false,
            executor: &mut Kernels,
            keep: false,
        };
        step::step(tables, &mut state, &mut run, &mut status, &mut ws);
        touched |= ws.constraint.cross;
    }
    let all = state.qpos.iter().chain(&state.qacc_warmstart);
    (all.flat_map(|x| (0..L::WIDTH).map(|lane| x.get(lane).bits())).collect(), touched)
}

/// Tiles are another storage of the same factor: no bit depends on them.
#[test]
fn tiles_leave_the_bits_of_the_skyline() {
    for name in ["capsule_pile", "box_stack"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("models/zoo/{name}.xml"));
        let model = Model::from_xml_path(&path, &LoadOptions::default()).expect("a model");
        fn plain<T: Clone>(tables: &Tables<T>) -> Tables<T> {
            let mut plain = tables.clone();
            assert!(!plain.tiles.is_empty());
            (plain.tiles, plain.sizes.ntile, plain.sizes.npanel) = Default::default();
            plain
        }
        let (tables, tables_f32) = (model.tables(), model.tables_f32());
        let (with, touched) = bits_of::<f64x8>(tables);
        assert!(touched, "{name}: no trees touch");
        assert!(with == bits_of::<f64x8>(&plain(tables)).0, "{name} in f64");
        assert!(bits_of::<f32x16>(tables_f32).0 == bits_of::<f32x16>(&plain(tables_f32)).0, "{name} in f32");
    }
}

/// Code of a part that would not stay in the cache is not made, whatever part that is.
#[test]
fn no_part_is_recorded_at_any_size() {
    let body = "<body><freejoint/><geom size='.1' contype='0' conaffinity='0'/></body>";
    let text =
        format!("<mujoco><worldbody><replicate count='20000' offset='.3 0 0'>{body}</replicate></worldbody></mujoco>");
    let model = Model::from_xml_string(&text, &Default::default()).expect("a model");
    let Ok(isa) = InstructionSet::detect() else { return };
    let Ok(code) = ModelCode::new(model.tables(), isa).map(Arc::new) else { return };
    let start = std::time::Instant::now();
    assert!(code.all().iter().all(|(_, code)| code.is_none()));
    // To record it all takes minutes; a machine with other work to do may take long for little, too.
    assert!(start.elapsed().as_secs() < 30);
}
