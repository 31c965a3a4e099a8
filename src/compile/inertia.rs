//! Mass, centre of mass and inertia of bodies.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec3};

use super::pose::{Pose, rotation, unit_quat};
use crate::spec::{self, GeomMass, Inertia, InertiaFromGeom, Shape};

/// Tolerance of principal axes that are as good as rounding lets them be.
const EXACT: f64 = 1e-17;
/// Geoms of less mass do not count.
const NEGLIGIBLE: f64 = 1e-14;

/// Mass, the frame of the principal axes at the centre of mass, and the principal moments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mass {
    pub mass: f64,
    pub frame: Pose,
    pub inertia: DVec3,
}

impl Mass {
    /// No mass, at a frame.
    pub fn none(frame: Pose) -> Mass {
        Mass { mass: 0.0, frame, inertia: DVec3::ZERO }
    }

    /// The same, with the frame given in a frame in which its present one has pose `pose`.
    pub fn moved(&self, pose: &Pose) -> Mass {
        Mass { frame: pose.then(&self.frame), ..*self }
    }

    /// Inertia about the centre of mass in the axes in which `frame` is given.
    pub fn tensor(&self) -> DMat3 {
        let r = self.frame.rotation();
        r * DMat3::from_diagonal(self.inertia) * r.transpose()
    }

    /// The principal moments break the triangle rule A + B ≥ C by more than rounding.
    pub fn violates_triangle(&self) -> bool {
        let [a, b, c] = self.inertia.to_array();
        let slack = 1.0 + 1e-12;
        (a + b) * slack < c || (a + c) * slack < b || (b + c) * slack < a
    }

    /// Whether a body that moves may have it.
    pub fn can_move(&self) -> bool {
        const MINVAL: f64 = 1e-15;
        self.mass >= MINVAL && self.inertia.min_element() >= MINVAL
    }
}

/// The mass of rigidly connected parts, in the frame in which theirs are given. A lone part is left as it is.
pub(crate) fn combine(parts: &[Mass]) -> Mass {
    if let [one] = parts {
        return *one;
    }
    let (mass, com, tensor) = total(parts);
    let (inertia, quat) = principal(tensor, EXACT);
    Mass { mass, frame: Pose { pos: com, quat }, inertia }
}

/// Total mass, centre of mass and inertia about it.
pub(crate) fn total(parts: &[Mass]) -> (f64, DVec3, DMat3) {
    let mass: f64 = parts.iter().map(|p| p.mass).sum();
    let mut com = DVec3::ZERO;
    if mass > 0.0 {
        // A lone part keeps its centre to the last bit.
        com = match parts {
            [one] => one.frame.pos,
            _ => parts.iter().map(|p| p.frame.pos * p.mass).sum::<DVec3>() / mass,
        };
    }
    let tensor = parts.iter().fold(DMat3::ZERO, |sum, p| sum + p.tensor() + parallel_axis(p.mass, p.frame.pos - com));
    (mass, com, tensor)
}

/// What a point mass at distance `d` adds to an inertia.
pub(crate) fn parallel_axis(mass: f64, d: DVec3) -> DMat3 {
    let outer = DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    (DMat3::from_diagonal(DVec3::splat(d.length_squared())) - outer) * mass
}

/// Principal moments of a symmetric matrix, descending, and the orientation of their axes (Jacobi's method). Entries beside the
/// diagonal, and differences of moments, up to `tolerance` times the largest entry count as zero.
pub(crate) fn principal(tensor: DMat3, tolerance: f64) -> (DVec3, DQuat) {
    let mut a = tensor;
    let mut axes = DMat3::IDENTITY;
    // Convergence is quadratic: a handful of sweeps reach rounding.
    for _ in 0..50 {
        let off = [(a.col(1)[0], 0, 1), (a.col(2)[0], 0, 2), (a.col(2)[1], 1, 2)];
        let &(x, p, q) = off.iter().max_by(|l, r| l.0.abs().total_cmp(&r.0.abs())).expect("three entries");
        let scale = a.col(0)[0].abs().max(a.col(1)[1].abs()).max(a.col(2)[2].abs());
        if !x.is_finite() || x.abs() <= tolerance * scale || x == 0.0 {
            break;
        }
        let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * x);
        let t = 1.0 / (theta.abs() + (theta * theta + 1.0).sqrt()) * if theta < 0.0 { -1.0 } else { 1.0 };
        let c = 1.0 / (t * t + 1.0).sqrt();
        let mut rotate = DMat3::IDENTITY;
        rotate.col_mut(p)[p] = c;
        rotate.col_mut(q)[q] = c;
        rotate.col_mut(q)[p] = t * c;
        rotate.col_mut(p)[q] = -t * c;
        a = rotate.transpose() * a * rotate;
        axes *= rotate;
    }
    let mut moments = [a.col(0)[0], a.col(1)[1], a.col(2)[2]];
    let equal = if tolerance > EXACT { tolerance * moments.iter().copied().fold(0.0, f64::max) } else { 0.0 };
    // Sorted by quarter turns about the axis that stays: of the frames that have these axes MuJoCo takes this one.
    for (i, j, axis) in [(0, 1, DVec3::Z), (1, 2, DVec3::X), (0, 1, DVec3::Z)] {
        if moments[j] > moments[i] + equal {
            moments.swap(i, j);
            axes *= rotation(DQuat::from_axis_angle(axis, 0.5 * PI));
        }
    }
    let quat = DQuat::from_mat3(&axes);
    (DVec3::from(moments), unit_quat([quat.w, quat.x, quat.y, quat.z]))
}

