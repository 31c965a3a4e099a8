//! A model as MuJoCo's arrays: its names, numbering and layouts.

use std::collections::BTreeMap;

use glam::DVec3;
use lanesim_kernels::model::{NONE, Ring};
use lanesim_kernels::options::{Cone, Integrator, Options, Solver};

use super::actuators::{Actuators, Constants, Target};
use super::derived::Derived;
use super::joints;
use super::links::Links;
use super::order::Scene;
use super::pairs;
use crate::model::{Array, ArrayData, Key, Names};
use crate::spec::{Bias, Dynamics, Gain, Geom, HeightField, History, JointKind, Shape, Spec, Transmission, is_limited};

/// What the arrays show.
pub(crate) struct Sources<'a> {
    pub spec: &'a Spec,
    pub scene: &'a Scene<'a>,
    pub links: &'a Links,
    pub tables: &'a lanesim_kernels::model::Model<f64>,
    pub derived: &'a Derived,
    pub tendons: &'a super::tendons::Tendons,
    pub actuators: (&'a Actuators, &'a [Target], &'a Constants),
    pub held: &'a [super::equality::Objects],
    pub sensed: &'a [[(i32, i32); 2]],
    pub geom_names: &'a Names,
    pub keys: &'a [Key],
}

/// Arrays by name.
#[derive(Default)]
struct Arrays(BTreeMap<&'static str, Array>);

impl Arrays {
    /// An array of `width` numbers per element; 0: one number, without a second dimension.
    fn reals(&mut self, name: &'static str, width: usize, data: impl Iterator<Item = f64>) {
        let data: Vec<f64> = data.collect();
        self.insert(name, width, data.len(), ArrayData::F64(data));
    }

    fn ints(&mut self, name: &'static str, width: usize, data: impl Iterator<Item = i32>) {
        let data: Vec<i32> = data.collect();
        self.insert(name, width, data.len(), ArrayData::I32(data));
    }

    fn insert(&mut self, name: &'static str, width: usize, len: usize, data: ArrayData) {
        let shape = len.checked_div(width).map_or_else(|| vec![len], |n| vec![n, width]);
        self.0.insert(name, Array { shape, data });
    }
}

/// Every array.
pub(crate) fn arrays(s: &Sources) -> BTreeMap<&'static str, Array> {
    let mut out = Arrays::default();
    bodies(s, &mut out);
    joint_arrays(s, &mut out);
    dofs(s, &mut out);
    geoms(s, &mut out);
    sites(s, &mut out);
    contacts(s, &mut out);
    tendons(s, &mut out);
    equalities(s, &mut out);
    actuators(s, &mut out);
    sensors(s, &mut out);
    keys(s, &mut out);
    options(&s.spec.option, &mut out);
    out.0
}

