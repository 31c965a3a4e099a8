//! Arrays of the caller: read and written in place, the same numbers as one world at a time.

use std::sync::atomic::{AtomicBool, Ordering};

use lanesim::outputs::Output;
use lanesim::rows::{Rows, Strided, Values};
use lanesim::{Controls, Error, Field, Model, Options, Precision, Rollout, Worlds};

fn model() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/models/zoo/hopper.xml");
    Model::from_xml_path(path.as_ref(), &Default::default()).expect("a model")
}

fn worlds(model: &Model, nworld: usize, precision: Precision) -> Worlds {
    let options = Options { precision, threads: Some(2), ..Options::default() };
    Worlds::new(model, nworld, &options).expect("worlds")
}

fn outputs(names: &[&str]) -> Vec<Output> {
    names.iter().map(|name| Output::named(name).expect("an output")).collect()
}

/// Numbers without a pattern.
fn numbers(n: usize) -> Vec<f64> {
    (0..n).map(|i| (i as f64 * 0.7).sin()).collect()
}

#[test]
fn columns_of_a_wider_array_are_written() {
    let (model, nworld) = (model(), 19);
    let (nv, width) = (Field::Qvel.len(&model), Field::Qvel.len(&model) + 3);
    let given = numbers(nworld * width);
    let mask: Vec<bool> = (0..nworld).map(|w| w % 3 != 1).collect();
    let mut batch = worlds(&model, nworld, Precision::F64);
    let columns = Strided { values: Values::F64(&given), offset: 2, stride: width };
    batch.write_all(Field::Qvel, &columns, Some(&mask)).expect("to be written");
    for (w, chosen) in mask.iter().enumerate() {
        let expected = if *chosen { given[w * width + 2..][..nv].to_vec() } else { vec![0.0; nv] };
        assert_eq!(batch.get(Field::Qvel, w).expect("a row"), expected);
    }
    batch.reset_all(Some(&mask), None).expect("to be reset");
    assert_eq!(batch.get_all(Field::Qvel), vec![0.0; nworld * nv]);

    let short = Strided { offset: 4, ..columns };
    assert!(batch.write_all(Field::Qvel, &short, None).unwrap_err().to_string().contains("expected"));
    let message = batch.write_all(Field::Qvel, &columns, Some(&[true])).unwrap_err().to_string();
    assert_eq!(message, "the mask has 1 entries; expected nworld 19");
}

#[test]
fn outputs_are_the_same_wherever_they_go() {
    let (model, nworld, nstep) = (model(), 21, 12);
    let nu = Field::Ctrl.len(&model);
    let controls = numbers(nworld * nstep * nu);
    for precision in [Precision::F64, Precision::F32] {
        let names = outputs(&["state", "qpos", "xpos", "ncon"]);
        let run = Rollout { nstep, controls: Controls::Given(&controls), outputs: &names, ..Rollout::default() };
        let expected = worlds(&model, nworld, precision).rollout(&run).expect("a rollout").outputs;

        let (mut state, mut qpos) = (vec![0.0; expected[0].len()], vec![0.0_f32; expected[1].len()]);
        let (mut xpos, mut ncon) = (vec![0.0; expected[2].len()], vec![0_i32; expected[3].len()]);
        let rows = vec![Rows::F64(&mut state), Rows::F32(&mut qpos), Rows::F64(&mut xpos), Rows::I32(&mut ncon)];
        let strided = Controls::Strided { values: Values::F64(&controls), world: nstep * nu, step: nu };
        let mut batch = worlds(&model, nworld, precision);
        batch.rollout_into(&Rollout { controls: strided, ..run }, rows).expect("a rollout");
        assert_eq!((&state, &xpos), (&expected[0], &expected[2]));
        assert!(qpos.iter().zip(&expected[1]).all(|(a, b)| *a == *b as f32));
        assert!(ncon.iter().zip(&expected[3]).all(|(a, b)| f64::from(*a) == *b));

        let mut now = vec![0.0; nworld * Field::Qvel.len(&model)];
        let mut lists = vec![vec![7.0]; nworld];
        let rows = vec![Rows::F64(&mut now), Rows::Lists(&mut lists)];
        batch.read_all(&["qvel", "contact_dist"], rows).expect("to be read");
        assert_eq!(now, batch.get_all(Field::Qvel));
        batch
            .forward(&outputs(&["contact_dist"]), &mut |world, values| assert_eq!(values[0], lists[world]))
            .expect("memory");
    }
}

#[test]
fn one_row_of_controls_serves_all() {
    let (model, nworld, nstep) = (model(), 9, 5);
    let row = numbers(Field::Ctrl.len(&model));
    let repeated = row.repeat(nworld * nstep);
    let one = Controls::Strided { values: Values::F64(&row), world: 0, step: 0 };
    let hash = |controls| {
        let mut batch = worlds(&model, nworld, Precision::F64);
        batch.rollout(&Rollout { nstep, controls, ..Rollout::default() }).expect("a rollout");
        batch.state_hash()
    };
    assert_eq!(hash(one), hash(Controls::Given(&repeated)));
    let beyond = Controls::Strided { values: Values::F64(&row), world: 1, step: 0 };
    let result =
        worlds(&model, nworld, Precision::F64).rollout(&Rollout { nstep, controls: beyond, ..Rollout::default() });
    assert!(result.unwrap_err().to_string().contains("too few for strides (1, 0)"));
}

#[test]
fn arrays_must_fit() {
    let model = model();
    let mut batch = worlds(&model, 4, Precision::F64);
    let mut few = [0.0; 3];
    let message = batch.read_all(&["time"], vec![Rows::F64(&mut few)]).unwrap_err().to_string();
    assert_eq!(message, "array for time has 3 entries; expected 4");
    let message = batch.read_all(&["contact_dist"], vec![Rows::F64(&mut few)]).unwrap_err().to_string();
    assert!(message.contains("needs a list per world"), "{message}");
    assert!(batch.read_all(&["time"], Vec::new()).is_err());
    let mut lists = vec![Vec::new(); 8];
    let names = outputs(&["time"]);
    let run = Rollout { nstep: 2, outputs: &names, ..Rollout::default() };
    assert!(batch.rollout_into(&run, vec![Rows::Lists(&mut lists)]).is_err());
}

#[test]
fn a_run_can_be_stopped() {
    let model = model();
    let mut batch = worlds(&model, 40, Precision::F64);
    let cancel = AtomicBool::new(false);
    let result = std::thread::scope(|scope| {
        let run = scope
            .spawn(|| batch.rollout(&Rollout { nstep: usize::MAX / 100, cancel: Some(&cancel), ..Rollout::default() }));
        std::thread::sleep(std::time::Duration::from_millis(100));
        cancel.store(true, Ordering::Relaxed);
        run.join().expect("no panic")
    });
    assert!(matches!(result, Err(Error::Cancelled)));
    assert!(batch.get_all(Field::Qpos).iter().all(|x| x.is_finite()));
    batch.step(1).expect("a step");
}
