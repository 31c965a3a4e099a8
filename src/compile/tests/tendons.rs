//! Tendons: what is refused, and what follows from what is written.

use crate::model::{ArrayData, Model};

const BODIES: &str = "<worldbody><site name='w0' pos='0 0 1'/><body name='b'><joint name='a' axis='0 1 0'/>\
    <joint name='slide' type='slide'/><geom name='g' size='.1'/><geom name='cap' type='capsule' size='.1 .2'/>\
    <geom name='cyl' type='cylinder' size='.1 .1'/><site name='s1' pos='.3 0 0'/><site name='s2' pos='-.3 0 .3'/>\
    <site name='s3' pos='-.3 0 .3'/></body><body pos='3 0 0'><joint type='ball' name='ball'/><geom size='.1'/></body></worldbody>";

fn with(tendons: &str) -> Result<Model, String> {
    let text = format!("<mujoco>{BODIES}<tendon>\n{tendons}</tendon></mujoco>");
    Model::from_xml_string(&text, &Default::default()).map_err(|problems| problems.to_string())
}

fn real(model: &Model, name: &str) -> Vec<f64> {
    match &model.array(name).expect("an array").data {
        ArrayData::F64(x) => x.clone(),
        ArrayData::I32(x) => x.iter().map(|x| f64::from(*x)).collect(),
    }
}

/// What MuJoCo refuses, and what would only puzzle it.
#[test]
fn refused() {
    let two = "<site site='s1'/><site site='s2'/>";
    let spatial = |points: &str| format!("<spatial name='t'>{points}</spatial>");
    let fixed = |inside: &str| format!("<fixed name='t'>{inside}</fixed>");
    let one = |attributes: &str| format!("<fixed name='t' {attributes}><joint joint='a' coef='1'/></fixed>");
    for (tendon, message) in [
        (fixed(""), "has no joint (add joints, each with a coefficient)"),
        (fixed("<joint joint='aa' coef='1'/>"), "names an unknown joint \"aa\" (did you mean \"a\"?)"),
        (fixed("<joint joint='ball' coef='1'/>"), "joint \"ball\" is neither a hinge nor a slide"),
        (fixed("<joint joint='a' coef='1'/><joint joint='a' coef='2'/>"), "joint \"a\" is repeated"),
        (spatial(""), "has fewer than two sites"),
        (spatial("<site site='s1'/>"), "has fewer than two sites"),
        (spatial("<pulley divisor='2'/>"), "has fewer than two sites"),
        (spatial("<site site='s1'/><site site='s1'/>"), "site \"s1\" is repeated"),
        (spatial("<site site='s1'/><site site='s9'/>"), "names an unknown site \"s9\""),
        (spatial(&format!("{two}<pulley divisor='2'/>")), "ends with a pulley"),
        (spatial(&format!("{two}<pulley divisor='2'/><pulley divisor='2'/>{two}")), "has two pulleys in a row"),
        (spatial(&format!("{two}<pulley divisor='0'/>{two}")), "divisor of a pulley is 0 (give a positive number)"),
        (spatial(&format!("{two}<pulley divisor='2'/><site site='w0'/>")), "site \"w0\" is alone in its branch"),
        (spatial(&format!("<geom geom='g'/>{two}")), "geom \"g\" is not between two sites"),
        (spatial(&format!("{two}<geom geom='g'/>")), "geom \"g\" is not between two sites"),
        (
            spatial("<site site='s1'/><geom geom='g'/><geom geom='cyl'/><site site='s2'/>"),
            "geom \"g\" is not between two sites",
        ),
        (
            spatial("<site site='s1'/><geom geom='cap'/><site site='s2'/>"),
            "geom \"cap\" is neither a sphere nor a cylinder",
        ),
        (spatial("<site site='s1'/><geom geom='h'/><site site='s2'/>"), "names an unknown geom \"h\""),
        (
            spatial("<site site='s1'/><geom geom='g' sidesite='s'/><site site='s2'/>"),
            "names an unknown side site \"s\"",
        ),
        (
            "<spatial name='t' armature='1'><site site='w0'/><geom geom='g'/><site site='s2'/></spatial>".to_string(),
            "has armature and wraps geom \"g\"",
        ),
        (one("range='1 0' limited='true'"), "range is empty: 1 0"),
        (one("actuatorfrcrange='1 2'"), "actuatorfrcrange leaves no room for no force: 1 2"),
        (one("springlength='2 1'"), "springlength is empty: 2 1"),
        (one("damping='-1'"), "damping is negative: -1"),
        (one("armature='-1'"), "armature is negative: -1"),
        (one("frictionloss='-1'"), "frictionloss is negative: -1"),
        (one("solreflimit='0.1 -1'"), "solreflimit mixes its two forms"),
        (format!("{}{}", one(""), one("")), "repeated name"),
    ] {
        let problem = with(&tendon).expect_err(&tendon);
        assert!(problem.contains("2: tendon \"t\": ") && problem.contains(message), "{problem}");
    }
    for (equality, message) in [
        ("<tendon tendon1='u'/>", "tendon1 names an unknown tendon \"u\""),
        ("<tendon tendon1='t' tendon2='t'/>", "tendon \"t\" is held to itself"),
    ] {
        let text = format!("<mujoco>{BODIES}<tendon>{}</tendon><equality>{equality}</equality></mujoco>", one(""));
        let problem = Model::from_xml_string(&text, &Default::default()).expect_err(equality).to_string();
        assert!(problem.contains(message), "{problem}");
    }
}

