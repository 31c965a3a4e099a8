//! Sensors: what is refused of them, their tables, and MuJoCo's arrays.

use std::collections::HashMap;

use lanesim_kernels::model::{Bound, Limit, Mount, NONE, Sensor, SensorKind, Shape as KernelShape, Span, Target};

use super::check::Element;
use super::links::Links;
use super::names::label;
use super::order::{self, Scene};
use super::pairs::shape;
use super::pose::{Pose, row_major};
use crate::diagnostics::{Diagnostics, quoted};
use crate::model::ElementNames;
use crate::spec::{self, DataType, JointKind, NeedStage, Object, ObjectKind, Path, Shape, Spec, is_limited};

/// Most numbers of all sensors.
const MOST_NUMBERS: usize = 10_000_000;

impl ObjectKind {
    /// As messages call it.
    fn word(self) -> &'static str {
        match self {
            ObjectKind::Body | ObjectKind::XBody => "body",
            ObjectKind::Joint => "joint",
            ObjectKind::Geom => "geom",
            ObjectKind::Site => "site",
            ObjectKind::Tendon => "tendon",
            ObjectKind::Actuator => "actuator",
        }
    }

    /// MuJoCo's number of it.
    fn number(self) -> i32 {
        match self {
            ObjectKind::Body => 1,
            ObjectKind::XBody => 2,
            ObjectKind::Joint => 3,
            ObjectKind::Geom => 5,
            ObjectKind::Site => 6,
            ObjectKind::Tendon => 18,
            ObjectKind::Actuator => 19,
        }
    }
}

/// Adds every problem that sensors show.
pub(crate) fn check(spec: &Spec, diagnostics: &mut Diagnostics) {
    if spec.sensors.is_empty() {
        return;
    }
    let bodies = || spec.bodies.iter();
    let joints: HashMap<&str, &spec::Joint> = bodies().flat_map(|b| &b.joints).map(|j| (j.name.as_str(), j)).collect();
    let mut known: HashMap<&str, Vec<&str>> = HashMap::new();
    known.insert("body", bodies().map(|b| b.name.as_str()).collect());
    known.insert("joint", joints.keys().copied().collect());
    known.insert("geom", bodies().flat_map(|b| &b.geoms).map(|g| g.name.as_str()).collect());
    known.insert("site", bodies().flat_map(|b| &b.sites).map(|s| s.name.as_str()).collect());
    known.insert("tendon", spec.tendons.iter().map(|t| t.name.as_str()).collect());
    known.insert("actuator", spec.actuators.iter().map(|a| a.name.as_str()).collect());
    known.values_mut().for_each(|names| names.sort_unstable());
    let mut numbers = 0_usize;
    for (i, sensor) in spec.sensors.iter().enumerate() {
        let mut element = Element::new(label(sensor.kind.tag(), &sensor.name, i), &sensor.source, diagnostics);
        for (attribute, x) in [("cutoff", sensor.cutoff), ("noise", sensor.noise)] {
            if element.finite(attribute, &[x]) && x < 0.0 {
                element.refuse(format!("{attribute} is negative: {x}"), "give 0 or more");
            }
        }
        let (count, data, _) = sensor.shape();
        if sensor.cutoff > 0.0 && matches!(data, DataType::Axis | DataType::Quaternion) {
            element.refuse("an axis or quaternion cannot be cut off", "remove cutoff");
        }
        let wanted = match data {
            DataType::Axis => 3,
            DataType::Quaternion => 4,
            _ => count,
        };
        if count != wanted {
            element.refuse(format!("dim is {count}"), format!("this datatype has dim {wanted}"));
        }
        numbers = numbers.saturating_add(count);
        if matches!(sensor.kind, SensorKind::Force | SensorKind::Torque)
            && let Some(tendon) = spec.tendons.iter().find(|tendon| matches!(tendon.path, Path::Spatial(_)))
        {
            let what =
                format!("forces of spatial tendons on bodies are not supported, and {} is one", quoted(&tendon.name));
            element.refuse(what, "remove the sensor or the tendon");
        }
        check_objects(sensor, &mut element);
        for object in sensor.object.iter().chain(&sensor.reference) {
            let word = object.kind.word();
            if object.name.is_empty() || known[word].binary_search(&object.name.as_str()).is_err() {
                let message = format!("unknown {word} {}", quoted(&object.name));
                element.unknown(message, &object.name, known[word].iter().copied().filter(|name| !name.is_empty()));
            }
        }
        let of = |kind: ObjectKind| {
            sensor.object.as_ref().filter(|object| object.kind == kind).map(|object| object.name.as_str())
        };
        if let Some(joint) = of(ObjectKind::Joint).and_then(|name| joints.get(name)) {
            check_joint(sensor, joint, &mut element);
        }
        if let Some(name) = of(ObjectKind::Tendon).filter(|_| sensor.kind.of_limit().is_some())
            && spec.tendons.iter().any(|tendon| tendon.name == name && !is_limited(tendon.range, tendon.limited))
        {
            element.refuse(format!("tendon {} has no limits", quoted(name)), "give it a range, or remove the sensor");
        }
    }
    if numbers > MOST_NUMBERS {
        let message = format!("sensors have {numbers} numbers");
        diagnostics.push(&Default::default(), "sensor", message, format!("use at most {MOST_NUMBERS}"));
    }
}

