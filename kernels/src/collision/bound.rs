//! The bounding test of a pair: how far apart two geoms are at least.
//!
//! A capsule counts as what it is, a segment with a radius; any other shape is within its bounding sphere; a plane stands
//! still. Whether a pair is near follows from a world's own numbers, by the same operations in kernels and in code.

use crate::lane::{Lane, Real, Scalar};
use crate::math::vec3::{Vec3, dot, scale_add, sub};
use crate::model::{Geom, Model, Pair, Shape};
use crate::position::{Position, kinematics};

use super::body::{Frames, Rod, body};

/// What rounding may take from a distance, in units of the geoms' sizes.
const SLACK: f64 = 1e-3;
/// The largest gap that is told apart, in units of a pair's reach, and a smaller one: between them, the square root of the
/// squared distance is bounded from below by chords.
const FAR: f64 = 8.0;
const CLOSE: f64 = 1.0;

/// The bounding test of a pair.
#[derive(Clone, Debug)]
pub(super) struct Test {
    pub geoms: [u32; 2],
    /// Where the geoms are.
    pub frames: Frames,
    /// Whether the first geom is a plane.
    plane: bool,
    /// Half lengths of capsules.
    halves: [f64; 2],
    /// Distance of centres or segments, or height above the plane, within which the pair is near.
    reach: f64,
}

impl Test {
    pub fn new<T: Real>(model: &Model<T>, pair: &Pair<T>) -> Self {
        let geoms = [pair.geom1, pair.geom2];
        let both = geoms.map(|g| &model.geoms[g as usize]);
        let capsule = |geom: &Geom<T>| geom.shape == Shape::Capsule;
        let radius = |geom: &Geom<T>| if capsule(geom) { geom.size[0] } else { geom.rbound }.to_f64();
        let size: f64 = both.iter().map(|geom| geom.rbound.to_f64()).sum();
        Test {
            geoms,
            frames: Frames::new(model, pair),
            plane: both[0].shape == Shape::Plane,
            halves: both.map(|geom| if capsule(geom) { geom.size[1].to_f64() } else { 0.0 }),
            reach: (pair.include.to_f64() + radius(both[0]) + radius(both[1]) + SLACK * size).max(T::MINVAL),
        }
    }

    /// Which way counts: that within one tree, or that in the world.
    #[inline(always)]
    pub fn frame(&self) -> usize {
        usize::from(self.frames.trees[0] != self.frames.trees[1])
    }

    /// How much farther apart than the nearest points of two segments those that [`segments`] finds may be, in units of the last
    /// place of 1, m.
    pub fn slip(&self) -> f64 {
        let half = self.halves[0].min(self.halves[1]);
        4.0 * half * half / self.reach
    }

    /// Where the pair is near, and a lower bound of the distance by which it is not.
    #[inline(always)]
    pub fn near<L: Lane>(&self, [pos1, axis1]: &Rod<L>, [pos2, axis2]: &Rod<L>) -> (L::Mask, L) {
        let between = sub(pos2, pos1);
        let [half1, half2] = self.halves.map(L::of);
        let reach = L::of(self.reach);
        if self.plane {
            let height = dot(axis1, &between);
            let lowest = if self.halves[1] > 0.0 { dot(axis1, axis2).abs().neg_mul_add(half2, height) } else { height };
            return (lowest.le(reach), lowest - reach);
        }
        let apart = match self.halves.map(|half| half > 0.0) {
            [false, false] => between,
            [true, false] => to_segment(&between, axis1, half1),
            [false, true] => to_segment(&between, axis2, half2),
            [true, true] => segments(&between, (axis1, half1), (axis2, half2)),
        };
        let square = dot(&apart, &apart);
        let inner = square - L::of(self.reach * self.reach);
        let close = inner * L::of(1.0 / ((2.0 + CLOSE) * self.reach));
        let beyond = square - L::of((1.0 + CLOSE) * (1.0 + CLOSE) * self.reach * self.reach);
        let far = beyond.mul_add(L::of(1.0 / ((2.0 + CLOSE + FAR) * self.reach)), L::of(CLOSE * self.reach));
        // The last operand is what remains where one is not a number: a gap that nobody knows must not pass for a wide one.
        (inner.le(L::zero()), L::of(FAR * self.reach).min(close.min(far)))
    }
}

/// What is left of the difference of two centres where one of them may move along an axis.
#[inline(always)]
fn to_segment<L: Lane>(between: &Vec3<L>, axis: &Vec3<L>, half: L) -> Vec3<L> {
    scale_add(-dot(axis, between).clamp(-half, half), axis, between)
}

/// The difference of nearest points of two segments, about: of those that are nearly parallel, no points are nearer by
/// more than the slack.
#[inline(always)]
fn segments<L: Lane>(between: &Vec3<L>, (axis1, half1): (&Vec3<L>, L), (axis2, half2): (&Vec3<L>, L)) -> Vec3<L> {
    let cos = dot(axis1, axis2);
    let (u, v) = (dot(axis1, between), -dot(axis2, between));
    let sin2 = cos.neg_mul_add(cos, L::one()).max(L::of(L::Real::EPSILON));
    let first = (cos.mul_add(v, u) / sin2).clamp(-half1, half1);
    let second = first.mul_add(cos, v).clamp(-half2, half2);
    let first = second.mul_add(cos, u).clamp(-half1, half1);
    let apart = scale_add(second, axis2, between);
    scale_add(-first, axis1, &apart)
}

/// The model's pairs, those first that are nearest in the reference configuration.
pub(super) fn nearest_first<T: Scalar>(model: &Model<T>) -> Vec<u32> {
    let mut position = Position::<T>::new(&model.sizes);
    kinematics(model.into(), (&model.qpos0[..]).into(), &mut position);
    let gap = |pair: &Pair<T>| {
        let test = Test::new(model, pair);
        let [first, second] = test.geoms.map(|g| body(model.into(), &position, g as usize));
        let [first, second] = test.frames.place(&position, [first, second]);
        test.near(&first.rod(), &second.rod()).1.to_f64()
    };
    let gaps: Vec<f64> = model.pairs.iter().map(gap).collect();
    let mut order: Vec<u32> = (0..model.pairs.len() as u32).collect();
    order.sort_by(|a, b| gaps[*a as usize].total_cmp(&gaps[*b as usize]));
    order
}

/// The bounding tests of some pairs, from the poses of links: tells where each is near, and lower bounds of the distances by which
/// the pairs within a tree, and others, are not. All distances are finite: the compiler and the check of states answer for that.
pub fn near_pairs<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    pairs: &[u32],
    near: &mut dyn FnMut(L::Mask),
    gaps: &mut [L],
) {
    gaps.fill(L::of(L::Real::MAX));
    for p in pairs {
        let test = Test::new(model, &model.pairs[*p as usize]);
        let bodies = test.geoms.map(|g| body(model.into(), position, g as usize));
        let [first, second] = test.frames.place(position, bodies);
        let (mask, gap) = test.near(&first.rod(), &second.rod());
        near(mask);
        let frame = test.frame();
        gaps[frame] = gap.min(gaps[frame]);
    }
}
