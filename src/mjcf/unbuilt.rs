//! Sections of which nothing is built: problems or losses where the motion depends on them, notes where it does not.

use super::equality;
use super::report::Report;
use super::tree::{Element, Tree};
use super::value::numbers;

/// Reports what these sections hold.
pub(super) fn sections(tree: &Tree, report: &mut Report) {
    const SECTIONS: [(&str, &str); 3] = [
        ("tendon", "tendons are"),
        ("equality", "this kind of equality constraint is"),
        ("deformable", "deformable bodies are"),
    ];
    let defaults = has_default(tree, "tendon");
    for (section, what) in SECTIONS {
        let unbuilt = |index: &usize| section != "equality" || !equality::built(&tree[*index]);
        for index in tree.section(section).filter(unbuilt).filter(|&index| !idle(section, &tree[index], defaults)) {
            report.unsupported(&tree[index], what);
        }
    }
    // What nothing depends on by itself: elements that use it say so.
    note(tree, "extension", |_| true, "plugins are not built", report);
    note(tree, "asset", |element| element.tag == "hfield", "height fields are not read", report);
    for (section, what) in [
        ("tendon", "tendons without a force of their own are left out, as tendons are not built"),
        ("equality", "equality constraints of kinds that are not built, not active, are left out"),
        ("deformable", "skins are not drawn"),
    ] {
        note(tree, section, |element| idle(section, element, defaults), what, report);
    }
}

/// A note on how many there are, at the place of the first.
fn note(tree: &Tree, section: &str, counts: impl Fn(&Element) -> bool, what: &str, report: &mut Report) {
    let mut found = tree.section(section).map(|index| &tree[index]).filter(|element| counts(element));
    if let Some(first) = found.next() {
        report.note(first.source.placed(&format!("{} {what}", 1 + found.count())));
    }
}

/// Whether no motion depends on an element by itself; `defaults`: whether a class may give tendons more than is written.
fn idle(section: &str, element: &Element, defaults: bool) -> bool {
    match section {
        "tendon" => !defaults && element.attributes.iter().all(|(name, value)| harmless(name, value)),
        "equality" => !equality::built(element) && element.get("active") == Some("false"),
        _ => element.tag == "skin",
    }
}

/// Whether an attribute of a tendon gives it no force.
fn harmless(name: &str, value: &str) -> bool {
    match name {
        "name" | "group" | "width" | "rgba" | "material" | "user" | "springlength" | "class" => true,
        "limited" | "actuatorfrclimited" => value == "false",
        "stiffness" | "damping" | "frictionloss" | "armature" => {
            numbers(value).is_ok_and(|list| list.iter().all(|&x| x == 0.0))
        }
        _ => false,
    }
}

/// Whether any default class says something about elements of this kind.
fn has_default(tree: &Tree, tag: &str) -> bool {
    tree.elements.iter().any(|element| element.tag == "default" && element.children.iter().any(|&c| tree[c].tag == tag))
}
