//! `keyframe/key`.

use super::reader::Reader;
use super::report::Report;
use super::tree::Tree;
use super::value::integer;
use crate::spec::Key;

/// Most keyframes that `size/nkey` may ask for.
const MOST_KEYS: usize = 10_000;

/// Reads all keys. `kept` says of which controls a lenient load kept the actuators.
pub(super) fn read(tree: &Tree, kept: &[bool], lost_coordinates: bool, report: &mut Report) -> Vec<Key> {
    let mut keys = Vec::new();
    for index in tree.section("keyframe").filter(|&index| tree[index].tag == "key") {
        let element = &tree[index];
        if lost_coordinates {
            report.lose(element, "left out: it has coordinates of elements that were left out");
            continue;
        }
        let mut reader = Reader::new(element, report);
        let mut key = Key { name: reader.text("name"), source: element.source.clone(), ..Key::default() };
        reader.real("time", &mut key.time);
        key.qpos = reader.all("qpos");
        key.qvel = reader.all("qvel");
        key.act = reader.all("act");
        key.ctrl = reader.all("ctrl");
        key.mpos = reader.all("mpos");
        key.mquat = reader.all("mquat");
        key.plastic = reader.all("plastic");
        if kept.contains(&false) {
            drop_actuators(&mut key, kept, report, element);
        }
        keys.push(key);
    }
    // `size/nkey` is the least number of keys; those that are not written are the initial state.
    for index in tree.sections("size") {
        let element = &tree[index];
        match element.get("nkey").map_or(Ok(None), integer) {
            Ok(Some(n)) if n > MOST_KEYS as i32 => {
                report.error(element, format!("nkey is {n}, more than {MOST_KEYS}"), "");
            }
            Ok(n) => keys.resize(keys.len().max(usize::try_from(n.unwrap_or(0)).unwrap_or(0)), Key::default()),
            Err(message) => report.error(element, format!("attribute \"nkey\": {message}"), ""),
        }
    }
    keys
}

/// Removes what belongs to actuators that were left out.
fn drop_actuators(key: &mut Key, kept: &[bool], report: &mut Report, element: &super::tree::Element) {
    if let Some(ctrl) = &mut key.ctrl {
        let mut keep = kept.iter();
        ctrl.retain(|_| keep.next().copied().unwrap_or(true));
    }
    // Whose activations they are cannot be told.
    if key.act.take().is_some() {
        report.lose(element, "act left out with the actuators that it belongs to");
    }
}
