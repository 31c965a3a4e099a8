//! Paths of spatial tendons as pieces from site to site.

use std::collections::BTreeMap;

use lanesim_kernels::model::{NONE, Passes, Round, Span, Stretch, StretchDof, TendonDof};

use super::super::pose::{Pose, row_major};
use super::{Places, Tendons};
use crate::spec::{Shape, Waypoint};

/// MuJoCo's numbers for points of paths.
const PULLEY: i32 = 2;
const SITE: i32 = 3;
const SPHERE: i32 = 4;
const CYLINDER: i32 = 5;

impl Tendons {
    /// Adds the pieces of a path, and all dofs that change its length.
    pub(super) fn add_path(&mut self, path: &[Waypoint], places: Places) {
        let (first, first_dof) = (self.stretches.len(), self.dofs.len());
        let (mut last, mut around, mut share) = (None, None, 1.0);
        let mut moves: Vec<BTreeMap<u32, [bool; 3]>> = Vec::new();
        for point in path {
            match point {
                Waypoint::Pulley(divisor) => {
                    (last, share) = (None, 1.0 / divisor);
                    self.points.push((PULLEY, -1, *divisor));
                }
                Waypoint::Geom { geom, side } => {
                    let side = places.names.sites.id(side);
                    let Some(geom) = places.names.geoms.id(geom) else { continue };
                    let kind = if places.round(geom) == Round::Sphere { SPHERE } else { CYLINDER };
                    self.points.push((kind, geom as i32, side.map_or(-1.0, |side| side as f64)));
                    around = Some((geom, side));
                }
                Waypoint::Site(name) => {
                    let Some(site) = places.names.sites.id(name) else { continue };
                    self.points.push((SITE, site as i32, 0.0));
                    if let Some(from) = last.replace(site) {
                        let stretch = places.stretch([from, site], around.take(), share);
                        moves.push(places.moved(&stretch));
                        self.stretches.push(stretch);
                    }
                }
            }
        }
        let mut all: Vec<u32> = moves.iter().flat_map(|dofs| dofs.keys().copied()).collect();
        all.sort_unstable();
        all.dedup();
        for (stretch, dofs) in self.stretches[first..].iter_mut().zip(moves) {
            stretch.dofs = Span { start: self.stretch_dofs.len() as u32, len: dofs.len() as u32 };
            let entry = |dof: u32| (first_dof + all.partition_point(|known| *known < dof)) as u32;
            let dofs = dofs.into_iter().map(|(dof, moves)| StretchDof { dof, entry: entry(dof), moves });
            self.stretch_dofs.extend(dofs);
        }
        self.dofs.extend(all.into_iter().map(|dof| TendonDof { dof, qpos: 0, coef: 0.0 }));
    }
}

impl Places<'_> {
    /// A site on its link, or in the world.
    fn site(&self, site: usize) -> (u32, Pose) {
        let site = &self.scene.sites[site];
        (self.links.body_link[site.body], self.links.body_pose[site.body].then(&site.pose))
    }

    fn round(&self, geom: usize) -> Round {
        if self.scene.geoms[geom].spec.shape == Shape::Sphere { Round::Sphere } else { Round::Cylinder }
    }

    /// The piece between two sites, around a geom on the side of a site.
    fn stretch(&self, sites: [usize; 2], around: Option<(usize, Option<usize>)>, share: f64) -> Stretch<f64> {
        let [first, second] = sites.map(|site| self.site(site));
        let bodies = sites.map(|site| self.scene.sites[site].body as u32);
        let mut stretch = Stretch {
            links: [first.0, second.0, NONE],
            bodies: [bodies[0], bodies[1], NONE],
            round: None,
            passes: Passes::Anywhere,
            side_link: NONE,
            dofs: Span::default(),
            pos: [first.1.pos.to_array(), second.1.pos.to_array()],
            share,
            middle: [0.0; 3],
            rot: [0.0; 9],
            radius: 0.0,
            side: [0.0; 3],
        };
        let Some((id, side)) = around else { return stretch };
        let geom = &self.scene.geoms[id];
        let pose = self.links.body_pose[geom.body].then(&geom.pose);
        stretch.links[2] = self.links.body_link[geom.body];
        stretch.bodies[2] = geom.body as u32;
        stretch.round = Some(self.round(id));
        (stretch.middle, stretch.rot) = (pose.pos.to_array(), row_major(pose.rotation()));
        stretch.radius = geom.spec.size[0];
        if let Some(side) = side {
            let (link, place) = self.site(side);
            stretch.side_link = link;
            if link == stretch.links[2] {
                let local = pose.inverse_then(&place).pos;
                let within = local.length() < stretch.radius;
                stretch.passes = if within { Passes::Inside } else { Passes::Outside };
                stretch.side = local.to_array();
            } else {
                (stretch.passes, stretch.side) = (Passes::Either, place.pos.to_array());
            }
        }
        stretch
    }

    /// The dofs that move some of a piece's links against others.
    fn moved(&self, stretch: &Stretch<f64>) -> BTreeMap<u32, [bool; 3]> {
        let mut moves: BTreeMap<u32, [bool; 3]> = BTreeMap::new();
        for (side, link) in stretch.links.into_iter().enumerate().filter(|(_, link)| *link != NONE) {
            let mut dof = self.links.last_dof(link);
            while dof != NONE {
                moves.entry(dof).or_default()[side] = true;
                dof = self.dofs[dof as usize].parent;
            }
        }
        let straight = stretch.round.is_none();
        moves.retain(|_, [first, second, around]| !(*first && *second && (straight || *around)));
        moves
    }
}
