//! Our results beside MuJoCo's, for every model under `models/`: see `goldens/README.md`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use lanesim::mjcf::{self, LoadOptions};
use lanesim::npz::{self, Array};
use lanesim::{Model, Options, Precision, eval};

/// Where we differ on purpose, because nothing reads the value: MuJoCo leaves the range of an unlimited joint in degrees, and
/// computes lengths of actuators that are switched off.
const UNREAD: [(&str, &str); 2] = [("autolimits_off", "jnt_range"), ("actuation_off", "actuator_length")];

/// Models on a knife's edge in single precision: capsules at an angle of 9e-4, which it cannot tell from parallel ones, touch
/// at both ends.
const EDGE: [&str; 1] = ["capsule_parallel"];

/// One model's golden file.
struct Golden {
    name: String,
    arrays: BTreeMap<String, Array>,
}

impl Golden {
    /// All golden files.
    fn all() -> Vec<Golden> {
        let folder = root().join("tests/goldens");
        let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e == "npz"))
            .collect();
        paths.sort();
        assert!(paths.len() > 80, "only {} golden files", paths.len());
        paths
            .iter()
            .map(|path| Golden {
                name: path.file_stem().unwrap().to_str().unwrap().to_owned(),
                arrays: npz::read(path).unwrap(),
            })
            .collect()
    }

    /// Its model, with the solver settings of the goldens.
    fn model(&self) -> Model {
        let find = |folder: &str| root().join("models").join(folder).join(format!("{}.xml", self.name));
        let path = ["zoo", "unit"].map(find).into_iter().find(|p| p.exists()).unwrap();
        let overrides = [("tolerance", "1e-14"), ("ls_tolerance", "1e-6"), ("iterations", "200")];
        let overrides = overrides.map(|(name, value)| (name.to_owned(), value.to_owned())).to_vec();
        let spec = mjcf::load(&path, &LoadOptions { lenient: false, overrides }).unwrap();
        Model::from_spec(&spec).unwrap()
    }

    /// Arrays behind a prefix, without it.
    fn group(&self, prefix: &str) -> BTreeMap<&str, &Array> {
        self.arrays.iter().filter_map(|(name, array)| Some((name.strip_prefix(prefix)?, array))).collect()
    }

    fn unread(&self, field: &str) -> bool {
        UNREAD.contains(&(self.name.as_str(), field))
    }

    /// Our values of fields at the golden's states, after `nstep` steps.
    fn eval(&self, fields: &[&str], nstep: usize, precision: Precision) -> BTreeMap<String, Array> {
        let states = self.group("in/").into_iter().map(|(name, array)| (name.to_owned(), array.clone())).collect();
        let options = Options { precision, threads: Some(1), ..Options::default() };
        eval::eval(&self.model(), &states, fields, nstep, &options).unwrap().into_iter().collect()
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Largest difference over the largest value; infinite if the sizes differ. Values far below 0.1 count as zero.
fn error(ours: &[f64], theirs: &[f64]) -> f64 {
    if ours.len() != theirs.len() {
        return f64::INFINITY;
    }
    let scale = theirs.iter().fold(0.1_f64, |m, x| m.max(x.abs()));
    let worst = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, |m: f64, d| if d <= m { m } else { d });
    worst / scale
}

/// One row of a padded array.
fn rows(array: &Array, state: usize, count: usize) -> Vec<Vec<f64>> {
    let most = array.shape()[1];
    let width: usize = array.shape()[2..].iter().product();
    let values = array.to_f64();
    (0..count).map(|k| values[(state * most + k) * width..][..width].to_vec()).collect()
}

/// Contacts and constraint rows of one state in an order that does not depend on which of a pair's contacts was found
/// first: by geoms, then by position.
struct Rows {
    contacts: Vec<usize>,
    rows: Vec<usize>,
}

impl Rows {
    fn sorted(get: &dyn Fn(&str) -> Option<Vec<Vec<f64>>>) -> Rows {
        let (geom, pos, efc) = (get("contact_geom"), get("contact_pos"), get("contact_efc"));
        let (Some(geom), Some(pos), Some(efc)) = (geom, pos, efc) else {
            let n = get("efc_type").map_or(0, |rows| rows.len());
            return Rows { contacts: Vec::new(), rows: (0..n).collect() };
        };
        let key = |k: usize| {
            let place: Vec<i64> = pos[k].iter().map(|x| (x * 1e5).round() as i64).collect();
            (geom[k][0] as i64, geom[k][1] as i64, place)
        };
        let mut contacts: Vec<usize> = (0..geom.len()).collect();
        contacts.sort_by_key(|k| key(*k));
        let n = get("efc_type").map_or(0, |rows| rows.len());
        let mut starts: Vec<usize> = efc.iter().map(|e| e[0]).filter(|e| *e >= 0.0).map(|e| e as usize).collect();
        starts.push(n);
        starts.sort_unstable();
        let mut rows: Vec<usize> = (0..starts[0]).collect();
        for k in &contacts {
            if efc[*k][0] >= 0.0 {
                let start = efc[*k][0] as usize;
                let end = *starts.iter().find(|s| **s > start).unwrap();
                rows.extend(start..end);
            }
        }
        Rows { contacts, rows }
    }
}

