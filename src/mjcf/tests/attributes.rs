//! No attribute that the schema accepts is silently ignored: each changes the spec, is reported, or is listed here with
//! the reason why not.

use crate::mjcf::{LoadOptions, parse_with_files, schema};

const LOOKS: &str = "only for viewers";
const FILES: &str = "only for files that are not there in this test";
const SAVING: &str = "only for saving and attaching models";
const USER: &str = "numbers for the user's own code, of which there is none here";
const MEMORY: &str = "rooms are sized by the model";
const MESHES: &str = "only for shapes of meshes, of which there is none in this test, and height fields";
const SPEED: &str = "only steers speed";

/// Element (`*`: any, `default`: all in defaults), attributes, and why they have no effect.
const IDLE: &[(&str, &str, &str)] = &[
    ("mujoco", "version", "says which version wrote the file"),
    ("compiler", "assetdir meshdir texturedir strippath", FILES),
    ("compiler", "conflict passthrough savecanonical savecompiled saveinertial", SAVING),
    ("compiler", "coordinate", "local is the only value that is supported, and the default"),
    ("compiler", "usethread", SPEED),
    ("option", "jacobian sdf_initpoints sdf_iterations", SPEED),
    ("size", "memory nconmax njmax nstack", MEMORY),
    (
        "size",
        "nuserdata nuser_actuator nuser_body nuser_cam nuser_geom nuser_jnt nuser_sensor nuser_site nuser_tendon",
        USER,
    ),
    ("*", "user", USER),
    ("*", "material castshadow width", LOOKS),
    ("site tendon fixed spatial", "rgba", LOOKS),
    ("light", "*", LOOKS),
    ("camera", "ipd output target", LOOKS),
    ("geom", "hfield", MESHES),
    ("mesh hfield", "*", MESHES),
    ("geom", "fluidcoef", "only of ellipsoids in a medium (fluidshape)"),
    ("body", "simple", SPEED),
    ("custom numeric text tuple element", "*", USER),
    ("model", "name", "a name, which acts through the elements that give it"),
    ("tactile", "*", "the element is reported as not supported"),
    ("damper", "ctrllimited", "the control of a damper is always limited"),
    ("default", "cranklength", "only for slider-cranks, which are reported where they are used"),
    ("default", "class", "a name, which acts through the elements that give it"),
    ("frame", "name", "frames are gone once their poses are applied"),
];

/// Whether a list of words, or of all (`*`), has a word.
fn listed(list: &str, word: &str) -> bool {
    list == "*" || list.split_ascii_whitespace().any(|w| w == word)
}

fn idle(path: &[&str], attribute: &str) -> bool {
    let element = path[path.len() - 1];
    IDLE.iter().any(|(elements, attributes, why)| {
        assert!(!why.is_empty());
        let here = listed(elements, element) || *elements == "default" && path.contains(&"default");
        here && listed(attributes, attribute)
    })
}

