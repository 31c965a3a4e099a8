//! The shortest path around a sphere or a cylinder, or through its inside along the wall.
//!
//! Everything happens in a plane through the axis of what is wrapped: that of a sphere contains both ends, that of a cylinder is across
//! it. A path outside is told by the angle that it winds about the middle, from one end to the side site and on to the other: it
//! touches where the angle is larger than tangents need. A path inside touches the wall at one point, where both of its parts make the
//! same angle with it.

use crate::lane::{Lane, Real, atan2, sin_cos};
use crate::math::vec3::{Vec3, cross, dot, norm, normalize, scale, scale_add, select};
use crate::model::{Passes, Round};

/// A path that may touch.
pub(super) struct Wrapped<L: Lane> {
    /// Where it does.
    pub wraps: L::Mask,
    /// Where it arrives and leaves, in the frame of what is wrapped.
    pub touches: [Vec3<L>; 2],
    /// Length between the two.
    pub arc: L,
}

/// A point of the plane.
type Flat<L> = [L; 2];

/// The path between `ends`, all in the frame of what is wrapped. `side` counts unless the path passes anywhere.
#[inline(always)]
pub(super) fn wrap<L: Lane>(
    round: Round,
    passes: Passes,
    radius: L,
    ends: &[Vec3<L>; 2],
    side: &Vec3<L>,
) -> Wrapped<L> {
    let axes = match round {
        Round::Sphere => plane(ends),
        Round::Cylinder => [[L::one(), L::zero(), L::zero()], [L::zero(), L::one(), L::zero()]],
    };
    let flat = |point: &Vec3<L>| match round {
        Round::Sphere => [dot(point, &axes[0]), dot(point, &axes[1])],
        Round::Cylinder => [point[0], point[1]],
    };
    let [from, to] = [flat(&ends[0]), flat(&ends[1])];
    let touch = match passes {
        Passes::Anywhere => outside(radius, &from, &to, None),
        Passes::Outside => outside(radius, &from, &to, Some(&flat(side))),
        Passes::Inside => inside(radius, &from, &to),
        Passes::Either => {
            let within = norm(side).lt(radius);
            let (out, inner) = (outside(radius, &from, &to, Some(&flat(side))), inside(radius, &from, &to));
            let pick = |k: usize| [0, 1].map(|c: usize| L::select(within, inner.points[k][c], out.points[k][c]));
            Touch {
                wraps: (within & inner.wraps) | (!within & out.wraps),
                points: [pick(0), pick(1)],
                arc: L::select(within, inner.arc, out.arc),
            }
        }
    };
    let Touch { wraps, points: [first, second], arc } = touch;
    if round == Round::Sphere {
        let lifted = |[x, y]: Flat<L>| scale_add(x, &axes[0], &scale(y, &axes[1]));
        return Wrapped { wraps, touches: [lifted(first), lifted(second)], arc };
    }
    // Along the cylinder the path rises evenly.
    let (before, after) = (length(&minus(&first, &from)), length(&minus(&second, &to)));
    let rise = (ends[1][2] - ends[0][2]) / (before + arc + after).max(L::of(L::Real::MINVAL));
    let heights = [rise.mul_add(before, ends[0][2]), rise.mul_add(before + arc, ends[0][2])];
    let climbed = rise * arc;
    Wrapped {
        wraps,
        touches: [[first[0], first[1], heights[0]], [second[0], second[1], heights[1]]],
        arc: arc.mul_add(arc, climbed * climbed).sqrt(),
    }
}

/// Where a path touches a circle.
struct Touch<L: Lane> {
    wraps: L::Mask,
    points: [Flat<L>; 2],
    arc: L,
}

/// Two axes of the plane of a sphere's middle and both ends, the first towards the first end; any plane where these are in line.
#[inline(always)]
fn plane<L: Lane>(ends: &[Vec3<L>; 2]) -> [Vec3<L>; 2] {
    let (first, _) = normalize(&ends[0]);
    let (zero, one) = (L::zero(), L::one());
    let [x, y, z] = first.map(L::abs);
    let (x_most, y_most) = (x.gt(y) & x.gt(z), y.gt(z));
    let other = select(x_most, &[zero, one, one], &select(y_most, &[one, zero, one], &[one, one, zero]));
    let (normal, size) = normalize(&cross(&first, &normalize(&ends[1]).0));
    let normal = select(size.lt(L::of(L::Real::MINVAL)), &cross(&first, &other), &normal);
    [first, normalize(&cross(&normal, &first)).0]
}

#[inline(always)]
fn minus<L: Lane>(a: &Flat<L>, b: &Flat<L>) -> Flat<L> {
    [a[0] - b[0], a[1] - b[1]]
}

#[inline(always)]
fn product<L: Lane>(a: &Flat<L>, b: &Flat<L>) -> L {
    a[1].mul_add(b[1], a[0] * b[0])
}

/// a × b
#[inline(always)]
fn turn<L: Lane>(a: &Flat<L>, b: &Flat<L>) -> L {
    a[1].neg_mul_add(b[0], a[0] * b[1])
}

#[inline(always)]
fn length<L: Lane>(a: &Flat<L>) -> L {
    product(a, a).sqrt()
}

/// Angle from one direction to another.
#[inline(always)]
fn angle<L: Lane>(a: &Flat<L>, b: &Flat<L>) -> L {
    atan2(turn(a, b), product(a, b))
}

/// A point turned by an angle.
#[inline(always)]
fn turned<L: Lane>([x, y]: &Flat<L>, sin: L, cos: L) -> Flat<L> {
    [sin.neg_mul_add(*y, cos * *x), cos.mul_add(*y, sin * *x)]
}

