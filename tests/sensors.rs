//! Sensors against MuJoCo's, one by one; that nobody else pays for them; and errors of sensors that cannot be.

use crate::support;
use crate::support::golden::{Failures, Golden};
use crate::support::{agree, load, options, parse};
use lanesim::mjcf::LoadOptions;
use lanesim::{Backend, Model, Options, Precision, Rollout, Worlds};

/// Every sensor of every model that has some, in its recorded states, judged by the largest number of its kind: a force may be what is
/// left of larger ones.
fn measures(precision: Precision, tolerance: f64) {
    let mut failures = Failures::default();
    let mut seen = 0;
    for golden in Golden::all().into_iter().filter(|golden| !golden.model.names().sensors.is_empty()) {
        seen += 1;
        let ours = golden.eval(&["sensordata"], 0, &options(precision, Backend::Auto));
        let expected = golden.rows(&golden.array("out/sensordata"));
        for (state, (got, expected)) in ours["sensordata"].iter().zip(&expected).enumerate() {
            for (i, sensor) in golden.model.tables().sensors.iter().enumerate() {
                let place = || format!("{} state {state} sensor {i} {:?}", golden.name, sensor.kind);
                let alike = golden.model.tables().sensors.iter().filter(|other| other.kind == sensor.kind);
                let size = alike.map(|other| support::largest(&expected[other.data.range()])).fold(1.0, f64::max);
                let range = sensor.data.range();
                failures.check(place, agree(&got[range.clone()], &expected[range], tolerance, size));
            }
        }
    }
    assert!(seen > 0, "no model has sensors");
    failures.report();
}

#[test]
fn measures_are_mujocos_f64() {
    measures(Precision::F64, 1e-9);
}

#[test]
fn measures_are_mujocos_f32() {
    measures(Precision::F32, 3e-3);
}

/// A recorded measure is that of the state from which a step starts, whichever other outputs are asked for, and the run leaves the same
/// bits as one without sensors.
#[test]
fn rollouts_record_measures_and_leave_the_same_states() {
    let model = load("unit/sensors");
    let run = |names: &[&str]| {
        let mut worlds = Worlds::new(&model, 3, &Options::default()).expect("worlds");
        let outputs: Vec<_> = names.iter().map(|name| model.output(name).expect("output")).collect();
        let rollout = Rollout { nstep: 20, outputs: &outputs, ..Rollout::default() };
        worlds.rollout(&rollout).expect("rollout").outputs
    };
    let both = run(&["qpos", "sensordata"]);
    assert_eq!(both[0], run(&["qpos"])[0]);
    assert_eq!(both[1], run(&["sensordata"])[0]);
    // The clock is the last but the user's: 0 at the state from which the first step starts.
    let n = model.tables().sizes.nsensordata;
    assert_eq!((both[1][n - 3], both[1][2 * n - 3]), (0.0, model.tables().options.timestep));
}

#[test]
fn sensors_switched_off_are_zeros() {
    let model = support::load_with("unit/sensors", &[("sensor", "disable")]);
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("worlds");
    let outputs = [model.output("sensordata").expect("output")];
    let found =
        worlds.rollout(&Rollout { nstep: 1, outputs: &outputs, ..Rollout::default() }).expect("rollout").outputs;
    assert!(found[0].iter().all(|x| *x == 0.0));
}

