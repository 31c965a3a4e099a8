//! Parameters of limits, springs, tendons, activations and contacts: a world with numbers of its own has the bits of a model that was
//! compiled with them; what cannot be is refused.

use crate::parameters::{engines, options, run};
use crate::support::{Random, fails, parse};
use lanesim::rows::{Strided, Values};
use lanesim::{Backend, Model, Parameter, Precision, Worlds};

/// Different sets of numbers; larger batches repeat them.
const DIFFERENT: usize = 4;
/// Worlds of a batch: more than two blocks of either precision.
const WORLDS: usize = 35;

/// Rows of parameters, as the model is written with them. Joints: free, hinge, ball, slide; geoms: floor, ball, arm, hand.
const NOMINAL: [(Parameter, &[f64]); 18] = [
    (Parameter::DofFrictionloss, &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.3]),
    (Parameter::QposSpring, &[0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0, 0.01]),
    (Parameter::JntRange, &[0.0, 0.0, -0.4, 0.5, 0.0, 0.6, -0.05, 0.06]),
    (Parameter::JntSolref, &[0.02, 1.0, 0.03, 0.9, 0.025, 1.1, -900.0, -40.0]),
    (
        Parameter::JntSolimp,
        &[
            0.9, 0.95, 0.001, 0.5, 2.0, 0.8, 0.95, 0.01, 0.4, 3.0, 0.85, 0.9, 0.002, 0.5, 2.0, 0.9, 0.95, 0.003, 0.5,
            1.0,
        ],
    ),
    (Parameter::TendonStiffness, &[40.0, 0.0]),
    (Parameter::TendonDamping, &[0.7, 0.0]),
    (Parameter::TendonLengthspring, &[0.02, 0.05, 0.0, 0.0]),
    (Parameter::TendonFrictionloss, &[0.2, 0.0]),
    (Parameter::TendonRange, &[-0.06, 0.07, 0.0, 0.0]),
    (Parameter::TendonSolref, &[0.02, 1.0, 0.02, 1.0]),
    (Parameter::TendonSolimp, &[0.9, 0.95, 0.002, 0.5, 2.0, 0.9, 0.95, 0.001, 0.5, 2.0]),
    (Parameter::ActuatorForcerange, &[-0.5, 0.6, -2.0, 3.0, 0.0, 0.0]),
    (Parameter::ActuatorCtrlrange, &[-0.7, 0.8, -0.3, 0.2, 0.0, 1.0]),
    (
        Parameter::ActuatorDynprm,
        &[
            1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01,
            0.04, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        ],
    ),
    (Parameter::GeomSolref, &[0.02, 1.0, 0.03, 0.8, 0.015, 1.2, -2000.0, -60.0]),
    (
        Parameter::GeomSolimp,
        &[
            0.9, 0.95, 0.001, 0.5, 2.0, 0.8, 0.9, 0.002, 0.5, 2.0, 0.9, 0.97, 0.004, 0.5, 2.0, 0.85, 0.95, 0.001, 0.5,
            2.0,
        ],
    ),
    (Parameter::GeomMargin, &[0.004, 0.002, 0.006, 0.001]),
];

/// Margin and gap of each geom together.
const INCLUDE: f64 = 0.03;

/// Rows of a world.
#[derive(Clone)]
struct Numbers(Vec<(Parameter, Vec<f64>)>);

impl Numbers {
    fn nominal() -> Self {
        Numbers(NOMINAL.iter().map(|(parameter, row)| (*parameter, row.to_vec())).collect())
    }

    /// Those of world `id`; of `only` some parameters, the others the model's.
    fn of(id: usize, only: &[Parameter]) -> Self {
        let mut own = Numbers::nominal();
        let mut random = Random(id as u64 + 7);
        let counted = |parameter: Parameter, i: usize| match parameter {
            // A limit of a rotation has one end; powers are those of the model.
            Parameter::JntSolimp | Parameter::TendonSolimp | Parameter::GeomSolimp => i % 5 < 4,
            Parameter::JntSolref => i > 1,
            _ => true,
        };
        for (parameter, row) in &mut own.0 {
            let nominal = row.clone();
            let mut scaled: Vec<f64> = nominal
                .iter()
                .enumerate()
                .map(|(i, x)| if counted(*parameter, i) { x * random.uniform(0.6, 1.3) } else { *x })
                .collect();
            match parameter {
                // Impedances are shares, and those of a free joint and of an unlimited tendon have no effect.
                Parameter::JntSolimp | Parameter::TendonSolimp | Parameter::GeomSolimp => {
                    for (x, (i, old)) in scaled.iter_mut().zip(nominal.iter().enumerate()) {
                        if i % 5 < 2 {
                            *x = old + (*x - old) * 0.1;
                        }
                    }
                    match parameter {
                        Parameter::JntSolimp => scaled[..5].copy_from_slice(&nominal[..5]),
                        Parameter::TendonSolimp => scaled[5..].copy_from_slice(&nominal[5..]),
                        _ => {}
                    }
                }
                Parameter::TendonSolref => scaled[2..].copy_from_slice(&nominal[2..]),
                // Where the free and the ball joint rest is where they are in the reference configuration.
                Parameter::QposSpring => {
                    for at in [0..7, 8..12] {
                        scaled[at.clone()].copy_from_slice(&nominal[at]);
                    }
                }
                // What has no effect.
                Parameter::ActuatorDynprm => scaled[0] = nominal[0],
                _ => {}
            }
            if only.contains(parameter) {
                *row = scaled;
            }
        }
        own
    }

