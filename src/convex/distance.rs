//! Distance of two cores: the algorithm of Gilbert, Johnson and Keerthi (1988), with the nearest point of a simplex by
//! Voronoi regions (Ericson, Real-Time Collision Detection, 2005, §5.1, §9.5) and van den Bergen's bound for stopping
//! (Collision Detection in Interactive 3D Environments, 2003, §4.3).

use glam::DVec3;

use super::Nearest;
use super::support::{Solid, Vertex, combine, difference};

/// Most iterations; smooth shapes take a few dozen.
const ITERATIONS: usize = 128;
/// Gap between the distance and its lower bound, relative to the distance, at which the search ends.
const GAP: f64 = 1e-14;

/// What the search finds.
pub(super) enum Outcome {
    /// Farther apart than asked for, along a direction from the first to the second.
    Far(DVec3),
    /// Apart.
    Apart(Nearest),
    /// Penetrating, or closer than can be told.
    Touching,
}

/// Up to four vertices and the weights of the point of their hull that is nearest to the origin.
#[derive(Clone, Copy, Default)]
struct Simplex {
    len: usize,
    vertices: [Vertex; 4],
    weights: [f64; 4],
}

impl Simplex {
    fn of(picked: &[(Vertex, f64)]) -> Simplex {
        let mut out = Simplex::default();
        for (vertex, weight) in picked.iter().take(4) {
            out.vertices[out.len] = *vertex;
            out.weights[out.len] = *weight;
            out.len += 1;
        }
        out
    }

    fn point(&self) -> DVec3 {
        (0..self.len).map(|i| self.vertices[i].at * self.weights[i]).sum()
    }
}

/// Whether the cores are farther apart than `reach` along a direction from the first to the second; of none, it is not known.
pub(super) fn is_far(solids: &[Solid<'_>; 2], reach: f64, along: DVec3) -> bool {
    along != DVec3::ZERO && along.dot(difference(solids, -along).at) > reach * along.length()
}

/// Distance of the cores if it is above `touching` and at most `reach`.
pub(super) fn distance(solids: &[Solid<'_>; 2], reach: f64, touching: f64) -> Outcome {
    let mut simplex = Simplex::of(&[(difference(solids, solids[0].centre - solids[1].centre), 1.0)]);
    let mut v = simplex.point();
    for _ in 0..ITERATIONS {
        let length = v.length();
        if length <= touching {
            return Outcome::Touching;
        }
        let vertex = difference(solids, -v);
        let bound = v.dot(vertex.at) / length;
        if bound > reach {
            return Outcome::Far(v);
        }
        let known = simplex.vertices[..simplex.len].iter().any(|x| x.at == vertex.at);
        if known || length - bound <= GAP * length {
            break;
        }
        simplex.vertices[simplex.len] = vertex;
        simplex.len += 1;
        // A plane that separates is proof, whatever rounding makes of a flat tetrahedron.
        let Some(next) = nearest(&simplex, bound > touching) else { return Outcome::Touching };
        let closer = next.point();
        if closer.length_squared() >= v.length_squared() {
            // No more progress in this precision: the simplex before was as good.
            simplex.len -= 1;
            break;
        }
        (simplex, v) = (next, closer);
    }
    let length = v.length();
    let on = combine(&simplex.vertices[..simplex.len], &simplex.weights);
    Outcome::Apart(Nearest { dist: length, normal: v / length, on })
}

/// The face, edge or vertex of a simplex nearest to the origin; `None` if a tetrahedron holds the origin, which one of shapes
/// that are `apart` cannot.
fn nearest(simplex: &Simplex, apart: bool) -> Option<Simplex> {
    let [a, b, c, d] = simplex.vertices;
    match simplex.len {
        1 => Some(Simplex::of(&[(a, 1.0)])),
        2 => Some(on_segment(a, b)),
        3 => Some(on_triangle(a, b, c)),
        _ => on_tetrahedron([a, b, c, d], apart),
    }
}

fn on_segment(a: Vertex, b: Vertex) -> Simplex {
    let along = b.at - a.at;
    let t = -a.at.dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
    if t <= 0.0 {
        Simplex::of(&[(a, 1.0)])
    } else if t >= 1.0 {
        Simplex::of(&[(b, 1.0)])
    } else {
        Simplex::of(&[(a, 1.0 - t), (b, t)])
    }
}

fn on_triangle(a: Vertex, b: Vertex, c: Vertex) -> Simplex {
    let (ab, ac) = (b.at - a.at, c.at - a.at);
    let normal = ab.cross(ac);
    let area = normal.length_squared();
    // The origin's barycentric coordinates, by areas.
    let u = b.at.cross(c.at).dot(normal);
    let v = c.at.cross(a.at).dot(normal);
    let w = a.at.cross(b.at).dot(normal);
    if area > 0.0 && u > 0.0 && v > 0.0 && w > 0.0 {
        let sum = u + v + w;
        return Simplex::of(&[(a, u / sum), (b, v / sum), (c, w / sum)]);
    }
    least([on_segment(a, b), on_segment(a, c), on_segment(b, c)])
}

/// The simplex that comes nearest to the origin; the first of equals.
fn least<const N: usize>(simplices: [Simplex; N]) -> Simplex {
    let mut best = simplices[0];
    for simplex in &simplices[1..] {
        if simplex.point().length_squared() < best.point().length_squared() {
            best = *simplex;
        }
    }
    best
}

fn on_tetrahedron([a, b, c, d]: [Vertex; 4], apart: bool) -> Option<Simplex> {
    let volume = (b.at - a.at).cross(c.at - a.at).dot(d.at - a.at);
    // The origin is inside if it is on the inner side of every face.
    let side = |p: Vertex, q: Vertex, r: Vertex, inner: Vertex| {
        let normal = (q.at - p.at).cross(r.at - p.at);
        normal.dot(inner.at - p.at) * -normal.dot(p.at) > 0.0
    };
    if !apart && volume != 0.0 && side(a, b, c, d) && side(a, b, d, c) && side(a, c, d, b) && side(b, c, d, a) {
        return None;
    }
    Some(least([on_triangle(a, b, c), on_triangle(a, b, d), on_triangle(a, c, d), on_triangle(b, c, d)]))
}
