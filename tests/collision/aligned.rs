//! Contacts of shapes that are aligned or parallel, where several sets of points are as good as each other and rounding must
//! not choose: against MuJoCo (tests/pairs/make_aligned.py), and where the answer is plain.

use std::path::Path;

use lanesim::model::Model;
use lanesim::npz;
use lanesim::worlds::{Backend, Precision};

use super::{Contact, apart, contacts_of, options, turn};

type Quat = [f64; 4];

fn product(p: Quat, q: Quat) -> Quat {
    [
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    ]
}

fn rotated(q: Quat, v: [f64; 3]) -> [f64; 3] {
    let [_, x, y, z] = product(product(q, [0.0, v[0], v[1], v[2]]), [q[0], -q[1], -q[2], -q[3]]);
    [x, y, z]
}

fn back(q: Quat, v: [f64; 3]) -> [f64; 3] {
    rotated([q[0], -q[1], -q[2], -q[3]], v)
}

/// The 24 rotations that map coordinate axes to coordinate axes.
fn quarter_turns() -> Vec<Quat> {
    let about = |axis, quarters: u32| turn(axis, 90.0 * f64::from(quarters));
    let up = [[1.0, 0.0, 0.0, 0.0], about(0, 1), about(0, 2), about(0, 3), about(1, 1), about(1, 3)];
    up.iter().flat_map(|up| (0..4).map(move |n| product(*up, about(2, n)))).collect()
}

fn numbers(x: &[f64]) -> String {
    x.iter().map(|x| x.to_string()).collect::<Vec<_>>().join(" ")
}

/// A geom that stands still, turned with the scene, and a body with another; one contact of the iterative pairs.
fn model(shapes: [&str; 2], sizes: [&[f64]; 2], scene: Quat, margin: f64) -> Model {
    let [a, b] = sizes.map(numbers);
    let text = format!(
        "<mujoco><option><flag multiccd=\"disable\"/></option><worldbody>\
         <geom type=\"{}\" size=\"{a}\" quat=\"{}\" margin=\"{margin}\"/>\
         <body><freejoint/><inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 1\"/><geom type=\"{}\" size=\"{b}\"/></body></worldbody></mujoco>",
        shapes[0],
        numbers(&scene),
        shapes[1]
    );
    Model::from_xml_string(&text, &Default::default()).unwrap()
}

/// The contacts of poses in the first shape's axes, which are turned by `scene`.
fn found(model: &Model, scene: Quat, poses: &[f64], (precision, backend): (Precision, Backend)) -> Vec<Vec<Contact>> {
    let qpos: Vec<f64> = poses
        .chunks(7)
        .flat_map(|p| {
            let at = rotated(scene, [p[0], p[1], p[2]]);
            let q = product(scene, [p[3], p[4], p[5], p[6]]);
            [&at[..], &q[..]].concat()
        })
        .collect();
    let in_world = contacts_of(model, &qpos, 7, &options(precision, backend));
    let own = |c: &Contact| (c.0, back(scene, c.1), back(scene, c.2));
    in_world.iter().map(|list| list.iter().map(own).collect()).collect()
}

/// Without those that are at the same place with the same normal as an earlier one.
fn distinct(list: &[Contact], tolerance: f64) -> Vec<Contact> {
    let mut kept: Vec<Contact> = vec![];
    for c in list {
        if !kept.iter().any(|k| apart(&k.1, &c.1) < tolerance && apart(&k.2, &c.2) < tolerance) {
            kept.push(*c);
        }
    }
    kept
}

fn deepest(list: &[Contact]) -> &Contact {
    list.iter().min_by(|x, y| x.0.total_cmp(&y.0)).unwrap()
}

/// Largest differences in distance, position and normal to MuJoCo's; of one point of an iterative pair, not in position.
fn differences(got: &[Contact], expected: &[Contact], iterative: bool) -> [f64; 3] {
    if iterative {
        let (x, y) = (deepest(got), deepest(expected));
        return [(x.0 - y.0).abs(), 0.0, apart(&x.2, &y.2)];
    }
    super::difference(got, expected)
}

const SHAPES: [&str; 6] = ["plane", "sphere", "capsule", "ellipsoid", "cylinder", "box"];

