//! Options have one spelling over all commands, and what is not known is answered with what was probably meant.

use super::*;

const ARM: &str = "models/zoo/arm.xml";

#[test]
fn unknown_names_are_answered_with_the_nearest() {
    let folder = Folder::new("nearest");
    let (out, empty) = (folder.path("out.npz"), folder.path("empty.npz"));
    npz::write(Path::new(&empty), &[]).unwrap();
    let rollout = ["rollout", ARM, "--worlds", "1", "--steps", "1", "-o", &out];
    let eval = ["eval", ARM, "--input", &empty, "--output", &out];
    let with = |common: &[&str], more: &[&str], words: &str| {
        let words = words.replace('`', "\"");
        fails(&[common, more].concat(), 2, &words);
    };
    with(&rollout, &["--outputs", "qpso"], "there is no output qpso; did you mean `qpos`?");
    with(&["info", ARM], &["--outputs", "xmatt"], "there is no output xmatt; did you mean `xmat`?");
    with(&eval, &["--outputs", "body_mas"], "there is no output or model array body_mas; did you mean `body_mass`?");
    with(&eval, &["--outputs", "nonsense"], "there is no output nonsense; ");
    for command in [&rollout[..], &eval[..], &["check", ARM], &["bench", ARM, "--worlds", "8", "--steps", "1"]] {
        let outputs: &[&str] = if command[0] == "eval" { &["--outputs", "qpos"] } else { &[] };
        let with = |key: &str, words: &str| with(&[command, outputs].concat(), &["--keyframe", key], words);
        with("raech", "--keyframe raech: the model has 1 keyframes, none of that name; did you mean `reach`?");
        with("7", "--keyframe 7: the model has 1 keyframes, counted from 0");
    }
    // These are clap's.
    fails(&["rolout", ARM], 2, "a similar subcommand exists: 'rollout'");
    fails(&["check", ARM, "--step", "3"], 2, "a similar argument exists: '--steps'");
    fails(&["check", ARM, "--backend", "scaler"], 2, "a similar value exists: 'scalar'");
    fails(&["info", ARM, "--disassembly", "smoth"], 2, "there is no part smoth; did you mean \"smooth\"?");
}

/// A list of 60 names is no answer.
#[test]
fn messages_about_names_are_short() {
    for name in ["qpso", "nonsense"] {
        let out = lanesim(&["info", ARM, "--outputs", name]);
        assert!(out.stderr.len() < 200, "{}", String::from_utf8_lossy(&out.stderr));
    }
    assert!(succeeds(&["rollout", "--help"]).contains("subtree_com"));
}

#[test]
fn output_and_outputs_are_told_apart() {
    let folder = Folder::new("told-apart");
    let out = folder.path("out.npz");
    let common = ["rollout", ARM, "--worlds", "1", "--steps", "1"];
    let with = |more: &[&str], words: &str| fails(&[&common, more].concat(), 2, words);
    with(&["--output", "qpos,xpos"], "--output qpos,xpos would be a file; did you mean --outputs qpos,xpos?");
    with(&["-o", &out, "--output", "qpos"], "did you mean --outputs qpos?");
    with(&["-o", &out, "--outputs", "out.npz"], "did you mean --output out.npz?");
    assert!(!Path::new(env!("CARGO_MANIFEST_DIR")).join("qpos,xpos").exists());
}

#[test]
fn outputs_that_come_twice_are_refused_before_the_run() {
    let folder = Folder::new("twice");
    let out = folder.write("out.npz", "old", &[1], vec![1.0]);
    // So many steps would take hours.
    let long = ["rollout", ARM, "--worlds", "100", "--steps", "10000000", "--outputs", "time,qpos,time", "-o", &out];
    fails(&long, 2, "--outputs names time twice");
    fails(&["eval", ARM, "--input", &out, "-o", &out, "--outputs", "qpos,qpos"], 2, "--outputs names qpos twice");
    fails(&["info", ARM, "--outputs", "qpos,,qvel"], 2, "--outputs has an empty name");
    assert!(npz::read(Path::new(&out)).unwrap().contains_key("old"));
}

