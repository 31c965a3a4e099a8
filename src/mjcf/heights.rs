//! `asset/hfield`: height fields from files or written out. Only those that some geom has are read.

use std::collections::BTreeSet;

use super::include::Assets;
use super::reader::Reader;
use super::report::{Report, quoted};
use super::tree::{Element, Tree};
use crate::mesh::{MOST_POINTS, RawHeights};
use crate::spec::{HeightField, Spec};

/// Reads the height fields that geoms have.
pub(super) fn fields(tree: &Tree, assets: &mut Assets<'_, '_>, spec: &mut Spec, report: &mut Report) {
    let geoms = spec.bodies.iter().flat_map(|body| &body.geoms);
    let used: BTreeSet<String> = geoms.map(|geom| geom.hfield.clone()).filter(|name| !name.is_empty()).collect();
    for index in tree.section("asset").filter(|&index| tree[index].tag == "hfield") {
        let element = &tree[index];
        let (mut name, file) = {
            let reader = Reader::new(element, report);
            (reader.text("name"), reader.text("file"))
        };
        if name.is_empty() {
            let last = file.rsplit(['/', '\\']).next().unwrap_or_default();
            name = last.rsplit_once('.').map_or(last, |(stem, _)| stem).to_string();
        }
        if !used.contains(&name) {
            continue;
        }
        let mut size = [0.0; 4];
        if !Reader::new(element, report).list("size", &mut size) {
            report.error(element, "attribute \"size\" is missing", "give two half lengths, a height and a base");
            continue;
        }
        match heights(element, &file, assets, report) {
            Ok(raw) => spec.hfields.push(HeightField {
                name,
                size,
                rows: raw.size[0],
                columns: raw.size[1],
                heights: raw.normalised().into(),
                source: element.source.clone(),
            }),
            Err((message, remedy)) => report.error(element, message, remedy),
        }
    }
}

/// The heights of an element; the error is a message and a remedy.
fn heights(
    element: &Element,
    file: &str,
    assets: &mut Assets<'_, '_>,
    report: &mut Report,
) -> Result<RawHeights, (String, String)> {
    let mut reader = Reader::new(element, report);
    if !file.is_empty() {
        let kind = reader.text("content_type").to_ascii_lowercase();
        let is_png = kind == "image/png" || (kind.is_empty() && file.to_ascii_lowercase().ends_with(".png"));
        let bytes = assets.mesh(file, element.source.file.as_deref())?;
        return RawHeights::read(&bytes, is_png)
            .map_err(|message| (format!("file {} {message}", quoted(file)), String::new()));
    }
    let (mut rows, mut columns) = (0, 0);
    reader.integer("nrow", &mut rows);
    reader.integer("ncol", &mut columns);
    let size = [rows, columns].map(|count| usize::try_from(count).unwrap_or(0));
    let count = size[0].saturating_mul(size[1]);
    if count > MOST_POINTS {
        return Err((format!("{rows} by {columns} are more than {MOST_POINTS} points"), "give fewer".into()));
    }
    let written = reader.all("elevation").map(|list| list.iter().map(|x| *x as f32).collect::<Vec<f32>>());
    let list = written.unwrap_or_else(|| vec![0.0; count]);
    if list.len() != count {
        let message = format!("attribute \"elevation\" has {} numbers, and nrow times ncol is {count}", list.len());
        return Err((message, "give one height for every point".into()));
    }
    let raw = RawHeights::from_above(size, &list);
    match raw.problem() {
        Some(problem) => Err((problem, "name a file, or give nrow and ncol".into())),
        None => Ok(raw),
    }
}