/// Refuses a sensor that is about nothing, or about another kind of element than it measures.
fn check_objects(sensor: &spec::Sensor, element: &mut Element) {
    use ObjectKind::{Actuator, Body, Geom, Joint, Site, Tendon, XBody};
    use SensorKind as Kind;
    const FRAMES: &[ObjectKind] = &[Body, XBody, Geom, Site];
    let (object, reference): (&[ObjectKind], &[ObjectKind]) = match sensor.kind {
        Kind::User => return,
        Kind::EPotential | Kind::EKinetic | Kind::Clock => (&[], &[]),
        Kind::Touch | Kind::Accelerometer | Kind::Velocimeter | Kind::Gyro | Kind::Force | Kind::Torque => {
            (&[Site], &[])
        }
        Kind::Magnetometer | Kind::Rangefinder => (&[Site], &[]),
        Kind::JointPos | Kind::JointVel | Kind::JointActuatorFrc | Kind::BallQuat | Kind::BallAngVel => (&[Joint], &[]),
        Kind::JointLimitPos | Kind::JointLimitVel | Kind::JointLimitFrc => (&[Joint], &[]),
        Kind::TendonPos | Kind::TendonVel | Kind::TendonActuatorFrc => (&[Tendon], &[]),
        Kind::TendonLimitPos | Kind::TendonLimitVel | Kind::TendonLimitFrc => (&[Tendon], &[]),
        Kind::ActuatorPos | Kind::ActuatorVel | Kind::ActuatorFrc => (&[Actuator], &[]),
        Kind::SubtreeCom | Kind::SubtreeLinVel | Kind::SubtreeAngMom => (&[Body, XBody], &[]),
        Kind::InsideSite => (FRAMES, &[Site]),
        Kind::FrameLinAcc | Kind::FrameAngAcc => (FRAMES, &[]),
        Kind::FramePos | Kind::FrameQuat | Kind::FrameXAxis | Kind::FrameYAxis | Kind::FrameZAxis => (FRAMES, FRAMES),
        Kind::FrameLinVel | Kind::FrameAngVel => (FRAMES, FRAMES),
    };
    let optional = reference == FRAMES;
    for (what, given, wanted, optional) in
        [("object", &sensor.object, object, false), ("reference", &sensor.reference, reference, optional)]
    {
        let fits = given.as_ref().map_or(optional || wanted.is_empty(), |given| wanted.contains(&given.kind));
        if !fits {
            let words: Vec<&str> = wanted.iter().map(|kind| kind.word()).collect();
            let remedy =
                if words.is_empty() { "leave it out".into() } else { format!("name one of: {}", words.join(", ")) };
            element.refuse(format!("its {what} is missing or of a kind that it does not measure"), remedy);
        }
    }
}