/// Volume of a shape, or its area if the mass lies on the surface.
pub(crate) fn measure(shape: Shape, size: [f64; 3], shell: bool) -> f64 {
    let [r, l, _] = size;
    let h = 2.0 * l;
    let [a, b, c] = size;
    match (shape, shell) {
        // What a mesh weighs was found with its frame.
        (Shape::Plane | Shape::Mesh, _) => 0.0,
        (Shape::Sphere, false) => 4.0 / 3.0 * PI * r.powi(3),
        (Shape::Sphere, true) => 4.0 * PI * r * r,
        (Shape::Capsule, false) => PI * r * r * (4.0 / 3.0 * r + h),
        (Shape::Capsule, true) => 2.0 * PI * r * (2.0 * r + h),
        (Shape::Cylinder, false) => PI * r * r * h,
        (Shape::Cylinder, true) => 2.0 * PI * r * (r + h),
        (Shape::Ellipsoid, false) => 4.0 / 3.0 * PI * a * b * c,
        (Shape::Ellipsoid, true) => {
            // Thomsen's approximation.
            let p = 1.6075;
            let mean = ((a * b).powf(p) + (a * c).powf(p) + (b * c).powf(p)) / 3.0;
            4.0 * PI * mean.powf(1.0 / p)
        }
        (Shape::Box | Shape::HeightField, false) => 8.0 * a * b * c,
        (Shape::Box | Shape::HeightField, true) => 8.0 * (a * b + a * c + b * c),
    }
}

/// Principal moments of a shape of mass `m`, along its axes.
pub(crate) fn moments(shape: Shape, size: [f64; 3], shell: bool, m: f64) -> DVec3 {
    let [r, l, _] = size;
    let h = 2.0 * l;
    let [a, b, c] = size;
    let round = |x: f64, z: f64| DVec3::new(x, x, z);
    match (shape, shell) {
        (Shape::Plane | Shape::Mesh, _) => DVec3::ZERO,
        (Shape::Sphere, false) => DVec3::splat(0.4 * m * r * r),
        (Shape::Sphere, true) => DVec3::splat(2.0 / 3.0 * m * r * r),
        (Shape::Capsule, false) => {
            let ball = m * 4.0 * r / (4.0 * r + 3.0 * h);
            let tube = m - ball;
            round(
                tube * (3.0 * r * r + h * h) / 12.0 + 0.4 * ball * r * r + ball * h * (3.0 * r + 2.0 * h) / 8.0,
                0.5 * tube * r * r + 0.4 * ball * r * r,
            )
        }
        (Shape::Capsule, true) => {
            let ball = m * 2.0 * r / (2.0 * r + h);
            let tube = m - ball;
            let caps = 2.0 / 3.0 * ball * r * r;
            // The centre of a hemisphere's shell is half a radius from its plane.
            let shift = ball * ((l + 0.5 * r).powi(2) - (0.5 * r).powi(2));
            round(tube * (6.0 * r * r + h * h) / 12.0 + caps + shift, tube * r * r + caps)
        }
        (Shape::Cylinder, false) => round(m * (3.0 * r * r + h * h) / 12.0, 0.5 * m * r * r),
        (Shape::Cylinder, true) => {
            let disk = m * r / (2.0 * (r + h));
            let tube = m - 2.0 * disk;
            round(
                tube * (6.0 * r * r + h * h) / 12.0 + 2.0 * disk * (0.25 * r * r + l * l),
                tube * r * r + disk * r * r,
            )
        }
        (Shape::Ellipsoid, false) => solid_ellipsoid(size) * m,
        (Shape::Ellipsoid, true) => {
            let thickness = 1e-6;
            let outer = size.map(|s| s + thickness);
            let (inner_volume, outer_volume) = (a * b * c, outer[0] * outer[1] * outer[2]);
            let difference = solid_ellipsoid(outer) * outer_volume - solid_ellipsoid(size) * inner_volume;
            difference * (m / (outer_volume - inner_volume))
        }
        (Shape::Box | Shape::HeightField, false) => DVec3::new(b * b + c * c, a * a + c * c, a * a + b * b) * (m / 3.0),
        (Shape::Box | Shape::HeightField, true) => {
            let area = measure(shape, size, true);
            // One pair of faces at ±d along an axis with half sizes e, f along the others: inertia about the axis of d,
            // of e and of f.
            let faces = |d: f64, e: f64, f: f64| {
                let pair = m * 8.0 * e * f / area;
                let (about_d, about_e, about_f) = ((e * e + f * f) / 3.0, f * f / 3.0 + d * d, e * e / 3.0 + d * d);
                [pair * about_d, pair * about_e, pair * about_f]
            };
            let [xx, xy, xz] = faces(a, b, c);
            let [yy, yx, yz] = faces(b, a, c);
            let [zz, zx, zy] = faces(c, a, b);
            DVec3::new(xx + yx + zx, yy + xy + zy, zz + xz + yz)
        }
    }
}