/// Along the outside of a circle, on the side of `side`, or the shorter one.
#[inline(always)]
fn outside<L: Lane>(radius: L, from: &Flat<L>, to: &Flat<L>, side: Option<&Flat<L>>) -> Touch<L> {
    let (zero, one, least) = (L::zero(), L::one(), L::of(L::Real::MINVAL));
    let winds = side.map_or_else(|| angle(from, to), |side| angle(from, side) + angle(side, to));
    let sign = L::select(winds.lt(zero), -one, one);
    let reach = [from, to].map(|end| length(end));
    let beyond = !reach[0].lt(radius) & !reach[1].lt(radius) & !radius.lt(least);
    // Seen from the middle, a tangent takes so much of the angle.
    let tangent = |reach: L| {
        let reach = reach.max(radius).max(least);
        let high = ((reach - radius) * (reach + radius)).sqrt();
        (high, atan2(high, radius), radius / (reach * reach))
    };
    let [(from_high, from_angle, from_share), (to_high, to_angle, to_share)] = reach.map(tangent);
    let left = winds.abs() - from_angle - to_angle;
    let arc = radius * left.max(zero);
    Touch {
        wraps: beyond & left.gt(zero),
        points: [
            turned(from, from_share * sign * from_high, from_share * radius),
            turned(to, -(to_share * sign * to_high), to_share * radius),
        ],
        arc,
    }
}

/// Most steps towards the point that a path inside touches, and how near is near enough: MuJoCo's, so that both stop at the same point.
const STEPS: usize = 20;
const NEAR: f64 = 1e-6;
/// What rounding leaves of the sum of angles, in units in the last place: in single precision, nothing is nearer.
const ROUNDING: f64 = 32.0;

/// The angle whose sine is a times that of another, and what it gains with that.
#[inline(always)]
fn leaning<L: Lane>(a: L, (sin, cos): (L, L)) -> (L, L) {
    let sine = a * sin;
    let cosine = ((L::one() - sine) * (L::one() + sine)).max(L::zero()).sqrt();
    (atan2(sine, cosine), a * cos / cosine.max(L::of(L::Real::MINVAL)))
}

/// Through the inside of a circle, touching the wall once: with the wall's normal there, both parts of the path make an angle u for
/// which asin(a sin u) + asin(b sin u) - 2 u + g = 0, a and b the radius over the ends' distances, g the angle between them. Newton's
/// method comes to it from a right angle without ever passing it.
#[inline(always)]
fn inside<L: Lane>(radius: L, from: &Flat<L>, to: &Flat<L>) -> Touch<L> {
    let (zero, one, half, least) = (L::zero(), L::one(), L::of(0.5), L::of(L::Real::MINVAL));
    let near = L::of(NEAR.max(ROUNDING * L::Real::EPSILON));
    let reach = [from, to].map(|end| length(end));
    let span = minus(to, from);
    let square = product(&span, &span);
    let within = reach[0].le(radius) | reach[1].le(radius) | radius.lt(least) | reach[0].lt(least) | reach[1].lt(least);
    // The straight line runs through the circle.
    let along = -product(from, &span) / L::select(square.gt(least), square, one);
    let nearest = [along.mul_add(span[0], from[0]), along.mul_add(span[1], from[1])];
    let through = square.gt(least) & along.gt(zero) & along.lt(one) & length(&nearest).le(radius);
    let safe = reach.map(|reach| reach.max(radius).max(least));
    let cos = L::select(within, one, product(from, to) / (safe[0] * safe[1]));
    let wraps = !(within | through | cos.lt(L::of(L::Real::MINVAL - 1.0)));
    let [a, b] = safe.map(|reach| radius / reach);
    let between = atan2(turn(from, to).abs(), product(from, to));
    let value = |u: L| {
        let turn = sin_cos(u);
        let ((first, first_rate), (second, second_rate)) = (leaning(a, turn), leaning(b, turn));
        (first + second - (u + u) + between, first_rate + second_rate - L::of(2.0))
    };
    let mut u = L::of(std::f64::consts::FRAC_PI_2);
    let (mut f, mut rate) = value(u);
    let mut fails = cos.gt(L::of(1.0 - L::Real::MINVAL)) | f.gt(zero);
    let mut open = !fails & f.abs().gt(near);
    for _ in 0..STEPS {
        let flat = rate.gt(-least);
        let next = u - f / L::select(flat, -one, rate);
        let lost = open & (flat | next.gt(u));
        fails = fails | lost;
        open = open & !lost;
        u = L::select(open, next, u);
        let (next_f, next_rate) = value(u);
        (f, rate) = (L::select(open, next_f, f), L::select(open, next_rate, rate));
        fails = fails | (open & f.gt(near));
        open = open & !fails & f.abs().gt(near);
    }
    fails = fails | open;
    // From the end from which the point lies counter-clockwise.
    let first = turn(from, to).gt(zero);
    let pick = |x: L, y: L| L::select(first, x, y);
    let (start, share) = ([pick(from[0], to[0]), pick(from[1], to[1])], pick(a, b));
    let (sin, cos) = sin_cos(u - leaning(share, sin_cos(u)).0);
    let [x, y] = turned(&start, sin, cos);
    let mean = [half * (from[0] + to[0]), half * (from[1] + to[1])];
    let width = length(&mean);
    let narrow = width.lt(least);
    let mean_size = radius / L::select(narrow, one, width);
    let mean = [L::select(narrow, radius, mean_size * mean[0]), L::select(narrow, zero, mean_size * mean[1])];
    let point = [L::select(fails, mean[0], share * x), L::select(fails, mean[1], share * y)];
    Touch { wraps, points: [point, point], arc: zero }
}
