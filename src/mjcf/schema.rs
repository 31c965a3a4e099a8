//! Which elements and attributes there are: a table, and the check of a tree against it.

use super::report::{Report, quoted};
use super::tree::Tree;

/// What may stand in an element.
struct Rule {
    tag: &'static str,
    /// Lists of names separated by blanks.
    attributes: &'static [&'static str],
    children: &'static [&'static Rule],
    /// Children that may come at most once.
    once: &'static str,
    /// Whether the element is accepted with whatever it holds: it is ignored, or not supported as a whole.
    opaque: bool,
}

const PLAIN: Rule = Rule { tag: "", attributes: &[], children: &[], once: "", opaque: false };

/// An element without children.
const fn leaf(tag: &'static str, attributes: &'static [&'static str]) -> Rule {
    Rule { tag, attributes, ..PLAIN }
}

/// An element without attributes.
const fn section(tag: &'static str, children: &'static [&'static Rule]) -> Rule {
    Rule { tag, children, ..PLAIN }
}

const fn opaque(tag: &'static str) -> Rule {
    Rule { tag, opaque: true, ..PLAIN }
}

const IDENTITY: &str = "name class";
/// Orientation notations: at most one per element.
pub(super) const ORIENTATIONS: &str = "quat axisangle euler xyaxes zaxis";

/// What MuJoCo accepts in a `replicate`, and does not read.
pub(super) const IDLE_IN_REPLICATE: &str = "name pos quat axisangle xyaxes zaxis";

const COMPILER: &str = "alignfree angle assetdir autolimits balanceinertia boundinertia boundmass conflict coordinate \
    discardvisual eulerseq fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir passthrough savecanonical \
    savecompiled saveinertial settotalmass strippath texturedir usethread";
const LENGTHRANGE: &str = "accel interval inttotal maxforce mode timeconst timestep tolrange useexisting uselimit";
const SIZE: &str = "memory nconmax njmax nkey nstack nuser_actuator nuser_body nuser_cam nuser_geom nuser_jnt \
    nuser_sensor nuser_site nuser_tendon nuserdata";
const JOINT: &str = "actuatorfrclimited actuatorfrcrange actuatorgravcomp armature axis damping frictionloss group \
    limited margin pos range ref solimpfriction solimplimit solreffriction solreflimit springdamper springref \
    springyield stiffness type user";
const GEOM: &str = "adhesion castshadow conaffinity condim contype density fitscale fluidcoef fluidshape friction fromto \
    gap group hfield margin mass material mesh pos priority rgba shellinertia size solimp solmix solref surfacevel type \
    user";
const MESH: &str = "inertia maxhullvert scale";
const SITE: &str = "fromto group material mesh pos rgba size type user";
const CAMERA: &str = "focal focalpixel fovy ipd mode output pos principal principalpixel projection resolution \
    sensorsize user";
const LIGHT: &str = "active ambient attenuation bulbradius castshadow cutoff diffuse dir directional exponent intensity \
    mode pos range softness specular type";
const PAIR: &str = "adhesion condim friction gap margin solimp solref solreffriction";
const TENDON: &str = "actuatorfrclimited actuatorfrcrange armature damping frictionloss group limited margin range \
    solimpfriction solimplimit solreffriction solreflimit springlength springyield stiffness user";
const DRAWN: &str = "material rgba width";
const LAW: &str = "active solref solimp";
/// What every actuator but the newest kinds has.
const ACTUATOR: &str = "armature cranklength ctrllimited ctrlrange damping delay forcelimited forcerange gear group \
    interp nsample user";
const TRANSMISSION: &str = "cranksite joint jointinparent lengthrange name class slidersite tendon";
const ADHESION: &str = "ctrlrange delay forcelimited forcerange gain group interp nsample user";
const SITES: &str = "refsite site";
const GENERAL: &str = "actdim actearly actlimited actrange biasprm biastype dynprm dyntype ffrange gainprm gaintype \
    inheritrange input velrange";
const POSITION: &str = "dampratio inheritrange kp kv timeconst";
const INTVELOCITY: &str = "actlimited actrange dampratio inheritrange kp kv";
const CYLINDER: &str = "area bias diameter timeconst";
const PID: &str = "dampratio ffrange imax inheritrange input ki kp kv posrange slewmax velrange";
/// What a motor has of other actuators; its force is bounded by `saturation`.
const DRIVEN: &str = "armature cranklength ctrllimited ctrlrange damping delay gear group interp nsample user";
const DCMOTOR: &str = "cogging controller inductance input lugre motorconst nominal resistance saturation thermal";
const ORIENTATION: &str =
    "ctrllimited ctrlrange dampratio delay forcelimited forcerange group input interp kp kv nsample user";
const MUSCLE: &str = "force fpmax fvmax lmax lmin range scale timeconst vmax";

static MUJOCO: Rule = Rule {
    tag: "mujoco",
    attributes: &["model version"],
    children: &[
        &Rule {
            children: &[&leaf("lengthrange", &[LENGTHRANGE])],
            once: "lengthrange",
            ..leaf("compiler", &[COMPILER])
        },
        &Rule {
            children: &[&leaf("flag", &[super::option::FLAGS])],
            once: "flag",
            ..leaf("option", &[super::option::NAMES])
        },
        &leaf("size", &[SIZE]),
        &opaque("statistic"),
        &opaque("visual"),
        &DEFAULT,
        &opaque("extension"),
        &CUSTOM,
        &ASSET,
        &WORLDBODY,
        &WORLD,
        &opaque("deformable"),
        &CONTACT,
        &TENDONS,
        &EQUALITY,
        &ACTUATORS,
        &SENSORS,
        &KEYFRAME,
    ],
    ..PLAIN
};

static DEFAULT: Rule = Rule {
    tag: "default",
    attributes: &["class"],
    children: &[
        &leaf("mesh", &[MESH]),
        &opaque("texture"),
        &opaque("material"),
        &leaf("joint", &[JOINT]),
        &leaf("geom", &[GEOM, ORIENTATIONS]),
        &leaf("site", &[SITE, ORIENTATIONS]),
        &leaf("camera", &[CAMERA, ORIENTATIONS]),
        &leaf("light", &[LIGHT]),
        &leaf("pair", &[PAIR]),
        &leaf("equality", &[LAW]),
        &leaf("tendon", &[TENDON, DRAWN]),
        &leaf("general", &[ACTUATOR, GENERAL]),
        &leaf("motor", &[ACTUATOR]),
        &leaf("position", &[ACTUATOR, POSITION]),
        &leaf("velocity", &[ACTUATOR, "kv"]),
        &leaf("intvelocity", &[ACTUATOR, INTVELOCITY]),
        &leaf("damper", &[ACTUATOR, "kv"]),
        &leaf("cylinder", &[ACTUATOR, CYLINDER]),
        &leaf("muscle", &[ACTUATOR, MUSCLE]),
        &leaf("adhesion", &[ADHESION]),
        &leaf("dcmotor", &[DRIVEN, DCMOTOR]),
        &leaf("pid", &[ACTUATOR, PID]),
        &leaf("orientation", &[ORIENTATION]),
        &DEFAULT,
    ],
    once: "mesh texture material joint geom site camera light pair equality tendon general motor position velocity \
        intvelocity damper cylinder muscle adhesion dcmotor pid orientation",
    opaque: false,
};

static CUSTOM: Rule = section(
    "custom",
    &[
        &leaf("numeric", &["name size data"]),
        &leaf("text", &["name data"]),
        &Rule { children: &[&leaf("element", &["objtype objname prm"])], ..leaf("tuple", &["name"]) },
    ],
);

static MESH_ASSET: Rule = Rule {
    children: &[&opaque("plugin")],
    ..leaf(
        "mesh",
        &[
            MESH,
            "name class builtin centered content_type face file material normal params refpos refquat smoothnormal texcoord vertex",
        ],
    )
};

static ASSET: Rule = section(
    "asset",
    &[
        &opaque("texture"),
        &opaque("material"),
        &opaque("skin"),
        &MESH_ASSET,
        &leaf("hfield", &["name content_type file nrow ncol size elevation"]),
        &leaf("model", &["name file content_type"]),
    ],
);

static BODY_CHILDREN: [&Rule; 14] = [
    &leaf("inertial", &["pos mass diaginertia fullinertia", ORIENTATIONS]),
    &leaf("joint", &[JOINT, IDENTITY]),
    &leaf("freejoint", &["name group align"]),
    &Rule { children: &[&opaque("plugin")], ..leaf("geom", &[GEOM, ORIENTATIONS, IDENTITY]) },
    &leaf("site", &[SITE, ORIENTATIONS, IDENTITY]),
    &leaf("camera", &[CAMERA, ORIENTATIONS, IDENTITY, "target"]),
    &leaf("light", &[LIGHT, IDENTITY, "target texture"]),
    &leaf("attach", &["model body frame prefix"]),
    &opaque("plugin"),
    &opaque("composite"),
    &opaque("flexcomp"),
    &BODY,
    &FRAME,
    &REPLICATE,
];

static WORLDBODY: Rule = Rule { tag: "worldbody", children: &BODY_CHILDREN, ..PLAIN };
static WORLD: Rule = Rule { tag: "world", children: &BODY_CHILDREN, ..PLAIN };
static BODY: Rule = Rule {
    tag: "body",
    attributes: &["name childclass pos mocap gravcomp user sleep fuse simple", ORIENTATIONS],
    children: &BODY_CHILDREN,
    once: "inertial",
    opaque: false,
};
static FRAME: Rule =
    Rule { tag: "frame", attributes: &["name childclass pos", ORIENTATIONS], children: &BODY_CHILDREN, ..PLAIN };
static REPLICATE: Rule = Rule {
    tag: "replicate",
    attributes: &["count offset euler sep childclass", IDLE_IN_REPLICATE],
    children: &BODY_CHILDREN,
    ..PLAIN
};

static CONTACT: Rule =
    section("contact", &[&leaf("pair", &[PAIR, IDENTITY, "geom1 geom2"]), &leaf("exclude", &["name body1 body2"])]);

static TENDONS: Rule = section(
    "tendon",
    &[
        &Rule { children: &[&leaf("joint", &["joint coef"])], ..leaf("fixed", &[TENDON, IDENTITY]) },
        &Rule {
            children: &[&leaf("site", &["site"]), &leaf("geom", &["geom sidesite"]), &leaf("pulley", &["divisor"])],
            ..leaf("spatial", &[TENDON, DRAWN, IDENTITY])
        },
    ],
);

static EQUALITY: Rule = section(
    "equality",
    &[
        &leaf("connect", &[LAW, IDENTITY, "body1 body2 anchor site1 site2"]),
        &leaf("weld", &[LAW, IDENTITY, "body1 body2 anchor relpose torquescale site1 site2"]),
        &leaf("joint", &[LAW, IDENTITY, "joint1 joint2 polycoef"]),
        &leaf("tendon", &[LAW, IDENTITY, "tendon1 tendon2 polycoef"]),
        &opaque("flex"),
        &opaque("flexvert"),
        &opaque("flexstrain"),
        &opaque("distance"),
    ],
);

static ACTUATORS: Rule = section(
    "actuator",
    &[
        &leaf("general", &[ACTUATOR, TRANSMISSION, SITES, GENERAL, "body"]),
        &leaf("motor", &[ACTUATOR, TRANSMISSION, SITES]),
        &leaf("position", &[ACTUATOR, TRANSMISSION, SITES, POSITION]),
        &leaf("velocity", &[ACTUATOR, TRANSMISSION, SITES, "kv"]),
        &leaf("intvelocity", &[ACTUATOR, TRANSMISSION, SITES, INTVELOCITY]),
        &leaf("damper", &[ACTUATOR, TRANSMISSION, SITES, "kv"]),
        &leaf("cylinder", &[ACTUATOR, TRANSMISSION, SITES, CYLINDER]),
        &leaf("muscle", &[ACTUATOR, TRANSMISSION, MUSCLE, "tausmooth"]),
        &leaf("adhesion", &["name class body", ADHESION]),
        &leaf("dcmotor", &[DRIVEN, TRANSMISSION, SITES, DCMOTOR]),
        &leaf("pid", &[ACTUATOR, TRANSMISSION, SITES, PID]),
        &leaf("orientation", &["name class joint refsite site", ORIENTATION]),
        &opaque("plugin"),
    ],
);

/// What every sensor has.
const SENSOR: &str = "name cutoff noise user nsample interp delay interval";
const FRAME_SENSOR: &str = "objtype objname reftype refname";
const DISTANCE: &str = "geom1 geom2 body1 body2";

static SENSORS: Rule = section(
    "sensor",
    &[
        &leaf("touch", &[SENSOR, "site"]),
        &leaf("accelerometer", &[SENSOR, "site"]),
        &leaf("velocimeter", &[SENSOR, "site"]),
        &leaf("gyro", &[SENSOR, "site"]),
        &leaf("force", &[SENSOR, "site"]),
        &leaf("torque", &[SENSOR, "site"]),
        &leaf("magnetometer", &[SENSOR, "site"]),
        &leaf("camprojection", &[SENSOR, "site camera"]),
        &leaf("rangefinder", &[SENSOR, "site camera data"]),
        &leaf("jointpos", &[SENSOR, "joint"]),
        &leaf("jointvel", &[SENSOR, "joint"]),
        &leaf("tendonpos", &[SENSOR, "tendon"]),
        &leaf("tendonvel", &[SENSOR, "tendon"]),
        &leaf("actuatorpos", &[SENSOR, "actuator"]),
        &leaf("actuatorvel", &[SENSOR, "actuator"]),
        &leaf("actuatorfrc", &[SENSOR, "actuator"]),
        &leaf("jointactuatorfrc", &[SENSOR, "joint"]),
        &leaf("tendonactuatorfrc", &[SENSOR, "tendon"]),
        &leaf("ballquat", &[SENSOR, "joint"]),
        &leaf("ballangvel", &[SENSOR, "joint"]),
        &leaf("jointlimitpos", &[SENSOR, "joint"]),
        &leaf("jointlimitvel", &[SENSOR, "joint"]),
        &leaf("jointlimitfrc", &[SENSOR, "joint"]),
        &leaf("tendonlimitpos", &[SENSOR, "tendon"]),
        &leaf("tendonlimitvel", &[SENSOR, "tendon"]),
        &leaf("tendonlimitfrc", &[SENSOR, "tendon"]),
        &leaf("framepos", &[SENSOR, FRAME_SENSOR]),
        &leaf("framequat", &[SENSOR, FRAME_SENSOR]),
        &leaf("framexaxis", &[SENSOR, FRAME_SENSOR]),
        &leaf("frameyaxis", &[SENSOR, FRAME_SENSOR]),
        &leaf("framezaxis", &[SENSOR, FRAME_SENSOR]),
        &leaf("framelinvel", &[SENSOR, FRAME_SENSOR]),
        &leaf("frameangvel", &[SENSOR, FRAME_SENSOR]),
        &leaf("framelinacc", &[SENSOR, "objtype objname"]),
        &leaf("frameangacc", &[SENSOR, "objtype objname"]),
        &leaf("subtreecom", &[SENSOR, "body"]),
        &leaf("subtreelinvel", &[SENSOR, "body"]),
        &leaf("subtreeangmom", &[SENSOR, "body"]),
        &leaf("insidesite", &[SENSOR, "site objtype objname"]),
        &leaf("distance", &[SENSOR, DISTANCE]),
        &leaf("normal", &[SENSOR, DISTANCE]),
        &leaf("fromto", &[SENSOR, DISTANCE]),
        &leaf("contact", &[SENSOR, DISTANCE, "subtree1 subtree2 site num data reduce"]),
        &leaf("e_potential", &[SENSOR]),
        &leaf("e_kinetic", &[SENSOR]),
        &leaf("clock", &[SENSOR]),
        &leaf("tactile", &[SENSOR, "geom mesh"]),
        &leaf("user", &[SENSOR, "objtype objname datatype needstage dim"]),
        &opaque("plugin"),
    ],
);

static KEYFRAME: Rule = section("keyframe", &[&leaf("key", &["name time qpos qvel act ctrl mpos mquat plastic"])]);

/// The names in lists separated by blanks.
fn names(lists: &'static [&'static str]) -> impl Iterator<Item = &'static str> + Clone {
    lists.iter().flat_map(|list| list.split_ascii_whitespace())
}

