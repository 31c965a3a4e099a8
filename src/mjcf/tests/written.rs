//! Text as people write it, which MuJoCo 4.0.0 loads.

use std::collections::BTreeMap;

use super::{close, ok, rejects, world};
use crate::mjcf::{LoadOptions, load, parse, parse_with_files};
use crate::spec::{Source, Tri};

const MODEL: &str = "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>";

/// A folder of files that is removed at the end.
struct Folder(std::path::PathBuf);

impl Folder {
    fn new(name: &str, files: &[(&str, &[u8])]) -> Folder {
        let folder = std::env::temp_dir().join(format!("lanesim-{name}-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("parts")).expect("a temporary folder");
        for (name, bytes) in files {
            std::fs::write(folder.join(name), bytes).expect("written");
        }
        Folder(folder)
    }

    #[track_caller]
    fn load(&self, name: &str) -> crate::spec::Spec {
        load(&self.0.join(name), &LoadOptions::default()).unwrap_or_else(|problems| panic!("{name}: {problems}"))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn blanks_before_the_declaration() {
    for start in ["\n", "  \t", "\u{feff}\n", "\u{feff}", "\u{feff}\u{feff}", ""] {
        assert_eq!(ok(&format!("{start}<?xml version=\"1.0\" encoding=\"utf-8\"?>\n{MODEL}")).bodies.len(), 1);
    }
    let text = "\n<?xml version='1.0'\n?>\n<mujoco>\n<worldbody><geom/><geom sise='1'/></worldbody></mujoco>";
    rejects(text, "5: geom: unknown attribute \"sise\" (did you mean \"size\"?)");
    ok(&format!("<?xml version='1.0'?><?editor x?>{MODEL}"));
    ok(&format!("<!DOCTYPE mujoco SYSTEM 'mjcf.dtd'>\n{MODEL}\0\0"));
}

#[test]
fn prefixes_on_the_root() {
    for attribute in [
        "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" xsi:noNamespaceSchemaLocation=\"mjcf.xsd\"",
        "xmlns:xacro='http://ros.org/wiki/xacro'",
        "xmlns=\"http://mujoco.org\"",
        "xsi:schemaLocation\n=\n'a b'",
        "xml:base='a'",
    ] {
        let text = format!("<mujoco {attribute} model=\"m\"><worldbody><geom size='1'/></worldbody></mujoco>");
        assert_eq!(ok(&text).name, "m", "{attribute}");
    }
    rejects(
        &world("\n<body xsi:type='b'/>"),
        "2: attribute \"xsi:type\": MJCF has no prefixes (remove it; the root element may have such attributes, which mean \
         nothing)",
    );
    rejects(
        &world("<xacro:property name='a'/>"),
        "1: element \"xacro:property\": MJCF has no prefixes (expand macros first, or remove it)",
    );
    let given = BTreeMap::from([("a.xml".to_string(), "<x xmlns:xsi='u' xsi:a='b'><geom size='2'/></x>".into())]);
    parse_with_files(&world("<include file='a.xml'/>"), &given, &LoadOptions::default()).expect("good");
}

#[test]
fn characters_in_values() {
    let name = |value: &str| ok(&format!("<mujoco model=\"{value}\"/>")).name;
    assert_eq!(name("a<b"), "a<b");
    assert_eq!(name("a&b & c;"), "a&b & c;");
    assert_eq!(name("&foo;"), "&foo;");
    assert_eq!(name("&amp;&lt;&#65;&#x41;"), "&<AA");
}

#[test]
fn encodings_with_one_byte_per_character() {
    let text = |declared: &str| {
        let mut bytes = format!("<?xml version=\"1.0\" {declared}?><!-- caf").into_bytes();
        bytes.push(0xe9);
        bytes.extend_from_slice(b" -->\n<mujoco model='\xe9'><worldbody><geom size='1'/></worldbody></mujoco>");
        bytes
    };
    let files =
        ["encoding=\"ISO-8859-1\"", "encoding='windows-1252'", "encoding='us-ascii'", "", "encoding='utf-8'"].map(text);
    for bytes in &files {
        let folder = Folder::new("latin", &[("main.xml", bytes)]);
        let spec = folder.load("main.xml");
        assert_eq!((spec.name.as_str(), spec.bodies[0].geoms.len()), ("é", 1));
        assert!(spec.notes[0].ends_with("main.xml: is not UTF-8 and was read as ISO-8859-1: names may look otherwise"));
    }
}

#[test]
fn backslashes_in_paths() {
    let part: &[u8] = b"<mujoco><geom size='7'/></mujoco>";
    let nested: &[u8] = b"<mujoco><include file='.\\geom.xml'/></mujoco>";
    let main: &[u8] = b"<mujoco><worldbody><include file=\"parts\\arm.xml\"/></worldbody></mujoco>";
    let folder = Folder::new("backslash", &[("main.xml", main), ("parts/arm.xml", nested), ("parts/geom.xml", part)]);
    assert_eq!(folder.load("main.xml").bodies[0].geoms[0].size[0], 7.0);
    let text = std::str::from_utf8(main).expect("text");
    for name in ["parts/arm.xml", "parts\\arm.xml", "arm.xml"] {
        let given = BTreeMap::from([(name.to_string(), "<mujoco><geom size='7'/></mujoco>".into())]);
        parse_with_files(text, &given, &LoadOptions::default()).unwrap_or_else(|problems| panic!("{name}: {problems}"));
    }
}

/// Poses of the copies, of MuJoCo 4.0.0.
#[test]
fn replicate_multiplies_euler_angles() {
    let copy = |compiler: &str, euler: &str, k: usize| {
        let text = format!(
            "<mujoco><compiler {compiler}/><worldbody><replicate count='4' offset='1 0.2 0.3' euler='{euler}'>\
             <body name='link'><geom size='0.1'/></body></replicate></worldbody></mujoco>"
        );
        let body = ok(&text).bodies[k + 1].clone();
        [&body.pos[..], &body.quat[..]].concat()
    };
    close(&copy("", "10 20 30", 2), &[1.822434, 0.85952, 0.43651, 0.771739, 0.309727, 0.21011, 0.514143]);
    close(&copy("", "10 20 30", 3), &[2.26561, 1.760531, 0.785472, 0.5, 0.5, 0.183013, 0.683013]);
    let fixed = [2.85567, 1.093452, 0.74187, 0.5, 0.683013, 0.183013, 0.5];
    close(&copy("eulerseq='ZYX'", "10 20 30", 3), &fixed);
    let mixed = [2.611442, 1.436318, -0.058661, 0.683013, 0.183013, 0.5, 0.5];
    close(&copy("eulerseq='zXy'", "10 20 30", 3), &mixed);
    let radians = [1.937968, 0.672579, 0.463964, 0.925754, 0.151891, 0.159933, 0.307131];
    close(&copy("angle='radian'", ".1 .2 .3", 2), &radians);
}

#[test]
fn replicate_says_what_it_does_not_read() {
    let spec = ok(&world("<replicate count='2' quat='0 1 0 0' pos='1 0 0'><body><geom size='.1'/></body></replicate>"));
    assert_eq!(spec.bodies[2].quat, [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(
        spec.notes,
        [
            "line 1: replicate: attribute \"pos\" has no effect: give offset or euler",
            "line 1: replicate: attribute \"quat\" has no effect: give offset or euler",
        ]
    );
}

#[test]
fn align_of_a_free_joint_is_read() {
    let align = |value: &str| ok(&world(&format!("<body><freejoint {value}/></body>"))).bodies[1].joints[0].align;
    assert_eq!(align(""), Tri::Auto);
    assert_eq!(align("align='true'"), Tri::True);
    assert_eq!(align("align='false'"), Tri::False);
    rejects(
        &world("<body><freejoint align='ture'/></body>"),
        "1: freejoint: attribute \"align\": \"ture\" is not one of true, false, auto; did you mean \"true\"?",
    );
}

#[test]
fn infinite_ends_of_ranges_are_read() {
    let joint = |range: &str| ok(&world(&format!("<body><joint type='slide' range='{range}'/></body>")));
    let range = |text: &str| joint(text).bodies[1].joints[0].range;
    assert_eq!(range("-inf 0.5"), Some([f64::NEG_INFINITY, 0.5]));
    assert_eq!(range("0 Infinity"), Some([0.0, f64::INFINITY]));
    rejects(
        &world("<body><joint range='nan 1'/></body>"),
        "1: joint: attribute \"range\": \"nan\" is not a finite number",
    );
    assert_eq!(joint("-inf inf").bodies[1].joints[0].source, Source { file: None, line: 1 });
}

/// A solver that cannot reach its tolerance made a billion sweeps in every step.
#[test]
fn iterations_without_end_are_noted() {
    let load = |attribute: &str| parse(&format!("<mujoco>\n<option {attribute}/></mujoco>"), &Default::default());
    let spec = load("noslip_iterations='1000000000' iterations='10000'").expect("a model");
    let note =
        "line 2: option: noslip_iterations 1000000000 count as 10000: what has not converged by then lost its digits";
    assert_eq!(spec.notes, [note]);
    let model = crate::Model::from_spec(&spec).expect("a model");
    assert_eq!((model.tables().options.noslip_iterations, spec.option.noslip_iterations), (10_000, 1_000_000_000));
}
