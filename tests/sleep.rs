//! Trees that sleep: when they fall asleep and when they wake, as MuJoCo has it; what holds them; on every backend.

use crate::support::{options, parse};
use lanesim::mjcf::LoadOptions;
use lanesim::{Backend, Field, Model, Precision, Worlds};

/// Boxes on each other, a ball that falls on them, two slides that an equality constraint joins, a tree with an actuator, one that is
/// to stay awake, and one that starts asleep in the air.
const SCENE: &str = r#"<mujoco>
  <option timestep="0.004" sleep_tolerance="0.005"><flag sleep="enable"/></option>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body pos="0 0 0.0995"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
    <body pos="0.02 0 0.2985"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
    <body pos="0 0 2.5"><freejoint/><geom type="sphere" size="0.08"/></body>
    <body pos="1 0 0.5">
      <joint name="drawn" type="slide" axis="1 0 0" damping="5"/><geom type="sphere" size="0.1"/>
    </body>
    <body pos="1 1 0.5">
      <joint name="linked" type="slide" axis="1 0 0" damping="5"/><geom type="sphere" size="0.1"/>
    </body>
    <body pos="2 0 0.5">
      <joint name="driven" axis="0 1 0" damping="1"/><geom type="capsule" size="0.05 0.2" pos="0 0 -0.2"/>
    </body>
    <body pos="3 0 0.5" sleep="never">
      <joint axis="0 0 1" damping="1"/><geom type="capsule" size="0.05 0.2" pos="0 0 -0.2"/>
    </body>
    <body pos="4 0 1" sleep="init"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
  </worldbody>
  <equality><joint joint1="drawn" joint2="linked"/></equality>
  <actuator><motor joint="driven"/></actuator>
</mujoco>"#;

/// Steps after which others sleep than before, and MuJoCo's `tree_asleep` then, at least 0 where trees sleep; before step 201, and in it
/// alone, the first slide is pushed.
const MUJOCO: [(usize, [i32; 8]); 7] = [
    (1, [-9, -9, -9, -9, -9, -11, -11, 7]),
    (9, [-10, -11, -11, 4, 3, -11, -11, 7]),
    (27, [1, 0, -11, 4, 3, -11, -11, 7]),
    (161, [-10, -10, -11, 4, 3, -11, -11, 7]),
    (201, [-1, -1, -11, -11, -10, -11, -11, 7]),
    (211, [-1, -1, -4, 4, 3, -11, -11, 7]),
    (214, [1, 2, 0, 4, 3, -11, -11, 7]),
];
const PUSHED: usize = 18;

fn asleep(worlds: &Worlds, world: usize) -> Vec<i32> {
    let rest = worlds.get(Field::TreeRest, world).expect("a world");
    rest.iter().map(|steps| *steps as i32 - 11).collect()
}

fn push(worlds: &mut Worlds, world: usize, force: f64) {
    let mut forces = vec![0.0; worlds.model().tables().sizes.nv];
    forces[PUSHED] = force;
    worlds.set(Field::QfrcApplied, world, &forces).expect("a world");
}

/// World 1 of three does what MuJoCo's does; the others are pushed all the time, and what they do is nothing to it.
fn as_in_mujoco(precision: Precision, backend: Backend) -> Vec<f64> {
    let model = parse(SCENE);
    let mut worlds = Worlds::new(&model, 3, &options(precision, backend)).expect("a batch");
    [0, 2].into_iter().for_each(|world| push(&mut worlds, world, 1.0));
    let mut changes = Vec::new();
    let mut before = vec![true; 8];
    for step in 1..=300 {
        push(&mut worlds, 1, if step == 201 { 1.0 } else { 0.0 });
        worlds.step(1).expect("a step");
        let now = asleep(&worlds, 1);
        let sleeps: Vec<bool> = now.iter().map(|tree| *tree >= 0).collect();
        if sleeps != before {
            changes.push((step, <[i32; 8]>::try_from(now).expect("eight trees")));
            before = sleeps;
        }
    }
    assert_eq!(changes, MUJOCO, "{precision:?} {backend:?}");
    assert!(asleep(&worlds, 0)[3] < 0 && asleep(&worlds, 2)[4] < 0);
    let velocities = worlds.get(Field::Qvel, 1).expect("a world");
    assert!(velocities[..20].iter().chain(&velocities[22..]).all(|v| *v == 0.0), "{velocities:?}");
    // What starts asleep hangs in the air.
    assert_eq!(worlds.get(Field::Qpos, 1).expect("a world")[25..28], [4.0, 0.0, 1.0]);
    worlds.get_all(Field::Qpos)
}

#[test]
fn trees_sleep_when_mujocos_do() {
    let native = as_in_mujoco(Precision::F64, Backend::Native);
    assert_eq!(native, as_in_mujoco(Precision::F64, Backend::Scalar));
    assert_eq!(as_in_mujoco(Precision::F32, Backend::Wide), as_in_mujoco(Precision::F32, Backend::Native));
}