/// Principal moments of a solid ellipsoid of mass one.
fn solid_ellipsoid([a, b, c]: [f64; 3]) -> DVec3 {
    DVec3::new(b * b + c * c, a * a + c * c, a * a + b * b) / 5.0
}

/// Mass of a geom at a pose in the body.
fn of_geom(geom: &spec::Geom, pose: Pose) -> Mass {
    let mass = match geom.mass {
        _ if geom.shape == Shape::Plane => 0.0,
        GeomMass::Solid { mass, moments } => return Mass { mass, frame: pose, inertia: DVec3::from(moments) },
        GeomMass::Mass(mass) => mass,
        GeomMass::Density(density) => density * measure(geom.shape, geom.size, geom.shellinertia),
    };
    Mass { mass, frame: pose, inertia: moments(geom.shape, geom.size, geom.shellinertia, mass) }
}

/// Mass of the geoms of a body that count, if any do.
pub(crate) fn of_geoms<'a>(
    geoms: impl Iterator<Item = (&'a spec::Geom, Pose)>,
    compiler: &spec::Compiler,
) -> Option<Mass> {
    let [low, high] = compiler.inertiagrouprange;
    let counted = geoms.filter(|(g, _)| (low..=high).contains(&g.group));
    let parts: Vec<Mass> = counted.map(|(g, pose)| of_geom(g, pose)).filter(|m| m.mass > NEGLIGIBLE).collect();
    (!parts.is_empty()).then(|| combine(&parts))
}

/// Mass of a body as written, before bounds: from `inertial` or from geoms, if it has either. `Err`: why a full inertia
/// is refused.
pub(crate) fn of_body(body: &spec::Body, compiler: &spec::Compiler) -> Result<Option<Mass>, &'static str> {
    let from_geoms = || of_geoms(body.geoms.iter().map(|g| (g, Pose::new(g.pos, g.quat))), compiler);
    let written = || body.inertial.as_ref().map(of_inertial).transpose();
    match compiler.inertiafromgeom {
        InertiaFromGeom::False => written(),
        InertiaFromGeom::Auto if body.inertial.is_some() => written(),
        InertiaFromGeom::Auto => Ok(from_geoms()),
        InertiaFromGeom::True => match from_geoms() {
            None => written(),
            some => Ok(some),
        },
    }
}

