//! The command line as users meet it: files, exit statuses, messages.

mod accuracy;
mod clouds;
mod files;
mod names;
mod optimise;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use lanesim::npz::{self, Array, Data};

const ANT: &str = "models/zoo/ant.xml";

fn lanesim(args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    Command::new(env!("CARGO_BIN_EXE_lanesim")).args(args).current_dir(root).output().unwrap()
}

/// Standard output of a command that succeeds.
fn succeeds(args: &[&str]) -> String {
    let out = lanesim(args);
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap()
}

/// Asserts that a command fails with this status and a message that contains `words`.
fn fails(args: &[&str], status: i32, words: &str) {
    let out = lanesim(args);
    let message = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(status), "{args:?}: {message}");
    assert!(message.contains(words), "{args:?}: {message}");
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap()
}

/// A folder for a test's files, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("lanesim-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().to_owned()
    }

    /// Writes an archive with one array.
    fn write(&self, file: &str, name: &str, shape: &[usize], values: Vec<f64>) -> String {
        let array = Array::new(shape.to_vec(), Data::F64(values)).unwrap();
        npz::write(Path::new(&self.path(file)), &[(name.to_owned(), array)]).unwrap();
        self.path(file)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn help_names_every_command() {
    let help = succeeds(&["--help"]);
    for command in ["info", "check", "rollout", "bench", "eval"] {
        assert!(help.contains(command), "{command}");
        assert!(succeeds(&[command, "--help"]).contains("--option <NAME=VALUE>"), "{command}");
    }
}

#[test]
fn info_has_the_sizes() {
    let info = json(&succeeds(&["info", ANT, "--json"]));
    for (name, n) in
        [("nq", 15), ("nv", 14), ("nu", 8), ("na", 0), ("nbody", 10), ("njnt", 9), ("ngeom", 10), ("nsite", 0)]
    {
        assert_eq!(info[name], n, "{name}");
    }
    assert!(info["bytes_per_world"].as_u64().unwrap() > 0);
    assert!(succeeds(&["info", ANT]).contains("bytes per world"));
}

#[test]
fn options_override_the_model() {
    let info = json(&succeeds(&["info", ANT, "--json", "--option", "timestep=0.001"]));
    assert_eq!(info["timestep"], 0.001);
    fails(&["info", ANT, "--option", "timestp=0.001"], 1, "timestep");
    fails(&["info", ANT, "--option", "timestep"], 2, "NAME=VALUE");
}

#[test]
fn check_reports_and_rejects() {
    let folder = Folder::new("check");
    let report = json(&succeeds(&["check", ANT, "--steps", "50", "--json"]));
    assert_eq!((&report["steps"], report["flags"].as_array().unwrap().len()), (&50.into(), 0));
    let bad = folder.path("bad.xml");
    std::fs::write(&bad, "<mujoco>\n <worldbody>\n  <body>\n   <joint/>\n  </body>\n </worldbody>\n</mujoco>\n")
        .unwrap();
    fails(&["check", &bad, "--steps", "5"], 1, "mass");
    fails(&["check", "no_such_file.xml"], 1, "no_such_file.xml");
    fails(&["check"], 2, "MODEL");
    fails(&["check", ANT, "--steps", "0"], 2, "must be from 1");
}

#[test]
fn rollout_writes_what_was_asked_for() {
    let folder = Folder::new("rollout");
    let out = folder.path("out.npz");
    let controls = folder.write("u.npz", "ctrl", &[3, 5, 8], vec![0.5; 120]);
    let states = folder.write("s.npz", "qvel", &[3, 14], vec![0.1; 42]);
    let common = ["rollout", ANT, "--worlds", "3", "--steps", "5", "-o", &out];
    let run = |more: &[&str]| json(&succeeds(&[&common, more, &["--json"]].concat()));
    let summary =
        run(&["--controls", &controls, "--states", &states, "--outputs", "qpos,xpos,ncon,status", "--threads", "2"]);
    assert_eq!(summary["lost"], 0);
    let arrays = npz::read(Path::new(&out)).unwrap();
    assert_eq!(arrays["qpos"].shape(), [3, 5, 15]);
    assert_eq!(arrays["xpos"].shape(), [3, 5, 10, 3]);
    assert_eq!(arrays["ncon"].shape(), [3, 5]);
    // The same worlds one at a time and with one thread: the same bits.
    let scalar = run(&["--controls", &controls, "--states", &states, "--backend", "scalar", "--threads", "1"]);
    assert_eq!(scalar["state_hash"], summary["state_hash"]);
    assert_ne!(run(&["--noise", "--seed", "1"])["state_hash"], run(&["--noise", "--seed", "2"])["state_hash"]);
    assert_eq!(run(&["--noise=1"])["state_hash"], run(&["--noise"])["state_hash"]);
    assert_ne!(run(&["--noise=0.5"])["state_hash"], run(&["--noise"])["state_hash"]);
    assert_eq!(run(&["--noise=0.5"])["state_hash"], run(&["--noise", "0.5"])["state_hash"]);
}

#[test]
fn wrong_arrays_are_named() {
    let folder = Folder::new("wrong");
    let out = folder.path("out.npz");
    let common = ["rollout", ANT, "--worlds", "4", "--steps", "100", "-o", &out];
    let with =
        |more: [&'static str; 1], file: &str, words: &str| fails(&[&common[..], &more, &[file]].concat(), 1, words);
    let shape = folder.write("shape.npz", "ctrl", &[3, 100, 2], vec![0.0; 600]);
    with(["--controls"], &shape, "has shape [3, 100, 2]; expected [nworld=4, nstep=100, nu=8]");
    let mut values = vec![0.0; 3200];
    values[800 + 8 + 3] = f64::NAN;
    let nan = folder.write("nan.npz", "ctrl", &[4, 100, 8], values);
    with(["--controls"], &nan, "array `ctrl` holds NaN at [1, 1, 3]");
    let name = folder.write("name.npz", "control", &[4, 100, 8], vec![0.0; 3200]);
    with(["--controls"], &name, "array `control` is not known here; valid: ctrl");
    let empty = folder.path("empty.npz");
    npz::write(Path::new(&empty), &[]).unwrap();
    with(["--controls"], &empty, "has no array `ctrl`");
    let more = folder.path("more.npz");
    let zeros = |shape: &[usize]| Array::new(shape.to_vec(), Data::F64(vec![0.0; shape.iter().product()])).unwrap();
    npz::write(Path::new(&more), &[("qpso".into(), zeros(&[4, 15])), ("qvel".into(), zeros(&[4, 14]))]).unwrap();
    with(["--states"], &more, "array `qpso` is not known here; did you mean \"qpos\"?");
    let other = folder.write("other.npz", "qpos", &[4, 7], vec![0.0; 28]);
    with(["--states"], &other, "was it made for another model?");
    std::fs::write(folder.path("text.npz"), "not an archive").unwrap();
    with(["--states"], &folder.path("text.npz"), "not a NumPy archive");
    fails(&[&common[..], &["--outputs", "qpso"]].concat(), 2, "qpso");
    fails(&[&common[..], &["--keyframe", "0"]].concat(), 2, "the model has no keyframes; leave it out");
    assert!(!Path::new(&out).exists());
}

#[test]
fn what_cannot_fit_is_refused() {
    fails(&["bench", ANT, "--worlds", "2000000000"], 1, "memory");
    fails(&["rollout", ANT, "--worlds", "1000000", "--steps", "2000000000", "-o", "x.npz"], 1, "memory");
}

#[test]
fn a_diverging_world_is_named() {
    let folder = Folder::new("diverge");
    let stiff = folder.path("stiff.xml");
    let text = "<mujoco><option timestep='0.1'/><worldbody><body><joint name='hip' axis='0 1 0' stiffness='1e7'/>\
                <geom size='.1' pos='.3 0 0'/></body></worldbody></mujoco>";
    std::fs::write(&stiff, text).unwrap();
    let report = json(&succeeds(&["check", &stiff, "--steps", "50", "--json"]));
    assert_eq!(report["flags"], serde_json::json!(["HugeValue", "Frozen"]));
    let event = &report["events"][0];
    assert_eq!((&event["step"], &event["place"]), (&2.into(), &"dof 0 of joint 0 \"hip\"".into()));
    let again = json(&succeeds(&["check", &stiff, "--steps", "50", "--json", "--on-diverge", "reset"]));
    assert_eq!(again["flags"], serde_json::json!(["HugeValue"]));
    let words = "world 0 diverged: HugeValue at step 2, dof 0 of joint 0 \"hip\"";
    fails(&["check", &stiff, "--steps", "50", "--on-diverge", "error"], 1, words);
    let out = folder.path("out.npz");
    let summary = json(&succeeds(&["rollout", &stiff, "--worlds", "2", "--steps", "9", "-o", &out, "--json"]));
    assert_eq!((&summary["lost"], summary["events"].as_array().unwrap().len()), (&2.into(), 4));
}

#[test]
fn info_says_what_runs() {
    let plan = |more: &[&str]| json(&succeeds(&[&["info", ANT, "--json"], more].concat()))["plan"].clone();
    let runs = |plan: &serde_json::Value, stage: &str| {
        plan.as_array().unwrap().iter().find(|part| part["stage"] == stage).unwrap()["runs"].clone()
    };
    let usual = plan(&[]);
    for (stage, expected) in [("collision", true), ("limits", true), ("dry friction", false), ("energy", false)] {
        assert_eq!(runs(&usual, stage), expected, "{stage}");
    }
    assert_eq!(runs(&plan(&["--outputs", "energy"]), "energy"), true);
    assert_eq!(runs(&plan(&["--option", "contact=disable"]), "collision"), false);
    assert!(succeeds(&["info", ANT, "--option", "contact=disable"]).contains("contacts are switched off"));
}

#[test]
fn eval_computes_fields() {
    let folder = Folder::new("eval");
    let (empty, out) = (folder.path("empty.npz"), folder.path("out.npz"));
    npz::write(Path::new(&empty), &[]).unwrap();
    succeeds(&["eval", ANT, "--input", &empty, "--output", &out, "--outputs", "qM,qacc,body_mass,ncon,contact_pos"]);
    let arrays = npz::read(Path::new(&out)).unwrap();
    let shapes: Vec<(&str, &[usize])> = arrays.iter().map(|(name, array)| (name.as_str(), array.shape())).collect();
    let expected: [(&str, &[usize]); 5] =
        [("body_mass", &[10]), ("contact_pos", &[1, 0, 3]), ("ncon", &[1]), ("qM", &[1, 14, 14]), ("qacc", &[1, 14])];
    assert_eq!(shapes, expected);
    let states = folder.write("s.npz", "qvel", &[5, 14], vec![0.2; 70]);
    succeeds(&["eval", ANT, "--input", &states, "--output", &out, "--outputs", "time", "--steps", "3"]);
    assert_eq!(npz::read(Path::new(&out)).unwrap()["time"].to_f64().as_ref(), [0.012; 5]);
    fails(&["eval", ANT, "--input", &states, "--output", &out, "--outputs", "qaccc"], 2, "qaccc");
}

#[test]
fn inverse_computes_forces() {
    let folder = Folder::new("inverse");
    let write = |name: &str, rows: usize, of: &[(&str, usize)]| {
        let path = folder.path(name);
        let arrays: Vec<_> = of
            .iter()
            .map(|(name, width)| {
                ((*name).to_owned(), Array::new(vec![rows, *width], Data::F64(vec![0.1; rows * width])).unwrap())
            })
            .collect();
        npz::write(Path::new(&path), &arrays).unwrap();
        path
    };
    let out = folder.path("out.npz");
    let states = write("s.npz", 4, &[("qpos", 15), ("qvel", 14), ("qacc", 14), ("tme", 1), ("ctrl", 8)]);
    fails(&["inverse", ANT, "--states", &states, "-o", &out], 1, "array `tme` is not known here; did you mean");
    let states = write("s.npz", 4, &[("qpos", 15), ("qvel", 14), ("qacc", 14), ("ctrl", 8)]);
    succeeds(&["inverse", ANT, "--states", &states, "-o", &out]);
    assert_eq!(npz::read(Path::new(&out)).unwrap()["qfrc_inverse"].shape(), [4, 14]);
    let discrete = ["--option", "invdiscrete=enable", "--option", "integrator=RK4"];
    fails(
        &[&["inverse", ANT, "--states", &states, "-o", &out], &discrete[..]].concat(),
        2,
        "do not go with integrator RK4",
    );
    let states = write("s.npz", 4, &[("qpos", 15), ("qvel", 14)]);
    fails(&["inverse", ANT, "--states", &states, "-o", &out], 1, "has no array `qacc`; give qpos, qvel and qacc");
    let states = folder.path("t.npz");
    let motion = |steps: usize, last: f64| {
        let array = |steps: usize, width: usize, last: f64| {
            let mut values = vec![0.1; 2 * steps * width];
            values[2 * steps * width - 1] = last;
            Array::new(vec![2, steps, width], Data::F64(values)).unwrap()
        };
        let arrays = [("qpos", array(3, 15, 0.1)), ("qvel", array(3, 14, 0.1)), ("qacc", array(steps, 14, last))];
        npz::write(Path::new(&states), &arrays.map(|(name, array)| (name.to_owned(), array))).unwrap();
    };
    motion(4, 0.1);
    fails(
        &["inverse", ANT, "--states", &states, "-o", &out],
        1,
        "array `qpos` has shape [2, 3, 15]; expected [nworld=2, nstep=4, 15]",
    );
    motion(3, f64::NAN);
    fails(&["inverse", ANT, "--states", &states, "-o", &out], 1, "array `qacc` holds NaN at [1, 2, 13]");
}

#[test]
fn fd_computes_derivatives() {
    let folder = Folder::new("fd");
    let out = folder.path("out.npz");
    let write = |name: &str, qpos: f64, others: &[(&str, usize)]| {
        let path = folder.path(name);
        let array = |width: usize, x: f64| Array::new(vec![3, width], Data::F64(vec![x; 3 * width])).unwrap();
        let state = [("qpos", array(15, qpos)), ("qvel", array(14, 0.1))];
        let others = others.iter().map(|(name, width)| (*name, array(*width, 0.1)));
        let arrays: Vec<_> = state.into_iter().chain(others).map(|(name, array)| (name.to_owned(), array)).collect();
        npz::write(Path::new(&path), &arrays).unwrap();
        path
    };
    let states = write("s.npz", 0.5, &[("ctrl", 8), ("time", 1)]);
    succeeds(&["fd", ANT, "--states", &states, "--centred", "-o", &out]);
    let found = npz::read(Path::new(&out)).unwrap();
    assert_eq!((found["A"].shape(), found["B"].shape()), (&[3, 28, 28][..], &[3, 28, 8][..]));
    assert_eq!((found["sides"].to_f64()[0], found["status"].shape(), found.contains_key("C")), (2.0, &[3][..], false));
    succeeds(&["fd", ANT, "--states", &states, "--option", "integrator=Euler", "--method", "exact", "-o", &out]);
    fails(
        &["fd", ANT, "--states", &states, "--method", "exact", "--eps", "1e-6", "-o", &out],
        2,
        "--eps is of differences",
    );
    let times = succeeds(&["fd", ANT, "--states", &states, "--times", "-o", &out]);
    for kind in ["state ", "position ", "velocity ", "actuation "] {
        assert!(times.lines().any(|line| line.starts_with(kind) && line.contains(" us each")), "{times}");
    }
    succeeds(&["fd", ANT, "--states", &states, "--sensors", "--solving", "fixed-work", "-o", &out]);
    assert!(npz::read(Path::new(&out)).unwrap().contains_key("C"));
    let run = |more: &[&str], states: &str, code: i32, message: &str| {
        fails(&[&["fd", ANT, "--states", states, "-o", &out][..], more].concat(), code, message);
    };
    run(&["--eps", "0"], &states, 2, "eps is 0; expected a number from 1e-12 to 1");
    run(&["--eps=-1e-6"], &states, 2, "eps is -0.000001; expected a number from 1e-12 to 1");
    run(&["--method", "complex"], &states, 2, "complex");
    run(&["--precision", "f32", "--eps", "1e-7"], &states, 2, "in single precision");
    run(&[], &write("z.npz", 0.0, &[]), 1, "array `qpos` holds a quaternion of length zero at [0, 3]");
    run(&[], &write("n.npz", f64::NAN, &[]), 1, "array `qpos` holds NaN at [0, 0]");
    run(&[], &write("u.npz", 0.5, &[("crtl", 8)]), 1, "array `crtl` is not known here; did you mean");
    run(&[], &write("w.npz", 0.5, &[("ctrl", 7)]), 1, "array `ctrl` has shape [3, 7]; expected [N=3, 8]");
}

/// What an equality constraint cannot hold is refused before anything runs, with its line.
#[test]
fn bad_equality_constraints_are_named() {
    let folder = Folder::new("equality");
    let file = folder.path("m.xml");
    for (equality, message) in [
        ("<connect body1='q' anchor='0 0 0'/>", "body1 names an unknown body"),
        ("<weld body1='a' body2='a'/>", "is held to itself"),
        ("<joint joint1='x' polycoef='1 2 3 4 5 6'/>", "expected at most 5 numbers, found 6"),
        ("<joint joint1='x' joint2='y'/>\n<joint joint1='y' joint2='x'/>", "joints follow from each other in a circle"),
    ] {
        let xml = format!(
            "<mujoco><worldbody><body name='a'><joint name='x'/><joint name='y'/><geom size='.1'/></body></worldbody>
             <equality>{equality}</equality></mujoco>"
        );
        std::fs::write(&file, xml).unwrap();
        fails(&["check", &file], 1, message);
        fails(&["check", &file], 1, "m.xml:");
    }
}

#[test]
fn bench_prints_its_error_beside_its_speed() {
    let args = ["bench", "models/zoo/cheetah.xml", "--worlds", "40", "--steps", "20", "--json"];
    let record = json(&succeeds(&args));
    for name in [
        "model",
        "nworld",
        "nstep",
        "threads",
        "precision",
        "backend",
        "isa",
        "lanes",
        "seconds",
        "steps_per_second",
        "clock_hertz",
        "cycles",
        "lost",
        "ncon_mean",
        "nefc_mean",
        "solver_niter_mean",
        "solver_niter_max",
        "solver_residual_mean",
        "solver_residual_max",
        "solver_niter_block_max_mean",
        "slot_occupancy",
        "state_hash",
        "step_error_median",
        "step_error_max",
        "stage_seconds",
        "stage_cycles",
    ] {
        assert!(!record[name].is_null(), "{name}");
    }
    assert_eq!(record["lost"], 0);
    assert!(record["step_error_max"].as_f64().unwrap() < 1e-6);
    let again = json(&succeeds(&[&args[..], &["--threads", "1", "--backend", "scalar"]].concat()));
    assert_eq!(again["state_hash"], record["state_hash"]);
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_lanesim"))
        .args(["info", ANT])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let out = child.wait_with_output().unwrap();
    assert!(out.status.success());
    assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
}
