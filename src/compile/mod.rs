//! The compiler: from a [`Spec`] to a [`Model`]. It alone may refuse a model.
//!
//! The order of passes: check every element, number the elements and find masses (`order`), join bodies to links
//! (`links`), derive the constants of the reference configuration (`derived`), and fill the tables that depend on
//! them. Passes after the checks rely on names and sizes being right.

mod actuators;
mod arrays;
mod bounds;
mod check;
mod constraints;
mod derived;
mod drives;
mod element;
mod equality;
mod finite;
mod heavy;
mod histories;
mod inertia;
mod joints;
mod keys;
mod laws;
mod lengthrange;
mod links;
mod meshes;
mod names;
mod order;
mod pairs;
mod pose;
mod report;
mod response;
mod rows;
mod sensors;
mod sleep;
mod tendons;
#[cfg(test)]
mod tests;

use glam::DVec3;
use lanesim_kernels::acceleration::articulated;
use lanesim_kernels::collision::{blur, levers};
use lanesim_kernels::model::{self as kernel, EqualityKind, Features, SensorKind, Sizes};
use lanesim_kernels::options::{Integrator, Options};
use lanesim_kernels::stage::Stage;

use crate::diagnostics::Diagnostics;
use crate::model::{Basis, ElementNames, Model, Names, Parts, Report, Surface};
use crate::spec::{Source, Spec};
use actuators::Actuators;
pub(crate) use actuators::times;
pub(crate) use bounds::of_clamp;
use constraints::InverseWeights;
pub(crate) use constraints::{Bound, impedance, range_of};
use heavy::Heavy;
use histories::Histories;
pub(crate) use laws::{Contact, Law};
use links::Links;
use order::Scene;
use sensors::Sensors;
use tendons::Tendons;