/// Refuses a joint of another kind than a sensor is made for.
fn check_joint(sensor: &spec::Sensor, joint: &spec::Joint, element: &mut Element) {
    use SensorKind as Kind;
    let name = quoted(&joint.name);
    match sensor.kind {
        Kind::JointPos | Kind::JointVel | Kind::JointActuatorFrc
            if !matches!(joint.kind, JointKind::Slide | JointKind::Hinge) =>
        {
            element
                .refuse(format!("joint {name} is neither a slide nor a hinge"), "use ballquat, framepos or framequat");
        }
        Kind::BallQuat | Kind::BallAngVel if joint.kind != JointKind::Ball => {
            element.refuse(format!("joint {name} is not a ball"), "use jointpos or jointvel");
        }
        Kind::JointLimitPos | Kind::JointLimitVel | Kind::JointLimitFrc
            if joint.kind == JointKind::Free || !is_limited(joint.range, joint.limited) =>
        {
            element.refuse(format!("joint {name} has no limits"), "give it a range, or remove the sensor");
        }
        _ => {}
    }
}

/// The sensors of a model without faults.
#[derive(Default)]
pub(crate) struct Sensors {
    pub table: Vec<Sensor<f64>>,
    /// Frames that they are about, after those on which actuators act.
    pub mounts: Vec<Mount<f64>>,
    pub targets: Vec<Target<f64>>,
    /// Numbers of all.
    pub ndata: usize,
    /// Of each, the objects that it is about, in MuJoCo's types and numbers; -1: none.
    pub objects: Vec<[(i32, i32); 2]>,
}

/// What sensors are made of.
pub(crate) struct Sources<'a> {
    pub spec: &'a Spec,
    pub scene: &'a Scene<'a>,
    pub links: &'a Links,
    pub names: &'a ElementNames,
    pub limits: &'a [Limit<f64>],
    /// Frames on which actuators act.
    pub mounts: &'a [Mount<f64>],
}

impl Sensors {
    /// Their tables.
    pub fn new(s: &Sources, diagnostics: &mut Diagnostics) -> Sensors {
        let mut out = Sensors { mounts: s.mounts.to_vec(), ..Sensors::default() };
        for sensor in &s.spec.sensors {
            out.add(s, sensor);
        }
        if let Some(ranging) = s.spec.sensors.iter().find(|sensor| sensor.kind == SensorKind::Rangefinder) {
            out.add_targets(s, ranging, diagnostics);
        }
        out
    }

    fn add(&mut self, s: &Sources, sensor: &spec::Sensor) {
        use SensorKind as Kind;
        let (count, data, _) = sensor.shape();
        let ids =
            [&sensor.object, &sensor.reference].map(|object| object.as_ref().map(|object| (object, id(s, object))));
        self.objects.push(ids.map(|of| of.map_or((0, -1), |(object, id)| (object.kind.number(), id as i32))));
        let volume =
            ids[usize::from(sensor.kind == Kind::InsideSite)].filter(|(object, _)| object.kind == ObjectKind::Site);
        let site = volume.map(|(_, id)| &s.scene.sites[id]);
        let mut entry = Sensor {
            kind: sensor.kind,
            data: Span { start: self.ndata as u32, len: count as u32 },
            bound: match data {
                _ if sensor.cutoff <= 0.0 => Bound::None,
                DataType::Positive => Bound::Above,
                _ => Bound::Both,
            },
            mount: NONE,
            reference: NONE,
            id: NONE,
            bodies: Span::default(),
            shape: site.map_or(KernelShape::Sphere, |site| shape(site.spec.shape)),
            size: site.map_or([0.0; 3], |site| site.spec.size),
            cutoff: sensor.cutoff,
        };
        self.ndata += count;
        if let Some((object, id)) = ids[0] {
            let joint = s.scene.joints.get(id);
            let number = |of: fn(&order::Joint) -> usize| joint.map_or(NONE, |joint| of(joint) as u32);
            match sensor.kind {
                Kind::JointPos | Kind::BallQuat => entry.id = number(|joint| joint.qpos),
                Kind::JointVel | Kind::JointActuatorFrc | Kind::BallAngVel => entry.id = number(|joint| joint.dof),
                Kind::JointLimitPos | Kind::JointLimitVel | Kind::JointLimitFrc => {
                    entry.id = limit(s, |limit| limit.tendon == NONE && limit.joint as usize == id);
                }
                Kind::TendonLimitPos | Kind::TendonLimitVel | Kind::TendonLimitFrc => {
                    entry.id = limit(s, |limit| limit.tendon as usize == id);
                }
                Kind::TendonPos | Kind::TendonVel | Kind::TendonActuatorFrc => entry.id = id as u32,
                Kind::ActuatorPos | Kind::ActuatorVel | Kind::ActuatorFrc => entry.id = id as u32,
                Kind::SubtreeCom | Kind::SubtreeLinVel | Kind::SubtreeAngMom => entry.bodies = subtree(s.scene, id),
                Kind::User => {}
                _ => {
                    let (body, pose) = frame(s, object.kind, id);
                    entry.mount = self.mount(s, body, &pose);
                    (entry.id, entry.bodies) = (body as u32, subtree(s.scene, body));
                }
            }
        }
        if let Some((object, id)) = ids[1] {
            let (body, pose) = frame(s, object.kind, id);
            entry.reference = self.mount(s, body, &pose);
        }
        self.table.push(entry);
    }

