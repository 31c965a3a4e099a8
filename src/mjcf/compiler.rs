//! `compiler`: how the rest of the file is to be read. The last value of an attribute holds for the whole model.

use super::orientation::Angles;
use super::reader::Reader;
use super::report::Report;
use super::tree::Tree;
use crate::spec::{InertiaFromGeom, LengthRangeMode, Spec};

const UNITS: &[(&str, f64)] = &[("degree", std::f64::consts::PI / 180.0), ("radian", 1.0)];
const INERTIA: &[(&str, InertiaFromGeom)] =
    &[("auto", InertiaFromGeom::Auto), ("false", InertiaFromGeom::False), ("true", InertiaFromGeom::True)];

/// User-defined muscles are refused wherever they are.
const MODES: &[(&str, LengthRangeMode)] = &[
    ("none", LengthRangeMode::None),
    ("muscle", LengthRangeMode::Muscle),
    ("muscleuser", LengthRangeMode::Muscle),
    ("all", LengthRangeMode::All),
];

/// Reads all `compiler` sections, in order.
pub(super) fn read(tree: &Tree, spec: &mut Spec, report: &mut Report) -> Angles {
    let mut angles = Angles { scale: UNITS[0].1, sequence: *b"xyz" };
    for index in tree.sections("compiler") {
        let mut reader = Reader::new(&tree[index], report);
        for (name, _) in &reader.element.attributes {
            spec.written.insert(format!("compiler {name}"), reader.element.source.clone());
        }
        let compiler = &mut spec.compiler;
        reader.keyword("angle", UNITS, &mut angles.scale);
        sequence(&mut reader, &mut angles.sequence);
        if reader.element.get("coordinate").is_some_and(|value| value != "local") {
            reader.report.error(reader.element, "attribute \"coordinate\": only local is supported", "");
        }
        reader.boolean("autolimits", &mut compiler.autolimits);
        reader.real("boundmass", &mut compiler.boundmass);
        reader.real("boundinertia", &mut compiler.boundinertia);
        reader.real("settotalmass", &mut compiler.settotalmass);
        reader.boolean("balanceinertia", &mut compiler.balanceinertia);
        reader.boolean("fusestatic", &mut compiler.fusestatic);
        reader.boolean("discardvisual", &mut compiler.discardvisual);
        reader.boolean("alignfree", &mut compiler.alignfree);
        reader.boolean("fitaabb", &mut compiler.fitaabb);
        reader.keyword("inertiafromgeom", INERTIA, &mut compiler.inertiafromgeom);
        reader.integers("inertiagrouprange", &mut compiler.inertiagrouprange);
        for &child in &tree[index].children {
            lengthrange(&mut Reader::new(&tree[child], report), spec);
        }
    }
    angles
}

fn lengthrange(reader: &mut Reader, spec: &mut Spec) {
    for (name, _) in &reader.element.attributes {
        spec.written.insert(format!("lengthrange {name}"), reader.element.source.clone());
    }
    let range = &mut spec.compiler.lengthrange;
    reader.keyword("mode", MODES, &mut range.mode);
    reader.boolean("useexisting", &mut range.useexisting);
    reader.boolean("uselimit", &mut range.uselimit);
    reader.real("accel", &mut range.accel);
    reader.real("maxforce", &mut range.maxforce);
    reader.real("timeconst", &mut range.timeconst);
    reader.real("timestep", &mut range.timestep);
    reader.real("inttotal", &mut range.inttotal);
    reader.real("interval", &mut range.interval);
    reader.real("tolrange", &mut range.tolrange);
}

fn sequence(reader: &mut Reader, target: &mut [u8; 3]) {
    let Some(text) = reader.element.get("eulerseq") else { return };
    match <[u8; 3]>::try_from(text.as_bytes()) {
        Ok(letters) if letters.iter().all(|c| b"xyzXYZ".contains(c)) => *target = letters,
        _ => reader.report.error(reader.element, "attribute \"eulerseq\": must be three of x, y, z, X, Y, Z", ""),
    }
}
