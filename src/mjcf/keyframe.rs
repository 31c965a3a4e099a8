//! `keyframe/key`.

use super::reader::Reader;
use super::report::Report;
use super::tree::Tree;
use crate::spec::Key;

/// Reads all keys. `kept` says which actuators a lenient load kept.
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
        if reader.all("plastic").is_some() {
            reader.report.unsupported(element, "plastic states (plastic) are");
        }
        if kept.contains(&false) {
            drop_actuators(&mut key, kept, report, element);
        }
        keys.push(key);
    }
    keys
}

/// Removes what belongs to actuators that were left out.
fn drop_actuators(key: &mut Key, kept: &[bool], report: &mut Report, element: &super::tree::Element) {
    if let Some(ctrl) = key.ctrl.as_mut().filter(|ctrl| ctrl.len() == kept.len()) {
        let mut keep = kept.iter();
        ctrl.retain(|_| keep.next().copied().unwrap_or(true));
    }
    // No actuator that was kept has an activation.
    if key.act.take().is_some() {
        report.lose(element, "act left out with the actuators that it belongs to");
    }
}
