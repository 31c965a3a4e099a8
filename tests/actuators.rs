//! Actuators beyond what the goldens hold: ranges of lengths, setpoints that turn, activations of worlds that stand still, and what is refused.

use crate::support;
use crate::support::{agree, load, options, parse};
use lanesim::model::ArrayData;
use lanesim::{Backend, Field, Model, Parameter, Precision, Worlds};

/// An arm whose muscles' ranges are found.
fn arm(compiler: &str) -> String {
    format!(
        "<mujoco><compiler>{compiler}</compiler><option gravity='0 0 -3'/><worldbody><body name='upper' pos='0 0 1'>
           <joint name='shoulder' axis='0 1 0' range='-80 70'/><geom type='capsule' fromto='0 0 0 0.3 0 0' size='0.03'/>
           <body name='lower' pos='0.3 0 0'><joint name='elbow' axis='0 1 0' range='-20 110'/>
             <geom type='capsule' fromto='0 0 0 0.25 0 0.05' size='0.025'/><site name='b' pos='0.1 0 0.02'/></body></body>
           <site name='w' pos='0.2 0 1.3'/></worldbody>
         <actuator><muscle joint='shoulder' gear='-0.3'/><muscle joint='elbow' lengthrange='-0.5 2'/>
           <general site='b' refsite='w' gear='0.3 0 1' biastype='muscle' biasprm='0.7 1.3 8 200 0.5 1.4 1.5 1.3 1.2'/>
           <motor joint='elbow' gear='2'/></actuator></mujoco>"
    )
}

fn ranges(model: &Model) -> Vec<f64> {
    match &model.array("actuator_lengthrange").expect("an array").data {
        ArrayData::F64(x) => x.clone(),
        ArrayData::I32(_) => panic!("not real numbers"),
    }
}

/// What MuJoCo 4.0.0 finds. A pull ends where limits and force balance, to what is left of the motion: between the sites, 1e-5 in a step.
#[test]
fn ranges_of_lengths_are_mujocos() {
    let (shoulder, between) = ([-0.366701096027, 0.418962982768], [-0.717665305723, 0.0596796354926]);
    let (given, none) = ([-0.5, 2.0], [0.0; 2]);
    let pulled = [-0.349691576492, 1.92090675927];
    let check = |compiler: &str, expected: [[f64; 2]; 4]| {
        let found = ranges(&parse(&arm(compiler)));
        agree(&found, expected.as_flattened(), 5e-5, 1.0).unwrap_or_else(|problem| panic!("{compiler}{problem}"));
    };
    check("", [shoulder, given, between, none]);
    check("<lengthrange mode='all'/>", [shoulder, given, between, [-0.699383152984, 3.84181351855]]);
    check("<lengthrange useexisting='false'/>", [shoulder, pulled, between, none]);
    check("<lengthrange mode='none'/>", [none, given, none, none]);
    let limits = [[-1.3962634016, 1.2217304764], given, between, [-0.349065850399, 1.91986217719]];
    check("<lengthrange uselimit='true' mode='all'/>", limits);
}

#[track_caller]
fn refused(text: &str, expected: &str) {
    let problem = Model::from_xml_string(text, &Default::default()).expect_err("not refused").to_string();
    assert!(problem.contains(expected), "{problem}");
}

#[test]
fn ranges_of_lengths_that_are_not_found() {
    refused(
        &arm("<lengthrange accel='5' maxforce='1' timeconst='0.2' timestep='0.005' inttotal='5' interval='1'/>"),
        "actuator #0: the range of its lengths was not found: pulled to either side, its length still went from -0.2602 to \
         -0.2105 and from ",
    );
    // A hinge without limits turns for ever.
    let free = arm("").replace(" range='-80 70'", "");
    refused(&free, "(give lengthrange, or limit the joints that it moves)");
    refused(
        &arm("<lengthrange inttotal='1e9'/>"),
        "inttotal takes 100000000000 steps of timestep (take at most 100000)",
    );
    refused(&arm("<lengthrange interval='-1'/>"), "interval is negative");
}

