//! Our models against MuJoCo 4.0.0: model arrays, every stage's results at the recorded states, and one step.
//!
//! `tests/goldens/README.md` says what the files hold. A number is judged against the size of its field in its state: the
//! largest entry, or the floor given with the field.

use std::collections::BTreeMap;

use crate::support;
use crate::support::golden::{Failures, Golden};
use crate::support::{agree, all_models, options, repository};
use lanesim::model::ArrayData;
use lanesim::{Backend, Options, Precision};

/// How far results may be from MuJoCo's, relative to the field's size.
struct Tolerances {
    /// Poses and dof axes.
    kinematics: f64,
    /// Inertia, forces, smooth acceleration, energy.
    dynamics: f64,
    /// The smooth acceleration: forces times the inverse of an inertia matrix whose condition number reaches 1e5.
    qacc_smooth: f64,
    /// Contact distance, place and frame.
    contacts: f64,
    /// Rows: Jacobian, position, regulariser, reference.
    rows: f64,
    /// Acceleration, forces of rows.
    solution: f64,
    /// Positions and velocities after a step.
    step: f64,
}

/// Both sides round differently, and that is all.
const F64: Tolerances = Tolerances {
    kinematics: 1e-12,
    dynamics: 1e-11,
    qacc_smooth: 1e-10,
    contacts: 1e-12,
    rows: 1e-10,
    solution: 1e-9,
    step: 1e-10,
};

/// Rounding the input alone gives 6e-8 per number; sums over a tree of thirty links add to that, and differences of nearly
/// equal numbers (distances, velocities of contacts, and the forces and accelerations that follow from them) add more.
const F32: Tolerances = Tolerances {
    kinematics: 2e-6,
    dynamics: 1e-5,
    qacc_smooth: 1e-3,
    contacts: 1e-5,
    rows: 1e-3,
    solution: 3e-3,
    step: 1e-5,
};

/// Compares fields with a fixed shape, in every state of every model. Fields come with tolerance and floor.
#[track_caller]
fn check_fields(options: &Options, fields: &[(&str, f64, f64)]) {
    let names: Vec<&str> = fields.iter().map(|field| field.0).collect();
    let mut failures = Failures::default();
    for golden in Golden::all() {
        let ours = golden.eval(&names, 0, options);
        for (name, tolerance, floor) in fields {
            let expected = golden.rows(&golden.array(&format!("out/{name}")));
            for (state, (got, expected)) in ours[*name].iter().zip(&expected).enumerate() {
                let place = || format!("{} state {state} {name}", golden.name);
                let got = if *name == "xquat" { same_sign(got, expected) } else { got.clone() };
                failures.check(place, agree(&got, expected, *tolerance, *floor));
            }
        }
    }
    failures.report();
}

/// The quaternions, each with the sign that is nearer to the expected one: both stand for the same rotation.
fn same_sign(got: &[f64], expected: &[f64]) -> Vec<f64> {
    let pick = |(q, e): (&[f64], &[f64])| {
        let dot: f64 = q.iter().zip(e).map(|(a, b)| a * b).sum();
        q.iter().map(|x| x * dot.signum()).collect::<Vec<f64>>()
    };
    got.chunks(4).zip(expected.chunks(4)).flat_map(pick).collect()
}

fn kinematics(options: &Options, tolerances: &Tolerances) {
    let t = tolerances.kinematics;
    let fields =
        "xpos xquat xipos subtree_com geom_xpos geom_xmat site_xpos site_xmat cdof ten_length ten_J actuator_length";
    check_fields(options, &fields.split(' ').map(|name| (name, t, 1.0)).collect::<Vec<_>>());
}

fn dynamics(options: &Options, tolerances: &Tolerances) {
    let t = tolerances.dynamics;
    let forces = "ten_velocity qfrc_bias qfrc_passive actuator_force qfrc_actuator energy actuator_velocity act_dot";
    let mut fields: Vec<_> = forces.split(' ').map(|name| (name, t, 1.0)).collect();
    fields.push(("qM", t, 1e-3));
    fields.push(("qacc_smooth", tolerances.qacc_smooth, 1.0));
    check_fields(options, &fields);
}

