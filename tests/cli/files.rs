//! Files in and out: those that are hostile, and those that must survive.

use super::*;

/// A command that may take 10 s and 1 GB of address space: no hostile file may cost more.
#[cfg(unix)]
fn bounded(args: &[std::ffi::OsString], kilobytes: u64) -> Output {
    let script = format!("ulimit -v {kilobytes}; exec timeout 10 \"$0\" \"$@\"");
    Command::new("sh")
        .arg("-c")
        .arg(script)
        .arg(env!("CARGO_BIN_EXE_lanesim"))
        .args(args)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap()
}

#[cfg(unix)]
#[test]
fn every_input_must_be_a_regular_file() {
    let folder = Folder::new("regular");
    let pipe = folder.path("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let out = folder.path("out.npz");
    let rollout = ["rollout", ANT, "--worlds", "1", "--steps", "1", "-o", &out];
    for bad in [&*pipe, "/dev/zero", "/dev/stdin", "models"] {
        let commands: [Vec<&str>; 4] = [
            vec!["check", bad],
            vec!["eval", ANT, "--input", bad, "--output", &out, "--outputs", "qpos"],
            [&rollout[..], &["--states", bad]].concat(),
            [&rollout[..], &["--controls", bad]].concat(),
        ];
        for command in commands {
            let args: Vec<_> = command.iter().map(|arg| (*arg).into()).collect();
            let result = bounded(&args, 2_000_000);
            let message = String::from_utf8_lossy(&result.stderr);
            assert_eq!(result.status.code(), Some(1), "{command:?}: {message}");
            assert!(message.contains(bad) && message.contains("not a regular file"), "{message}");
        }
    }
    // A pipe would be opened for ever, and a folder is no file.
    for bad in [&*pipe, "models"] {
        fails(&["rollout", ANT, "--worlds", "1", "--steps", "1", "-o", bad], 1, "not a regular file");
    }
}

#[cfg(unix)]
#[test]
fn names_need_not_be_utf_8() {
    use std::ffi::{OsStr, OsString};
    use std::os::unix::ffi::OsStrExt;
    let folder = Folder::new("utf8");
    let strange = |name: &[u8]| {
        let mut path = folder.0.clone().into_os_string();
        path.push("/");
        path.push(OsStr::from_bytes(name));
        path
    };
    let (model, states, out) = (strange(b"m\xff.xml"), strange(b"s\xfe.npz"), strange(b"out\xff.npz"));
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join(ANT), &model).unwrap();
    std::fs::copy(folder.write("s.npz", "qvel", &[1, 14], vec![0.1; 14]), &states).unwrap();
    let run =
        |args: &[&dyn AsRef<OsStr>]| bounded(&args.iter().map(|a| a.as_ref().into()).collect::<Vec<_>>(), 4_000_000);
    let args: [&dyn AsRef<OsStr>; 11] =
        [&"rollout", &model, &"--worlds", &"1", &"--steps", &"1", &"--states", &states, &"-o", &out, &"--json"];
    for args in [&args[..], &args[..10]] {
        let result = run(args);
        assert!(result.status.success(), "{}", String::from_utf8_lossy(&result.stderr));
        assert!(String::from_utf8_lossy(&result.stdout).contains("out\u{fffd}.npz"));
        assert!(npz::read(Path::new(&out)).unwrap().contains_key("qpos"));
    }
    // Anywhere else they are a mistake, and nothing more.
    let bad = OsString::from(OsStr::from_bytes(b"q\xff"));
    for option in ["--outputs", "--option", "--keyframe", "--precision", "--worlds", "--no-such"] {
        let result = run(&[&"rollout", &model, &"--worlds", &"1", &"--steps", &"1", &"-o", &out, &option, &bad]);
        assert_eq!(result.status.code(), Some(2), "{option}: {}", String::from_utf8_lossy(&result.stderr));
    }
    for args in [&[&bad as &dyn AsRef<OsStr>][..], &[&"check" as &dyn AsRef<OsStr>, &bad]] {
        let code = run(args).status.code();
        assert!(matches!(code, Some(1 | 2)), "{code:?}");
    }
}

