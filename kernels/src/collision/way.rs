//! How far geoms can have moved since they were last looked at, from the joints' motion: an upper bound that is cheaper than to
//! look at them again.
//!
//! A joint moves a point by at most its angle times the point's distance from it. The distance between two points of a
//! tree changes by no more than the sum over the joints below its first link, that of points of different trees or of the
//! world by no more than the sum over all joints and the origin's way, on either side.

use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::{Vec3, sub};
use crate::model::{Blur, Joint, JointKind, Model, NONE, Shape};
use crate::position::{Configuration, Position};

use super::{Colliders, bound};

/// Added to every way, m: more than what rounding takes from a sum of ways.
const STEP: f64 = 1e-6;
/// By which rounding in single precision may lengthen a lever.
const ROUNDING: f64 = 1.001;
/// Units in the last place by which a link's pose is rounded, and by which a pair's bounding test is, at most.
const ULPS: [f64; 2] = [4.0, 32.0];

fn length(x: &[f64; 3]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// For every link, how far a geom's centre or a capsule's end, on it or on what it carries, can be from one of its joints,
/// as long as no slide below the first link of the tree is extended.
pub fn levers(model: &Model<f64>) -> Vec<f64> {
    let mut reach = vec![0.0_f64; model.links.len()];
    for geom in model.geoms.iter().filter(|geom| geom.link != NONE) {
        let half = if geom.shape == Shape::Capsule { geom.size[1] } else { 0.0 };
        let reach = &mut reach[geom.link as usize];
        *reach = reach.max(length(&geom.pos) + half);
    }
    for (l, link) in model.links.iter().enumerate().rev() {
        let anchors: f64 = model.joints[link.joints.range()].iter().map(|joint| length(&joint.pos)).sum();
        // A joint away from its frame moves the frame by up to twice the distance.
        reach[l] += 2.0 * anchors;
        if link.parent != NONE {
            let parent = link.parent as usize;
            reach[parent] = reach[parent].max(length(&link.pos) + reach[l]);
        }
    }
    reach.iter().map(|reach| ROUNDING * reach).collect()
}

/// The blur of a model whose [`levers`] are known.
pub fn blur(model: &Model<f64>) -> Blur<f64> {
    let mut depths = vec![1.0_f64; model.links.len()];
    for (l, link) in model.links.iter().enumerate().filter(|(_, link)| link.parent != NONE) {
        depths[l] = 1.0 + depths[link.parent as usize];
    }
    let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0_f64, f64::max);
    let still = model.geoms.iter().filter(|geom| geom.link == NONE).map(|geom| length(&geom.pos));
    let extent = largest(&mut model.levers.iter().copied().chain(still));
    let ulps = ULPS[0] * largest(&mut depths.into_iter()) + ULPS[1];
    // Of segments that are nearly parallel, those points that are found as the nearest may be farther apart by about this.
    let slip = largest(&mut model.pairs.iter().map(|pair| bound::Test::new(model, pair).slip()));
    Blur { ulps, length: ulps * extent + slip }
}

/// Least square of the norm of a quaternion for which [`turn`] has a bound: steps leave unit quaternions.
const LEAST_NORM: f64 = 0.8;

/// A bound of the largest distance between two rotations' images of a point of the unit sphere, by their quaternions; of those that
/// are far from unit quaternions, none. It is 2 |q - q'| / min(|q|, |q'|), with the sum of magnitudes for the norm of the
/// difference: a square root and a division would cost more than what a tighter bound saves.
#[inline(always)]
fn turn<L: Lane>(old: &[L], new: &[L]) -> L {
    let (mut change, mut first, mut second) = (L::zero(), L::zero(), L::zero());
    for (old, new) in old.iter().zip(new).take(4) {
        change += (*new - *old).abs();
        first = old.mul_add(*old, first);
        second = new.mul_add(*new, second);
    }
    let usual = L::of(LEAST_NORM).le(first.min(second));
    L::select(usual, change * L::of(2.0 / LEAST_NORM.sqrt()), L::of(L::Real::MAX))
}