fn bodies(s: &Sources, out: &mut Arrays) {
    let bodies = &s.scene.bodies;
    out.ints("body_parentid", 0, bodies.iter().map(|b| b.parent as i32));
    out.ints("body_weldid", 0, pairs::weld_groups(s.scene).into_iter().map(|w| w as i32));
    let mut root = Vec::with_capacity(bodies.len());
    for (i, b) in bodies.iter().enumerate() {
        root.push(if b.parent == 0 { i } else { root[b.parent] });
    }
    out.ints("body_rootid", 0, root.into_iter().map(|r| r as i32));
    let trees = s.links.tree_ids();
    let tree = |link: &u32| trees.get(*link as usize).copied().unwrap_or(-1);
    out.ints("body_treeid", 0, s.links.body_link.iter().map(tree));
    out.ints("body_mocapid", 0, bodies.iter().map(|b| b.mocap.map_or(-1, |m| m as i32)));
    out.ints("body_jntnum", 0, bodies.iter().map(|b| b.joints.len() as i32));
    out.ints("body_jntadr", 0, bodies.iter().map(|b| address(&b.joints)));
    let dofs = |b: &super::order::Body| {
        let end = s.scene.joints.get(b.joints.end).map_or(s.scene.nv, |j| j.dof);
        s.scene.joints.get(b.joints.start).filter(|_| !b.joints.is_empty()).map(|j| j.dof..end).unwrap_or_default()
    };
    out.ints("body_dofnum", 0, bodies.iter().map(|b| dofs(b).len() as i32));
    out.ints("body_dofadr", 0, bodies.iter().map(|b| address(&dofs(b))));
    out.ints("body_geomnum", 0, bodies.iter().map(|b| b.geoms.len() as i32));
    out.ints("body_geomadr", 0, bodies.iter().map(|b| address(&b.geoms)));
    out.reals("body_pos", 3, bodies.iter().flat_map(|b| b.pose.pos.to_array()));
    out.reals("body_quat", 4, bodies.iter().flat_map(|b| b.pose.wxyz()));
    out.reals("body_ipos", 3, bodies.iter().flat_map(|b| b.inertial.pos.to_array()));
    out.reals("body_iquat", 4, bodies.iter().flat_map(|b| b.inertial.wxyz()));
    out.reals("body_mass", 0, bodies.iter().map(|b| b.mass.mass));
    out.reals("body_inertia", 3, bodies.iter().flat_map(|b| b.mass.inertia.to_array()));
    out.reals("body_gravcomp", 0, bodies.iter().map(|b| b.spec.gravcomp));
    let mut subtree: Vec<f64> = bodies.iter().map(|b| b.mass.mass).collect();
    for b in (1..bodies.len()).rev() {
        subtree[bodies[b].parent] += subtree[b];
    }
    out.reals("body_subtreemass", 0, subtree.into_iter());
    out.reals("body_invweight0", 2, s.derived.body_invweight0.iter().flatten().copied());
}

/// First of a range, or -1 if it is empty.
fn address(range: &std::ops::Range<usize>) -> i32 {
    if range.is_empty() { -1 } else { range.start as i32 }
}

fn joint_arrays(s: &Sources, out: &mut Arrays) {
    let (joints, table) = (&s.scene.joints, &s.tables.joints);
    let kind = |kind| match kind {
        JointKind::Free => 0,
        JointKind::Ball => 1,
        JointKind::Slide => 2,
        JointKind::Hinge => 3,
    };
    out.ints("jnt_type", 0, joints.iter().map(|j| kind(j.spec.kind)));
    out.ints("jnt_qposadr", 0, joints.iter().map(|j| j.qpos as i32));
    out.ints("jnt_dofadr", 0, joints.iter().map(|j| j.dof as i32));
    out.ints("jnt_bodyid", 0, joints.iter().map(|j| j.body as i32));
    out.ints("jnt_group", 0, joints.iter().map(|j| j.spec.group));
    let limited = |j: &super::order::Joint| j.spec.kind != JointKind::Free && is_limited(j.spec.range, j.spec.limited);
    out.ints("jnt_limited", 0, joints.iter().map(|j| i32::from(limited(j))));
    let scalar = |j: &super::order::Joint| matches!(j.spec.kind, JointKind::Hinge | JointKind::Slide);
    let bounded = |j: &super::order::Joint| scalar(j) && is_limited(j.spec.actuatorfrcrange, j.spec.actuatorfrclimited);
    out.ints("jnt_actfrclimited", 0, joints.iter().map(|j| i32::from(bounded(j))));
    out.ints("jnt_actgravcomp", 0, joints.iter().map(|j| i32::from(j.spec.actuatorgravcomp)));
    out.reals("jnt_pos", 3, table.iter().flat_map(|j| j.pos));
    out.reals("jnt_axis", 3, table.iter().flat_map(|j| j.axis));
    out.reals("jnt_stiffness", 0, table.iter().map(|j| j.stiffness[0]));
    out.reals("jnt_stiffnesspoly", 2, table.iter().flat_map(|j| [j.stiffness[1], j.stiffness[2]]));
    out.reals("jnt_springyield", 0, table.iter().map(|j| j.springyield));
    out.ints("jnt_plasticadr", 0, table.iter().map(|j| place(j.plastic)));
    out.reals("jnt_range", 2, joints.iter().flat_map(|j| j.spec.range.unwrap_or_default()));
    out.reals("jnt_actfrcrange", 2, joints.iter().flat_map(|j| j.spec.actuatorfrcrange.unwrap_or_default()));
    out.reals("jnt_margin", 0, joints.iter().map(|j| j.spec.margin));
    out.reals("jnt_solref", 2, joints.iter().flat_map(|j| j.spec.solreflimit));
    out.reals("jnt_solimp", 5, joints.iter().flat_map(|j| j.spec.solimplimit));
    out.reals("qpos0", 0, s.tables.qpos0.iter().copied());
    out.reals("qpos_spring", 0, joints::qpos_spring(s.scene).into_iter());
}

