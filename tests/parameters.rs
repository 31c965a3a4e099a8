//! Numbers of the model that differ from world to world: a world with numbers of its own has the bits of a model that was
//! compiled with them, whatever steps it and whoever is beside it; what cannot be is refused.

use std::sync::atomic::AtomicBool;

use crate::support::{Random, fails, load, load_with, parse};
use lanesim::outputs::Output;
use lanesim::rows::{Strided, Values};
use lanesim::{Backend, Controls, Error, Field, InstructionSet, Model, Options, Parameter, Precision, Rollout, Worlds};

/// Different sets of numbers; larger batches repeat them.
const DIFFERENT: usize = 5;
/// Worlds of a batch: more than two blocks of either precision, so that worlds change places.
const WORLDS: usize = 37;
const STEPS: usize = 120;

/// The numbers of one world.
#[derive(Clone)]
struct Numbers {
    gravity: [f64; 3],
    /// Of the joints: free, hinge, ball, slide, hinge.
    damping: [f64; 5],
    stiffness: [f64; 5],
    /// Of the actuators: motor, servo, affine, ball.
    gain: [[f64; 3]; 4],
    bias: [[f64; 3]; 4],
    gear: [[f64; 3]; 4],
    /// Of the geoms: floor, trunk, arm, hand, foot, toe.
    friction: [[f64; 3]; 6],
    /// Of the bodies: trunk, load, arm, hand, foot, toe, and a weight that hangs still.
    mass: [f64; 7],
    inertia: [[f64; 3]; 7],
    /// Of the joints.
    armature: [f64; 5],
}

impl Numbers {
    /// What the model is written with.
    fn nominal() -> Self {
        Numbers {
            gravity: [0.0, 0.0, -9.81],
            damping: [0.0, 0.4, 0.1, 0.3, 0.0],
            stiffness: [0.0, 2.0, 0.5, 0.0, 1.0],
            gain: [[1.0, 0.0, 0.0], [20.0, 0.0, 0.0], [3.0, 0.5, -0.2], [1.0, 0.0, 0.0]],
            bias: [[0.0; 3], [0.0, -20.0, -1.0], [0.1, 0.2, -0.3], [0.0; 3]],
            gear: [[2.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.3, 0.2, 0.1]],
            friction: [
                [1.0, 0.005, 1e-4],
                [0.6, 0.005, 1e-4],
                [0.5, 0.005, 1e-4],
                [0.9, 0.01, 1e-3],
                [0.7, 0.005, 1e-4],
                [0.3, 0.02, 2e-4],
            ],
            mass: [4.0, 0.7, 1.1, 0.5, 0.9, 0.4, 3.0],
            inertia: [
                [0.03, 0.05, 0.06],
                [0.001, 0.002, 0.002],
                [0.01, 0.01, 0.003],
                [0.002, 0.003, 0.004],
                [0.003, 0.003, 0.002],
                [0.001, 0.002, 0.0015],
                [0.1, 0.1, 0.1],
            ],
            armature: [0.0, 0.01, 0.002, 0.1, 0.0],
        }
    }

    /// Those of world `id`: the first has neither weight nor dampers nor springs.
    fn of(id: usize) -> Self {
        let mut random = Random(id as u64 + 1);
        let mut own = Numbers::nominal();
        let mut scale = |x: &mut f64| *x *= random.uniform(0.6, 1.4);
        own.damping.iter_mut().chain(&mut own.stiffness).for_each(|x| {
            *x += 0.2;
            scale(x);
        });
        own.gravity.iter_mut().for_each(&mut scale);
        for rows in [&mut own.gain, &mut own.bias, &mut own.gear] {
            rows.as_flattened_mut().iter_mut().for_each(&mut scale);
        }
        own.friction.as_flattened_mut().iter_mut().for_each(&mut scale);
        own.mass.iter_mut().for_each(&mut scale);
        own.inertia.iter_mut().for_each(|moments| {
            let mut factor = 1.0;
            scale(&mut factor);
            moments.iter_mut().for_each(|x| *x *= factor);
        });
        own.armature.iter_mut().for_each(|x| {
            *x += 0.005;
            scale(x);
        });
        if id == 0 {
            (own.gravity, own.damping, own.stiffness) = ([0.0; 3], [0.0; 5], [0.0; 5]);
            own.friction[0] = [0.0; 3];
            own.friction[1] = [0.0; 3];
        }
        own
    }

