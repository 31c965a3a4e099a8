//! Explicit pairs of geoms that cannot move against each other: MuJoCo reports their contacts and gives them no rows.

use std::collections::BTreeMap;

use lanesim::eval::eval;
use lanesim::model::Model;
use lanesim::worlds::{Backend, Field, Precision, Worlds};

use super::options;

const PAIR: &str = "<contact><pair geom1=\"a\" geom2=\"b\" margin=\"0.3\" gap=\"0.1\" condim=\"4\"/></contact>";

/// Geoms of two bodies without joints; of one and the world; of the world; of one body that moves; of it and a body fixed to
/// it; the first alone, and beside a ball that touches one of them.
fn worlds() -> [String; 7] {
    let a = "<geom name=\"a\" size=\"1\"/>";
    let b = "<geom name=\"b\" size=\"1\" pos=\"1.5 0 0\"/>";
    let free = "<body pos=\"0 0 9\"><freejoint/><geom size=\"0.1\"/></body>";
    let ball = "<body pos=\"0 0 1.4\"><freejoint/><geom size=\"0.5\"/></body>";
    [
        format!("<body>{a}</body><body>{b}</body>{free}"),
        format!("{a}<body>{b}</body>{free}"),
        format!("{a}{b}{free}"),
        format!("<body><freejoint/>{a}{b}</body>"),
        format!("<body><freejoint/>{a}<body>{b}</body></body>"),
        format!("<body>{a}</body><body>{b}</body>"),
        format!("<body>{a}</body><body>{b}</body>{ball}"),
    ]
}

fn model(world: &str) -> Model {
    let text = format!("<mujoco><worldbody>{world}</worldbody>{PAIR}</mujoco>");
    Model::from_xml_string(&text, &Default::default()).unwrap()
}

#[test]
fn contacts_of_geoms_that_cannot_move_are_reported_without_rows() {
    let fields = ["ncon", "nefc", "contact_dist", "contact_pos", "contact_dim", "contact_efc", "contact_geom"];
    for (w, world) in worlds().iter().enumerate() {
        let model = model(world);
        for precision in [Precision::F64, Precision::F32] {
            for backend in [Backend::Scalar, Backend::Wide, Backend::Auto] {
                let out = eval(&model, &BTreeMap::new(), &fields, 0, &options(precision, backend)).unwrap();
                let [ncon, nefc, dist, pos, dim, address, geoms] =
                    [0, 1, 2, 3, 4, 5, 6].map(|i| out[i].1.to_f64().into_owned());
                let place = format!("world {w} {precision:?} {backend:?}");
                // The ball's contact has four edges of a pyramid.
                let touching = w == 6;
                let expected = if touching { ([2.0], [4.0]) } else { ([1.0], [0.0]) };
                assert_eq!((&ncon[..], &nefc[..]), (&expected.0[..], &expected.1[..]), "{place}");
                assert!((dist[0] + 0.5).abs() < 1e-6 && (pos[0] - 0.75).abs() < 1e-6, "{place}: {dist:?} {pos:?}");
                assert_eq!((dim[0], address[0], &geoms[..2]), (4.0, -1.0, &[0.0, 1.0][..]), "{place}");
                assert_eq!(address.get(1).copied().filter(|_| touching), touching.then_some(0.0), "{place}");
            }
        }
    }
}

/// Such a contact changes no motion: a free body falls as without it.
#[test]
fn contacts_of_geoms_that_cannot_move_do_nothing() {
    for world in worlds().iter().take(5) {
        for backend in [Backend::Scalar, Backend::Wide, Backend::Auto] {
            let mut worlds = Worlds::new(&model(world), 3, &options(Precision::F64, backend)).unwrap();
            worlds.step(10).unwrap();
            let fallen = 9.81 * 0.002 * 0.002 * 55.0;
            let height = if world.contains("0 0 9") { 9.0 } else { 0.0 };
            let qpos = worlds.get(Field::Qpos, 1).unwrap();
            assert!((qpos[2] - height + fallen).abs() < 1e-12, "{world} {qpos:?}");
        }
    }
}