fn dofs(s: &Sources, out: &mut Arrays) {
    let dofs = &s.tables.dofs;
    let joint = |d: &lanesim_kernels::model::Dof<f64>| &s.scene.joints[d.joint as usize];
    let trees = s.links.tree_ids();
    let tree = |d: &lanesim_kernels::model::Dof<f64>| trees[d.link as usize];
    out.ints("dof_bodyid", 0, dofs.iter().map(|d| joint(d).body as i32));
    out.ints("dof_jntid", 0, dofs.iter().map(|d| d.joint as i32));
    out.ints("dof_parentid", 0, dofs.iter().map(|d| if d.parent == NONE { -1 } else { d.parent as i32 }));
    out.ints("dof_treeid", 0, dofs.iter().map(tree));
    out.reals("dof_armature", 0, dofs.iter().map(|d| joint(d).spec.armature));
    out.reals("dof_frictionloss", 0, dofs.iter().map(|d| joint(d).spec.frictionloss));
    out.reals("dof_solref", 2, dofs.iter().flat_map(|d| joint(d).spec.solreffriction));
    out.reals("dof_solimp", 5, dofs.iter().flat_map(|d| joint(d).spec.solimpfriction));
    let damping = s.joint_damping();
    out.reals("dof_damping", 0, dofs.iter().map(|d| damping[d.joint as usize][0]));
    out.reals("dof_dampingpoly", 2, dofs.iter().flat_map(|d| damping[d.joint as usize][1..].to_vec()));
    out.reals("dof_M0", 0, s.derived.dof_m0.iter().copied());
    out.reals("dof_invweight0", 0, s.derived.dof_invweight0.iter().copied());
}

impl Sources<'_> {
    /// Damping of each joint by itself: as written, or from `springdamper`.
    fn joint_damping(&self) -> Vec<[f64; 3]> {
        let mut damping: Vec<[f64; 3]> = self.scene.joints.iter().map(|j| j.spec.damping).collect();
        for (joint, _, linear) in super::constraints::springdampers(self.scene, &self.derived.dof_invweight0) {
            damping[joint] = [linear, 0.0, 0.0];
        }
        damping
    }
}

/// MuJoCo's number of a shape.
fn shape(shape: Shape) -> i32 {
    match shape {
        Shape::Plane => 0,
        Shape::Sphere => 2,
        Shape::Capsule => 3,
        Shape::Ellipsoid => 4,
        Shape::Cylinder => 5,
        Shape::HeightField => 1,
        Shape::Box => 6,
        Shape::Mesh => 7,
    }
}