fn of_inertial(inertial: &spec::Inertial) -> Result<Mass, &'static str> {
    let pos = DVec3::from(inertial.pos);
    match inertial.inertia {
        Inertia::Diagonal(d) => Ok(Mass {
            mass: inertial.mass,
            frame: Pose { pos, quat: unit_quat(inertial.quat) },
            inertia: DVec3::from(d),
        }),
        Inertia::Full([xx, yy, zz, xy, xz, yz]) => {
            let tensor = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
            let (moments, quat) = principal(tensor, EXACT);
            if moments.z <= 0.0 {
                return Err("the full inertia is not positive definite");
            }
            Ok(Mass { mass: inertial.mass, frame: Pose { pos, quat }, inertia: moments })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(shape: Shape, shell: bool, mass: f64, inertia: [f64; 3]) {
        let size = match shape {
            Shape::Sphere => [0.1, 0.0, 0.0],
            Shape::Capsule | Shape::Cylinder => [0.1, 0.3, 0.0],
            _ => [0.1, 0.2, 0.3],
        };
        let got = 1000.0 * measure(shape, size, shell);
        assert!((got - mass).abs() < 1e-13 * mass, "mass {got} instead of {mass}");
        let got = moments(shape, size, shell, mass);
        let error = (got - DVec3::from(inertia)).abs().max_element() / got.max_element();
        // An ellipsoid's shell is the difference of two solids that differ by a millionth.
        let tolerance = if shape == Shape::Ellipsoid && shell { 1e-8 } else { 1e-13 };
        assert!(error < tolerance, "{got} instead of {inertia:?}: {error:e}");
    }

    /// Figures of MuJoCo 4.0.0.
    #[test]
    fn primitives() {
        check(Shape::Sphere, false, 4.188790204786391, [0.01675516081914557; 3]);
        check(Shape::Sphere, true, 125.66370614359174, [0.8377580409572783; 3]);
        check(Shape::Capsule, false, 23.038346126325152, [1.1006046263076243, 1.1006046263076243, 0.11100294042683936]);
        check(Shape::Capsule, true, 502.65482457436696, [29.112091923265417, 29.112091923265417, 4.607669225265031]);
        check(Shape::Cylinder, false, 18.84955592153876, [0.6126105674500096, 0.6126105674500096, 0.0942477796076938]);
        check(Shape::Cylinder, true, 439.82297150257097, [19.006635554218246, 19.006635554218246, 4.084070449666731]);
        check(
            Shape::Ellipsoid,
            false,
            25.132741228718345,
            [0.653451271946677, 0.5026548245743669, 0.25132741228718347],
        );
        check(Shape::Ellipsoid, true, 489.7193333371731, [18.075174882542342, 14.068366576335393, 8.102680936804973]);
        check(Shape::Box, false, 48.00000000000001, [2.0800000000000005, 1.6000000000000003, 0.8000000000000003]);
        check(Shape::Box, true, 880.0, [54.13333333333334, 42.13333333333334, 24.266666666666673]);
    }

    #[test]
    fn principal_axes_rebuild_the_tensor() {
        let tensor =
            DMat3::from_cols(DVec3::new(3.0, 0.1, -0.7), DVec3::new(0.1, 4.0, 0.3), DVec3::new(-0.7, 0.3, 3.5));
        let (inertia, quat) = principal(tensor, EXACT);
        assert!(inertia.x >= inertia.y && inertia.y >= inertia.z);
        let mass = Mass { mass: 1.0, frame: Pose { pos: DVec3::ZERO, quat }, inertia };
        assert!((mass.tensor() - tensor).to_cols_array().iter().all(|x| x.abs() < 1e-14));
    }

    /// Of the frames along the principal axes, MuJoCo 4.0.0's.
    #[test]
    fn principal_axes_are_sorted_by_quarter_turns() {
        let (inertia, quat) = principal(DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.0)), EXACT);
        assert_eq!(inertia, DVec3::new(3.0, 2.0, 1.0));
        let half = 0.5f64.sqrt();
        assert!((quat - DQuat::from_xyzw(half, 0.0, half, 0.0)).length() < 1e-15, "{quat}");
    }

    /// A sphere and a box, figures of MuJoCo 4.0.0.
    #[test]
    fn two_geoms() {
        let geom = |shape, size, pos| spec::Geom { shape, size, pos, ..Default::default() };
        let body = spec::Body {
            geoms: vec![
                geom(Shape::Sphere, [0.1, 0.0, 0.0], [1.0, 0.0, 0.0]),
                geom(Shape::Box, [0.1, 0.2, 0.3], [0.0, 1.0, 0.0]),
            ],
            ..Default::default()
        };
        let mass = of_body(&body, &spec::Compiler::default()).unwrap().unwrap();
        assert!((mass.mass - 52.1887902047864).abs() < 1e-12);
        assert!((mass.frame.pos - DVec3::new(0.08026225916235598, 0.919737740837644, 0.0)).length() < 1e-15);
        let expected = DVec3::new(9.569400295328954, 8.521932040405327, 1.8492869058955188);
        assert!((mass.inertia - expected).length() < 1e-13);
    }
}
