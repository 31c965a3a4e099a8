//! `lanesim accuracy` and `lanesim stress`.

use super::{Folder, fails, json, succeeds};

const HUMANOID: &str = "models/zoo/humanoid27.xml";

#[test]
fn accuracy_lists_its_scenarios() {
    let list = succeeds(&["accuracy", "--list"]);
    assert!(list.lines().count() >= 26, "{list}");
    for id in ["A1 ", "B11", "C3", "D5c"] {
        assert!(list.contains(id), "no {id}: {list}");
    }
}

/// The error of an engine's setting in the records.
fn error(records: &serde_json::Value, wanted: &[(&str, &str)], timestep: f64) -> f64 {
    let fits = |row: &&serde_json::Value| {
        row["timestep"] == timestep && wanted.iter().all(|(name, value)| row[*name] == *value)
    };
    let row = records.as_array().unwrap().iter().find(fits).unwrap();
    assert!(row["work"].as_f64().unwrap() > 0.0, "{row}");
    row["error"].as_f64().unwrap()
}

#[test]
fn accuracy_measures_orders_of_integrators() {
    let folder = Folder::new("accuracy");
    let (out, cache) = (folder.path("out"), folder.path("cache"));
    let args =
        ["accuracy", "A1", "--no-mujoco", "--timesteps", "10,5", "--integrators", "Euler,RK4", "--timed", "0.001"];
    let table = succeeds(&[&args[..], &["--cache", &cache, "-o", &out]].concat());
    assert!(table.contains("| A1 | pendulum") && table.contains("MuJoCo was not there"), "{table}");
    let records = json(&std::fs::read_to_string(format!("{out}/accuracy.json")).unwrap());
    for (engine, integrator, order, floor) in
        [("lanesim f64", "Euler", 1.0, 0.0), ("lanesim f64", "RK4", 4.0, 0.0), ("lanesim f32", "RK4", 0.0, 1e-4)]
    {
        let at = |dt| error(&records, &[("engine", engine), ("integrator", integrator)], dt);
        let (coarse, fine) = (at(0.01), at(0.005));
        if order > 0.0 {
            let slope = (coarse / fine).log2();
            assert!((slope - order).abs() < 0.2, "{engine} {integrator}: order {slope}");
        } else {
            assert!(coarse < floor, "{engine} {integrator}: {coarse}");
        }
    }
    // MuJoCo's figure for Euler at 5 ms is 1.17e-2.
    let euler = error(&records, &[("engine", "lanesim f64"), ("integrator", "Euler")], 0.005);
    assert!((euler - 1.17e-2).abs() < 1e-3, "{euler}");
    assert!(std::fs::read_to_string(format!("{out}/A1.svg")).unwrap().contains("</svg>"));
    assert_eq!(std::fs::read_dir(&cache).unwrap().count(), 1, "one reference is kept");
}

#[test]
fn accuracy_counts_what_solvers_leave() {
    let folder = Folder::new("accuracy-solvers");
    let (out, cache) = (folder.path("out"), folder.path("cache"));
    let args = ["accuracy", "D4d", "--no-mujoco", "--precision", "f64", "--timed", "0.001"];
    succeeds(&[&args[..], &["--cache", &cache, "-o", &out]].concat());
    let records = json(&std::fs::read_to_string(format!("{out}/accuracy.json")).unwrap());
    let left = |solver: &str, n: usize| {
        let fits = |row: &&serde_json::Value| row["solver"] == solver && row["iterations"] == n;
        records.as_array().unwrap().iter().find(fits).unwrap()["error"].as_f64().unwrap()
    };
    for solver in ["Newton", "CG", "PGS"] {
        let (one, hundred) = (left(solver, 1), left(solver, 100));
        // Newton's may be done after one: no contact slides.
        assert!(hundred <= 1e-2 * one && hundred < 1e-4, "{solver}: {one} {hundred}");
    }
}

#[test]
fn accuracy_refuses_what_it_does_not_know() {
    fails(&["accuracy", "Z9"], 2, "there is no scenario Z9: `lanesim accuracy --list` shows all");
    fails(&["accuracy", "A1", "--timesteps", "3"], 2, "must divide 20 ms");
    fails(&["accuracy", "A1", "--precision", "f16"], 2, "f16");
}

#[test]
fn stress_maps_lost_worlds() {
    let folder = Folder::new("stress-map");
    let picture = folder.path("map.svg");
    let args = ["stress", HUMANOID, "--worlds", "16", "--seconds", "0.5", "--timesteps", "2,20", "--severity", "0.1,4"];
    let more = ["--integrators", "Euler,leapfrog", "--picture", &picture, "--json"];
    let map = json(&succeeds(&[&args[..], &more].concat()));
    let lost = &map["sheets"][0]["lost"];
    assert_eq!(lost[0][0], 0, "calm worlds at 2 ms: {map}");
    assert!(lost[1][1].as_u64().unwrap() > 8, "wild worlds at 20 ms: {map}");
    assert!(map["sheets"][1]["refused"].as_str().unwrap().contains("leapfrog"), "{map}");
    assert!(std::fs::read_to_string(&picture).unwrap().contains("</svg>"));
}

#[test]
fn stress_goes_on_from_its_file_with_the_same_bits() {
    let folder = Folder::new("stress-long");
    let (whole, parts) = (folder.path("whole.npz"), folder.path("parts.npz"));
    let run = |seconds: &str, file: &str| {
        let args =
            ["stress", HUMANOID, "--worlds", "20", "--long", seconds, "--state", file, "--precision", "f32", "--json"];
        json(&succeeds(&args))
    };
    let once = run("1", &whole);
    assert_eq!(run("0.4", &parts)["resumed"], false);
    let resumed = run("1", &parts);
    assert_eq!(resumed["resumed"], true);
    assert_eq!((&once["state_hash"], &once["world_steps"]), (&resumed["state_hash"], &resumed["world_steps"]));
    let long = |model: &str, option: &str| {
        let args = [
            "stress",
            model,
            "--worlds",
            "20",
            "--long",
            "1",
            "--state",
            &parts,
            "--precision",
            "f32",
            "--option",
            option,
        ];
        fails(
            &args,
            1,
            &format!("was written by a run of model \"humanoid27\" and this is \"{}\"", &model[11..model.len() - 4]),
        );
    };
    long("models/zoo/ant.xml", "timestep=0.002");
    long(HUMANOID, "timestep=0.001");
    fails(&["stress", HUMANOID, "--long", "1"], 2, "--state");
    let other = folder.write("other.npz", "qpos", &[1], vec![0.0]);
    fails(
        &["stress", HUMANOID, "--long", "1", "--state", &other],
        1,
        "has no array `stress_model`: not a file of this command",
    );
}
