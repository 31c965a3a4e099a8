//! Poses: the algebra of frames that are fixed to each other.

use glam::{DMat3, DQuat, DVec3};

/// Position and orientation of a frame in another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    pub pos: DVec3,
    pub quat: DQuat,
}

impl Pose {
    pub const IDENTITY: Pose = Pose { pos: DVec3::ZERO, quat: DQuat::IDENTITY };

    /// From MJCF's numbers; the quaternion is normalised.
    pub fn new(pos: [f64; 3], quat: [f64; 4]) -> Pose {
        Pose { pos: DVec3::from(pos), quat: unit_quat(quat) }
    }

    /// The pose, in the frame of `self`'s parent, of a frame given in `self`.
    pub fn then(&self, inner: &Pose) -> Pose {
        Pose { pos: self.pos + self.quat * inner.pos, quat: self.quat * inner.quat }
    }

    /// The pose, in `self`, of a frame given in the frame of `self`'s parent.
    pub fn inverse_then(&self, outer: &Pose) -> Pose {
        let inverse = self.quat.conjugate();
        Pose { pos: inverse * (outer.pos - self.pos), quat: inverse * outer.quat }
    }

    /// A pose in a body whose inertia has the frame `inertia`: where position and orientation, or the orientation alone, are nearly
    /// those of the body or of its inertia, exactly those. MuJoCo does the same (`geom_sameframe`), to copy frames.
    pub fn settled(&self, inertia: &Pose) -> Pose {
        const NEAR: f64 = 1e-6;
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < NEAR);
        let at = |other: &Pose| close(&self.pos.to_array(), &other.pos.to_array());
        let along = |other: &Pose| close(&self.wxyz(), &other.wxyz()) || close(&self.wxyz(), &wxyz(-other.quat));
        let body = Pose::IDENTITY;
        let whole = [&body, inertia].into_iter().find(|other| at(other) && along(other));
        let turned = || [&body, inertia].into_iter().find(|other| along(other));
        match whole {
            Some(other) => *other,
            None => Pose { quat: turned().map_or(self.quat, |other| other.quat), ..*self },
        }
    }

    /// Orientation as (w, x, y, z).
    pub fn wxyz(&self) -> [f64; 4] {
        wxyz(self.quat)
    }

    /// Orientation as a matrix.
    pub fn rotation(&self) -> DMat3 {
        rotation(self.quat)
    }
}

/// The unit quaternion along (w, x, y, z); the identity if that is zero or not finite.
pub(crate) fn unit_quat([w, x, y, z]: [f64; 4]) -> DQuat {
    let q = DQuat::from_xyzw(x, y, z, w);
    let norm = q.length();
    if norm > 0.0 && norm.is_finite() { q / norm } else { DQuat::IDENTITY }
}

/// The components as (w, x, y, z).
pub(crate) fn wxyz(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

/// The rotation matrix. Entries that rounding alone keeps from 0 or ±1 are set to those: right angles then cost nothing
/// in recorded kernels.
pub(crate) fn rotation(q: DQuat) -> DMat3 {
    let clean = |v: DVec3| DVec3::new(snap(v.x), snap(v.y), snap(v.z));
    let m = DMat3::from_quat(q);
    DMat3::from_cols(clean(m.x_axis), clean(m.y_axis), clean(m.z_axis))
}

/// 0 or ±1 if `x` is within rounding of it.
pub(crate) fn snap(x: f64) -> f64 {
    const NEAR: f64 = 1e-15;
    if x.abs() < NEAR {
        0.0
    } else if (x.abs() - 1.0).abs() < NEAR {
        x.signum()
    } else {
        x
    }
}

/// A matrix row by row.
pub(crate) fn row_major(m: DMat3) -> [f64; 9] {
    m.transpose().to_cols_array()
}

/// The matrix of the cross product with `v`.
pub(crate) fn skew(v: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, v.z, -v.y), DVec3::new(-v.z, 0.0, v.x), DVec3::new(v.y, -v.x, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes_then() {
        let outer = Pose::new([1.0, 2.0, 3.0], [0.5, -0.1, 0.7, 0.2]);
        let inner = Pose::new([-2.0, 0.5, 1.0], [0.1, 0.9, 0.0, 0.3]);
        let back = outer.inverse_then(&outer.then(&inner));
        assert!((back.pos - inner.pos).length() < 1e-15);
        assert!((back.quat - inner.quat).length() < 1e-15);
    }

    #[test]
    fn right_angles_are_exact() {
        let quarter = Pose::new([0.0; 3], [1.0, 1.0, 0.0, 0.0]);
        assert_eq!(row_major(quarter.rotation()), [1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0]);
    }

    #[test]
    fn skew_is_the_cross_product() {
        let (a, b) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 5.0, 0.5));
        assert_eq!(skew(a) * b, a.cross(b));
    }
}