/// Compiles a model, or says everything that is wrong with it.
///
/// ```
/// use lanesim::spec::{Body, Geom, Joint, Shape, Spec};
///
/// let mut spec = Spec::new("pendulum");
/// let arm = spec.add_body(0, Body { name: "arm".into(), pos: [0.0, 0.0, 1.0], ..Body::default() });
/// spec.bodies[arm].joints.push(Joint { axis: [0.0, 1.0, 0.0], ..Joint::default() });
/// let rod = Geom { shape: Shape::Capsule, size: [0.02, 0.25, 0.0], pos: [0.0, 0.0, -0.25], ..Geom::default() };
/// spec.bodies[arm].geoms.push(rod);
///
/// let model = lanesim::compile(&spec)?;
/// assert_eq!((model.tables().sizes.nq, model.tables().sizes.nv), (1, 1));
/// # Ok::<(), lanesim::Diagnostics>(())
/// ```
pub fn compile(spec: &Spec) -> Result<Model, Diagnostics> {
    let mut diagnostics = Diagnostics::default();
    let (placed, meshes) = meshes::place(spec, &mut diagnostics);
    let spec = &*placed;
    let mut notes = spec.notes.clone();
    let tree = check::check(spec, &mut diagnostics);
    tendons::check(spec, &mut diagnostics);
    equality::check(spec, &mut diagnostics);
    sleep::check(spec, &mut diagnostics);
    sensors::check(spec, &mut diagnostics);
    if !tree {
        return Err(diagnostics.first());
    }
    let scene = Scene::new(spec, &mut diagnostics, &mut notes);
    if !diagnostics.0.is_empty() {
        return Err(diagnostics.first());
    }
    report::compile_notes(spec, &scene, &mut notes);

    let names = element_names(spec, &scene);
    let links = Links::new(&scene);
    let targets = actuators::targets(spec, &names);
    let reflected = actuators::reflected(spec, &targets, scene.joints.len());
    let mut joints = joints::joints(&scene, &links);
    let mut dofs = joints::dofs(&scene, &links, &reflected);
    let on_tendons = actuators::reflected_on_tendons(spec, &targets);
    let mut tendons = Tendons::new(spec, &scene, &links, (&joints, &dofs), &names, &on_tendons);
    tendons.check_discrete(spec, &mut diagnostics);
    let mut derived = derived::Derived::new(&scene, &links, &joints, &dofs);
    if let Some(heavy) = tendons.heavy(&scene, &links, (&joints, &dofs)) {
        derived.with_tendons(heavy, &scene, &links, &joints);
    }
    tendons.weigh(&derived);
    for (j, stiffness, damping) in constraints::springdampers(&scene, &derived.dof_invweight0) {
        joints[j].stiffness = [stiffness, 0.0, 0.0];
        joints[j].spring = true;
        let joint = &scene.joints[j];
        for dof in &mut dofs[joint.dof..joint.dof + check::dof_count(joint.spec.kind)] {
            joints::set_damping(dof, [damping, 0.0, 0.0], &reflected[j]);
        }
    }
    let actuators = actuators::actuators(spec, (&scene, &links, &tendons), &targets, &joints, &dofs);
    let weights = &derived.body_invweight0;
    let pairs = pairs::pairs(spec, &scene, &links, &dofs, weights, (&names.geoms, &meshes), &mut diagnostics);
    let equalities =
        equality::Equalities::new(spec, &scene, &links, &dofs, &derived, &tendons, &names).unwrap_or_else(|n| {
            let message = format!("the Jacobians of equality constraints have {n} entries and more");
            diagnostics.push(&Source::default(), "", message, "split the model, or hold bodies nearer to the world");
            Default::default()
        });
    let inverse = InverseWeights { dofs: &derived.dof_invweight0, tendons: &tendons.invweight0 };
    let limits = constraints::limits(spec, &scene, &tendons.table, inverse);
    let friction_losses = constraints::friction_losses(spec, &scene, &tendons.table, inverse);
    let listed: Vec<Vec<u32>> = equalities.joining().chain(tendons.joining(&limits, &friction_losses)).collect();
    let joined = !listed.is_empty() || !tendons.table.is_empty();
    let own = kernel::Strips::own(&dofs, &pairs.pairs, joined, &spec.option);
    // What contacts couple is not stored where every world has a Hessian of its own.
    let coupling = if own.is_empty() { &pairs.pairs[..] } else { &[] };
    let (rows, nm) = rows::skyline(&dofs, (coupling, &pairs.dofs), &listed).unwrap_or_else(|n| {
        let message = format!("{n} degrees of freedom are coupled: the inertia matrix is too large");
        diagnostics.push(
            &Source::default(),
            "",
            message,
            "split the model, or separate geoms with contype and conaffinity",
        );
        Default::default()
    });
    let sensors = sensors::Sources {
        spec,
        scene: &scene,
        links: &links,
        names: &names,
        limits: &limits,
        rows: &actuators.rows,
        mounts: &actuators.mounts,
        meshes: &meshes,
        nhull: pairs.hulls.len(),
        nheight: pairs.heights.len(),
    };
    let sensors = Sensors::new(&sensors, &mut diagnostics);
    let histories = Histories::new(spec, &actuators.told, &sensors.table, &mut diagnostics);
    diagnostics.into_result()?;

    let plastic0 = plastic(&mut joints, &mut tendons.table);
    let keys = keys::keys(spec, &scene, (&joints, &plastic0), &histories.numbers);
    let gravity = if spec.option.flags.gravity { spec.option.gravity } else { [0.0; 3] };
    let tables = kernel::Model {
        sizes: Sizes {
            nplastic: plastic0.len(),
            ..histories.counted(sizes((&scene, &links), &tendons, &actuators, &pairs, &equalities, &sensors, nm))
        },
        options: spec.option.clone().limited(),
        features: features(&spec.option, &links, &joints, &dofs, &tendons.table, &actuators),
        joints,
        dofs,
        levers: Vec::new(),
        blur: Default::default(),
        belts: belts(&scene, &pairs.geoms),
        geoms: pairs.geoms,
        hulls: pairs.hulls.into_iter().chain(sensors.hulls).collect(),
        heights: pairs.heights.into_iter().chain(sensors.heights).collect(),
        pairs: pairs.pairs,
        pair_dofs: pairs.dofs,
        tendons: tendons.table.clone(),
        tendon_dofs: tendons.dofs.clone(),
        stretches: tendons.stretches.clone(),
        stretch_dofs: tendons.stretch_dofs.clone(),
        limits,
        friction_losses,
        equalities: equalities.table,
        equality_dofs: equalities.dofs,
        eq_active0: spec.equalities.iter().map(|equality| f64::from(u8::from(equality.active))).collect(),
        fluids: fluids(&spec.option, |options| links.fluids(&scene, options)),
        ellipsoids: fluids(&spec.option, |options| links.ellipsoids(&scene, options)),
        plastic0,
        ctrl_rings: histories.controls,
        sensor_rings: histories.sensors,
        history0: histories.numbers,
        actuators: actuators.table.clone(),
        controls: actuators.controls.clone(),
        controllers: actuators.controllers.clone(),
        motors: actuators.motors.clone(),
        servos: actuators.servos.clone(),
        mounts: sensors.mounts,
        moment_dofs: actuators.moment_dofs.clone(),
        muscles: Vec::new(),
        sensors: sensors.table,
        rays: sensors.rays,
        targets: sensors.targets,
        spaces: sensors.spaces,
        surfaces: sensors.surfaces.into(),
        rows,
        tiles: Default::default(),
        own,
        tree_pattern: Default::default(),
        mean_inertia: mean(&derived.dof_m0),
        qpos0: joints::qpos0(&scene),
        low0: Vec::new(),
        potential_still: potential(&links.still(&scene), gravity),
        sleepers: Vec::new(),
        sleep_lengths: Vec::new(),
        tree_rest0: Vec::new(),
        gravity,
        bodies: links.bodies(&scene),
        links: links.links.clone(),
    };
    let (tree_pattern, levers) = (rows::tree_pattern(&tables.dofs), levers(&tables));
    let mut tables = kernel::Model { tree_pattern, levers, ..tables };
    tables.blur = blur(&tables);
    tables.tiles = kernel::Tiles::new(&tables);
    if !tables.tiles.is_empty() {
        (tables.sizes.ntile, tables.sizes.npanel) = tables.tiles.room();
    }
    let mut diagnostics = Diagnostics::default();
    let constants = actuators::constants(spec, &derived, &mut tables, &mut diagnostics);
    // What is implicit needs the matrix.
    tables.dofs.iter_mut().zip(&derived.dof_invweight0).for_each(|(dof, weight)| dof.invweight = *weight);
    tables.sizes.nguard = tables.guarded().count();
    if articulated::pays(&tables) && !Stage::Derivative.present(&tables) && tables.sizes.nguard == 0 {
        (tables.features.articulated, tables.sizes.narticulated) = (true, tables.sizes.nlink);
    }
    finite::check(spec, &scene, &tables, &derived, &mut diagnostics);
    actuators::check_discrete(spec, &tables, &mut diagnostics);
    diagnostics.into_result()?;
    notes.extend(equality::notes(spec, &tables));
    if spec.option.guard && tables.sizes.nguard == 0 {
        notes.push(
            "option guard has no effect: no tree has inner motions, from which inertial forces could create energy"
                .into(),
        );
    }
    let arrays = arrays::arrays(&arrays::Sources {
        spec,
        scene: &scene,
        links: &links,
        tables: &tables,
        derived: &derived,
        tendons: &tendons,
        actuators: (&actuators, &targets, &constants),
        held: &equalities.held,
        sensed: &sensors.objects,
        geom_names: &names.geoms,
        keys: &keys,
    });
    notes.extend(sleep::sleep(spec, &scene, &arrays, &mut tables));
    let counts = report::counts(spec, &scene, &links, &tables.sizes);
    Ok(Model::new(Parts {
        name: spec.name.clone(),
        tables,
        names,
        placements: links.placements(&scene),
        keys,
        arrays,
        counts,
        report: Report { notes, losses: spec.losses.clone() },
        basis: Basis {
            still: links.still(&scene),
            mixed: pairs.mixed,
            surfaces: scene.geoms.iter().map(|geom| Surface::of(geom.spec)).collect(),
            spring_dampers: scene.joints.iter().any(|joint| joint.spec.springdamper[0] > 0.0),
            spec: spec.clone(),
            scaled_muscles: spec.actuators.iter().any(actuators::is_scaled_muscle),
            damping_ratios: spec.actuators.iter().any(|actuator| actuator.dampratio > 0.0),
        },
    }))
}

