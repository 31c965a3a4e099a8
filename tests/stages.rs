//! Stages of a step, one by one: each writes all that it promises whatever was there before, every lane type computes the
//! same bits, and independent algorithms give the same numbers.

use crate::support;
use crate::support::{Random, all_models, assert_agree, load, load_with};
use lanesim::Model;
use lanesim::convex::SupportCollider;
use lanesim_kernels::acceleration::articulated::{self, Scratch};
use lanesim_kernels::collision::Contact;
use lanesim_kernels::fields::FieldView;
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::math::{ldl, spatial};
use lanesim_kernels::model::{JointKind, Model as Tables, NONE};
use lanesim_kernels::options::Integrator;
use lanesim_kernels::part::{Executor, Kernels, Op, Part, Step};
use lanesim_kernels::pipeline::{Run, Stage, Stages};
use lanesim_kernels::position::{Position, kinematics};
use lanesim_kernels::state::{BlockStatus, State};
use lanesim_kernels::tendon::{self, Tendons};
use lanesim_kernels::workspace::Workspace;
use lanesim_kernels::{inertia, integration, position, step, velocity};
use std::sync::Arc;
use wide::{f32x16, f64x8};

/// A state of one world.
struct World {
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    ctrl: Vec<f64>,
}

/// A random state near the reference configuration, low enough to touch the floor now and then.
fn world(model: &Model, random: &mut Random) -> World {
    let sizes = &model.tables().sizes;
    let mut qpos = model.initial_key().qpos;
    qpos.iter_mut().for_each(|q| *q += random.uniform(-0.3, 0.3));
    World { qpos, qvel: random.vector(sizes.nv, 1.0), ctrl: random.vector(sizes.nu, 1.0) }
}

/// Worlds side by side.
fn state<L: LaneQuery>(model: &Tables<L::Real>, worlds: &[World]) -> State<L> {
    let mut state = State::initial(model);
    for lane in 0..L::WIDTH {
        let world = &worlds[lane % worlds.len()];
        let fill = |lanes: &mut [L], x: &[f64]| {
            lanes.iter_mut().zip(x).for_each(|(l, x)| l.set(lane, L::Real::from_f64(*x)));
        };
        fill(&mut state.qpos, &world.qpos);
        fill(&mut state.qvel, &world.qvel);
        fill(&mut state.ctrl, &world.ctrl);
    }
    state
}

/// One step and the energy before it, with everything that they leave in the workspace.
fn step<L: LaneQuery>(model: &Tables<L::Real>, state: &State<L>, ws: &mut Workspace<L>) {
    step_by(&mut Kernels, model, state, ws, true);
}

/// The step, or only what it begins with.
fn step_by<L: LaneQuery>(
    executor: &mut dyn Executor<L>,
    model: &Tables<L::Real>,
    state: &State<L>,
    ws: &mut Workspace<L>,
    whole: bool,
) {
    let mut status = BlockStatus { alive: ((1_u64 << L::WIDTH) - 1) as u32, ..BlockStatus::default() };
    let (convex, stages) = (&SupportCollider, Stages::up_to(Stage::Energy));
    let (residual, keep) = (false, true);
    let mut run =
        Run { applied: None, varied: None, clock: None, max_contacts: 1024, convex, stages, residual, executor, keep };
    let mut state = state.clone();
    let solved = step::evaluate(model, &mut state, &mut run, &mut status, ws);
    if whole {
        step::advance(model, &mut state, &mut run, &mut status, solved, ws);
    }
}

/// Calls `f` with stage and field of everything in the workspace.
fn each_field<L: LaneQuery>(ws: &mut Workspace<L>, f: &mut dyn FnMut(&'static str, FieldView<'_, L>)) {
    ws.position.for_each(&mut |field| f("position", field));
    ws.inertia.for_each(&mut |field| f("inertia", field));
    ws.collision.colliders.for_each(&mut |field| f("collision", field));
    ws.velocity.for_each(&mut |field| f("velocity", field));
    ws.passive.for_each(&mut |field| f("passive", field));
    ws.actuation.for_each(&mut |field| f("actuation", field));
    ws.acceleration.for_each(&mut |field| f("acceleration", field));
    ws.derivative.for_each(&mut |field| f("derivative", field));
    ws.solver.fields.for_each(&mut |field| f("solver", field));
    ws.integration.for_each(&mut |field| f("integration", field));
    ws.energy.for_each(&mut |field| f("energy", field));
    if let Some(rk4) = &mut ws.rk4 {
        rk4.stage.for_each(&mut |field| f("between", field));
        rk4.rates.for_each(&mut |field| f("rates", field));
    }
}

