//! Meshes that are built in (MJCF `mesh/builtin`): made from a few parameters, in single precision as MuJoCo makes them.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::Triangles;

/// A kind: its word, what its parameters are, and what makes it of them or says what is wrong with them.
type Kind = (&'static str, &'static [&'static str], fn(&[f64]) -> Result<Triangles, String>);

const KINDS: &[Kind] = &[
    ("sphere", &["subdivision"], |p| Ok(sphere(count("subdivision", p[0], 0..=4)?))),
    ("hemisphere", &["resolution"], |p| Ok(hemisphere(count("resolution", p[0], 0..=10)?))),
    ("cone", &["nvert", "radius"], |p| {
        Ok(cone(count("nvert", p[0], 3..=MOST_ROUND)?, within("radius", p[1], 0.0..=1.0)?))
    }),
    ("supersphere", &["resolution", "e", "n"], |p| {
        let powers = [within("e", p[1], 0.0..=MOST_POWER)?, within("n", p[2], 0.0..=MOST_POWER)?];
        Ok(supersphere(count("resolution", p[0], 3..=MOST_ROUND)?, powers))
    }),
    ("supertorus", &["resolution", "radius", "s", "t"], |p| {
        let radius = within("radius", p[1], f64::MIN_POSITIVE..=1.0)?;
        let powers =
            [within("s", p[2], f64::MIN_POSITIVE..=MOST_POWER)?, within("t", p[3], f64::MIN_POSITIVE..=MOST_POWER)?];
        Ok(supertorus(count("resolution", p[0], 4..=MOST_ROUND)?, radius, powers))
    }),
];
/// Kinds that only serve sensors that are not built.
const SENSED: [&str; 2] = ["wedge", "plate"];
/// Most vertices round a mesh.
const MOST_ROUND: u32 = 1000;
/// Largest power: those above leave nothing of a shape.
const MOST_POWER: f64 = 1e3;

/// A mesh of a kind, named by its word; the error is a message and a remedy.
pub(crate) fn builtin(word: &str, params: &[f64]) -> Result<Triangles, (String, String)> {
    if SENSED.contains(&word) {
        return Err((format!("built-in meshes of kind {word} are not supported"), "save it to a file".into()));
    }
    let Some((_, names, make)) = KINDS.iter().find(|(kind, ..)| *kind == word) else {
        let kinds: Vec<&str> = KINDS.iter().map(|(kind, ..)| *kind).collect();
        return Err((format!("attribute \"builtin\": unknown kind \"{word}\""), format!("use {}", kinds.join(", "))));
    };
    let wanted = format!("give {}", names.join(" "));
    if params.len() != names.len() {
        let message = format!("attribute \"params\": a {word} has {}, and there are {}", names.len(), params.len());
        return Err((message, wanted));
    }
    make(params).map_err(|message| (format!("attribute \"params\": {message}"), wanted))
}

/// A parameter that is a whole number, which MuJoCo cuts off.
fn count(name: &str, value: f64, range: std::ops::RangeInclusive<u32>) -> Result<u32, String> {
    let (low, high) = (f64::from(*range.start()), f64::from(*range.end()));
    within(name, value.trunc(), low..=high).map(|value| value as u32)
}

fn within(name: &str, value: f64, range: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let [low, high] = [range.start(), range.end()];
    let above = if *low == f64::MIN_POSITIVE { "above 0".to_string() } else { format!("from {low}") };
    if range.contains(&value) { Ok(value) } else { Err(format!("{name} is {value}, not {above} to {high}")) }
}

fn rounded(vertices: impl IntoIterator<Item = DVec3>) -> Vec<DVec3> {
    vertices.into_iter().map(|p| p.as_vec3().as_dvec3()).collect()
}

/// A regular icosahedron of radius 1, each triangle of which is divided into four as often as is said.
fn sphere(subdivision: u32) -> Triangles {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let ring = |[i, j, k]: [usize; 3]| {
        [[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]].map(|[short, long]| {
            let mut p = [0.0; 3];
            (p[i], p[j], p[k]) = (short, long * golden, 0.0);
            DVec3::from(p).normalize().as_vec3()
        })
    };
    let mut vertices: Vec<Vec3> = ring([0, 1, 2]).into();
    // The other two rings run through their corners in another order.
    let [a, b, c, d] = ring([1, 2, 0]);
    vertices.extend([a, b, c, d]);
    let [a, b, c, d] = ring([2, 0, 1]);
    vertices.extend([a, b, c, d]);
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..subdivision {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let [x, y, z] = ((vertices[a as usize] + vertices[b as usize]) / 2.0).to_array();
                vertices.push(Vec3::new(x, y, z) / (x * x + y * y + z * z).sqrt());
                vertices.len() as u32 - 1
            })
        };
        let split = |[a, b, c]: [u32; 3]| {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        };
        faces = faces.into_iter().flat_map(split).collect();
    }
    Triangles { vertices: vertices.into_iter().map(Vec3::as_dvec3).collect(), faces }
}

