//! Meshes: one of a box touches as the box does, it comes to rest, and meshes that cannot collide are refused.

use lanesim::worlds::{Backend, Precision, Worlds};
use lanesim::{Model, Options};

use super::{Contact, SHAPES, contacts, contacts_of, model, options, pairs, recorded};

/// The place of the box among the shapes.
const BOX: usize = 4;
/// Its corners.
const CORNERS: &str = "-0.3 -0.2 -0.25  0.3 -0.2 -0.25  -0.3 0.2 -0.25  0.3 0.2 -0.25  \
    -0.3 -0.2 0.25  0.3 -0.2 0.25  -0.3 0.2 0.25  0.3 0.2 0.25";

/// A free body of a shape, then one of a box as a mesh.
fn with_mesh(shape: (&str, &str), margin: f64) -> Model {
    let geom = match shape.0 {
        "box" => "type=\"mesh\" mesh=\"box\"".to_string(),
        _ => format!("type=\"{}\" size=\"{}\"", shape.0, shape.1),
    };
    let text = format!(
        "<mujoco><option><flag multiccd=\"disable\"/></option><asset><mesh name=\"box\" vertex=\"{CORNERS}\"/></asset><worldbody>\
         <body><freejoint/><geom {geom} margin=\"{margin}\"/></body>\
         <body><freejoint/><geom type=\"mesh\" mesh=\"box\"/></body></worldbody></mujoco>"
    );
    Model::from_xml_string(&text, &Default::default()).unwrap()
}

fn deepest(list: &[Contact]) -> Option<&Contact> {
    list.iter().min_by(|p, q| p.0.total_cmp(&q.0))
}

#[test]
fn a_mesh_of_a_box_touches_as_the_box_does() {
    let recorded = recorded();
    for (a, b) in pairs().filter(|(_, b)| *b == BOX) {
        let qpos = recorded[&format!("{}_{}/qpos", SHAPES[a].0, SHAPES[b].0)].to_f64().into_owned();
        let run = options(Precision::F64, Backend::Wide);
        let (plain, mesh) = (model(SHAPES[a], SHAPES[b], 0.1, false), with_mesh(SHAPES[a], 0.1));
        let (expected, got) = (contacts(&plain, &qpos, &run), contacts(&mesh, &qpos, &run));
        for (pose, (expected, got)) in expected.iter().zip(&got).enumerate() {
            let (Some(x), Some(y)) = (deepest(expected), deepest(got)) else {
                assert_eq!(expected.is_empty(), got.is_empty(), "{} pose {pose}", SHAPES[a].0);
                continue;
            };
            // Of a capsule whose axis meets the box, the formula does not find the shortest way out.
            if SHAPES[a].0 == "capsule" && y.0 < -0.1 {
                continue;
            }
            // Its vertices are rounded to single precision, and formulas and search differ where an angle hardly matters. Of two boxes
            // the formula prefers faces to edges that are a little less deep.
            assert!(y.0 > x.0 - 2e-6, "{} pose {pose}: {x:?} {y:?}", SHAPES[a].0);
            assert!(y.0 < x.0 + if a == BOX { 1e-3 } else { 2e-6 }, "{} pose {pose}: {x:?} {y:?}", SHAPES[a].0);
            if y.0 > x.0 + 2e-6 {
                continue;
            }
            let cosine: f64 = x.2.iter().zip(&y.2).map(|(x, y)| x * y).sum();
            assert!(cosine > 1.0 - 1e-4, "{} pose {pose}: {x:?} {y:?}", SHAPES[a].0);
        }
    }
}

/// On a plane and on another mesh, at four points, and it stays where it is.
#[test]
fn meshes_come_to_rest() {
    let text = format!(
        "<mujoco><asset><mesh name=\"box\" vertex=\"{CORNERS}\"/></asset><worldbody><geom type=\"plane\" size=\"1 1 1\"/>\
         <body pos=\"0 0 0.26\"><freejoint/><geom type=\"mesh\" mesh=\"box\"/></body>\
         <body pos=\"0.1 0 0.77\"><freejoint/><geom type=\"mesh\" mesh=\"box\"/></body></worldbody></mujoco>"
    );
    let model = Model::from_xml_string(&text, &Default::default()).unwrap();
    for precision in [Precision::F64, Precision::F32] {
        let mut worlds = Worlds::new(&model, 3, &Options { precision, ..Options::default() }).unwrap();
        worlds.step(1000).unwrap();
        assert_eq!(worlds.lost(), 0);
        let qpos = worlds.get(lanesim::Field::Qpos, 1).unwrap();
        let at = [0.0, 0.0, 0.25, 1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.75, 1.0, 0.0, 0.0, 0.0];
        for (x, y) in qpos.iter().zip(at) {
            assert!((x - y).abs() < 2e-3, "{precision:?}: {qpos:?}");
        }
        assert!(worlds.get(lanesim::Field::Qvel, 1).unwrap().iter().all(|v| v.abs() < 1e-3));
    }
}

