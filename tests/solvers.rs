//! The solvers alone: every pair of shapes, cone and contact dimension, dry friction, limits and all parameters of contacts,
//! against the minimiser that `tests/goldens/make_solver.py` recorded.

use std::collections::BTreeMap;

use crate::support;
use crate::support::golden::Failures;
use crate::support::{agree, load, options, repository};
use lanesim::eval::eval;
use lanesim::mjcf::LoadOptions;
use lanesim::npz::{self, Array};
use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Model, Options, Precision, Rollout, Worlds};

const CONES: [&str; 2] = ["pyramidal", "elliptic"];
const DIMENSIONS: [u32; 4] = [1, 3, 4, 6];

/// A solver, set to go as far as its arithmetic allows, and how close it comes.
struct Solver {
    name: &'static str,
    iterations: &'static str,
    tolerance: &'static str,
    /// Relative error of accelerations and forces.
    close: f64,
    /// In single precision: the same at the 99th percentile.
    single: f64,
}

/// Rounding in a system whose condition number, with the stiffness of contacts, reaches 1e6.
const NEWTON: Solver = Solver { name: "Newton", iterations: "200", tolerance: "1e-14", close: 1e-9, single: 1e-4 };
const CG: Solver = Solver { name: "CG", iterations: "5000", tolerance: "1e-14", close: 1e-9, single: 1e-4 };
const PGS: Solver = Solver { name: "PGS", iterations: "20000", tolerance: "1e-22", close: 1e-9, single: 1e-4 };

/// A scene with one cone and dimension, and its states.
struct Case {
    name: String,
    scene: String,
    variant: String,
    text: String,
    arrays: BTreeMap<String, Array>,
}

