//! `equality`: connect, weld, joint, tendon.

use super::reader::Reader;
use super::tree::Element;
use crate::spec::{Equality, Held};

/// Reads what all kinds and their default have in common.
pub(super) fn read(reader: &mut Reader, equality: &mut Equality) {
    reader.boolean("active", &mut equality.active);
    reader.leading("solref", &mut equality.solref);
    reader.leading("solimp", &mut equality.solimp);
}

/// Whether a kind is built.
pub(super) fn built(element: &Element) -> bool {
    matches!(element.tag.as_str(), "connect" | "weld" | "joint" | "tendon")
}

/// What an element holds; `None` if it does not say, which is reported.
pub(super) fn held(reader: &mut Reader) -> Option<Held> {
    let pair = |reader: &Reader, first, second| [reader.text(first), reader.text(second)];
    match reader.element.tag.as_str() {
        kind @ ("joint" | "tendon") => {
            let of_joints = kind == "joint";
            let [first, second] = if of_joints { ["joint1", "joint2"] } else { ["tendon1", "tendon2"] };
            let complete = reader.required(first);
            let mut polycoef = [0.0, 1.0, 0.0, 0.0, 0.0];
            reader.leading("polycoef", &mut polycoef);
            let names = pair(reader, first, second);
            complete.then_some(match of_joints {
                true => Held::Joints { joints: names, polycoef },
                false => Held::Tendons { tendons: names, polycoef },
            })
        }
        "connect" if by_sites(reader, &["body1", "body2", "anchor"])? => {
            Some(Held::Sites(pair(reader, "site1", "site2")))
        }
        "connect" => {
            let mut anchor = [0.0; 3];
            let complete = reader.required("body1") & reader.required("anchor");
            reader.list("anchor", &mut anchor);
            complete.then(|| Held::Points { bodies: pair(reader, "body1", "body2"), anchor })
        }
        _ => {
            let mut torquescale = 1.0;
            reader.real("torquescale", &mut torquescale);
            if by_sites(reader, &["body1", "body2", "anchor", "relpose"])? {
                return Some(Held::SiteFrames { sites: pair(reader, "site1", "site2"), torquescale });
            }
            let (mut anchor, mut pose) = ([0.0; 3], [0.0; 7]);
            reader.list("anchor", &mut anchor);
            reader.list("relpose", &mut pose);
            let [x, y, z, quat @ ..] = pose;
            let relpose = (quat != [0.0; 4]).then_some(([x, y, z], quat));
            let complete = reader.required("body1");
            complete.then(|| Held::Frames { bodies: pair(reader, "body1", "body2"), anchor, relpose, torquescale })
        }
    }
}

/// Whether an element names sites; `None` if it does so by half, or names others too, which is reported.
fn by_sites(reader: &mut Reader, others: &[&str]) -> Option<bool> {
    let sites = ["site1", "site2"].map(|name| reader.has_value(name));
    if sites == [false; 2] {
        return Some(false);
    }
    if let Some(other) = others.iter().find(|other| reader.has_value(other)) {
        let message = format!("both sites and {other} are given");
        let remedy = format!("keep site1 and site2, or {}", others.join(", "));
        reader.report.error(reader.element, message, remedy);
        return None;
    }
    (reader.required("site1") & reader.required("site2")).then_some(true)
}
