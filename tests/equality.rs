//! Equality constraints: per world, in loops that say things twice, with masses that vary, and what is refused.
//! `tests/goldens.rs` and `tests/solvers.rs` hold their numbers against MuJoCo's.

use crate::support;
use crate::support::{load, load_with, options, parse};
use lanesim::rows::Rows;
use lanesim::{Backend, Field, Options, Parameter, Precision, Worlds};

/// Bits of a field of one world.
fn bits(worlds: &Worlds, field: Field, world: usize) -> Vec<u64> {
    worlds.get(field, world).expect("a world").iter().map(|x| x.to_bits()).collect()
}

/// All of a state that follows from the constraints.
fn state(worlds: &Worlds, world: usize) -> Vec<Vec<u64>> {
    [Field::Qpos, Field::Qvel, Field::QaccWarmstart].map(|field| bits(worlds, field, world)).to_vec()
}

/// Which constraints are active in a world of the tests.
fn pattern(world: usize, neq: usize) -> Vec<f64> {
    (0..neq).map(|e| f64::from(u8::from(world >> e & 1 != 0))).collect()
}

/// A start of a world that pulls at the constraints.
fn start(worlds: &mut Worlds, at: usize, world: usize) {
    let mut random = support::Random(world as u64);
    let n = worlds.model().tables().sizes.nv;
    let (neq, qvel) = (worlds.model().tables().sizes.neq, random.vector(n, 0.5));
    worlds.set(Field::Qvel, at, &qvel).expect("a velocity");
    worlds.set(Field::EqActive, at, &pattern(world, neq)).expect("what is active");
}

const MODELS: [&str; 5] =
    ["unit/equality_connect", "unit/equality_weld", "unit/equality_joint", "zoo/four_bar", "solver/equality"];

/// What is active in one world changes no bit of another, wherever they are, on any backend.
#[test]
fn worlds_have_constraints_of_their_own() {
    for name in MODELS {
        for solver in ["Newton", "CG", "PGS"] {
            let model = load_with(name, &[("solver", solver)]);
            for precision in [Precision::F64, Precision::F32] {
                let run = |worlds: &[usize], backend| {
                    let mut batch = Worlds::new(&model, worlds.len(), &options(precision, backend)).expect("worlds");
                    worlds.iter().enumerate().for_each(|(at, world)| start(&mut batch, at, *world));
                    batch.step(20).expect("steps");
                    (0..worlds.len()).map(|at| state(&batch, at)).collect::<Vec<_>>()
                };
                let all: Vec<usize> = (0..32).collect();
                let together = run(&all, Backend::Wide);
                assert!(run(&all, Backend::Native) == together, "{name} {solver} {precision:?} in code");
                for world in [0, 1, 6, 21, 31] {
                    assert!(
                        run(&[world], Backend::Wide)[0] == together[world],
                        "{name} {solver} {precision:?} {world}"
                    );
                    assert!(
                        run(&[world], Backend::Scalar)[0] == together[world],
                        "{name} {solver} {precision:?} {world}"
                    );
                }
            }
        }
    }
}

/// Without any active constraint a world is that of a model without constraints.
#[test]
fn inactive_constraints_leave_no_trace() {
    for name in MODELS {
        let (model, off) = (load(name), load_with(name, &[("equality", "disable")]));
        let run = |model| {
            let mut worlds = Worlds::new(model, 1, &options(Precision::F64, Backend::Wide)).expect("worlds");
            start(&mut worlds, 0, 0);
            worlds.step(50).expect("steps");
            state(&worlds, 0)
        };
        assert!(run(&model) == run(&off), "{name}");
    }
}

#[test]
fn a_reset_restores_what_the_model_says() {
    let model = load("unit/equality_connect");
    let mut worlds = Worlds::new(&model, 2, &Options::default()).expect("worlds");
    let active = [1.0, 1.0, 1.0, 1.0, 0.0];
    assert_eq!(worlds.get_all(Field::EqActive), [active, active].concat());
    worlds.set(Field::EqActive, 1, &[0.0, 1.0, 0.0, 1.0, 1.0]).expect("five numbers");
    worlds.step(3).expect("steps");
    assert_eq!(worlds.get(Field::EqActive, 1).unwrap(), [0.0, 1.0, 0.0, 1.0, 1.0]);
    worlds.reset(1, None).expect("a reset");
    assert_eq!(worlds.get(Field::EqActive, 1).unwrap(), active);
    let error = worlds.set(Field::EqActive, 0, &[1.0]).unwrap_err().to_string();
    assert_eq!(error, "eq_active has 1 numbers; expected 5");
    let error = worlds.set(Field::EqActive, 0, &[1.0, 0.0, 0.5, 1.0, 1.0]).unwrap_err().to_string();
    assert_eq!(error, "eq_active[2] of world 0 is 0.5; expected 0 or 1");
}