/// How far slides below the first links of trees extend them, now and before.
#[inline(always)]
fn extension<L: Lane>(model: &Model<L::Real>, qpos: &[L], colliders: &Colliders<L>) -> L {
    let inner =
        |joint: &&Joint<L::Real>| joint.kind == JointKind::Slide && model.links[joint.link as usize].parent != NONE;
    model.joints.iter().filter(inner).fold(L::zero(), |sum, joint| {
        let (old, new) = (colliders.qpos[joint.qpos as usize], qpos[joint.qpos as usize]);
        sum + (new - L::splat(joint.qpos0)).abs() + (new - old).abs()
    })
}

/// Finds how far geoms can have moved since pairs were last tested. Returns the worlds that travelled so far, or came from
/// nowhere, that tests are due.
pub fn way<L: Lane>(
    model: &Model<L::Real>,
    configuration: Configuration<'_, L>,
    position: &Position<L>,
    colliders: &mut Colliders<L>,
) -> L::Mask {
    let qpos = configuration.qpos;
    let extension = extension(model, qpos, colliders);
    colliders.stir.fill([L::zero(); 2]);
    for joint in &model.joints {
        let link = &model.links[joint.link as usize];
        let first = link.parent == NONE;
        let (old, new) = (&colliders.qpos[joint.qpos as usize..], &qpos[joint.qpos as usize..]);
        let lever = L::splat(model.levers[joint.link as usize]) + extension;
        let stir = &mut colliders.stir[link.tree as usize][usize::from(first)];
        *stir = match joint.kind {
            // It moves the origin.
            JointKind::Slide if first => continue,
            JointKind::Slide => (new[0] - old[0]).abs() + *stir,
            JointKind::Hinge => (new[0] - old[0]).abs().mul_add(lever, *stir),
            JointKind::Ball => turn(old, new).mul_add(lever, *stir),
            JointKind::Free => turn(&old[3..], &new[3..]).mul_add(lever, *stir),
        };
    }
    for (l, link) in model.links.iter().enumerate().filter(|(_, link)| link.mocap != NONE) {
        let mocap = link.mocap as usize;
        let turn = turn(&colliders.mocap_quat[mocap], &configuration.mocap_quat[mocap]);
        colliders.stir[link.tree as usize][1] = turn * L::splat(model.levers[l]);
    }
    let mut known = L::Mask::splat(true);
    let (mut longest, mut farthest) = ([L::zero(); 2], L::zero());
    for (t, [inner, outer]) in colliders.stir.iter().enumerate() {
        let origin: Vec3<L> = sub(&position.origin[t], &colliders.origin[t]);
        let all = origin.iter().fold(*inner + *outer, |all, x| all + x.abs());
        known = known & all.within(L::Real::MAX);
        longest = [longest[0].max(*inner), longest[1].max(all)];
        let [x, y, z] = position.origin[t];
        farthest = farthest.max(x.abs() + y.abs() + z.abs());
    }
    let ulp = L::of(L::Real::EPSILON);
    let within = ulp * L::splat(model.blur.ulps).mul_add(extension, L::splat(model.blur.length));
    colliders.blur[0] = within;
    colliders.blur[1] = (ulp * L::splat(model.blur.ulps)).mul_add(farthest, within);
    let mut passed = L::Mask::splat(true);
    for (i, longest) in longest.into_iter().enumerate() {
        let way = L::select(known, longest, L::of(L::Real::MAX)) + L::of(STEP);
        colliders.way[i] = way;
        passed = passed & (colliders.travel[i] + way + colliders.blur[i]).lt(colliders.due[i]);
    }
    !passed
}

impl<L: Lane> Colliders<L> {
    /// Measures ways from these positions on.
    pub fn set_out(&mut self, configuration: Configuration<'_, L>, position: &Position<L>) {
        self.qpos.copy_from_slice(configuration.qpos);
        self.mocap_quat.copy_from_slice(configuration.mocap_quat);
        self.origin.copy_from_slice(&position.origin);
    }
}