/// Of actuators that act on more than joints, or have activations.
fn moments(options: &Options, tolerances: &Tolerances) {
    let mut failures = Failures::default();
    for golden in Golden::all().into_iter().filter(|golden| golden.arrays.contains_key("out/actuator_moment")) {
        let ours = golden.eval(&["actuator_moment"], 0, options);
        let expected = golden.rows(&golden.array("out/actuator_moment"));
        for (state, (got, expected)) in ours["actuator_moment"].iter().zip(&expected).enumerate() {
            let place = || format!("{} state {state} actuator_moment", golden.name);
            failures.check(place, agree(got, expected, tolerances.kinematics, 1.0));
        }
    }
    failures.report();
}

/// For each of MuJoCo's contacts, the one of ours between the same geoms that is nearest and not yet taken.
fn match_contacts(geoms: [&[f64]; 2], places: [&[f64]; 2], counts: [usize; 2]) -> Result<Vec<usize>, String> {
    let [ours, theirs] = counts;
    if ours != theirs {
        return Err(format!("ncon is {ours} instead of {theirs}"));
    }
    let mut free: Vec<usize> = (0..ours).collect();
    let mut found = Vec::new();
    for c in 0..theirs {
        let distance = |i: usize| (0..3).map(|k| (places[0][3 * i + k] - places[1][3 * c + k]).powi(2)).sum::<f64>();
        let same = |i: &&usize| geoms[0][2 * **i..2 * **i + 2] == geoms[1][2 * c..2 * c + 2];
        let Some(&best) = free.iter().filter(same).min_by(|a, b| distance(**a).total_cmp(&distance(**b))) else {
            return Err(format!("there is no contact between geoms {:?}", &geoms[1][2 * c..2 * c + 2]));
        };
        free.retain(|i| *i != best);
        found.push(best);
    }
    Ok(found)
}

/// Contacts of one state: ours beside MuJoCo's.
struct Contacts {
    ours: BTreeMap<String, Vec<f64>>,
    theirs: BTreeMap<String, Vec<f64>>,
    matched: Vec<usize>,
}

const CONTACT_FIELDS: [&str; 9] = [
    "ncon",
    "contact_geom",
    "contact_dim",
    "contact_dist",
    "contact_pos",
    "contact_frame",
    "contact_friction",
    "contact_margin",
    "contact_efc",
];
const ROW_FIELDS: [&str; 9] =
    ["nefc", "efc_type", "efc_id", "efc_J", "efc_pos", "efc_D", "efc_R", "efc_aref", "efc_force"];

/// Calls `f` for every state with its contacts and rows; states whose contacts do not match are failures.
fn each_state(options: &Options, failures: &mut Failures, mut f: impl FnMut(&Golden, usize, &Contacts, &mut Failures)) {
    let names: Vec<&str> = CONTACT_FIELDS.into_iter().chain(ROW_FIELDS).collect();
    for golden in Golden::all() {
        let ours = golden.eval(&names, 0, options);
        for state in 0..golden.states() {
            let mine = names.iter().map(|name| (name.to_string(), ours[*name][state].clone())).collect();
            let recorded =
                |name: &&str| (name.to_string(), golden.rows(&golden.array(&format!("out/{name}")))[state].clone());
            let theirs = names.iter().map(recorded).collect();
            let mut contacts = Contacts { ours: mine, theirs, matched: vec![] };
            let pick = |field: &str| [&contacts.ours[field][..], &contacts.theirs[field][..]];
            let counts = pick("ncon").map(|n| n[0] as usize);
            match match_contacts(pick("contact_geom"), pick("contact_pos"), counts) {
                Ok(matched) => contacts.matched = matched,
                Err(message) => {
                    failures.check(|| format!("{} state {state} ", golden.name), Err(message));
                    continue;
                }
            }
            f(&golden, state, &contacts, failures);
        }
    }
}

fn contacts(options: &Options, tolerances: &Tolerances) {
    let t = tolerances.contacts;
    let fields = [
        ("contact_dim", 1, 0.0),
        ("contact_dist", 1, t),
        ("contact_pos", 3, t),
        ("contact_frame", 9, t),
        ("contact_friction", 5, t),
        ("contact_margin", 1, t),
    ];
    let mut failures = Failures::default();
    each_state(options, &mut failures, |golden, state, contacts, failures| {
        for (c, ours) in contacts.matched.iter().enumerate() {
            for (name, width, tolerance) in fields {
                let got = &contacts.ours[name][ours * width..(ours + 1) * width];
                let expected = &contacts.theirs[name][c * width..(c + 1) * width];
                let place = || format!("{} state {state} contact {c} {name}", golden.name);
                failures.check(place, agree(got, expected, tolerance, 1.0));
            }
        }
    });
    failures.report();
}

