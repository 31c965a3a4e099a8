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
