//! Shapes on a height field, against MuJoCo (tests/pairs/make_heights.py), and fields that cannot be.

use std::collections::BTreeMap;
use std::path::Path;

use lanesim::worlds::{Backend, Precision};
use lanesim::{Model, mjcf, npz};

use super::{Contact, contacts_of, difference, options};

/// Distance from a body to the next, along x, and the first's place.
const APART: f64 = 2.0;
const FIRST: f64 = -5.0;
const BODIES: usize = 6;

fn of_body(list: &[Contact], body: usize) -> Vec<Contact> {
    list.iter().filter(|contact| ((contact.1[0] - FIRST) / APART).round() as usize == body).copied().collect()
}

#[test]
fn shapes_touch_the_ground_where_mujoco_has_it() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pairs");
    let recorded = npz::read(&folder.join("heights.npz")).unwrap();
    let [qpos, pair, dist, pos, normal] =
        ["qpos", "pair", "dist", "pos", "normal"].map(|name| recorded[name].to_f64().into_owned());
    let (nq, most) = (recorded["qpos"].shape()[1], recorded["pair"].shape()[1]);
    let model = Model::from_xml_path(&folder.join("heights.xml"), &Default::default()).unwrap();
    let expected = |pose: usize, wanted: usize| -> Vec<Contact> {
        let three = |x: &[f64], c: usize| [x[3 * c], x[3 * c + 1], x[3 * c + 2]];
        let list = (pose * most..(pose + 1) * most).filter(|c| pair[*c] == wanted as f64);
        list.map(|c| (dist[c], three(&pos, c), three(&normal, c))).collect()
    };
    // Of round shapes MuJoCo's own search ends a little early.
    let limits = [1e-5, 2e-3, 2e-3];
    for backend in [Backend::Wide, Backend::Scalar] {
        let found = contacts_of(&model, &qpos, nq, &options(Precision::F64, backend));
        for (pose, list) in found.iter().enumerate() {
            for body in 0..BODIES {
                let (got, expected) = (of_body(list, body), expected(pose, body));
                assert_eq!(got.len(), expected.len(), "pose {pose} body {body}: {got:?} {expected:?}");
                let off = difference(&got, &expected);
                assert!((0..3).all(|i| off[i] < limits[i]), "pose {pose} body {body}: {off:?}");
            }
        }
    }
    let found = contacts_of(&model, &qpos, nq, &options(Precision::F32, Backend::Wide));
    let agrees = |(pose, body): (usize, usize)| {
        let (got, expected) = (of_body(&found[pose], body), expected(pose, body));
        got.len() == expected.len() && difference(&got, &expected).iter().all(|off| *off < 5e-3)
    };
    let all = (0..found.len()).flat_map(|pose| (0..BODIES).map(move |body| (pose, body)));
    let count = all.filter(|x| agrees(*x)).count();
    assert!(100 * count >= 97 * BODIES * found.len(), "{count} of {}", BODIES * found.len());
}

fn problem(field: &str, files: &[(&str, &[u8])]) -> String {
    let text = format!(
        "<mujoco><asset><hfield name='h' {field}/></asset><worldbody><geom type='hfield' hfield='h'/>\
         <body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    );
    let files: BTreeMap<String, Vec<u8>> =
        files.iter().map(|(name, bytes)| (name.to_string(), bytes.to_vec())).collect();
    let model = mjcf::parse_with_files(&text, &files, &Default::default()).and_then(|spec| Model::from_spec(&spec));
    model.map_or_else(|error| error.to_string(), |_| String::new())
}

#[test]
fn fields_that_cannot_be_are_refused() {
    let header = |rows: i32, columns: i32, heights: &[f32]| {
        let counts = [rows, columns].into_iter().flat_map(i32::to_le_bytes);
        counts.chain(heights.iter().flat_map(|height| height.to_le_bytes())).collect::<Vec<u8>>()
    };
    let cases: [(&str, Vec<u8>, &str); 11] = [
        ("nrow='2' ncol='2'", vec![], "attribute \"size\" is missing"),
        ("nrow='1' ncol='2' size='1 1 1 1'", vec![], "too few"),
        ("nrow='2000000000' ncol='2000000000' size='1 1 1 1'", vec![], "more than"),
        ("nrow='2' ncol='2' size='1 1 1 0'", vec![], "is not one"),
        ("nrow='2' ncol='2' size='1 1 1 1' elevation='1 2 3'", vec![], "has 3 numbers"),
        ("file='missing.bin' size='1 1 1 1'", vec![], "no such file"),
        ("file='f.bin' size='1 1 1 1'", vec![1, 2, 3], "ends within the header"),
        ("file='f.bin' size='1 1 1 1'", header(2, 2, &[1.0]), "bytes are announced"),
        ("file='f.bin' size='1 1 1 1'", header(-2, 2, &[1.0]), "a count in it is negative"),
        ("file='f.bin' size='1 1 1 1'", header(2, 2, &[1.0, f32::NAN, 0.0, 0.0]), "height 1 is not finite"),
        ("file='f.png' size='1 1 1 1'", vec![137, 80, 78, 71], "is not a PNG file"),
    ];
    for (field, bytes, expected) in &cases {
        let found = problem(field, &[("f.bin", bytes), ("f.png", bytes)]);
        assert!(found.contains(expected), "{field}: {found}");
    }
    assert_eq!(problem("file='f.bin' size='1 1 1 1'", &[("f.bin", &header(2, 2, &[1.0, 0.0, 0.0, 0.5]))]), "");
}
