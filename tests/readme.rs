//! Every shell command in the README runs as it is written there, block after block, in a folder that looks like a clone.
//! What needs another tool (a build, a virtual environment, all tests) is not run here; `python/tests/test_readme.py` runs
//! the Python.

#![cfg(unix)]

use std::path::Path;
use std::process::Command;

use lanesim::npz::{self, Array, Data};

/// Beginnings of lines that are not run. `accuracy` takes its minute; tests of the command line run parts of it.
const ELSEWHERE: [&str; 6] =
    ["cargo build", "tests/run", "python3 -m venv", "venv/bin/pip install", "venv/bin/python", "lanesim accuracy"];

/// The lines of the blocks in this language.
fn lines(readme: &str, language: &str) -> Vec<String> {
    let mut inside = false;
    let mut out = Vec::new();
    for line in readme.lines() {
        if let Some(fence) = line.strip_prefix("```") {
            inside = !inside && fence == language;
        } else if inside && !line.trim().is_empty() {
            out.push(line.to_owned());
        }
    }
    out
}

#[test]
fn every_shell_command_of_the_readme_runs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let folder = std::env::temp_dir().join(format!("lanesim-readme-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("target/release")).unwrap();
    let program = env!("CARGO_BIN_EXE_lanesim");
    std::os::unix::fs::symlink(program, folder.join("target/release/lanesim")).unwrap();
    std::os::unix::fs::symlink(root.join("models"), folder.join("models")).unwrap();
    // The README makes these with NumPy.
    let controls = Array::new(vec![256, 500, 8], Data::F64(vec![0.5; 256 * 500 * 8])).unwrap();
    npz::write(&folder.join("controls.npz"), &[("ctrl".to_owned(), controls)]).unwrap();

    let lines = lines(&readme, "sh");
    assert!(lines.len() > 10, "the README has no shell blocks: {lines:?}");
    let mut script = "set -e\n".to_owned();
    for line in lines.iter().filter(|line| !ELSEWHERE.iter().any(|start| line.starts_with(start))) {
        // The same program, which need not be built again.
        script += &line.replace("cargo run --release --", "target/release/lanesim");
        script += "\n";
    }
    for command in ["check", "info", "rollout", "eval", "inverse", "bench", "stress", "fd", "optimise"] {
        assert!(script.contains(&format!("lanesim {command} ")), "the README does not show {command}");
    }
    let out = Command::new("sh").arg("-c").arg(&script).current_dir(&folder).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{script}\n{said}");
    let fields = npz::read(&folder.join("fields.npz")).unwrap();
    assert_eq!(fields["qM"].shape(), [256 * 20, 14, 14]);
    assert_eq!(npz::read(&folder.join("ant.npz")).unwrap()["qpos"].shape(), [256, 500, 15]);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Options that the README shows are those of the program.
#[test]
fn the_readme_has_one_spelling_per_option() {
    let readme = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    for old in ["--fields", "--nstep"] {
        assert!(!readme.contains(old), "{old}");
    }
}