/// Masses and inertias of bodies, and armature of dofs.
pub(crate) struct Weights<'a> {
    pub mass: &'a [f64],
    pub inertia: &'a [f64],
    pub armature: &'a [f64],
}

/// Gives the tables of a model, compiled from `spec`, other weights, with all that follows from them but for what
/// `springdamper` and `dampratio` ask for.
pub(crate) fn reweigh(spec: &Spec, weights: &Weights<'_>, tables: &mut kernel::Model<f64>) {
    let mut scene = Scene::new(spec, &mut Diagnostics::default(), &mut Vec::new());
    let given = weights.mass.iter().zip(weights.inertia.chunks_exact(3));
    for (body, (mass, inertia)) in scene.bodies.iter_mut().zip(given) {
        (body.mass.mass, body.mass.inertia) = (*mass, DVec3::from_slice(inertia));
    }
    for (dof, armature) in tables.dofs.iter_mut().zip(weights.armature) {
        dof.armature = *armature;
    }
    let links = Links::new(&scene);
    for (link, new) in tables.links.iter_mut().zip(&links.links) {
        (link.mass, link.com, link.inertia) = (new.mass, new.com, new.inertia);
        (link.gravcomp, link.gravcomp_pos) = (new.gravcomp, new.gravcomp_pos);
    }
    tables.bodies = links.bodies(&scene);
    tables.potential_still = potential(&links.still(&scene), tables.gravity);
    let mut derived = derived::Derived::new(&scene, &links, &tables.joints, &tables.dofs);
    if let Some(heavy) = Heavy::new(tables) {
        derived.with_tendons(heavy, &scene, &links, &tables.joints);
    }
    let tendons = tendons::reweigh(tables, &derived);
    let inverse = InverseWeights { dofs: &derived.dof_invweight0, tendons: &tendons };
    tables.limits = constraints::limits(spec, &scene, &tables.tendons, inverse);
    tables.friction_losses = constraints::friction_losses(spec, &scene, &tables.tendons, inverse);
    tables.mean_inertia = mean(&derived.dof_m0);
    if !tables.equalities.is_empty() {
        let held = equality::all_objects(spec, &scene, &element_names(spec, &scene));
        equality::Equalities::reweigh(&mut tables.equalities, &held, &scene, &derived, &tendons);
    }
    let weight = |geom: u32| derived.body_invweight0[scene.geoms[tables.geoms[geom as usize].id as usize].body][0];
    for pair in &mut tables.pairs {
        pair.invweight = weight(pair.geom1) + weight(pair.geom2);
    }
}

