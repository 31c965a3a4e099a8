//! `tendon`: fixed and spatial.

use super::reader::Reader;
use super::report::Report;
use super::tree::{Element, Tree};
use crate::spec::{Path, Tendon, Waypoint};

/// Reads what both kinds and their default have in common.
pub(super) fn read(reader: &mut Reader, tendon: &mut Tendon) {
    reader.range("range", &mut tendon.range);
    reader.tri("limited", &mut tendon.limited);
    reader.real("margin", &mut tendon.margin);
    let mut rest = [0.0, f64::NAN];
    if reader.leading("springlength", &mut rest) {
        // One number is both ends.
        tendon.springlength = [rest[0], if rest[1].is_nan() { rest[0] } else { rest[1] }];
    }
    reader.leading("stiffness", &mut tendon.stiffness);
    reader.leading("damping", &mut tendon.damping);
    reader.real("armature", &mut tendon.armature);
    reader.real("frictionloss", &mut tendon.frictionloss);
    reader.leading("solreflimit", &mut tendon.solreflimit);
    reader.leading("solimplimit", &mut tendon.solimplimit);
    reader.leading("solreffriction", &mut tendon.solreffriction);
    reader.leading("solimpfriction", &mut tendon.solimpfriction);
    reader.range("actuatorfrcrange", &mut tendon.actuatorfrcrange);
    reader.tri("actuatorfrclimited", &mut tendon.actuatorfrclimited);
    reader.integer("group", &mut tendon.group);
    reader.ignored("width", 1, false);
    reader.ignored("rgba", 4, false);
    reader.real("springyield", &mut tendon.springyield);
}

pub(super) fn joints(tree: &Tree, index: usize, report: &mut Report) -> Path {
    let mut joints = Vec::new();
    for element in tree.children(index) {
        let mut reader = Reader::new(element, report);
        let mut coef = 0.0;
        let complete = reader.required("joint") & reader.required("coef");
        reader.real("coef", &mut coef);
        if complete {
            joints.push((reader.text("joint"), coef));
        }
    }
    Path::Fixed(joints)
}

pub(super) fn waypoints(tree: &Tree, index: usize, report: &mut Report) -> Path {
    Path::Spatial(tree.children(index).filter_map(|element| waypoint(element, report)).collect())
}

/// A point of a path; `None` if it does not say enough, which is reported.
fn waypoint(element: &Element, report: &mut Report) -> Option<Waypoint> {
    let mut reader = Reader::new(element, report);
    match element.tag.as_str() {
        "site" => reader.required("site").then(|| Waypoint::Site(reader.text("site"))),
        "geom" => {
            let (geom, side) = (reader.text("geom"), reader.text("sidesite"));
            reader.required("geom").then_some(Waypoint::Geom { geom, side })
        }
        _ => {
            let mut divisor = 1.0;
            let given = reader.required("divisor") && reader.real("divisor", &mut divisor);
            given.then_some(Waypoint::Pulley(divisor))
        }
    }
}
