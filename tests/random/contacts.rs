//! The solvers' answers on random heaps of bodies: optimality conditions, agreement, independence of start and neighbours.

use lanesim::worlds::Field;
use lanesim::{Backend, Precision};
use lanesim_kernels::options::Solver;
use proptest::prelude::{TestCaseError, prop_assert, prop_assert_eq, prop_assume, proptest};

use super::recipe::{HeapRecipe, heap};
use super::{State, config, evaluate, forward, minus, norm, times, worlds};
use crate::support::{Random, options};

/// Worlds per model.
const WORLDS: usize = 9;
const SOLVERS: [Solver; 3] = [Solver::Newton, Solver::Cg, Solver::Pgs];
/// What MuJoCo calls the rows of elliptic contacts, and of dry friction.
const ELLIPTIC: f64 = 7.0;
const DRY: f64 = 1.0;

/// How well a converged solver satisfies a condition, relative to the sizes of what cancels. Sweeps of Gauss-Seidel converge
/// linearly, slowly where bodies press on each other from many sides.
fn tolerance(solver: Solver) -> f64 {
    if solver == Solver::Pgs { 1e-6 } else { 1e-9 }
}

fn states(recipe: &HeapRecipe) -> Vec<State> {
    let model = recipe.model(Solver::Newton);
    let mut random = Random(recipe.seed);
    (0..WORLDS).map(|_| State::random(&model, 0.3, 0.01, 0.5, &mut random)).collect()
}

/// Constraint rows of one world, and everything that optimality is about.
struct Rows<'a> {
    kind: &'a [f64],
    force: &'a [f64],
    /// J a - a_ref + R f: where it is zero the force is free.
    residual: Vec<f64>,
    /// First row, dimension and friction of elliptic contacts.
    cones: Vec<(usize, usize, &'a [f64])>,
    /// Size of the velocities and of the forces.
    sizes: (f64, f64),
}

const FIELDS: [&str; 14] = [
    "qM",
    "qacc",
    "qacc_smooth",
    "qfrc_constraint",
    "efc_J",
    "efc_R",
    "efc_aref",
    "efc_type",
    "efc_force",
    "contact_efc",
    "contact_dim",
    "contact_friction",
    "status",
    "nefc",
];