fn pairs() -> impl Iterator<Item = [&'static str; 2]> {
    let not_planes = |a: usize| a.max(1)..SHAPES.len();
    (0..SHAPES.len()).flat_map(move |a| not_planes(a).map(move |b| [SHAPES[a], SHAPES[b]]))
}

fn iterative([a, b]: [&str; 2]) -> bool {
    let round = |x| x == "ellipsoid" || x == "cylinder";
    a != "plane" && (a, b) != ("sphere", "cylinder") && (round(a) || round(b))
}

/// In every quarter turn of the scene and in oblique ones: the number of distinct points, their distances, places and normals.
#[test]
fn aligned_poses_match_mujoco() {
    let recorded = npz::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pairs/aligned.npz")).unwrap();
    let oblique = [[0.1, -0.5, 0.7, 0.5], [0.7, 0.1, 0.1, 0.7]];
    let scenes: Vec<Quat> = quarter_turns().into_iter().chain(oblique).collect();
    for pair in pairs() {
        let name = pair.join("_");
        let array = |field: &str| recorded[&format!("{name}/{field}")].to_f64().into_owned();
        let (size, pose, ncon) = (array("size"), array("pose"), array("ncon"));
        let (dist, pos, normal) = (array("dist"), array("pos"), array("normal"));
        let three = |x: &[f64], at: usize| [x[at], x[at + 1], x[at + 2]];
        let expected = |i: usize| -> Vec<Contact> {
            let of = |c: usize| 8 * i + c;
            (0..ncon[i] as usize).map(|c| (dist[of(c)], three(&pos, 3 * of(c)), three(&normal, 3 * of(c)))).collect()
        };
        for (s, scene) in scenes.iter().enumerate() {
            let norm = scene.iter().map(|x| x * x).sum::<f64>().sqrt();
            let scene = scene.map(|x| x / norm);
            let model = model(pair, [&size[..3], &size[3..]], scene, 0.02);
            for precision in [Precision::F64, Precision::F32] {
                // Of a rod that leaves an edge by 1e-6, MuJoCo turns the normal by as much; its iterative pairs reach 1e-9 in
                // distance, where an angle's error is the square root.
                let limits = match (precision, iterative(pair), name.as_str()) {
                    (Precision::F64, true, _) => [1e-8, 0.0, 1e-3],
                    (Precision::F64, _, "capsule_box") => [1e-12, 1e-6, 2e-6],
                    (Precision::F64, ..) => [1e-13, 1e-13, 1e-12],
                    (Precision::F32, true, _) => [1e-6, 0.0, 1e-3],
                    (Precision::F32, ..) => [1e-6, 2e-6, 5e-6],
                };
                let limits = if iterative(pair) { [limits[0], f64::EPSILON, limits[2]] } else { limits };
                for (i, got) in found(&model, scene, &pose, (precision, Backend::Scalar)).iter().enumerate() {
                    let got = distinct(got, 1e-5);
                    let place = format!("{name} pose {i} scene {s} {precision:?}: {got:?}");
                    assert_eq!(got.len(), ncon[i] as usize, "{place}");
                    let worst = differences(&got, &expected(i), iterative(pair));
                    assert!(worst.iter().zip(limits).all(|(x, limit)| *x < limit), "{place} {worst:?}");
                }
            }
        }
    }
}

/// The kernels, their lanes and the machine code leave the same bits.
#[test]
fn aligned_poses_have_the_same_bits_on_all_backends() {
    let recorded = npz::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pairs/aligned.npz")).unwrap();
    for pair in pairs() {
        let name = pair.join("_");
        let [size, pose] = ["size", "pose"].map(|field| recorded[&format!("{name}/{field}")].to_f64().into_owned());
        let scene = turn(1, 90.0);
        let model = model(pair, [&size[..3], &size[3..]], scene, 0.02);
        for precision in [Precision::F64, Precision::F32] {
            let of = |backend| found(&model, scene, &pose, (precision, backend));
            let scalar = of(Backend::Scalar);
            assert_eq!(scalar, of(Backend::Wide), "{name} {precision:?}");
            assert_eq!(scalar, of(Backend::Auto), "{name} {precision:?}");
        }
    }
}

