//! No world changes another, whatever finite or other numbers it holds: every world of a batch, through resets, losses and
//! states of any size, has the bits of the same world alone on the scalar backend. What frozen worlds say of themselves too.

use crate::support::{Random, load, options, parse};
use lanesim::rows::Rows;
use lanesim::{Backend, Field, InstructionSet, Model, OnDiverge, Options, Precision, Worlds};

/// A ball over a floor, two pairs of geoms.
const BALL: &str = "<mujoco><worldbody><geom type='plane' size='5 5 1'/>\
    <body pos='0 0 .3'><freejoint/><geom size='.1'/></body></worldbody></mujoco>";
/// The same with more pairs than code tests at once.
const BALLS: &str = "<mujoco><worldbody><geom type='plane' size='5 5 1'/>\
    <body pos='0 0 .3'><freejoint/><geom size='.1'/></body>\
    <replicate count='36' offset='3 0 0'><body pos='10 0 .3'><freejoint/><geom size='.1'/></body></replicate>\
    </worldbody></mujoco>";
/// A slide far out, whose places are rounded coarsely, with a hinge that turns often before it strikes.
const CRANE: &str = "<mujoco><worldbody><geom type='box' size='.1 5 .1' pos='3000 0 0'/>\
    <body><joint type='slide' axis='1 0 0' damping='1'/><geom size='.1'/>\
    <body pos='0 0 .3'><joint axis='0 1 0'/><geom type='capsule' size='.02' fromto='0 0 0 0 0 .35'/></body></body>\
    </worldbody></mujoco>";
const FIELDS: [Field; 5] = [Field::Time, Field::Qpos, Field::Qvel, Field::QaccWarmstart, Field::XfrcApplied];
const OUTPUTS: [&str; 8] = ["status", "ncon", "nefc", "solver_niter", "qacc", "xpos", "efc_force", "contact_dist"];

/// What stands between two runs of steps.
#[derive(Clone, Copy)]
struct Round {
    world: usize,
    round: usize,
    seed: u64,
}

impl Round {
    /// Does to a world what happens to it in this round: mostly nothing.
    fn disturb(self, worlds: &mut Worlds, place: usize) {
        let random = &mut Random(self.seed.wrapping_add((self.world * 7919 + self.round) as u64 * 0x9e37));
        random.bits();
        let sizes = worlds.model().tables().sizes.clone();
        let put = |worlds: &mut Worlds, field, values: &[f64]| {
            worlds.set_unchecked(field, place, values).expect("a state");
        };
        let any = |random: &mut Random, n: usize, most: f64| -> Vec<f64> {
            let scale = 10_f64.powf(random.uniform(-3.0, most));
            random.vector(n, 1.0).iter().map(|x| x * scale).collect()
        };
        match (random.uniform(0.0, 20.0)) as u32 {
            // Any finite numbers, but in the positions alone, in the velocities, or as forces.
            0 => put(worlds, Field::Qpos, &any(random, sizes.nq, 300.0)),
            1 => put(worlds, Field::Qvel, &any(random, sizes.nv, 300.0)),
            2 => put(worlds, Field::XfrcApplied, &any(random, 6 * sizes.nbody, 300.0)),
            // What may be stepped on.
            3 => put(worlds, Field::Qpos, &any(random, sizes.nq, 7.0)),
            4 => put(worlds, Field::Qvel, &any(random, sizes.nv, 4.0)),
            5 => put(worlds, Field::Ctrl, &any(random, sizes.nu, 12.0)),
            6 => put(worlds, Field::Qpos, &vec![f64::NAN; sizes.nq]),
            7 | 8 => worlds.reset(place, None).expect("a world"),
            9 => {
                // Moved by little: contacts come and go.
                let qpos = worlds.model().initial_key().qpos;
                let moved: Vec<f64> = qpos.iter().map(|q| q + random.uniform(-0.3, 0.3)).collect();
                put(worlds, Field::Qpos, &moved);
            }
            _ => {}
        }
    }
}

