//! Velocities of links and the bias force (Coriolis, centrifugal, gravity) by the recursive Newton-Euler algorithm
//! (Featherstone 2008, §5.3).

mod tendons;

pub use tendons::stretching;

use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::math::spatial::{Spatial, cross_force, cross_motion, dot6, inertia_mul};
use crate::math::vec3::{add, scale_add, zero};
use crate::model::{DofKind, Instance, Link, Model, NONE};
use crate::position::Position;
use crate::tendon::Tendons;

fields! {
    /// Velocities and the bias force.
    pub struct Velocity(sizes) {
        /// Velocity of each link (ω; v) at its tree's origin, world axes.
        pub cvel: Vec<[L; 6]> = sizes.nlink,
        /// Acceleration of each link with zero joint accelerations, gravity as an upward acceleration of the world.
        pub cacc: Vec<[L; 6]> = sizes.nlink,
        /// Force that each link and all that it carries need for that acceleration.
        pub cfrc: Vec<[L; 6]> = sizes.nlink,
        /// Bias force c, on the left of M a + c = τ + Jᵀf.
        pub qfrc_bias: Vec<L> = sizes.nv,
    } L
}

/// Link velocities, and the bias force from velocities `qvel`.
pub fn rne<L: Lane>(
    model: Instance<'_, L>,
    (position, tendons, inertia): (&Position<L>, &Tendons<L>, &Inertia<L>),
    qvel: &[L],
    velocity: &mut Velocity<L>,
) {
    for (l, link) in model.links.iter().enumerate() {
        let (mut v, mut a) = if link.parent == NONE {
            let g = model.gravity();
            (zero(), [L::zero(), L::zero(), L::zero(), -g[0], -g[1], -g[2]])
        } else {
            (velocity.cvel[link.parent as usize], velocity.cacc[link.parent as usize])
        };
        joint_motion(&model, link, position, qvel, &mut v, &mut a);
        let i = &inertia.link[l];
        velocity.cvel[l] = v;
        velocity.cacc[l] = a;
        velocity.cfrc[l] = add(&inertia_mul(i, &a), &cross_force(&v, &inertia_mul(i, &v)));
    }
    for (l, link) in model.links.iter().enumerate().rev() {
        let force = velocity.cfrc[l];
        for i in link.dofs.range() {
            velocity.qfrc_bias[i] = dot6(&position.cdof[i], &force);
        }
        if link.parent != NONE {
            let parent = &mut velocity.cfrc[link.parent as usize];
            *parent = add(parent, &force);
        }
    }
    tendons::resist(&model, position, tendons, &model.gravity(), velocity);
}

/// Adds a link's joint motions to velocity `v` and, through the rates of their axes, to acceleration `a`. The rate of an
/// axis follows from the velocity before its dof; the rotations of a ball or free joint share the velocity before the
/// joint, and translations of a free joint do not turn.
#[inline(always)]
fn joint_motion<L: Lane>(
    model: &Model<L::Real>,
    link: &Link<L::Real>,
    position: &Position<L>,
    qvel: &[L],
    v: &mut Spatial<L>,
    a: &mut Spatial<L>,
) {
    let mut i = link.dofs.start as usize;
    let end = link.dofs.range().end;
    while i < end {
        match model.dofs[i].kind {
            DofKind::FreeTranslation(_) => {
                for k in 0..3 {
                    v[3 + k] += qvel[i + k];
                }
                i += 3;
            }
            DofKind::FreeRotation(_) | DofKind::BallRotation(_) => {
                let before = *v;
                let mut spin = zero();
                for k in i..i + 3 {
                    spin = scale_add(qvel[k], &position.cdof[k], &spin);
                }
                *a = add(a, &cross_motion(&before, &spin));
                *v = add(v, &spin);
                i += 3;
            }
            DofKind::Slide | DofKind::Hinge => {
                let motion = position.cdof[i].map(|s| s * qvel[i]);
                *a = add(a, &cross_motion(v, &motion));
                *v = add(v, &motion);
                i += 1;
            }
        }
    }
}