    fn row(&self, parameter: Parameter) -> &[f64] {
        &self.0.iter().find(|(own, _)| *own == parameter).expect("one of the model's").1
    }

    /// The model that is written with them.
    fn model(&self, text: &str) -> Model {
        let at = |parameter: Parameter, width: usize, i: usize| {
            let row = &self.row(parameter)[width * i..width * (i + 1)];
            row.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(" ")
        };
        let geom = |i: usize| {
            let margin = self.row(Parameter::GeomMargin)[i];
            let (solref, solimp) = (at(Parameter::GeomSolref, 2, i), at(Parameter::GeomSolimp, 5, i));
            let gap = INCLUDE - margin;
            format!("solref='{solref}' solimp='{solimp}' margin='{margin:?}' gap='{gap:?}'")
        };
        let limit = |i: usize| {
            let (range, solref) = (at(Parameter::JntRange, 2, i), at(Parameter::JntSolref, 2, i));
            let solimp = at(Parameter::JntSolimp, 5, i);
            format!("range='{range}' solreflimit='{solref}' solimplimit='{solimp}'")
        };
        let [loss, rest] = [Parameter::DofFrictionloss, Parameter::QposSpring].map(|parameter| self.row(parameter));
        let tendon = |parameter: Parameter, width: usize| at(parameter, width, 0);
        let actuator = |i: usize| {
            format!(
                "ctrlrange='{}' forcerange='{}'",
                at(Parameter::ActuatorCtrlrange, 2, i),
                at(Parameter::ActuatorForcerange, 2, i)
            )
        };
        let time = |i: usize| self.row(Parameter::ActuatorDynprm)[10 * (1 + i / 2) + i % 2];
        parse(&format!(
            "<mujoco><compiler angle='radian'/><option {text}/>
            <worldbody>
              <geom type='plane' size='5 5 1' {g0}/>
              <body pos='0 0 .3'><joint type='free' stiffness='.4'/><geom size='.1' mass='1' {g1}/>
                <body pos='.15 0 0'>
                  <joint name='hinge' axis='0 1 0' stiffness='1.5' springref='{s0:?}' frictionloss='{l0:?}' {r1}/>
                  <geom type='capsule' size='.03 .1' pos='0 0 -.1' mass='.4' {g2}/>
                  <body pos='0 0 -.2'>
                    <inertial pos='0 0 0' mass='.1' diaginertia='.001 .001 .001'/>
                    <joint name='ball' type='ball' stiffness='.3' {r2}/>
                    <body><joint name='slide' type='slide' axis='0 0 1' stiffness='30' springref='{s1:?}' frictionloss='{l1:?}' {r3}/>
                      <geom size='.05' mass='.3' {g3}/>
                    </body>
                  </body>
                </body>
              </body>
            </worldbody>
            <tendon>
              <fixed name='belt' stiffness='{tk}' damping='{td}' springlength='{tl}' frictionloss='{tf}' range='{tr}'
                solreflimit='{ts}' solimplimit='{ti}'><joint joint='hinge' coef='.1'/><joint joint='slide' coef='.9'/></fixed>
              <fixed name='other' springlength='0 0'><joint joint='hinge' coef='.2'/></fixed>
            </tendon>
            <actuator>
              <general joint='hinge' {a0}/>
              <general joint='slide' dyntype='filter' dynprm='{t0:?}' gainprm='30' biastype='affine' biasprm='0 -30 -1' {a1}/>
              <muscle tendon='other' lengthrange='-.2 .2' force='2' timeconst='{t2:?} {t3:?}' ctrlrange='{c2}'/>
            </actuator></mujoco>",
            g0 = geom(0), g1 = geom(1), g2 = geom(2), g3 = geom(3),
            s0 = rest[7], s1 = rest[12], l0 = loss[6], l1 = loss[10],
            r1 = limit(1), r2 = limit(2), r3 = limit(3),
            tk = tendon(Parameter::TendonStiffness, 1), td = tendon(Parameter::TendonDamping, 1),
            tl = tendon(Parameter::TendonLengthspring, 2), tf = tendon(Parameter::TendonFrictionloss, 1),
            tr = tendon(Parameter::TendonRange, 2), ts = tendon(Parameter::TendonSolref, 2),
            ti = tendon(Parameter::TendonSolimp, 5),
            a0 = actuator(0), a1 = actuator(1),
            t0 = time(0), t2 = time(2), t3 = time(3),
            c2 = at(Parameter::ActuatorCtrlrange, 2, 2),
        ))
    }
}

