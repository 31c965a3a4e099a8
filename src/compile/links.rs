//! Links: bodies with joints and mocap bodies, and all that is fixed to them.

use glam::DVec3;
use lanesim_kernels::model::{Body, Ellipsoid, Fluid, Link, NONE, Span};
use lanesim_kernels::options::Options;
use lanesim_kernels::passive::fluid::resistance;

use super::inertia::{self, Mass};
use super::order::Scene;
use super::pose::{Pose, row_major};
use crate::model::{Placement, Placements};
use crate::spec::{self, Shape};

/// The links of a scene, and where everything else is on them.
pub(crate) struct Links {
    pub links: Vec<Link<f64>>,
    /// First link of every tree.
    pub tree_root: Vec<u32>,
    /// Link that carries each body, or [`NONE`].
    pub body_link: Vec<u32>,
    /// Pose of each body in its link, or in the world.
    pub body_pose: Vec<Pose>,
}

impl Links {
    pub fn new(scene: &Scene) -> Links {
        let mut out = Links {
            links: Vec::new(),
            tree_root: Vec::new(),
            body_link: Vec::with_capacity(scene.bodies.len()),
            body_pose: Vec::with_capacity(scene.bodies.len()),
        };
        let mut carried: Vec<Vec<(Mass, f64)>> = Vec::new();
        for b in 0..scene.bodies.len() {
            out.add(scene, b, &mut carried);
        }
        for (link, parts) in out.links.iter_mut().zip(&carried) {
            set_mass(link, parts);
        }
        out
    }

    fn add(&mut self, scene: &Scene, b: usize, carried: &mut Vec<Vec<(Mass, f64)>>) {
        let body = &scene.bodies[b];
        let (mut link, mut pose) = (NONE, body.pose);
        if b > 0 {
            link = self.body_link[body.parent];
            pose = self.body_pose[body.parent].then(&body.pose);
        }
        if !body.joints.is_empty() || body.mocap.is_some() {
            let new = self.links.len() as u32;
            let tree = if link == NONE {
                self.tree_root.push(new);
                self.tree_root.len() as u32 - 1
            } else {
                self.links[link as usize].tree
            };
            let dof = |joint: usize| scene.joints.get(joint).map_or(scene.nv, |j| j.dof);
            let (first, end) = (dof(body.joints.start), dof(body.joints.end));
            let rotation = pose.rotation();
            self.links.push(Link {
                parent: link,
                tree,
                body: b as u32,
                mocap: body.mocap.map_or(NONE, |m| m as u32),
                joints: Span { start: body.joints.start as u32, len: body.joints.len() as u32 },
                dofs: Span { start: first as u32, len: (end - first) as u32 },
                aligned: rotation == glam::DMat3::IDENTITY,
                zeros: Default::default(),
                pos: pose.pos.to_array(),
                rot: row_major(rotation),
                quat: pose.wxyz(),
                mass: 0.0,
                com: [0.0; 3],
                inertia: [0.0; 6],
                gravcomp: 0.0,
                gravcomp_pos: [0.0; 3],
            });
            carried.push(Vec::new());
            (link, pose) = (new, Pose::IDENTITY);
        }
        if link != NONE {
            carried[link as usize].push((body.mass.moved(&pose), body.spec.gravcomp));
        }
        self.body_link.push(link);
        self.body_pose.push(pose);
    }

    /// The link whose joints move a body, or [`NONE`].
    pub fn moving(&self, body: usize) -> u32 {
        let link = self.body_link[body];
        if self.links.get(link as usize).is_some_and(|link| link.mocap == NONE) { link } else { NONE }
    }

    /// The last degree of freedom of a link's own, or [`NONE`].
    pub fn last_dof(&self, link: u32) -> u32 {
        self.links.get(link as usize).map_or(NONE, lanesim_kernels::model::Link::last_dof)
    }

    /// By link, its number among the trees with joints.
    pub fn tree_ids(&self) -> Vec<i32> {
        let mut ids = Vec::with_capacity(self.links.len());
        let mut next = 0;
        for link in &self.links {
            // What a mocap body carries begins a tree.
            let of_parent = self.links.get(link.parent as usize).filter(|parent| parent.mocap == NONE);
            ids.push(match of_parent {
                _ if link.mocap != NONE => -1,
                Some(_) => ids[link.parent as usize],
                None => {
                    next += 1;
                    next - 1
                }
            });
        }
        ids
    }

    /// Where a frame fixed to body `b` is.
    fn place(&self, b: usize, in_body: &Pose) -> Placement {
        let pose = self.body_pose[b].then(in_body);
        Placement {
            link: self.body_link[b],
            pos: pose.pos.to_array(),
            quat: pose.wxyz(),
            mat: row_major(pose.rotation()),
        }
    }