/// Loops in which rows say what others say already: every solver converges, at every step, and holds them together.
#[test]
fn redundant_loops_converge() {
    for (name, reach) in [("zoo/four_bar", 3e-3), ("zoo/closed_chain", 3e-3), ("zoo/stewart", 3e-3)] {
        for (solver, iterations) in [("Newton", "20"), ("CG", "300"), ("PGS", "500")] {
            let overrides = [("solver", solver), ("iterations", iterations), ("tolerance", "1e-8")];
            let model = load_with(name, &overrides);
            for precision in [Precision::F64, Precision::F32] {
                let mut worlds = Worlds::new(&model, 16, &options(precision, Backend::Auto)).expect("worlds");
                for world in 0..16 {
                    let nu = model.tables().sizes.nu;
                    worlds.set(Field::Ctrl, world, &vec![world as f64 / 8.0 - 1.0; nu]).expect("controls");
                }
                worlds.step(500).expect("steps");
                for world in 0..16 {
                    let status = worlds.status(world).expect("a world");
                    assert!(status.names().is_empty(), "{name} {solver} {precision:?}: {:?}", status.names());
                }
                let mut gaps = vec![Vec::new(); 16];
                worlds.read_all(&["efc_pos"], vec![Rows::Lists(&mut gaps)]).expect("rows");
                let most = support::largest(&gaps.concat());
                assert!(most < reach, "{name} {solver} {precision:?}: gap {most:.1e}");
            }
        }
    }
}

/// The report of a model names constraints that say what others do.
#[test]
fn redundant_rows_are_notes() {
    let notes = |name: &str| {
        let notes = load(name).report().notes.clone();
        notes.into_iter().filter(|note| note.contains("rows say nothing new")).collect::<Vec<_>>()
    };
    let ring = notes("zoo/closed_chain");
    assert_eq!(ring.len(), 2);
    assert!(
        ring[0].contains(":39: weld #1: 6 of its 6 rows say nothing new in the reference configuration"),
        "{}",
        ring[0]
    );
    assert!(ring[1].contains(":40: connect #2: 3 of its 3 rows"), "{}", ring[1]);
    assert!(notes("zoo/four_bar")[0].contains(":23: connect #0: 1 of its 3 rows"));
    assert!(notes("unit/equality_joint").is_empty());
}

/// Inverse weights of constraints follow masses that a world has of its own.
#[test]
fn constraints_follow_masses_that_vary() {
    let own = load("unit/equality_weld");
    let masses: Vec<f64> = Parameter::BodyMass.of(&own).iter().map(|mass| 1.5 * mass).collect();
    let inertias: Vec<f64> = Parameter::BodyInertia.of(&own).iter().map(|inertia| 1.5 * inertia).collect();
    let text = std::fs::read_to_string(support::repository("models/unit/equality_weld.xml")).expect("the model");
    let heavy = parse(&text.replace("<geom contype", "<geom density=\"1500\" contype"));
    for precision in [Precision::F64, Precision::F32] {
        let mut varied = Worlds::new(&own, 9, &options(precision, Backend::Auto)).expect("worlds");
        varied.set_parameter(Parameter::BodyMass, 4, &masses).expect("masses");
        varied.set_parameter(Parameter::BodyInertia, 4, &inertias).expect("inertias");
        let mut fixed = Worlds::new(&heavy, 1, &options(precision, Backend::Wide)).expect("worlds");
        start(&mut varied, 4, 31);
        start(&mut fixed, 0, 31);
        varied.step(10).expect("steps");
        fixed.step(10).expect("steps");
        let (got, expected) = (varied.get(Field::Qvel, 4).unwrap(), fixed.get(Field::Qvel, 0).unwrap());
        let tolerance = if precision == Precision::F64 { 1e-10 } else { 1e-4 };
        support::assert_agree("qvel", &got, &expected, tolerance, 1.0);
    }
}

/// A model with some equality constraints.
fn with(equalities: &str) -> String {
    format!(
        "<mujoco><worldbody>\n<body name='a'><joint name='x'/><joint name='y' type='slide'/><geom size='.1'/><site name='s'/>\
         <body name='b' pos='1 0 0'><joint name='z' axis='1 0 0'/><geom size='.1'/><site name='t'/></body></body>\n\
         <body name='c'><freejoint name='f'/><geom size='.1'/></body></worldbody>\n<equality>\n{equalities}\n</equality></mujoco>"
    )
}

/// What a load says against it.
fn refusal(equalities: &str) -> String {
    let loaded = lanesim::Model::from_xml_string(&with(equalities), &Default::default());
    loaded.err().unwrap_or_else(|| panic!("accepted: {equalities}")).to_string()
}