#[test]
fn what_is_moved_wakes() {
    let model = parse(SCENE);
    let mut worlds = Worlds::new(&model, 1, &options(Precision::F64, Backend::Auto)).expect("a batch");
    let settle = |worlds: &mut Worlds| {
        worlds.step(300).expect("steps");
        assert_eq!(asleep(worlds, 0)[..5], [1, 2, 0, 4, 3]);
    };
    settle(&mut worlds);
    let rest = worlds.get(Field::TreeRest, 0).expect("a world");
    let mut velocities = worlds.get(Field::Qvel, 0).expect("a world");
    velocities[19] = 1e-9;
    worlds.set(Field::Qvel, 0, &velocities).expect("a world");
    worlds.step(1).expect("a step");
    assert_eq!(asleep(&worlds, 0)[..5], [1, 2, 0, -10, -10]);
    settle(&mut worlds);
    let mut forces = vec![0.0; 6 * model.tables().sizes.nbody];
    forces[6] = 1e-3;
    worlds.set(Field::XfrcApplied, 0, &forces).expect("a world");
    worlds.step(1).expect("a step");
    assert_eq!(asleep(&worlds, 0)[..5], [-11, -10, -10, 4, 3]);
    // A force that stays keeps its tree awake, and what it touches.
    worlds.step(100).expect("steps");
    assert_eq!(asleep(&worlds, 0)[..5], [-11, -1, -1, 4, 3]);
    worlds.set(Field::XfrcApplied, 0, &vec![0.0; forces.len()]).expect("a world");
    settle(&mut worlds);
    // Positions wake a world; a state that holds its trees' rest restores it.
    let positions = worlds.get(Field::Qpos, 0).expect("a world");
    worlds.set(Field::Qpos, 0, &positions).expect("a world");
    assert!(asleep(&worlds, 0).iter().all(|tree| *tree == -11));
    worlds.set(Field::TreeRest, 0, &rest).expect("a world");
    assert_eq!(asleep(&worlds, 0)[..5], [1, 2, 0, 4, 3]);
    worlds.reset(0, None).expect("a world");
    assert_eq!(asleep(&worlds, 0), [-10, -10, -10, -10, -10, -11, -11, 7]);
}

#[test]
fn policies_are_those_of_trees() {
    let refused = |body: &str, problem: &str| {
        let text = format!("<mujoco><worldbody>{body}</worldbody></mujoco>");
        let problems = Model::from_xml_string(&text, &LoadOptions::default()).expect_err("refused").to_string();
        assert!(problems.contains(problem), "{problems}");
    };
    let what = "has sleep, and is not the first body of a tree that moves (give it to the first body with joints)";
    refused("<body name='a' sleep='never'><geom size='1'/></body>", &format!("body \"a\": {what}"));
    let inner = "<body><joint/><geom size='1'/><body name='b' sleep='allowed'><geom size='1'/></body></body>";
    refused(inner, &format!("body \"b\": {what}"));
    refused("<body sleep='often'><joint/><geom size='1'/></body>", "sleep");
    // Without the flag nothing sleeps, and nothing is kept of it.
    let awake = SCENE.replace("<flag sleep=\"enable\"/>", "");
    assert_eq!(parse(&awake).tables().sizes.nsleep, 0);
    // What touches a tree that is awake cannot start asleep.
    let touching = SCENE.replace("pos=\"4 0 1\"", "pos=\"0 0 0.15\"");
    let model = parse(&touching);
    let note =
        "1 of 1 trees with sleep=\"init\" start awake: in the reference configuration they touch one that is awake";
    assert!(model.report().notes.iter().any(|told| told == note), "{:?}", model.report().notes);
    // A tolerance of zero: nothing is ever slow enough.
    let never = SCENE.replace("sleep_tolerance=\"0.005\"", "sleep_tolerance=\"0\"").replace(" sleep=\"init\"", "");
    let mut worlds = Worlds::new(&parse(&never), 1, &options(Precision::F64, Backend::Auto)).expect("a batch");
    worlds.step(50).expect("steps");
    assert!(asleep(&worlds, 0).iter().all(|tree| *tree < 0));
}

#[test]
fn what_cannot_be_counted_is_awake() {
    let model = parse(SCENE);
    for bad in [f64::NAN, f64::INFINITY, -3.0, 1e9, 19.0, 12.5] {
        let mut worlds = Worlds::new(&model, 2, &options(Precision::F64, Backend::Auto)).expect("a batch");
        worlds.set_unchecked(Field::TreeRest, 1, &[bad; 8]).expect("a world");
        worlds.step(2).expect("steps");
        assert_eq!(asleep(&worlds, 0), [-8, -11, -11, -8, -8, -11, -11, 7], "{bad}");
        assert!(asleep(&worlds, 1).iter().all(|tree| (-11..8).contains(tree)), "{bad}");
    }
}