/// Shapes of every size from micrometres to thousands of kilometres: the same contacts, scaled.
#[test]
fn contacts_scale_with_the_shapes() {
    let recorded = npz::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pairs/aligned.npz")).unwrap();
    let scene = turn(0, 90.0);
    for pair in pairs() {
        let name = pair.join("_");
        let [size, pose] = ["size", "pose"].map(|field| recorded[&format!("{name}/{field}")].to_f64().into_owned());
        let scaled = |by: f64, precision| {
            let size: Vec<f64> = size.iter().map(|x| by * x).collect();
            let pose: Vec<f64> = pose.iter().enumerate().map(|(i, x)| if i % 7 < 3 { by * x } else { *x }).collect();
            let model = model(pair, [&size[..3], &size[3..]], scene, 0.02 * by);
            let unit = |c: &Contact| (c.0 / by, c.1.map(|x| x / by), c.2);
            let lists = found(&model, scene, &pose, (precision, Backend::Scalar));
            lists.iter().map(|list| list.iter().map(unit).collect()).collect::<Vec<Vec<Contact>>>()
        };
        for precision in [Precision::F64, Precision::F32] {
            let expected = scaled(1.0, precision);
            for by in [1e-6, 1e-3, 1e3, 1e6] {
                for (i, (x, y)) in scaled(by, precision).iter().zip(&expected).enumerate() {
                    let [x, y] = [x, y].map(|list| distinct(list, 1e-5));
                    let place = format!("{name} pose {i} times {by} {precision:?}: {x:?} {y:?}");
                    assert_eq!(x.len(), y.len(), "{place}");
                    let worst = differences(&x, &y, iterative(pair));
                    let limit = if precision == Precision::F32 || iterative(pair) { 1e-5 } else { 1e-12 };
                    assert!(worst[0] < limit && worst[2] < 1e2 * limit, "{place} {worst:?}");
                }
            }
        }
    }
}

/// Capsules side by side share a part of their length, and touch at its ends: overlapping partly, wholly, or only end to end,
/// thin and fat, the same way round and the other, at any small angle, apart and within each other.
#[test]
fn capsules_side_by_side_touch_at_the_ends_of_the_common_part() {
    let cases = [(0.1, 0.3, 0.1, 0.3), (0.1, 0.3, 0.1, 0.27), (0.02, 0.5, 0.3, 0.1), (0.2, 0.05, 0.2, 0.05)];
    for (radius1, half1, radius2, half2) in cases {
        let sizes: [&[f64]; 2] = [&[radius1, half1], &[radius2, half2]];
        for shift in [0.0, 0.1, -0.1, half1 - half2, half1 + half2 - 1e-3] {
            for gap in [0.02, -0.01] {
                for angle in [0.0, 1e-9, 1e-7, 1e-5, 9e-5, std::f64::consts::PI] {
                    let (sin, cos) = (angle / 2.0).sin_cos();
                    let across = radius1 + radius2 + gap;
                    let pose = [across, 0.0, shift, cos, 0.0, sin, 0.0];
                    let model = model(["capsule", "capsule"], sizes, turn(2, 0.0), 0.05);
                    for (precision, slack) in [(Precision::F64, 1e-12), (Precision::F32, 1e-6)] {
                        let list = found(&model, turn(2, 0.0), &pose, (precision, Backend::Scalar)).remove(0);
                        let place = format!("{sizes:?} {shift} {gap} {angle} {precision:?}: {list:?}");
                        assert_eq!(list.len(), 2, "{place}");
                        let (low, high) = (f64::max(-half1, shift - half2), f64::min(half1, shift + half2));
                        let tilt = if angle > 1.0 { 0.0 } else { angle };
                        for (c, z) in list.iter().zip([low, high]) {
                            // The second leans towards the first on one side, and away on the other.
                            let expected = gap + tilt * (z - shift);
                            assert!((c.0 - expected).abs() < slack + tilt * tilt, "{place}");
                            assert!((c.1[2] - z).abs() < slack + tilt && c.2[0] > 1.0 - slack - tilt, "{place}");
                        }
                    }
                }
            }
        }
    }
}