/// A face of twenty corners counts with all of them: a box covers one of its corners, and MuJoCo has it among four points.
/// Reduced from a gripper's finger: one hull touches with an edge, whose other side stands across the contact's normal. MuJoCo 4.0.0 has the
/// same point; the depth is that of the hulls' exact difference.
#[test]
fn an_edge_does_not_lie_against_a_side_that_faces_elsewhere() {
    let text = "<mujoco><asset>
      <mesh name='a' vertex='0.0045739379 0.031215486 0.033879061  0.0052219066 0.042671924 0.017772756
        0.0095601117 0.041125683 0.015343016  0.00952808 0.040592437 0.016701429'/>
      <mesh name='b' vertex='0.012715938 0.083589795 0.093464819  0.012011826 0.078450031 0.1008381
        0.01201369 0.080775983 0.10057234  -0.019532174 0.023583484 0.020192454  -0.019484101 0.083548393 0.090980371
        0.019464072 0.018880575 0.014677593  -0.01953592 0.018911821 0.014677609  0.019455829 0.0085886177 0.020386784
        -0.019489965 0.076224678 0.10019354  -0.019486298 0.080801221 0.10057236  0.019458938 0.012471411 0.012841991
        0.0194608 0.014797361 0.012576234  -0.019539191 0.01482861 0.012576254'/></asset>
      <worldbody><geom type='mesh' mesh='a'/><body><freejoint/><geom type='mesh' mesh='b'/></body></worldbody></mujoco>";
    let model = Model::from_xml_string(text, &Default::default()).unwrap();
    let found = contacts_of(&model, &model.initial_key().qpos, 7, &options(Precision::F64, Backend::Wide));
    let [(dist, _, normal, ..)] = &found[0][..] else { panic!("{found:?}") };
    assert!((dist + 0.0030083988).abs() < 1e-9, "{dist}");
    let off =
        [-0.000611097, -0.763027394, 0.646365858].iter().zip(normal).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    assert!(off < 1e-8, "{normal:?}");
}

#[test]
fn faces_of_many_corners_are_whole() {
    let rim = ".9 -.01 Z  .861 .146 Z  .707 .31 Z  .523 .407 Z  .281 .475 Z  -.025 .5 Z  -.238 .482 Z  -.544 .398 Z  -.721 .299 Z \
        -.844 .174 Z  -.9 -.008 Z  -.843 -.175 Z  -.743 -.282 Z  -.519 -.408 Z  -.295 -.472 Z  .022 -.5 Z  .297 -.472 Z \
        .508 -.413 Z  .745 -.28 Z  .86 -.147 Z ";
    let text = format!(
        "<mujoco><asset><mesh name=\"coin\" vertex=\"{}{}\"/></asset><worldbody><body><freejoint/><geom type=\"mesh\" mesh=\"coin\"/>\
         </body><body pos=\"-1.05 .4 .29\"><freejoint/><geom type=\"box\" size=\".3 .3 .1\"/></body></worldbody></mujoco>",
        rim.replace('Z', ".2"),
        rim.replace('Z', "-.2")
    );
    let model = Model::from_xml_string(&text, &Default::default()).unwrap();
    let qpos = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.05, 0.4, 0.29, 1.0, 0.0, 0.0, 0.0];
    let corners = [[-0.75, 0.1], [-0.866_769_226_29, 0.1], [-0.844, 0.174], [-0.75, 0.269_528_461_358]];
    let expected = corners.map(|[x, y]| (-0.01, [x, y, 0.195], [0.0, 0.0, -1.0]));
    let found = contacts(&model, &qpos, &options(Precision::F64, Backend::Wide));
    let off = super::difference(&found[0], &expected);
    assert!(off.iter().all(|off| *off < 1e-7), "{off:?}");
}

