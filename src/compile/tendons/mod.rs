//! Tendons: what they run along, as the tables have it, and what follows from it in the reference configuration.

mod check;
mod stretches;

use lanesim_kernels::model::{
    Dof, FrictionLoss, Instance, Joint, Limit, Link, Model, NONE, Sizes, Span, Stretch, StretchDof, Tendon, TendonDof,
};
use lanesim_kernels::position::{self, Position};
use lanesim_kernels::tendon::{self, Tendons as Stage};

use super::bounds;
use super::derived::Derived;
use super::heavy::Heavy;
use super::joints::{Reflected, qpos_spring, qpos0};
use super::links::Links;
use super::names::label;
use super::order::Scene;
use super::rows::{joins, skyline, tree_pattern};
use crate::diagnostics::Diagnostics;
use crate::model::ElementNames;
use crate::spec::{self, Path, Spec, is_limited};
pub(super) use check::check;

/// The tendons of a model.
#[derive(Default)]
pub(crate) struct Tendons {
    pub table: Vec<Tendon<f64>>,
    pub dofs: Vec<TendonDof<f64>>,
    pub stretches: Vec<Stretch<f64>>,
    pub stretch_dofs: Vec<StretchDof>,
    /// Lengths in the reference configuration.
    pub length0: Vec<f64>,
    /// The Jacobian there, entry by entry of `dofs`.
    pub jacobian0: Vec<f64>,
    /// Inverse weights.
    pub invweight0: Vec<f64>,
    /// Points of the paths as MuJoCo has them: type, object, parameter; and how many of each.
    pub points: Vec<(i32, i32, f64)>,
    pub counts: Vec<usize>,
}

/// What paths go by.
#[derive(Clone, Copy)]
struct Places<'a> {
    scene: &'a Scene<'a>,
    links: &'a Links,
    names: &'a ElementNames,
    dofs: &'a [Dof<f64>],
}

/// MuJoCo's numbers for points of paths.
const JOINT: i32 = 1;

impl Tendons {
    /// Those of a spec without faults; without their inverse weights.
    pub fn new(
        spec: &Spec,
        scene: &Scene,
        links: &Links,
        (joints, dofs): (&[Joint<f64>], &[Dof<f64>]),
        names: &ElementNames,
        reflected: &[Reflected],
    ) -> Tendons {
        let mut out = Tendons::default();
        let places = Places { scene, links, names, dofs };
        for (tendon, reflected) in spec.tendons.iter().zip(reflected) {
            out.add(tendon, places, reflected);
        }
        if out.table.is_empty() {
            return out;
        }
        let model = out.alone(scene, &links.links, links.tree_root.len(), joints, dofs);
        let at_rest = measure(&model, &qpos_spring(scene)).length;
        for ((tendon, written), length) in out.table.iter_mut().zip(&spec.tendons).zip(at_rest) {
            tendon.rest = if written.springlength == [-1.0; 2] { [length; 2] } else { written.springlength };
        }
        let Stage { length, jacobian, .. } = measure(&model, &qpos0(scene));
        (out.length0, out.jacobian0) = (length, jacobian);
        out
    }

    fn add(&mut self, written: &spec::Tendon, places: Places, reflected: &Reflected) {
        let first = self.stretches.len();
        let (start, points) = (self.dofs.len(), self.points.len());
        match &written.path {
            Path::Fixed(joints) => {
                let mut dofs = Vec::new();
                for (name, coef) in joints {
                    let Some(id) = places.names.joints.id(name) else { continue };
                    let joint = &places.scene.joints[id];
                    dofs.push(TendonDof { dof: joint.dof as u32, qpos: joint.qpos as u32, coef: *coef });
                    self.points.push((JOINT, id as i32, *coef));
                }
                dofs.sort_by_key(|entry| entry.dof);
                self.dofs.extend(dofs);
            }
            Path::Spatial(path) => self.add_path(path, places),
        }
        self.counts.push(self.points.len() - points);
        let span = |start: usize, end: usize| Span { start: start as u32, len: (end - start) as u32 };
        let dofs: Vec<u32> = self.dofs[start..].iter().map(|entry| entry.dof).collect();
        let armature = written.armature + reflected.armature;
        let damping: [f64; 3] = std::array::from_fn(|k| written.damping[k] + reflected.damping[k]);
        let force_range = written.actuatorfrcrange.unwrap_or_default();
        let limited = is_limited(written.actuatorfrcrange, written.actuatorfrclimited);
        self.table.push(Tendon {
            dofs: span(start, self.dofs.len()),
            stretches: span(first, self.stretches.len()),
            cross: joins(places.dofs, &dofs),
            spring: written.stiffness != [0.0; 3],
            plastic: NONE,
            springyield: written.springyield,
            damped: damping != [0.0; 3],
            damping_linear: damping[1..] == [0.0; 2],
            heavy: armature > 0.0,
            force_limited: limited && !bounds::are_none(force_range),
            rest: written.springlength,
            stiffness: written.stiffness,
            damping,
            armature,
            force_range: bounds::of_clamp(force_range),
        });
    }