fn geoms(s: &Sources, out: &mut Arrays) {
    let geoms = &s.scene.geoms;
    out.ints("geom_type", 0, geoms.iter().map(|g| shape(g.spec.shape)));
    out.ints("geom_contype", 0, geoms.iter().map(|g| g.spec.contype as i32));
    out.ints("geom_conaffinity", 0, geoms.iter().map(|g| g.spec.conaffinity as i32));
    out.ints("geom_condim", 0, geoms.iter().map(|g| g.spec.condim));
    out.ints("geom_bodyid", 0, geoms.iter().map(|g| g.body as i32));
    out.ints("geom_group", 0, geoms.iter().map(|g| g.spec.group));
    out.ints("geom_priority", 0, geoms.iter().map(|g| g.spec.priority));
    out.reals("geom_size", 3, geoms.iter().flat_map(|g| g.spec.size));
    out.reals("geom_pos", 3, geoms.iter().flat_map(|g| g.written.pos.to_array()));
    out.reals("geom_quat", 4, geoms.iter().flat_map(|g| g.written.wxyz()));
    out.reals("geom_rbound", 0, geoms.iter().map(|g| reported_radius(s, g.spec)));
    out.reals("geom_friction", 3, geoms.iter().flat_map(|g| g.spec.friction));
    out.reals("geom_solmix", 0, geoms.iter().map(|g| g.spec.solmix));
    out.reals("geom_solref", 2, geoms.iter().flat_map(|g| g.spec.solref));
    out.reals("geom_solimp", 5, geoms.iter().flat_map(|g| g.spec.solimp));
    out.reals("geom_margin", 0, geoms.iter().map(|g| g.spec.margin));
    out.reals("geom_gap", 0, geoms.iter().map(|g| g.spec.gap));
}

/// Radius of the bounding sphere as MuJoCo has it: of a height field by its largest height or its base, whichever is more.
fn reported_radius(s: &Sources, geom: &Geom) -> f64 {
    match s.spec.hfields.iter().find(|field| geom.shape == Shape::HeightField && field.name == geom.hfield) {
        Some(HeightField { size: [x, y, top, base], .. }) => DVec3::new(*x, *y, top.max(*base)).length(),
        None => pairs::bounding_radius(geom),
    }
}

fn sites(s: &Sources, out: &mut Arrays) {
    let sites = &s.scene.sites;
    out.ints("site_type", 0, sites.iter().map(|x| shape(x.spec.shape)));
    out.ints("site_bodyid", 0, sites.iter().map(|x| x.body as i32));
    out.ints("site_group", 0, sites.iter().map(|x| x.spec.group));
    out.reals("site_size", 3, sites.iter().flat_map(|x| x.spec.size));
    out.reals("site_pos", 3, sites.iter().flat_map(|x| x.written.pos.to_array()));
    out.reals("site_quat", 4, sites.iter().flat_map(|x| x.written.wxyz()));
}

fn contacts(s: &Sources, out: &mut Arrays) {
    let id = |name: &str| s.geom_names.id(name).unwrap_or(0);
    let body = |g: usize| s.scene.geoms[g].body;
    let mut pairs: Vec<(i32, usize, usize, &crate::spec::Pair)> = s
        .spec
        .pairs
        .iter()
        .filter(|_| !s.scene.geoms.is_empty())
        .map(|p| {
            let (a, b) = (id(&p.geom1), id(&p.geom2));
            let (a, b) = if body(a) > body(b) { (b, a) } else { (a, b) };
            (signature(body(a), body(b)), a, b, p)
        })
        .collect();
    pairs.sort_by_key(|p| p.0);
    out.ints("pair_dim", 0, pairs.iter().map(|p| p.3.condim));
    out.ints("pair_geom1", 0, pairs.iter().map(|p| p.1 as i32));
    out.ints("pair_geom2", 0, pairs.iter().map(|p| p.2 as i32));
    out.ints("pair_signature", 0, pairs.iter().map(|p| p.0));
    out.reals("pair_solref", 2, pairs.iter().flat_map(|p| p.3.solref));
    out.reals("pair_solreffriction", 2, pairs.iter().flat_map(|p| p.3.solreffriction));
    out.reals("pair_solimp", 5, pairs.iter().flat_map(|p| p.3.solimp));
    out.reals("pair_margin", 0, pairs.iter().map(|p| p.3.margin));
    out.reals("pair_gap", 0, pairs.iter().map(|p| p.3.gap));
    out.reals("pair_friction", 5, pairs.iter().flat_map(|p| p.3.friction));
    let mut excludes: Vec<i32> =
        pairs::exclude_ids(s.spec, s.scene).into_iter().map(|(a, b)| signature(a, b)).collect();
    excludes.sort_unstable();
    out.ints("exclude_signature", 0, excludes.into_iter());
}

