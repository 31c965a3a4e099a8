//! What is read: XML, names, numbers, limits, files.

use std::collections::BTreeMap;

use super::{LoadOptions, ok, parse, rejects, world};
use crate::mjcf::{Document, load, parse_with_files};
use crate::spec::GeomMass;

#[test]
fn what_is_not_xml() {
    rejects("", "the file is empty (an MJCF file starts with <mujoco>)");
    rejects("  \n", "the file is empty (an MJCF file starts with <mujoco>)");
    rejects(
        "garbage",
        "1: not well-formed XML: unknown token at 1:1 (every tag must be closed, every value be in quotes)",
    );
    rejects(
        "<mujoco>\n<worldbody",
        "1: not well-formed XML: the root node was opened but never closed (every tag must be closed, every value be in \
         quotes)",
    );
    // No tag and no quote is at fault.
    rejects(
        "<mujoco model='a\u{0}b'/>",
        "1: not well-formed XML: a non-XML character '\\0' found at 1:17 (remove the character)",
    );
    rejects(
        "<!DOCTYPE a [<!ENTITY b \"c\">]><mujoco/>",
        "1: not well-formed XML: XML with DTD detected (remove the document type declaration)",
    );
    rejects("<html/>", "1: html: the root element must be <mujoco>, not <html> (an MJCF file starts with <mujoco>)");
}

#[test]
fn tolerated_xml() {
    ok("<mujoco><!-- two -- dashes --->\n<worldbody/></mujoco>");
    assert_eq!(ok("<mujoco model=\"m\"version=\"1\"/>").name, "m");
    assert_eq!(ok("\u{feff}<mujoco/>").bodies.len(), 1);
    assert_eq!(ok(&world("text <geom size='.1'/>")).bodies[0].geoms.len(), 1);
}

#[test]
fn names_of_elements_and_attributes() {
    rejects(&world("<geom size='1' colour='1'/><body>\n</body>"), &{
        let valid = "adhesion, castshadow, conaffinity, condim, contype, density, fitscale, fluidcoef, fluidshape, \
            friction, fromto, gap, group, hfield, margin, mass, material, mesh, pos, priority, rgba, shellinertia, \
            size, solimp, solmix, solref, surfacevel, type, user, quat, axisangle, euler, xyaxes, zaxis, name, class";
        format!("1: geom: unknown attribute \"colour\" (valid: {valid})")
    });
    rejects(
        "<mujoco>\n<worldbody>\n<geom name='floor' frction='1'/></worldbody></mujoco>",
        "3: geom \"floor\": unknown attribute \"frction\" (did you mean \"friction\"?)",
    );
    rejects(&world("<boddy/>"), "1: boddy: unknown element in worldbody (did you mean \"body\"?)");
    rejects("<mujoco><worldboyd/></mujoco>", "1: worldboyd: unknown element in mujoco (did you mean \"worldbody\"?)");
    rejects("<mujoco><worldbody pos='0 0 0'/></mujoco>", "1: worldbody: worldbody has no attributes (remove them)");
    rejects(
        "<mujoco><option><flag/><flag/></option></mujoco>",
        "1: flag: a second flag in the same option (merge the two)",
    );
    assert_eq!(ok("<mujoco><world><geom size='1'/></world></mujoco>").notes, ["world is an old name of worldbody"]);
}

#[test]
fn problems_are_collected_and_capped() {
    let text = world(&"<geom foo='1' size='x'/>".repeat(40));
    let problems = parse(&text, &LoadOptions::default()).expect_err("bad").0;
    assert_eq!(problems.len(), 51);
    assert_eq!(problems[50].message, "30 more problems are not listed");
}

