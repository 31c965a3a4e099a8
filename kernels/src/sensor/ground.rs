//! Rays and height fields: the ground's surface, the walls below its edges, and the box that it stands on.

use super::ray::{Nearest, distance, normal, triangle};
use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::{Vec3, scale_add, select, zero};
use crate::model::{HeightField, Shape};

/// Whether a mask holds in some lane, for whoever may ask.
pub(super) type Any<'a, M> = &'a dyn Fn(M) -> bool;

/// The part of a ray that is of interest, from one distance along it to another.
#[derive(Clone, Copy)]
struct Stretch<L: Lane> {
    from: L,
    to: L,
}

impl<L: Lane> Stretch<L> {
    /// What of it is between two planes across one axis, where the ray starts at `p` and goes by `v`.
    #[inline(always)]
    fn between(self, p: L, v: L, [low, high]: [L; 2]) -> Self {
        let turned = v.abs().gt(L::of(L::Real::MINVAL));
        let inverse = L::one() / L::select(turned, v, L::one());
        let (a, b) = ((low - p) * inverse, (high - p) * inverse);
        let inside = low.le(p) & p.le(high);
        let end = |own: L, else_: L| L::select(turned, own, L::select(inside, else_, -L::one()));
        let most = L::of(L::Real::MAXVAL);
        Stretch { from: self.from.max(end(a.min(b), L::zero())), to: self.to.min(end(a.max(b), most)) }
    }

    /// Where there is any of it.
    fn some(self) -> L::Mask {
        self.from.le(self.to)
    }
}

/// Distance along a ray from `p` in direction `v`, in the field's axes, to the ground, and the normal there; -1: it is not met.
pub(super) fn meet<L: Lane>(field: &HeightField, p: &Vec3<L>, v: &Vec3<L>, any: Any<'_, L::Mask>) -> (L, Vec3<L>) {
    let box_ = [field.half[0], field.half[1], 0.5 * field.base].map(L::of);
    let above = [p[0], p[1], p[2] + box_[2]];
    let mut met = (Nearest::none(), zero());
    let at = distance(Shape::Box, &box_, &above, v);
    let taken = met.0.take(at, L::Mask::splat(true));
    met.1 = select(taken, &normal(Shape::Box, &box_, &scale_add(at, v, &above)), &met.1);
    // A little more than the box about the ground, for rounding.
    let top = field.heights.iter().copied().fold(0.0, f64::max);
    let wide = |x: f64| [L::of(-x * (1.0 + 1e-6)), L::of(x * (1.0 + 1e-6))];
    let mut stretch = Stretch { from: L::zero(), to: L::of(L::Real::MAXVAL) };
    for (axis, ends) in [wide(field.half[0]), wide(field.half[1]), wide(top + 1e-6)].into_iter().enumerate() {
        stretch = stretch.between(p[axis], v[axis], ends);
    }
    if any(stretch.some()) {
        surface(field, (p, v), stretch, any, &mut met);
        for (axis, side) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)] {
            wall(field, (p, v), (axis, side), any, &mut met);
        }
    }
    (met.0.0, met.1)
}

/// The triangles of the cells above or below which the ray passes.
fn surface<L: Lane>(
    field: &HeightField,
    (p, v): (&Vec3<L>, &Vec3<L>),
    stretch: Stretch<L>,
    any: Any<'_, L::Mask>,
    (nearest, normal): &mut (Nearest<L>, Vec3<L>),
) {
    let [width, length] = field.cell();
    let [rows, columns] = field.size;
    let ends = |number: usize, cell: f64, half: f64| {
        [number as f64 - 1e-3, number as f64 + 1.001].map(|edge| L::of(edge * cell - half))
    };
    for row in 0..rows - 1 {
        let over = stretch.between(p[1], v[1], ends(row, length, field.half[1]));
        if !any(over.some()) {
            continue;
        }
        for column in 0..columns - 1 {
            if !any(over.between(p[0], v[0], ends(column, width, field.half[0])).some()) {
                continue;
            }
            let corner = |i: usize, j: usize| field.point(row + i, column + j).map(L::of);
            for other in [[corner(1, 1), corner(0, 1)], [corner(1, 0), corner(1, 1)]] {
                let (at, ok, own) = triangle([corner(0, 0), other[0], other[1]], p, v);
                let nearer = nearest.take(at, ok);
                // It shows upwards.
                let up = own[2].lt(L::zero());
                *normal = select(nearer, &own.map(|x| L::select(up, -x, x)), normal);
            }
        }
    }
}

/// The wall below an edge, across `axis`.
fn wall<L: Lane>(
    field: &HeightField,
    (p, v): (&Vec3<L>, &Vec3<L>),
    (axis, side): (usize, f64),
    any: Any<'_, L::Mask>,
    (nearest, normal): &mut (Nearest<L>, Vec3<L>),
) {
    let turned = v[axis].abs().gt(L::of(L::Real::MINVAL));
    let at = (L::of(side * field.half[axis]) - p[axis]) / L::select(turned, v[axis], L::one());
    let along = 1 - axis;
    let (x, z) = (at.mul_add(v[along], p[along]), at.mul_add(v[2], p[2]));
    let ok = turned & at.ge(L::zero()) & z.ge(L::zero()) & x.abs().le(L::of(field.half[along]));
    if !any(ok) {
        return;
    }
    let [rows, columns] = field.size;
    let cell = field.cell()[along];
    let last = if side < 0.0 { 0 } else { [columns, rows][axis] - 1 };
    let height = |i: usize| if axis == 0 { field.point(i, last)[2] } else { field.point(last, i)[2] };
    for i in 0..[columns, rows][along] - 1 {
        let (low, high) = (height(i), height(i + 1));
        let share = (x + L::of(field.half[along])) * L::of(1.0 / cell) - L::of(i as f64);
        let here = ok & share.ge(L::zero()) & share.le(L::one());
        let below = z.lt(share.mul_add(L::of(high - low), L::of(low)));
        let nearer = nearest.take(at, here & below);
        let mut outward = zero();
        outward[axis] = L::of(side);
        *normal = select(nearer, &outward, normal);
    }
}