    /// The bodies' table.
    pub fn bodies(&self, scene: &Scene) -> Vec<Body<f64>> {
        let com = |(b, body): (usize, &super::order::Body)| self.body_pose[b].then(&body.mass.frame).pos.to_array();
        let table = |(b, body): (usize, &super::order::Body)| Body {
            link: self.body_link[b],
            com: com((b, body)),
            rot: row_major(self.body_pose[b].then(&body.mass.frame).rotation()),
            mass: body.mass.mass,
            inertia: body.mass.inertia.to_array(),
        };
        scene.bodies.iter().enumerate().map(table).collect()
    }

    /// Bodies that move in a medium.
    pub fn fluids(&self, scene: &Scene, options: &Options) -> Vec<Fluid<f64>> {
        const MINVAL: f64 = 1e-15;
        let boxed = |b: usize| scene.bodies[b].geoms.clone().all(|geom| scene.geoms[geom].spec.fluid.is_none());
        let moving =
            scene.bodies.iter().enumerate().filter(|(b, body)| self.moving(*b) != NONE && body.mass.mass >= MINVAL);
        let fluid = |(b, body): (usize, &super::order::Body)| {
            let pose = self.body_pose[b].then(&body.mass.frame);
            let inertia = body.mass.inertia.to_array();
            let (linear, square) = resistance(body.mass.mass, inertia, options.density, options.viscosity);
            Fluid { link: self.body_link[b], pos: pose.pos.to_array(), rot: row_major(pose.rotation()), linear, square }
        };
        moving.filter(|(b, _)| boxed(*b)).map(fluid).collect()
    }

    /// Geoms that move in a medium as ellipsoids.
    pub fn ellipsoids(&self, scene: &Scene, options: &Options) -> Vec<Ellipsoid<f64>> {
        const MINVAL: f64 = 1e-15;
        let moves = |body: usize| self.body_link[body] != NONE && scene.bodies[body].mass.mass >= MINVAL;
        let ellipsoid = |geom: &super::order::Placed<'_, spec::Geom>| {
            let coefficients = geom.spec.fluid?;
            let [a, b, c] = geom.spec.size;
            let axes = match geom.spec.shape {
                Shape::Sphere => [a; 3],
                Shape::Capsule => [a, a, a + b],
                Shape::Cylinder => [a, a, b],
                _ => [a, b, c],
            };
            let pose = self.body_pose[geom.body].then(&geom.pose);
            let own = Ellipsoid::new(self.body_link[geom.body], axes, coefficients, options.density, options.viscosity);
            Some(Ellipsoid { pos: pose.pos.to_array(), rot: row_major(pose.rotation()), ..own })
        };
        scene.geoms.iter().filter(|geom| moves(geom.body)).filter_map(ellipsoid).collect()
    }

    /// Masses and centres of mass of the bodies that stand still.
    pub fn still(&self, scene: &Scene) -> Vec<(f64, [f64; 3])> {
        let still = scene.bodies.iter().enumerate().filter(|&(b, _)| self.body_link[b] == NONE);
        let place = |(b, body): (usize, &super::order::Body)| {
            (body.mass.mass, self.body_pose[b].then(&body.mass.frame).pos.to_array())
        };
        still.map(place).collect()
    }

    /// Where bodies, their inertial frames, geoms and sites are.
    pub fn placements(&self, scene: &Scene) -> Placements {
        Placements {
            bodies: (0..scene.bodies.len()).map(|b| self.place(b, &Pose::IDENTITY)).collect(),
            inertials: scene.bodies.iter().enumerate().map(|(b, body)| self.place(b, &body.mass.frame)).collect(),
            geoms: scene.geoms.iter().map(|g| self.place(g.body, &g.pose)).collect(),
            sites: scene.sites.iter().map(|s| self.place(s.body, &s.pose)).collect(),
        }
    }
}

/// Mass and inertia of a link from those of its bodies, which come with the share of their weight that is compensated.
fn set_mass(link: &mut Link<f64>, parts: &[(Mass, f64)]) {
    let masses: Vec<Mass> = parts.iter().map(|p| p.0).filter(|m| m.mass > 0.0 || m.inertia != DVec3::ZERO).collect();
    let (mass, com, tensor) = inertia::total(&masses);
    let trace = tensor.x_axis.x + tensor.y_axis.y + tensor.z_axis.z;
    // Products of inertia that rounding alone makes: a right angle somewhere.
    let clean = |x: f64| if x.abs() <= 4e-16 * trace { 0.0 } else { x };
    let products = [clean(tensor.y_axis.x), clean(tensor.z_axis.x), clean(tensor.z_axis.y)];
    link.mass = mass;
    link.com = com.to_array();
    link.inertia = [tensor.x_axis.x, tensor.y_axis.y, tensor.z_axis.z, products[0], products[1], products[2]];
    link.zeros = (link.com.map(|x| x == 0.0), link.inertia.map(|x| x == 0.0));
    let weights = || parts.iter().map(|(m, share)| (m.mass * share, m.frame.pos));
    link.gravcomp = weights().map(|w| w.0).sum();
    if link.gravcomp != 0.0 {
        let mean = weights().map(|(w, pos)| pos * w).sum::<DVec3>() / link.gravcomp;
        link.gravcomp_pos = mean.to_array();
    }
}
