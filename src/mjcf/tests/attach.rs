//! `attach`: what a part brings, and what is refused.

use std::collections::BTreeMap;

use crate::mjcf::{LoadOptions, parse_with_files};
use crate::spec::Spec;

const CHILD: &str = "<mujoco model='child'><option timestep='.001'/><worldbody><geom name='g0' size='.1'/>\
    <frame name='f' pos='1 0 0'><body name='a' pos='0 0 1'><joint name='j' damping='3'/><geom name='ga' size='.1'/>\
    <site name='s'/><body name='b'><joint name='k'/><geom size='.1' pos='1 0 0'/></body></body></frame>\
    <body name='z'><freejoint/><geom size='.1'/></body></worldbody>\
    <contact><exclude body1='a' body2='z'/><exclude body1='a' body2='b'/><pair geom1='g0' geom2='ga'/></contact>\
    <actuator><motor name='m' joint='j'/><motor name='n' joint='k'/></actuator>\
    <sensor><jointpos joint='k'/><actuatorfrc actuator='m'/><clock/></sensor>\
    <keyframe><key name='up' time='3' qpos='1 2 0 0 0 1 0 0 0' ctrl='.1 .2'/></keyframe></mujoco>";

fn attached(body: &str, setting: &str) -> Result<Spec, String> {
    let text = format!(
        "<mujoco>{setting}<asset><model name='child' file='child.xml'/></asset><worldbody><body name='p'><joint name='pj'/>\
         <geom size='.1'/><frame pos='0 0 2'>{body}</frame></body></worldbody></mujoco>"
    );
    let around = "<mujoco><asset><model name='child' file='round.xml'/></asset><worldbody><attach model='child' prefix='x'/>\
        </worldbody></mujoco>";
    let files = [("child.xml", CHILD), ("round.xml", around)];
    let files: BTreeMap<String, Vec<u8>> =
        files.map(|(name, text)| (name.to_string(), text.as_bytes().to_vec())).into();
    parse_with_files(&text, &files, &LoadOptions::default()).map_err(|error| error.to_string())
}

#[test]
fn a_body_comes_with_what_is_about_it_alone() {
    let spec = attached("<attach model='child' body='a' prefix='x_'/>", "").unwrap();
    let names: Vec<&str> = spec.bodies.iter().map(|body| body.name.as_str()).collect();
    assert_eq!(names, ["world", "p", "x_a", "x_b"]);
    assert_eq!((spec.bodies[2].parent, spec.bodies[2].pos), (1, [0.0, 0.0, 3.0]));
    assert_eq!(spec.bodies[2].joints[0].damping[0], 3.0);
    assert_eq!((spec.pairs.len(), spec.excludes.len(), spec.sensors.len()), (0, 1, 3));
    assert_eq!(spec.excludes[0].body1, "x_a");
    let actuators: Vec<&str> = spec.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
    assert_eq!(actuators, ["x_m", "x_n"]);
    let key = &spec.keys[0];
    assert_eq!((key.name.as_str(), key.time, key.parts.len()), ("x_up", 3.0, 2));
    assert_eq!((&key.parts[1].qpos, &key.controls[1]), (&vec![2.0], &("x_n".to_string(), 0.2)));
    assert!(spec.notes.iter().any(|note| note.contains("options of the attached model give way")), "{:?}", spec.notes);
}

#[test]
fn frames_and_whole_models() {
    let frame = attached("<attach model='child' frame='f' prefix='x_'/>", "").unwrap();
    assert_eq!(frame.bodies[2].pos, [1.0, 0.0, 3.0]);
    let inner =
        attached("<attach model='child' body='b' prefix='x_'/><attach model='child' body='b' prefix='y_'/>", "")
            .unwrap();
    assert_eq!((inner.bodies.len(), inner.actuators.len(), inner.sensors.len()), (4, 2, 4));
    assert_eq!(inner.keys[1].parts[0].qpos, [2.0]);
    assert_eq!(inner.keys[1].parts[0].body, 3);
}

#[test]
fn options_meet_as_conflict_says() {
    let step = |setting: &str| {
        attached("<attach model='child' body='a' prefix='x'/>", setting).map(|spec| spec.option.timestep)
    };
    assert_eq!(step(""), Ok(0.002));
    assert_eq!(step("<compiler conflict='merge'/>"), Ok(0.001));
    assert_eq!(step("<compiler conflict='merge'/><option timestep='.0005'/>"), Ok(0.0005));
    let error = step("<compiler conflict='error'/><option timestep='.004'/>").unwrap_err();
    assert!(error.contains("options of the attached model differ from the model's own: timestep"), "{error}");
}

#[test]
fn what_cannot_be_attached() {
    let cases = [
        ("<attach model='child' body='a'/>", "attribute \"prefix\" is missing"),
        ("<attach model='chil' body='a' prefix='x'/>", "no asset is a model \"chil\" (did you mean \"child\"?)"),
        ("<attach model='child' body='q' prefix='x'/>", "the model has no body \"q\""),
        ("<attach model='child' body='a' frame='f' prefix='x'/>", "both body and frame are given"),
        ("<attach body='p' prefix='x'/>", "attaching a part of the same model is not supported"),
        ("<attach modl='child' prefix='x'/>", "unknown attribute \"modl\""),
    ];
    for (body, message) in cases {
        let error = attached(body, "").unwrap_err();
        assert!(error.contains(message), "{body}: {error}");
    }
    let round = attached("<attach model='round' prefix='x'/>", "<asset><model name='round' file='round.xml'/></asset>")
        .unwrap_err();
    assert!(round.contains("the model attaches itself"), "{round}");
    let missing = attached("", "<asset><model name='gone' file='gone.xml'/></asset>").unwrap_err();
    assert!(missing.contains("file \"gone.xml\": no such file among those given"), "{missing}");
}