fn all() -> Vec<Parameter> {
    NOMINAL.map(|(parameter, _)| parameter).to_vec()
}

/// Worlds that have the parameters of their own do what models do that are compiled with them.
#[track_caller]
fn assert_compiled(parameters: &[Parameter], text: &str, engine: &lanesim::Options) {
    let ids: Vec<usize> = (0..WORLDS).map(|world| world * 7 % DIFFERENT).collect();
    let mut worlds = Worlds::new(&Numbers::nominal().model(text), WORLDS, engine).expect("a batch");
    for parameter in parameters {
        let rows: Vec<f64> = ids.iter().flat_map(|id| Numbers::of(*id, parameters).row(*parameter).to_vec()).collect();
        let rows = Strided::new(Values::F64(&rows), rows.len() / WORLDS);
        worlds.set_parameters(*parameter, &rows, None).expect("parameters");
    }
    let got = run(&mut worlds, &ids);
    for id in 0..DIFFERENT {
        let mut own = Worlds::new(&Numbers::of(id, parameters).model(text), 1, engine).expect("a batch");
        let expected = run(&mut own, &[id]).remove(0);
        for (world, _) in ids.iter().enumerate().filter(|(_, own)| **own == id) {
            let other = got[world].iter().zip(&expected).position(|(a, b)| a != b);
            assert_eq!(other, None, "{parameters:?} of world {world}, numbers {id}, {engine:?}");
        }
    }
}

/// With every parameter changed alone a world does something else, or it would not have been seen.
#[test]
fn each_element_may_vary_alone() {
    let nominal = |engine: &lanesim::Options| {
        run(&mut Worlds::new(&Numbers::nominal().model(""), 1, engine).expect("a batch"), &[1]).remove(0)
    };
    for precision in [Precision::F64, Precision::F32] {
        let engine = options(precision, Backend::Auto);
        let before = nominal(&engine);
        for parameter in all() {
            assert_compiled(&[parameter], "", &engine);
            let mut other = Worlds::new(&Numbers::of(1, &[parameter]).model(""), 1, &engine).expect("a batch");
            assert_ne!(run(&mut other, &[1])[0], before, "{parameter:?} changes nothing in {precision:?}");
        }
    }
}

#[test]
fn elements_vary_together_in_every_engine() {
    for precision in [Precision::F64, Precision::F32] {
        engines(precision).iter().for_each(|engine| assert_compiled(&all(), "", engine));
    }
}

#[test]
fn elements_vary_with_every_solver_and_integrator() {
    let texts = [
        "solver='PGS'",
        "solver='CG'",
        "cone='elliptic' noslip_iterations='3'",
        "integrator='RK4'",
        "integrator='implicitfast'",
        "integrator='implicit'",
    ];
    for text in texts {
        for backend in [Backend::Wide, Backend::Native] {
            assert_compiled(&all(), text, &options(Precision::F64, backend));
        }
    }
}

/// Contacts' numbers follow from those of their geoms and from masses: whichever is set last, both count.
#[test]
fn laws_of_contacts_and_masses_vary_together() {
    let parameters = [Parameter::GeomSolref, Parameter::GeomMargin, Parameter::JntRange];
    let numbers = Numbers::of(2, &parameters);
    let set = |order: &[Parameter]| {
        let mut worlds =
            Worlds::new(&Numbers::nominal().model(""), 1, &options(Precision::F64, Backend::Auto)).expect("a batch");
        let mass: Vec<f64> = Parameter::BodyMass.of(worlds.model()).iter().map(|mass| 1.3 * mass).collect();
        for parameter in order {
            let row = if *parameter == Parameter::BodyMass { &mass[..] } else { numbers.row(*parameter) };
            worlds.set_parameter(*parameter, 0, row).expect("a parameter");
        }
        run(&mut worlds, &[2]).remove(0)
    };
    let [solref, margin, range] = parameters;
    let first = set(&[Parameter::BodyMass, solref, margin, range]);
    assert_eq!(first, set(&[solref, range, margin, Parameter::BodyMass]));
    assert_ne!(first, set(&[solref, margin, range]));
}