/// Entries of a ragged field in sorted order. Numbers of contacts and of rows depend on the order and are left out.
fn ragged(arrays: &BTreeMap<&str, &Array>, field: &str, state: usize) -> Vec<f64> {
    let count = |name: &str| arrays.get(name).map_or(0, |a| a.to_f64()[state] as usize);
    let (ncon, nefc) = (count("ncon"), count("nefc"));
    let get = |name: &str| {
        let n = if name.starts_with("contact") { ncon } else { nefc };
        arrays.get(name).filter(|a| a.shape().len() > 1).map(|a| rows(a, state, n))
    };
    let order = Rows::sorted(&get);
    let order = if field.starts_with("contact") { order.contacts } else { order.rows };
    let all = get(field).unwrap_or_default();
    order.iter().flat_map(|k| all[*k].clone()).collect()
}

fn is_ragged(field: &str) -> bool {
    field.starts_with("contact_") || field.starts_with("efc_")
}

/// Everything that differs by more than `tolerance(field)`.
fn differences(golden: &Golden, precision: Precision, tolerance: &dyn Fn(&str) -> Option<f64>) -> Vec<String> {
    let theirs = golden.group("out/");
    let wanted: Vec<&str> = theirs.keys().copied().filter(|field| tolerance(field).is_some()).collect();
    let ours = golden.eval(&wanted, 0, precision);
    let ours: BTreeMap<&str, &Array> = ours.iter().map(|(name, array)| (name.as_str(), array)).collect();
    let mut found = Vec::new();
    let mut judge = |field: &str, ours: &[f64], theirs: &[f64]| {
        let e = error(ours, theirs);
        let bad = e.is_nan() || tolerance(field).is_some_and(|t| e > t);
        if bad && !golden.unread(field) {
            found.push(format!("{} {field}: {e:.1e}", golden.name));
        }
    };
    for field in wanted.iter().filter(|field| !matches!(**field, "efc_id" | "contact_efc")) {
        if is_ragged(field) {
            for state in 0..theirs["ncon"].shape()[0] {
                judge(field, &ragged(&ours, field, state), &ragged(&theirs, field, state));
            }
        } else {
            judge(field, &ours[field].to_f64(), &theirs[field].to_f64());
        }
    }
    let after = golden.group("next/");
    let stepped = golden.eval(&["qpos", "qvel"], 1, precision);
    for (field, theirs) in &after {
        judge(field, &stepped[*field].to_f64(), &theirs.to_f64());
    }
    found
}

#[test]
fn model_arrays() {
    let mut found = Vec::new();
    for golden in Golden::all() {
        let model = golden.model();
        for (field, theirs) in golden.group("model/") {
            let Some(ours) = model.array(field) else { continue };
            let ours: Vec<f64> = match &ours.data {
                lanesim::model::ArrayData::F64(v) => v.clone(),
                lanesim::model::ArrayData::I32(v) => v.iter().map(|x| f64::from(*x)).collect(),
            };
            let e = error(&ours, &theirs.to_f64());
            if (e.is_nan() || e > 1e-9) && !golden.unread(field) {
                found.push(format!("{} {field}: {e:.1e}", golden.name));
            }
        }
        for (name, n) in golden.group("size/") {
            let ours = model.sizes().iter().find(|(size, _)| *size == name).map(|(_, n)| *n as f64);
            assert_eq!(ours, Some(n.to_f64()[0]), "{} {name}", golden.name);
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn double_precision() {
    let found: Vec<String> =
        Golden::all().iter().flat_map(|golden| differences(golden, Precision::F64, &|_| Some(1e-9))).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Contacts and rows are compared by their effect: which contacts exist may differ at the edge of contact.
#[test]
fn single_precision() {
    let tolerance = |field: &str| match field {
        "ncon" | "nefc" => None,
        _ if is_ragged(field) => None,
        "qacc" | "qfrc_constraint" => Some(2e-3),
        "qacc_smooth" | "qpos" | "qvel" => Some(5e-4),
        _ => Some(2e-5),
    };
    let found: Vec<String> = Golden::all()
        .iter()
        .filter(|golden| !EDGE.contains(&golden.name.as_str()))
        .flat_map(|golden| differences(golden, Precision::F32, &tolerance))
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}