fn tendons(s: &Sources, out: &mut Arrays) {
    let (written, table, own) = (&s.spec.tendons, &s.tables.tendons, s.tendons);
    let starts = own.counts.iter().scan(0, |next, count| Some(std::mem::replace(next, *next + count)));
    out.ints("tendon_adr", 0, starts.map(|start: usize| start as i32));
    out.ints("tendon_num", 0, own.counts.iter().map(|count| *count as i32));
    out.ints("tendon_group", 0, written.iter().map(|t| t.group));
    out.ints("tendon_limited", 0, written.iter().map(|t| i32::from(is_limited(t.range, t.limited))));
    let bounded = |t: &crate::spec::Tendon| is_limited(t.actuatorfrcrange, t.actuatorfrclimited);
    out.ints("tendon_actfrclimited", 0, written.iter().map(|t| i32::from(bounded(t))));
    out.reals("tendon_range", 2, written.iter().flat_map(|t| t.range.unwrap_or_default()));
    out.reals("tendon_actfrcrange", 2, written.iter().flat_map(|t| t.actuatorfrcrange.unwrap_or_default()));
    out.reals("tendon_margin", 0, written.iter().map(|t| t.margin));
    out.reals("tendon_solref_lim", 2, written.iter().flat_map(|t| t.solreflimit));
    out.reals("tendon_solimp_lim", 5, written.iter().flat_map(|t| t.solimplimit));
    out.reals("tendon_solref_fri", 2, written.iter().flat_map(|t| t.solreffriction));
    out.reals("tendon_solimp_fri", 5, written.iter().flat_map(|t| t.solimpfriction));
    out.reals("tendon_stiffness", 0, written.iter().map(|t| t.stiffness[0]));
    out.reals("tendon_stiffnesspoly", 2, written.iter().flat_map(|t| [t.stiffness[1], t.stiffness[2]]));
    out.reals("tendon_damping", 0, written.iter().map(|t| t.damping[0]));
    out.reals("tendon_dampingpoly", 2, written.iter().flat_map(|t| [t.damping[1], t.damping[2]]));
    out.reals("tendon_armature", 0, written.iter().map(|t| t.armature));
    out.reals("tendon_frictionloss", 0, written.iter().map(|t| t.frictionloss));
    out.reals("tendon_lengthspring", 2, table.iter().flat_map(|t| t.rest));
    out.reals("tendon_springyield", 0, table.iter().map(|t| t.springyield));
    out.ints("tendon_plasticadr", 0, table.iter().map(|t| place(t.plastic)));
    out.reals("tendon_length0", 0, own.length0.iter().copied());
    out.reals("tendon_invweight0", 0, own.invweight0.iter().copied());
    out.ints("wrap_type", 0, own.points.iter().map(|point| point.0));
    out.ints("wrap_objid", 0, own.points.iter().map(|point| point.1));
    out.reals("wrap_prm", 0, own.points.iter().map(|point| point.2));
}

/// MuJoCo's number of a place; -1: none.
fn place(place: u32) -> i32 {
    if place == NONE { -1 } else { place as i32 }
}

fn equalities(s: &Sources, out: &mut Arrays) {
    use lanesim_kernels::model::EqualityKind::{Connect, Joint, Tendon, Weld};
    let kind = |kind| match kind {
        Connect => 0,
        Weld => 1,
        Joint => 2,
        Tendon => 3,
    };
    let written = &s.spec.equalities;
    out.ints("eq_type", 0, s.held.iter().map(|held| kind(held.kind)));
    out.ints("eq_obj1id", 0, s.held.iter().map(|held| held.ids[0]));
    out.ints("eq_obj2id", 0, s.held.iter().map(|held| held.ids[1]));
    out.ints("eq_objtype", 0, s.held.iter().map(|held| held.objtype));
    out.ints("eq_active0", 0, written.iter().map(|equality| i32::from(equality.active)));
    out.reals("eq_solref", 2, written.iter().flat_map(|equality| equality.solref));
    out.reals("eq_solimp", 5, written.iter().flat_map(|equality| equality.solimp));
    out.reals("eq_data", super::equality::DATA, s.held.iter().flat_map(|held| held.data));
}

