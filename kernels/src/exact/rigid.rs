//! The derivative of rigid bodies' inverse dynamics, M a + c, by positions and velocities, in one pass over the tree each way (Singh,
//! Russo, Wensing, Efficient analytical derivatives of rigid-body dynamics using spatial vector algebra, RA-L 2022).
//!
//! A step s of a dof turns what it carries, as one body. Seen from there only what comes from above has changed: the velocity of every link by
//! u = v₋ × s, its acceleration by w + u × v with w = a₋ × s + v₋ × u, where v₋ and a₋ are the velocity and acceleration before the joint. A link's
//! force gains I w + K u from it, K that of [`bias`]. Seen from outside, the force turns as well, by s ×* f.

use crate::derivative::bias::{gained, turns};
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::math::spatial::{Spatial, cross_force, cross_motion, dot6, inertia_mul, join, lin, rot};
use crate::math::vec3::{Mat3, Vec3, add, build, cross, dot, mul, mul_t, scale, scale_add, zero};
use crate::model::{DofKind, Instance, Model, NONE, Sizes};
use crate::position::Position;

/// Motions, and what links and all that they carry do with them.
#[derive(Clone, Debug)]
pub(super) struct Rigid<L> {
    /// By dof, the velocity before its joint, about the tree's origin.
    pub before: Vec<[L; 6]>,
    /// By dof, the part of the acceleration before its joint that comes from the dofs' accelerations.
    pub pull_before: Vec<[L; 6]>,
    /// By link, that part.
    pub pull: Vec<[L; 6]>,
    /// By link, the acceleration, gravity as one of the world.
    pub acceleration: Vec<[L; 6]>,
    /// By link, the velocity.
    pub velocity: Vec<[L; 6]>,
    /// By dof, u.
    pub rate: Vec<[L; 6]>,
    /// By dof, w.
    pub curl: Vec<[L; 6]>,
    /// By dof, what its velocity adds to accelerations.
    pub turn: Vec<[L; 6]>,
    /// By link and all that it carries: the force.
    pub force: Vec<[L; 6]>,
    /// The same: T and p of [`bias`](crate::derivative).
    pub gain: Vec<[L; 12]>,
}

impl<L: Lane> Rigid<L> {
    /// Room for a model of these sizes.
    pub fn new(sizes: &Sizes) -> Self {
        Rigid {
            before: vec![zero(); sizes.nv],
            pull_before: vec![zero(); sizes.nv],
            pull: vec![zero(); sizes.nlink],
            acceleration: vec![zero(); sizes.nlink],
            velocity: vec![zero(); sizes.nlink],
            rate: vec![zero(); sizes.nv],
            curl: vec![zero(); sizes.nv],
            turn: vec![zero(); sizes.nv],
            force: vec![zero(); sizes.nlink],
            gain: vec![zero(); sizes.nlink],
        }
    }
}

/// Which motions there are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motions<'a, L> {
    /// Velocities.
    pub qvel: &'a [L],
    /// Accelerations.
    pub qacc: &'a [L],
    /// Whether there is gravity.
    pub gravity: bool,
}

/// Velocities, accelerations and forces of links.
pub(super) fn move_links<L: Lane>(
    model: Instance<'_, L>,
    (position, inertia): (&Position<L>, &Inertia<L>),
    motions: Motions<'_, L>,
    rigid: &mut Rigid<L>,
) {
    let Motions { qvel, qacc, gravity } = motions;
    for (l, link) in model.links.iter().enumerate() {
        let (mut v, mut a, mut pull) = match link.parent {
            NONE if gravity => {
                let g = model.gravity();
                (zero(), [L::zero(), L::zero(), L::zero(), -g[0], -g[1], -g[2]], zero())
            }
            NONE => (zero(), zero(), zero()),
            parent => {
                let parent = parent as usize;
                (rigid.velocity[parent], rigid.acceleration[parent], rigid.pull[parent])
            }
        };
        turns(&model, link.dofs.range(), v, &position.cdof, qvel, &mut rigid.turn);
        let mut i = link.dofs.range().start;
        while i < link.dofs.range().end {
            let count = together(model.dofs[i].kind);
            let (mut spin, mut own) = (zero(), zero());
            for k in i..i + count {
                let s = &position.cdof[k];
                (rigid.before[k], rigid.pull_before[k]) = (v, pull);
                let still = matches!(model.dofs[k].kind, DofKind::FreeTranslation(_));
                let u = if still { zero() } else { cross_motion(&v, s) };
                rigid.rate[k] = u;
                rigid.curl[k] = if still { zero() } else { add(&cross_motion(&a, s), &cross_motion(&v, &u)) };
                (spin, own) = (scale_add(qvel[k], s, &spin), scale_add(qacc[k], s, &own));
            }
            let still = matches!(model.dofs[i].kind, DofKind::FreeTranslation(_));
            let turned = if still { zero() } else { cross_motion(&v, &spin) };
            a = add(&add(&a, &turned), &own);
            (v, pull) = (add(&v, &spin), add(&pull, &own));
            i += count;
        }
        (rigid.velocity[l], rigid.acceleration[l], rigid.pull[l]) = (v, a, pull);
        let own = &inertia.link[l];
        rigid.force[l] = add(&inertia_mul(own, &a), &cross_force(&v, &inertia_mul(own, &v)));
        rigid.gain[l] = gained(own, &v);
    }
    for (l, link) in model.links.iter().enumerate().rev() {
        if link.parent != NONE {
            let (force, gain) = (rigid.force[l], rigid.gain[l]);
            let parent = link.parent as usize;
            rigid.force[parent] = add(&rigid.force[parent], &force);
            rigid.gain[parent] = add(&rigid.gain[parent], &gain);
        }
    }
}