/// Whether a stage writes a field of this model at every step. The solver's fields but these two are its scratch.
fn promised<T: Real>(model: &Tables<T>, stage: &str, field: &str) -> bool {
    // Scratch.
    if ["between", "rates"].contains(&stage) || !present(model, stage) {
        return false;
    }
    match (stage, field) {
        // Of trees with a derivative of the bias force.
        ("derivative", "upper" | "turn" | "gain") => model.options.integrator == Integrator::Implicit,
        ("derivative", "metric" | "pull" | "joined") => model.options.integrator == Integrator::Discrete,
        ("derivative", "inverse") => model.options.integrator != Integrator::Discrete,
        ("solver", _) => ["qacc", "qfrc_constraint"].contains(&field),
        ("acceleration", "residual" | "twist") | (_, "multipliers") => false,
        // Poses of geoms wait until a pair needs them.
        ("collision", "pos" | "axis") => false,
        // When pairs are tested again within a step depends on neighbours.
        ("collision", _) if model.options.integrator == Integrator::Rk4 => false,
        // They tell of steps before, too.
        ("collision", "way" | "blur" | "stir" | "travel" | "due" | "gaps") => false,
        ("passive", "qfrc_gravcomp") => model.features.gravcomp,
        ("actuation", "length" | "moment") => true,
        ("actuation", _) => model.features.actuation,
        ("acceleration", "factor") => !model.features.articulated,
        ("integration", "factor") => model.features.implicit_damping && !model.features.articulated,
        ("integration", "inverse") => model.features.implicit_damping,
        (_, "body" | "column") | ("integration", "twist") => false,
        // The joint axis of a free joint is not a thing that exists.
        ("position", "axis") => model.joints.iter().all(|j| j.kind != JointKind::Free),
        _ => true,
    }
}

/// Whether the model has anything for a stage to do.
fn present<T: Real>(model: &Tables<T>, stage: &str) -> bool {
    if ["between", "rates"].contains(&stage) {
        return model.options.integrator == Integrator::Rk4;
    }
    let found = Stage::ALL.iter().find(|(_, name)| *name == stage);
    found.unwrap_or_else(|| panic!("no stage {stage}")).0.present(model)
}

/// Fills everything with NaN, but for what is there from the start: the gaps in the rows of M, and the fields of stages that
/// have nothing to do, which are never written; and the sums over links of the solver, which every solve leaves at zero.
fn poison<L: LaneQuery>(model: &Tables<L::Real>, ws: &mut Workspace<L>) {
    let nan = L::of(f64::NAN);
    each_field(ws, &mut |stage, field| {
        if present(model, stage) {
            field.data.fill(nan);
        }
    });
    ws.solver.fields.wrench.as_flattened_mut().fill(L::zero());
    ws.solver.fields.pull.fill(L::zero());
    ws.solver.fields.stiffness.as_flattened_mut().fill(L::zero());
    let m = &mut ws.inertia.m;
    m.fill(L::zero());
    for i in 0..model.sizes.nv {
        let columns = model.tree_pattern.row(i).iter().flat_map(|run| run.range()).chain([i]);
        columns.for_each(|j| m[model.rows.at(i, j)] = nan);
    }
}

/// Name and bits of every promised field, for one lane.
fn contents<L: LaneQuery>(model: &Tables<L::Real>, ws: &mut Workspace<L>, lane: usize) -> Vec<(String, Vec<u64>)> {
    let mut out = vec![];
    each_field(ws, &mut |stage, field| {
        if promised(model, stage, field.name) {
            // + 0: inactive contacts may leave zeros of either sign.
            let bits = field.data.iter().map(|x| (x.get(lane).to_f64() + 0.0).to_bits()).collect();
            out.push((format!("{stage}.{}", field.name), bits));
        }
    });
    out
}

