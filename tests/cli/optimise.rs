//! `lanesim optimise`: table, goals, files, and what is refused.

use std::path::Path;

use lanesim::npz;

use super::{Folder, fails, lanesim, succeeds};

#[test]
fn tasks_are_listed() {
    let list = succeeds(&["optimise", "--list"]);
    for name in ["cartpole", "hopper", "humanoid"] {
        assert!(list.contains(name), "{list}");
    }
    assert!(succeeds(&["optimise", "--help"]).contains("gauss-newton"));
}

#[test]
fn a_task_has_a_table_goals_and_files() {
    let folder = Folder::new("optimise");
    let out = folder.path("new/motion");
    let said = succeeds(&["optimise", "cartpole", "--iterations", "3", "--seconds", "1", "--threads", "1", "-o", &out]);
    for words in
        ["regularisation", "iterations used up after 3 iterations", "not reached: angle of the pole", "derivatives"]
    {
        assert!(said.contains(words), "{words}: {said}");
    }
    let arrays = npz::read(&Path::new(&out).join("motion.npz")).unwrap();
    for (name, shape) in [
        ("qpos", &[51, 2][..]),
        ("qvel", &[51, 2]),
        ("act", &[51, 0]),
        ("ctrl", &[50, 1]),
        ("gains", &[50, 1, 4]),
        ("cost", &[4]),
    ] {
        assert_eq!(arrays[name].shape(), shape, "{name}");
    }
    let picture = std::fs::read_to_string(Path::new(&out).join("costs.svg")).unwrap();
    assert!(picture.contains("iteration") && picture.contains("seconds") && picture.contains("polyline"));
    let other =
        succeeds(&["optimise", "cartpole", "--method", "gauss-newton", "--iterations", "2", "--horizon", "0.4"]);
    assert!(other.contains("missing force"), "{other}");
}

#[test]
fn what_cannot_be_optimised_is_named() {
    fails(&["optimise", "cartpol"], 2, "there is no task \"cartpol\"; did you mean \"cartpole\"?");
    fails(&["optimise"], 2, "TASK");
    fails(&["optimise", "cartpole", "--seconds", "0"], 2, "the horizon is 0 s");
    fails(&["optimise", "cartpole", "--seconds", "-1"], 2, "the horizon is -1 s");
    fails(&["optimise", "cartpole", "--seconds", "nan"], 2, "the horizon is NaN s");
    fails(&["optimise", "cartpole", "--iterations", "0"], 2, "0 is not in 1..=1000000");
    fails(&["optimise", "cartpole", "--method", "ddp"], 2, "ddp");
    fails(&["optimise", "humanoid", "--method", "gauss-newton"], 1, "needs motors on hinges and slides");
    fails(
        &["optimise", "cartpole", "--method", "gauss-newton", "--beside-mujoco"],
        2,
        "leave out --method gauss-newton",
    );
    fails(&["optimise", "cartpole", "-o", "Cargo.toml"], 1, "Cargo.toml");
}

/// Where there is no MuJoCo, the rest is done, and a note says so.
#[test]
fn without_mujoco_there_is_a_note() {
    let out = lanesim(&["optimise", "cartpole", "--iterations", "1", "--beside-mujoco", "--python", "no-such-python"]);
    assert!(out.status.success());
    assert!(String::from_utf8_lossy(&out.stderr).contains("without MuJoCo: cannot run no-such-python"));
}
