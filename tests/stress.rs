//! What must not load, or loads with care: meshes, tendons and sensors that are empty, flat, huge, inside out, cut off, lying, or about
//! things that are not there. Every case either steps with numbers, as in MuJoCo, or is refused with what is said here.

use std::collections::BTreeMap;

use lanesim::mjcf::{LoadOptions, parse_with_files};
use lanesim::{Model, Options, Worlds};

/// What loads.
const LOADS: &str = "";

type Files = BTreeMap<String, Vec<u8>>;

#[track_caller]
fn check(name: &str, text: &str, files: &Files, expected: &str) {
    let loaded = parse_with_files(text, files, &LoadOptions::default()).and_then(|spec| Model::from_spec(&spec));
    match (loaded, expected) {
        (Ok(model), LOADS) => {
            let mut worlds = Worlds::new(&model, 2, &Options { threads: Some(1), ..Options::default() }).expect(name);
            worlds.step(20).expect(name);
            let state = worlds.get(lanesim::Field::Qpos, 1).expect(name);
            assert!(state.iter().all(|x| x.is_finite()), "{name}: {state:?}");
        }
        (Ok(_), expected) => panic!("{name} loads, instead of: {expected}"),
        (Err(problems), expected) => {
            let problems = problems.to_string();
            assert!(expected != LOADS && problems.contains(expected), "{name}: {problems}\n instead of: {expected}");
        }
    }
}

const TETRAHEDRON: &str = "vertex='0 0 0 1 0 0 0 1 0 0 0 1'";

fn mesh(attributes: &str, file: Option<(&str, Vec<u8>)>, expected: &str) {
    let text = format!(
        "<mujoco><asset><mesh name='m' {attributes}/></asset><worldbody>\
         <body><freejoint/><geom type='mesh' mesh='m'/></body></worldbody></mujoco>"
    );
    let files = file.into_iter().map(|(name, bytes)| (name.to_string(), bytes)).collect();
    check(attributes, &text, &files, expected);
}

#[test]
fn meshes_that_are_written() {
    let mesh = |attributes: &str, expected| mesh(attributes, None, expected);
    let tetrahedron = |attributes: &str, expected| mesh(&format!("{TETRAHEDRON} {attributes}"), expected);
    mesh("vertex=''", "neither file nor vertex is given (name a file)");
    mesh("vertex='0 0 0 1 0 0 0 1 0'", "3 vertices are too few; a mesh has at least 4");
    let flat = "has no convex hull: its vertices lie in a plane, or nearly so";
    mesh("vertex='0 0 0 1 0 0 0 1 0 1 1 0'", flat);
    mesh("vertex='0 0 0 1 0 0 2 0 0 3 0 0'", flat);
    mesh("vertex='1 1 1 1 1 1 1 1 1 1 1 1'", flat);
    mesh("vertex='0 0 0 1 0 0 0 1 0 0 0 nan'", "attribute \"vertex\": \"nan\" is not a finite number");
    mesh("vertex='0 0 0 1 0 0 0 1 0 0 0 1e39'", "vertex 3 is not finite");
    mesh("vertex='0 0 0 1 0 0 0 1 0 1'", "attribute \"vertex\": the count is no multiple of 3 (give x y z of each)");
    tetrahedron("face='0 1 9'", "a face has vertex 9, but there are 4");
    tetrahedron("face='0 1 -2'", "attribute \"face\": index -2 is negative");
    tetrahedron("face='0 1'", "attribute \"face\": the count is no multiple of 3 (give three vertices of each)");
    tetrahedron("face='1 1 1'", "encloses a volume of 0.000e0, which is too small");
    tetrahedron("face='0 1 2 0 3 1 0 2 3 1 3 2' inertia='exact'", "its faces may point inward or be few");
    tetrahedron("scale='1 0 1'", "refpos, refquat and scale must be finite, and no scale 0");
    tetrahedron("scale='1e-8 1e-8 1e-8'", "which is too small");
    tetrahedron("scale='1e12 1e12 1e12'", "leaves the range of numbers");
    tetrahedron("scale='-1 1 1'", LOADS);
    tetrahedron("maxhullvert='3'", "attribute \"maxhullvert\": 3 is too few (use -1 or 4 and more)");
    tetrahedron("file='a.obj'", "both file and vertex are given (keep one)");
    let twice =
        format!("<mujoco><asset><mesh name='m' {TETRAHEDRON}/>\n<mesh name='m' {TETRAHEDRON}/></asset></mujoco>");
    check("twice", &twice, &Files::new(), "repeated name \"m\", first used in line 1 (rename one of them)");
}