/// For each of MuJoCo's rows, ours: contact rows by contact, the others by type, id and order.
fn match_rows(contacts: &Contacts) -> Result<Vec<usize>, String> {
    const FIRST_CONTACT_TYPE: f64 = 5.0;
    let key = |side: &BTreeMap<String, Vec<f64>>, row: usize, to_theirs: bool| {
        let (kind, id) = (side["efc_type"][row], side["efc_id"][row] as usize);
        let theirs = |id| contacts.matched.iter().position(|ours| *ours == id).unwrap_or(usize::MAX);
        (kind as usize, if to_theirs && kind >= FIRST_CONTACT_TYPE { theirs(id) } else { id })
    };
    let (ours, theirs) = (contacts.ours["nefc"][0] as usize, contacts.theirs["nefc"][0] as usize);
    if ours != theirs {
        return Err(format!("nefc is {ours} instead of {theirs}"));
    }
    let mut free: Vec<usize> = (0..ours).collect();
    let mut found = Vec::new();
    for row in 0..theirs {
        let wanted = key(&contacts.theirs, row, false);
        let Some(at) = free.iter().position(|r| key(&contacts.ours, *r, true) == wanted) else {
            return Err(format!("there is no row of type {} and id {}", wanted.0, wanted.1));
        };
        found.push(free.remove(at));
    }
    Ok(found)
}

/// Compares fields of rows: name, tolerance, floor.
fn check_rows(options: &Options, fields: &[(&str, f64, f64)]) {
    let mut failures = Failures::default();
    each_state(options, &mut failures, |golden, state, contacts, failures| {
        let place = |name: &str| format!("{} state {state} {name}", golden.name);
        let matched = match match_rows(contacts) {
            Ok(matched) => matched,
            Err(message) => return failures.check(|| place(""), Err(message)),
        };
        let nv = golden.model.tables().sizes.nv;
        for (name, tolerance, floor) in fields {
            let width = if *name == "efc_J" { nv } else { 1 };
            let row = |values: &[f64], r: usize| values[r * width..(r + 1) * width].to_vec();
            let got: Vec<f64> = matched.iter().flat_map(|r| row(&contacts.ours[*name], *r)).collect();
            let expected: Vec<f64> = (0..matched.len()).flat_map(|r| row(&contacts.theirs[*name], r)).collect();
            failures.check(|| place(name), agree(&got, &expected, *tolerance, *floor));
        }
    });
    failures.report();
}

fn rows(options: &Options, tolerances: &Tolerances) {
    let t = tolerances.rows;
    check_rows(options, &["efc_J", "efc_pos", "efc_D", "efc_R", "efc_aref"].map(|name| (name, t, 1.0)));
}

fn solution(options: &Options, tolerances: &Tolerances) {
    let t = tolerances.solution;
    check_fields(options, &[("qacc", t, 1.0), ("qfrc_constraint", t, 1.0)]);
    check_rows(options, &[("efc_force", t, 1.0)]);
}