    /// Those of `self` for one parameter, the others the model's.
    fn only(&self, parameter: Parameter) -> Self {
        let mut own = Numbers::nominal();
        match parameter {
            Parameter::Gravity => own.gravity = self.gravity,
            Parameter::DofDamping => own.damping = self.damping,
            Parameter::JntStiffness => own.stiffness = self.stiffness,
            Parameter::ActuatorGainprm => own.gain = self.gain,
            Parameter::ActuatorBiasprm => own.bias = self.bias,
            Parameter::ActuatorGear => own.gear = self.gear,
            Parameter::GeomFriction => own.friction = self.friction,
            Parameter::BodyMass => own.mass = self.mass,
            Parameter::BodyInertia => own.inertia = self.inertia,
            Parameter::DofArmature => own.armature = self.armature,
            _ => unreachable!("{parameter:?} is not one of this model's"),
        }
        own
    }

    /// The row of a parameter.
    fn row(&self, parameter: Parameter) -> Vec<f64> {
        let dofs = |[free, hinge, ball, slide, last]: [f64; 5]| {
            [&[free; 6][..], &[hinge], &[ball; 3], &[slide, last]].concat()
        };
        let ten = |rows: [[f64; 3]; 4]| rows.map(|[a, b, c]| [a, b, c, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]).concat();
        match parameter {
            Parameter::Gravity => self.gravity.to_vec(),
            Parameter::DofDamping => dofs(self.damping),
            Parameter::DofArmature => dofs(self.armature),
            Parameter::BodyMass => [&[0.0][..], &self.mass].concat(),
            Parameter::BodyInertia => [&[0.0; 3][..], self.inertia.as_flattened()].concat(),
            Parameter::JntStiffness => self.stiffness.to_vec(),
            Parameter::ActuatorGainprm => ten(self.gain),
            Parameter::ActuatorBiasprm => ten(self.bias),
            Parameter::ActuatorGear => self.gear.iter().flat_map(|[a, b, c]| [*a, *b, *c, 0.0, 0.0, 0.0]).collect(),
            Parameter::GeomFriction => self.friction.as_flattened().to_vec(),
            _ => unreachable!("{parameter:?} is not one of this model's"),
        }
    }

    /// A trunk that falls on a floor, with an arm whose hand can touch it, and a foot beside it.
    fn model(&self, options: &str) -> Model {
        let list = |x: &[f64]| x.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(" ");
        let [d0, d1, d2, d3, d4] = self.damping;
        let [s0, s1, s2, s3, s4] = self.stiffness;
        let [a0, a1, a2, a3, a4] = self.armature;
        let places = [".01 0 .02", "0 .01 0", "0 0 .1", ".02 0 0", "0 0 -.1", "0 .1 0", "0 0 0"];
        let inertial = |b: usize| {
            let (mass, moments) = (self.mass[b], list(&self.inertia[b]));
            format!("<inertial pos='{}' mass='{mass:?}' diaginertia='{moments}'/>", places[b])
        };
        let f = self.friction.map(|f| list(&f));
        let [g, b, r] = [&self.gain, &self.bias, &self.gear].map(|rows| rows.each_ref().map(|row| list(row)));
        parse(&format!(
            "<mujoco><option gravity='{gravity}' {options}/>
            <worldbody>
              <geom name='floor' type='plane' size='5 5 1' friction='{f0}'/>
              <body pos='0 0 .3' gravcomp='.2'>{i0}
                <joint type='free' armature='{a0:?}' damping='{d0:?}' stiffness='{s0:?}'/>
                <geom name='trunk' type='capsule' size='.08 .15' euler='0 90 0' friction='{f1}'/>
                <body pos='0 -.1 .05' euler='20 30 0' gravcomp='.1'>{i1}</body>
                <body pos='.25 0 0'>{i2}
                  <joint name='elbow' axis='0 1 0' armature='{a1:?}' damping='{d1:?}' stiffness='{s1:?}' range='-100 100'/>
                  <geom name='arm' type='capsule' size='.04 .1' pos='0 0 .1' friction='{f2}'/>
                  <body pos='0 0 .25'>{i3}
                    <joint name='wrist' type='ball' armature='{a2:?}' damping='{d2:?}' stiffness='{s2:?}'/>
                    <geom name='hand' size='.06' pos='.02 0 0' friction='{f3}' condim='4'/>
                  </body>
                </body>
                <body pos='-.2 .1 0'>{i4}
                  <joint name='leg' type='slide' axis='0 0 1' armature='{a3:?}' damping='{d3:?}' stiffness='{s3:?}' range='-.1 .1' limited='true'/>
                  <geom name='foot' size='.07' pos='0 0 -.1' friction='{f4}' priority='1'/>
                  <body pos='0 .1 -.1'>{i5}
                    <joint name='toe' axis='1 0 0' frictionloss='.02' armature='{a4:?}' damping='{d4:?}' stiffness='{s4:?}'/>
                    <geom name='toe' size='.05' pos='0 .1 0' friction='{f5}'/>
                  </body>
                </body>
              </body>
              <body pos='3 0 2'>{i6}</body>
            </worldbody>
            <contact><pair geom1='toe' geom2='hand' friction='.4 .4 .01 .001 .001'/></contact>
            <actuator>
              <general joint='elbow' gainprm='{g0}' gear='{r0}' ctrlrange='-1 1'/>
              <general joint='leg' gainprm='{g1}' biastype='affine' biasprm='{b1}' gear='{r1}' ctrlrange='-.1 .1'/>
              <general joint='toe' gaintype='affine' gainprm='{g2}' biastype='affine' biasprm='{b2}' gear='{r2}' ctrlrange='-1 1'/>
              <general joint='wrist' gainprm='{g3}' gear='{r3}' ctrlrange='-1 1'/>
            </actuator></mujoco>",
            gravity = list(&self.gravity),
            f0 = f[0], f1 = f[1], f2 = f[2], f3 = f[3], f4 = f[4], f5 = f[5],
            g0 = g[0], g1 = g[1], g2 = g[2], g3 = g[3],
            b1 = b[1], b2 = b[2],
            r0 = r[0], r1 = r[1], r2 = r[2], r3 = r[3],
            i0 = inertial(0), i1 = inertial(1), i2 = inertial(2), i3 = inertial(3), i4 = inertial(4), i5 = inertial(5),
            i6 = inertial(6),
        ))
    }
}