/// Two bodies in one number, as MuJoCo packs them; for models of more than 65535 bodies it is not unique.
fn signature(body1: usize, body2: usize) -> i32 {
    ((body1 as u32) << 16).wrapping_add(body2 as u32) as i32
}

fn actuators(s: &Sources, out: &mut Arrays) {
    let written = &s.spec.actuators;
    let table = &s.tables.actuators;
    let (actuators, targets, constants) = s.actuators;
    let kind = |t: &Transmission| match t {
        Transmission::Joint(_) => 0,
        Transmission::JointInParent(_) => 1,
        Transmission::SliderCrank { .. } => 2,
        Transmission::Tendon(_) => 3,
        Transmission::Site { .. } => 4,
        Transmission::Body(_) => 5,
    };
    let ids = |target: &Target| match target {
        Target::Joint(target) | Target::Tendon(target) | Target::Body(target) => [*target as i32, -1],
        Target::Sites(sites) => [0, 1].map(|k| sites.get(k).map_or(-1, |site| *site as i32)),
    };
    let turns = |a: &crate::spec::Actuator| if a.gain == Gain::So3 { 6 } else { kind(&a.transmission) };
    out.ints("actuator_trntype", 0, written.iter().map(turns));
    out.ints("actuator_outadr", 0, actuators.rows.iter().map(|rows| rows.start as i32));
    out.ints("actuator_outnum", 0, actuators.rows.iter().map(|rows| rows.len as i32));
    let first = || actuators.rows.iter().map(|rows| &table[rows.start as usize]);
    out.ints("actuator_trnid", 2, targets.iter().flat_map(ids));
    out.reals("actuator_cranklength", 0, first().map(|a| a.rod));
    let dynamics = |dynamics: Dynamics| match dynamics {
        Dynamics::None => 0,
        Dynamics::Integrator => 1,
        Dynamics::Filter => 2,
        Dynamics::FilterExact => 3,
        Dynamics::Muscle => 4,
        Dynamics::DcMotor => 5,
        Dynamics::Pid => 6,
    };
    let gain = |gain: Gain| match gain {
        Gain::Fixed => 0,
        Gain::Affine => 1,
        Gain::Muscle => 2,
        Gain::DcMotor => 3,
        Gain::So3 => 4,
        Gain::Pid => 5,
    };
    let bias = |bias: Bias| match bias {
        Bias::None => 0,
        Bias::Affine => 1,
        Bias::Muscle => 2,
        Bias::DcMotor => 3,
        Bias::So3 => 4,
    };
    out.ints("actuator_dyntype", 0, written.iter().map(|a| dynamics(a.dynamics)));
    out.ints("actuator_gaintype", 0, written.iter().map(|a| gain(a.gain)));
    out.ints("actuator_biastype", 0, written.iter().map(|a| bias(a.bias)));
    let counts = || written.iter().map(|a| a.activations() as i32);
    let starts = counts().scan(0, |next, count| Some(std::mem::replace(next, *next + count)));
    out.ints("actuator_actadr", 0, starts.zip(counts()).map(|(start, count)| if count > 0 { start } else { -1 }));
    out.ints("actuator_actnum", 0, counts());
    out.ints("actuator_ctrladr", 0, actuators.told.iter().map(|told| told.start as i32));
    out.ints("actuator_ctrlnum", 0, actuators.told.iter().map(|told| told.len as i32));
    out.ints("actuator_actearly", 0, written.iter().map(|a| i32::from(a.actearly || a.gain == Gain::DcMotor)));
    let ranges = &actuators.act_ranges;
    let limited = written.iter().zip(ranges).map(|(a, &range)| is_limited(Some(range), a.actlimited));
    out.ints("actuator_actlimited", 0, limited.map(i32::from));
    out.reals("actuator_actrange", 2, ranges.iter().flatten().copied());
    out.reals("actuator_dynprm", 10, written.iter().flat_map(|a| a.dynprm));
    out.reals("actuator_lengthrange", 2, table.iter().flat_map(|a| constants.length_ranges[a.id as usize]));
    out.ints("actuator_group", 0, written.iter().map(|a| a.group));
    let ranges = &actuators.ctrl_ranges;
    out.ints("actuator_ctrllimited", 0, ranges.iter().map(|(_, limited)| i32::from(*limited)));
    out.ints("actuator_forcelimited", 0, written.iter().map(|a| i32::from(is_limited(a.forcerange, a.forcelimited))));
    out.reals("actuator_gainprm", 10, written.iter().flat_map(|a| a.gainprm));
    let bias = |(a, t): (&crate::spec::Actuator, &lanesim_kernels::model::Actuator<f64>)| {
        let mut prm = a.biasprm;
        if matches!(a.bias, Bias::Affine | Bias::So3) {
            prm[..3].copy_from_slice(&t.bias);
        }
        prm
    };
    out.reals("actuator_biasprm", 10, written.iter().zip(first()).flat_map(bias));
    out.reals("actuator_ctrlrange", 2, ranges.iter().flat_map(|(range, _)| *range));
    out.reals("actuator_forcerange", 2, written.iter().flat_map(|a| a.forcerange.unwrap_or_default()));
    out.reals("actuator_gear", 6, table.iter().flat_map(|a| a.gear));
    out.reals("actuator_armature", 0, written.iter().map(|a| a.armature));
    out.reals("actuator_damping", 0, written.iter().map(|a| a.damping[0]));
    out.reals("actuator_dampingpoly", 2, written.iter().flat_map(|a| [a.damping[1], a.damping[2]]));
    out.ints("actuator_history", 2, written.iter().flat_map(|a| kept(&a.history)));
    out.ints("actuator_historyadr", 0, addresses(written.iter().map(|a| &a.history), &s.tables.ctrl_rings));
    out.reals("actuator_delay", 0, written.iter().map(|a| a.history.delay));
    out.reals("actuator_acc0", 0, constants.acc0.iter().copied());
    out.reals("actuator_length0", 0, constants.length0.iter().copied());
}