/// Every attribute that is accepted, with the path of its element; of elements that nest in themselves, the outermost.
#[cfg(test)]
pub(super) fn attributes() -> Vec<(Vec<&'static str>, &'static str)> {
    let mut out = Vec::new();
    let mut seen: Vec<*const Rule> = Vec::new();
    let mut open = vec![(vec![MUJOCO.tag], &MUJOCO)];
    // Breadth first, so that paths are short.
    while !open.is_empty() {
        let (path, rule) = open.remove(0);
        if seen.contains(&std::ptr::from_ref(rule)) {
            continue;
        }
        seen.push(rule);
        out.extend(names(rule.attributes).map(|name| (path.clone(), name)));
        let inner = rule.children.iter().filter(|child| !child.opaque);
        open.extend(inner.map(|child| ([&path[..], &[child.tag]].concat(), *child)));
    }
    out
}

/// Reports every element and attribute that the table does not know.
pub(super) fn check(tree: &Tree, report: &mut Report) {
    if tree[0].tag != MUJOCO.tag {
        let message = format!("the root element must be <mujoco>, not <{}>", crate::diagnostics::shorten(&tree[0].tag));
        let remedy = match tree[0].tag.as_str() {
            "robot" => "this is URDF: load it with MuJoCo and save it as MJCF",
            _ => "an MJCF file starts with <mujoco>",
        };
        return report.error(&tree[0], message, remedy);
    }
    let mut open = vec![(0, &MUJOCO)];
    while let Some((index, rule)) = open.pop() {
        check_attributes(tree, index, rule, report);
        check_repeats(tree, index, rule, report);
        let before = open.len();
        for &child in &tree[index].children {
            let element = &tree[child];
            match rule.children.iter().find(|rule| rule.tag == element.tag) {
                Some(rule) if rule.opaque => {}
                Some(rule) => open.push((child, rule)),
                None => {
                    let message = format!("unknown element in {}", rule.tag);
                    let remedy = report.propose(&element.tag, rule.children.iter().map(|r| r.tag));
                    report.error(element, message, remedy);
                }
            }
        }
        // So that children are checked, and problems listed, in the order of the file.
        open[before..].reverse();
    }
}

fn check_attributes(tree: &Tree, index: usize, rule: &Rule, report: &mut Report) {
    let element = &tree[index];
    if rule.attributes.is_empty() && !element.attributes.is_empty() {
        return report.error(element, format!("{} has no attributes", rule.tag), "remove them");
    }
    for (name, _) in &element.attributes {
        if !names(rule.attributes).any(|known| known == name) {
            let remedy = report.propose(name, names(rule.attributes));
            report.error(element, format!("unknown attribute {}", quoted(name)), remedy);
        }
    }
}

fn check_repeats(tree: &Tree, index: usize, rule: &Rule, report: &mut Report) {
    for tag in rule.once.split_ascii_whitespace() {
        if let Some(second) = tree.children(index).filter(|child| child.tag == tag).nth(1) {
            report.error(second, format!("a second {tag} in the same {}", rule.tag), "merge the two");
        }
    }
}