#[test]
fn forms_of_numbers() {
    let bad = |value: &str| {
        rejects(&world(&format!("<geom size='1' mass='{value}'/>")), &{
            let reason = match value {
                "1 2" => "expected 1 number, found 2".to_string(),
                "nan" | "inf" => format!("\"{value}\" is not a finite number"),
                "1e400" => "\"1e400\" is too large".to_string(),
                "1,2" => "\"1,2\" is not a number; separate numbers by blanks".to_string(),
                _ => format!("\"{value}\" is not a number"),
            };
            format!("1: geom: attribute \"mass\": {reason}")
        })
    };
    ["1 2", "nan", "inf", "1e400", "0x10", "1,2", "1f", "1d3", "1_0", "--1"].into_iter().for_each(bad);
    for value in ["1", "+1", "1.", "1e0", " 1 ", "\t1\n"] {
        let spec = ok(&world(&format!("<geom size='1' mass='{value}'/>")));
        assert_eq!(spec.bodies[0].geoms[0].mass, GeomMass::Mass(1.0));
    }
    // Blank is as if it were absent.
    assert_eq!(ok(&world("<geom size='1' mass=''/>")).bodies[0].geoms[0].mass, GeomMass::Density(1000.0));
    rejects(&world("<geom contype='1.5'/>"), "1: geom: attribute \"contype\": \"1.5\" is not an integer");
    rejects(&world("<geom contype='4294967295'/>"), "1: geom: attribute \"contype\": \"4294967295\" is too large");
    assert_eq!(ok(&world("<geom contype='-1'/>")).bodies[0].geoms[0].contype, u32::MAX);
    rejects(&world("<geom pos='1 2'/>"), "1: geom: attribute \"pos\": expected 3 numbers, found 2");
    rejects(
        &world("<geom friction='1 2 3 4'/>"),
        "1: geom: attribute \"friction\": expected at most 3 numbers, found 4",
    );
    rejects(
        &world("<geom shellinertia='True'/>"),
        "1: geom: attribute \"shellinertia\": \"True\" is not one of true, false; did you mean \"true\"?",
    );
    rejects(
        &world("<geom type='cube'/>"),
        "1: geom: attribute \"type\": \"cube\" is not one of plane, hfield, sphere, capsule, ellipsoid, cylinder, box, mesh, sdf",
    );
}

#[test]
fn hostile_sizes() {
    let many: String = (0..200).map(|i| format!(" a{i}='0'")).collect();
    rejects(
        &format!("<mujoco>\n<option{many}/></mujoco>"),
        "2: an element has 200 attributes, more than 128 (remove attributes)",
    );
    let deep = format!("{}{}", "<body>".repeat(10_000), "</body>".repeat(10_000));
    assert_eq!(ok(&world(&deep)).bodies.len(), 10_001);
    let too_deep = format!("{}{}", "<body>".repeat(60_000), "</body>".repeat(60_000));
    rejects(&world(&too_deep), "1: elements are nested more than 50000 deep (nest less)");
    assert_eq!(ok(&world(&"<body><geom size='1'/></body>".repeat(20_000))).bodies.len(), 20_001);
    let huge = "<replicate count='2000000000' offset='1 0 0'><geom size='1'/></replicate>";
    rejects(&world(huge), "1: replicate: the model has more than 1000000 elements (replicate less)");
    let nested = format!("{}<geom/>{}", "<replicate count='100'>".repeat(9), "</replicate>".repeat(9));
    rejects(&world(&nested), "1: replicate: the model has more than 1000000 elements (replicate less)");
    let empty = format!("{}{}", "<replicate count='1000000'>".repeat(9), "</replicate>".repeat(9));
    rejects(&world(&empty), "1: replicate: the model has more than 1000000 elements (replicate less)");
}

#[test]
fn includes_from_memory() {
    let files = |list: &[(&str, &str)]| -> BTreeMap<String, Vec<u8>> {
        list.iter().map(|&(name, text)| (name.to_string(), text.as_bytes().to_vec())).collect()
    };
    let given = files(&[
        ("a.xml", "<x>\n<geom size='.2'/><include file='b.xml'/></x>"),
        ("b.xml", "<mujocoinclude><geom size='.3' mas='1'/></mujocoinclude>"),
    ]);
    let read = |text: &str, files: &BTreeMap<String, Vec<u8>>| parse_with_files(text, files, &LoadOptions::default());
    let text = world("<geom size='.1'/><include file='a.xml'/><geom size='.4'/>");
    let problem = read(&text, &given).expect_err("bad").to_string();
    assert_eq!(problem, "b.xml:1: geom: unknown attribute \"mas\" (did you mean \"mass\"?)");
    let given = files(&[("a.xml", "<x>\n<geom size='.2'/></x>")]);
    let spec = read(&text, &given).expect("good");
    let sizes: Vec<f64> = spec.bodies[0].geoms.iter().map(|geom| geom.size[0]).collect();
    assert_eq!(sizes, [0.1, 0.2, 0.4]);
    let source = &spec.bodies[0].geoms[1].source;
    assert_eq!((source.file.as_deref(), source.line), (Some("a.xml"), 2));
    let twice = world("<include file='a.xml'/>\n<include file='a.xml'/>");
    let problem = read(&twice, &given).expect_err("bad").to_string();
    assert_eq!(problem, "2: include: file \"a.xml\" was already included (include each file once)");
    rejects(
        &text,
        "1: include: file \"a.xml\": no such file among those given (paths are relative to the main file, or to the file that includes)",
    );
    rejects(&world("<include/>"), "1: include: attribute \"file\" is missing");
}

