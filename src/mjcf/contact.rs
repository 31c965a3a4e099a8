//! `contact/pair` and `contact/exclude`.

use super::reader::Reader;
use crate::spec::{Exclude, Pair};

/// Reads what a pair and its default have in common.
pub(super) fn read(reader: &mut Reader, pair: &mut Pair) {
    reader.integer("condim", &mut pair.condim);
    reader.leading("friction", &mut pair.friction);
    reader.leading("solref", &mut pair.solref);
    reader.leading("solreffriction", &mut pair.solreffriction);
    reader.leading("solimp", &mut pair.solimp);
    reader.real("margin", &mut pair.margin);
    reader.real("gap", &mut pair.gap);
    reader.neutral("adhesion", "adhesive contact (adhesion) is");
}

/// Reads a pair over its class's values.
pub(super) fn pair(reader: &mut Reader, default: &Pair) -> Option<Pair> {
    let complete = reader.required("geom1") & reader.required("geom2");
    let mut pair = default.clone();
    read(reader, &mut pair);
    pair.name = reader.text("name");
    pair.geom1 = reader.text("geom1");
    pair.geom2 = reader.text("geom2");
    pair.source = reader.element.source.clone();
    complete.then_some(pair)
}

/// Reads an exclude.
pub(super) fn exclude(reader: &mut Reader) -> Option<Exclude> {
    let complete = reader.required("body1") & reader.required("body2");
    complete.then(|| Exclude {
        name: reader.text("name"),
        body1: reader.text("body1"),
        body2: reader.text("body2"),
        source: reader.element.source.clone(),
    })
}