/// Potential energy of bodies that stand still: their masses and centres.
pub(crate) fn potential(still: &[(f64, [f64; 3])], gravity: [f64; 3]) -> f64 {
    still.iter().map(|(mass, at)| -mass * DVec3::from(gravity).dot(DVec3::from(*at))).sum()
}

fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 1.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
}

fn element_names(spec: &Spec, scene: &Scene) -> ElementNames {
    ElementNames {
        bodies: Names::new(scene.bodies.iter().map(|b| b.spec.name.clone()).collect()),
        joints: Names::new(scene.joints.iter().map(|j| j.spec.name.clone()).collect()),
        geoms: Names::new(scene.geoms.iter().map(|g| g.spec.name.clone()).collect()),
        sites: Names::new(scene.sites.iter().map(|s| s.spec.name.clone()).collect()),
        cameras: Names::new(scene.cameras.iter().map(|c| c.spec.name.clone()).collect()),
        tendons: Names::new(spec.tendons.iter().map(|t| t.name.clone()).collect()),
        equalities: Names::new(spec.equalities.iter().map(|e| e.name.clone()).collect()),
        actuators: Names::new(spec.actuators.iter().map(|a| a.name.clone()).collect()),
        sensors: Names::new(spec.sensors.iter().map(|s| s.name.clone()).collect()),
        keys: Names::new(spec.keys.iter().map(|k| k.name.clone()).collect()),
    }
}

