//! Contacts of two bodies: against MuJoCo at random poses (tests/pairs/make.py), at poses that can be worked out by hand,
//! where formulas degenerate, and across lane types.

mod aligned;
mod heights;
mod manifold;
mod mesh;
mod still;

use std::collections::BTreeMap;
use std::path::Path;

use lanesim::eval::eval;
use lanesim::model::Model;
use lanesim::npz::{self, Array, Data};
use lanesim::worlds::{Backend, Options, Precision};

const SHAPES: [(&str, &str); 5] = [
    ("sphere", "0.2"),
    ("capsule", "0.1 0.3"),
    ("ellipsoid", "0.15 0.3 0.2"),
    ("cylinder", "0.2 0.3"),
    ("box", "0.3 0.2 0.25"),
];

/// A contact: distance, position, normal.
type Contact = (f64, [f64; 3], [f64; 3]);

fn pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..5).flat_map(|a| (a..5).map(move |b| (a, b)))
}

/// Whether a pair is found by the iterative collider.
fn iterative(a: usize, b: usize) -> bool {
    let (a, b) = (SHAPES[a].0, SHAPES[b].0);
    let simple = |x| x == "sphere" || x == "capsule" || x == "box";
    !(simple(a) && simple(b)) && (a, b) != ("sphere", "cylinder")
}

/// Two free bodies with a geom each: type and size.
fn model(a: (&str, &str), b: (&str, &str), margin: f64, multi: bool) -> Model {
    let multi = if multi { "enable" } else { "disable" };
    let text = format!(
        "<mujoco><option><flag multiccd=\"{multi}\"/></option><worldbody>\
         <body><freejoint/><geom type=\"{}\" size=\"{}\" margin=\"{margin}\"/></body>\
         <body><freejoint/><geom type=\"{}\" size=\"{}\"/></body></worldbody></mujoco>",
        a.0, a.1, b.0, b.1
    );
    Model::from_xml_string(&text, &Default::default()).unwrap()
}

fn options(precision: Precision, backend: Backend) -> Options {
    Options { precision, backend, threads: Some(1), ..Options::default() }
}

/// Contacts of every pose of two free bodies.
fn contacts(model: &Model, qpos: &[f64], options: &Options) -> Vec<Vec<Contact>> {
    contacts_of(model, qpos, 14, options)
}

/// Contacts of every pose of `nq` numbers.
fn contacts_of(model: &Model, qpos: &[f64], nq: usize, options: &Options) -> Vec<Vec<Contact>> {
    let n = qpos.len() / nq;
    let inputs = BTreeMap::from([("qpos".to_string(), Array::new(vec![n, nq], Data::F64(qpos.to_vec())).unwrap())]);
    let out = eval(model, &inputs, &["ncon", "contact_dist", "contact_pos", "contact_frame"], 0, options).unwrap();
    let [ncon, dist, pos, frame] = [0, 1, 2, 3].map(|i| out[i].1.to_f64().into_owned());
    let most = dist.len() / n;
    let three = |x: &[f64], at: usize| [x[at], x[at + 1], x[at + 2]];
    (0..n)
        .map(|i| {
            let of = |c: usize| i * most + c;
            (0..ncon[i] as usize).map(|c| (dist[of(c)], three(&pos, 3 * of(c)), three(&frame, 9 * of(c)))).collect()
        })
        .collect()
}

fn recorded() -> BTreeMap<String, Array> {
    npz::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pairs/poses.npz")).unwrap()
}