/// How many dofs act at once.
pub(super) fn together(kind: DofKind) -> usize {
    match kind {
        DofKind::Slide | DofKind::Hinge => 1,
        DofKind::FreeTranslation(_) | DofKind::FreeRotation(_) | DofKind::BallRotation(_) => 3,
    }
}

/// The dofs that turn together with dof `i`, all of which are carried by each other: it alone, or the rotations of its joint.
pub(super) fn group<T>(model: &Model<T>, i: usize) -> std::ops::Range<usize> {
    let dof = &model.dofs[i];
    let first = match dof.kind {
        DofKind::FreeRotation(k) | DofKind::BallRotation(k) => i - k as usize,
        _ => return i..i + 1,
    };
    first..first + 3
}

/// K u.
fn gain_times<L: Lane>(gain: &[L; 12], u: &Spatial<L>) -> Spatial<L> {
    let (matrix, momentum) = parts(gain);
    let w = rot(u);
    join(&mul(&matrix, &w), &scale(L::of(2.0), &cross(&w, &momentum)))
}

/// Kᵀ s, of which only what meets rotations is not zero.
fn gain_met<L: Lane>(gain: &[L; 12], s: &Spatial<L>) -> Vec3<L> {
    let (matrix, momentum) = parts(gain);
    scale_add(L::of(2.0), &cross(&momentum, &lin(s)), &mul_t(&matrix, &rot(s)))
}

fn parts<L: Lane>(gain: &[L; 12]) -> (Mat3<L>, Vec3<L>) {
    (build(|k| gain[k]), build(|k| gain[9 + k]))
}

/// Adds the derivatives of M a + c by positions, and if they are wanted by velocities, to the first columns of a matrix with `width` columns, rows first.
pub(super) fn differentiate<L: Lane>(
    model: &Model<L::Real>,
    (position, inertia, rigid): (&Position<L>, &Inertia<L>, &Rigid<L>),
    velocities: bool,
    (width, slopes): (usize, &mut [L]),
) {
    let nv = model.sizes.nv;
    for i in 0..nv {
        let link = model.dofs[i].link as usize;
        let (composite, gain, axis) = (&inertia.composite[link], &rigid.gain[link], &position.cdof[i]);
        let own = group(model, i);
        // What this dof feels of those that carry it, and of those that turn with it.
        let (held, felt) = (inertia_mul(composite, axis), gain_met(gain, axis));
        // What its own step does to those that carry it.
        let turned = cross_force(axis, &rigid.force[link]);
        let moved = add(&add(&inertia_mul(composite, &rigid.curl[i]), &gain_times(gain, &rigid.rate[i])), &turned);
        let sped = add(&inertia_mul(composite, &rigid.turn[i]), &gain_times(gain, axis));
        let mut each = |j: usize| {
            let s = &position.cdof[j];
            slopes[width * i + j] += dot6(&held, &rigid.curl[j]) + dot(&felt, &rot(&rigid.rate[j]));
            if velocities {
                slopes[width * i + nv + j] += dot6(&held, &rigid.turn[j]) + dot(&felt, &rot(s));
            }
            if !own.contains(&j) {
                slopes[width * j + i] += dot6(&moved, s);
                if velocities {
                    slopes[width * j + nv + i] += dot6(&sped, s);
                }
            }
        };
        own.clone().for_each(&mut each);
        ancestors(model, own.start).for_each(each);
    }
}

/// The dofs that carry dof `i`, up to the root.
pub(super) fn ancestors<T>(model: &Model<T>, i: usize) -> impl Iterator<Item = usize> {
    let parent = |i: usize| Some(model.dofs[i].parent).filter(|parent| *parent != NONE).map(|parent| parent as usize);
    std::iter::successors(parent(i), move |i| parent(*i))
}
