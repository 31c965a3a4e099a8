//! What is not built: problems of a strict load, losses of a lenient one, notes where no motion depends on it.

use super::{LoadOptions, lenient, ok, parse, rejects, with_joint, world};
use crate::Model;

/// A strict load names the attribute and its line, a lenient one lists the loss.
#[track_caller]
fn option(text: &str, problem: &str, loss: &str) {
    rejects(text, problem);
    let spec = lenient(text);
    assert_eq!(spec.losses, [loss]);
    Model::from_spec(&spec).unwrap_or_else(|problems| panic!("{problems}"));
}

#[test]
fn flags_that_are_not_built() {
    let text = |flag: &str| format!("<mujoco><option>\n<flag {flag}='enable'/></option></mujoco>");
    for (flag, what, instead) in [
        ("diagexact", "the exact diagonal of the constraint space is", "approximated"),
        ("ipc", "incremental potential contact is", "left out"),
        ("speculative", "speculative contact is", "left out"),
    ] {
        option(
            &text(flag),
            &format!("2: flag: {flag}: {what} not supported (remove it; a lenient load goes without)"),
            &format!("line 2: flag: {flag}: {what} not supported, {instead}"),
        );
    }
}

#[test]
fn overrides_come_before_what_is_not_built() {
    let with = |text: &str, name: &str, value: &str| {
        parse(text, &LoadOptions { lenient: false, overrides: vec![(name.into(), value.into())] })
    };
    let written = "<mujoco><option><flag ipc='enable'/></option></mujoco>";
    assert!(with(written, "ipc", "disable").is_ok());
    let problem = with("<mujoco/>", "ipc", "enable").expect_err("not built").to_string();
    let expected = "flag: ipc: incremental potential contact is not supported (remove it; a lenient load goes without)";
    assert_eq!(problem, expected);
}

#[test]
fn bad_settings_have_a_line() {
    let problem = |text: &str| Model::from_xml_string(text, &LoadOptions::default()).expect_err("bad").to_string();
    assert_eq!(
        problem("<mujoco>\n<option timestep='-1'/>\n<compiler boundmass='-1'/></mujoco>"),
        "2: option: timestep is -1 (give a positive time step)\n3: compiler: boundmass is negative: -1 (give 0 or more)"
    );
}

#[test]
fn attributes_of_actuators_that_are_not_built_are_named() {
    let check = |actuator: &str, what: &str| {
        let text = with_joint(&format!("<actuator>{actuator}</actuator>"));
        rejects(&text, &format!("1: {what} not supported (a lenient load leaves it out)"));
        assert_eq!(lenient(&text).losses, [format!("line 1: {what} not supported, left out")]);
    };
    check("<general joint='j' gaintype='user'/>", "general: gaintype \"user\" is");
    check("<general joint='j' biastype='user'/>", "general: biastype \"user\" is");
    check("<general joint='j' dyntype='user'/>", "general: dyntype \"user\" is");
    let text = |actuator: &str| with_joint(&format!("<actuator>{actuator}</actuator>"));
    rejects(
        &text("<general joint='j' input='pos vel'/>"),
        "1: general: attribute \"input\": \"pos vel\" is none that the actuator has (valid: pos, vel, pressure)",
    );
    rejects(
        &text("<general joint='j' input='pso'/>"),
        "1: general: attribute \"input\": \"pso\" is unknown (did you mean \"pos\"?)",
    );
    rejects(
        &text("<general joint='j' actrange='0 1'/>"),
        "1: general: attribute \"actrange\" or \"actlimited\": the actuator has no activation (remove it)",
    );
}

#[test]
fn sensors_go_with_what_they_are_about() {
    let text = with_joint(
        "<actuator><plugin name='a' joint='j'/></actuator>\
         <sensor><actuatorfrc actuator='a'/><tactile geom='g' mesh='m'/><clock/></sensor>",
    );
    let spec = lenient(&text);
    assert_eq!(spec.sensors.len(), 1);
    assert_eq!(
        spec.losses[1..],
        [
            "line 1: tactile: sensors of kind tactile are not supported, left out",
            "line 1: actuatorfrc: actuator \"a\" was left out, and so is this actuatorfrc",
        ]
    );
    let text = with_joint("<sensor><tactile geom='g' mesh='m'/></sensor>");
    rejects(&text, "1: tactile: sensors of kind tactile are not supported (a lenient load leaves it out)");
}

/// A signed distance field on a body, with what stands before it.
fn field(compiler: &str, before: &str, geom: &str) -> String {
    format!(
        "<mujoco><compiler {compiler}/><worldbody><body>{before}\
         <geom size='.1'/>\n<geom name='v' type='sdf' {geom}/></body></worldbody></mujoco>"
    )
}

#[test]
fn distance_fields_that_only_decorate_are_notes() {
    let idle = "contype='0' conaffinity='0'";
    let inertial = "<frame><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></frame>";
    let massless = format!("{idle} mass='0'");
    let grouped = format!("{idle} group='3'");
    for text in [
        field("", &format!("<joint/>{inertial}"), idle),
        field("", "<joint/>", &massless),
        field("", "<joint/>", &format!("{idle} density='0'")),
        field("inertiagrouprange='0 2'", "<joint/>", &grouped),
        field("inertiafromgeom='false'", "<joint/>", idle),
        field("", "", idle),
    ] {
        let spec = ok(&text);
        assert_eq!(spec.bodies[1].geoms.len(), 1);
        assert_eq!(
            spec.notes,
            [
                "1 geom on which no motion depends is left out, as signed distance fields are not built: line 2: geom \"v\": the first"
            ]
        );
    }
}