/// Those that this model has; `tests/elements.rs` has the others.
fn all() -> Vec<Parameter> {
    Parameter::ALL[..10].iter().map(|(parameter, _)| *parameter).collect()
}

pub(crate) fn options(precision: Precision, backend: Backend) -> Options {
    Options { precision, backend, threads: Some(2), ..Options::default() }
}

/// Everything that can step worlds.
pub(crate) fn engines(precision: Precision) -> Vec<Options> {
    let native = [InstructionSet::Avx512, InstructionSet::Avx2].into_iter().filter(|set| set.check().is_ok());
    let native = native.map(|set| Options { instructions: Some(set), ..options(precision, Backend::Native) });
    [Backend::Wide, Backend::Scalar].map(|backend| options(precision, backend)).into_iter().chain(native).collect()
}

/// Bits of what the worlds of the given ids do under their own controls: one row per world. They start apart, and fall.
pub(crate) fn run(worlds: &mut Worlds, ids: &[usize]) -> Vec<Vec<u64>> {
    let model = worlds.model().clone();
    let sizes = &model.tables().sizes;
    let mut controls = Vec::new();
    for (world, id) in ids.iter().enumerate() {
        let mut random = Random(*id as u64 + 100);
        let mut qpos = model.initial_key().qpos;
        qpos.iter_mut().for_each(|q| *q += random.uniform(-0.1, 0.1));
        worlds.set(Field::Qpos, world, &qpos).expect("a state");
        worlds.set(Field::Qvel, world, &random.vector(sizes.nv, 0.5)).expect("a state");
        controls.extend(random.vector(sizes.nu * STEPS, 1.0));
    }
    let names = ["qpos", "qvel", "ncon", "energy", "qfrc_passive", "status"];
    let outputs = names.map(|name| Output::named(name).expect("an output"));
    let controls = Controls::Given(&controls);
    let rollout = Rollout { nstep: STEPS, controls, outputs: &outputs[..2], ..Rollout::default() };
    let mut rows = worlds.rollout(&rollout).expect("a rollout").outputs;
    let mut last = vec![Vec::new(); outputs.len()];
    worlds
        .forward(&outputs, &mut |_, lists| last.iter_mut().zip(lists).for_each(|(all, own)| all.extend(own)))
        .expect("outputs");
    rows.extend(last);
    let of_world = |world: usize| {
        let part = |values: &Vec<f64>| {
            let width = values.len() / ids.len();
            values[world * width..][..width].iter().map(|x| (x + 0.0).to_bits()).collect::<Vec<_>>()
        };
        rows.iter().flat_map(part).collect()
    };
    (0..ids.len()).map(of_world).collect()
}