fn sensors(s: &Sources, out: &mut Arrays) {
    let (written, table) = (&s.spec.sensors, &s.tables.sensors);
    out.ints("sensor_type", 0, table.iter().map(|sensor| sensor.kind as i32));
    out.ints("sensor_datatype", 0, written.iter().map(super::sensors::data_type));
    out.ints("sensor_needstage", 0, written.iter().map(super::sensors::need_stage));
    out.ints("sensor_objtype", 0, s.sensed.iter().map(|[(kind, _), _]| *kind));
    out.ints("sensor_objid", 0, s.sensed.iter().map(|[(_, id), _]| *id));
    out.ints("sensor_reftype", 0, s.sensed.iter().map(|[_, (kind, _)]| *kind));
    out.ints("sensor_refid", 0, s.sensed.iter().map(|[_, (_, id)]| *id));
    out.ints("sensor_dim", 0, table.iter().map(|sensor| sensor.data.len as i32));
    out.ints("sensor_adr", 0, table.iter().map(|sensor| sensor.data.start as i32));
    out.reals("sensor_cutoff", 0, written.iter().map(|sensor| sensor.cutoff));
    out.reals("sensor_noise", 0, written.iter().map(|sensor| sensor.noise));
    out.ints("sensor_history", 2, written.iter().flat_map(|sensor| kept(&sensor.history)));
    out.ints("sensor_historyadr", 0, addresses(written.iter().map(|sensor| &sensor.history), &s.tables.sensor_rings));
    out.reals("sensor_delay", 0, written.iter().map(|sensor| sensor.history.delay));
    out.reals("sensor_interval", 2, written.iter().flat_map(|sensor| sensor.history.interval));
}

