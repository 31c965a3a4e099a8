//! `compiler`: how the rest of the file is to be read. The last value of an attribute holds for the whole model.

use super::orientation::Angles;
use super::reader::Reader;
use super::report::Report;
use super::tree::Tree;
use crate::spec::{InertiaFromGeom, Spec};

const UNITS: &[(&str, f64)] = &[("degree", std::f64::consts::PI / 180.0), ("radian", 1.0)];
const INERTIA: &[(&str, InertiaFromGeom)] =
    &[("auto", InertiaFromGeom::Auto), ("false", InertiaFromGeom::False), ("true", InertiaFromGeom::True)];

/// Reads all `compiler` sections, in order.
pub(super) fn read(tree: &Tree, spec: &mut Spec, report: &mut Report) -> Angles {
    let compiler = &mut spec.compiler;
    let mut angles = Angles { scale: UNITS[0].1, sequence: *b"xyz" };
    for index in tree.sections("compiler") {
        let mut reader = Reader::new(&tree[index], report);
        for (name, _) in &reader.element.attributes {
            spec.written.insert(format!("compiler {name}"), reader.element.source.clone());
        }
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
    }
    angles
}

fn sequence(reader: &mut Reader, target: &mut [u8; 3]) {
    let Some(text) = reader.element.get("eulerseq") else { return };
    match <[u8; 3]>::try_from(text.as_bytes()) {
        Ok(letters) if letters.iter().all(|c| b"xyzXYZ".contains(c)) => *target = letters,
        _ => reader.report.error(reader.element, "attribute \"eulerseq\": must be three of x, y, z, X, Y, Z", ""),
    }
}