#[test]
fn a_geom_left_out_says_what_it_takes_with_it() {
    let check = |text: &str, with: &str| {
        rejects(
            text,
            &format!("2: geom \"v\": signed distance fields are not supported (a lenient load leaves it out {with})"),
        );
        let lost = format!("line 2: geom \"v\": signed distance fields are not supported, left out {with}");
        assert_eq!(lenient(text).losses, [lost]);
    };
    let idle = "contype='0' conaffinity='0'";
    check(&field("", "<joint/>", ""), "with its contacts and its mass");
    check(&field("", "<joint/>", "mass='0'"), "with its contacts");
    check(&field("", "<joint/>", idle), "with its mass");
    check(&field("", "", ""), "with its contacts");
    check(&field("settotalmass='1'", "", idle), "with its mass");
    check(
        &field("inertiafromgeom='true'", "<joint/><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>", idle),
        "with its mass",
    );
}

/// A pair may name a copy of a geom that is left out, at any depth.
#[test]
fn a_pair_with_a_copy_of_a_lost_geom_is_lost() {
    let text = |name: &str, idle: &str| {
        format!(
            "<mujoco><worldbody><geom name='h' size='.1'/><body><joint/>\
             <geom size='.1'/><replicate count='2'><replicate count='2' sep='_'><geom name='g' type='sdf' {idle}/>\
             <geom type='sdf'/></replicate></replicate></body></worldbody>\
             <contact><pair geom1='h' geom2='{name}'/></contact></mujoco>"
        )
    };
    for name in ["g", "g_1", "g_10"] {
        let spec = lenient(&text(name, ""));
        let lost = format!("line 1: pair: geom \"{name}\" was left out, and so is this pair");
        assert!(spec.pairs.is_empty() && spec.losses.contains(&lost), "{:?}", spec.losses);
    }
    assert_eq!(lenient(&text("0", "")).pairs.len(), 1, "what has no name has no copies either");
    // Where only the pair makes the geom matter, the pair is refused.
    let idle = "contype='0' conaffinity='0' mass='0'";
    let only = text("g_10", idle).replace("<geom type='sdf'/>", "");
    rejects(&only, "1: pair: geom \"g_10\" is not supported (a lenient load leaves the pair out)");
}

#[test]
fn sentences_are_capped() {
    let spec = lenient(&world(&"<geom type='sdf'/>".repeat(1500)));
    assert_eq!((spec.losses.len(), spec.losses[1000].as_str()), (1001, "500 more are not listed"));
}

/// What MuJoCo 4.0.0 writes for `<position>`, `<velocity>` and a class of servos.
#[test]
fn saved_actuators_are_read() {
    let gains = |sections: &str| {
        let spec = ok(&with_joint(sections));
        let a = &spec.actuators[0];
        (a.gainprm, a.biasprm, a.dampratio)
    };
    let saved = "<general joint='j' input='pos' biastype='affine' gainprm='20' biasprm='0 -20 -0.5'/>";
    assert_eq!(
        gains(&format!("<actuator>{saved}</actuator>")),
        gains("<actuator><position joint='j' kp='20' kv='0.5'/></actuator>")
    );
    let saved = "<general joint='j' input='vel' biastype='affine' gainprm='1.5' biasprm='0 0 -1.5'/>";
    assert_eq!(
        gains(&format!("<actuator>{saved}</actuator>")),
        gains("<actuator><velocity joint='j' kv='1.5'/></actuator>")
    );
    let class = "<default><default class='servo'><general input='pos' biastype='affine' gainprm='6' \
        biasprm='0 -6 -0.3'/></default></default>";
    let reset = "<general class='servo' joint='j' input='' biastype='none' gainprm='1' biasprm='0 0 0'/>";
    let plain = crate::spec::Actuator::default();
    let motor = (plain.gainprm, plain.biasprm, 0.0);
    assert_eq!(gains(&format!("{class}<actuator>{reset}</actuator>")), motor);
}

/// What gives no force by itself stops no strict load.
#[test]
fn constraints_and_skins_without_effect_are_notes() {
    for (section, note) in [
        (
            "<equality>\n<flex flex='f' active='false'/><distance geom1='g' geom2='h' active='false'/></equality>",
            "line 2: 2 equality constraints of kinds that are not built, not active, are left out",
        ),
        ("<deformable>\n<skin name='s'/></deformable>", "line 2: 1 skins are not drawn"),
    ] {
        let spec = ok(&with_joint(&format!("{section}<keyframe><key qpos='1'/></keyframe>")));
        assert_eq!((spec.notes, spec.keys.len()), (vec![note.to_string()], 1), "{section}");
    }
    for section in ["<equality><flex flex='f'/></equality>", "<deformable><flex/></deformable>"] {
        parse(&with_joint(section), &LoadOptions::default()).expect_err("changes the motion");
    }
}

/// The compiler's message about a body names the geom that a lenient load took from it, or from what is fixed to it.
#[test]
fn a_body_without_mass_names_the_geom_that_had_it() {
    let lost = "body \"b\": moves, but has no mass or no inertia: what has it was left out (line 2: geom \"v\")";
    let geom = "\n<geom name='v' type='sdf'/>";
    for content in [geom.to_string(), format!("<body>{geom}</body>"), format!("<frame>{geom}</frame>")] {
        let spec = lenient(&world(&format!("<body name='b'><joint/>{content}</body>")));
        let problem = Model::from_spec(&spec).expect_err("no mass").to_string();
        assert!(problem.contains(lost), "{problem}");
    }
}
