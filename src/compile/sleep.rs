//! Trees that may sleep: which, from which speeds on they rest, and which sleep at first.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use lanesim_kernels::model::{self as kernel, JointKind, NONE, Sleeper, Span, Transmission};
use lanesim_kernels::part::Kernels;
use lanesim_kernels::pipeline::{Run, Stages, forward};
use lanesim_kernels::sleep::ASLEEP;
use lanesim_kernels::state::{BlockStatus, State};
use lanesim_kernels::workspace::Workspace;

use super::names::label;
use super::order::Scene;
use crate::convex::SupportCollider;
use crate::diagnostics::Diagnostics;
use crate::model::{Array, ArrayData};
use crate::spec::{SleepPolicy, Spec};

/// Bodies that say whether they sleep must carry a tree.
pub(crate) fn check(spec: &Spec, diagnostics: &mut Diagnostics) {
    // Whether a body or one that carries it has joints.
    let mut moves = vec![false; spec.bodies.len()];
    for (b, body) in spec.bodies.iter().enumerate() {
        let carried = moves.get(body.parent).copied().unwrap_or_default();
        moves[b] = carried || !body.joints.is_empty();
        if body.sleep != SleepPolicy::Auto && (carried || !moves[b]) {
            let message = "has sleep, and is not the first body of a tree that moves";
            let remedy = "give it to the first body with joints";
            diagnostics.push(&body.source, label("body", &body.name, b), message, remedy);
        }
    }
}

/// Fills the tables of a model in which trees may sleep; returns a note if some cannot start as they are asked to.
pub(crate) fn sleep(
    spec: &Spec,
    scene: &Scene,
    arrays: &BTreeMap<&'static str, Array>,
    tables: &mut kernel::Model<f64>,
) -> Option<String> {
    if !spec.option.flags.sleep {
        return None;
    }
    let ntree = tables.sizes.ntree;
    let driven = driven(tables);
    let policies: Vec<SleepPolicy> = roots(tables).map(|body| scene.bodies[body as usize].spec.sleep).collect();
    tables.sizes.nsleep = ntree;
    tables.sleepers = (0..ntree)
        .map(|tree| {
            let allowed = match policies[tree] {
                SleepPolicy::Auto => !driven[tree],
                SleepPolicy::Never => false,
                SleepPolicy::Allowed | SleepPolicy::Init => true,
            };
            let (qpos, dofs) = spans(tables, tree as u32);
            Sleeper { allowed: allowed && dofs.len > 0, qpos, dofs }
        })
        .collect();
    tables.sleep_lengths = lengths(arrays, tables);
    tables.tree_rest0 = vec![0.0; ntree];
    let initially: Vec<bool> = policies.iter().map(|policy| *policy == SleepPolicy::Init).collect();
    let wanted = initially.iter().filter(|asleep| **asleep).count();
    if wanted == 0 {
        return None;
    }
    tables.tree_rest0 = asleep(tables, &initially);
    let slept = tables.tree_rest0.iter().filter(|rest| **rest >= f64::from(ASLEEP)).count();
    (slept < wanted).then(|| {
        let awake = wanted - slept;
        format!("{awake} of {wanted} trees with sleep=\"init\" start awake: in the reference configuration they touch one that is awake")
    })
}

/// MJCF bodies with which trees begin.
fn roots(tables: &kernel::Model<f64>) -> impl Iterator<Item = u32> {
    // A mocap body moves nothing: what it carries has the say.
    (0..tables.sizes.ntree as u32).map(|tree| {
        let of_tree = || tables.links.iter().filter(move |link| link.tree == tree);
        of_tree().find(|link| link.dofs.len > 0).or(of_tree().next()).map_or(0, |link| link.body)
    })
}

/// Positions and degrees of freedom of a tree.
fn spans(tables: &kernel::Model<f64>, tree: u32) -> (Span, Span) {
    let links = || tables.links.iter().filter(|link| link.tree == tree && link.dofs.len > 0);
    let joints = links().flat_map(|link| &tables.joints[link.joints.range()]);
    let width = |kind| match kind {
        JointKind::Free => 7,
        JointKind::Ball => 4,
        JointKind::Slide | JointKind::Hinge => 1,
    };
    let over = |ranges: &mut dyn Iterator<Item = (u32, u32)>| {
        let all = ranges.reduce(|(low, high), (start, end)| (low.min(start), high.max(end)));
        all.map_or(Span::default(), |(start, end)| Span { start, len: end - start })
    };
    (
        over(&mut joints.map(|joint| (joint.qpos, joint.qpos + width(joint.kind)))),
        over(&mut links().map(|link| (link.dofs.start, link.dofs.start + link.dofs.len))),
    )
}