/// Tendons that nothing moves, and of no length, do nothing.
#[test]
fn degenerate() {
    let model = with(
        "<spatial range='0 1' frictionloss='1' stiffness='3'><site site='s2'/><site site='s3'/></spatial>\
         <spatial><pulley divisor='2'/><site site='s1'/><site site='s2'/></spatial>\
         <fixed><joint joint='a' coef='0'/></fixed>",
    )
    .expect("a model");
    let tables = model.tables();
    assert!(tables.limits.is_empty() && tables.friction_losses.is_empty());
    let lengths = real(&model, "tendon_length0");
    assert_eq!((lengths[0], lengths[2]), (0.0, 0.0));
    assert!((lengths[1] - 0.5 * (0.45_f64).sqrt()).abs() < 1e-15, "{lengths:?}");
    assert_eq!(real(&model, "tendon_invweight0"), [0.0; 3]);
}

#[test]
fn spring_lengths() {
    let one = |attributes: &str| format!("<fixed {attributes}><joint joint='slide' coef='2'/></fixed>");
    let all = [one(""), one("springlength='.5'"), one("springlength='-.5'"), one("springlength='-1 2'")].concat();
    let model = with(&all).expect("a model");
    assert_eq!(real(&model, "tendon_lengthspring"), [0.0, 0.0, 0.5, 0.5, -0.5, -0.5, -1.0, 2.0]);
}

#[test]
fn replicas() {
    let text = "<mujoco><worldbody><site name='w'/><replicate count='2' offset='0 0 1'><body name='b'><joint name='j' type='slide'/>\
        <geom name='g' size='.1'/><site name='s' pos='0 0 2'/></body></replicate></worldbody><tendon>\
        <spatial name='t'><site site='w'/><geom geom='g' sidesite='s'/><site site='s'/></spatial>\
        <fixed name='f'><joint joint='j' coef='1'/></fixed></tendon>\
        <equality><tendon tendon1='t' tendon2='f'/></equality></mujoco>";
    let model = Model::from_xml_string(text, &Default::default()).expect("a model");
    assert_eq!(model.names().tendons.iter().collect::<Vec<_>>(), ["t0", "f0", "t1", "f1"]);
    assert_eq!(real(&model, "eq_obj1id"), [0.0, 2.0]);
    assert_eq!(real(&model, "eq_obj2id"), [1.0, 3.0]);
}

/// What actuators ask of tendons.
#[test]
fn actuators() {
    let tendons = "<fixed name='t'><joint joint='a' coef='1'/></fixed>\
        <spatial name='w'><site site='w0'/><geom geom='g'/><site site='s1'/></spatial>";
    for (actuator, message) in [
        ("<motor name='m' tendon='u'/>", "acts on an unknown tendon \"u\""),
        ("<position name='m' tendon='t' inheritrange='1'/>", "inheritrange, but tendon \"t\" has no range"),
        ("<general name='m' tendon='w' armature='1'/>", "armature, but tendon \"w\" wraps a geom"),
        ("<motor name='m' tendon='t' joint='a'/>", "both joint and tendon are given"),
    ] {
        let text = format!("<mujoco>{BODIES}<tendon>{tendons}</tendon><actuator>\n{actuator}</actuator></mujoco>");
        let problem = Model::from_xml_string(&text, &Default::default()).expect_err(actuator).to_string();
        assert!(problem.contains("2: ") && problem.contains("\"m\": ") && problem.contains(message), "{problem}");
    }
}