#[test]
fn meshes_that_are_built_in() {
    let mesh = |attributes: &str, expected| mesh(attributes, None, expected);
    mesh("builtin='cube' params='1'", "unknown kind \"cube\" (use sphere, hemisphere, cone, supersphere, supertorus)");
    mesh("builtin='wedge' params='3 3 90 90 0'", "built-in meshes of kind wedge are not supported (save it to a file)");
    mesh("builtin='sphere'", "attribute \"params\": a sphere has 1, and there are 0 (give subdivision)");
    mesh("builtin='sphere' params='99'", "attribute \"params\": subdivision is 99, not from 0 to 4 (give subdivision)");
    mesh("builtin='sphere' params='-1'", "subdivision is -1, not from 0 to 4");
    mesh("builtin='hemisphere' params='11'", "resolution is 11, not from 0 to 10");
    mesh("builtin='cone' params='2 0'", "nvert is 2, not from 3 to 1000");
    mesh("builtin='cone' params='9 2'", "radius is 2, not from 0 to 1 (give nvert radius)");
    mesh("builtin='supersphere' params='1e9 1 1'", "resolution is 1000000000, not from 3 to 1000");
    mesh("builtin='supersphere' params='5 -1 1'", "e is -1, not from 0 to 1000");
    mesh("builtin='supertorus' params='5 0 1 1'", "radius is 0, not above 0 to 1");
    mesh("builtin='sphere' params='1' file='a.obj'", "builtin is given with a file or with vertices (keep one)");
    mesh("builtin='supersphere' params='9 0.3 2'", LOADS);
}