/// By tree, whether something acts on it that does not rest: an actuator, or a tendon's spring or damper that other trees share.
fn driven(tables: &kernel::Model<f64>) -> Vec<bool> {
    let mut driven = vec![false; tables.sizes.ntree];
    let tree = |dof: u32| tables.links[tables.dofs[dof as usize].link as usize].tree as usize;
    for actuator in &tables.actuators {
        let moments = &tables.moment_dofs[actuator.moments.range()];
        moments.iter().for_each(|moment| driven[tree(moment.dof)] = true);
        if actuator.transmission == Transmission::Body {
            let link = tables.bodies[actuator.body as usize].link;
            if link != NONE {
                driven[tables.links[link as usize].tree as usize] = true;
            }
        }
    }
    for tendon in tables.tendons.iter().filter(|tendon| tendon.spring || tendon.damped) {
        let trees: Vec<usize> = tables.tendon_dofs[tendon.dofs.range()].iter().map(|dof| tree(dof.dof)).collect();
        if trees.iter().any(|tree| *tree != trees[0]) {
            trees.into_iter().for_each(|tree| driven[tree] = true);
        }
    }
    driven
}

/// By degree of freedom, how far from a joint's anchor what turns with it is: its body's centre of mass, its geoms, and the joints of
/// bodies that it carries. 1 for translations.
fn lengths(arrays: &BTreeMap<&'static str, Array>, tables: &kernel::Model<f64>) -> Vec<f64> {
    let numbers = |name: &str| match arrays.get(name).map(|array| &array.data) {
        Some(ArrayData::F64(data)) => &data[..],
        _ => &[],
    };
    let integers = |name: &str| match arrays.get(name).map(|array| &array.data) {
        Some(ArrayData::I32(data)) => &data[..],
        _ => &[],
    };
    let at = |name: &str, i: usize| DVec3::from_slice(&numbers(name)[3 * i..]);
    let (of_joint, of_geom, parents) = (integers("jnt_bodyid"), integers("geom_bodyid"), integers("body_parentid"));
    // In its body's frame; a free joint's is the body's origin.
    let anchor = |j: usize| if tables.joints[j].kind == JointKind::Free { DVec3::ZERO } else { at("jnt_pos", j) };
    let length = |j: usize| {
        let (body, here) = (of_joint[j] as usize, anchor(j));
        let com = at("body_ipos", body);
        let geoms = (0..of_geom.len()).filter(|g| of_geom[*g] as usize == body);
        let reach = geoms.map(|g| (at("geom_pos", g) - com).length() + numbers("geom_rbound")[g]);
        let carried = (0..of_joint.len())
            .filter(|k| parents[of_joint[*k] as usize] as usize == body && of_joint[*k] as usize != body);
        let far = carried.map(|k| {
            let child = of_joint[k] as usize;
            let [w, x, y, z] = [0, 1, 2, 3].map(|i| numbers("body_quat")[4 * child + i]);
            (at("body_pos", child) + DQuat::from_xyzw(x, y, z, w) * anchor(k) - here).length()
        });
        reach.chain(far).fold((com - here).length(), f64::max)
    };
    let mut out = vec![1.0; tables.sizes.nv];
    for (j, joint) in tables.joints.iter().enumerate() {
        let first = joint.dof as usize;
        let turns = match joint.kind {
            JointKind::Free => first + 3..first + 6,
            JointKind::Ball => first..first + 3,
            JointKind::Hinge => first..first + 1,
            JointKind::Slide => continue,
        };
        out[turns].fill(length(j));
    }
    out
}

/// For how long trees have rested at first, some of which start asleep unless they touch one that does not.
fn asleep(tables: &kernel::Model<f64>, initially: &[bool]) -> Vec<f64> {
    let (mut ws, mut state) = (Workspace::<f64>::new(tables), State::<f64>::initial(tables));
    let mut status = BlockStatus { alive: 1, ..BlockStatus::default() };
    let mut run = Run {
        applied: None,
        varied: None,
        clock: None,
        max_contacts: usize::MAX,
        convex: &SupportCollider,
        stages: Stages::STEP,
        residual: false,
        executor: &mut Kernels,
        keep: true,
    };
    forward(tables, &mut state, &mut run, &mut status, &mut ws);
    if let Some(sleep) = &mut ws.sleep {
        sleep.begin(tables, &ws.constraint, initially, &mut state);
    }
    state.tree_rest
}