#[test]
fn keyframes_have_names_and_numbers() {
    let folder = Folder::new("keyframes");
    let (out, empty) = (folder.path("out.npz"), folder.path("empty.npz"));
    npz::write(Path::new(&empty), &[]).unwrap();
    let start = |key: &[&str]| {
        let args = ["eval", ARM, "--states", &empty, "-o", &out, "--outputs", "qpos,ctrl"];
        succeeds(&[&args, key].concat());
        let arrays = npz::read(Path::new(&out)).unwrap();
        [&arrays["qpos"], &arrays["ctrl"]].map(|array| array.to_f64().into_owned())
    };
    let home = start(&["--keyframe", "reach"]);
    assert_eq!(home, start(&["--keyframe", "0"]));
    assert_ne!(home, start(&[]));
    let hash = |key: &str| {
        let args = ["rollout", ARM, "--worlds", "2", "--steps", "2", "-o", &out, "--json", "--keyframe", key];
        json(&succeeds(&args))["state_hash"].clone()
    };
    assert_eq!(hash("reach"), hash("0"));
    let bench = ["bench", ARM, "--worlds", "8", "--steps", "2", "--warm-up", "0", "--json"];
    let with = |more: &[&str]| json(&succeeds(&[&bench, more].concat()))["state_hash"].clone();
    assert_ne!(with(&["--keyframe", "reach"]), with(&[]));
    assert_eq!(with(&["--noise"]), with(&["--noise", "1"]));
}

/// An adapter of an older day: `--fields` for `--outputs`, `--nstep` for `--steps`.
#[test]
fn older_spellings_of_eval_go_on_working() {
    let folder = Folder::new("older");
    let (out, empty) = (folder.path("out.npz"), folder.path("empty.npz"));
    npz::write(Path::new(&empty), &[]).unwrap();
    succeeds(&["eval", ARM, "--input", &empty, "--output", &out, "--fields", "time", "--nstep", "2"]);
    let old = npz::read(Path::new(&out)).unwrap()["time"].clone();
    succeeds(&["eval", ARM, "--input", &empty, "--output", &out, "--outputs", "time", "--steps", "2"]);
    assert_eq!(npz::read(Path::new(&out)).unwrap()["time"], old);
}

/// A gain that blows up under control, and stands still without.
#[test]
fn check_finds_what_only_holds_still() {
    let folder = Folder::new("holds-still");
    let model = folder.path("still.xml");
    let text = "<mujoco><worldbody><body><joint name='j' type='slide'/><geom size='.1'/></body></worldbody>\
                <actuator><motor joint='j' gear='1e13'/></actuator></mujoco>";
    std::fs::write(&model, text).unwrap();
    let report = json(&succeeds(&["check", &model, "--steps", "20", "--json"]));
    assert_eq!((&report["runs"][0]["controls"], &report["runs"][0]["flags"]), (&"held".into(), &serde_json::json!([])));
    assert_eq!(report["runs"][1]["controls"], "noise");
    assert!(report["flags"].as_array().unwrap().contains(&"HugeValue".into()), "{report}");
    assert_eq!(report["events"][0]["controls"], "noise");
    // The middle of the range of a control is zero.
    let middle = json(&succeeds(&["check", &model, "--steps", "20", "--json", "--noise", "0"]));
    assert_eq!(middle["flags"], serde_json::json!([]));
    fails(&["check", &model, "--steps", "20", "--on-diverge", "error"], 1, "world 0 diverged: HugeValue");
    fails(&["check", "--noise", &model], 2, "if this is the model, put it first");
    assert!(succeeds(&["check", &model, "--steps", "20"]).contains("under control noise (share 1, seed 0)"));
}

#[test]
fn every_help_has_examples() {
    for command in ["info", "check", "rollout", "bench", "eval"] {
        for help in ["-h", "--help"] {
            let text = succeeds(&[command, help]);
            assert!(text.contains("Examples:") && text.contains(&format!("lanesim {command} ")), "{text}");
        }
    }
}