#[track_caller]
fn assert_same(what: &str, got: &[(String, Vec<u64>)], expected: &[(String, Vec<u64>)]) {
    for ((name, got), (_, expected)) in got.iter().zip(expected) {
        for (i, (a, b)) in got.iter().zip(expected).enumerate() {
            let (x, y) = (f64::from_bits(*a), f64::from_bits(*b));
            assert!(x.is_finite(), "{what} {name}[{i}] is {x}");
            assert!(a == b, "{what} {name}[{i}] is {x} instead of {y}");
        }
    }
}

/// A step in a poisoned workspace gives what it gives in a new one, finite, and the same in every lane as alone.
fn check_stages<W: LaneQuery<Real: LaneQuery<Real = W::Real>>>(name: &str, model: &Model, tables: &Tables<W::Real>) {
    let mut random = Random(11);
    let worlds: Vec<World> = (0..W::WIDTH).map(|_| world(model, &mut random)).collect();
    let side_by_side = state::<W>(tables, &worlds);
    let mut clean = Workspace::<W>::new(tables);
    step(tables, &side_by_side, &mut clean);
    let mut poisoned = Workspace::<W>::new(tables);
    poison(tables, &mut poisoned);
    step(tables, &side_by_side, &mut poisoned);
    for (lane, world) in worlds.iter().enumerate() {
        let what = format!("{name} {} lane {lane}", W::NAME);
        let expected = contents(tables, &mut clean, lane);
        assert_same(&what, &contents(tables, &mut poisoned, lane), &expected);
        let mut alone = Workspace::<W::Real>::new(tables);
        poison(tables, &mut alone);
        step(tables, &state::<W::Real>(tables, std::slice::from_ref(world)), &mut alone);
        assert_same(&format!("{what} alone"), &contents(tables, &mut alone, 0), &expected);
    }
}

#[test]
fn every_stage_writes_all_that_it_promises_f64() {
    for name in all_models() {
        let model = load(&name);
        check_stages::<f64x8>(&name, &model, model.tables());
    }
}

#[test]
fn every_stage_writes_all_that_it_promises_f32() {
    for name in all_models() {
        let model = load(&name);
        check_stages::<f32x16>(&name, &model, model.tables_f32());
    }
}

/// Kernels that test pairs in groups, as code does.
struct Grouped {
    tested: usize,
}

impl<L: LaneQuery> Executor<L> for Grouped {
    fn in_groups(&self) -> bool {
        true
    }

    fn run(&mut self, part: Part, given: u32, returned: &mut [u32], step: &mut Step<'_, L>) {
        self.tested += usize::from(part.op == Op::Near);
        Kernels.run(part, given, returned, step);
    }
}

/// One step of the worlds' contacts in a workspace that has seen other steps, and in a new one.
fn check_contacts<L: LaneQuery>(
    name: &str,
    executor: &mut dyn Executor<L>,
    tables: &Tables<L::Real>,
    state: &State<L>,
    used: &mut Workspace<L>,
) {
    let mut fresh = Workspace::new(tables);
    step_by(executor, tables, state, used, true);
    step(tables, state, &mut fresh);
    assert_eq!(used.collision.slots, fresh.collision.slots, "{name}");
    for (a, b) in used.collision.contacts().zip(fresh.collision.contacts()) {
        for lane in 0..L::WIDTH {
            let bits = |contact: Contact<'_, L>| contact.0.map(|x| x.get(lane).bits());
            assert_eq!(bits(a), bits(b), "{name} lane {lane}");
        }
    }
}

