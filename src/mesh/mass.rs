//! Volume, centre and inertia of what a mesh encloses, or of its surface (MuJoCo's documentation of `mesh/inertia`; Mirtich,
//! Fast and accurate computation of polyhedral mass properties, 1996).

use glam::{DMat3, DVec3};

use super::Triangles;
/// What of a mesh has mass (MJCF `mesh/inertia`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MeshInertia {
    /// What its faces enclose as seen from their middle, whichever way they are turned: too much where it is not convex.
    #[default]
    Legacy,
    /// What its faces enclose; they must be turned outward and leave no holes.
    Exact,
    /// Its convex hull.
    Convex,
    /// Its surface.
    Shell,
}

/// Less volume, or area, is none.
const MINVAL: f64 = 1e-15;

/// What a mesh holds at a density of one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bulk {
    /// Volume, or area of the surface.
    pub volume: f64,
    pub centre: DVec3,
    /// Inertia about the centre.
    pub inertia: DMat3,
}

/// What a mesh holds; of convex inertia, `mesh` is its hull. The error says what is wrong with it.
pub(crate) fn bulk(mesh: &Triangles, how: MeshInertia) -> Result<Bulk, String> {
    let surface = mesh.faces.iter().map(|face| triangle(mesh.corners(*face))).fold(Sums::default(), Sums::plus);
    let middle = if surface.volume > 0.0 { surface.moment / surface.volume } else { DVec3::ZERO };
    if how == MeshInertia::Shell {
        let square = surface.square - outer(middle) * surface.volume;
        return finish(Bulk { volume: surface.volume, centre: middle, inertia: inertia(&square) }, how);
    }
    // First from the middle of the surface, then from the centre so found; where faces are all turned outward and leave no holes,
    // where from does not matter. Of the legacy way, whatever way faces are turned counts as outward.
    let turned = how == MeshInertia::Legacy;
    let centre = centre(mesh, middle, turned);
    let solids = mesh.faces.iter().map(|face| tetrahedron(mesh.corners(*face).map(|p| p - centre), turned));
    let second = solids.fold(Sums::default(), Sums::plus);
    finish(Bulk { volume: second.volume, centre, inertia: inertia(&second.square) }, how)
}

fn finish(bulk: Bulk, how: MeshInertia) -> Result<Bulk, String> {
    let (what, remedy) = match how {
        MeshInertia::Shell => ("area", "scale it up"),
        MeshInertia::Exact => ("volume", "its faces may point inward or be few; try inertia=\"convex\" or \"shell\""),
        MeshInertia::Convex | MeshInertia::Legacy => ("volume", "if it is flat, inertia=\"shell\" gives it an area"),
    };
    let Bulk { volume, .. } = bulk;
    if volume.is_nan() || volume < MINVAL {
        return Err(format!("encloses a {what} of {volume:.3e}, which is too small: {remedy}"));
    }
    Ok(bulk)
}

/// Integrals of 1, x and x xᵀ.
#[derive(Clone, Copy, Debug)]
struct Sums {
    volume: f64,
    moment: DVec3,
    square: DMat3,
}

impl Default for Sums {
    fn default() -> Self {
        Sums { volume: 0.0, moment: DVec3::ZERO, square: DMat3::ZERO }
    }
}

impl Sums {
    fn plus(self, other: Sums) -> Sums {
        Sums {
            volume: self.volume + other.volume,
            moment: self.moment + other.moment,
            square: self.square + other.square,
        }
    }
}

fn outer(p: DVec3) -> DMat3 {
    DMat3::from_cols(p * p.x, p * p.y, p * p.z)
}

fn inertia(square: &DMat3) -> DMat3 {
    let trace = square.col(0).x + square.col(1).y + square.col(2).z;
    DMat3::from_diagonal(DVec3::splat(trace)) - *square
}

/// Of the tetrahedron between the origin and a face; `turned`: counted as positive whichever way it is turned.
fn tetrahedron([a, b, c]: [DVec3; 3], turned: bool) -> Sums {
    let determinant = a.dot(b.cross(c));
    let determinant = if turned { determinant.abs() } else { determinant };
    let sum = a + b + c;
    Sums {
        volume: determinant / 6.0,
        moment: sum * (determinant / 24.0),
        square: (outer(a) + outer(b) + outer(c) + outer(sum)) * (determinant / 120.0),
    }
}

/// The centre of the tetrahedra between a point and the faces, `turned` or not. Summed in the order in which MuJoCo's number comes out,
/// to the last bit: where a mesh is symmetric, the centre is nothing but rounding.
fn centre(mesh: &Triangles, apex: DVec3, turned: bool) -> DVec3 {
    let (mut volume, mut moment) = (0.0, DVec3::ZERO);
    for [a, b, c] in mesh.faces.iter().map(|face| mesh.corners(*face)) {
        let normal = (b - a).cross(c - a);
        let length = normal.length();
        if length == 0.0 {
            continue;
        }
        let middle = (a + b + c) / 3.0;
        let own = (middle - apex).dot(normal / length) * (length / 2.0) / 3.0;
        let own = if turned { own.abs() } else { own };
        volume += own;
        moment += (middle * 0.75 + apex * 0.25) * own;
    }
    if volume > 0.0 { moment / volume } else { apex }
}

/// Of a face's area.
fn triangle([a, b, c]: [DVec3; 3]) -> Sums {
    let area = 0.5 * (b - a).cross(c - a).length();
    let sum = a + b + c;
    Sums {
        volume: area,
        moment: sum / 3.0 * area,
        square: (outer(a) + outer(b) + outer(c) + outer(sum)) * (area / 12.0),
    }
}