/// Errors of the acceleration in states with rows, sorted, relative to the acceleration or to what constraints add to the
/// smooth one: at rest these cancel and leave nothing.
fn acceleration_errors(options: &Options) -> Vec<f64> {
    let mut errors = Vec::new();
    for golden in Golden::all() {
        let ours = golden.eval(&["qacc"], 0, options);
        let expected = golden.rows(&golden.array("out/qacc"));
        let smooth = golden.rows(&golden.array("out/qacc_smooth"));
        let constrained = golden.array("out/nefc");
        for (state, (got, expected)) in ours["qacc"].iter().zip(&expected).enumerate() {
            if constrained[state] > 0.0 {
                let size = norm(expected).max(distance(expected, &smooth[state]));
                errors.push(distance(got, expected) / size);
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    errors
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    norm(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>())
}

/// The project's goal for accelerations under constraints: median, and all but the worst hundredth.
#[test]
fn accelerations_meet_the_goal() {
    for (precision, median, most) in [(Precision::F64, 1e-10, 1e-8), (Precision::F32, 5e-6, 1e-4)] {
        let errors = acceleration_errors(&options(precision, Backend::Wide));
        let at = |fraction: f64| errors[((errors.len() - 1) as f64 * fraction) as usize];
        println!(
            "{precision:?}: {} states, median {:.1e}, 99 % {:.1e}, worst {:.1e}",
            errors.len(),
            at(0.5),
            at(0.99),
            at(1.0)
        );
        assert!(at(0.5) <= median && at(0.99) <= most, "{precision:?}: median {:.1e}, 99 % {:.1e}", at(0.5), at(0.99));
    }
}

fn step(options: &Options, tolerances: &Tolerances) {
    let mut failures = Failures::default();
    for golden in Golden::all() {
        let ours = golden.eval(&["qpos", "qvel", "act"], 1, options);
        for name in ["qpos", "qvel", "act"] {
            let expected = golden.rows(&golden.array(&format!("next/{name}")));
            for (state, (got, expected)) in ours[name].iter().zip(&expected).enumerate() {
                let place = || format!("{} state {state} next {name}", golden.name);
                failures.check(place, agree(got, expected, tolerances.step, 1.0));
            }
        }
    }
    failures.report();
}

/// One test per group of results, for a precision and a backend.
macro_rules! groups {
    ($mode:ident, $precision:ident, $backend:ident, $tolerances:ident: $($group:ident)*) => {
        mod $mode {
            use super::*;
            $(#[test]
            fn $group() {
                super::$group(&options(Precision::$precision, Backend::$backend), &$tolerances);
            })*
        }
    };
}

groups!(f64_wide, F64, Wide, F64: kinematics moments dynamics contacts rows solution step);
groups!(f64_native, F64, Native, F64: kinematics moments dynamics contacts rows solution step);
groups!(f64_scalar, F64, Scalar, F64: kinematics moments dynamics contacts rows solution step);
groups!(f32_wide, F32, Wide, F32: kinematics moments dynamics contacts rows solution step);
groups!(f32_native, F32, Native, F32: kinematics moments dynamics contacts rows solution step);
groups!(f32_scalar, F32, Scalar, F32: kinematics moments dynamics contacts rows solution step);

fn numbers(data: &ArrayData) -> Vec<f64> {
    match data {
        ArrayData::F64(x) => x.clone(),
        ArrayData::I32(x) => x.iter().map(|x| f64::from(*x)).collect(),
    }
}

/// Inertia tensors of bodies in their own axes, from principal moments and axes: the same however equal moments are
/// ordered and whichever sign a quaternion has.
fn inertia_tensors(moments: &[f64], quaternions: &[f64]) -> Vec<f64> {
    let tensor = |(moments, q): (&[f64], &[f64])| {
        let rotation = glam::DMat3::from_quat(glam::DQuat::from_xyzw(q[1], q[2], q[3], q[0]));
        let moments = glam::DMat3::from_diagonal(glam::DVec3::from_slice(moments));
        (rotation * moments * rotation.transpose()).to_cols_array()
    };
    moments.chunks(3).zip(quaternions.chunks(4)).flat_map(tensor).collect()
}

#[test]
fn model_arrays() {
    let tolerance = |name: &str| match name {
        // Entries of inverses of inertia matrices.
        "body_invweight0" | "dof_invweight0" | "tendon_invweight0" | "actuator_acc0" => 1e-9,
        // MuJoCo stops diagonalising when the largest angle left is below 1e-12.
        "body_inertia" | "body_iquat" => 1e-11,
        _ => 1e-12,
    };
    let mut failures = Failures::default();
    for golden in Golden::all() {
        let sizes: BTreeMap<_, _> = golden.model.sizes().iter().copied().collect();
        let array = |name: &str| golden.model.array(name).map(|array| numbers(&array.data));
        for (name, expected) in &golden.arrays {
            let place = || format!("{} {name}", golden.name);
            let expected = expected.to_f64();
            if let Some(name) = name.strip_prefix("size/") {
                let result = match sizes.get(name) {
                    Some(n) if *n as f64 == expected[0] => Ok(0.0),
                    other => Err(format!(" is {other:?} instead of {}", expected[0])),
                };
                failures.check(place, result);
            } else if let Some(name) = name.strip_prefix("model/") {
                let Some(mut got) = array(name) else {
                    failures.check(place, Err(" is missing".into()));
                    continue;
                };
                let mut expected = expected.into_owned();
                if name == "body_iquat" {
                    got = inertia_tensors(&array("body_inertia").unwrap_or_default(), &got);
                    expected = inertia_tensors(&golden.array("model/body_inertia"), &expected);
                }
                if name == "jnt_range" {
                    // The range of a joint without limits means nothing; MuJoCo leaves it in degrees.
                    let limited = golden.array("model/jnt_limited");
                    got.iter_mut()
                        .zip(&mut expected)
                        .enumerate()
                        .filter(|(i, _)| limited[i / 2] == 0.0)
                        .for_each(|(_, (got, expected))| (*got, *expected) = (0.0, 0.0));
                }
                failures.check(place, agree(&got, &expected, tolerance(name), 1.0));
            }
        }
    }
    failures.report();
}

#[test]
fn every_golden_has_a_model() {
    let files: Vec<String> = all_models().iter().map(|name| name.split('/').nth(1).unwrap_or("").to_string()).collect();
    for entry in std::fs::read_dir(repository("tests/goldens")).expect("the goldens") {
        let path = entry.expect("a golden").path();
        if path.extension().is_some_and(|e| e == "npz") {
            let stem = path.file_stem().expect("a file name").to_string_lossy().into_owned();
            assert!(files.contains(&stem), "there is no model for {}", path.display());
        }
    }
}

/// What the goldens must exercise: a model, and the least number of contacts and rows that some state of it has.
#[test]
fn goldens_hold_what_models_are_for() {
    const LEAST: [(&str, usize, usize); 49] = [
        ("zoo/ant", 4, 20),
        ("zoo/hopper", 2, 8),
        ("zoo/cheetah", 2, 8),
        ("zoo/humanoid18", 6, 24),
        ("zoo/four_bar", 0, 3),
        ("zoo/closed_chain", 0, 15),
        ("zoo/stewart", 0, 18),
        ("zoo/humanoid27", 4, 16),
        ("unit/ball_limit", 0, 1),
        ("unit/box_box", 4, 16),
        ("unit/box_box_edge", 1, 4),
        ("unit/capsule_box", 1, 4),
        ("unit/capsule_capsule", 1, 4),
        ("unit/capsule_parallel", 4, 16),
        ("unit/condim1", 4, 6),
        ("unit/condim_elliptic", 6, 26),
        ("unit/condim_pyramidal", 6, 41),
        ("unit/contact_override", 3, 12),
        ("unit/contact_self", 2, 8),
        ("unit/contact_trees", 6, 24),
        ("unit/equality_connect", 0, 12),
        ("unit/equality_joint", 0, 5),
        ("unit/equality_weld", 0, 24),
        ("unit/exclude", 4, 16),
        ("unit/filterparent", 1, 4),
        ("unit/frictionloss", 0, 2),
        ("unit/impratio", 4, 16),
        ("unit/limits", 0, 6),
        ("unit/margin_gap", 4, 16),
        ("unit/pair", 3, 9),
        ("unit/plane_box", 4, 16),
        ("unit/plane_capsule", 2, 8),
        ("unit/plane_cylinder", 1, 4),
        ("unit/plane_cylinder_disk", 3, 3),
        ("unit/plane_ellipsoid", 1, 4),
        ("unit/plane_sphere", 1, 4),
        ("unit/plane_tilted", 1, 4),
        ("unit/priority", 5, 20),
        ("unit/refsafe_off", 1, 5),
        ("unit/sphere_box", 5, 20),
        ("unit/sphere_capsule", 1, 4),
        ("unit/sphere_cylinder", 4, 16),
        ("unit/sphere_sphere", 1, 4),
        ("unit/tendon_armature", 0, 1),
        ("unit/tendon_fixed", 0, 8),
        ("unit/tendon_spatial", 0, 7),
        ("unit/tendon_wrap", 0, 3),
        ("unit/tree_origins", 5, 20),
        ("unit/warmstart_off", 1, 5),
    ];
    for (name, ncon, nefc) in LEAST {
        let golden = Golden::read(name);
        let most = |field: &str| support::largest(&golden.array(field)) as usize;
        let found = (most("out/ncon"), most("out/nefc"));
        assert!(found.0 >= ncon && found.1 >= nefc, "{name} has at most {found:?} contacts and rows");
    }
    for golden in Golden::all() {
        assert!(golden.states() > 0, "{} has no state", golden.name);
        assert!(golden.array("out/qacc").iter().all(|x| x.is_finite()), "{} is not finite", golden.name);
    }
}