#[test]
fn includes_from_disk() {
    let folder = std::env::temp_dir().join(format!("lanesim-mjcf-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("parts")).expect("a temporary folder");
    let write = |name: &str, text: &[u8]| std::fs::write(folder.join(name), text).expect("written");
    write("main.xml", b"<mujoco><include file='parts/a.xml'/></mujoco>");
    // The second file is found beside the one that includes it.
    write("parts/a.xml", b"<x><worldbody><include file='b.xml'/></worldbody></x>");
    write("parts/b.xml", b"<x><geom size='7'/></x>");
    write("self.xml", b"<mujoco><include file='./self.xml'/></mujoco>");
    write("utf16.xml", b"\xff\xfe<\0m\0");
    let read = |name: &str| load(&folder.join(name), &LoadOptions::default());
    assert_eq!(read("main.xml").expect("good").bodies[0].geoms[0].size[0], 7.0);
    let problem = |name: &str| read(name).expect_err("bad").0[0].message.clone();
    assert_eq!(problem("self.xml"), "file \"./self.xml\" was already included");
    assert_eq!(problem("utf16.xml"), "the file is UTF-16, but must be UTF-8: save it as that");
    assert!(problem("none.xml").starts_with("the file cannot be read: "));
    assert_eq!(problem("parts"), "the file cannot be read: not a regular file");
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// A main file that is named without a folder has one all the same: a missing include is answered with its neighbour.
/// As MuJoCo finds them: in the folder of meshes, or else beside the included file that names them, without that folder.
#[test]
fn files_of_included_elements_may_be_beside_them() {
    let folder = std::env::temp_dir().join(format!("lanesim-beside-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("parts")).expect("a temporary folder");
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("written");
    let mesh = |x: f64| format!("v 0 0 0\nv {x} 0 0\nv 0 1 0\nv 0 0 1\n");
    let geom = "<worldbody><geom type='mesh' mesh='a'/></worldbody>";
    write("main.xml", &format!("<mujoco><include file='parts/i.xml'/>{geom}</mujoco>"));
    write("parts/i.xml", "<mujocoinclude><asset><mesh name='a' file='a.obj'/></asset></mujocoinclude>");
    write("parts/a.obj", &mesh(2.0));
    let main = folder.join("main.xml");
    let width = |path: &std::path::Path| {
        let (document, spec) = Document::load(path, &LoadOptions::default()).expect("good");
        let again = document.spec(&LoadOptions::default()).expect("recorded");
        assert_eq!(spec.meshes[0].triangles.vertices, again.meshes[0].triangles.vertices);
        spec.meshes[0].triangles.vertices.iter().map(|v| v.x).fold(0.0, f64::max)
    };
    assert_eq!(width(&main), 2.0);
    write("a.obj", &mesh(3.0));
    assert_eq!(width(&main), 3.0);
    std::fs::remove_dir_all(&folder).expect("removed");
}

#[test]
fn neighbours_of_includes_are_sought_without_a_folder() {
    // The tests run in the folder of the package.
    let name = format!("lanesim-neighbour-{}.xml", std::process::id());
    std::fs::write(&name, "<mujoco><include file='Cargo.tomll'/></mujoco>").expect("written");
    let problem = load(std::path::Path::new(&name), &LoadOptions::default()).expect_err("missing").0[0].clone();
    std::fs::remove_file(&name).expect("removed");
    assert!(problem.remedy.starts_with("did you mean \"Cargo.toml\"? "), "{problem}");
}

/// MuJoCo reads no text between tags, so nothing in it is a fault.
#[test]
fn text_between_tags_means_nothing() {
    for text in ["&nbsp;", "a & b", "\u{1}", "&#1;", "]]>", "é > "] {
        assert_eq!(
            ok(&format!("<mujoco>{text}<option timestep='0.5'/>\n{text}</mujoco>")).option.timestep,
            0.5,
            "{text}"
        );
    }
    // Lines stay in their places.
    rejects("<mujoco>a\n&b\n<optoin/></mujoco>", "3: optoin: unknown element in mujoco (did you mean \"option\"?)");
}

#[test]
fn remedies_of_what_is_met_in_files() {
    rejects(
        "<robot name='r'/>",
        "1: robot \"r\": the root element must be <mujoco>, not <robot> (this is URDF: load it with MuJoCo and save it as MJCF)",
    );
    rejects(
        &world("<geom size='1,2'/>"),
        "1: geom: attribute \"size\": \"1,2\" is not a number; separate numbers by blanks",
    );
}

/// Copies of what is rejected are not made: a thousand problems would say no more than one.
#[test]
fn a_replica_whose_angles_overflow_is_one_problem() {
    let text = |angles: &str| world(&format!("<replicate count='65536' euler='{angles}'><geom size='1'/></replicate>"));
    rejects(&text("1e305 0 0"), "1: replicate: attribute \"euler\": the last copy's angles overflow (turn less)");
    rejects(&text("1 2"), "1: replicate: attribute \"euler\": expected 3 numbers, found 2");
}
