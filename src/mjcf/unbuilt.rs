//! Sections of which nothing is built: problems or losses where the motion depends on them, notes where it does not.

use super::equality;
use super::report::Report;
use super::tree::{Element, Tree};

/// Reports what these sections hold.
pub(super) fn sections(tree: &Tree, report: &mut Report) {
    const SECTIONS: [(&str, &str); 2] =
        [("equality", "this kind of equality constraint is"), ("deformable", "deformable bodies are")];
    for (section, what) in SECTIONS {
        let unbuilt = |index: &usize| section != "equality" || !equality::built(&tree[*index]);
        for index in tree.section(section).filter(unbuilt).filter(|&index| !idle(section, &tree[index])) {
            report.unsupported(&tree[index], what);
        }
    }
    // What nothing depends on by itself: elements that use it say so.
    note(tree, "extension", |_| true, "plugins are not built", report);
    for (section, what) in [
        ("equality", "equality constraints of kinds that are not built, not active, are left out"),
        ("deformable", "skins are not drawn"),
    ] {
        note(tree, section, |element| idle(section, element), what, report);
    }
}

/// A note on how many there are, at the place of the first.
fn note(tree: &Tree, section: &str, counts: impl Fn(&Element) -> bool, what: &str, report: &mut Report) {
    let mut found = tree.section(section).map(|index| &tree[index]).filter(|element| counts(element));
    if let Some(first) = found.next() {
        report.note(first.source.placed(&format!("{} {what}", 1 + found.count())));
    }
}

/// Whether no motion depends on an element by itself.
fn idle(section: &str, element: &Element) -> bool {
    match section {
        "equality" => !equality::built(element) && element.get("active") == Some("false"),
        _ => element.tag == "skin",
    }
}
