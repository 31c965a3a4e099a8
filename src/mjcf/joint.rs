//! `joint` and `freejoint`.

use super::orientation::Angles;
use super::reader::Reader;
use crate::spec::{Joint, JointKind, Tri, is_limited};

const KINDS: &[(&str, JointKind)] =
    &[("free", JointKind::Free), ("ball", JointKind::Ball), ("slide", JointKind::Slide), ("hinge", JointKind::Hinge)];

/// Reads what a joint and its default have in common; angles stay as written until the kind of the joint is final.
pub(super) fn read(reader: &mut Reader, joint: &mut Joint) {
    reader.keyword("type", KINDS, &mut joint.kind);
    reader.list("pos", &mut joint.pos);
    reader.list("axis", &mut joint.axis);
    reader.range("range", &mut joint.range);
    reader.tri("limited", &mut joint.limited);
    reader.real("margin", &mut joint.margin);
    reader.real("ref", &mut joint.reference);
    reader.real("springref", &mut joint.springref);
    reader.real("springyield", &mut joint.springyield);
    reader.leading("stiffness", &mut joint.stiffness);
    reader.leading("damping", &mut joint.damping);
    reader.list("springdamper", &mut joint.springdamper);
    reader.real("armature", &mut joint.armature);
    reader.real("frictionloss", &mut joint.frictionloss);
    reader.leading("solreflimit", &mut joint.solreflimit);
    reader.leading("solimplimit", &mut joint.solimplimit);
    reader.leading("solreffriction", &mut joint.solreffriction);
    reader.leading("solimpfriction", &mut joint.solimpfriction);
    reader.range("actuatorfrcrange", &mut joint.actuatorfrcrange);
    reader.tri("actuatorfrclimited", &mut joint.actuatorfrclimited);
    reader.boolean("actuatorgravcomp", &mut joint.actuatorgravcomp);
    reader.integer("group", &mut joint.group);
}

/// Turns angles into radians, and the limit of a free joint off.
pub(super) fn finish(joint: &mut Joint, angles: &Angles) {
    let scale = angles.scale;
    // As in MuJoCo, the range of a joint without a limit stays as it was written.
    if matches!(joint.kind, JointKind::Hinge | JointKind::Ball) && is_limited(joint.range, joint.limited) {
        joint.range = joint.range.map(|range| range.map(|x| x * scale));
    }
    if joint.kind == JointKind::Hinge {
        joint.reference *= scale;
        joint.springref *= scale;
    }
    if matches!(joint.kind, JointKind::Hinge | JointKind::Ball) {
        joint.springyield *= scale;
    }
    if joint.kind == JointKind::Free {
        // Defaults often give every joint a limit; a free one has none.
        joint.limited = Tri::False;
    }
}

/// Reads a `freejoint`, which has no class.
pub(super) fn free(reader: &mut Reader) -> Joint {
    let mut joint = Joint { kind: JointKind::Free, ..Joint::default() };
    reader.tri("align", &mut joint.align);
    reader.integer("group", &mut joint.group);
    joint
}
