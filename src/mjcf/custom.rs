//! `custom`: user data, which has no effect but for names that start with `lanesim.`.

use super::reader::Reader;
use super::report::{Report, quoted};
use super::tree::{Element, Tree};
use super::value::keyword;

/// Start of the names that mean something to this library.
const PREFIX: &str = "lanesim.";
/// Those names.
const KNOWN: [&str; 4] = ["lanesim.family", "lanesim.contact", "lanesim.equality", "lanesim.maxvel"];

/// Checks all user data.
pub(super) fn check(tree: &Tree, report: &mut Report) {
    for index in tree.section("custom") {
        let element = &tree[index];
        let mut reader = Reader::new(element, report);
        match element.tag.as_str() {
            "numeric" => numeric(&mut reader),
            "text" => {
                let _ = reader.required("name") & reader.required("data");
            }
            "tuple" => {
                reader.required("name");
                for member in tree.children(index).filter(|child| child.tag == "element") {
                    let mut reader = Reader::new(member, reader.report);
                    let _ = reader.required("objtype") & reader.required("objname");
                    reader.real("prm", &mut 0.0);
                }
            }
            _ => continue,
        }
        if element.get("name").is_some_and(|name| name.starts_with(PREFIX)) {
            extension(element, report);
        }
    }
}

fn numeric(reader: &mut Reader) {
    reader.required("name");
    let mut size = 0;
    reader.integer("size", &mut size);
    let given = reader.all("data").map_or(0, |list| list.len());
    if reader.has("size") && usize::try_from(size).is_ok_and(|size| given > size) {
        reader.report.error(reader.element, format!("attribute \"data\": more than {size} numbers"), "");
    } else if size < 0 || given == 0 && !reader.has("size") {
        reader.report.error(reader.element, "a numeric needs a size or data", "");
    }
}

/// Checks a name that starts with the prefix.
fn extension(element: &Element, report: &mut Report) {
    let (name, data) = (element.get("name").unwrap_or_default(), element.get("data").unwrap_or_default());
    // Whether the value is the default, and so supported.
    let neutral = match (element.tag.as_str(), name) {
        ("text", "lanesim.family") => keyword(data, &[("accel", true), ("velocity", false)]),
        ("text", "lanesim.contact") => keyword(data, &[("implicit", false), ("convex", false), ("diagonal", false)]),
        ("text", "lanesim.equality") => keyword(data, &[("soft", true), ("project", false)]),
        ("tuple", "lanesim.maxvel") => Ok(false),
        _ => {
            let remedy = report.propose(name, KNOWN.into_iter());
            return report.error(element, format!("unknown name {}", quoted(name)), remedy);
        }
    };
    match neutral {
        Ok(true) => {}
        Ok(false) => report.unsupported(element, "velocity stepping is"),
        Err(message) => report.error(element, format!("attribute \"data\": {message}"), ""),
    }
}
