//! Ranges, limits and keyframes that MuJoCo 4.0.0 takes, and what it makes of them.

use super::*;
use crate::mjcf::LoadOptions;

const INF: f64 = f64::INFINITY;

fn load(text: &str) -> Model {
    Model::from_xml_string(text, &LoadOptions::default()).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

/// A body with a joint `j`, and actuators.
fn with(joint: &str, actuators: &str) -> Model {
    load(&format!(
        "<mujoco><worldbody><body><joint name='j' {joint}/><geom size='0.1' pos='1 0 0'/></body></worldbody>\
         <actuator>{actuators}</actuator></mujoco>"
    ))
}

#[test]
fn ranges_without_a_limit_stay_as_written() {
    let model = with("limited='false' range='-45 90'", "<position joint='j' kp='3' inheritrange='1'/>");
    agrees(&model, "jnt_range", &[-45.0, 90.0]);
    agrees(&model, "actuator_ctrlrange", &[-45.0, 90.0]);
    agrees(&with("range='90 -45'", ""), "jnt_range", &[90.0, -45.0]);
    agrees(&with("type='ball' limited='false' range='0.1 0.5'", ""), "jnt_range", &[0.1, 0.5]);
    agrees(&with("type='free' range='0 1'", ""), "jnt_range", &[0.0, 1.0]);
    let degree = std::f64::consts::PI / 180.0;
    agrees(&with("range='-45 90'", ""), "jnt_range", &[-45.0 * degree, 90.0 * degree]);
}

#[test]
fn a_ball_joint_may_be_limited_to_nothing() {
    let model = load(
        "<mujoco><default><joint limited='true'/></default><worldbody><body><joint type='ball'/>\
         <geom size='0.1' pos='1 0 0'/></body></worldbody></mujoco>",
    );
    agrees(&model, "jnt_limited", &[1.0]);
    agrees(&model, "jnt_range", &[0.0, 0.0]);
    assert_eq!(model.tables().limits[0].range, [0.0, 0.0]);
}

#[test]
fn infinite_ranges_never_act() {
    let model = with("type='slide' range='-inf 0.5'", "<motor joint='j' forcerange='-inf inf' ctrlrange='0 inf'/>");
    agrees(&model, "jnt_limited", &[1.0]);
    agrees(&model, "actuator_forcelimited", &[1.0]);
    agrees(&model, "actuator_ctrllimited", &[1.0]);
    let array = |name: &str| match &model.array(name).expect(name).data {
        crate::model::ArrayData::F64(x) => x.clone(),
        crate::model::ArrayData::I32(_) => panic!("real"),
    };
    assert_eq!(array("jnt_range"), [-INF, 0.5]);
    assert_eq!(array("actuator_forcerange"), [-INF, INF]);
    assert_eq!(array("actuator_ctrlrange"), [0.0, INF]);
    assert_eq!(model.tables().limits[0].range, [-1e11, 0.5]);
    assert!(!model.tables().actuators[0].force_limited && model.tables().controls[0].limited);
    assert_eq!(model.control_range(0), [0.0, 2.0]);
    assert!(with("range='-inf inf'", "").tables().limits.is_empty());
    let bounded = with("actuatorfrcrange='-inf 3'", "<motor joint='j'/>");
    assert_eq!(bounded.tables().joints[0].force_range, [-f64::from(f32::MAX), 3.0]);
}

#[test]
fn ranges_that_are_empty_bound_nothing_and_are_noted() {
    let model = with("range='1 1' actuatorfrcrange='2 -2'", "<motor joint='j' ctrlrange='1 -1' forcerange='1 1'/>");
    for name in ["jnt_limited", "jnt_actfrclimited", "actuator_ctrllimited", "actuator_forcelimited"] {
        agrees(&model, name, &[0.0]);
    }
    assert_eq!(
        model.report().notes,
        ["line 1: ranges are empty and limit nothing: joint \"j\" range 1 1, joint \"j\" actuatorfrcrange 2 -2, \
             actuator #0 ctrlrange 1 -1, actuator #0 forcerange 1 1"]
    );
}

/// However many elements a sentence is true of, it is said once.
#[test]
fn notes_are_bounded() {
    let joint = "range='1 1' actuatorfrcrange='2 -2' stiffness='-1'";
    let inertial = "<inertial pos='0 0 0' mass='1' diaginertia='1 1 3'/>";
    let bodies = format!("<body><joint {joint}/>{inertial}</body>").repeat(2000);
    let text = format!("<mujoco><compiler balanceinertia='true'/><worldbody>{bodies}</worldbody></mujoco>");
    assert_eq!(
        load(&text).report().notes,
        [
            "line 1: inertia violated A + B >= C and was replaced by its mean: body #1, body #2, body #3, body #4, \
             body #5 and 1995 more",
            "line 1: stiffness is negative, the spring pushes away: joint #0, joint #1, joint #2, joint #3, joint #4 and \
             1995 more",
            "line 1: ranges are empty and limit nothing: joint #0 range 1 1, joint #0 actuatorfrcrange 2 -2, joint #1 \
             range 1 1, joint #1 actuatorfrcrange 2 -2, joint #2 range 1 1 and 3995 more",
        ]
    );
}

#[test]
fn a_moving_free_body_is_aligned() {
    let model = load(
        "<mujoco><worldbody><body name='b'><freejoint align='true'/><geom type='box' size='0.1 0.2 0.3' mass='9'/>\
         <geom size='0.1' pos='1 0 0' mass='4'/></body></worldbody></mujoco>",
    );
    agrees(&model, "body_pos", &[0.0, 0.0, 0.0, 4.0 / 13.0, 0.0, 0.0]);
    agrees(&model, "body_ipos", &[0.0; 6]);
    agrees(&model, "qpos0", &[4.0 / 13.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5]);
}

const KEYS: &str = "<worldbody><body mocap='true' pos='1 2 3'><geom size='.1'/></body>\
    <body mocap='true' pos='4 5 6'><geom size='.1'/></body>\
    <body><freejoint/><geom size='0.1'/><body><joint type='slide' ref='0.3'/><geom size='0.1'/>\
    <body><joint name='h' type='ball'/><geom size='.1'/></body></body></body></worldbody>\
    <actuator><motor joint='h'/><motor joint='h'/></actuator>";

#[test]
fn short_keyframes_are_filled() {
    let key =
        |text: &str| load(&format!("<mujoco>{KEYS}<keyframe><key {text}/></keyframe></mujoco>")).keys()[0].clone();
    let rest = [1.0, 0.0, 0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0];
    assert_eq!(key("qpos='0 0 2'").qpos, [&[0.0, 0.0, 2.0], &rest[..]].concat());
    assert_eq!(key("qpos='0 0 2 2 0'").qpos, [&[0.0, 0.0, 2.0], &rest[..]].concat());
    assert_eq!(key("qpos='0 0 2 0 0 0 0'").qpos, [&[0.0, 0.0, 2.0], &rest[..]].concat());
    assert_eq!(key("qvel='0 0 0 3'").qvel, [0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(key("ctrl='1'").ctrl, [1.0, 0.0]);
    assert_eq!(key("mpos='7'").mpos, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(key("mpos='7 8 9 10'").mpos, [7.0, 8.0, 9.0, 4.0, 5.0, 6.0]);
    assert_eq!(key("mquat='0 1 0 0 1'").mquat, [0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let long = Model::from_xml_string(
        &format!("<mujoco>{KEYS}<keyframe>\n<key act='1'/></keyframe></mujoco>"),
        &LoadOptions::default(),
    );
    assert_eq!(
        long.expect_err("too long").to_string(),
        "2: key #0: act has 1 numbers, the model has 0 (give at most 0 numbers; those that are missing are filled in)"
    );
}

#[test]
fn the_gravity_array_stays_while_its_flag_is_off() {
    let model = load(
        "<mujoco><option><flag gravity='disable'/></option><worldbody><body><freejoint/><geom size='0.1'/></body>\
         </worldbody></mujoco>",
    );
    agrees(&model, "gravity", &[0.0, 0.0, -9.81]);
    assert_eq!(model.tables().gravity, [0.0; 3]);
}