/// The upper half of an octahedron whose vertices are moved to radius 1, in rings from its top, with its base.
fn hemisphere(resolution: u32) -> Triangles {
    let rings = resolution + 1;
    let corner = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
    let mut vertices = vec![DVec3::Z];
    let mut faces = Vec::new();
    // The first vertex of a ring; the top is a ring of one.
    let first = |ring: u32| if ring == 0 { 0 } else { 1 + 2 * ring * (ring - 1) };
    let at = |ring: u32, place: u32| if ring == 0 { 0 } else { first(ring) + place % (4 * ring) };
    for ring in 1..=rings {
        let inner = ring - 1;
        for quadrant in 0..4 {
            for k in 0..ring {
                let [from, to] = [corner[quadrant as usize], corner[(quadrant as usize + 1) % 4]];
                let flat = from * f64::from(ring - k) + to * f64::from(k) + DVec3::Z * f64::from(rings - ring);
                vertices.push(flat.normalize());
                let [a, b] = [quadrant * inner + k, quadrant * ring + k];
                faces.push([at(inner, a), at(ring, b), at(ring, b + 1)]);
                if k < inner {
                    faces.push([at(inner, a), at(ring, b + 1), at(inner, a + 1)]);
                }
            }
        }
    }
    let base = vertices.len() as u32;
    vertices.push(DVec3::ZERO);
    faces.extend((0..4 * rings).map(|k| [at(rings, k), base, at(rings, k + 1)]));
    Triangles { vertices: rounded(vertices), faces }
}

/// A pyramid between heights -1 and 1, with a regular polygon of radius 1 as its base; its tip is cut off at a radius. It has no
/// triangles but those of its hull.
fn cone(sides: u32, radius: f64) -> Triangles {
    let polygon = |radius: f64, height: f64| {
        (0..sides).map(move |k| {
            let (sin, cos) = (2.0 * PI * f64::from(k) / f64::from(sides)).sin_cos();
            DVec3::new(radius * cos, radius * sin, height)
        })
    };
    let base = polygon(1.0, -1.0);
    let vertices =
        if radius == 0.0 { rounded(base.chain([DVec3::Z])) } else { rounded(base.chain(polygon(radius, 1.0))) };
    Triangles { vertices, faces: Vec::new() }
}

/// A power of a number's magnitude, with its sign.
fn power(x: f64, exponent: f64) -> f64 {
    x.abs().powf(exponent).copysign(x)
}

/// A sphere of radius 1 in which sines and cosines of longitudes and latitudes are raised to powers.
fn supersphere(resolution: u32, [e, n]: [f64; 2]) -> Triangles {
    let (rings, share) = (resolution - 1, f64::from(resolution));
    let ring = |i: u32| {
        let (z, r) = (-0.5 * PI + PI * f64::from(i) / share).sin_cos();
        let (z, r) = (power(z, n), power(r, n));
        (0..resolution).map(move |k| {
            let (y, x) = (-PI + 2.0 * PI * f64::from(k) / share).sin_cos();
            DVec3::new(r * power(x, e), r * power(y, e), z)
        })
    };
    let mut vertices = vec![DVec3::NEG_Z];
    vertices.extend((1..=rings).flat_map(ring));
    let top = vertices.len() as u32;
    vertices.push(DVec3::Z);
    let at = |ring: u32, k: u32| 1 + ring * resolution + k % resolution;
    let round = 0..resolution;
    let mut faces: Vec<[u32; 3]> = round.clone().map(|k| [0, at(0, k + 1), at(0, k)]).collect();
    for ring in 0..rings - 1 {
        for k in round.clone() {
            faces.push([at(ring, k), at(ring, k + 1), at(ring + 1, k)]);
            faces.push([at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k)]);
        }
    }
    faces.extend(round.map(|k| [at(rings - 1, k), at(rings - 1, k + 1), top]));
    Triangles { vertices: rounded(vertices), faces }
}

/// A torus of radius 1 and a radius of its tube; sines and cosines are raised to powers, s round the tube, t round the axis.
fn supertorus(resolution: u32, radius: f64, [s, t]: [f64; 2]) -> Triangles {
    let angle = |k: u32| (2.0 * PI * f64::from(k) / f64::from(resolution)).sin_cos();
    let vertices = (0..resolution).flat_map(|i| {
        let (y, x) = angle(i);
        (0..resolution).map(move |j| {
            let (z, r) = angle(j);
            let r = 1.0 + radius * power(r, s);
            DVec3::new(r * power(x, t), r * power(y, t), radius * power(z, s))
        })
    });
    let at = |i: u32, j: u32| (i % resolution) * resolution + j % resolution;
    let square = |i: u32, j: u32| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
        [[a, b, c], [b, d, c]]
    };
    let faces = (0..resolution).flat_map(|i| (0..resolution).flat_map(move |j| square(i, j))).collect();
    Triangles { vertices: rounded(vertices), faces }
}