/// What a model does that is compiled with the numbers of a world.
fn compiled(numbers: &Numbers, id: usize, text: &str, engine: &Options) -> Vec<u64> {
    let mut worlds = Worlds::new(&numbers.model(text), 1, engine).expect("a batch");
    run(&mut worlds, &[id]).remove(0)
}

/// Worlds that have the parameters of their own do what models do that are compiled with them.
#[track_caller]
fn assert_compiled(parameters: &[Parameter], text: &str, engine: &Options) {
    let ids: Vec<usize> = (0..WORLDS).map(|world| world * 7 % DIFFERENT).collect();
    let numbers = |id: usize| match parameters {
        [one] => Numbers::of(id).only(*one),
        _ => Numbers::of(id),
    };
    let mut worlds = Worlds::new(&Numbers::nominal().model(text), WORLDS, engine).expect("a batch");
    for parameter in parameters {
        let rows: Vec<f64> = ids.iter().flat_map(|id| numbers(*id).row(*parameter)).collect();
        let rows = Strided::new(Values::F64(&rows), rows.len() / WORLDS);
        worlds.set_parameters(*parameter, &rows, None).expect("parameters");
    }
    let got = run(&mut worlds, &ids);
    for id in 0..DIFFERENT {
        let expected = compiled(&numbers(id), id, text, engine);
        for (world, _) in ids.iter().enumerate().filter(|(_, own)| **own == id) {
            let same = got[world].iter().zip(&expected).position(|(a, b)| a != b);
            assert_eq!(same, None, "{parameters:?} of world {world}, numbers {id}, {engine:?}");
        }
    }
}

#[test]
fn worlds_do_what_compiled_models_do() {
    for precision in [Precision::F64, Precision::F32] {
        for engine in engines(precision) {
            assert_compiled(&all(), "", &engine);
        }
    }
}

#[test]
fn each_parameter_may_vary_alone() {
    for parameter in all() {
        for precision in [Precision::F64, Precision::F32] {
            assert_compiled(&[parameter], "", &options(precision, Backend::Auto));
        }
    }
}

#[test]
fn whatever_the_solver_the_cone_and_the_integrator() {
    let solvers = ["solver='PGS'", "solver='CG'", "cone='elliptic'", "cone='elliptic' noslip_iterations='3'"];
    let integrators =
        ["integrator='RK4'", "integrator='implicitfast'", "integrator='implicit'", "integrator='discrete'"];
    for text in solvers.into_iter().chain(integrators) {
        for backend in [Backend::Wide, Backend::Native] {
            assert_compiled(&all(), text, &options(Precision::F64, backend));
        }
    }
}

/// Of a planar model most products of inertia are zero whatever bodies weigh; of a body whose moments are equal by chance,
/// they are not.
#[test]
fn products_of_inertia_that_are_zero_by_chance_may_vary() {
    let model = |mass: [f64; 3], moments: [[f64; 3]; 3]| {
        let inertial = |b: usize| {
            let [x, y, z] = moments[b];
            format!("mass='{:?}' diaginertia='{x:?} {y:?} {z:?}'", mass[b])
        };
        parse(&format!(
            "<mujoco><worldbody><body pos='0 0 1'>
               <joint type='slide' axis='1 0 0'/><joint type='slide' axis='0 0 1'/><joint axis='0 1 0'/>
               <inertial pos='.1 0 .02' euler='0 25 0' {}/>
               <body pos='.2 0 0'><joint axis='0 1 0' range='-40 40'/>
                 <inertial pos='0 0 -.2' euler='0 0 45' {}/>
                 <body pos='0 0 .1'><inertial pos='.03 0 .1' {}/></body>
               </body>
             </body></worldbody></mujoco>",
            inertial(0),
            inertial(1),
            inertial(2),
        ))
    };
    let (mass, moments) = ([2.0, 1.0, 0.5], [[0.03, 0.04, 0.02], [0.02, 0.02, 0.03], [0.01, 0.02, 0.02]]);
    let other = ([1.5, 1.2, 0.9], [[0.02, 0.03, 0.03], [0.015, 0.025, 0.03], [0.02, 0.02, 0.01]]);
    for precision in [Precision::F64, Precision::F32] {
        for engine in engines(precision) {
            let mut worlds = Worlds::new(&model(mass, moments), 2, &engine).expect("a batch");
            let row = |first: &[f64], rest: &[f64]| [first, rest].concat();
            worlds.set_parameter(Parameter::BodyMass, 1, &row(&[0.0], &other.0)).expect("masses");
            worlds.set_parameter(Parameter::BodyInertia, 1, &row(&[0.0; 3], other.1.as_flattened())).expect("moments");
            let got = run(&mut worlds, &[0, 1]);
            for (world, (mass, moments)) in [(mass, moments), other].into_iter().enumerate() {
                let mut alone = Worlds::new(&model(mass, moments), 1, &engine).expect("a batch");
                assert!(got[world] == run(&mut alone, &[world])[0], "world {world}, {engine:?}");
            }
        }
    }
}