/// Pairs that were far are passed over until they may be near: worlds that creep, leap, or become numbers again have the
/// contacts that a new workspace finds.
fn far_pairs_are_not_missed<L: LaneQuery>(tables: fn(&Model) -> &Arc<Tables<L::Real>>) {
    let (mut contacts, mut tested, mut all) = (0, 0, 0);
    for name in all_models() {
        let model = load(&name);
        let tables = tables(&model);
        let mut random = Random(21);
        let mut worlds: Vec<World> = (0..L::WIDTH).map(|_| world(&model, &mut random)).collect();
        let mut used = Workspace::<L>::new(tables);
        let mut grouped = Workspace::<L>::new(tables);
        let mut code = Grouped { tested: 0 };
        // Many groups, whatever the number of pairs.
        let pairs = grouped.collision.groups.concat();
        grouped.collision.groups = pairs.chunks(5).map(<[u32]>::to_vec).collect();
        for round in 0..60 {
            let size = [0.0002, 0.02, 0.1][round / 10 % 3];
            for world in &mut worlds {
                world.qpos.iter_mut().for_each(|q| *q += random.uniform(-size, size));
            }
            match round {
                33 => worlds[0].qpos.fill(f64::NAN),
                36 => worlds[0] = world(&model, &mut random),
                45 => worlds.iter_mut().for_each(|w| *w = world(&model, &mut random)),
                _ => {}
            }
            let state = state::<L>(tables, &worlds);
            check_contacts(&format!("{name} round {round}"), &mut Kernels, tables, &state, &mut used);
            check_contacts(&format!("{name} round {round}, groups"), &mut code, tables, &state, &mut grouped);
            contacts += used.collision.slots.len();
            all += grouped.collision.groups.len();
        }
        tested += code.tested;
    }
    assert!(contacts > 10_000, "only {contacts} contacts");
    assert!(10 * tested < 9 * all, "{tested} of {all} groups were tested");
}

#[test]
fn far_pairs_are_not_missed_f64() {
    far_pairs_are_not_missed::<f64x8>(Model::tables);
}

#[test]
fn far_pairs_are_not_missed_f32() {
    far_pairs_are_not_missed::<f32x16>(Model::tables_f32);
}

/// The state of a world and everything that follows from it, one world at a time.
fn forward(model: &Model, world: &World) -> Workspace<f64> {
    let tables = model.tables();
    let mut ws = Workspace::new(tables);
    step_by(&mut Kernels, tables, &state::<f64>(tables, std::slice::from_ref(world)), &mut ws, false);
    ws
}

fn dense(tables: &Tables<f64>, m: &[f64]) -> Vec<Vec<f64>> {
    let nv = tables.sizes.nv;
    let unit = |i: usize| (0..nv).map(|j| f64::from(u8::from(i == j))).collect::<Vec<f64>>();
    let column = |i: usize| {
        let mut out = vec![0.0; nv];
        ldl::multiply(&tables.rows, &tables.tree_pattern, m, &unit(i), &mut out);
        out
    };
    (0..nv).map(column).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Poses only.
/// Whether tendons have armature: of what that couples, M leaves out what is between branches, as in MuJoCo.
fn heavy(model: &Model) -> bool {
    model.tables().tendons.iter().any(|tendon| tendon.heavy)
}

fn pose(tables: &Tables<f64>, qpos: &[f64]) -> Position<f64> {
    let mut position = Position::new(&tables.sizes);
    kinematics(tables.into(), qpos.into(), &mut position);
    position
}

/// qpos moved by `v` for a time `h`.
fn moved(tables: &Tables<f64>, qpos: &[f64], v: &[f64], h: f64) -> Vec<f64> {
    let mut out = vec![0.0; qpos.len()];
    integration::advance(tables, [qpos, &[]], v, h, [&mut out, &mut []]);
    out
}

/// ½ vᵀ M v, by the composite inertias, is the sum of the links' ½ vᵀ I v, by the recursion of velocities, and of what
/// armatures store. For every velocity, so for every entry of M.
#[test]
fn kinetic_energy_is_that_of_the_links() {
    for name in all_models() {
        let model = load(&name);
        if heavy(&model) {
            continue;
        }
        let tables = model.tables();
        let mut random = Random(12);
        for _ in 0..3 {
            let world = world(&model, &mut random);
            let ws = forward(&model, &world);
            let mut of_links: f64 =
                0.5 * tables.dofs.iter().zip(&world.qvel).map(|(dof, v)| dof.armature * v * v).sum::<f64>();
            for (inertia, v) in ws.inertia.link.iter().zip(&ws.velocity.cvel) {
                of_links += 0.5 * spatial::dot6(v, &spatial::inertia_mul(inertia, v));
            }
            assert_agree(&format!("{name} kinetic energy"), &ws.energy.kinetic, &[of_links], 1e-12, 1e-6);
        }
    }
}

/// M a₀ is the smooth force again.
#[test]
fn the_smooth_acceleration_solves_its_equation() {
    for name in all_models() {
        let model = load(&name);
        let ws = forward(&model, &world(&model, &mut Random(13)));
        let discrete = model.tables().options.integrator == Integrator::Discrete;
        let rows = dense(model.tables(), if discrete { &ws.derivative.metric } else { &ws.inertia.m });
        let force: Vec<f64> = rows.iter().map(|row| dot(row, &ws.acceleration.qacc_smooth)).collect();
        // Backward error: relative to the largest product in the sum, not to the sum.
        let size =
            rows.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs())) * support::largest(&ws.acceleration.qacc_smooth);
        assert_agree(&format!("{name} M a"), &force, &ws.acceleration.qfrc_smooth, 1e-12, size);
    }
}

