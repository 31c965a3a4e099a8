//! Meshes that can be worked out by hand, and files that lie.

use std::f64::consts::FRAC_PI_4;

use glam::{DVec2, DVec3};

use super::*;

/// A box of half sizes 1, 2, 3 about (5, 0, 0), as OBJ.
const BOX: &str = "# a box\no box\nv 4 -2 -3\nv 6 -2 -3\nv 4 2 -3\nv 6 2 -3\nv 4 -2 3\nv 6 -2 3\nv 4 2 3\nv 6 2 3\n\
    f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf -8 -4 -2 -6\nf 2 4 8 6\n";

fn cuboid() -> Triangles {
    Format::Obj.read(BOX.as_bytes()).expect("a box")
}

/// The same in another format.
fn stl(mesh: &Triangles) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((mesh.faces.len() as u32).to_le_bytes());
    for face in &mesh.faces {
        let corners = mesh.corners(*face).map(|p| p.as_vec3().to_array());
        bytes.extend([[0.0_f32; 3]].iter().chain(&corners).flatten().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0, 0]);
    }
    bytes
}

fn msh(mesh: &Triangles) -> Vec<u8> {
    let mut bytes: Vec<u8> = Vec::new();
    bytes.extend([mesh.vertices.len() as i32, 0, 1, mesh.faces.len() as i32].iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend(mesh.vertices.iter().flat_map(|p| p.as_vec3().to_array()).flat_map(|x| x.to_le_bytes()));
    bytes.extend([0_u8; 8]);
    bytes.extend(mesh.faces.iter().flatten().flat_map(|v| v.to_le_bytes()));
    bytes
}

fn ascii(mesh: &Triangles) -> String {
    let facet = |face: &[u32; 3]| {
        let corner = |p: &DVec3| format!("vertex {} {} {}\n", p.x, p.y, p.z);
        let corners: String = mesh.corners(*face).iter().map(corner).collect();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    format!("solid box\n{}endsolid box\n", mesh.faces.iter().map(facet).collect::<String>())
}

#[track_caller]
fn is_the_box(mesh: &Triangles) {
    let bulk = bulk(mesh, MeshInertia::Exact).expect("a volume");
    assert!((bulk.volume - 48.0).abs() < 1e-12, "{bulk:?}");
    assert!((bulk.centre - DVec3::new(5.0, 0.0, 0.0)).length() < 1e-13, "{bulk:?}");
    // m/3 times the sums of squares of half sizes.
    let expected = DVec3::new(13.0, 10.0, 5.0) * 16.0;
    let diagonal = DVec3::new(bulk.inertia.x_axis.x, bulk.inertia.y_axis.y, bulk.inertia.z_axis.z);
    assert!((diagonal - expected).length() < 1e-11, "{bulk:?}");
    assert!(bulk.inertia.x_axis.y.abs() + bulk.inertia.x_axis.z.abs() + bulk.inertia.y_axis.z.abs() < 1e-11);
}

#[test]
fn every_format_holds_the_same_box() {
    let mesh = cuboid();
    assert_eq!((mesh.vertices.len(), mesh.faces.len()), (8, 12));
    is_the_box(&mesh);
    is_the_box(&Format::Stl.read(&stl(&mesh)).expect("binary"));
    is_the_box(&Format::Stl.read(ascii(&mesh).as_bytes()).expect("text"));
    is_the_box(&Format::Msh.read(&msh(&mesh)).expect("msh"));
}

#[test]
fn binary_files_may_begin_with_a_line_of_text() {
    let mut bytes = stl(&cuboid());
    bytes[..80].fill(b' ');
    bytes[..8].copy_from_slice(b"solid a\n");
    is_the_box(&Format::Stl.read(&bytes).expect("binary"));
}

#[test]
fn ways_to_have_mass() {
    let mesh = cuboid();
    let volume = |mesh: &Triangles, how| bulk(mesh, how).map(|bulk| bulk.volume);
    assert!((volume(&mesh, MeshInertia::Legacy).expect("a volume") - 48.0).abs() < 1e-12);
    assert!((volume(&mesh, MeshInertia::Shell).expect("an area") - 88.0).abs() < 1e-12);
    let inside_out = Triangles { faces: mesh.faces.iter().map(|[a, b, c]| [*a, *c, *b]).collect(), ..mesh.clone() };
    assert!((volume(&inside_out, MeshInertia::Legacy).expect("a volume") - 48.0).abs() < 1e-12);
    let problem = volume(&inside_out, MeshInertia::Exact).expect_err("inside out");
    assert!(problem.starts_with("encloses a volume of -4.800e1, which is too small"), "{problem}");
    let flat = Triangles { vertices: mesh.vertices.iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect(), ..mesh };
    assert!(volume(&flat, MeshInertia::Legacy).is_err() && volume(&flat, MeshInertia::Shell).is_ok());
}

#[test]
fn files_that_lie_are_errors() {
    let mesh = cuboid();
    let whole = stl(&mesh);
    for length in [0, 50, 83, 84, 100, whole.len() - 1] {
        let problem = Format::Stl.read(&whole[..length]).expect_err("cut off");
        assert!(problem.starts_with("is not an STL file"), "{problem}");
    }
    let mut many = whole.clone();
    many[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let problem = Format::Stl.read(&many).expect_err("too many");
    assert_eq!(problem, "is not an STL file: 4294967295 triangles are announced, and there is room for 12");
    assert!(Format::Stl.read(b"solid box\nfacet normal 0 0").is_err());
    let whole = msh(&mesh);
    for length in [0, 15, 16, whole.len() - 1] {
        assert!(Format::Msh.read(&whole[..length]).is_err(), "{length}");
    }
    let mut negative = whole.clone();
    negative[0..4].copy_from_slice(&(-1_i32).to_le_bytes());
    assert!(Format::Msh.read(&negative).is_err());
    let mut beyond = whole;
    let last = beyond.len() - 4;
    beyond[last..].copy_from_slice(&8_u32.to_le_bytes());
    let read = Format::Msh.read(&beyond).expect("a file of the right length");
    assert_eq!(read.problem().as_deref(), Some("a face has vertex 8, but there are 8"));
    for text in ["v 1 2\n", "v 0 0 0\nf 1 2 3\n", "v a b c\nf 1 1 1\n", "f 0 0 0\n", "\0\0\0"] {
        let refused = Format::Obj.read(text.as_bytes()).map_or(true, |mesh| mesh.problem().is_some());
        assert!(refused, "{text:?}");
    }
    let infinite = Triangles { vertices: vec![DVec3::INFINITY; 4], faces: vec![] };
    assert_eq!(infinite.problem().as_deref(), Some("vertex 0 is not finite"));
}

#[test]
fn a_hull_has_flat_faces_and_the_farthest_vertices() {
    let mut points = cuboid().vertices;
    points.extend([DVec3::new(5.0, 0.0, 0.0), DVec3::new(5.5, 1.0, 2.0), DVec3::new(4.0, 0.0, 0.0)]);
    let hull = hull(&points, None).expect("a hull");
    let hull = hull.outline(&hull.vertices, &hull.vertices);
    assert_eq!((hull.vertices.len(), hull.faces.len()), (8, 6));
    assert!(hull.faces.iter().all(|face| face.corners.len() == 4));
    for direction in [[1.0, 0.1, 0.2], [-0.3, -1.0, 0.2], [0.1, 0.2, -1.0]] {
        let height = |p: &[f64; 3]| p.iter().zip(&direction).map(|(x, d)| x * d).sum::<f64>();
        let most = hull.vertices.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
        assert_eq!(height(&hull.vertices[hull.support(direction) as usize]), most);
    }
}

/// Of a ball of many vertices a search that climbs finds what a search through all does, and a simpler hull lies within.
#[test]
fn searches_on_large_hulls() {
    let golden = 2.399_963_229_728_653;
    let point = |i: usize| {
        let (z, turn) = (1.0 - (2 * i + 1) as f64 / 500.0, golden * i as f64);
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * turn.cos(), r * turn.sin(), z)
    };
    let points: Vec<DVec3> = (0..500).map(point).collect();
    let outline = hull(&points, None).expect("a hull");
    let outline = outline.outline(&outline.vertices, &outline.vertices);
    assert_eq!(outline.vertices.len(), 500);
    for direction in points.iter().map(|p| DVec3::new(p.y, -p.z, 0.5 * p.x)) {
        let height = |p: &[f64; 3]| DVec3::from_array(*p).dot(direction);
        let most = outline.vertices.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
        assert_eq!(height(&outline.vertices[outline.support(direction.to_array()) as usize]), most);
    }
    let simple = hull(&points, Some(30)).expect("a hull");
    assert_eq!(simple.vertices.len(), 30);
    assert!(simple.vertices.iter().all(|p| points.contains(p)));
    let volume = bulk(&simple, MeshInertia::Exact).expect("a volume").volume;
    assert!((2.9..4.19).contains(&volume), "{volume}");
}

#[test]
fn flat_points_have_no_hull() {
    let square: Vec<DVec3> = (0..20).map(|i| DVec3::new(f64::from(i % 5), f64::from(i / 5), 0.0)).collect();
    assert!(hull(&square, None).is_err());
    assert!(hull(&[DVec3::ONE; 8], None).is_err());
}

/// A membrane has a hull: found by MuJoCo's qhull, and refused here when its thin axis was not widened.
#[test]
fn thin_meshes_have_hulls() {
    for thickness in [1e-2, 1e-3, 1e-5] {
        let point = |i: usize| {
            let (angle, side) = (0.1 * i as f64, if i.is_multiple_of(2) { 1.0 } else { -1.0 });
            DVec3::new(side * thickness * (1.0 + (7.0 * angle).sin()), 1.1 * angle.cos(), 2.6 * (1.3 * angle).sin())
        };
        let points: Vec<DVec3> = (0..1500).map(point).collect();
        let hull = hull(&points, None).expect("a hull");
        assert!(hull.vertices.iter().all(|p| points.contains(p)));
    }
}

/// Corners of the faces of the hull of some points.
fn faces(points: &[DVec3]) -> Vec<usize> {
    let hull = hull(points, None).expect("a hull");
    hull.outline(&hull.vertices, &hull.vertices).faces.iter().map(|face| face.corners.len()).collect()
}

/// MuJoCo 4.0.0 has the same faces of the same vertices: thirty sides whose azimuths are a milliradian apart are four, with 5, 10, 10 and 5 of
/// them; the sides of a flat pyramid are one face up to a slope of √2e-7.
#[test]
fn triangles_in_a_cell_of_directions_are_one_face() {
    let around = |i: i32| DVec2::from_angle(1e-3 * f64::from(i));
    let mut points = vec![DVec3::new(-1.0, 0.3, -1.0), DVec3::new(-1.0, 0.3, 1.0)];
    points.extend((0..=30).flat_map(|i| [-1.0, 1.0].map(|z| around(i).extend(z))));
    let mut strips: Vec<usize> = faces(&points).into_iter().filter(|corners| *corners < 30).collect();
    strips.sort_unstable();
    assert_eq!(strips, [4, 4, 12, 12, 22, 22]);
    for (slope, sides) in [(4.4e-4, 0), (4.5e-4, 8)] {
        let corner = |i: i32| DVec2::from_angle(0.1 + FRAC_PI_4 * f64::from(i));
        let mut points = vec![DVec3::new(0.0, 0.0, slope * (0.5 * FRAC_PI_4).cos())];
        points.extend((0..8).flat_map(|i| [-1.0, 0.0].map(|z| corner(i).extend(z))));
        assert_eq!(faces(&points).iter().filter(|corners| **corners == 3).count(), sides);
    }
}
