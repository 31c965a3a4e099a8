//! `sensor`.

use super::reader::Reader;
use super::report::Report;
use super::tree::Tree;
use crate::spec::{DataType, NeedStage, Object, ObjectKind, Sensor, SensorKind};

/// What a kind says of the element that it is about.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Names {
    /// Nothing.
    Nothing,
    /// An element of one kind, by an attribute of that name.
    One(ObjectKind, &'static str),
    /// Any with a frame, by `objtype` and `objname`.
    Frame,
    /// The same, and perhaps another, by `reftype` and `refname`.
    Frames,
    /// A site, and any with a frame.
    SiteAndFrame,
    /// Perhaps any.
    Any,
}

const SITE: Names = Names::One(ObjectKind::Site, "site");
const JOINT: Names = Names::One(ObjectKind::Joint, "joint");
const TENDON: Names = Names::One(ObjectKind::Tendon, "tendon");
const ACTUATOR: Names = Names::One(ObjectKind::Actuator, "actuator");
const BODY: Names = Names::One(ObjectKind::Body, "body");

/// Every kind, with what it names.
const KINDS: &[(SensorKind, Names)] = &[
    (SensorKind::Touch, SITE),
    (SensorKind::Accelerometer, SITE),
    (SensorKind::Velocimeter, SITE),
    (SensorKind::Gyro, SITE),
    (SensorKind::Force, SITE),
    (SensorKind::Torque, SITE),
    (SensorKind::Magnetometer, SITE),
    (SensorKind::Rangefinder, SITE),
    (SensorKind::JointPos, JOINT),
    (SensorKind::JointVel, JOINT),
    (SensorKind::TendonPos, TENDON),
    (SensorKind::TendonVel, TENDON),
    (SensorKind::ActuatorPos, ACTUATOR),
    (SensorKind::ActuatorVel, ACTUATOR),
    (SensorKind::ActuatorFrc, ACTUATOR),
    (SensorKind::JointActuatorFrc, JOINT),
    (SensorKind::TendonActuatorFrc, TENDON),
    (SensorKind::BallQuat, JOINT),
    (SensorKind::BallAngVel, JOINT),
    (SensorKind::JointLimitPos, JOINT),
    (SensorKind::JointLimitVel, JOINT),
    (SensorKind::JointLimitFrc, JOINT),
    (SensorKind::TendonLimitPos, TENDON),
    (SensorKind::TendonLimitVel, TENDON),
    (SensorKind::TendonLimitFrc, TENDON),
    (SensorKind::FramePos, Names::Frames),
    (SensorKind::FrameQuat, Names::Frames),
    (SensorKind::FrameXAxis, Names::Frames),
    (SensorKind::FrameYAxis, Names::Frames),
    (SensorKind::FrameZAxis, Names::Frames),
    (SensorKind::FrameLinVel, Names::Frames),
    (SensorKind::FrameAngVel, Names::Frames),
    (SensorKind::FrameLinAcc, Names::Frame),
    (SensorKind::FrameAngAcc, Names::Frame),
    (SensorKind::SubtreeCom, BODY),
    (SensorKind::SubtreeLinVel, BODY),
    (SensorKind::SubtreeAngMom, BODY),
    (SensorKind::InsideSite, Names::SiteAndFrame),
    (SensorKind::EPotential, Names::Nothing),
    (SensorKind::EKinetic, Names::Nothing),
    (SensorKind::Clock, Names::Nothing),
    (SensorKind::User, Names::Any),
];

/// Things with a frame.
const FRAMES: &[(&str, ObjectKind)] =
    &[("body", ObjectKind::Body), ("xbody", ObjectKind::XBody), ("geom", ObjectKind::Geom), ("site", ObjectKind::Site)];

/// All that a user's sensor may be about.
const OBJECTS: &[(&str, ObjectKind)] = &[
    ("body", ObjectKind::Body),
    ("xbody", ObjectKind::XBody),
    ("geom", ObjectKind::Geom),
    ("site", ObjectKind::Site),
    ("joint", ObjectKind::Joint),
    ("tendon", ObjectKind::Tendon),
    ("actuator", ObjectKind::Actuator),
];

const DATA_TYPES: &[(&str, DataType)] = &[
    ("real", DataType::Real),
    ("positive", DataType::Positive),
    ("axis", DataType::Axis),
    ("quaternion", DataType::Quaternion),
];
const STAGES: &[(&str, NeedStage)] = &[("pos", NeedStage::Pos), ("vel", NeedStage::Vel), ("acc", NeedStage::Acc)];