/// Attributes that an element has beside the one under test (a general actuator is a servo, which heeds every one), which
/// replaces one of the same name.
fn base(path: &[&str]) -> &'static [(&'static str, &'static str)] {
    let (element, default) = (path[path.len() - 1], path.contains(&"default"));
    match element {
        "joint" if path.contains(&"equality") => &[("joint1", "j")],
        "user" => &[("dim", "1")],
        "e_potential" | "e_kinetic" | "clock" => &[],
        "contact" if path.contains(&"sensor") => &[],
        "distance" | "normal" | "fromto" if path.contains(&"sensor") => &[("geom1", "g"), ("geom2", "h")],
        "camprojection" => &[("site", "s"), ("camera", "e")],
        tag if path.contains(&"sensor") && tag.starts_with("tendon") => &[("tendon", "t")],
        "tactile" => &[],
        "insidesite" => &[("site", "s"), ("objtype", "geom"), ("objname", "g")],
        tag if path.contains(&"sensor") && tag.starts_with("frame") => &[("objtype", "site"), ("objname", "s")],
        tag if path.contains(&"sensor") && tag.starts_with("actuator") => &[("actuator", "m")],
        tag if path.contains(&"sensor") && tag.starts_with("subtree") => &[("body", "a")],
        tag if path.contains(&"sensor") && (tag.starts_with("joint") || tag.starts_with("ball")) => &[("joint", "j")],
        _ if path.contains(&"sensor") && path.len() > 1 => &[("site", "s")],
        "model" => &[("file", "child")],
        "attach" => &[("model", "m"), ("body", "b"), ("prefix", "p")],
        "tendon" if path.contains(&"equality") => &[("tendon1", "t")],
        "joint" if path.contains(&"tendon") => &[("joint", "j"), ("coef", "3")],
        "site" if path.contains(&"tendon") => &[("site", "s")],
        "geom" if path.contains(&"tendon") => &[("geom", "g")],
        "pulley" => &[("divisor", "3")],
        "connect" => &[("body1", "a"), ("anchor", "0 0 1")],
        "weld" => &[("body1", "a")],
        "default" => &[("class", "main")],
        "general" if default => &[("biastype", "affine"), ("gainprm", "2"), ("biasprm", "0 -2")],
        _ if default => &[],
        "numeric" => &[("name", "n"), ("size", "1")],
        "text" => &[("name", "n"), ("data", "d")],
        "tuple" => &[("name", "n")],
        "element" => &[("objtype", "geom"), ("objname", "g")],
        "body" => &[("name", "b")],
        "inertial" => &[("pos", "0 0 0"), ("mass", "1"), ("diaginertia", "1 1 1")],
        "joint" => &[("range", "-0.5 0.5")],
        "geom" | "site" => &[("name", "x"), ("type", "box"), ("size", "0.1 0.2 0.3"), ("euler", "10 20 30")],
        "replicate" => &[("count", "2"), ("offset", "1 0 0")],
        "pair" => &[("geom1", "g"), ("geom2", "h")],
        "exclude" => &[("body1", "a"), ("body2", "world")],
        "general" => &[("joint", "j"), ("biastype", "affine"), ("gainprm", "2"), ("biasprm", "0 -2")],
        "motor" | "position" | "velocity" | "intvelocity" | "cylinder" | "muscle" | "pid" => &[("joint", "j")],
        "dcmotor" => &[("joint", "j"), ("resistance", "1"), ("motorconst", "1")],
        "orientation" => &[("joint", "j")],
        "damper" => &[("joint", "j"), ("ctrlrange", "0 1")],
        "adhesion" => &[("body", "a"), ("ctrlrange", "0 1")],
        _ => &[],
    }
}

/// A model with an element at a path, once with an attribute and once without.
fn model(path: &[&str], attribute: Option<(&str, &str)>) -> String {
    let element = path[path.len() - 1];
    let default = path.contains(&"default");
    let replaced = |name: &str| {
        let oriented = |name: &str| schema::ORIENTATIONS.split_ascii_whitespace().any(|notation| notation == name);
        attribute.is_some_and(|(given, _)| {
            given == name
                || oriented(given) && oriented(name)
                || given == "fromto" && oriented(name)
                || given == "inheritrange" && name == "ctrlrange"
                || given == "jointinparent" && name == "joint"
                || given == "body1" && name == "geom1"
                || given == "body2" && name == "geom2"
                || given == "fullinertia" && name == "diaginertia"
        })
    };
    let mut attributes = String::new();
    let kept = base(path).iter().filter(|(name, _)| !replaced(name)).copied();
    for (name, value) in kept.chain(attribute) {
        attributes += &format!(" {name}='{value}'");
    }
    let inside = match element {
        "body" | "frame" | "replicate" if !default => "<geom name='r' type='box' size='.1 .1 .1' euler='10 20 30'/>",
        _ => "",
    };
    // A joint or inertia needs a body around it.
    let refers = path.contains(&"equality") || path.contains(&"tendon");
    let needs_body = matches!(element, "joint" | "freejoint" | "inertial") && !default && !refers;
    let mut text =
        if element == "mujoco" { String::new() } else { format!("<{element}{attributes}>{inside}</{element}>") };
    if needs_body {
        text = format!("<body>{text}<geom size='.1'/></body>");
    }
    for around in path[..path.len() - 1].iter().skip(1).rev() {
        let own = base(&[around]).iter().filter(|_| *around != "default");
        let own: String = own.map(|(n, v)| format!(" {n}='{v}'")).collect();
        text = format!("<{around}{own}>{text}</{around}>");
    }
    let root = if element == "mujoco" { attributes } else { String::new() };
    format!(
        "<mujoco{root}><asset><model name='m' file='child'/></asset><default><default class='c'><joint damping='3'/><geom mass='7'/><site group='4'/><camera fovy='4'/><pair gap='3'/><equality active='false'/><tendon group='4'/>\
         <general gear='5'/></default></default>{text}<worldbody><geom name='h' size='1'/><body name='a'>\
         <joint name='j' range='-30 60'/><joint name='k' type='slide'/><geom name='g' size='.1' euler='10 20 30'/><site name='s'/><camera name='e'/></body></worldbody>\
         <contact><pair geom1='g' geom2='h'/></contact><tendon><fixed><joint joint='j' coef='1'/></fixed></tendon><equality><joint joint1='k'/></equality>\
         <actuator><general joint='j'/></actuator></mujoco>"
    )
}

