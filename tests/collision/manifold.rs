//! Shapes that touch with sides and edges, against MuJoCo (tests/pairs/make_manifold.py).

use std::path::Path;

use lanesim::worlds::{Backend, Precision};
use lanesim::{Model, npz};

use super::{Contact, contacts_of, difference, options};

/// Distance from a pair to the next, along x.
const APART: f64 = 5.0;
/// The number of the pair of a cylinder, whose round sides MuJoCo meets less exactly.
const CYLINDER: usize = 4;
const PAIRS: usize = 6;

fn of_pair(list: &[Contact], pair: usize) -> Vec<Contact> {
    list.iter().filter(|contact| (contact.1[0] / APART).round() as usize == pair).copied().collect()
}

#[test]
fn sides_and_edges_touch_where_mujoco_has_them() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pairs");
    let recorded = npz::read(&folder.join("manifold.npz")).unwrap();
    let [qpos, pair, dist, pos, normal] =
        ["qpos", "pair", "dist", "pos", "normal"].map(|name| recorded[name].to_f64().into_owned());
    let (nq, most) = (recorded["qpos"].shape()[1], recorded["pair"].shape()[1]);
    let model = Model::from_xml_path(&folder.join("manifold.xml"), &Default::default()).unwrap();
    let expected = |pose: usize, wanted: usize| -> Vec<Contact> {
        let three = |x: &[f64], c: usize| [x[3 * c], x[3 * c + 1], x[3 * c + 2]];
        let list = (pose * most..(pose + 1) * most).filter(|c| pair[*c] == wanted as f64);
        list.map(|c| (dist[c], three(&pos, c), three(&normal, c))).collect()
    };
    for backend in [Backend::Wide, Backend::Scalar] {
        let found = contacts_of(&model, &qpos, nq, &options(Precision::F64, backend));
        for (pose, list) in found.iter().enumerate() {
            for pair in 0..PAIRS {
                let limits = if pair == CYLINDER { [1e-4, 2e-3, 2e-3] } else { [1e-6; 3] };
                let got = of_pair(list, pair);
                let off = difference(&got, &expected(pose, pair));
                assert!((0..3).all(|i| off[i] < limits[i]), "pose {pose} pair {pair}: {off:?}");
            }
        }
    }
    // Where places are rounded, another side may count as flat: a few poses have other points then.
    let found = contacts_of(&model, &qpos, nq, &options(Precision::F32, Backend::Wide));
    let agrees = |pose: usize, pair: usize| {
        let (got, expected) = (of_pair(&found[pose], pair), expected(pose, pair));
        got.len() == expected.len() && difference(&got, &expected).iter().all(|off| *off < 2e-3)
    };
    let count =
        (0..found.len()).flat_map(|pose| (0..PAIRS).map(move |pair| (pose, pair))).filter(|x| agrees(x.0, x.1)).count();
    assert!(100 * count >= 97 * PAIRS * found.len(), "{count} of {}", PAIRS * found.len());
}

/// An upright cylinder against an upright edge of a box: of the two sides that meet there MuJoCo takes that across x, however
/// squarely either faces the cylinder. It meets the round side to within the square root of its tolerance.
#[test]
fn of_two_sides_of_a_box_the_first_touches() {
    let model = super::model(("cylinder", "0.06 0.07"), ("box", "0.06 0.05 0.08"), 0.0, true);
    let at = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    let (half, root) = (0.5, 0.866_025_403_784_438_6);
    for (other, dist, [x, y], normal) in [
        (
            [0.131_961_524_227, -0.013_301_270_189, 0.01, 0.965_925_826_289, 0.0, 0.0, 0.258_819_045_103],
            -0.004_324_868_790,
            [0.058_127_275_958, -0.001_091_732_059],
            [root, half, 0.0],
        ),
        (
            [0.128_301_270_189, 0.026_961_524_227, 0.01, root, 0.0, 0.0, half],
            -0.002_499_231_686,
            [0.059_375_192_072, -0.001_083_086_234],
            [half, root, 0.0],
        ),
    ] {
        let qpos = [at, other].concat();
        let expected = [-0.07, 0.07].map(|z| (dist, [x, y, z], normal));
        let found = super::contacts(&model, &qpos, &options(Precision::F64, Backend::Wide));
        let off = difference(&found[0], &expected);
        assert!(off[0] < 1e-5 && off[1] < 2e-5 && off[2] < 1e-9, "{off:?}");
    }
}
