//! `attach`: what a part brings, and what is refused.

use std::collections::BTreeMap;

use super::ok;
use crate::Model;
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
    assert_eq!((&key.parts[1].qpos, &key.controls[1]), (&vec![2.0], &("x_n".to_string(), vec![0.2])));
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
        (
            "<attach body='gone' prefix='x'/>",
            "the model has no body \"gone\" (name a part that is not attached itself)",
        ),
        ("<attach prefix='x'/>", "nothing to attach (give body or frame, or a model)"),
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

/// What MuJoCo makes of a part that a model attaches of itself: all that is about it alone, with the prefix; keyframes stay as they are.
#[test]
fn a_part_of_the_same_model() {
    let text = "<mujoco>
        <default><default class='c'><geom size='.3'/></default></default>
        <worldbody>
          <body name='a' pos='0 0 1' childclass='c'>
            <joint name='j'/><geom name='g'/><site name='s'/>
            <body name='b'><joint name='k'/><geom/></body>
          </body>
          <frame pos='1 0 0'><attach body='a' prefix='x_'/></frame>
          <attach body='b' prefix='y_'/>
        </worldbody>
        <actuator><motor name='m' joint='j'/></actuator>
        <sensor><jointpos name='sj' joint='j'/></sensor>
        <contact><exclude body1='a' body2='b'/></contact>
        <equality><joint name='q' joint1='j' joint2='k'/></equality>
        <keyframe><key name='kk' qpos='1 2'/></keyframe>
      </mujoco>";
    let model = Model::from_xml_string(text, &LoadOptions::default()).unwrap_or_else(|problems| panic!("{problems}"));
    let id = |name: &str| model.names().joints.id(name);
    assert_eq!(["j", "k", "x_j", "x_k", "y_k"].map(id), [0, 1, 2, 3, 4].map(Some));
    let sizes = model.sizes();
    let count = |name: &str| sizes.iter().find(|(known, _)| *known == name).map(|(_, n)| *n);
    assert_eq!([count("nu"), count("nsensor"), count("neq"), count("nexclude")], [Some(2); 4]);
    assert_eq!(model.keys()[0].qpos, [1.0, 2.0, 0.0, 0.0, 0.0]);
    // A part that is around the place, once.
    let around = "<mujoco><worldbody>
          <body name='w'><geom size='1'/><attach body='w' prefix='y_'/></body>
        </worldbody></mujoco>";
    assert_eq!(ok(around).bodies.len(), 3);
}
