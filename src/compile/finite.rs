//! Constants that leave the range of numbers: no table holds one, in double precision or rounded to single.

use lanesim_kernels::model::{Model, NONE, Representable};

use super::derived::Derived;
use super::names::label;
use super::order::Scene;
use crate::diagnostics::Diagnostics;
use crate::spec::{Source, Spec};

/// Most elements that are named.
const MOST: usize = 20;
/// Farthest that a geom may be from its tree's first joint, or stand from the world's origin, and largest that it may be, m:
/// bounding tests square distances in single precision.
const FARTHEST: f64 = 1e15;

/// Refuses every element of which a table holds a number that is not finite.
pub(super) fn check(spec: &Spec, scene: &Scene, tables: &Model<f64>, derived: &Derived, diagnostics: &mut Diagnostics) {
    let mut refuse = |source: &Source, label: String, field: Option<&str>| {
        if let Some(field) = field.filter(|_| diagnostics.0.len() < MOST) {
            let message = format!("{} leaves the range of numbers (of single precision, too)", field.replace('_', " "));
            // Many entries of a table may be about one element.
            if !diagnostics.0.iter().any(|known| known.element == label && known.message == message) {
                diagnostics.push(source, label, message, "use numbers of more usual size");
            }
        }
    };
    let body = |i: usize| (&scene.bodies[i].spec.source, label("body", &scene.bodies[i].spec.name, i));
    let joint = |i: usize| (&scene.joints[i].spec.source, label("joint", &scene.joints[i].spec.name, i));
    let geom = |i: usize| (&scene.geoms[i].spec.source, label("geom", &scene.geoms[i].spec.name, i));
    let mut at = |(source, label): (&Source, String), field: Option<&str>| refuse(source, label, field);
    for (i, entry) in tables.bodies.iter().enumerate() {
        at(body(i), entry.overflow());
    }
    for (i, entry) in scene.bodies.iter().enumerate() {
        let mass = [[entry.mass.mass; 3], entry.mass.inertia.to_array(), entry.mass.frame.pos.to_array()];
        let weight = derived.body_invweight0[i];
        let sound = mass.representable() && entry.pose.pos.to_array().representable();
        at(body(i), (!sound).then_some("mass, inertia or position"));
        at(body(i), (!weight.representable()).then_some("inverse weight"));
    }
    for (link, lever) in tables.links.iter().zip(&tables.levers) {
        at(body(link.body as usize), link.overflow());
        at(body(link.body as usize), (*lever > FARTHEST || !lever.representable()).then_some("reach"));
    }
    for (i, entry) in tables.joints.iter().enumerate() {
        at(joint(i), entry.overflow());
    }
    for (i, dof) in tables.dofs.iter().enumerate() {
        let (inertia, weight) = (derived.dof_m0[i], derived.dof_invweight0[i]);
        at(joint(dof.joint as usize), dof.overflow());
        at(joint(dof.joint as usize), (!inertia.representable()).then_some("inertia"));
        at(joint(dof.joint as usize), (!weight.representable()).then_some("inverse weight"));
    }
    let tendon = |i: usize| (&spec.tendons[i].source, label("tendon", &spec.tendons[i].name, i));
    let of = |t: u32, j: u32| if t == NONE { joint(j as usize) } else { tendon(t as usize) };
    for entry in &tables.limits {
        at(of(entry.tendon, entry.joint), entry.overflow());
    }
    for entry in &tables.friction_losses {
        at(of(entry.tendon, tables.dofs[entry.dof as usize].joint), entry.overflow());
    }
    for (i, entry) in tables.tendons.iter().enumerate() {
        at(tendon(i), entry.overflow());
        at(tendon(i), tables.tendon_dofs[entry.dofs.range()].iter().find_map(|dof| dof.overflow()));
        at(tendon(i), tables.stretches[entry.stretches.range()].iter().find_map(|stretch| stretch.overflow()));
    }
    for entry in &tables.geoms {
        at(geom(entry.id as usize), entry.overflow());
        let far = entry.pos.iter().chain([&entry.rbound]).any(|x| x.abs() > FARTHEST);
        at(geom(entry.id as usize), far.then_some("place or size"));
    }
    for entry in &tables.pairs {
        at(geom(tables.geoms[entry.geom1 as usize].id as usize), entry.overflow());
    }
    for entry in &tables.equalities {
        let equality = &spec.equalities[entry.id as usize];
        at((&equality.source, label("equality", &equality.name, entry.id as usize)), entry.overflow());
    }
    for entry in &tables.actuators {
        let (i, actuator) = (entry.id as usize, &spec.actuators[entry.id as usize]);
        at((&actuator.source, label("actuator", &actuator.name, i)), entry.overflow());
        for mount in &tables.mounts[entry.mounts.range()] {
            at((&actuator.source, label("actuator", &actuator.name, i)), mount.overflow());
        }
    }
    let world = || (&scene.bodies[0].spec.source, "model".to_string());
    at(world(), (!tables.mean_inertia.representable()).then_some("mean inertia"));
    at(world(), (!tables.potential_still.representable()).then_some("potential energy of what stands still"));
    for (name, x) in [("timestep", tables.options.timestep), ("impratio", tables.options.impratio)] {
        let place = spec.place("option", name);
        // Steps divide by them.
        at((&place, "option".to_string()), (!(x as f32).is_normal()).then_some(name));
    }
    let gravity = spec.place("option", "gravity");
    at((&gravity, "option".to_string()), (!tables.gravity.representable()).then_some("gravity"));
}