/// The model's own numbers change nothing, and neither does a world that has others.
#[test]
fn own_numbers_change_nothing() {
    let model = Numbers::nominal().model("");
    for precision in [Precision::F64, Precision::F32] {
        let engine = options(precision, Backend::Auto);
        let ids: Vec<usize> = (0..WORLDS).collect();
        let mut plain = Worlds::new(&model, WORLDS, &engine).expect("a batch");
        let mut varied = Worlds::new(&model, WORLDS, &engine).expect("a batch");
        for parameter in all() {
            varied.set_parameter(parameter, 3, &Numbers::of(1).row(parameter)).expect("a parameter");
            assert_eq!(varied.parameter(parameter, 3).expect("a world"), Numbers::of(1).row(parameter));
            assert_eq!(varied.parameter(parameter, 2).expect("a world"), parameter.of(&model));
        }
        let (plain, varied) = (run(&mut plain, &ids), run(&mut varied, &ids));
        for world in 0..WORLDS {
            assert_eq!(plain[world] == varied[world], world != 3, "world {world}");
        }
    }
}

/// Numbers may be set anew at any time; a mask says where, and a reset leaves them alone.
#[test]
fn parameters_are_set_where_the_mask_says() {
    let model = Numbers::nominal().model("");
    let mut worlds = Worlds::new(&model, 3, &options(Precision::F32, Backend::Auto)).expect("a batch");
    assert_eq!(worlds.varying().count(), 0);
    let before = worlds.memory().0;
    let moon = [0.0, 0.0, -1.62];
    let rows = Strided::new(Values::F64(&moon), 3);
    worlds.set_parameters(Parameter::Gravity, &rows, Some(&[true, false, true])).expect("parameters");
    worlds.reset_all(None, None).expect("a reset");
    let got = [0, 1, 2].map(|world| worlds.parameter(Parameter::Gravity, world).expect("a world")[2]);
    assert_eq!(got, [-1.62, -9.81, -1.62]);
    assert_eq!(worlds.varying().collect::<Vec<_>>(), [Parameter::Gravity]);
    // Four lanes of four bytes (with the potential of what stands still), three numbers of eight, and per block the heads of 28 lists.
    let more = worlds.memory().0 - before;
    assert!((16 + 24..16 + 24 + 50).contains(&more), "{more} bytes");
}