/// A rod along a box's edge, in all 576 quarter turns of the scene and of the box: two contacts, at the ends of what they
/// share, be it inside, at one end or both ends beyond the edge, or as long as it.
#[test]
fn a_rod_along_an_edge_touches_at_both_ends_of_the_common_part() {
    let reach = 0.2 + 0.095 / 2.0_f64.sqrt();
    for (half, shift) in [(0.1, 0.03), (0.2, 0.1), (0.4, 0.1), (0.2, 0.0), (0.6, -0.3)] {
        let (low, high) = (f64::max(-0.2, shift - half), f64::min(0.2, shift + half));
        for scene in quarter_turns() {
            let model = model(["box", "capsule"], [&[0.2; 3], &[0.1, half]], scene, 0.0);
            let up = |turn: Quat| rotated(turn, [0.0, 0.0, 1.0]);
            // The rod along each of the twelve edges, either way round.
            let poses: Vec<f64> = quarter_turns()
                .into_iter()
                .flat_map(|turn| {
                    let at = rotated(turn, [reach, reach, shift]);
                    [&at[..], &turn[..]].concat()
                })
                .collect();
            for (precision, slack) in [(Precision::F64, 1e-12), (Precision::F32, 1e-6)] {
                let lists = found(&model, scene, &poses, (precision, Backend::Scalar));
                for (list, along) in lists.iter().zip(quarter_turns()) {
                    assert_eq!(list.len(), 2, "{half} {shift} {precision:?} {list:?}");
                    let mut places: Vec<f64> =
                        list.iter().map(|c| c.1.iter().zip(up(along)).map(|(x, y)| x * y).sum()).collect();
                    places.sort_by(f64::total_cmp);
                    let right = places.iter().zip([low, high]).all(|(x, y)| (x - y).abs() < slack);
                    let depths = list.iter().all(|c| (c.0 + 0.005).abs() < slack);
                    assert!(right && depths, "{half} {shift} {precision:?} {list:?}");
                }
            }
        }
    }
}

/// A rod pressed between two boxes along their edges is held at four points, and does not tip.
#[test]
fn a_rod_in_a_gap_does_not_tip() {
    let text = "<mujoco><option gravity=\"0 0 9.81\"/>\
        <default><geom type=\"box\" size=\"0.1 0.2 0.2\" quat=\"0.70710678118654757 0 0.70710678118654746 0\"/></default>\
        <worldbody><geom pos=\"0.26 0 0\"/><geom pos=\"-0.26 0 0\"/><body pos=\"0 0.1 -0.1799\"><freejoint/>\
        <geom type=\"capsule\" size=\"0.1 0.2\" quat=\"0.70710678118654757 -0.70710678118654757 0 0\"/></body>\
        </worldbody></mujoco>";
    let model = Model::from_xml_string(text, &Default::default()).unwrap();
    for (precision, slack) in [(Precision::F64, 1e-9), (Precision::F32, 1e-5)] {
        for backend in [Backend::Scalar, Backend::Auto] {
            let list = contacts_of(&model, &[0.0, 0.1, -0.1799, 1.0, 0.0, 0.0, 0.0], 7, &options(precision, backend))
                .remove(0);
            assert_eq!(list.len(), 4, "{list:?}");
            for c in &list {
                let off = f64::min((c.1[1] - 0.2).abs(), (c.1[1] + 0.1).abs());
                assert!((c.0 + 7.998e-5).abs() < 1e-8 + slack && off < slack, "{list:?}");
            }
        }
    }
}