/// Reads the sections. A kind that is not built is reported: numbers that somebody relies on would be missing.
pub(super) fn all(tree: &Tree, report: &mut Report) -> Vec<Sensor> {
    let mut sensors = Vec::new();
    for index in tree.section("sensor") {
        let element = &tree[index];
        match KINDS.iter().find(|(kind, _)| kind.tag() == element.tag) {
            Some((kind, names)) => sensors.extend(read(*kind, *names, &mut Reader::new(element, report))),
            None => report.unsupported(element, &format!("sensors of kind {} are", element.tag)),
        }
    }
    sensors
}

/// Reads a sensor; `None` if something is missing or not built, which is reported.
fn read(kind: SensorKind, names: Names, reader: &mut Reader) -> Option<Sensor> {
    let mut sensor =
        Sensor { name: reader.text("name"), kind, source: reader.element.source.clone(), ..Sensor::default() };
    reader.real("cutoff", &mut sensor.cutoff);
    reader.real("noise", &mut sensor.noise);
    if delayed(reader) {
        reader.report.unsupported(reader.element, "histories of sensors (nsample, delay, interval) are");
        return None;
    }
    let complete = match names {
        Names::Nothing => true,
        Names::One(of, attribute) => {
            if kind == SensorKind::Rangefinder && of_camera(reader) {
                return None;
            }
            let given = reader.required(attribute);
            sensor.object = Some(Object { kind: of, name: reader.text(attribute) });
            given
        }
        Names::Frame => frame(reader, "obj", &mut sensor.object)?,
        Names::Frames => {
            let given = frame(reader, "obj", &mut sensor.object)?;
            let referred = !reader.has_value("reftype") && !reader.has_value("refname");
            given & (referred || frame(reader, "ref", &mut sensor.reference)?)
        }
        Names::SiteAndFrame => {
            sensor.reference = Some(Object { kind: ObjectKind::Site, name: reader.text("site") });
            reader.required("site") & frame(reader, "obj", &mut sensor.object)?
        }
        Names::Any => user(reader, &mut sensor),
    };
    complete.then_some(sensor)
}

/// Whether a sensor asks for a history.
fn delayed(reader: &mut Reader) -> bool {
    let (mut samples, mut delay, mut interval) = (0, 0.0, [0.0; 2]);
    reader.integer("nsample", &mut samples);
    reader.real("delay", &mut delay);
    reader.leading("interval", &mut interval);
    samples != 0 || delay != 0.0 || interval[0] != 0.0
}

/// Whether a rangefinder is one of a camera, or returns other things than distances, which is reported.
fn of_camera(reader: &mut Reader) -> bool {
    let what = if reader.has_value("camera") {
        "rangefinders of cameras are"
    } else if reader.element.get("data").is_some_and(|data| data.split_ascii_whitespace().ne(["dist"])) {
        "rangefinders that return more than distances are"
    } else {
        return false;
    };
    reader.report.unsupported(reader.element, what);
    true
}

/// An element with a frame, by the attributes `objtype` and `objname` or `reftype` and `refname`; `None`: it is a camera, which is
/// reported.
fn frame(reader: &mut Reader, prefix: &str, object: &mut Option<Object>) -> Option<bool> {
    let [kind, name] = ["type", "name"].map(|attribute| format!("{prefix}{attribute}"));
    let complete = reader.required(&kind) & reader.required(&name);
    if reader.element.get(&kind) == Some("camera") {
        reader.report.unsupported(reader.element, "sensors of cameras are");
        return None;
    }
    let mut of = ObjectKind::Site;
    reader.keyword(&kind, FRAMES, &mut of);
    *object = Some(Object { kind: of, name: reader.text(&name) });
    Some(complete)
}

/// What only a user's sensor has.
fn user(reader: &mut Reader, sensor: &mut Sensor) -> bool {
    let complete = reader.required("dim");
    let mut dim = 0;
    reader.integer("dim", &mut dim);
    let (count, data, stage) = &mut sensor.user;
    *count = usize::try_from(dim).unwrap_or(0);
    reader.keyword("datatype", DATA_TYPES, data);
    reader.keyword("needstage", STAGES, stage);
    if dim < 0 {
        reader.report.error(reader.element, format!("attribute \"dim\": {dim} is negative"), "give 0 or more");
    }
    if reader.has_value("objtype") || reader.has_value("objname") {
        let mut of = ObjectKind::Body;
        let both = reader.required("objtype") & reader.required("objname");
        reader.keyword("objtype", OBJECTS, &mut of);
        sensor.object = Some(Object { kind: of, name: reader.text("objname") });
        return complete & both;
    }
    complete
}
