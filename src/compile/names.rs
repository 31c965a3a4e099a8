//! Names of elements in messages, and that they are unique.

use std::collections::HashMap;

use crate::diagnostics::{Diagnostics, quoted};
use crate::spec::{Source, Spec};

/// An element as messages call it: `geom "floor"`, or `geom #3` without a name.
pub(crate) fn label(kind: &str, name: &str, index: usize) -> String {
    if name.is_empty() { format!("{kind} #{index}") } else { format!("{kind} {}", quoted(name)) }
}

/// Elements of which one sentence is true.
#[derive(Default)]
pub(super) struct List {
    /// Where the first is.
    source: Source,
    labels: Vec<String>,
}

impl List {
    pub fn push(&mut self, source: &Source, label: String) {
        if self.labels.is_empty() {
            self.source = source.clone();
        }
        self.labels.push(label);
    }

    /// The sentence with the place of the first element, the first few, and how many more there are; `None` of nothing.
    pub fn sentence(&self, what: &str) -> Option<String> {
        const SHOWN: usize = 5;
        let shown = self.labels.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
        let more = match self.labels.len().saturating_sub(SHOWN) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        (!self.labels.is_empty()).then(|| self.source.placed(&format!("{what}: {shown}{more}")))
    }
}

/// Refuses two elements of one kind and one name.
pub(crate) fn check_unique(spec: &Spec, diagnostics: &mut Diagnostics) {
    let bodies = &spec.bodies;
    unique("body", bodies.iter().map(|b| (&b.name, &b.source)), diagnostics);
    unique("joint", bodies.iter().flat_map(|b| &b.joints).map(|j| (&j.name, &j.source)), diagnostics);
    unique("geom", bodies.iter().flat_map(|b| &b.geoms).map(|g| (&g.name, &g.source)), diagnostics);
    unique("site", bodies.iter().flat_map(|b| &b.sites).map(|s| (&s.name, &s.source)), diagnostics);
    unique("camera", bodies.iter().flat_map(|b| &b.cameras).map(|c| (&c.name, &c.source)), diagnostics);
    unique("pair", spec.pairs.iter().map(|p| (&p.name, &p.source)), diagnostics);
    unique("exclude", spec.excludes.iter().map(|e| (&e.name, &e.source)), diagnostics);
    unique("tendon", spec.tendons.iter().map(|t| (&t.name, &t.source)), diagnostics);
    unique("equality", spec.equalities.iter().map(|e| (&e.name, &e.source)), diagnostics);
    unique("actuator", spec.actuators.iter().map(|a| (&a.name, &a.source)), diagnostics);
    unique("sensor", spec.sensors.iter().map(|s| (&s.name, &s.source)), diagnostics);
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
                let place = match &first.file {
                    Some(file) if source.file != first.file => format!(", first used in {file}:{}", first.line),
                    _ if first.line > 0 => format!(", first used in line {}", first.line),
                    _ => String::new(),
                };
                diagnostics.push(source, label(kind, name, i), format!("repeated name{place}"), "rename one of them");
            }
        }
    }
}