impl Case {
    /// All scenes in all variants.
    fn all() -> Vec<Case> {
        let variants = |scene: String| {
            CONES.iter().flat_map(|cone| DIMENSIONS.map(|dim| (cone, dim))).map(move |(cone, dim)| {
                let file = repository("tests/goldens/solver").join(format!("{scene}.npz"));
                let arrays = npz::read(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
                let variant = format!("{cone}{dim}");
                Case {
                    name: format!("{scene} {variant}"),
                    text: text(&scene, cone, dim),
                    scene: scene.clone(),
                    variant,
                    arrays,
                }
            })
        };
        scenes().into_iter().flat_map(variants).collect()
    }

    /// The model with a solver's settings, but for those of the other options.
    fn model(&self, solver: &Solver, others: &[(&str, &str)]) -> Model {
        let mut overrides = vec![
            ("solver", solver.name),
            ("iterations", solver.iterations),
            ("tolerance", solver.tolerance),
            ("ls_tolerance", "1e-6"),
        ];
        overrides.retain(|(name, _)| others.iter().all(|(other, _)| name != other));
        overrides.extend(others);
        let overrides = overrides.iter().map(|(k, v)| ((*k).to_string(), (*v).to_string())).collect();
        let options = LoadOptions { overrides, ..LoadOptions::default() };
        Model::from_xml_string(&self.text, &options).unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }

    /// A recorded array, state by state.
    fn rows(&self, name: &str) -> Vec<Vec<f64>> {
        self.arrays.get(name).map_or(vec![vec![]; self.states()], |array| split(array, self.states()))
    }

    /// An array of this variant.
    fn own(&self, name: &str) -> Vec<Vec<f64>> {
        self.rows(&format!("{}/{name}", self.variant))
    }

    fn states(&self) -> usize {
        self.arrays["in/qpos"].shape()[0]
    }

    /// Our fields, state by state.
    fn eval(&self, model: &Model, fields: &[&str], options: &Options) -> BTreeMap<String, Vec<Vec<f64>>> {
        let input = |(name, array): (&String, &Array)| Some((name.strip_prefix("in/")?.to_string(), array.clone()));
        let inputs = self.arrays.iter().filter_map(input).collect();
        let found = eval(model, &inputs, fields, 0, options).unwrap_or_else(|e| panic!("{}: {e}", self.name));
        found.into_iter().map(|(name, array)| (name, split(&array, self.states()))).collect()
    }
}

/// Names of the scenes.
fn scenes() -> Vec<String> {
    let files = std::fs::read_dir(repository("models/solver")).expect("the scenes");
    let name = |path: std::path::PathBuf| path.file_stem().map(|s| s.to_string_lossy().into_owned());
    let mut names: Vec<String> = files.filter_map(|file| name(file.ok()?.path())).collect();
    names.sort();
    names
}

/// A scene's text with another cone and dimension.
fn text(scene: &str, cone: &str, dim: u32) -> String {
    let path = repository("models/solver").join(format!("{scene}.xml"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    text.replace("cone=\"pyramidal\"", &format!("cone=\"{cone}\""))
        .replace("condim=\"3\"", &format!("condim=\"{dim}\""))
}

fn split(array: &Array, states: usize) -> Vec<Vec<f64>> {
    let values = array.to_f64();
    let width = values.len() / states;
    (0..states).map(|i| values[i * width..(i + 1) * width].to_vec()).collect()
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// |ours - theirs| / (|theirs| + |smooth|)
fn relative(ours: &[f64], theirs: &[f64], smooth: &[f64]) -> f64 {
    let difference: Vec<f64> = ours.iter().zip(theirs).map(|(a, b)| a - b).collect();
    norm(&difference) / (norm(theirs) + norm(smooth))
}

/// Relative errors of the accelerations of every case and state.
fn accelerations(solver: &Solver, options: &Options) -> Vec<(String, String, f64)> {
    let mut errors = Vec::new();
    for case in Case::all() {
        let ours = case.eval(&case.model(solver, &[]), &["qacc"], options);
        let (theirs, smooth) = (case.own("qacc"), case.rows("out/qacc_smooth"));
        for state in 0..case.states() {
            let error = relative(&ours["qacc"][state], &theirs[state], &smooth[state]);
            errors.push((format!("{} state {state}", case.name), case.variant.clone(), error));
        }
    }
    errors
}

/// The worst error of each cone and dimension, for whoever reads the test's output.
fn print_worst(solver: &Solver, errors: &[(String, String, f64)]) {
    let mut worst: BTreeMap<&str, f64> = BTreeMap::new();
    for (_, variant, error) in errors {
        let entry = worst.entry(variant).or_default();
        *entry = entry.max(*error);
    }
    let worst: Vec<String> = worst.iter().map(|(variant, error)| format!("{variant} {error:.0e}")).collect();
    println!("{}: {}", solver.name, worst.join(", "));
}

#[track_caller]
fn assert_close(solver: &Solver) {
    let errors = accelerations(solver, &options(Precision::F64, Backend::Wide));
    print_worst(solver, &errors);
    let mut failures = Failures::default();
    for (place, _, error) in errors {
        let good = error <= solver.close;
        failures.check(|| place, if good { Ok(error) } else { Err(format!(": {error:.1e}")) });
    }
    failures.report();
}

#[test]
fn newton_finds_the_minimiser() {
    assert_close(&NEWTON);
}

#[test]
fn conjugate_gradients_find_the_minimiser() {
    assert_close(&CG);
}

#[test]
fn projected_gauss_seidel_finds_the_minimiser() {
    assert_close(&PGS);
}

/// Rounding the recorded inputs alone moves the minimiser by up to 1.5e-6 in the median and 2e-5 at the 99th percentile.
#[test]
fn single_precision_stays_near() {
    const MEDIAN: f64 = 5e-6;
    for solver in [NEWTON, CG, PGS] {
        let mut errors = accelerations(&solver, &options(Precision::F32, Backend::Wide));
        print_worst(&solver, &errors);
        errors.sort_by(|a, b| a.2.total_cmp(&b.2));
        let at = |part: f64| &errors[((errors.len() - 1) as f64 * part) as usize];
        println!("median {:?}, 99 % {:?}, worst {:?}", at(0.5), at(0.99), at(1.0));
        assert!(at(0.5).2 <= MEDIAN, "{}: median {:.1e}", solver.name, at(0.5).2);
        assert!(at(0.99).2 <= solver.single, "{}: 99th percentile {:.1e} ({})", solver.name, at(0.99).2, at(0.99).0);
    }
}

/// Code made for a model finds what the kernels find, bit for bit, whatever the contacts.
#[test]
fn code_finds_the_same() {
    let fields = ["qacc", "qfrc_constraint", "efc_force"];
    for case in Case::all() {
        for (solver, precision) in [(&NEWTON, Precision::F64), (&NEWTON, Precision::F32), (&CG, Precision::F32)] {
            let model = case.model(solver, &[("iterations", "20")]);
            let [wide, native] = [Backend::Wide, Backend::Native]
                .map(|backend| case.eval(&model, &fields, &options(precision, backend)));
            assert!(wide == native, "{} {} {precision:?}", solver.name, case.name);
        }
    }
}

/// Row forces, each beside the recorded row it belongs to, and the generalised force that they add up to.
#[test]
fn forces_are_the_minimisers() {
    let fields = ["efc_force", "qfrc_constraint", "ncon", "nefc", "contact_geom", "contact_pos", "contact_efc"];
    let mut failures = Failures::default();
    for case in Case::all() {
        let dimension = case.variant.trim_start_matches(|c: char| c.is_alphabetic());
        let condim: usize = dimension.parse().expect("a dimension");
        let rows = if condim > 1 && case.variant.starts_with("pyramidal") { 2 * (condim - 1) } else { condim };
        for solver in [&NEWTON, &CG, &PGS] {
            let ours = case.eval(&case.model(solver, &[]), &fields, &options(Precision::F64, Backend::Wide));
            let (theirs, generalised) = (case.own("efc_force"), case.own("qfrc_constraint"));
            for state in 0..case.states() {
                let place = || format!("{} {} state {state} ", solver.name, case.name);
                let order = match row_order(&case, &ours, state, rows) {
                    Ok(order) => order,
                    Err(message) => {
                        failures.check(place, Err(message));
                        continue;
                    }
                };
                let force: Vec<f64> = order.iter().map(|row| ours["efc_force"][state][*row]).collect();
                let expected = &theirs[state][..order.len()];
                failures.check(place, agree(&force, expected, solver.close, 1.0));
                let found = &ours["qfrc_constraint"][state];
                failures.check(place, agree(found, &generalised[state], solver.close, 1.0));
            }
        }
    }
    failures.report();
}

/// For each recorded row, ours. Contacts of a pair may come in another order.
fn row_order(
    case: &Case,
    ours: &BTreeMap<String, Vec<Vec<f64>>>,
    state: usize,
    rows: usize,
) -> Result<Vec<usize>, String> {
    let ncon = case.rows("contact/ncon")[state][0] as usize;
    let nefc = case.own("nefc")[state][0] as usize;
    let (our_ncon, our_nefc) = (ours["ncon"][state][0] as usize, ours["nefc"][state][0] as usize);
    if (ncon, nefc) != (our_ncon, our_nefc) {
        return Err(format!("ncon {our_ncon}, nefc {our_nefc} instead of {ncon}, {nefc}"));
    }
    let (geom, pos) = (&case.rows("contact/geom")[state], &case.rows("contact/pos")[state]);
    let (our_geom, our_pos) = (&ours["contact_geom"][state], &ours["contact_pos"][state]);
    let addresses = &case.own("contact_efc")[state];
    let mut order: Vec<usize> = (0..nefc).collect();
    for c in 0..ncon {
        let away = |i: usize| norm(&[0, 1, 2].map(|k| our_pos[3 * i + k] - pos[3 * c + k]));
        let same = |i: &usize| our_geom[2 * i..2 * i + 2] == geom[2 * c..2 * c + 2];
        let nearest = (0..ncon).filter(same).min_by(|a, b| away(*a).total_cmp(&away(*b)));
        let nearest = nearest.ok_or_else(|| format!("no contact of geoms {:?}", &geom[2 * c..2 * c + 2]))?;
        if away(nearest) > 1e-9 {
            return Err(format!("contact {c} is {:.1e} away", away(nearest)));
        }
        let (theirs, own) = (addresses[c], ours["contact_efc"][state][nearest]);
        if (theirs < 0.0) != (own < 0.0) {
            return Err(format!("contact {c} acts on one side only"));
        }
        if theirs >= 0.0 {
            (0..rows).for_each(|r| order[theirs as usize + r] = own as usize + r);
        }
    }
    Ok(order)
}

/// Ten sweeps of the no-slip pass from the minimiser. Not a converged result: MuJoCo takes the same sweeps in the same
/// order, up to rounding and the accuracy of its own start.
#[test]
fn no_slip_pass() {
    const CLOSE: f64 = 1e-4;
    let overrides = [("noslip_iterations", "10"), ("noslip_tolerance", "0")];
    let mut failures = Failures::default();
    for case in Case::all() {
        let name = format!("noslip_{}/qacc", case.variant);
        if !case.arrays.contains_key(&name) {
            continue;
        }
        let smooth = case.rows("out/qacc_smooth");
        for solver in [&NEWTON, &CG, &PGS] {
            let ours = case.eval(&case.model(solver, &overrides), &["qacc"], &options(Precision::F64, Backend::Wide));
            for (state, theirs) in case.rows(&name).iter().enumerate() {
                let error = relative(&ours["qacc"][state], theirs, &smooth[state]);
                let result = if error <= CLOSE { Ok(error) } else { Err(format!(": {error:.1e}")) };
                failures.check(|| format!("{} {} state {state}", solver.name, case.name), result);
            }
        }
    }
    failures.report();
}

/// Whatever a solver is stopped at, the row forces that it reports add up to its generalised force.
#[test]
fn row_forces_of_unfinished_solvers_add_up() {
    const ROUNDING: f64 = 1e-12;
    let settings = [("iterations", "2"), ("noslip_iterations", "2")];
    let mut failures = Failures::default();
    for case in Case::all() {
        for (solver, overrides) in [(&PGS, &settings[..1]), (&PGS, &settings[..]), (&NEWTON, &settings[..])] {
            let fields = ["efc_force", "efc_J", "qfrc_constraint"];
            let ours = case.eval(&case.model(solver, overrides), &fields, &options(Precision::F64, Backend::Wide));
            for (state, expected) in ours["qfrc_constraint"].iter().enumerate() {
                let mut sum = vec![0.0; expected.len()];
                let rows = ours["efc_J"][state].chunks(expected.len());
                for (row, force) in rows.zip(&ours["efc_force"][state]) {
                    sum.iter_mut().zip(row).for_each(|(sum, j)| *sum += j * force);
                }
                let place = || format!("{} {} state {state} ", solver.name, case.name);
                failures.check(place, agree(&sum, expected, ROUNDING, 1.0));
            }
        }
    }
    failures.report();
}

/// What rounding leaves of the gradient does not keep Newton's method at work until the limit of iterations: single precision
/// needs no more of them than double precision, in the slowest world of a block.
#[test]
fn rounding_does_not_keep_newton_busy() {
    for name in ["zoo/humanoid29", "zoo/balls_in_box", "zoo/arm", "zoo/humanoid27"] {
        let iterations = |precision| {
            let mut worlds = Worlds::new(&load(name), 16, &options(precision, Backend::Wide)).expect("worlds");
            let controls = Controls::Noise { seed: 3, scale: 1.0 };
            let rollout = Rollout { nstep: 300, controls, statistics: true, ..Rollout::default() };
            let statistics = worlds.rollout(&rollout).expect("a rollout").statistics;
            statistics.block_iterations / statistics.block_steps
        };
        let (single, double) = (iterations(Precision::F32), iterations(Precision::F64));
        println!("{name}: {single:.2} iterations in single precision, {double:.2} in double");
        // A block of single precision has twice the worlds.
        assert!(single < 1.5 * double + 1.0, "{name}: {single:.2} iterations instead of {double:.2}");
    }
}

/// Largest error of an acceleration from the first state, after so many sweeps, against Newton's solution.
fn sweeping_error(text: &str, sweeps: usize) -> f64 {
    let acceleration = |solver: &str, iterations: usize, tolerance: &str| {
        let option = format!(r#"<option solver="{solver}" iterations="{iterations}" tolerance="{tolerance}""#);
        let model = support::parse(&text.replace("<option", &option));
        let mut worlds = Worlds::new(&model, 1, &options(Precision::F64, Backend::Wide)).expect("a world");
        let mut found = Vec::new();
        worlds
            .forward(&[Output::named("qacc").expect("an output")], &mut |_, fields| found.clone_from(&fields[0]))
            .expect("outputs");
        found
    };
    let (best, found) = (acceleration("Newton", 200, "1e-15"), acceleration("PGS", sweeps, "0"));
    best.iter().zip(found).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Sweeps come as close as MuJoCo's come with their momentum, to a small factor: a box on a box, and ten boxes on one another.
/// The figures are MuJoCo 4.0.0's after 20, 100 and 1000 sweeps.
#[test]
fn pgs_convergence() {
    const FACTOR: f64 = 5.0;
    const ROUNDING: f64 = 1e-9;
    let boxes = |cone: &str, dim: u32| {
        format!(
            r#"<mujoco><option cone="{cone}"/><worldbody><geom type="box" size=".1 .1 .1" condim="{dim}"/>
               <body pos=".02 .03 .19"><freejoint/><geom type="box" size=".1 .12 .1" condim="{dim}"/></body>
               </worldbody></mujoco>"#
        )
    };
    let stack = |cone: &str| {
        let body = |i: usize| {
            let (y, z) = (0.001 * i as f64, 0.0995 + 0.199 * i as f64);
            format!(r#"<body pos="0 {y} {z}"><freejoint/><geom type="box" size=".1 .1 .1"/></body>"#)
        };
        let bodies: String = (0..10).map(body).collect();
        format!(
            r#"<mujoco><option cone="{cone}"/><worldbody><geom type="plane" size="5 5 1"/>{bodies}</worldbody></mujoco>"#
        )
    };
    let cases: [(String, [f64; 3]); 9] = [
        (boxes("pyramidal", 1), [4.4e-2, 6.1e-9, 3.9e-14]),
        (boxes("pyramidal", 3), [1.1e-1, 1.4e-5, 8.4e-14]),
        (boxes("pyramidal", 4), [2.8e-1, 2.5e-5, 4.7e-14]),
        (boxes("pyramidal", 6), [2.9e-1, 1.5e-5, 9.9e-14]),
        (boxes("elliptic", 3), [2.9e-1, 3.6e-4, 8.1e-14]),
        (boxes("elliptic", 4), [3.1e-1, 1.5e-4, 2.1e-14]),
        (boxes("elliptic", 6), [3.1e-1, 1.5e-4, 2.8e-14]),
        (stack("pyramidal"), [2.5, 1.4e-4, 3.6e-13]),
        (stack("elliptic"), [1.2, 1.6e-3, 2.9e-13]),
    ];
    let mut failures = Failures::default();
    for (number, (text, theirs)) in cases.iter().enumerate() {
        let ours = [20, 100, 1000].map(|sweeps| sweeping_error(text, sweeps));
        println!("case {number}: {ours:?}, MuJoCo {theirs:?}");
        for (ours, theirs) in ours.into_iter().zip(*theirs) {
            let good = ours <= FACTOR * theirs.max(ROUNDING);
            failures.check(|| format!("case {number}"), if good { Ok(ours) } else { Err(format!(": {ours:.1e}")) });
        }
    }
    failures.report();
}

#[test]
fn every_scene_is_recorded() {
    let cases = Case::all();
    assert_eq!(cases.len(), scenes().len() * CONES.len() * DIMENSIONS.len());
    for case in cases {
        assert!(case.states() >= 3 && case.own("nefc").iter().all(|n| n[0] > 0.0), "{}", case.scene);
    }
}