/// Accelerations by articulated bodies are those by the factor of the inertia matrix, whichever of the two a model takes; M and a
/// second diagonal, too. Long chains take the former.
#[test]
fn articulated_bodies_accelerate_as_the_matrix_says() {
    for name in all_models() {
        let model = load(&name);
        if heavy(&model) {
            continue;
        }
        let (tables, world) = (model.tables(), world(&model, &mut Random(31)));
        let ws = forward(&model, &world);
        let nv = tables.sizes.nv;
        for more in [0.0, 0.7] {
            let mut m = ws.inertia.m.clone();
            (0..nv).for_each(|i| m[tables.rows.diagonal(i)] += more);
            let (mut inverse, mut scratch) = (vec![0.0; nv], vec![0.0; nv]);
            ldl::factor(&tables.rows, &tables.tree_pattern, &mut m, &mut inverse, &mut scratch);
            let mut expected = ws.acceleration.qfrc_smooth.clone();
            ldl::solve(&tables.rows, &tables.tree_pattern, &m, &inverse, &mut expected);
            let (mut body, mut force) =
                (vec![[f64::NAN; 21]; tables.links.len()], vec![[f64::NAN; 6]; tables.links.len()]);
            let (mut column, mut inverse) = (vec![[f64::NAN; 6]; nv], vec![f64::NAN; nv]);
            let scratch = Scratch { body: &mut body, force: &mut force, column: &mut column, inverse: &mut inverse };
            let mut found = ws.acceleration.qfrc_smooth.clone();
            let diagonal = |i: usize| tables.dofs[i].armature + more;
            let singular =
                articulated::solve(tables, &ws.position.cdof, &ws.inertia.link, diagonal, scratch, &mut found);
            assert!(!singular, "{name}");
            assert_agree(&format!("{name} + {more}"), &found, &expected, 1e-9, support::largest(&expected));
        }
    }
    let takes = |name: &str| load(name).tables().features.articulated;
    assert!(takes("zoo/chain31") && !takes("zoo/hand32") && !takes("zoo/isolated34") && !takes("zoo/humanoid27"));
}

/// Tendons at a state.
fn lines(tables: &Tables<f64>, position: &Position<f64>, qpos: &[f64], qvel: &[f64]) -> Tendons<f64> {
    let mut tendons = Tendons::new(&tables.sizes);
    tendon::tendons(tables, position, qpos, qvel, &mut tendons);
    tendons
}

fn bias(tables: &Tables<f64>, qpos: &[f64], qvel: &[f64]) -> Vec<f64> {
    let position = pose(tables, qpos);
    let mut inertia = inertia::Inertia::new(&tables.sizes);
    inertia::crb(tables.into(), &position, &lines(tables, &position, qpos, qvel), &mut inertia);
    let mut velocity = velocity::Velocity::new(&tables.sizes);
    velocity::rne(tables.into(), (&position, &lines(tables, &position, qpos, qvel), &inertia), qvel, &mut velocity);
    velocity.qfrc_bias
}

fn inertia_matrix(tables: &Tables<f64>, qpos: &[f64]) -> Vec<Vec<f64>> {
    let mut inertia = inertia::Inertia::new(&tables.sizes);
    let position = pose(tables, qpos);
    let still = vec![0.0; tables.sizes.nv];
    inertia::crb(tables.into(), &position, &lines(tables, &position, qpos, &still), &mut inertia);
    dense(tables, &inertia.m)
}

