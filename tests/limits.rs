//! Memory, time and lengths have limits, and what is beyond them is an error with the figure.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::support::{load, options};
use lanesim::outputs::Output;
use lanesim::rows::{Rows, Strided, Values};
use lanesim::{Backend, Error, Field, Model, Options, Parameter, Precision, Rollout, Worlds};

/// Free bodies with geoms of these attributes.
fn free_bodies(count: usize, geom: &str) -> Model {
    let body = format!("<body><freejoint/><geom size='.1' {geom}/></body>");
    let bodies = format!("<replicate count='{count}' offset='.3 0 .1'>{body}</replicate>");
    let text = format!("<mujoco><worldbody>{bodies}</worldbody></mujoco>");
    Model::from_xml_string(&text, &Default::default()).expect("a model")
}

#[test]
fn scratch_beyond_the_limit_is_refused_with_the_figures() {
    let model = free_bodies(150, "");
    let (world, thread) = Worlds::memory_of(&model, &Options::default());
    let batch = |limit, threads| {
        Worlds::new(&model, 3, &Options { max_memory: Some(limit), threads: Some(threads), ..Options::default() })
    };
    let refused = batch(thread / 2, 1).err().expect("too little memory");
    let Error::MemoryLimit { bytes, limit, .. } = &refused else { panic!("{refused}") };
    assert!(*bytes >= thread && *limit == thread / 2, "{refused}");
    assert!(refused.to_string().contains("max_memory"), "{refused}");
    // 3 worlds are one block: of 8 threads one has something to do.
    let worlds = batch(thread + 8 * world + 10_000, 8).expect("memory for one thread");
    assert_eq!(worlds.memory(), (world, thread));
}

#[test]
fn a_model_without_contacts_takes_memory_in_proportion_to_its_bodies() {
    let of = |count| free_bodies(count, "contype='0' conaffinity='0'");
    let options = Options { threads: Some(1), ..Options::default() };
    let small = Worlds::memory_of(&of(1000), &options).1;
    let model = of(10_000);
    assert!(Worlds::memory_of(&model, &options).1 < 11 * small);
    // Nor is code made for it that no cache holds.
    let mut worlds = Worlds::new(&model, 1, &options).expect("a batch");
    let start = Instant::now();
    worlds.step(1).expect("a step");
    assert!(start.elapsed() < Duration::from_secs(5));
}

/// The actuators of a large model each took as long as the whole model is large: a minute here, hours for larger ones.
#[test]
fn many_actuators_on_many_bodies_compile_in_time() {
    let arm = "<body name='a' pos='.1 0 0'><joint name='j'/><geom size='.1'/></body>";
    for (count, frame) in [(60000, ""), (5000, "<freejoint/><geom size='.1'/>")] {
        let text = format!(
            "<mujoco><worldbody><body>{frame}<replicate count='{count}' offset='.3 0 .1'>{arm}</replicate></body></worldbody>
            <default><geom contype='0' conaffinity='0'/></default><actuator><motor joint='j'/></actuator></mujoco>"
        );
        let begin = Instant::now();
        let model = Model::from_xml_string(&text, &Default::default()).expect("a model");
        assert!(model.sizes().contains(&("nu", count)), "{:?}", model.sizes());
        assert!(begin.elapsed() < Duration::from_secs(20), "{:?}", begin.elapsed());
    }
}

#[test]
fn fields_beyond_the_limit_are_an_error() {
    let model = load("zoo/ant");
    let n = 20_000;
    let nq = model.tables().sizes.nq;
    let qpos = lanesim::npz::Array::new(vec![n, nq], lanesim::npz::Data::F64(model.tables().qpos0.repeat(n)));
    let inputs = BTreeMap::from([("qpos".to_owned(), qpos.expect("an array"))]);
    let few = Options { max_memory: Some(20_000_000), threads: Some(1), ..Options::default() };
    lanesim::eval::eval(&model, &inputs, &["time"], 0, &few).expect("worlds and times");
    let error = lanesim::eval::eval(&model, &inputs, &["qM"], 0, &few).expect_err("31 MB");
    assert!(matches!(error, Error::MemoryLimit { .. }), "{error}");
}

#[test]
fn a_long_run_of_frozen_worlds_can_be_stopped() {
    let model = load("zoo/cheetah");
    let mut worlds = Worlds::new(&model, 3, &options(Precision::F64, Backend::Auto)).expect("a batch");
    for world in 0..3 {
        worlds.set_unchecked(Field::Qvel, world, &[f64::NAN; 9]).expect("a world");
    }
    worlds.step(1).expect("a step");
    assert_eq!(worlds.lost(), 3);
    let cancel = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let run = Rollout { nstep: 1 << 40, cancel: Some(&cancel), ..Rollout::default() };
        let stopped = scope.spawn(move || worlds.rollout(&run).map(|_| ()));
        std::thread::sleep(Duration::from_millis(20));
        cancel.store(true, Ordering::Relaxed);
        assert!(matches!(stopped.join().expect("a result"), Err(Error::Cancelled)));
    });
}

#[test]
fn lengths_that_do_not_fit_are_errors() {
    let model = load("zoo/ant");
    let mut worlds = Worlds::new(&model, 3, &Options::default()).expect("a batch");
    let numbers = [0.0; 45];
    for (offset, stride) in [(usize::MAX, 15), (0, usize::MAX), (usize::MAX / 2, usize::MAX / 2), (1, 15)] {
        let rows = Strided { values: Values::F64(&numbers), offset, stride };
        assert!(worlds.write_all(Field::Qpos, &rows, None).is_err(), "{offset} {stride}");
        assert!(worlds.set_parameters(Parameter::Gravity, &rows, None).is_err() || stride == 15);
    }
    let outputs = [Output::named("qpos").expect("an output")];
    let mut room = [0.0; 45];
    for nstep in [usize::MAX, usize::MAX / 45 + 1, 2] {
        let rollout = Rollout { nstep, outputs: &outputs, ..Rollout::default() };
        let error = worlds.rollout_into(&rollout, vec![Rows::F64(&mut room)]).expect_err("too many steps");
        assert!(error.to_string().contains("array for qpos has 45 entries"), "{error}");
    }
}