    /// A model of links and tendons alone.
    fn alone(
        &self,
        scene: &Scene,
        links: &[Link<f64>],
        ntree: usize,
        joints: &[Joint<f64>],
        dofs: &[Dof<f64>],
    ) -> Model<f64> {
        let sizes = Sizes {
            nq: scene.nq,
            nv: scene.nv,
            njnt: joints.len(),
            nlink: links.len(),
            ntree,
            ntendon: self.table.len(),
            ntj: self.dofs.len(),
            ..Sizes::default()
        };
        Model {
            sizes,
            links: links.to_vec(),
            joints: joints.to_vec(),
            dofs: dofs.to_vec(),
            tendons: self.table.clone(),
            tendon_dofs: self.dofs.clone(),
            stretches: self.stretches.clone(),
            stretch_dofs: self.stretch_dofs.clone(),
            ..Model::default()
        }
    }

    /// Refuses what discrete steps would need more room for in their metric than the inertia matrix has.
    pub fn check_discrete(&self, spec: &Spec, diagnostics: &mut Diagnostics) {
        let flags = &spec.option.flags;
        let holds = |t: &Tendon<f64>| t.cross && (flags.spring && t.spring || flags.damper && t.damped);
        let integrator = spec.option.integrator;
        for (t, (written, _)) in
            spec.tendons.iter().zip(&self.table).enumerate().filter(|(_, (_, t))| integrator.has_metric() && holds(t))
        {
            let message = format!(
                "a spring or damper along a tendon between branches is not supported under integrator {integrator}"
            );
            let remedy = "set integrator=\"implicitfast\"";
            diagnostics.push(&written.source, label("tendon", &written.name, t), message, remedy);
        }
    }

    /// What gives models with armature on tendons their weights.
    pub fn heavy(&self, scene: &Scene, links: &Links, (joints, dofs): (&[Joint<f64>], &[Dof<f64>])) -> Option<Heavy> {
        let mut model = self.alone(scene, &links.links, links.tree_root.len(), joints, dofs);
        if model.tendons.iter().all(|tendon| !tendon.heavy) {
            return None;
        }
        let (rows, nm) = skyline(dofs, (&[], &[]), &[]).ok()?;
        (model.rows, model.sizes.nm, model.tree_pattern) = (rows, nm, tree_pattern(dofs));
        model.qpos0 = qpos0(scene);
        Heavy::new(&model)
    }

    /// Finds the inverse weights.
    pub fn weigh(&mut self, derived: &Derived) {
        self.invweight0 = weights((&self.table, &self.dofs), &self.jacobian0, derived);
    }

    /// Lists of dofs that rows along tendons couple beyond the inertia matrix.
    pub fn joining(&self, limits: &[Limit<f64>], losses: &[FrictionLoss<f64>]) -> Vec<Vec<u32>> {
        let held = limits.iter().map(|limit| limit.tendon).chain(losses.iter().map(|loss| loss.tendon));
        let tendons = held.filter(|tendon| *tendon != NONE).map(|tendon| tendon as usize);
        let dofs = |tendon: usize| self.dofs_of(tendon).iter().map(|entry| entry.dof).collect();
        tendons.filter(|tendon| self.table[*tendon].cross).map(dofs).collect()
    }

    /// The dofs of a tendon.
    pub fn dofs_of(&self, tendon: usize) -> &[TendonDof<f64>] {
        &self.dofs[self.table[tendon].dofs.range()]
    }
}

/// Lengths and Jacobians of the tendons of a model.
fn measure(model: &Model<f64>, qpos: &[f64]) -> Stage<f64> {
    let (mut position, mut tendons) = (Position::new(&model.sizes), Stage::new(&model.sizes));
    position::kinematics(Instance::from(model), qpos.into(), &mut position);
    tendon::tendons(model, &position, qpos, &vec![0.0; model.sizes.nv], &mut tendons);
    tendons
}

/// J M⁻¹ Jᵀ of each tendon.
fn weights((table, dofs): (&[Tendon<f64>], &[TendonDof<f64>]), jacobian0: &[f64], derived: &Derived) -> Vec<f64> {
    let weight = |tendon: &Tendon<f64>| {
        let range = tendon.dofs.range();
        let row = || dofs[range.clone()].iter().map(|entry| entry.dof as usize).zip(jacobian0[range.clone()].iter());
        let qacc = derived.response(row().map(|(dof, j)| (dof, *j)));
        row().map(|(dof, j)| j * qacc[dof]).sum::<f64>().max(0.0)
    };
    table.iter().map(weight).collect()
}

/// Inverse weights of the tendons of a compiled model, of other masses.
pub(crate) fn reweigh(tables: &Model<f64>, derived: &Derived) -> Vec<f64> {
    let Stage { jacobian, .. } = measure(tables, &tables.qpos0);
    weights((&tables.tendons, &tables.tendon_dofs), &jacobian, derived)
}
