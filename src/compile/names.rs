//! Names of elements in messages, and that they are unique.

use std::collections::HashMap;

use crate::diagnostics::Diagnostics;
use crate::spec::{Source, Spec};

/// An element as messages call it: `geom "floor"`, or `geom #3` without a name.
pub(crate) fn label(kind: &str, name: &str, index: usize) -> String {
    if name.is_empty() { format!("{kind} #{index}") } else { format!("{kind} \"{name}\"") }
}

/// `: did you mean "x"?` for the closest of `candidates`, or nothing if none is close.
pub(crate) fn suggestion<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> String {
    const LOOKED_AT: usize = 2000;
    let limit = name.chars().count() / 3 + 1;
    candidates
        .take(LOOKED_AT)
        .filter(|c| !c.is_empty() && c.len().abs_diff(name.len()) <= limit)
        .map(|c| (distance(name, c), c))
        .filter(|&(d, _)| d <= limit)
        .min()
        .map_or(String::new(), |(_, c)| format!("did you mean \"{c}\"?"))
}

/// Levenshtein's distance.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, &y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// Refuses two elements of one kind and one name.
pub(crate) fn check_unique(spec: &Spec, diagnostics: &mut Diagnostics) {
    let bodies = &spec.bodies;
    unique("body", bodies.iter().map(|b| (&b.name, &b.source)), diagnostics);
    unique("joint", bodies.iter().flat_map(|b| &b.joints).map(|j| (&j.name, &j.source)), diagnostics);
    unique("geom", bodies.iter().flat_map(|b| &b.geoms).map(|g| (&g.name, &g.source)), diagnostics);
    unique("site", bodies.iter().flat_map(|b| &b.sites).map(|s| (&s.name, &s.source)), diagnostics);
    unique("pair", spec.pairs.iter().map(|p| (&p.name, &p.source)), diagnostics);
    unique("exclude", spec.excludes.iter().map(|e| (&e.name, &e.source)), diagnostics);
    unique("actuator", spec.actuators.iter().map(|a| (&a.name, &a.source)), diagnostics);
    unique("key", spec.keys.iter().map(|k| (&k.name, &k.source)), diagnostics);
}

fn unique<'a>(kind: &str, elements: impl Iterator<Item = (&'a String, &'a Source)>, diagnostics: &mut Diagnostics) {
    let mut seen: HashMap<&str, &Source> = HashMap::new();
    for (i, (name, source)) in elements.enumerate() {
        if name.is_empty() {
            continue;
        }
        match seen.get(name.as_str()) {
            None => {
                seen.insert(name, source);
            }
            Some(first) => {
                let place = if first.line > 0 { format!(", first used in line {}", first.line) } else { String::new() };
                diagnostics.push(source, label(kind, name, i), format!("repeated name{place}"), "rename one of them");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suggestions() {
        let known = ["left_knee", "right_knee", "hip"];
        assert_eq!(suggestion("left_kne", known.into_iter()), "did you mean \"left_knee\"?");
        assert_eq!(suggestion("shoulder", known.into_iter()), "");
    }
}