/// A binary STL of a tetrahedron that announces so many triangles.
fn stl(announced: u32) -> Vec<u8> {
    let corners = [[0.0_f32; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut bytes = vec![0; 80];
    bytes.extend(announced.to_le_bytes());
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        bytes.extend([0; 12]);
        face.iter().flat_map(|corner| corners[*corner as usize]).for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn meshes_in_files() {
    let of = |name: &str, bytes: &[u8], expected: &str| {
        mesh(&format!("file='{name}'"), Some((name, bytes.to_vec())), expected)
    };
    mesh("file='gone.stl'", None, "file \"gone.stl\": no such file among those given");
    mesh("file='../../../etc/passwd.obj'", None, "no such file among those given");
    of("a.stl", &stl(4), LOADS);
    of("a.ply", b"ply", "meshes of type \"ply\" are not supported (use OBJ, STL or MSH)");
    of("a.stl", b"", "file \"a.stl\" is not an STL file: it ends within the header");
    of("a.stl", &stl(400_000_000), "400000000 triangles are announced, and there is room for 4");
    let cut = stl(4);
    of("a.stl", &cut[..cut.len() - 7], "4 triangles are announced, and there is room for 3");
    of("a.stl", &stl(0)[..84], "0 vertices are too few");
    of("a.stl", b"solid x\nfacet normal 0 0 0\nouter loop\nvertex 0 0", "is not an STL file");
    of("a.obj", b"this is no mesh\n", "0 vertices are too few");
    of("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 9\n", "face vertex index out of bounds");
    of("a.msh", &[255; 16], "it ends within the header, or a count in it is negative");
}

/// Two links with sites, sites of the world, and what else there is.
fn arm(extra: &str, section: &str) -> String {
    format!(
        "<mujoco><worldbody>
           <site name='w' pos='0 0 1'/><site name='v' pos='0 0 1'/><site name='in'/>
           <body name='a'><joint name='j' axis='0 1 0'/><geom name='g' size='.1'/><site name='s' pos='.2 0 0'/>
             <body pos='.5 0 0'><joint name='k' axis='0 1 0'/><geom name='h' size='.1'/><site name='t' pos='.2 0 0'/></body>
           </body>{extra}
         </worldbody>{section}</mujoco>"
    )
}

#[test]
fn tendons() {
    let box_ = "<geom name='b' type='box' size='.1 .1 .1'/>";
    let free = "<body pos='3 0 0'><freejoint name='f'/><geom size='1'/></body>";
    let with = |extra: &str, tendon: &str, expected: &str| {
        check(tendon, &arm(extra, &format!("<tendon>{tendon}</tendon>")), &Files::new(), expected);
    };
    let path = |path: &str, expected: &str| with("", &format!("<spatial>{path}</spatial>"), expected);
    let few = "has fewer than two sites (a path goes from site to site)";
    path("", few);
    path("<site site='w'/>", few);
    path("<pulley divisor='2'/>", few);
    path("<site site='w'/><geom geom='g'/>", few);
    path("<pulley divisor='2'/><site site='w'/><site site='s'/>", LOADS);
    path("<site site='w'/><site site='s'/><pulley divisor='2'/>", "ends with a pulley (end it with a site");
    let zero = "<site site='w'/><site site='s'/><pulley divisor='0'/><site site='w'/><site site='t'/>";
    path(zero, "divisor of a pulley is 0 (give a positive number)");
    path("<site site='w'/><site site='w'/>", "site \"w\" is repeated (remove one of the two)");
    path("<site site='w'/><site site='v'/>", LOADS);
    path("<site site='w'/><geom geom='g'/><site site='in'/>", LOADS);
    let two = "<site site='w'/><geom geom='g'/><geom geom='h'/><site site='t'/>";
    path(two, "geom \"g\" is not between two sites (put sites around it)");
    path("<site site='w'/><geom geom='g' sidesite='q'/><site site='t'/>", "names an unknown side site \"q\"");
    path("<site site='w'/><site site='q'/>", "names an unknown site \"q\"");
    let wraps = "<spatial><site site='w'/><geom geom='b'/><site site='t'/></spatial>";
    with(box_, wraps, "geom \"b\" is neither a sphere nor a cylinder");
    with("", "<fixed name='x'/>", "tendon \"x\": has no joint (add joints, each with a coefficient)");
    let fixed = |attributes: &str, expected: &str| {
        with("", &format!("<fixed {attributes}><joint joint='j' coef='1'/></fixed>"), expected);
    };
    fixed("range='1 -1' limited='true'", "range");
    fixed("stiffness='1' springlength='1 .5'", "springlength is empty: 1 0.5 (give springlength as shorter longer)");
    fixed("stiffness='-1'", LOADS);
    let twice = "<fixed><joint joint='j' coef='1'/><joint joint='j' coef='2'/></fixed>";
    with("", twice, "joint \"j\" is repeated (add up its coefficients)");
    with("", "<fixed><joint joint='q' coef='1'/></fixed>", "names an unknown joint \"q\"");
    with(free, "<fixed><joint joint='f' coef='1'/></fixed>", "joint \"f\" is neither a hinge nor a slide");
}

#[test]
fn sensors() {
    let ball = "<body pos='3 0 0'><joint name='b' type='ball'/><geom size='1'/></body>";
    let plane = "<geom name='p' type='plane' size='1 1 1' pos='0 0 -3'/>";
    let with = |extra: &str, sensor: &str, expected: &str| {
        check(sensor, &arm(extra, &format!("<sensor>{sensor}</sensor>")), &Files::new(), expected);
    };
    let alone = |sensor: &str, expected: &str| with("", sensor, expected);
    alone("<gyro site='q'/>", "gyro #0: unknown site \"q\"");
    alone("<gyro/>", "attribute \"site\" is missing");
    alone("<ballquat joint='j'/>", "joint \"j\" is not a ball (use jointpos or jointvel)");
    with(ball, "<jointpos joint='b'/>", "joint \"b\" is neither a slide nor a hinge");
    alone("<jointlimitpos joint='j'/>", "joint \"j\" has no limits (give it a range, or remove the sensor)");
    alone("<smell site='w'/>", "unknown element in sensor");
    alone("<framepos objtype='cat' objname='w'/>", "\"cat\" is not one of body, xbody, geom, site, camera");
    alone("<framepos objtype='geom' objname='w'/>", "unknown geom \"w\"");
    alone("<framepos objtype='site' objname='w' refname='s'/>", "attribute \"reftype\" is missing");
    alone("<gyro site='w' cutoff='-1'/>", "cutoff is negative: -1 (give 0 or more)");
    alone("<gyro site='w' cutoff='nan'/>", "attribute \"cutoff\": \"nan\" is not a finite number");
    alone("<gyro site='w' noise='-1'/>", "noise is negative: -1 (give 0 or more)");
    alone("<user name='u'/>", "attribute \"dim\" is missing");
    alone("<user dim='2000000000'/>", "sensors have 2000000000 numbers (use at most 10000000)");
    alone("<contact geom1='g' num='1000000000'/>", "numbers (use at most 10000000)");
    alone("<contact geom1='g' body1='world'/>", "both geom1 and body1 are given (keep one)");
    alone("<contact geom1='g' reduce='best'/>", "\"best\" is not one of none, mindist, maxforce, netforce");
    alone("<distance geom1='g' geom2='g'/>", "both sides have the same geom");
    with(plane, "<distance geom1='g' geom2='p'/>", LOADS);
    alone("<insidesite site='w' objtype='geom' objname='q'/>", "unknown geom \"q\"");
    alone("<clock name='c'/>\n<clock name='c'/>", "repeated name, first used in line");
    alone("<rangefinder/>", "attribute \"site\" is missing (give site or camera)");
    alone("<tendonpos tendon='q'/>", "unknown tendon \"q\"");
    alone("<actuatorfrc actuator='q'/>", "unknown actuator \"q\"");
}