impl<'a> Rows<'a> {
    fn new(found: &'a [Vec<f64>]) -> Rows<'a> {
        let [_, qacc, smooth, _, j, r, aref, kind, force, efc, dim, friction, ..] = found else { panic!("the fields") };
        let y = minus(&times(j, qacc), aref);
        let residual = y.iter().zip(r.iter().zip(force)).map(|(y, (r, f))| y + r * f).collect();
        let elliptic = |c: &usize| efc[*c] >= 0.0 && kind[efc[*c] as usize] == ELLIPTIC;
        let cone = |c: usize| (efc[c] as usize, dim[c] as usize, &friction[5 * c..5 * c + 5]);
        let cones = (0..efc.len()).filter(elliptic).map(cone).collect();
        let sizes = (norm(&y) + norm(&times(j, smooth)) + norm(aref), norm(force) + 1.0);
        Rows { kind, force, residual, cones, sizes }
    }

    /// Forces within their cones, residuals within the dual cones, and nothing of one along the other.
    fn check(&self, tolerance: f64, bound: f64) -> Result<(), TestCaseError> {
        let (speed, push) = (tolerance * self.sizes.0, tolerance * self.sizes.1);
        let mut work = 0.0;
        for (i, (f, r)) in self.force.iter().zip(&self.residual).enumerate() {
            if self.kind[i] == ELLIPTIC {
                work += f * r;
            } else if self.kind[i] == DRY {
                prop_assert!(f.abs() <= bound * (1.0 + tolerance), "dry friction {f} beyond {bound}");
                let free = f.abs() < bound * (1.0 - tolerance);
                prop_assert!(if free { r.abs() <= speed } else { r * f <= speed * bound }, "row {i}: {r} at {f}");
            } else {
                prop_assert!(*f >= -push && *r >= -speed, "row {i}: force {f}, residual {r}");
                work += f * r;
            }
        }
        for (start, dim, friction) in &self.cones {
            let side = |x: &[f64], scale: &dyn Fn(f64) -> f64| {
                norm(&(1..*dim).map(|k| x[start + k] * scale(friction[k - 1])).collect::<Vec<_>>())
            };
            let (f, r) = (self.force[*start], self.residual[*start]);
            let (slip, pull) = (side(self.force, &|mu| 1.0 / mu), side(&self.residual, &|mu| mu));
            prop_assert!(slip <= f + push, "force {f} with {slip} to the side");
            prop_assert!(pull <= r + speed, "residual {r} with {pull} to the side");
        }
        prop_assert!(work.abs() <= tolerance * self.sizes.0 * self.sizes.1, "forces and residuals: {work:e}");
        Ok(())
    }
}

proptest! {
    #![proptest_config(config(60))]

    #[test]
    fn solutions_satisfy_the_optimality_conditions(recipe in heap()) {
        let states = states(&recipe);
        for solver in SOLVERS {
            let model = recipe.model(solver);
            let found = evaluate(&model, &states, &FIELDS, &options(Precision::F64, Backend::Wide));
            prop_assume!(found.iter().any(|world| world[13][0] > 0.0));
            for world in found.iter().filter(|world| world[13][0] > 0.0) {
                let inertial = times(&world[0], &minus(&world[1], &world[2]));
                let size = norm(&world[3]) + norm(&times(&world[0], &world[2]));
                let left = norm(&minus(&inertial, &world[3])) / size;
                prop_assert!(left <= tolerance(solver), "{solver:?}: gradient {left:e}");
                Rows::new(world).check(tolerance(solver), 0.05)
                    .map_err(|e| TestCaseError::fail(format!("{solver:?}: {e}")))?;
            }
        }
    }

    #[test]
    fn solvers_agree(recipe in heap()) {
        let states = states(&recipe);
        let solve = |solver| {
            let model = recipe.model(solver);
            evaluate(&model, &states, &["qacc", "qacc_smooth"], &options(Precision::F64, Backend::Wide))
        };
        let newton = solve(Solver::Newton);
        for solver in [Solver::Cg, Solver::Pgs] {
            for (ours, exact) in solve(solver).iter().zip(&newton) {
                let error = norm(&minus(&ours[0], &exact[0])) / (norm(&exact[0]) + norm(&exact[1]));
                prop_assert!(error <= tolerance(solver), "{solver:?}: {error:e}");
            }
        }
    }

    #[test]
    fn the_start_does_not_matter(recipe in heap()) {
        let states = states(&recipe);
        let mut random = Random(!recipe.seed);
        for solver in SOLVERS {
            let model = recipe.model(solver);
            let mut worlds = worlds(&model, &states, &options(Precision::F64, Backend::Wide));
            let cold = forward(&mut worlds, &["qacc", "qacc_smooth"]);
            for (world, found) in cold.iter().enumerate() {
                let size = norm(&found[0]) / (found[0].len() as f64).sqrt();
                let near: Vec<f64> = found[0].iter().zip(&found[1]).map(|(a, a0)| a - a0).collect();
                let start: Vec<f64> = near.iter().map(|a| a + random.uniform(-0.3, 0.3) * size).collect();
                worlds.set(Field::QaccWarmstart, world, &start).map_err(|e| TestCaseError::fail(e.to_string()))?;
            }
            for (warm, cold) in forward(&mut worlds, &["qacc"]).iter().zip(&cold) {
                let error = norm(&minus(&warm[0], &cold[0])) / (norm(&cold[0]) + norm(&cold[1]));
                prop_assert!(error <= tolerance(solver), "{solver:?}: {error:e}");
            }
        }
    }

    /// Places and neighbours change no bits, nor do lanes: several steps with default settings of the solver.
    #[test]
    fn worlds_do_not_see_each_other(recipe in heap()) {
        let states = states(&recipe);
        let reversed: Vec<State> = states.iter().rev().cloned().collect();
        for (solver, precision) in SOLVERS.into_iter().flat_map(|s| [(s, Precision::F32), (s, Precision::F64)]) {
            let model = recipe.model_as_usual(solver);
            let run = |states: &[State], backend| {
                let mut worlds = worlds(&model, states, &options(precision, backend));
                let result = worlds.step(6).map(|()| [worlds.get_all(Field::Qpos), worlds.get_all(Field::Qvel)]);
                result.map_err(|e| TestCaseError::fail(e.to_string()))
            };
            let (there, back) = (run(&states, Backend::Wide)?, run(&reversed, Backend::Wide)?);
            prop_assert_eq!(&there, &run(&states, Backend::Scalar)?, "{:?}: lanes", solver);
            for (there, back) in there.iter().zip(&back) {
                let width = there.len() / WORLDS;
                let back: Vec<f64> = back.chunks(width).rev().flatten().copied().collect();
                prop_assert_eq!(there, &back, "{:?}: order", solver);
            }
        }
    }
}

/// The heaps touch: most worlds have contacts, some of them between bodies.
#[test]
fn heaps_touch() {
    use proptest::strategy::{Strategy, ValueTree};
    use proptest::test_runner::TestRunner;
    let mut runner = TestRunner::new(config(1));
    let (mut floor, mut between, mut total) = (0, 0, 0);
    for _ in 0..40 {
        let recipe = heap().new_tree(&mut runner).expect("a heap").current();
        let found = evaluate(
            &recipe.model(Solver::Newton),
            &states(&recipe),
            &["contact_geom"],
            &options(Precision::F64, Backend::Wide),
        );
        for world in found {
            let pairs: Vec<&[f64]> = world[0].chunks(2).collect();
            total += 1;
            floor += usize::from(pairs.iter().any(|pair| pair[0] == 0.0));
            between += usize::from(pairs.iter().any(|pair| pair[0] > 0.0));
        }
    }
    println!("{floor} on the floor and {between} on each other of {total}");
    assert!(floor > total / 2 && between > total / 4, "{floor} and {between} of {total}");
}