#[test]
fn actuators_that_cannot_be() {
    let with = |actuator: &str| {
        format!(
            "<mujoco><worldbody><site name='w'/><body name='b'><joint name='j'/><geom size='.1' pos='.3 0 0'/><site name='s'/></body>
             </worldbody><actuator>{actuator}</actuator></mujoco>"
        )
    };
    let check = |actuator: &str, expected: &str| refused(&with(actuator), expected);
    check("<motor site='x'/>", "actuator #0: site names an unknown site \"x\"");
    check("<motor site='s' refsite='ss'/>", "refsite names an unknown site \"ss\" (did you mean \"s\"?)");
    check("<motor cranksite='s' slidersite='x' cranklength='1'/>", "slidersite names an unknown site \"x\"");
    check("<motor cranksite='s' slidersite='w'/>", "cranklength 0 is no length of a rod (give a positive cranklength)");
    check("<motor cranksite='s' slidersite='w' cranklength='-1'/>", "cranklength -1 is no length of a rod");
    check("<motor site='s' armature='1'/>", "armature and damping, which act on a joint, but it acts on sites");
    check("<position site='s' refsite='w' inheritrange='1'/>", "inheritrange, but sites have no range");
    check("<general joint='j' dyntype='filter' actlimited='true'/>", "actrange is empty: 0 0");
    check("<general joint='j' dyntype='filter' actdim='2'/>", "\"actdim\": 2, but the actuator has one activation");
    check("<general joint='j' actdim='1'/>", "\"actdim\": 1, but the actuator has no activation");
    check("<general joint='j' actrange='0 1'/>", "the actuator has no activation (remove it)");
    check("<general joint='j' dyntype='user'/>", "dyntype \"user\" is not supported");
    check("<general joint='j' gaintype='user'/>", "gaintype \"user\" is not supported");
    check("<intvelocity joint='j' actrange='0 1' inheritrange='1'/>", "both actrange and inheritrange are given");
    check("<position joint='j' timeconst='-1'/>", "timeconst must not be negative");
    check("<muscle joint='j' lengthrange='0 1' tausmooth='-1'/>", "tausmooth must not be negative");
    check(
        "<muscle joint='j' lengthrange='0 1' range='1 .5'/>",
        "a muscle of the range 1 0.5 (give range as lower upper)",
    );
    check("<muscle joint='j' lengthrange='0 1' lmin='1'/>", "a muscle with lmin 1 and lmax 1.6");
    check("<muscle joint='j' lengthrange='0 1' vmax='0'/>", "a muscle with vmax 0 (give a positive vmax)");
    check("<general joint='j' gaintype='muscle' lengthrange='0 1'/>", "a muscle of the range 1 0");
    let key = with("<intvelocity joint='j'/>").replace("</mujoco>", "<keyframe><key act='1 2'/></keyframe></mujoco>");
    refused(&key, "act has 2 numbers, the model has 1");
}

/// A setpoint on a rotation is as good a turn further, whatever the state.
#[test]
fn setpoints_are_the_same_turns_apart() {
    let gear = [0.5_f64, 0.3, -0.2];
    let model = parse(
        "<mujoco><worldbody><body name='b'><joint name='j' type='ball'/><geom type='box' size='.1 .2 .3'/></body></worldbody>
         <actuator><position joint='j' gear='0.5 0.3 -0.2' kp='3'/></actuator></mujoco>",
    );
    let turn = 2.0 * std::f64::consts::PI * gear.iter().map(|x| x * x).sum::<f64>().sqrt();
    for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 1e-5)] {
        let mut worlds = Worlds::new(&model, 5, &options(precision, Backend::Auto)).expect("a batch");
        for world in 0..5 {
            worlds.set(Field::Qpos, world, &[0.8, 0.1, -0.5, 0.3]).expect("a state");
            worlds.set(Field::Ctrl, world, &[0.4 + (world as f64 - 2.0) * turn]).expect("a control");
        }
        worlds.step(20).expect("steps");
        let first = worlds.get(Field::Qvel, 0).expect("a world");
        for world in 1..5 {
            let own = worlds.get(Field::Qvel, world).expect("a world");
            agree(&own, &first, tolerance, 1.0).unwrap_or_else(|problem| panic!("world {world}{problem}"));
        }
    }
}

