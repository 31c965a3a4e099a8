//! The frame of a contact.

use crate::lane::Lane;
use crate::math::vec3::{Mat3, Vec3, cross, dot, normalize, scale_add, select};

/// Rows normal, tangent 1, tangent 2. The first tangent follows the hint, if it has length, else the world's y axis, or z
/// where the normal is nearly along y.
#[inline(always)]
pub fn contact_frame<L: Lane>(normal: &Vec3<L>, hint: &Vec3<L>) -> Mat3<L> {
    let (z, one) = (L::zero(), L::one());
    let upright = normal[1].abs().lt(L::of(0.5));
    let default = select(upright, &[z, one, z], &[z, z, one]);
    let hint = select(dot(hint, hint).lt(L::of(0.25)), &default, hint);
    let (t1, _) = normalize(&scale_add(-dot(normal, &hint), normal, &hint));
    let t2 = cross(normal, &t1);
    [normal[0], normal[1], normal[2], t1[0], t1[1], t1[2], t2[0], t2[1], t2[2]]
}