/// Lagrange's equations: where every joint is a hinge or a slide, the bias force without gravity is made of derivatives of M
/// by positions, cᵢ = Σ (∂M_ij/∂q_k - ½ ∂M_jk/∂q_i) v_j v_k.
#[test]
fn the_bias_force_follows_from_the_inertia_matrix() {
    const STEP: f64 = 1e-5;
    let mut checked = 0;
    for name in all_models() {
        let model = load_with(&name, &[("gravity", "0 0 0")]);
        let tables = model.tables();
        let nv = tables.sizes.nv;
        if tables.sizes.nq != nv {
            continue;
        }
        checked += 1;
        let World { qpos, qvel: v, .. } = world(&model, &mut Random(14));
        let derivative = |k: usize| {
            let at = |h: f64| {
                let mut q = qpos.clone();
                q[k] += h;
                inertia_matrix(tables, &q)
            };
            let (plus, minus) = (at(STEP), at(-STEP));
            let row = |(p, m): (&Vec<f64>, &Vec<f64>)| {
                p.iter().zip(m).map(|(p, m)| (p - m) / (2.0 * STEP)).collect::<Vec<f64>>()
            };
            plus.iter().zip(&minus).map(row).collect::<Vec<Vec<f64>>>()
        };
        let by: Vec<Vec<Vec<f64>>> = (0..nv).map(derivative).collect();
        let expected: Vec<f64> = (0..nv)
            .map(|i| {
                let turning: f64 = (0..nv).map(|k| dot(&by[k][i], &v) * v[k]).sum();
                let pulling: f64 = (0..nv).map(|j| dot(&by[i][j], &v) * v[j]).sum();
                turning - 0.5 * pulling
            })
            .collect();
        // Central differences: 1e-10 from the step's square, 1e-11 from rounding.
        assert_agree(&format!("{name} bias"), &bias(tables, &qpos, &v), &expected, 1e-7, 1e-3);
    }
    assert!(checked > 20, "only {checked} models without quaternions");
}

/// Power: what bias and gravity do along the motion is what energies lose, with every kind of joint.
#[test]
fn the_bias_force_conserves_energy() {
    const STEP: f64 = 1e-5;
    for name in all_models() {
        let model = load_with(&name, &[("spring", "disable")]);
        if heavy(&model) {
            continue;
        }
        let tables = model.tables();
        let World { qpos, qvel: v, .. } = world(&model, &mut Random(15));
        // With no force but the bias, M v' = -c, the energy stands still: d/dt (½ vᵀMv + V) = ½ vᵀM'v + V' - vᵀc = 0.
        let energy = |h: f64| {
            let q = moved(tables, &qpos, &v, h);
            let ws = forward(&model, &World { qpos: q.clone(), qvel: v.clone(), ctrl: vec![0.0; tables.sizes.nu] });
            ws.energy.kinetic[0] + ws.energy.potential[0]
        };
        let rate = (energy(STEP) - energy(-STEP)) / (2.0 * STEP);
        let power = dot(&bias(tables, &qpos, &v), &v);
        assert_agree(&format!("{name} power"), &[power], &[rate], 1e-6, 1.0);
    }
}

/// Axes of dofs are the rates of the poses.
#[test]
fn dof_axes_are_derivatives_of_poses() {
    const STEP: f64 = 1e-6;
    for name in all_models() {
        let model = load(&name);
        let tables = model.tables();
        let qpos = world(&model, &mut Random(16)).qpos;
        let now = pose(tables, &qpos);
        for dof in 0..tables.sizes.nv {
            let mut v = vec![0.0; tables.sizes.nv];
            v[dof] = 1.0;
            let (plus, minus) =
                (pose(tables, &moved(tables, &qpos, &v, STEP)), pose(tables, &moved(tables, &qpos, &v, -STEP)));
            for (l, link) in tables.links.iter().enumerate() {
                let tree = link.tree as usize;
                let moves = moves(tables, dof, l);
                let at = |p: &Position<f64>, k: usize| p.pos[l][k] + p.origin[tree][k];
                let shift: Vec<f64> = (0..3).map(|k| (at(&plus, k) - at(&minus, k)) / (2.0 * STEP)).collect();
                let turn: Vec<f64> = (0..9).map(|k| (plus.rot[l][k] - minus.rot[l][k]) / (2.0 * STEP)).collect();
                let s = if moves { now.cdof[dof] } else { [0.0; 6] };
                // v + ω × position.
                let p = &now.pos[l];
                let turned = |k: usize| s[(k + 1) % 3] * p[(k + 2) % 3] - s[(k + 2) % 3] * p[(k + 1) % 3];
                let expected_shift: Vec<f64> = (0..3).map(|k| s[3 + k] + turned(k)).collect();
                let r = &now.rot[l];
                // ω × each column.
                let expected_turn: Vec<f64> = (0..9)
                    .map(|k| {
                        let (i, j) = (k / 3, k % 3);
                        s[(i + 1) % 3] * r[3 * ((i + 2) % 3) + j] - s[(i + 2) % 3] * r[3 * ((i + 1) % 3) + j]
                    })
                    .collect();
                assert_agree(&format!("{name} dof {dof} link {l} position"), &shift, &expected_shift, 1e-8, 1.0);
                assert_agree(&format!("{name} dof {dof} link {l} rotation"), &turn, &expected_turn, 1e-8, 1.0);
            }
        }
    }
}