/// Whatever ends a run, a file that was there before is still whole.
#[cfg(unix)]
#[test]
fn an_output_that_was_there_survives() {
    let folder = Folder::new("survives");
    let out = folder.write("out.npz", "old", &[1], vec![1.0]);
    let old = std::fs::read(&out).unwrap();
    let run = |before: &str, steps: &str| {
        let script = format!("{before}; exec \"$0\" \"$@\"");
        let args = ["rollout", ANT, "--worlds", "8", "--steps", steps, "-o", &out];
        Command::new("sh")
            .args(["-c", &script, env!("CARGO_BIN_EXE_lanesim")])
            .args(args)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    };
    // The system ends the process while it writes, or refuses to write more.
    assert!(!run("ulimit -f 8", "100").wait().unwrap().success());
    assert_eq!(std::fs::read(&out).unwrap(), old);
    assert!(!run("trap '' XFSZ; ulimit -f 8", "100").wait().unwrap().success());
    assert_eq!(std::fs::read(&out).unwrap(), old);
    // Somebody else ends it while it runs.
    for signal in ["INT", "TERM", "KILL"] {
        let mut child = run(":", "1000000");
        std::thread::sleep(std::time::Duration::from_millis(300));
        let kill = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap();
        assert!(kill.success() && !child.wait().unwrap().success());
        assert_eq!(std::fs::read(&out).unwrap(), old);
    }
    assert!(run(":", "100").wait().unwrap().success());
    assert!(npz::read(Path::new(&out)).unwrap().contains_key("qpos"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error() {
    let args = ["rollout", ANT, "--worlds", "1", "--steps", "1", "-o"];
    fails(&[&args[..], &["/dev/full"]].concat(), 1, "/dev/full: No space left on device");
    succeeds(&[&args[..], &["/dev/null"]].concat());
    fails(
        &[&args[..], &["no/such/folder/out.npz"]].concat(),
        1,
        "no/such/folder/out.npz: cannot write to no/such/folder",
    );
}

#[test]
fn what_arrays_may_take_has_a_limit_that_can_be_raised() {
    let folder = Folder::new("limit");
    let (out, states) = (folder.path("out.npz"), folder.write("s.npz", "qvel", &[5, 14], vec![0.0; 70]));
    let eval = ["eval", ANT, "--input", &states, "--output", &out, "--outputs", "qpos", "--input-limit"];
    let message = "array `qvel`: would bring the arrays of this file";
    fails(&[&eval[..], &["100"]].concat(), 1, message);
    succeeds(&[&eval[..], &["560"]].concat());
    fails(&[&eval[..], &["1X"]].concat(), 2, "such as 500M or 8G");
}

/// Sizes whose product overflows are a shape all the same where one of them is 0.
#[test]
fn states_that_cannot_be_counted_are_an_error() {
    let folder = Folder::new("uncounted");
    let states = folder.write("s.npz", "act", &[1 << 40, 1 << 40, 0], vec![]);
    let args = ["eval", ANT, "--input", &states, "-o", &folder.path("out.npz"), "--outputs", "qpos"];
    fails(&args, 1, "array `act` has more states than can be counted");
}

/// Included files are read too, and an output replaces none of them.
#[test]
fn an_output_never_replaces_an_included_file() {
    let folder = Folder::new("included");
    let main = folder.path("main.xml");
    std::fs::write(&main, "<mujoco><include file='inc1.xml'/></mujoco>").unwrap();
    let (first, second) = (folder.path("inc1.xml"), folder.path("inc2.xml"));
    std::fs::write(&first, "<mujoco><worldbody><include file='inc2.xml'/></worldbody></mujoco>").unwrap();
    std::fs::write(&second, "<mujoco><body><joint/><geom size='.1'/></body></mujoco>").unwrap();
    let empty = folder.path("empty.npz");
    npz::write(Path::new(&empty), &[]).unwrap();
    for out in [&first, &second] {
        let old = std::fs::read(out).unwrap();
        let words = format!("--output {out} would replace the input {out}; give another name");
        fails(&["eval", &main, "--input", &empty, "-o", out, "--outputs", "qpos"], 2, &words);
        fails(&["rollout", &main, "--worlds", "1", "--steps", "1", "-o", out], 2, &words);
        assert_eq!(std::fs::read(out).unwrap(), old);
    }
}

/// An array too many among the controls is named with a remedy, and before the numbers of others are looked at.
#[test]
fn spare_arrays_among_controls_are_named_first() {
    let folder = Folder::new("spare");
    let controls = folder.path("u.npz");
    let array = |values: Vec<f64>| Array::new(vec![1, 1, 8], Data::F64(values)).unwrap();
    let arrays = [("ctrl".to_owned(), array(vec![f64::NAN; 8])), ("zzz".to_owned(), array(vec![0.0; 8]))];
    npz::write(Path::new(&controls), &arrays).unwrap();
    let out = folder.path("out.npz");
    let args = ["rollout", ANT, "--worlds", "1", "--steps", "1", "--controls", &controls, "-o", &out];
    fails(&args, 1, "array `zzz` is not known here; valid: ctrl");
}

/// `--max-memory` holds for states that are filled up from a keyframe, too.
#[test]
fn states_from_a_keyframe_are_held_against_the_limit() {
    let folder = Folder::new("keyframe-memory");
    let states = folder.write("s.npz", "time", &[100_000], vec![0.0; 100_000]);
    let (arm, out) = ("models/zoo/arm.xml", folder.path("out.npz"));
    let args =
        ["eval", arm, "--input", &states, "--keyframe", "0", "-o", &out, "--outputs", "time", "--max-memory", "1M"];
    fails(&args, 1, "the states would take");
    fails(&args, 1, "allowed (--max-memory)");
    let args = ["rollout", ANT, "--worlds", "1", "--steps", "1", "--max-memory", "1k", "-o", &out];
    fails(&args, 1, "--max-memory");
}

/// `eval` under a limit on memory says so; it used to abort. At every limit it does its work or says why not.
#[cfg(target_os = "linux")]
#[test]
fn eval_without_memory_is_an_error() {
    let folder = Folder::new("eval-memory");
    let out = folder.path("out.npz");
    let states = folder.write("s.npz", "qvel", &[5000, 30], vec![0.1; 150_000]);
    let mut refused = [0, 0];
    for (i, outputs) in ["xmat,cdof,qM", "efc_J,contact_frame"].into_iter().enumerate() {
        for megabytes in [50, 60, 70, 80, 90, 100, 110, 120, 150, 200, 250, 600] {
            let model = "models/zoo/box_stack.xml";
            let args = ["eval", model, "--input", &states, "--output", &out, "--outputs", outputs, "--threads", "1"];
            let args: Vec<_> = args.iter().map(|arg| (*arg).into()).collect();
            let result = bounded(&args, megabytes * 1000);
            let message = String::from_utf8_lossy(&result.stderr);
            match result.status.code() {
                Some(0) => {}
                Some(1) if message.contains("which the system does not give") => refused[i] += 1,
                code => panic!("{outputs}, {megabytes} MB: {code:?} {message}"),
            }
        }
    }
    assert!(refused.iter().all(|n| (1..12).contains(n)), "{refused:?}");
}