/// Number of samples of a history, and MuJoCo's number of its interpolation.
fn kept(history: &History) -> [i32; 2] {
    [history.nsample as i32, history.interp as i32]
}

/// Where the histories are that are kept; -1: one is not.
fn addresses<'a>(histories: impl Iterator<Item = &'a History>, rings: &[Ring]) -> impl Iterator<Item = i32> {
    let mut rings = rings.iter();
    histories.map(move |history| {
        let ring = (history.nsample > 0).then(|| rings.next()).flatten();
        ring.map_or(-1, |ring| ring.span.start as i32)
    })
}

fn keys(s: &Sources, out: &mut Arrays) {
    let sizes = &s.tables.sizes;
    let n = s.keys.len();
    out.reals("key_time", 0, s.keys.iter().map(|k| k.time));
    type Field = fn(&Key) -> &Vec<f64>;
    let fields: [(&'static str, usize, Field); 7] = [
        ("key_qpos", sizes.nq, |k| &k.qpos),
        ("key_qvel", sizes.nv, |k| &k.qvel),
        ("key_act", sizes.na, |k| &k.act),
        ("key_plastic", sizes.nplastic, |k| &k.plastic),
        ("key_ctrl", sizes.nu, |k| &k.ctrl),
        ("key_mpos", 3 * sizes.nmocap, |k| &k.mpos),
        ("key_mquat", 4 * sizes.nmocap, |k| &k.mquat),
    ];
    for (name, width, field) in fields {
        let data: Vec<f64> = s.keys.iter().flat_map(|k| field(k).iter().copied()).collect();
        out.0.insert(name, Array { shape: vec![n, width], data: ArrayData::F64(data) });
    }
}

fn options(o: &Options, out: &mut Arrays) {
    let scalars = [
        ("timestep", o.timestep),
        ("density", o.density),
        ("viscosity", o.viscosity),
        ("impratio", o.impratio),
        ("tolerance", o.tolerance),
        ("ls_tolerance", o.ls_tolerance),
        ("noslip_tolerance", o.noslip_tolerance),
        ("ccd_tolerance", o.ccd_tolerance),
        ("sleep_tolerance", o.sleep_tolerance),
        ("o_margin", o.o_margin),
    ];
    for (name, x) in scalars {
        out.0.insert(name, Array { shape: Vec::new(), data: ArrayData::F64(vec![x]) });
    }
    out.reals("gravity", 0, o.gravity.into_iter());
    out.reals("wind", 0, o.wind.into_iter());
    out.reals("magnetic", 0, o.magnetic.into_iter());
    out.reals("o_solref", 0, o.o_solref.into_iter());
    out.reals("o_solimp", 0, o.o_solimp.into_iter());
    out.reals("o_friction", 0, o.o_friction.into_iter());
    let integrator = match o.integrator {
        Integrator::Euler => 0,
        Integrator::Rk4 => 1,
        Integrator::Implicit => 2,
        Integrator::ImplicitFast => 3,
        Integrator::Discrete => 4,
        // MuJoCo has no such number.
        Integrator::Midpoint => 5,
    };
    let cone = match o.cone {
        Cone::Pyramidal => 0,
        Cone::Elliptic => 1,
    };
    let solver = match o.solver {
        Solver::Pgs => 0,
        Solver::Cg => 1,
        Solver::Newton => 2,
    };
    let numbers = [
        ("integrator", integrator),
        ("guard", i32::from(o.guard)),
        ("cone", cone),
        ("solver", solver),
        ("iterations", o.iterations as i32),
        ("ls_iterations", o.ls_iterations as i32),
        ("noslip_iterations", o.noslip_iterations as i32),
        ("ccd_iterations", o.ccd_iterations as i32),
        ("disableactuator", o.actuatorgroupdisable as i32),
    ];
    for (name, x) in numbers {
        out.0.insert(name, Array { shape: Vec::new(), data: ArrayData::I32(vec![x]) });
    }
}