/// A margin per world is a contact from a distance: it presses before shapes touch.
#[test]
fn margins_make_contacts_from_a_distance() {
    let model = parse(
        "<mujoco><option gravity='0 0 0'/><worldbody><geom type='plane' size='1 1 1' gap='.1'/>
           <body pos='0 0 .13'><freejoint/><geom size='.1'/></body></worldbody></mujoco>",
    );
    let mut worlds = Worlds::new(&model, 3, &options(Precision::F64, Backend::Auto)).expect("a batch");
    for (world, margin) in [0.0, 0.02, 0.06].into_iter().enumerate() {
        worlds.set_parameter(Parameter::GeomMargin, world, &[margin, 0.0]).expect("a margin");
    }
    worlds.step(1).expect("a step");
    let speed = |world: usize| worlds.get(lanesim::Field::Qvel, world).expect("velocities")[2];
    assert_eq!((speed(0), speed(1)), (0.0, 0.0));
    assert!(speed(2) > 1e-3, "{}", speed(2));
}

#[test]
fn impossible_numbers_are_refused() {
    let worlds =
        || Worlds::new(&Numbers::nominal().model(""), 2, &options(Precision::F64, Backend::Auto)).expect("a batch");
    let refused = |parameter: Parameter, place: usize, x: f64, message: &str| {
        let mut row = Numbers::nominal().row(parameter).to_vec();
        row[place] = x;
        fails(worlds().set_parameter(parameter, 1, &row), message);
    };
    refused(Parameter::DofFrictionloss, 7, 0.1, "expected the model's 0, since it has no effect");
    refused(Parameter::DofFrictionloss, 6, -0.1, "expected a number that is not negative");
    refused(Parameter::QposSpring, 8, 0.5, "expected a quaternion of length 1");
    refused(Parameter::JntRange, 2, 0.6, "expected a lower end, then an upper one beyond both margins");
    refused(Parameter::JntRange, 2, f64::NEG_INFINITY, "expected a finite number");
    refused(Parameter::JntRange, 4, 0.1, "since it has no effect");
    refused(Parameter::JntSolref, 3, -1.0, "expected two positive numbers (time, damping ratio)");
    refused(Parameter::JntSolimp, 9, 2.0, "gives joint 1 another form of impedance");
    refused(Parameter::TendonStiffness, 1, 1.0, "since it has no effect");
    refused(Parameter::TendonLengthspring, 0, 0.1, "expected a lower end that is not above the upper one");
    refused(Parameter::TendonSolimp, 2, 0.0, "gives tendon 0 another form of impedance");
    refused(Parameter::ActuatorForcerange, 5, 1.0, "since it has no effect");
    refused(Parameter::ActuatorCtrlrange, 0, 2.0, "expected a lower end that is not above the upper one");
    refused(Parameter::ActuatorDynprm, 22, 0.1, "since it has no effect");
    refused(Parameter::GeomSolimp, 4, 1.0, "another form of impedance");
    refused(Parameter::GeomMargin, 0, 0.1, "give the geoms a gap in the model");

    let mut bare = Worlds::new(
        &parse("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"),
        1,
        &options(Precision::F64, Backend::Auto),
    )
    .expect("a batch");
    fails(bare.set_parameter(Parameter::JntRange, 0, &[0.0, 1.0]), "no joint has a limit in force");
    fails(bare.set_parameter(Parameter::DofFrictionloss, 0, &[1.0]), "no dof has dry friction");
    fails(bare.set_parameter(Parameter::GeomSolref, 0, &[0.01, 1.0]), "no contact has the numbers of its geoms");
    fails(bare.set_parameter(Parameter::TendonRange, 0, &[]), "it has none");
    let mut discrete =
        Worlds::new(&Numbers::nominal().model("integrator='discrete'"), 1, &options(Precision::F64, Backend::Auto))
            .expect("a batch");
    let row = Numbers::nominal().row(Parameter::GeomSolref).to_vec();
    fails(
        discrete.set_parameter(Parameter::GeomSolref, 0, &row),
        "discrete steps take solref and solimp in a form of their own",
    );
}