    /// A frame fixed to a body.
    fn mount(&mut self, s: &Sources, body: usize, in_body: &Pose) -> u32 {
        let pose = s.links.body_pose[body].then(in_body);
        let (pos, quat, rot) = (pose.pos.to_array(), pose.wxyz(), row_major(pose.rotation()));
        self.mounts.push(Mount { link: s.links.body_link[body], pos, rot, quat });
        self.mounts.len() as u32 - 1
    }

    /// The geoms that rays can meet.
    fn add_targets(&mut self, s: &Sources, ranging: &spec::Sensor, diagnostics: &mut Diagnostics) {
        for geom in s.scene.geoms.iter().filter(|geom| !geom.spec.clear) {
            if matches!(geom.spec.shape, Shape::Mesh | Shape::HeightField) {
                let name = label(ranging.kind.tag(), &ranging.name, 0);
                let message = format!(
                    "rays to meshes and height fields are not supported, and geom {} is one",
                    quoted(&geom.spec.name)
                );
                return diagnostics.push(
                    &ranging.source,
                    name,
                    message,
                    "give it an rgba without opacity, or remove it",
                );
            }
            let mount = self.mount(s, geom.body, &geom.pose);
            let (body, size) = (geom.body as u32, geom.spec.size);
            self.targets.push(Target { body, mount, shape: shape(geom.spec.shape), size });
        }
    }
}

/// Number of a limit; [`NONE`]: none is in force.
fn limit(s: &Sources, of: impl Fn(&Limit<f64>) -> bool) -> u32 {
    s.limits.iter().position(of).map_or(NONE, |limit| limit as u32)
}

/// Number of an object among those of its kind.
fn id(s: &Sources, object: &Object) -> usize {
    let names = match object.kind {
        ObjectKind::Body | ObjectKind::XBody => &s.names.bodies,
        ObjectKind::Joint => &s.names.joints,
        ObjectKind::Geom => &s.names.geoms,
        ObjectKind::Site => &s.names.sites,
        ObjectKind::Tendon => &s.names.tendons,
        ObjectKind::Actuator => &s.names.actuators,
    };
    // Checked before.
    names.id(&object.name).unwrap_or_default()
}

/// The body that has a frame, and the frame's pose in it.
fn frame(s: &Sources, kind: ObjectKind, id: usize) -> (usize, Pose) {
    match kind {
        ObjectKind::Body => (id, s.scene.bodies[id].mass.frame),
        ObjectKind::Geom => (s.scene.geoms[id].body, s.scene.geoms[id].pose),
        ObjectKind::Site => (s.scene.sites[id].body, s.scene.sites[id].pose),
        _ => (id, Pose::IDENTITY),
    }
}

/// A body and all that it carries: bodies come depth first.
fn subtree(scene: &Scene, body: usize) -> Span {
    let carried = scene.bodies[body + 1..].iter().take_while(|other| body == 0 || other.parent >= body).count();
    Span { start: body as u32, len: carried as u32 + 1 }
}

/// MuJoCo's number of a data type.
pub(super) fn data_type(sensor: &spec::Sensor) -> i32 {
    match sensor.shape().1 {
        DataType::Real => 0,
        DataType::Positive => 1,
        DataType::Axis => 2,
        DataType::Quaternion => 3,
    }
}

/// MuJoCo's number of the stage by which a sensor is known.
pub(super) fn need_stage(sensor: &spec::Sensor) -> i32 {
    match sensor.shape().2 {
        NeedStage::Pos => 1,
        NeedStage::Vel => 2,
        NeedStage::Acc => 3,
    }
}