#[test]
fn impossible_numbers_are_named() {
    fails(Parameter::named("body_color"), "body_color cannot differ between worlds; valid: gravity, dof_damping");
    fails(Parameter::named("body_ipos"), "inverse weights of limits and contacts and the mean inertia follow from it");
    let mut worlds = Worlds::new(&Numbers::nominal().model(""), 3, &Options::default()).expect("a batch");
    fails(worlds.set_parameter(Parameter::Gravity, 3, &[0.0; 3]), "there is no world 3: the batch has 3");
    fails(worlds.set_parameter(Parameter::Gravity, 1, &[0.0; 2]), "gravity has 2 numbers; expected 3");
    let rows = Strided::new(Values::F64(&[1.0; 7]), 3);
    fails(worlds.set_parameters(Parameter::Gravity, &rows, None), "gravity has 7 numbers; expected 9 = nworld 3 × 3");
    let rows = Strided::new(Values::F64(&[1.0; 9]), 3);
    fails(worlds.set_parameters(Parameter::Gravity, &rows, Some(&[true])), "the mask has 1 entries");
    let nan = worlds.set_parameter(Parameter::Gravity, 1, &[0.0, f64::NAN, 0.0]);
    fails(nan, "gravity[1] of world 1 is NaN; expected a finite number");
    let mut damping = [0.1; 12];
    damping[7] = -1.0;
    let negative = worlds.set_parameter(Parameter::DofDamping, 1, &damping);
    fails(negative, "dof_damping[7] of world 1 is -1; expected a number that is not negative");
    let mut gain = Parameter::ActuatorGainprm.of(worlds.model()).to_vec();
    gain[2] = 0.5;
    let unused = worlds.set_parameter(Parameter::ActuatorGainprm, 2, &gain);
    fails(unused, "actuator_gainprm[2] of world 2 is 0.5; expected the model's 0, since it has no effect");
    assert_eq!(worlds.varying().count(), 0, "what is refused does not vary");
    let mut mass = Parameter::BodyMass.of(worlds.model()).to_vec();
    mass[0] = 1.0;
    let still = worlds.set_parameter(Parameter::BodyMass, 0, &mass);
    fails(still, "body_mass[0] of world 0 is 1; expected 0, as in the model");
    (mass[0], mass[2]) = (0.0, 0.0);
    let light = worlds.set_parameter(Parameter::BodyMass, 0, &mass);
    fails(light, "body_mass[2] of world 0 is 0; expected a positive number");
    let mut inertia = Parameter::BodyInertia.of(worlds.model()).to_vec();
    inertia[5] *= 10.0;
    let thin = worlds.set_parameter(Parameter::BodyInertia, 0, &inertia);
    fails(thin, "expected moments A, B, C with A + B >= C");
    assert_eq!(worlds.varying().count(), 0, "what is refused does not vary");
    let single = Options { precision: Precision::F32, ..Options::default() };
    let mut worlds = Worlds::new(&Numbers::nominal().model(""), 3, &single).expect("a batch");
    let huge = worlds.set_parameter(Parameter::Gravity, 0, &[0.0, 0.0, 1e40]);
    fails(huge, "gravity[2] of world 0 is 1000");
}

#[test]
fn what_would_be_stale_or_without_effect_is_refused() {
    let refused = |model: &Model, parameter: Parameter, why: &str| {
        let mut worlds = Worlds::new(model, 2, &Options::default()).expect("a batch");
        let own = parameter.of(model).to_vec();
        fails(
            worlds.set_parameter(parameter, 0, &own),
            &format!("{}: {why}", "cannot differ between worlds of this model"),
        );
    };
    let off = load_with("zoo/hopper", &[("gravity", "0 0 0")]);
    let mut worlds = Worlds::new(&off, 1, &Options::default()).expect("a batch");
    worlds.set_parameter(Parameter::Gravity, 0, &[0.0, 0.0, -9.81]).expect("weight where there was none");
    let body = "<worldbody><body><joint name='j' damping='1' stiffness='1'/><geom size='.1'/></body></worldbody>";
    let flag = |flag: &str| parse(&format!("<mujoco><option><flag {flag}='disable'/></option>{body}</mujoco>"));
    refused(&flag("gravity"), Parameter::Gravity, "the flag gravity is off");
    refused(&flag("damper"), Parameter::DofDamping, "the flag damper is off");
    refused(&flag("spring"), Parameter::JntStiffness, "the flag spring is off");
    refused(&flag("gravity"), Parameter::ActuatorGear, "it has none");
    refused(&flag("gravity"), Parameter::GeomFriction, "no contact has the numbers of its geoms");
    let driven = |actuator: &str| parse(&format!("<mujoco>{body}<actuator>{actuator}</actuator></mujoco>"));
    refused(&driven("<motor joint='j'/>"), Parameter::ActuatorBiasprm, "no actuator has a bias");
    let reflected = driven("<motor joint='j' gear='2' armature='.1'/>");
    refused(&reflected, Parameter::ActuatorGear, "armature and damping of actuators act on joints through the gear");
    let ratio = driven("<position joint='j' kp='5' dampratio='1'/>");
    refused(&ratio, Parameter::ActuatorGear, "dampratio derives biases from gears");
    refused(&ratio, Parameter::ActuatorGainprm, "dampratio derives biases from gains");
    refused(&ratio, Parameter::BodyMass, "dampratio derives biases from inertias");
    let sprung =
        parse("<mujoco><worldbody><body><joint springdamper='1 1'/><geom size='.1'/></body></worldbody></mujoco>");
    refused(&sprung, Parameter::DofArmature, "springdamper derives stiffness and damping from inertias");
    let mut worlds = Worlds::new(&ratio, 1, &Options::default()).expect("a batch");
    for parameter in [Parameter::ActuatorBiasprm, Parameter::ActuatorGainprm] {
        worlds.set_parameter(parameter, 0, parameter.of(&ratio)).expect("a bias of its own, then a gain");
    }
}

