//! `sensor`.

use super::history::history;
use super::reader::Reader;
use super::report::{Report, quoted};
use super::tree::Tree;
use crate::spec::{
    ContactField, Contacts, DataType, NeedStage, Object, ObjectKind, RayField, Reduce, Sensor, SensorKind,
};

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
    /// A site or a camera.
    SiteOrCamera,
    /// A site and a camera.
    SiteAndCamera,
    /// A geom or a body on either side.
    Sides,
    /// What is on either side of contacts, if anything.
    Contacts,
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
    (SensorKind::Rangefinder, Names::SiteOrCamera),
    (SensorKind::CamProjection, Names::SiteAndCamera),
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
    (SensorKind::GeomDist, Names::Sides),
    (SensorKind::GeomNormal, Names::Sides),
    (SensorKind::GeomFromTo, Names::Sides),
    (SensorKind::Contact, Names::Contacts),
    (SensorKind::EPotential, Names::Nothing),
    (SensorKind::EKinetic, Names::Nothing),
    (SensorKind::Clock, Names::Nothing),
    (SensorKind::User, Names::Any),
];

/// Things with a frame.
const FRAMES: &[(&str, ObjectKind)] = &[
    ("body", ObjectKind::Body),
    ("xbody", ObjectKind::XBody),
    ("geom", ObjectKind::Geom),
    ("site", ObjectKind::Site),
    ("camera", ObjectKind::Camera),
];