#[test]
fn bad_constraints_are_refused_with_place_and_remedy() {
    for (equality, message) in [
        ("<connect body1='q' anchor='0 0 0'/>", "5: connect #0: body1 names an unknown body \"q\""),
        ("<connect body1='a' body2='d' anchor='0 0 0'/>", "body2 names an unknown body \"d\""),
        ("<connect body1='a' body2='a' anchor='0 0 0'/>", "body \"a\" is held to itself (name two different bodies)"),
        ("<weld body1='world'/>", "body \"world\" is held to itself"),
        ("<weld name='w' site1='s' site2='s'/>", "weld \"w\": site \"s\" is held to itself"),
        ("<weld site1='s' site2='u'/>", "site2 names an unknown site \"u\""),
        ("<connect site1='s'/>", "attribute \"site2\" is missing"),
        ("<connect site1='s' site2='t' anchor='0 0 0'/>", "both sites and anchor are given (keep site1 and site2, or"),
        ("<connect body1='a'/>", "attribute \"anchor\" is missing"),
        ("<connect body2='a' anchor='0 0 0'/>", "attribute \"body1\" is missing"),
        ("<connect body1='a' anchor='0 0'/>", "attribute \"anchor\": expected 3 numbers, found 2"),
        ("<weld body1='a' relpose='1 2 3'/>", "attribute \"relpose\": expected 7 numbers, found 3"),
        ("<joint joint1='x' polycoef='1 2 3 4 5 6'/>", "attribute \"polycoef\": expected at most 5 numbers, found 6"),
        ("<joint joint2='x'/>", "attribute \"joint1\" is missing"),
        ("<joint joint1='x' joint2='q'/>", "joint2 names an unknown joint \"q\""),
        ("<joint joint1='x' joint2='x'/>", "joint \"x\" is held to itself"),
        (
            "<joint joint1='f'/>",
            "joint \"f\" is neither a hinge nor a slide (hold a ball or a free joint by connect or weld)",
        ),
        ("<joint joint1='x' solref='0.1 -1'/>", "solref mixes its two forms"),
        (
            "<joint joint1='x' joint2='y'/>\n<joint joint1='y' joint2='z'/>\n<joint joint1='z' joint2='x'/>",
            "7: equality joint #2: joints follow from each other in a circle: \"z\", \"x\", \"y\", \"z\"",
        ),
        ("<joint name='n' joint1='x'/><weld name='n' body1='a'/>", "repeated name"),
        ("<joint joint1='x' torquescale='2'/>", "unknown attribute \"torquescale\""),
        ("<tendon tendon1='t'/>", "tendon1 names an unknown tendon \"t\""),
        ("<flex flex='f'/>", "this kind of equality constraint is not supported"),
    ] {
        let said = refusal(equality);
        assert!(said.contains(message), "{equality}: {said}\nexpected: {message}");
    }
    // Two that say the same at different times are no circle.
    parse(&with("<joint joint1='x' joint2='y'/><joint joint1='y' joint2='x' active='false'/>"));
}

/// Copies hold copies of what the original holds.
#[test]
fn constraints_are_replicated_with_what_they_hold() {
    let model = parse(
        "<mujoco><worldbody><body name='post' pos='0 0 2'><geom size='.1'/></body>\
         <replicate count='3' offset='1 0 0'><body name='a'><joint name='a'/><geom size='.1'/><site name='a'/></body></replicate>\
         </worldbody><equality><joint name='j' joint1='a'/><connect body1='a' body2='post' anchor='0 0 1'/></equality></mujoco>",
    );
    assert_eq!(model.names().equalities.len(), 6);
    assert_eq!(
        (model.names().equalities.id("j0").is_some(), model.names().equalities.id("j2").is_some()),
        (true, true)
    );
}

/// However stiff constraints are, single precision finds the accelerations: of a ring closed thrice it could not by itself.
#[test]
fn stiff_loops_are_evaluated_in_double_precision() {
    let text = std::fs::read_to_string(support::repository("models/zoo/closed_chain.xml")).expect("the model");
    // Light about the axes of its capsules.
    let text = text.replace(" armature=\"0.005\"", "");
    for impedance in ["0.9 0.95", "0.99 0.99", "0.999 0.999", "0.9999 0.9999"] {
        let model = parse(&text.replace("<default>", &format!("<default><equality solimp=\"{impedance}\"/>")));
        let qacc = |precision, backend| {
            let mut worlds = Worlds::new(&model, 40, &options(precision, backend)).expect("worlds");
            for world in 0..40 {
                // Numbers that single precision has.
                let qvel = support::Random(world as u64)
                    .vector(13, 0.5)
                    .iter()
                    .map(|x| f64::from(*x as f32))
                    .collect::<Vec<_>>();
                worlds.set(Field::Qvel, world, &qvel).expect("a velocity");
            }
            let mut qacc = vec![0.0; 40 * 13];
            worlds.read_all(&["qacc"], vec![Rows::F64(&mut qacc)]).expect("accelerations");
            qacc
        };
        let exact = qacc(Precision::F64, Backend::Auto);
        let single = qacc(Precision::F32, Backend::Auto);
        assert!(single == qacc(Precision::F32, Backend::Wide), "{impedance}");
        for (world, (got, expected)) in single.chunks(13).zip(exact.chunks(13)).enumerate() {
            support::assert_agree(&format!("{impedance} world {world} "), got, expected, 1e-3, 1.0);
        }
    }
}