/// Bits of everything that the worlds keep and say, one row per world. All numbers that are none count alike.
fn bits(worlds: &mut Worlds) -> Vec<Vec<u64>> {
    let n = worlds.nworld();
    let mut lists = vec![vec![Vec::new(); n]; OUTPUTS.len()];
    worlds.read_all(&OUTPUTS, lists.iter_mut().map(|list| Rows::Lists(list)).collect()).expect("outputs");
    let bits = |x: &f64| if x.is_nan() { u64::MAX } else { x.to_bits() };
    (0..n)
        .map(|world| {
            let state = FIELDS.iter().flat_map(|field| worlds.get(*field, world).expect("a field"));
            let state: Vec<u64> = state.map(|x| bits(&x)).collect();
            let events = worlds.status_detail(world).expect("a world");
            let events = events.iter().map(|event| u64::from(event.status.0) << 32 | event.step);
            let outputs = lists.iter().flat_map(|list| list[world].iter().map(bits));
            state.into_iter().chain(events).chain(outputs).collect()
        })
        .collect()
}

/// Worlds `ids` side by side through all rounds; the bits after each.
fn history(model: &Model, ids: &[usize], rounds: usize, seed: u64, options: &Options) -> Vec<Vec<Vec<u64>>> {
    let mut worlds = Worlds::new(model, ids.len(), options).expect("a batch");
    let mut one = |round: usize| {
        for (place, world) in ids.iter().enumerate() {
            Round { world: *world, round, seed }.disturb(&mut worlds, place);
        }
        worlds.step(1 + (round * 7) % 23).expect("steps");
        bits(&mut worlds)
    };
    (0..rounds).map(&mut one).collect()
}

fn engines(precision: Precision) -> Vec<Options> {
    let native = [InstructionSet::Avx512, InstructionSet::Avx2].into_iter().filter(|set| set.check().is_ok());
    let native = native.map(|set| Options { instructions: Some(set), ..options(precision, Backend::Native) });
    [Backend::Wide, Backend::Scalar].map(|backend| options(precision, backend)).into_iter().chain(native).collect()
}