/// Whether a dof moves a link.
fn moves(tables: &Tables<f64>, dof: usize, mut link: usize) -> bool {
    loop {
        if tables.dofs[dof].link as usize == link {
            return true;
        }
        match tables.links[link].parent {
            NONE => return false,
            parent => link = parent as usize,
        }
    }
}

/// Momentum of all links (angular about the world's origin; linear).
fn momentum(tables: &Tables<f64>, qpos: &[f64], qvel: &[f64]) -> [f64; 6] {
    let model_position = pose(tables, qpos);
    let mut inertia = inertia::Inertia::new(&tables.sizes);
    let tendons = lines(tables, &model_position, qpos, qvel);
    inertia::crb(tables.into(), &model_position, &tendons, &mut inertia);
    let mut velocity = velocity::Velocity::new(&tables.sizes);
    velocity::rne(tables.into(), (&model_position, &tendons, &inertia), qvel, &mut velocity);
    let mut sum = [0.0; 6];
    for (l, link) in tables.links.iter().enumerate() {
        let h = spatial::inertia_mul(&inertia.link[l], &velocity.cvel[l]);
        let o = position_of(&model_position, link.tree);
        for k in 0..3 {
            let (a, b) = ((k + 1) % 3, (k + 2) % 3);
            sum[k] += h[k] + o[a] * h[3 + b] - o[b] * h[3 + a];
            sum[3 + k] += h[3 + k];
        }
    }
    sum
}

fn position_of(position: &position::Position<f64>, tree: u32) -> [f64; 3] {
    position.origin[tree as usize]
}

/// Nothing from outside acts on a floating body: whatever its joints, motors and self-contacts do, its momentum stays.
#[test]
fn floating_bodies_keep_their_momentum() {
    // Accelerations reach 2000 here, and the difference is off by the square of what they do in a step.
    const STEP: f64 = 1e-6;
    // Converged: the forces of constraints balance as far as the equation is solved.
    let options = [("gravity", "0 0 0"), ("tolerance", "1e-14"), ("ls_tolerance", "1e-6"), ("iterations", "200")];
    for name in ["zoo/humanoid27", "zoo/humanoid18", "zoo/ant"] {
        let model = load_with(name, &options);
        let tables = model.tables();
        let mut random = Random(17);
        for _ in 0..5 {
            let mut start = world(&model, &mut random);
            start.qpos[2] += 10.0;
            let ws = forward(&model, &start);
            let a = &ws.solver.fields.qacc;
            let at = |h: f64| {
                let v: Vec<f64> = start.qvel.iter().zip(a).map(|(v, a)| v + h * a).collect();
                let mean: Vec<f64> = start.qvel.iter().zip(a).map(|(v, a)| v + 0.5 * h * a).collect();
                momentum(tables, &moved(tables, &start.qpos, &mean, h), &v)
            };
            let (plus, minus) = (at(STEP), at(-STEP));
            let rate: Vec<f64> = plus.iter().zip(minus).map(|(p, m)| (p - m) / (2.0 * STEP)).collect();
            let size = support::largest(&ws.acceleration.qfrc_smooth).max(1.0);
            assert_agree(&format!("{name} momentum's rate"), &rate, &[0.0; 6], 1e-6, size);
        }
    }
}
