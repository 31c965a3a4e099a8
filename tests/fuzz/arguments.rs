//! Command lines: words that belong there in orders that do not, and words that belong nowhere.

use std::ffi::OsString;

use super::random::Random;

const WORDS: [&str; 74] = [
    "info",
    "check",
    "rollout",
    "bench",
    "eval",
    "help",
    "rolout",
    "--help",
    "-h",
    "--version",
    "-V",
    "--",
    "-",
    "--json",
    "--lenient",
    "--option",
    "timestep=0.001",
    "timestep",
    "=",
    "a=b=c",
    "--precision",
    "f32",
    "f64",
    "f16",
    "--backend",
    "native",
    "wide",
    "scalar",
    "auto",
    "--instructions",
    "avx2",
    "avx512",
    "--threads",
    "0",
    "1",
    "4096",
    "4097",
    "-1",
    "--on-diverge",
    "freeze",
    "reset",
    "error",
    "--worlds",
    "--steps",
    "--nstep",
    "2147483649",
    "1e3",
    "99999999999999999999",
    "--noise",
    "0.5",
    "1.5",
    "nan",
    "inf",
    "--noise=",
    "--noise=1",
    "--seed",
    "--controls",
    "--states",
    "--input",
    "--keyframe",
    "home",
    "--outputs",
    "qpos,qvel",
    "qpos,,qpos",
    "--fields",
    "-o",
    "--output",
    "out.npz",
    "--native",
    "--disassembly",
    "--input-limit",
    "8G",
    "99999999999T",
    "model.xml",
];

/// A command line, the program's name first.
pub fn arguments(random: &mut Random) -> Vec<OsString> {
    let mut line: Vec<OsString> = vec!["lanesim".into()];
    if !random.one_in(8) {
        line.push(random.pick(&WORDS[..5]).into());
    }
    for _ in 0..random.below(9) {
        line.push(match random.below(24) {
            0 => strange(random),
            1 => format!("{}={}", random.pick(&WORDS), random.pick(&WORDS)).into(),
            _ => random.pick(&WORDS).into(),
        });
    }
    line
}

#[cfg(unix)]
fn strange(random: &mut Random) -> OsString {
    use std::os::unix::ffi::OsStringExt;
    // The end of a string is the one byte that an argument cannot have.
    let byte = |random: &mut Random| 1 + random.below(255) as u8;
    OsString::from_vec((0..random.below(12)).map(|_| byte(random)).collect())
}

#[cfg(not(unix))]
fn strange(random: &mut Random) -> OsString {
    "é".repeat(random.below(12)).into()
}