fn apart(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

/// The largest differences in distance, position and normal of two contact lists, each matched with its nearest.
fn difference(got: &[Contact], expected: &[Contact]) -> [f64; 3] {
    assert_eq!(got.len(), expected.len(), "{got:?} {expected:?}");
    let mut worst = [0.0_f64; 3];
    for x in expected {
        let y = got.iter().min_by(|p, q| apart(&p.1, &x.1).total_cmp(&apart(&q.1, &x.1))).unwrap();
        let here = [(x.0 - y.0).abs(), apart(&x.1, &y.1), apart(&x.2, &y.2)];
        worst = std::array::from_fn(|i| worst[i].max(here[i]));
    }
    worst
}

#[test]
fn random_poses_match_mujoco() {
    let recorded = recorded();
    for (a, b) in pairs() {
        let name = format!("{}_{}", SHAPES[a].0, SHAPES[b].0);
        let array = |field: &str| recorded[&format!("{name}/{field}")].to_f64().into_owned();
        let (qpos, ncon, dist, pos, normal) =
            (array("qpos"), array("ncon"), array("dist"), array("pos"), array("normal"));
        let ours = contacts(&model(SHAPES[a], SHAPES[b], 0.1, false), &qpos, &options(Precision::F64, Backend::Wide));
        // MuJoCo's own tolerance in distance is 1e-9 for the iterative pairs, and neither side always reaches it where the
        // distance hardly depends on the direction; an angle's error is the square root.
        let limits = if iterative(a, b) { [1e-6, 1e-3, 1e-2] } else { [1e-13, 1e-13, 1e-12] };
        for (i, got) in ours.iter().enumerate() {
            let three = |x: &[f64], at: usize| [x[at], x[at + 1], x[at + 2]];
            let of = |c: usize| 8 * i + c;
            let expected: Vec<Contact> = (0..ncon[i] as usize)
                .map(|c| (dist[of(c)], three(&pos, 3 * of(c)), three(&normal, 3 * of(c))))
                .collect();
            let worst = difference(got, &expected);
            assert!(worst.iter().zip(&limits).all(|(x, limit)| x < limit), "{name} pose {i}: {worst:?}");
        }
    }
}

#[test]
fn lanes_give_the_bits_of_the_scalar_path() {
    let recorded = recorded();
    for (a, b) in pairs() {
        let qpos = recorded[&format!("{}_{}/qpos", SHAPES[a].0, SHAPES[b].0)].to_f64().into_owned();
        let model = model(SHAPES[a], SHAPES[b], 0.1, true);
        for precision in [Precision::F64, Precision::F32] {
            let wide = contacts(&model, &qpos, &options(precision, Backend::Wide));
            let scalar = contacts(&model, &qpos, &options(precision, Backend::Scalar));
            assert_eq!(wide, scalar, "{} {} {precision:?}", SHAPES[a].0, SHAPES[b].0);
        }
    }
}

#[test]
fn single_precision_is_near_double() {
    let recorded = recorded();
    for (a, b) in pairs() {
        let name = format!("{}_{}", SHAPES[a].0, SHAPES[b].0);
        let qpos = recorded[&format!("{name}/qpos")].to_f64().into_owned();
        let model = model(SHAPES[a], SHAPES[b], 0.1, false);
        let double = contacts(&model, &qpos, &options(Precision::F64, Backend::Wide));
        let single = contacts(&model, &qpos, &options(Precision::F32, Backend::Wide));
        let deepest = |list: &Vec<Contact>| list.iter().map(|c| c.0).fold(f64::INFINITY, f64::min);
        for (i, (x, y)) in double.iter().zip(&single).enumerate() {
            // World positions reach ten metres, so poses are rounded to 1e-6.
            assert!((deepest(x) - deepest(y)).abs() < 2e-5, "{name} pose {i}: {x:?} {y:?}");
        }
    }
}

/// qpos of two bodies from places and quaternions.
fn at(p1: [f64; 3], q1: [f64; 4], p2: [f64; 3], q2: [f64; 4]) -> Vec<f64> {
    [&p1[..], &q1, &p2, &q2].concat()
}

const UPRIGHT: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

/// A turn about an axis.
fn turn(axis: usize, degrees: f64) -> [f64; 4] {
    let (sin, cos) = (degrees.to_radians() / 2.0).sin_cos();
    let mut q = [cos, 0.0, 0.0, 0.0];
    q[axis + 1] = sin;
    q
}

fn one(a: (&str, &str), b: (&str, &str), qpos: &[f64]) -> Vec<Contact> {
    contacts(&model(a, b, 0.0, true), qpos, &options(Precision::F64, Backend::Scalar)).remove(0)
}

#[test]
fn cases_worked_out_by_hand() {
    let cube = ("box", "1 1 1");
    let origin = [0.0; 3];
    // SPEC T6: a sphere on a cube, and inside it; a capsule lying on it; a small box turned on it.
    let sphere = one(("sphere", "0.2"), cube, &at([0.3, 0.2, 1.19], UPRIGHT, origin, UPRIGHT));
    assert!(difference(&sphere, &[(-0.01, [0.3, 0.2, 0.995], [0.0, 0.0, -1.0])]).iter().all(|x| *x < 1e-14));
    let inside = one(("sphere", "0.2"), cube, &at([0.3, 0.2, 0.9], UPRIGHT, origin, UPRIGHT));
    assert!((inside[0].0 + 0.3).abs() < 1e-14 && (inside[0].1[2] - 0.85).abs() < 1e-14);
    let capsule = one(("capsule", "0.1 0.3"), cube, &at([0.3, 0.2, 1.09], turn(0, 90.0), origin, UPRIGHT));
    let expected = [0.5, -0.1].map(|y| (-0.01, [0.3, y, 0.995], [0.0, 0.0, -1.0]));
    assert!(difference(&capsule, &expected).iter().all(|x| *x < 1e-12), "{capsule:?}");
    let small = one(cube, ("box", "0.2 0.3 0.4"), &at(origin, UPRIGHT, [0.3, 0.2, 1.39], turn(2, 30.0)));
    assert_eq!(small.len(), 4);
    for (dist, pos, normal) in small {
        assert!((dist + 0.01).abs() < 1e-14 && (pos[2] - 0.995).abs() < 1e-14 && normal == [0.0, 0.0, 1.0]);
    }
}

#[test]
fn flat_sides_touch_at_several_points() {
    let cube = ("box", "1 1 1");
    let cases = [
        (one(cube, cube, &at([0.0; 3], UPRIGHT, [0.0, 0.0, 1.99], UPRIGHT)), 4),
        (one(cube, cube, &at([0.0; 3], UPRIGHT, [0.0, 0.0, 1.99], turn(2, 45.0))), 8),
        (one(("cylinder", "0.2 0.3"), cube, &at([0.3, 0.2, 1.29], UPRIGHT, [0.0; 3], UPRIGHT)), 4),
        (one(("cylinder", "0.2 0.3"), cube, &at([0.3, 0.2, 1.19], turn(0, 90.0), [0.0; 3], UPRIGHT)), 2),
        (
            one(
                ("capsule", "0.1 0.3"),
                ("cylinder", "0.5 0.6"),
                &at([0.1, 0.0, 0.69], turn(0, 90.0), [0.0; 3], UPRIGHT),
            ),
            2,
        ),
        (one(("cylinder", "0.5 0.6"), ("cylinder", "0.2 0.3"), &at([0.0; 3], UPRIGHT, [0.1, 0.0, 0.89], UPRIGHT)), 4),
    ];
    for (i, (list, count)) in cases.iter().enumerate() {
        assert_eq!(list.len(), *count, "case {i}: {list:?}");
        for (dist, _, normal) in list {
            assert!((dist + 0.01).abs() < 1e-9 && normal[2].abs() > 1.0 - 1e-9, "case {i}: {list:?}");
        }
    }
}

#[test]
fn edges_that_cross_touch_at_one_point() {
    let cube = ("box", "1 1 1");
    let height = 2.0 * 2.0_f64.sqrt() - 0.02;
    let list = one(cube, cube, &at([0.0; 3], turn(0, 45.0), [0.0, 0.0, height], turn(1, 45.0)));
    let expected = [(-0.02, [0.0, 0.0, height / 2.0], [0.0, 0.0, 1.0])];
    assert!(difference(&list, &expected).iter().all(|x| *x < 1e-12), "{list:?}");
}

/// Every pair at coincident centres and with parallel axes: some contact, unit normals, finite numbers.
#[test]
fn degenerate_poses_give_usable_contacts() {
    let turns = [UPRIGHT, turn(0, 90.0), turn(1, 90.0), turn(2, 180.0), turn(0, 1e-7), turn(1, 45.0)];
    let places = [[0.0; 3], [0.0, 0.0, 0.1], [0.15, 0.0, 0.0], [1e-12, 0.0, 0.0], [0.1, 0.1, 0.1]];
    for (a, b) in pairs() {
        // A margin, since a capsule that pierces a box just touches by the rule for its ends.
        let model = model(SHAPES[a], SHAPES[b], 0.05, true);
        let poses: Vec<f64> =
            turns.iter().flat_map(|q| places.map(|p| at([0.0; 3], UPRIGHT, p, *q))).flatten().collect();
        for precision in [Precision::F64, Precision::F32] {
            for (i, list) in contacts(&model, &poses, &options(precision, Backend::Wide)).iter().enumerate() {
                let place = format!("{} {} {precision:?} pose {i}: {list:?}", SHAPES[a].0, SHAPES[b].0);
                assert!(!list.is_empty(), "{place}");
                for (dist, pos, normal) in list {
                    let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
                    assert!((length - 1.0).abs() < 1e-5, "{place}");
                    assert!(dist.abs() < 2.0 && pos.iter().all(|x| x.abs() < 2.0), "{place}");
                }
            }
        }
    }
}

/// Two equal shapes swapped: the same contacts, normals reversed.
#[test]
fn equal_shapes_can_be_swapped() {
    let recorded = recorded();
    for (name, size) in SHAPES {
        let qpos = recorded[&format!("{name}_{name}/qpos")].to_f64().into_owned();
        let swapped: Vec<f64> = qpos.chunks(14).flat_map(|q| [&q[7..], &q[..7]].concat()).collect();
        let model = model((name, size), (name, size), 0.1, false);
        let options = options(Precision::F64, Backend::Wide);
        for (x, y) in contacts(&model, &qpos, &options).iter().zip(contacts(&model, &swapped, &options)) {
            let deepest = |list: &[Contact]| list.iter().map(|c| c.0).fold(f64::INFINITY, f64::min);
            assert!((deepest(x) - deepest(&y)).abs() < 1e-9, "{name}: {x:?} {y:?}");
        }
    }
}

/// A box resting on a box: the contacts together carry its weight.
#[test]
fn a_resting_box_is_carried() {
    let text = "<mujoco><worldbody><geom type=\"box\" size=\"1 1 0.1\"/>\
                <body pos=\"0.1 0.2 0.2\"><freejoint/><geom type=\"box\" size=\"0.1 0.2 0.1\"/></body>\
                </worldbody></mujoco>";
    let model = Model::from_xml_string(text, &Default::default()).unwrap();
    let inputs = BTreeMap::new();
    let options = options(Precision::F64, Backend::Wide);
    let out = eval(&model, &inputs, &["qfrc_constraint", "qvel", "ncon"], 2000, &options).unwrap();
    let [force, velocity, ncon] = [0, 1, 2].map(|i| out[i].1.to_f64().into_owned());
    let weight = 16.0 * 9.81;
    assert_eq!(ncon, [4.0]);
    assert!((force[2] - weight).abs() < 1e-6 * weight, "{force:?}");
    assert!(velocity.iter().all(|v| v.abs() < 1e-6), "{velocity:?}");
}

/// The models of convex pairs run without a flag, their bodies held up by the contact.
#[test]
fn models_of_convex_pairs_run() {
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("models/convex")).unwrap() {
        let path = entry.unwrap().path();
        let model = Model::from_xml_path(&path, &Default::default()).unwrap();
        let mut worlds = lanesim::worlds::Worlds::new(&model, 9, &Options::default()).unwrap();
        worlds.step(500).unwrap();
        for world in 0..9 {
            assert_eq!(worlds.status(world).unwrap(), Default::default(), "{}", path.display());
        }
    }
}