/// A filter under a constant control: w = u (1 - exp(-t/τ)) exactly, whatever the step.
#[test]
fn exact_filters_are_exact() {
    let model = parse(
        "<mujoco><option timestep='0.02'/><worldbody><body><joint name='j'/><geom size='.1'/></body></worldbody><actuator>
         <general joint='j' dyntype='filterexact' dynprm='0.03'/></actuator></mujoco>",
    );
    let mut worlds = Worlds::new(&model, 1, &options(Precision::F64, Backend::Auto)).expect("a batch");
    worlds.set(Field::Ctrl, 0, &[0.7]).expect("a control");
    for step in 1..=20 {
        worlds.step(1).expect("a step");
        let expected = 0.7 * (1.0 - (-0.02 * f64::from(step) / 0.03).exp());
        agree(&worlds.get(Field::Act, 0).expect("a world"), &[expected], 1e-14, 1.0).expect("the exact activation");
    }
}

/// An activation that is no number, or huge, freezes its world before the first step and names the actuator.
#[test]
fn activations_from_outside_are_looked_at() {
    let model = load("unit/activation");
    for (act, name) in [(f64::NAN, "NonFinitePos"), (1e30, "HugeValue")] {
        let mut worlds = Worlds::new(&model, 2, &options(Precision::F64, Backend::Auto)).expect("a batch");
        let mut row = worlds.get(Field::Act, 1).expect("a world");
        row[3] = act;
        worlds.set_unchecked(Field::Act, 1, &row).expect("a state");
        worlds.step(3).expect("steps");
        let names = |world| worlds.status(world).expect("a world").names();
        assert!(names(1).contains(&name), "{:?}", names(1));
        assert!(names(0).is_empty());
    }
}

/// What follows from gears and inertias is not stale: where it would be, they cannot differ between worlds.
#[test]
fn muscles_keep_their_gears() {
    let model = load("unit/muscle");
    let mut worlds = Worlds::new(&model, 2, &options(Precision::F64, Backend::Auto)).expect("a batch");
    let mut refused = |parameter: Parameter, why: &str| {
        let own = parameter.of(&model).to_vec();
        support::fails(worlds.set_parameter(parameter, 1, &own), why);
    };
    refused(Parameter::ActuatorGear, "ranges of lengths and forces of muscles follow from gears, and would be stale");
    refused(Parameter::BodyMass, "forces of muscles follow from inertias, and would be stale; give muscles a force");
    // Parameters of muscles cannot, those of what is no muscle can.
    let mut gains = Parameter::ActuatorGainprm.of(&model).to_vec();
    gains[2] = 3.0;
    support::fails(worlds.set_parameter(Parameter::ActuatorGainprm, 1, &gains), "since it has no effect");
}

/// Worlds with their own gains, biases and gears have the bits of models that were compiled with them.
#[test]
fn gains_of_activations_differ_between_worlds() {
    let text = |gain: f64, gear: f64| {
        format!(
            "<mujoco><worldbody><site name='w' pos='0 0 1'/><body><joint name='j' axis='0 1 0'/><geom size='.1' pos='.3 0 0'/>
             <site name='s' pos='.2 0 0'/></body></worldbody><actuator>
             <general site='s' refsite='w' gear='0 0 {gear} 0 0.3 0' dyntype='filter' dynprm='.1' gainprm='{gain}'/>
             <intvelocity joint='j' kp='2' kv='.1'/></actuator></mujoco>"
        )
    };
    for (precision, backend) in [(Precision::F64, Backend::Wide), (Precision::F32, Backend::Native)] {
        let (plain, other) = (parse(&text(1.5, 0.7)), parse(&text(0.4, -1.1)));
        let engine = options(precision, backend);
        let run = |worlds: &mut Worlds, world: usize| {
            worlds.set(Field::Ctrl, world, &[0.7, -0.5]).expect("controls");
            worlds.step(30).expect("steps");
            [Field::Qvel, Field::Act].map(|field| worlds.get(field, world).expect("a world"))
        };
        let mut varied = Worlds::new(&plain, 3, &engine).expect("a batch");
        for parameter in [Parameter::ActuatorGainprm, Parameter::ActuatorGear] {
            varied.set_parameter(parameter, 2, parameter.of(&other)).expect("a parameter");
        }
        let mut alone = Worlds::new(&other, 1, &engine).expect("a batch");
        assert_eq!(run(&mut varied, 2), run(&mut alone, 0), "{precision:?} {backend:?}");
    }
}