#[test]
fn meshes_that_cannot_be_are_refused() {
    let load = |mesh: &str, geom: &str| {
        let text = format!(
            "<mujoco><asset>\n<mesh name=\"m\" {mesh}/></asset><worldbody><geom type=\"plane\" size=\"1 1 1\"/><body><freejoint/>\n\
             <geom type=\"mesh\" {geom}/></body></worldbody></mujoco>"
        );
        Model::from_xml_string(&text, &Default::default()).map(|_| ()).unwrap_err().to_string()
    };
    let flat = "vertex=\"0 0 0 1 0 0 0 1 0 1 1 0\" face=\"0 1 2 1 3 2\"";
    for (mesh, geom, message) in [
        (flat, "mesh=\"m\"", "2: mesh \"m\": encloses a volume of 0.000e0, which is too small"),
        (
            &format!("{flat} inertia=\"shell\""),
            "mesh=\"m\"",
            "3: geom #1: its mesh \"m\" has no convex hull: its vertices lie in a plane, or nearly so",
        ),
        (flat, "mesh=\"n\"", "3: geom #1: mesh names an unknown mesh \"n\""),
        (flat, "", "3: geom: a geom of type mesh needs a mesh"),
        ("vertex=\"0 0 0\"", "mesh=\"m\"", "2: mesh \"m\": 1 vertices are too few; a mesh has at least 4"),
        ("vertex=\"0 0\"", "mesh=\"m\"", "2: mesh \"m\": attribute \"vertex\": the count is no multiple of 3"),
        (
            "vertex=\"0 0 0 1 0 0 0 1 0 0 0 1\" face=\"0 1 9\"",
            "mesh=\"m\"",
            "2: mesh \"m\": a face has vertex 9, but there are 4",
        ),
        ("vertex=\"0 0 0 1 0 0 0 1 0 0 0 1\" face=\"0 1 -1\"", "mesh=\"m\"", "index -1 is negative"),
        ("file=\"m.stl\"", "mesh=\"m\"", "2: mesh \"m\": file \"m.stl\": no such file among those given"),
        ("file=\"m.dae\"", "mesh=\"m\"", "2: mesh \"m\": file \"m.dae\": meshes of type \"dae\" are not supported"),
        ("", "mesh=\"m\"", "2: mesh \"m\": neither file nor vertex is given"),
        ("file=\"m.stl\" vertex=\"0 0 0\"", "mesh=\"m\"", "2: mesh \"m\": both file and vertex are given"),
        ("builtin=\"sphere\"", "mesh=\"m\"", "attribute \"params\": a sphere has 1, and there are 0"),
        ("builtin=\"plate\"", "mesh=\"m\"", "plate"),
        ("maxhullvert=\"3\" vertex=\"0 0 0\"", "mesh=\"m\"", "attribute \"maxhullvert\": 3 is too few"),
        (
            "scale=\"1 0 1\" vertex=\"0 0 0 1 0 0 0 1 0 0 0 1\"",
            "mesh=\"m\"",
            "2: mesh \"m\": refpos, refquat and scale must be finite, and no scale 0",
        ),
    ] {
        let problem = load(mesh, geom);
        assert!(problem.contains(message), "{mesh} {geom}: {problem}");
    }
}

/// What is only looked at is dropped with its mesh, whether that is there or not.
#[test]
fn discardvisual_drops_meshes_too() {
    let text = |file: &str| {
        format!(
            "<mujoco><compiler discardvisual=\"true\"/><asset><mesh name=\"m\" {file}/></asset><worldbody><body><freejoint/>\
             <geom size=\"0.1\"/><geom type=\"mesh\" mesh=\"m\" contype=\"0\" conaffinity=\"0\" mass=\"0\"/></body>\
             </worldbody></mujoco>"
        )
    };
    for file in [format!("vertex=\"{CORNERS}\""), "file=\"m.stl\"".into()] {
        let model = Model::from_xml_string(&text(&file), &Default::default()).unwrap();
        assert_eq!(model.names().geoms.len(), 1, "{file}");
    }
}

/// A mesh that nothing depends on is left out where its file is not there; one that matters is not.
#[test]
fn meshes_that_only_decorate_may_be_missing() {
    let text = |geom: &str| {
        format!(
            "<mujoco><asset>\n<mesh name=\"m\" file=\"m.stl\"/></asset><worldbody><body><freejoint/><geom size=\"0.1\"/>\
             <geom type=\"mesh\" mesh=\"m\" {geom}/></body></worldbody></mujoco>"
        )
    };
    let decorates = "contype=\"0\" conaffinity=\"0\" mass=\"0\"";
    let model = Model::from_xml_string(&text(decorates), &Default::default()).unwrap();
    assert_eq!(
        model.report().notes,
        [
            "1 geom on which no motion depends is left out: line 2: mesh \"m\": file \"m.stl\": no such file among those given"
        ]
    );
    for matters in ["", "contype=\"0\" conaffinity=\"0\"", "mass=\"0\""] {
        let problem = Model::from_xml_string(&text(matters), &Default::default()).unwrap_err().to_string();
        assert!(problem.contains("2: mesh \"m\": file \"m.stl\": no such file among those given"), "{problem}");
    }
}
