//! A point of one body on a point of another, or a frame on a frame.

use super::{Held, Motion, Rates};
use crate::lane::Lane;
use crate::math::quat::{self, Quat};
use crate::math::spatial::{Spatial, lin, rot};
use crate::math::vec3::{Mat3, Vec3, add, cross, cross_add, dot, mul_add, mul_t, scale, splat, sub, zero};
use crate::model::{Equality, EqualityKind, Instance, NONE};

/// The two points, and what the rows of orientation are made of.
pub(super) struct Sides<L> {
    /// Each relative to the origin of its tree, or in the world.
    points: [Vec3<L>; 2],
    turn: Option<Turn<L>>,
}

/// With E the first frame's orientation in the second's, a relative rotation at ω is seen in the second as u, and changes E by
/// ½ (0, u) ∘ E.
struct Turn<L> {
    /// Orientation of the second frame.
    second: Mat3<L>,
    /// E.
    error: Quat<L>,
    /// Half the length that stands for a radian.
    half: L,
}

impl<L: Lane> Turn<L> {
    #[inline(always)]
    fn new(equality: &Equality<L::Real>, quats: &[Quat<L>]) -> Self {
        let frame = |side: usize| {
            let own = splat(&equality.quat[side]);
            let link = equality.links[side];
            if link == NONE { own } else { quat::mul(&quats[link as usize], &own) }
        };
        let (first, second) = (frame(0), frame(1));
        Turn {
            error: quat::mul(&quat::conjugate(&second), &first),
            second: quat::to_matrix(&second),
            half: L::splat(equality.torquescale) * L::of(0.5),
        }
    }

    /// The vector of ½ s (w, u) ∘ E.
    #[inline(always)]
    fn vector(&self, w: L, u: &Vec3<L>) -> Vec3<L> {
        let [e0, e1, e2, e3] = self.error;
        let e = [e1, e2, e3];
        scale(self.half, &add(&scale(e0, u), &cross_add(u, &e, &scale(w, &e))))
    }

    /// Rates of the rows at a relative rotation, world axes.
    #[inline(always)]
    fn rates(&self, rotation: &Vec3<L>) -> Vec3<L> {
        self.vector(L::zero(), &mul_t(&self.second, rotation))
    }

    /// What these rates change by, at a relative acceleration, where the second frame turns at `spin`.
    #[inline(always)]
    fn drift(&self, rotation: &Vec3<L>, acceleration: &Vec3<L>, spin: &Vec3<L>) -> Vec3<L> {
        let u = mul_t(&self.second, rotation);
        let change = mul_t(&self.second, &cross_add(rotation, spin, acceleration));
        self.vector(-(dot(&u, &u) * L::of(0.5)), &change)
    }
}

impl<L: Lane> Sides<L> {
    /// The column of a dof with the given motion, which moves one of the sides, or both.
    #[inline(always)]
    pub fn rates(&self, motion: &Spatial<L>, moves: [bool; 2]) -> [L; 6] {
        let of = |side: usize| {
            if moves[side] { (velocity(motion, &self.points[side]), rot(motion)) } else { (zero(), zero()) }
        };
        let (first, second) = (of(0), of(1));
        self.rows(&sub(&first.0, &second.0), &sub(&first.1, &second.1))
    }

    /// All rows, from how the first point moves relative to the second and how the first frame turns.
    #[inline(always)]
    fn rows(&self, shift: &Vec3<L>, rotation: &Vec3<L>) -> [L; 6] {
        let turn = self.turn.as_ref().map_or_else(zero, |turn| turn.rates(rotation));
        [shift[0], shift[1], shift[2], turn[0], turn[1], turn[2]]
    }
}

/// Velocity of a point.
#[inline(always)]
fn velocity<L: Lane>(motion: &Spatial<L>, point: &Vec3<L>) -> Vec3<L> {
    cross_add(&rot(motion), point, &lin(motion))
}

/// r = p₁ - p₂, and of frames s times the vector of E.
#[inline(always)]
pub(super) fn held<L: Lane>(
    model: Instance<'_, L>,
    equality: &Equality<L::Real>,
    motion: Motion<'_, L>,
    quats: &[Quat<L>],
) -> Held<L> {
    let Motion { position, velocity: moving, .. } = motion;
    let point = |side: usize| {
        let (link, own) = (equality.links[side], splat(&equality.pos[side]));
        if link == NONE { own } else { mul_add(&position.rot[link as usize], &own, &position.pos[link as usize]) }
    };
    let points = [point(0), point(1)];
    let off = position.moved(&model, &sub(&points[0], &points[1]), equality.links[0], equality.links[1]);
    let turn = (equality.kind == EqualityKind::Weld).then(|| Turn::new(equality, quats));
    let sides = Sides { points, turn };

    let gravity = model.gravity();
    let still = [L::zero(), L::zero(), L::zero(), -gravity[0], -gravity[1], -gravity[2]];
    let twist = equality.links.map(|link| if link == NONE { zero() } else { moving.cvel[link as usize] });
    let change = equality.links.map(|link| if link == NONE { still } else { moving.cacc[link as usize] });
    let speeds = [0, 1].map(|side: usize| velocity(&twist[side], &points[side]));
    let accelerations = [0, 1]
        .map(|side: usize| add(&velocity(&change[side], &points[side]), &cross(&rot(&twist[side]), &speeds[side])));
    let rotation = sub(&rot(&twist[0]), &rot(&twist[1]));
    let shift = sub(&accelerations[0], &accelerations[1]);
    let (mut angle, mut drift) = (zero(), zero());
    if let Some(turn) = &sides.turn {
        let [_, e1, e2, e3] = turn.error;
        angle = scale(turn.half + turn.half, &[e1, e2, e3]);
        drift = turn.drift(&rotation, &sub(&rot(&change[0]), &rot(&change[1])), &rot(&twist[1]));
    }
    Held {
        pos: [off[0], off[1], off[2], angle[0], angle[1], angle[2]],
        drift: [shift[0], shift[1], shift[2], drift[0], drift[1], drift[2]],
        rates: Rates::Sides(sides),
    }
}