/// Rounds of a model: `LANESIM_NEIGHBOUR_ROUNDS` for hours of it.
fn rounds(usual: usize) -> usize {
    std::env::var("LANESIM_NEIGHBOUR_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

/// The same worlds in company and alone.
fn in_company_as_alone(name: &str, model: &Model, usual: usize) {
    let rounds = rounds(usual);
    for (precision, count) in [(Precision::F64, 19), (Precision::F32, 35)] {
        for policy in [OnDiverge::Freeze, OnDiverge::Reset { key: None }] {
            let ids: Vec<usize> = (0..count).collect();
            let with = |options: Options| Options { on_diverge: policy, ..options };
            let scalar = with(options(precision, Backend::Scalar));
            let alone: Vec<_> = ids.iter().map(|id| history(model, &[*id], rounds, 11, &scalar)).collect();
            for engine in engines(precision).into_iter().map(with) {
                let company = history(model, &ids, rounds, 11, &engine);
                for (round, worlds) in company.iter().enumerate() {
                    for (id, bits) in worlds.iter().enumerate() {
                        let expected = &alone[id][round][0];
                        let place = bits.iter().zip(expected).position(|(a, b)| a != b);
                        assert!(
                            place.is_none() && bits.len() == expected.len(),
                            "{name}: world {id} has other bits after round {round}, first at {place:?}, with {engine:?}"
                        );
                    }
                }
            }
        }
    }
}

/// So many rounds, as it takes hundreds to meet a ball deep in the floor whose last step of single precision, on an edge of its
/// friction, went by the factor of a later round where a neighbour needed one.
#[test]
fn a_world_far_away_leaves_contacts_alone() {
    in_company_as_alone("ball", &parse(BALL), 800);
}

#[test]
fn so_it_does_where_kernels_test_the_pairs() {
    in_company_as_alone("balls", &parse(BALLS), 8);
}

#[test]
fn places_that_are_rounded_coarsely_are_tested_in_time() {
    in_company_as_alone("crane", &parse(CRANE), 60);
}

#[test]
fn convex_shapes_after_resets() {
    in_company_as_alone("sphere_ellipsoid", &load("convex/sphere_ellipsoid"), 60);
}

/// What a search for contacts remembers of the last one saves work, and changes nothing: a step among others is that of worlds that
/// were just made.
#[test]
fn convex_shapes_have_no_past() {
    let body = |shape: &str, x: f64| format!("<body pos='{x} 0 .3'><freejoint/><geom {shape}/></body>");
    let shapes = ["type='mesh' mesh='gem'", "type='cylinder' size='.08 .1'", "type='ellipsoid' size='.1 .07 .12'"];
    let bodies: String = (0..6).map(|i| body(shapes[i % 3], 0.22 * i as f64)).collect();
    let text = format!(
        "<mujoco><asset><mesh name='gem' vertex='.1 0 0 -.1 0 0 0 .1 0 0 -.1 0 0 0 .1 0 0 -.1 .07 .07 .07'/></asset>
        <worldbody><geom type='plane' size='5 5 1'/><geom type='box' size='.5 .1 .1' euler='0 20 10'/>{bodies}</worldbody></mujoco>"
    );
    let model = parse(&text);
    let sizes = &model.tables().sizes;
    let fields = [Field::Qpos, Field::Qvel, Field::QaccWarmstart];
    for precision in [Precision::F64, Precision::F32] {
        let options = options(precision, Backend::Wide);
        let mut old = Worlds::new(&model, 16, &options).expect("a batch");
        let random = &mut Random(5);
        for world in 0..16 {
            old.set(Field::Qvel, world, &random.vector(sizes.nv, 2.0)).expect("a state");
        }
        for step in 0..150 {
            let mut new = Worlds::new(&model, 16, &options).expect("a batch");
            for (world, field) in (0..16).flat_map(|world| fields.map(|field| (world, field))) {
                new.set(field, world, &old.get(field, world).expect("a field")).expect("a state");
            }
            old.step(1).expect("a step");
            new.step(1).expect("a step");
            for (world, field) in (0..16).flat_map(|world| fields.map(|field| (world, field))) {
                let [old, new] = [&old, &new].map(|worlds| worlds.get(field, world).expect("a field"));
                assert_eq!(old, new, "{field:?} of world {world} after step {step} in {precision:?}");
            }
        }
    }
}

#[test]
fn legs_in_any_company() {
    in_company_as_alone("ant", &load("zoo/ant"), 30);
}

#[test]
fn limbs_in_any_company() {
    in_company_as_alone("humanoid27", &load("zoo/humanoid27"), 8);
}

/// A neighbour at 1e15 m made worlds fall through the floor, those of other blocks of the worker too.
#[test]
fn neighbour_kills_contacts() {
    // From higher up: the gap must be one that is told apart from a way of 1e15 m.
    for text in [BALL, BALLS].map(|text| text.replace("0 0 .3", "0 0 1")) {
        let model = parse(&text);
        for (backend, nworld) in [(Backend::Wide, 2), (Backend::Wide, 16), (Backend::Native, 2), (Backend::Native, 16)]
        {
            let run = |far: Option<f64>| {
                let mut worlds = Worlds::new(&model, nworld, &options(Precision::F64, backend)).expect("a batch");
                worlds.step(1).expect("a step");
                if let Some(far) = far {
                    let mut qpos = worlds.get(Field::Qpos, 1).expect("a field");
                    qpos[0] = far;
                    worlds.set(Field::Qpos, 1, &qpos).expect("a state");
                }
                worlds.step(600).expect("steps");
                [0, nworld / 4 * 2].map(|world| worlds.get(Field::Qpos, world).expect("a field"))
            };
            let clean = run(None);
            assert!((clean[0][2] - 0.1).abs() < 1e-2, "the ball lies on the floor: {:?}", clean[0]);
            for far in [1e6, 1e9, 1e10, 1e13, 1e15, 1e16, 1e300] {
                assert_eq!(run(Some(far)), clean, "a neighbour at {far:e} of {nworld} with {backend:?}");
            }
        }
    }
}

/// A world that was lost and set back stepped without its contacts for good.
#[test]
fn reset_loses_contact() {
    let model = load("convex/sphere_ellipsoid");
    let lost = [0.0, -0.000_465_565_623_017_028, -647.965_759_277_343_8, -940_650_853_826_560.0];
    for precision in [Precision::F32, Precision::F64] {
        for backend in [Backend::Wide, Backend::Scalar, Backend::Native] {
            let reset = OnDiverge::Reset { key: None };
            let options = Options { on_diverge: reset, ..options(precision, backend) };
            let run = |qpos: Option<&[f64]>| {
                let mut worlds = Worlds::new(&model, 1, &options).expect("a batch");
                if let Some(qpos) = qpos {
                    worlds.set(Field::Qpos, 0, qpos).expect("a state");
                }
                worlds.step(400).expect("steps");
                worlds.get(Field::Qpos, 0).expect("a field")
            };
            assert_eq!(run(Some(&lost)), run(None), "{precision:?} {backend:?}");
        }
    }
}