/// What a load says and makes, without places.
fn outcome(text: &str) -> Result<String, String> {
    let options = LoadOptions { lenient: true, ..LoadOptions::default() };
    let child = b"<mujoco model='n'><worldbody><frame name='f'><body name='b'><geom size='.1'/></body><body name='a'><geom size='.2'/></body></frame></worldbody></mujoco>";
    let files = [("child".to_string(), child.to_vec())].into();
    let mut spec = parse_with_files(text, &files, &options).map_err(|problems| problems.to_string())?;
    spec.written.clear();
    Ok(format!("{spec:?}"))
}

const VALUES: &[&str] = &[
    "never",
    "true",
    "dir",
    "mindist",
    "track",
    "orthographic",
    "false",
    "disable",
    "enable",
    "1",
    "2",
    "0.5",
    "3",
    "c",
    "name",
    "j",
    "s",
    "g",
    "h",
    "a",
    "1 2",
    "-1 2",
    "1 3",
    "1 2 3",
    "0 0 1",
    "90 20 10",
    "0 1 0 0",
    "1 2 3 40",
    "0.1 0.2 0.3 0.4 0.5",
    "0 1 0 -1 0 0",
    "1 2 3 .1 .2 .3",
    "1 2 3 1 0 0 0",
    "radian",
    "zyx",
    "sphere",
    "capsule",
    "ball",
    "RK4",
    "elliptic",
    "PGS",
    "filter",
    "affine",
    "none",
    "ellipsoid",
    "cubic",
    "quat",
    "vel pos",
    "pos",
    "vel",
    "axis",
    "body",
];

/// Whether an error says that the attribute means something here, not only that its form is wrong.
fn speaks(error: &str) -> bool {
    [
        "does not go with",
        "fromto needs",
        "not supported",
        "is given",
        "has no activation",
        "given",
        "is missing",
        "no asset is",
        "that the actuator has",
    ]
    .iter()
    .any(|word| error.contains(word))
}

#[test]
fn no_attribute_is_silently_ignored() {
    let (mut silent, mut stale) = (Vec::new(), Vec::new());
    for (path, attribute) in schema::attributes() {
        let element = path[path.len() - 1];
        let without = outcome(&model(&path, None)).unwrap_or_else(|error| panic!("{path:?}: {error}"));
        let acts = VALUES.iter().any(|value| match outcome(&model(&path, Some((attribute, value)))) {
            Ok(with) => with != without,
            Err(error) => speaks(&error),
        });
        match (acts, idle(&path, attribute)) {
            (false, false) => silent.push(format!("{} {attribute}", path.join("/"))),
            // Of elements without effect, some attributes are wrong, and are reported.
            (true, true) if !IDLE.iter().any(|(e, a, _)| listed(e, element) && *a == "*") => {
                stale.push(format!("{} {attribute}", path.join("/")));
            }
            _ => {}
        }
    }
    assert!(silent.is_empty(), "accepted and ignored: {silent:#?}");
    assert!(stale.is_empty(), "listed as without effect, but acting: {stale:#?}");
}

#[test]
fn a_body_can_keep_out_of_fusestatic() {
    let bodies = |fuse: &str| {
        let text = format!(
            "<mujoco><compiler fusestatic='true'/><worldbody><body><joint/><geom size='.1'/><body {fuse}>\
             <geom size='.1'/></body></body></worldbody></mujoco>"
        );
        crate::Model::from_xml_string(&text, &LoadOptions::default()).expect("good").names().bodies.len()
    };
    assert_eq!((bodies(""), bodies("fuse='auto'"), bodies("fuse='false'")), (2, 2, 3));
}