/// All that a user's sensor may be about.
const OBJECTS: &[(&str, ObjectKind)] = &[
    ("body", ObjectKind::Body),
    ("xbody", ObjectKind::XBody),
    ("geom", ObjectKind::Geom),
    ("site", ObjectKind::Site),
    ("camera", ObjectKind::Camera),
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
/// Words of `reduce`.
const REDUCE: &[(&str, Reduce)] = &[
    ("none", Reduce::None),
    ("mindist", Reduce::MinDist),
    ("maxforce", Reduce::MaxForce),
    ("netforce", Reduce::NetForce),
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
    history(reader, &mut sensor.history);
    reader.leading("interval", &mut sensor.history.interval);
    let complete = match names {
        Names::Nothing => true,
        Names::One(of, attribute) => {
            let given = reader.required(attribute);
            sensor.object = Some(Object { kind: of, name: reader.text(attribute) });
            given
        }
        Names::Frame => frame(reader, "obj", &mut sensor.object),
        Names::Frames => {
            let given = frame(reader, "obj", &mut sensor.object);
            let referred = !reader.has_value("reftype") && !reader.has_value("refname");
            given & (referred || frame(reader, "ref", &mut sensor.reference))
        }
        Names::SiteAndFrame => {
            sensor.reference = Some(Object { kind: ObjectKind::Site, name: reader.text("site") });
            reader.required("site") & frame(reader, "obj", &mut sensor.object)
        }
        Names::SiteOrCamera => {
            fields(reader, RayField::ALL, &mut sensor.fields);
            let choices: &[Choice] = &[(ObjectKind::Site, "site"), (ObjectKind::Camera, "camera")];
            sensor.object = one_of(reader, choices);
            side_given(reader, &sensor.object, choices)
        }
        Names::SiteAndCamera => {
            sensor.object = Some(Object { kind: ObjectKind::Site, name: reader.text("site") });
            sensor.reference = Some(Object { kind: ObjectKind::Camera, name: reader.text("camera") });
            reader.required("site") & reader.required("camera")
        }
        Names::Sides => {
            const SIDES: [&[Choice]; 2] = [&[GEOMS[0], BODIES[0]], &[GEOMS[1], BODIES[1]]];
            sensor.object = one_of(reader, SIDES[0]);
            sensor.reference = one_of(reader, SIDES[1]);
            side_given(reader, &sensor.object, SIDES[0]) & side_given(reader, &sensor.reference, SIDES[1])
        }
        Names::Contacts => {
            sensor.object = one_of(reader, &[GEOMS[0], BODIES[0], SUBTREES[0], (ObjectKind::Site, "site")]);
            sensor.reference = one_of(reader, &[GEOMS[1], BODIES[1], SUBTREES[1]]);
            contacts(reader, &mut sensor.contacts)
        }
        Names::Any => user(reader, &mut sensor),
    };
    complete.then_some(sensor)
}

/// A kind of element, and the attribute that names it.
type Choice = (ObjectKind, &'static str);

const GEOMS: [Choice; 2] = [(ObjectKind::Geom, "geom1"), (ObjectKind::Geom, "geom2")];
const BODIES: [Choice; 2] = [(ObjectKind::Body, "body1"), (ObjectKind::Body, "body2")];
const SUBTREES: [Choice; 2] = [(ObjectKind::XBody, "subtree1"), (ObjectKind::XBody, "subtree2")];

/// What one of several attributes names; two are reported.
fn one_of(reader: &mut Reader, choices: &[Choice]) -> Option<Object> {
    let given: Vec<&Choice> = choices.iter().filter(|(_, attribute)| reader.has_value(attribute)).collect();
    if let [(_, first), (_, second), ..] = given[..] {
        reader.report.error(reader.element, format!("both {first} and {second} are given"), "keep one");
    }
    given.first().map(|(kind, attribute)| Object { kind: *kind, name: reader.text(attribute) })
}

/// Whether one of several attributes is there; reported if not.
fn side_given(reader: &mut Reader, side: &Option<Object>, choices: &[Choice]) -> bool {
    if side.is_none() {
        let names: Vec<&str> = choices.iter().map(|(_, attribute)| *attribute).collect();
        reader.report.error(
            reader.element,
            format!("attribute {} is missing", quoted(names[0])),
            format!("give {}", names.join(" or ")),
        );
    }
    side.is_some()
}

/// What a contact sensor returns of which contacts.
fn contacts(reader: &mut Reader, contacts: &mut Contacts) -> bool {
    fields(reader, ContactField::ALL, &mut contacts.fields);
    reader.keyword("reduce", REDUCE, &mut contacts.reduce);
    let mut num = 1;
    reader.integer("num", &mut num);
    if num < 1 {
        reader.report.error(reader.element, format!("attribute \"num\": {num} is not positive"), "give 1 or more");
    }
    contacts.num = usize::try_from(num).unwrap_or(0);
    true
}

/// What is returned of each ray or contact, in the one order that there is.
fn fields<T: Copy>(reader: &mut Reader, table: &[(&str, T)], fields: &mut Vec<T>) {
    let mut next = 0;
    for word in reader.element.get("data").unwrap_or_default().split_ascii_whitespace() {
        let places: Vec<(&str, usize)> = table.iter().enumerate().map(|(i, (word, _))| (*word, i)).collect();
        let mut place = 0;
        if !reader.word("data", word, &places, &mut place) {
            continue;
        }
        if place < next {
            let message = format!("attribute \"data\": {} is out of order", quoted(word));
            let words: Vec<&str> = table.iter().map(|(word, _)| *word).collect();
            reader.report.error(
                reader.element,
                message,
                format!("give each once, in this order: {}", words.join(", ")),
            );
        }
        next = place + 1;
        fields.push(table[place].1);
    }
}

/// An element with a frame, by the attributes `objtype` and `objname` or `reftype` and `refname`; says whether both are given.
fn frame(reader: &mut Reader, prefix: &str, object: &mut Option<Object>) -> bool {
    let [kind, name] = ["type", "name"].map(|attribute| format!("{prefix}{attribute}"));
    let complete = reader.required(&kind) & reader.required(&name);
    let mut of = ObjectKind::Site;
    reader.keyword(&kind, FRAMES, &mut of);
    *object = Some(Object { kind: of, name: reader.text(&name) });
    complete
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