/// Outputs that depend on masses have those of their world.
#[test]
fn outputs_have_the_worlds_masses() {
    let outputs = ["subtree_com", "energy", "qM"].map(|name| Output::named(name).expect("an output"));
    let read = |worlds: &mut Worlds| {
        let mut last = Vec::new();
        worlds.forward(&outputs, &mut |_, lists| last = lists).expect("outputs");
        last
    };
    let (nominal, own) = (Numbers::nominal(), Numbers::of(2).only(Parameter::BodyMass));
    let mut worlds = Worlds::new(&nominal.model(""), 2, &Options::default()).expect("a batch");
    worlds.set_parameter(Parameter::BodyMass, 1, &own.row(Parameter::BodyMass)).expect("masses");
    let mut alone = Worlds::new(&own.model(""), 1, &Options::default()).expect("a batch");
    assert_eq!(read(&mut worlds), read(&mut alone));
}

/// Damping that actuators add to a joint's own stays.
#[test]
fn damping_of_actuators_is_kept() {
    let model = |damping: f64| {
        parse(&format!(
            "<mujoco><worldbody><body><joint name='j' axis='0 1 0' damping='{damping:?}'/><geom size='.1' pos='.3 0 0'/></body>
            </worldbody><actuator><motor joint='j' gear='3' damping='.07'/></actuator></mujoco>"
        ))
    };
    let step = |worlds: &mut Worlds| {
        worlds.set(Field::Qvel, 0, &[2.0]).expect("a state");
        worlds.step(50).expect("steps");
        worlds.state_hash()
    };
    let mut varied = Worlds::new(&model(0.3), 1, &Options::default()).expect("a batch");
    varied.set_parameter(Parameter::DofDamping, 0, &[0.9]).expect("damping");
    let mut compiled = Worlds::new(&model(0.9), 1, &Options::default()).expect("a batch");
    assert_eq!(step(&mut varied), step(&mut compiled));
}

/// Models of the zoo: their own numbers, scaled, step without trouble and differ from the original.
#[test]
fn models_of_the_zoo_can_vary() {
    for name in ["zoo/ant", "zoo/hopper", "zoo/cartpole"] {
        let model = load(name);
        let mut worlds = Worlds::new(&model, 20, &options(Precision::F32, Backend::Auto)).expect("a batch");
        let mut random = Random(3);
        for parameter in all() {
            let own = parameter.of(&model);
            let rows: Vec<f64> =
                (0..20).map(|_| random.uniform(0.8, 1.2)).flat_map(|s| own.iter().map(move |x| s * x)).collect();
            if worlds.set_parameters(parameter, &Strided::new(Values::F64(&rows), own.len()), None).is_err() {
                assert!(parameter != Parameter::Gravity, "{name}");
            }
        }
        worlds
            .rollout(&Rollout { nstep: 100, controls: Controls::Noise { seed: 1, scale: 1.0 }, ..Rollout::default() })
            .expect("a rollout");
        assert_eq!(worlds.lost(), 0, "{name}");
        let qpos = worlds.get_all(Field::Qpos);
        assert!(qpos.chunks(qpos.len() / 20).skip(1).all(|row| row != &qpos[..qpos.len() / 20]), "{name}");
    }
}

#[test]
fn setting_parameters_stops_when_it_is_told_to() {
    let model = Model::from_xml_path("models/zoo/ant.xml".as_ref(), &Default::default()).expect("a model");
    let mut worlds = Worlds::new(&model, 3, &Options::default()).expect("a batch");
    let numbers = [0.0, 0.0, -1.62];
    let rows = Strided::new(Values::F64(&numbers), 3);
    let result = worlds.set_parameters_until(Parameter::Gravity, &rows, None, &AtomicBool::new(true));
    assert!(matches!(result, Err(Error::Cancelled)), "{result:?}");
    assert_eq!(worlds.parameter(Parameter::Gravity, 0).expect("gravity"), [0.0, 0.0, -9.81]);
}