/// The one contact of flat sides, or of edges along each other, lies in the middle of what they share.
#[test]
fn one_contact_of_flat_sides_lies_in_their_middle() {
    /// Shapes, their sizes, where the second is, and the middle of what they share.
    type Case = ([&'static str; 2], [&'static [f64]; 2], [f64; 3], [f64; 3]);
    // Box or cylinder upright on a cylinder's disk; capsule and cylinder along a cylinder, half beside it.
    let cases: [Case; 4] = [
        (["cylinder", "box"], [&[0.5, 0.3], &[0.1, 0.2, 0.1]], [0.1, 0.05, 0.39], [0.1, 0.05, 0.295]),
        (["cylinder", "cylinder"], [&[0.5, 0.3], &[0.1, 0.2]], [0.1, 0.05, 0.49], [0.1, 0.05, 0.295]),
        (["capsule", "cylinder"], [&[0.1, 0.3], &[0.2, 0.2]], [0.29, 0.0, 0.2], [0.095, 0.0, 0.15]),
        (["cylinder", "cylinder"], [&[0.1, 0.3], &[0.2, 0.2]], [0.29, 0.0, -0.05], [0.095, 0.0, -0.05]),
    ];
    for (shapes, sizes, at, middle) in cases {
        for scene in quarter_turns() {
            let model = model(shapes, sizes, scene, 0.0);
            let pose = [at[0], at[1], at[2], 1.0, 0.0, 0.0, 0.0];
            for (precision, slack) in [(Precision::F64, 1e-9), (Precision::F32, 1e-6)] {
                let list = found(&model, scene, &pose, (precision, Backend::Scalar)).remove(0);
                assert_eq!(list.len(), 1, "{shapes:?} {list:?}");
                // Of two curved sides the direction is known to the root of the distance's accuracy.
                assert!((list[0].0 + 0.01).abs() < slack && apart(&list[0].1, &middle) < 1e-6, "{shapes:?} {list:?}");
            }
        }
    }
}

/// Rods that share an end, where a joint is: what rounding leaves between the ends has no direction that counts. The normal is orthogonal
/// to both rods, in either precision.
#[test]
fn rods_with_a_common_end_have_the_normal_across_both() {
    let xml = "<mujoco><worldbody><body><geom type='capsule' size='.01' fromto='0 0 0 0 0 .1'/></body><body pos='0 0 .1'>\
        <joint type='ball'/><geom type='capsule' size='.01' fromto='0 0 0 0 .1 .1'/></body></worldbody></mujoco>";
    let model = Model::from_xml_string(xml, &Default::default()).unwrap();
    let poses: Vec<f64> = (0..20)
        .flat_map(|i| {
            let x = f64::from(i);
            let q = [1.0, 0.3 * x.sin(), 0.3 * (1.7 * x).cos(), 0.2 * (0.7 * x).sin()];
            let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
            q.map(|x| x / length)
        })
        .collect();
    let normals = |precision| {
        let found = contacts_of(&model, &poses, 4, &options(precision, Backend::Wide));
        found.into_iter().map(|list| list[0].2).collect::<Vec<_>>()
    };
    for (single, double) in normals(Precision::F32).iter().zip(normals(Precision::F64)) {
        assert!(single[2].abs() < 1e-5 && apart(single, &double) < 1e-4, "{single:?} {double:?}");
    }
}

/// A capsule whose axis goes through a box along one of its axes: MuJoCo has the place where it enters, and where it leaves only if
/// the nearest edge lies on a certain side of the axis.
#[test]
fn a_capsule_through_a_box_leaves_as_with_mujoco() {
    let model = super::model(("capsule", "0.1 0.2"), ("box", "0.1 0.1 0.1"), 0.0, true);
    let run = super::options(Precision::F64, Backend::Wide);
    let (up, down) = ([1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]);
    for ([x, y, z], turn, both) in [
        ([-0.05, 0.0, -0.04], up, true),
        ([-0.05, 0.0, -0.04], down, false),
        ([0.05, 0.02, -0.04], up, false),
        ([0.05, 0.02, -0.04], down, true),
        ([0.02, -0.05, 0.03], up, true),
        ([0.02, 0.05, 0.03], up, false),
    ] {
        let qpos = [[x, y, z].as_slice(), &turn, &[0.0, 0.0, 0.0], &up].concat();
        let mut expected = vec![(-0.1, [x, y, -0.05], [0.0, 0.0, 1.0])];
        expected.extend(both.then_some((-0.1, [x, y, 0.05], [0.0, 0.0, -1.0])));
        let off = super::difference(&super::contacts(&model, &qpos, &run)[0], &expected);
        assert!(off.iter().all(|off| *off < 1e-12), "{x} {y} {z} {turn:?}: {off:?}");
    }
}
