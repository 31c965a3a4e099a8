//! Forces of a medium on bodies, each taken for a box of the same inertia (MuJoCo's documentation, Computation, Fluid forces: the inertia
//! model). Along and about every axis of the box, drag grows with the square of the speed, and viscous resistance, that of a sphere of
//! about its size, with the speed.

use std::f64::consts::PI;

use crate::lane::{Lane, Real};
use crate::math::spatial::{Spatial, join, lin, rot};
use crate::math::tree;
use crate::math::vec3::{Mat3, Vec3, build, cross_add, mul, mul_add, mul_mat, mul_t, splat, sub};
use crate::model::{Instance, Model, NONE};
use crate::position::Position;
use crate::velocity::Velocity;

/// A body, or a geom, in the medium.
pub(super) struct Immersed<L> {
    /// Orientation of its axes.
    axes: Mat3<L>,
    /// Its centre relative to the tree's origin.
    at: Vec3<L>,
}

impl<L: Lane> Immersed<L> {
    #[inline(always)]
    pub fn new(link: u32, pos: &[L::Real; 3], rot: &[L::Real; 9], position: &Position<L>) -> Immersed<L> {
        let turn = &position.rot[link as usize];
        let at = mul_add(turn, &splat(pos), &position.pos[link as usize]);
        Immersed { axes: mul_mat(turn, &splat(rot)), at }
    }

    /// Angular velocity and velocity of the centre, along the axes, of a motion at the tree's origin.
    #[inline(always)]
    pub fn along(&self, motion: &Spatial<L>, wind: &Vec3<L>) -> [Vec3<L>; 2] {
        let speed = sub(&cross_add(&rot(motion), &self.at, &lin(motion)), wind);
        [mul_t(&self.axes, &rot(motion)), mul_t(&self.axes, &speed)]
    }

    /// A torque and a force along the axes, as a wrench at the tree's origin.
    #[inline(always)]
    pub fn wrench(&self, [torque, force]: &[Vec3<L>; 2]) -> Spatial<L> {
        let (torque, force) = (mul(&self.axes, torque), mul(&self.axes, force));
        join(&cross_add(&self.at, &force, &torque), &force)
    }
}

/// Adds the forces of the medium.
pub(super) fn add<L: Lane>(
    model: Instance<'_, L>,
    position: &Position<L>,
    velocity: &Velocity<L>,
    qfrc_passive: &mut [L],
) {
    let wind = build(|k| L::of(model.options.wind[k]));
    for fluid in &model.fluids {
        let body = Immersed::new(fluid.link, &fluid.pos, &fluid.rot, position);
        let moving = body.along(&velocity.cvel[fluid.link as usize], &wind);
        let resisted: [Vec3<L>; 2] = [0, 1].map(|part: usize| {
            build(|k| {
                let speed = moving[part][k];
                -L::splat(fluid.square[part][k]).mul_add(speed.abs(), L::splat(fluid.linear[part])) * speed
            })
        });
        tree::push(&model, &position.cdof, fluid.link as usize, &body.wrench(&resisted), qfrc_passive);
    }
}

/// Adds h times what resistance gains with velocity to the rows of a matrix. It is symmetric.
pub(crate) fn add_slope<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    velocity: &Velocity<L>,
    h: L,
    matrix: &mut [L],
) {
    let (still, wind) = ([L::zero(); 3], build(|k| L::of(model.options.wind[k])));
    for fluid in &model.fluids {
        let body = Immersed::new(fluid.link, &fluid.pos, &fluid.rot, position);
        let moving = body.along(&velocity.cvel[fluid.link as usize], &wind);
        let two = L::of(2.0);
        let slope: [Vec3<L>; 2] = [0, 1].map(|part: usize| {
            build(|k| {
                let square = two * L::splat(fluid.square[part][k]);
                h * square.mul_add(moving[part][k].abs(), L::splat(fluid.linear[part]))
            })
        });
        let mut i = model.links[fluid.link as usize].last_dof();
        while i != NONE {
            let [turning, going] = body.along(&position.cdof[i as usize], &still);
            let held: [Vec3<L>; 2] = [build(|k| slope[0][k] * turning[k]), build(|k| slope[1][k] * going[k])];
            let felt = body.wrench(&held);
            let mut j = i;
            while j != NONE {
                let entry = &mut matrix[model.rows.at(i as usize, j as usize)];
                *entry += tree::project(model, &position.cdof, j as usize, &felt);
                j = model.dofs[j as usize].parent;
            }
            i = model.dofs[i as usize].parent;
        }
    }
}

/// Resistance of a box: what grows with the speed and with its square, about its axes and along them.
///
/// `mass` and principal moments are those of the body; density and viscosity those of the medium.
pub fn resistance(mass: f64, [a, b, c]: [f64; 3], density: f64, viscosity: f64) -> ([f64; 2], [[f64; 3]; 2]) {
    let edge = |sum: f64| (6.0 * sum.max(f64::MINVAL) / mass).sqrt();
    let edges = [edge(b + c - a), edge(a + c - b), edge(a + b - c)];
    let size = edges.iter().sum::<f64>() / 3.0;
    let linear = [PI * size.powi(3) * viscosity, 3.0 * PI * size * viscosity];
    let others = |k: usize| (edges[(k + 1) % 3], edges[(k + 2) % 3]);
    let about = |k: usize| {
        let (one, two) = others(k);
        density * edges[k] * (one.powi(4) + two.powi(4)) / 64.0
    };
    let along = |k: usize| {
        let (one, two) = others(k);
        0.5 * density * one * two
    };
    (linear, [[0, 1, 2].map(about), [0, 1, 2].map(along)])
}