fn sizes(
    (scene, links): (&Scene, &Links),
    tendons: &Tendons,
    actuators: &Actuators,
    pairs: &pairs::Pairs,
    equalities: &equality::Equalities,
    sensors: &Sensors,
    nm: usize,
) -> Sizes {
    let measures = |what: fn(SensorKind) -> bool| sensors.table.iter().any(|sensor| what(sensor.kind));
    // Torques of welds go by orientations.
    let welded = measures(|kind| matches!(kind, SensorKind::Force | SensorKind::Torque))
        && equalities.table.iter().any(|equality| equality.kind == EqualityKind::Weld);
    Sizes {
        nq: scene.nq,
        nv: scene.nv,
        nu: actuators.controls.len(),
        nout: actuators.table.len(),
        nmotor: actuators.motors.len(),
        nservo: actuators.servos.len(),
        nmoment: actuators.moment_dofs.len(),
        na: actuators.na,
        nbody: scene.bodies.len(),
        njnt: scene.joints.len(),
        ngeom: scene.geoms.len(),
        nsite: scene.sites.len(),
        nmocap: scene.nmocap,
        nlink: links.links.len(),
        ntree: links.tree_root.len(),
        npair: pairs.pairs.len(),
        ncollider: pairs.geoms.len(),
        nslot: pairs.nslot,
        nm,
        ntile: 0,
        npanel: 0,
        narticulated: 0,
        neq: equalities.held.len(),
        ne: equalities.ne,
        nej: equalities.nej,
        nsensordata: sensors.ndata,
        nsensorkey: sensors.nkey,
        nsensoracc: if measures(SensorKind::of_accelerations) { links.links.len() } else { 0 },
        nsensorquat: if measures(|kind| kind == SensorKind::FrameQuat) || welded { links.links.len() } else { 0 },
        nsleep: 0,
        nguard: 0,
        nlow: 0,
        nhistory: 0,
        nplastic: 0,
        ndelayed: 0,
        nmeasured: 0,
        ntendon: tendons.table.len(),
        ntj: tendons.dofs.len(),
    }
}

/// Gives springs that yield their place in the state, where they rest at first.
fn plastic(joints: &mut [kernel::Joint<f64>], tendons: &mut [kernel::Tendon<f64>]) -> Vec<f64> {
    let mut rest = Vec::new();
    for joint in joints.iter_mut().filter(|joint| joint.springyield > 0.0) {
        joint.plastic = rest.len() as u32;
        let count = if joint.kind == kernel::JointKind::Ball { 4 } else { 1 };
        rest.extend_from_slice(&joint.qpos_spring[..count]);
    }
    for tendon in tendons.iter_mut().filter(|tendon| tendon.springyield > 0.0) {
        tendon.plastic = rest.len() as u32;
        rest.extend_from_slice(&tendon.rest);
    }
    rest
}

/// The geoms whose surfaces move.
fn belts(scene: &Scene, geoms: &[kernel::Geom<f64>]) -> Vec<kernel::Belt<f64>> {
    let belt = |(place, geom): (u32, &kernel::Geom<f64>)| {
        let velocity = scene.geoms[geom.id as usize].spec.surfacevel;
        (velocity != [0.0; 6]).then_some(kernel::Belt { geom: place, velocity })
    };
    (0..).zip(geoms).filter_map(belt).collect()
}

/// What is in a medium, if there is one and passive forces are on.
fn fluids<T>(options: &Options, all: impl Fn(&Options) -> Vec<T>) -> Vec<T> {
    let dense = options.density > 0.0 || options.viscosity > 0.0;
    if dense && (options.flags.spring || options.flags.damper) { all(options) } else { Vec::new() }
}

fn features(
    options: &Options,
    links: &Links,
    joints: &[kernel::Joint<f64>],
    dofs: &[kernel::Dof<f64>],
    tendons: &[kernel::Tendon<f64>],
    actuators: &Actuators,
) -> Features {
    let flags = &options.flags;
    let damped = dofs.iter().any(|d| d.damped);
    let weight = flags.gravity && options.gravity != [0.0; 3];
    Features {
        springs: flags.spring && (joints.iter().any(|j| j.spring) || tendons.iter().any(|t| t.spring)),
        dampers: flags.damper && (damped || tendons.iter().any(|t| t.damped)),
        // Without springs and dampers there are no passive forces at all.
        gravcomp: weight && (flags.spring || flags.damper) && links.links.iter().any(|l| l.gravcomp != 0.0),
        fluid: (options.density > 0.0 || options.viscosity > 0.0)
            && (flags.spring || flags.damper)
            && !links.links.is_empty(),
        actuation: flags.actuation && !actuators.table.is_empty(),
        adhesion: actuators.table.iter().any(|a| a.transmission == kernel::Transmission::Body),
        implicit_damping: damped && flags.damper && flags.eulerdamp && options.integrator == Integrator::Euler,
        articulated: false,
    }
}