#[test]
fn sensors_that_cannot_be_are_refused() {
    let refused = |sensor: &str| {
        let xml = format!(
            "<mujoco><worldbody><body name='arm'><joint name='hinge' range='0 1'/><joint name='free hinge'/>\
             <geom name='ball' size='.1'/><site name='tip'/><camera name='eyes'/>\
             <camera name='follower' mode='track'/><camera name='dark' resolution='0 3'/><camera name='wide' fovy='180'/>\
             <camera name='blind' sensorsize='1 1' focal='0 1'/><camera name='vast' resolution='100000 100000'/><body name='hand'><joint name='ball' type='ball'/>\
             <geom name='palm' size='.1' pos='1 0 0'/></body></body></worldbody>\n<sensor>{sensor}</sensor></mujoco>"
        );
        match Model::from_xml_string(&xml, &LoadOptions::default()) {
            Ok(_) => panic!("{sensor} was accepted"),
            Err(error) => error.to_string(),
        }
    };
    let cases = [
        ("<touch/>", "2: touch: attribute \"site\" is missing"),
        ("<touch site='tap'/>", "2: touch #0: unknown site \"tap\" (did you mean \"tip\"?)"),
        ("<gyro name='g' site='tip' cutoff='-1'/>", "gyro \"g\": cutoff is negative: -1"),
        ("<gyro site='tip' noise='-1'/>", "noise is negative: -1"),
        ("<framequat objtype='site' objname='tip' cutoff='1'/>", "an axis or quaternion cannot be cut off"),
        ("<framepos objtype='site'/>", "attribute \"objname\" is missing"),
        ("<framepos objtype='site' objname='tip' reftype='body'/>", "attribute \"refname\" is missing"),
        ("<framepos objtype='joint' objname='hinge'/>", "attribute \"objtype\""),
        ("<jointpos joint='ball'/>", "joint \"ball\" is neither a slide nor a hinge"),
        ("<ballquat joint='hinge'/>", "joint \"hinge\" is not a ball"),
        ("<jointlimitpos joint='free hinge'/>", "joint \"free hinge\" has no limits"),
        ("<user dim='2' datatype='axis'/>", "dim is 2 (this datatype has dim 3)"),
        ("<user dim='-1'/>", "-1 is negative"),
        (
            "<gyro name='g' site='tip' delay='.1'/>",
            "gyro \"g\": delay 0.1, but it keeps no samples (give nsample, at least delay over timestep)",
        ),
        ("<framepos objtype='camera' objname='eye'/>", "unknown camera \"eye\" (did you mean \"eyes\"?)"),
        ("<framepos objtype='camera' objname='follower'/>", "camera \"follower\" tracks something"),
        ("<rangefinder camera='dark'/>", "camera \"dark\" has no pixels"),
        ("<rangefinder camera='wide'/>", "fovy of camera \"wide\" is 180"),
        ("<rangefinder camera='blind'/>", "camera \"blind\" has no focal length"),
        ("<rangefinder camera='eyes' site='tip'/>", "both site and camera are given"),
        ("<rangefinder/>", "attribute \"site\" is missing"),
        ("<rangefinder site='tip' data='normal dist'/>", "attribute \"data\": \"dist\" is out of order"),
        ("<rangefinder site='tip' data='dist dist'/>", "\"dist\" is out of order"),
        ("<rangefinder site='tip' data='dost'/>", "is not one of dist, dir, origin, point, normal, depth"),
        ("<distance geom1='ball'/>", "attribute \"geom2\" is missing (give geom2 or body2)"),
        ("<distance geom1='ball' body1='arm' geom2='palm'/>", "both geom1 and body1 are given"),
        ("<normal geom1='ball' geom2='ball'/>", "both sides have the same geom"),
        ("<fromto geom1='ball' body2='arm'/>", "both sides have the same geom"),
        ("<distance geom1='ball' geom2='plam'/>", "unknown geom \"plam\" (did you mean \"palm\"?)"),
        ("<contact geom1='ball' site='tip'/>", "both geom1 and site are given"),
        ("<contact body1='leg'/>", "unknown body \"leg\""),
        ("<contact data='force found'/>", "attribute \"data\": \"found\" is out of order (give each once"),
        ("<contact data='power'/>", "is not one of found, force, torque, dist"),
        ("<contact num='0'/>", "attribute \"num\": 0 is not positive"),
        ("<contact num='2000000' data='force torque'/>", "sensors have 12000000 numbers"),
        ("<contact reduce='netforce' data='linvel'/>", "a net force has no velocity"),
        ("<contact reduce='least'/>", "attribute \"reduce\""),
        ("<camprojection site='tip'/>", "attribute \"camera\" is missing"),
        ("<rangefinder camera='vast' data='dist dir'/>", "sensors have 40000000000 numbers"),
        ("<tactile geom='ball' mesh='m'/>", "sensors of kind tactile are not supported"),
        ("<gyro site='tip' objtype='site'/>", "unknown attribute \"objtype\""),
        ("<clock name='a'/><clock name='a'/>", "repeated name"),
    ];
    for (sensor, message) in cases {
        let error = refused(sensor);
        assert!(error.contains(message), "{sensor}: {error}");
    }
}

/// A force sensor on a body that rests on nothing but its parent carries its weight: 2 kg, and 3 kg that it carries.
#[test]
fn a_force_sensor_carries_the_weight_above_it() {
    let model = parse(
        "<mujoco><worldbody><body name='low'><geom size='.1' mass='2'/><site name='low' pos='0 0 -.1'/>\
         <body pos='.5 0 0'><geom size='.1' mass='3'/></body></body></worldbody>\
         <sensor><force site='low'/><torque site='low'/></sensor></mujoco>",
    );
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("worlds");
    let outputs = [model.output("sensordata").expect("output")];
    let found =
        worlds.rollout(&Rollout { nstep: 1, outputs: &outputs, ..Rollout::default() }).expect("rollout").outputs;
    let expected = [0.0, 0.0, 5.0 * 9.81, 0.0, -3.0 * 9.81 * 0.5, 0.0];
    assert!(found[0].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{:?}", found[0]);
}

/// Built in code, a sensor may lack what MJCF demands, and a keyframe speak of a body that is not there.
#[test]
fn sensors_built_in_code_are_checked() {
    use lanesim::spec::{Body, Geom, Joint, Key, KeyPart, Object, ObjectKind, Sensor, SensorKind, Shape, Site, Spec};
    let build = |sensor: Sensor| {
        let mut spec = Spec::new("");
        let geoms = vec![Geom { shape: Shape::Sphere, size: [0.1, 0.0, 0.0], ..Geom::default() }];
        let sites = vec![Site { name: "tip".into(), ..Site::default() }];
        let joints = vec![Joint { name: "hinge".into(), ..Joint::default() }];
        spec.add_body(0, Body { joints, geoms, sites, ..Body::default() });
        spec.keys.push(Key { parts: vec![KeyPart { body: 9, ..KeyPart::default() }], ..Key::default() });
        spec.sensors.push(sensor);
        lanesim::compile(&spec)
    };
    let about = |kind: ObjectKind, name: &str| Some(Object { kind, name: name.into() });
    let (site, joint) = (about(ObjectKind::Site, "tip"), about(ObjectKind::Joint, "hinge"));
    for kind in SensorKind::ALL.iter().copied().filter(|kind| *kind != SensorKind::User) {
        let alone =
            matches!(kind, SensorKind::EPotential | SensorKind::EKinetic | SensorKind::Clock | SensorKind::Contact);
        assert_eq!(build(Sensor { kind, ..Sensor::default() }).is_ok(), alone, "{kind:?}");
        let wrong = if kind.tag().starts_with("joint") || kind.tag().starts_with("ball") { &site } else { &joint };
        assert!(build(Sensor { kind, object: wrong.clone(), ..Sensor::default() }).is_err(), "{kind:?}");
    }
    let inside = Sensor { kind: SensorKind::InsideSite, object: site.clone(), ..Sensor::default() };
    assert!(build(inside.clone()).is_err());
    assert!(build(Sensor { reference: site, ..inside }).is_ok());
}
