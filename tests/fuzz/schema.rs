//! What the fuzzer knows of MJCF: elements, what may stand in them, and what kind of value an attribute has. More than
//! lanesim supports, for that must be refused.

/// An element: tag, attributes with kinds of values, children.
///
/// Kinds: `vN` N numbers, `n` one, `i` an integer, `b` true or false, `NAME` a name of that kind of element defined here,
/// `@NAME` one referred to, `a|b` one of these words, `t` text, `f` a file.
pub struct Rule {
    pub tag: &'static str,
    pub attributes: &'static str,
    pub children: &'static str,
}

const BODY: &str =
    "body frame replicate joint freejoint geom site inertial camera light include composite flexcomp plugin";
const ACTUATORS: &str =
    "motor position velocity general damper intvelocity cylinder muscle adhesion pid dcmotor orientation plugin";

const fn row(tag: &'static str, attributes: &'static str, children: &'static str) -> Rule {
    Rule { tag, attributes, children }
}

pub const RULES: &[Rule] = &[
    row(
        "mujoco",
        "model=t",
        "compiler option size default asset worldbody contact actuator keyframe custom visual statistic sensor \
            tendon equality deformable extension include",
    ),
    row(
        "compiler",
        "angle=radian|degree autolimits=b eulerseq=xyz|XYZ|zyx|zXy|xxx inertiafromgeom=true|false|auto \
            balanceinertia=b boundmass=n boundinertia=n settotalmass=n fusestatic=b coordinate=local|global \
            discardvisual=b inertiagrouprange=v2 alignfree=b saveinertial=b strippath=b meshdir=t assetdir=t",
        "lengthrange",
    ),
    row(
        "option",
        "timestep=n gravity=v3 integrator=Euler|RK4|implicit|implicitfast|discrete|midpoint cone=pyramidal|elliptic \
            solver=Newton|CG|PGS iterations=i tolerance=n ls_iterations=i ls_tolerance=n noslip_iterations=i \
            noslip_tolerance=n impratio=n wind=v3 density=n viscosity=n magnetic=v3 o_margin=n o_solref=v2 o_solimp=v5 \
            o_friction=v5 jacobian=dense|sparse|auto ccd_iterations=i actuatorgroupdisable=v3 sdf_iterations=i",
        "flag",
    ),
    row(
        "flag",
        "constraint=e equality=e frictionloss=e limit=e contact=e passive=e spring=e damper=e gravity=e \
            clampctrl=e warmstart=e filterparent=e actuation=e refsafe=e sensor=e midphase=e eulerdamp=e autoreset=e \
            override=e energy=e fwdinv=e invdiscrete=e multiccd=e island=e nativeccd=e",
        "",
    ),
    row("size", "memory=t njmax=i nconmax=i nstack=i nuserdata=i nkey=i nuser_geom=i", ""),
    row(
        "default",
        "class=CLASS",
        "default joint geom site motor position velocity general pair camera mesh material equality tendon",
    ),
    row("asset", "", "mesh texture material hfield"),
    row(
        "mesh",
        "name=MESH file=f vertex=v12 face=v3 scale=v3 refpos=v3 refquat=v4 inertia=legacy|exact|convex|shell maxhullvert=i class=@CLASS",
        "",
    ),
    row("hfield", "name=HFIELD nrow=i ncol=i size=v4 elevation=v9 file=f", ""),
    row("texture", "name=t type=2d|cube builtin=flat width=i height=i file=f", ""),
    row("material", "name=MATERIAL rgba=v4 texture=t class=@CLASS", ""),
    row("worldbody", "", BODY),
    row(
        "body",
        "name=BODY childclass=@CLASS mocap=b gravcomp=n user=v3 pos=v3 quat=v4 euler=v3 axisangle=v4 zaxis=v3",
        BODY,
    ),
    row("frame", "name=FRAME childclass=@CLASS pos=v3 quat=v4 euler=v3", BODY),
    row("replicate", "count=i offset=v3 euler=v3 sep=t childclass=@CLASS", BODY),
    row("inertial", "pos=v3 mass=n diaginertia=v3 fullinertia=v6 quat=v4 euler=v3", ""),
    row(
        "joint",
        "name=JOINT class=@CLASS type=hinge|slide|ball|free pos=v3 axis=v3 range=v2 limited=true|false|auto \
            stiffness=n damping=n armature=n frictionloss=n springref=n springyield=n ref=n margin=n springdamper=v2 solreflimit=v2 \
            solimplimit=v5 solreffriction=v2 solimpfriction=v5 actuatorfrcrange=v2 actuatorfrclimited=b \
            actuatorgravcomp=b group=i user=v2 joint1=@JOINT joint2=@JOINT polycoef=v5 active=b solref=v2 solimp=v5 joint=@JOINT coef=n",
        "",
    ),
    row("freejoint", "name=JOINT group=i align=true|false|auto", ""),
    row(
        "geom",
        "name=GEOM class=@CLASS type=plane|sphere|capsule|ellipsoid|cylinder|box|mesh|hfield|sdf size=v3 \
            fromto=v6 mass=n density=n friction=v3 condim=i contype=i conaffinity=i group=i priority=i margin=n gap=n \
            solref=v2 solimp=v5 solmix=n pos=v3 quat=v4 euler=v3 axisangle=v4 xyaxes=v6 zaxis=v3 mesh=@MESH geom=@GEOM sidesite=@SITE \
            hfield=@HFIELD material=@MATERIAL rgba=v4 shellinertia=b fluidshape=none|ellipsoid fluidcoef=v5 user=v3",
        "plugin",
    ),
    row("site", "name=SITE class=@CLASS type=sphere|box size=v3 fromto=v6 group=i site=@SITE", ""),
    row("camera", "name=t mode=fixed|track fovy=n target=@BODY pos=v3 xyaxes=v6", ""),
    row("light", "name=t mode=fixed dir=v3 pos=v3 target=@BODY directional=b", ""),
    row("composite", "type=cable|grid|particle count=v3 size=v3 prefix=t", "geom joint"),
    row("flexcomp", "name=t type=grid count=v3 spacing=v3 dim=i file=f", ""),
    row("contact", "", "pair exclude"),
    row(
        "pair",
        "name=t class=@CLASS geom1=@GEOM geom2=@GEOM condim=i friction=v5 solref=v2 solreffriction=v2 \
            solimp=v5 margin=n gap=n",
        "",
    ),
    row("exclude", "name=t body1=@BODY body2=@BODY", ""),
    row("actuator", "", ACTUATORS),
    row(
        "motor",
        "name=ACTUATOR class=@CLASS joint=@JOINT jointinparent=@JOINT site=@SITE tendon=@TENDON gear=v6 ctrlrange=v2 \
            ctrllimited=true|false|auto forcerange=v2 forcelimited=b group=i armature=n damping=n lengthrange=v2 delay=n nsample=i interp=zoh|linear|cubic \
            refsite=@SITE body=@BODY cranksite=@SITE slidersite=@SITE cranklength=n user=v2",
        "",
    ),
    row(
        "position",
        "name=ACTUATOR class=@CLASS joint=@JOINT kp=n kv=n dampratio=n timeconst=n inheritrange=n ctrlrange=v2 \
            forcerange=v2 gear=v1",
        "",
    ),
    row("velocity", "name=ACTUATOR joint=@JOINT kv=n ctrlrange=v2 gear=v1", ""),
    row(
        "general",
        "name=ACTUATOR class=@CLASS joint=@JOINT dyntype=none|integrator|filter|filterexact|muscle|user \
            gaintype=fixed|affine|muscle biastype=none|affine|muscle dynprm=v3 gainprm=v3 biasprm=v3 actlimited=b \
            actrange=v2 actdim=i actearly=b ctrlrange=v2 forcerange=v2 gear=v6 input=t",
        "",
    ),
    row("damper", "name=ACTUATOR joint=@JOINT kv=n ctrlrange=v2", ""),
    row("intvelocity", "name=ACTUATOR joint=@JOINT kp=n kv=n actrange=v2 inheritrange=n", ""),
    row(
        "pid",
        "name=ACTUATOR class=@CLASS joint=@JOINT kp=n kv=n ki=n imax=n slewmax=n input=t velrange=v2 ffrange=v2 ctrlrange=v2 nsample=i",
        "",
    ),
    row(
        "dcmotor",
        "name=ACTUATOR class=@CLASS joint=@JOINT resistance=n motorconst=v2 nominal=v3 inductance=v2 thermal=v6 saturation=v3 \
            cogging=v3 lugre=v5 controller=v6 input=t ctrlrange=v2",
        "",
    ),
    row(
        "orientation",
        "name=ACTUATOR class=@CLASS joint=@JOINT site=@SITE refsite=@SITE kp=n kv=n dampratio=n input=t forcerange=v2",
        "",
    ),
    row("cylinder", "name=ACTUATOR joint=@JOINT area=n diameter=n bias=v3", ""),
    row(
        "muscle",
        "name=ACTUATOR joint=@JOINT timeconst=v2 range=v2 force=n scale=n lmin=n lmax=n vmax=n lengthrange=v2",
        "",
    ),
    row("keyframe", "", "key"),
    row("key", "name=t time=n qpos=v7 qvel=v6 act=v2 ctrl=v2 mpos=v3 mquat=v4 plastic=v2", ""),
    row("custom", "", "numeric text tuple"),
    row("numeric", "name=t size=i data=v3", ""),
    row("text", "name=t data=t", ""),
    row("sensor", "", "jointpos gyro"),
    row("jointpos", "name=t joint=@JOINT noise=n nsample=i delay=n interval=v2 interp=zoh|linear|cubic", ""),
    row("gyro", "name=t site=@SITE", ""),
    row("equality", "", "weld connect joint tendon"),
    row(
        "tendon",
        "name=t class=@CLASS tendon1=@TENDON tendon2=@TENDON polycoef=v5 active=b solref=v2 solimp=v5 stiffness=n range=v2",
        "fixed spatial",
    ),
    row(
        "fixed",
        "name=TENDON class=@CLASS range=v2 limited=true|false|auto margin=n springlength=v2 stiffness=v3 damping=v3 armature=n \
            frictionloss=n solreflimit=v2 solimplimit=v5 solreffriction=v2 solimpfriction=v5 actuatorfrcrange=v2 \
            actuatorfrclimited=b group=i joint=@JOINT coef=n",
        "joint",
    ),
    row(
        "spatial",
        "name=TENDON class=@CLASS range=v2 limited=true|false|auto margin=n springlength=v1 stiffness=v2 damping=v1 armature=n \
            frictionloss=n width=n rgba=v4",
        "site geom pulley",
    ),
    row("pulley", "divisor=n", ""),
    row(
        "weld",
        "name=t class=@CLASS body1=@BODY body2=@BODY site1=@SITE site2=@SITE active=b relpose=v7 anchor=v3 torquescale=n \
            solref=v2 solimp=v5",
        "",
    ),
    row(
        "connect",
        "name=t class=@CLASS body1=@BODY body2=@BODY site1=@SITE site2=@SITE active=b anchor=v3 solref=v2 solimp=v5",
        "",
    ),
    row("include", "file=f", ""),
];

/// The rule of a tag.
pub fn rule(tag: &str) -> Option<&'static Rule> {
    RULES.iter().find(|rule| rule.tag == tag)
}
