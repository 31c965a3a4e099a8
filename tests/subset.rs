//! Some worlds of a batch: stepped, read, set and reset by their numbers, while the others keep their bits.

use std::sync::atomic::AtomicBool;

use lanesim::outputs::Output;
use lanesim::rows::{Rows, Strided, Values};
use lanesim::{
    Backend, Controls, Error, Field, Model, OnDiverge, Options, Parameter, Precision, Reading, Rollout, Worlds,
};

const NWORLD: usize = 37;
const IDS: [usize; 6] = [33, 2, 16, 17, 0, 36];

fn model() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/models/zoo/hopper.xml");
    Model::from_xml_path(path.as_ref(), &Default::default()).expect("a model")
}

fn options() -> impl Iterator<Item = Options> {
    let kinds = [(Precision::F64, Backend::Auto), (Precision::F32, Backend::Wide), (Precision::F64, Backend::Scalar)];
    kinds.into_iter().map(|(precision, backend)| Options { precision, backend, threads: Some(2), ..Options::default() })
}

/// Worlds that differ in everything: states, controls, forces from outside, parameters.
fn worlds(model: &Model, options: &Options) -> Worlds {
    let mut worlds = Worlds::new(model, NWORLD, options).expect("worlds");
    for world in 0..NWORLD {
        let x = world as f64;
        for (field, scale) in [(Field::Qvel, 0.1), (Field::Ctrl, 0.2), (Field::QfrcApplied, 0.3)] {
            let row: Vec<f64> = (0..field.len(model)).map(|i| scale * (x + 0.7 * i as f64).sin()).collect();
            if field != Field::QfrcApplied || world < 20 {
                worlds.set(field, world, &row).expect("to be set");
            }
        }
        worlds.set_parameter(Parameter::Gravity, world, &[0.0, 0.0, -9.0 - 0.02 * x]).expect("to be set");
    }
    worlds
}

/// All that is kept of a world, bit by bit.
fn bits(worlds: &Worlds, world: usize) -> Vec<u64> {
    let fields = Field::ALL.iter().flat_map(|(field, _)| worlds.get(*field, world).expect("a row"));
    let status = worlds.status(world).expect("a status").0;
    fields.map(f64::to_bits).chain([u64::from(status)]).collect()
}

#[test]
fn chosen_worlds_step_as_in_the_whole_batch_and_the_others_keep_their_bits() {
    let model = model();
    for options in options() {
        let (mut whole, mut some) = (worlds(&model, &options), worlds(&model, &options));
        assert!(!some.any_lost());
        let before: Vec<_> = (0..NWORLD).map(|world| bits(&some, world)).collect();
        whole.step(40).expect("a step");
        some.step_at(&IDS, 40).expect("a step");
        for (world, before) in before.iter().enumerate() {
            let expected = if IDS.contains(&world) { &bits(&whole, world) } else { before };
            assert_eq!(&bits(&some, world), expected, "world {world}");
        }
        // The others catch up.
        let others: Vec<usize> = (0..NWORLD).rev().filter(|world| !IDS.contains(world)).collect();
        some.step_at(&others, 40).expect("a step");
        assert_eq!(some.state_hash(), whole.state_hash());
        some.step_at(&[], 7).expect("nothing");
        assert_eq!(some.state_hash(), whole.state_hash());
    }
}

#[test]
fn rows_are_in_the_order_of_ids() {
    let model = model();
    let (nu, nstep) = (Field::Ctrl.len(&model), 9);
    let outputs = ["state", "xpos", "ncon"].map(|name| Output::named(name).expect("an output"));
    let given: Vec<f64> = (0..NWORLD * nstep * nu).map(|i| (0.3 * i as f64).sin()).collect();
    let row = |world: usize| &given[world * nstep * nu..][..nstep * nu];
    let chosen: Vec<f64> = IDS.iter().flat_map(|world| row(*world)).copied().collect();
    for options in options() {
        for noise in [false, true] {
            let controls = |given| if noise { Controls::Noise { seed: 3, scale: 0.5 } } else { Controls::Given(given) };
            let all = Rollout { nstep, controls: controls(&given), outputs: &outputs, ..Rollout::default() };
            let part = Rollout { controls: controls(&chosen), ids: Some(&IDS), ..all };
            let (mut whole, mut some) = (worlds(&model, &options), worlds(&model, &options));
            let (whole_rows, rows) = (whole.rollout(&all).expect("a run"), some.rollout(&part).expect("a run"));
            for (output, (all, part)) in outputs.iter().zip(whole_rows.outputs.iter().zip(&rows.outputs)) {
                let n = nstep * output.width(&model).expect("a width");
                for (i, world) in IDS.iter().enumerate() {
                    assert_eq!(part[i * n..][..n], all[world * n..][..n], "{} of {world}", output.name());
                }
            }
            let wanted = Output::named("subtree_com").expect("an output").width(&model).expect("a width");
            let (mut long, mut lists) = (vec![f64::NAN; IDS.len() * wanted], vec![vec![f64::NAN]; IDS.len()]);
            let rows = vec![Rows::F64(&mut long), Rows::Lists(&mut lists)];
            let names = ["subtree_com", "contact_dist"];
            some.read(&Reading { names: &names, ids: Some(&IDS), cancel: None }, rows).expect("to be read");
            let mut all = vec![f64::NAN; NWORLD * wanted];
            whole.read_all(&["subtree_com"], vec![Rows::F64(&mut all)]).expect("to be read");
            for (i, world) in IDS.iter().enumerate() {
                assert_eq!(long[i * wanted..][..wanted], all[world * wanted..][..wanted]);
            }
        }
    }
}

#[test]
fn states_of_some_worlds_are_set_and_read_back() {
    let model = model();
    let width = Output::named("state").expect("an output").width(&model).expect("a width");
    let rows: Vec<f64> = (0..IDS.len() * width).map(|i| 0.01 * i as f64).collect();
    for options in options() {
        let mut batch = worlds(&model, &options);
        let before: Vec<_> = (0..NWORLD).map(|world| bits(&batch, world)).collect();
        batch.write_states_at(&IDS, &Strided::new(Values::F64(&rows), width)).expect("to be set");
        let mut read = vec![f64::NAN; rows.len()];
        batch
            .read(&Reading { names: &["state"], ids: Some(&IDS), cancel: None }, vec![Rows::F64(&mut read)])
            .expect("to be read");
        // Time and positions have low words in single precision.
        let nsplit = 1 + Field::Qpos.len(&model);
        for (i, (read, x)) in read.iter().zip(&rows).enumerate() {
            match options.precision {
                Precision::F64 => assert_eq!(read, x),
                Precision::F32 if i % width < nsplit => assert!((read - x).abs() <= 4e-15 * x, "{read} {x}"),
                Precision::F32 => assert_eq!(*read, f64::from(*x as f32)),
            }
        }
        batch.reset_at(&IDS, None).expect("to be reset");
        for (world, before) in before.iter().enumerate().filter(|(world, _)| !IDS.contains(world)) {
            assert_eq!(&bits(&batch, world), before);
        }
        assert_eq!(batch.get(Field::Qvel, 33).expect("a row"), vec![0.0; Field::Qvel.len(&model)]);
        let mask: Vec<bool> = (0..NWORLD).map(|world| world == 5).collect();
        batch.write_states(&Strided::new(Values::F64(&rows[..width]), width), Some(&mask)).expect("to be set");
        assert_eq!(batch.get(Field::Time, 5).expect("a row"), [0.0]);
        assert_ne!(bits(&batch, 5), before[5]);
        assert_eq!(bits(&batch, 6), before[6]);
    }
}

#[test]
fn what_happened_stays_with_its_world() {
    let model = model();
    for mut options in options() {
        options.on_diverge = OnDiverge::Error;
        let mut batch = worlds(&model, &options);
        batch
            .set(Field::Qvel, 17, &vec![1e300_f64.min(f64::from(f32::MAX)); Field::Qvel.len(&model)])
            .expect("to be set");
        let error = batch.step_at(&IDS, 3).unwrap_err().to_string();
        assert!(error.starts_with("world 17 diverged"), "{error}");
        assert!(batch.lost() == 1 && batch.any_lost());
        assert!(!batch.status_detail(17).expect("events").is_empty());
        assert!(
            (0..NWORLD).filter(|world| *world != 17).all(|world| batch.status_detail(world).expect("none").is_empty())
        );
        // A world that was lost before is nothing to those that step now.
        batch.step_at(&[16, 18], 3).expect("a step");
    }
}

#[test]
fn lists_of_worlds_are_checked() {
    let mut batch = worlds(&model(), &Options::default());
    let message = |result: Result<(), Error>| result.unwrap_err().to_string();
    assert_eq!(message(batch.step_at(&[1, NWORLD], 1)), "there is no world 37: the batch has 37, counted from 0");
    assert_eq!(message(batch.step_at(&[4, 1, 4], 1)), "world 4 is named twice in ids; each can be named once");
    assert!(message(batch.reset_at(&[7, 7], None)).contains("twice"));
    let short = Strided { values: Values::F64(&[0.0]), offset: 0, stride: 1 };
    assert!(message(batch.write_at(&[1, 2], Field::Time, &short)).contains("expected 2 = nworld 2"));
    assert!(message(batch.write_states_at(&[1, 2], &short)).contains("state has 1 numbers"));
    assert!(message(batch.set_state(0, &[0.0; 5])).contains("state has 5 numbers"));
    let cancel = AtomicBool::new(true);
    let mut qpos = vec![0.0; NWORLD];
    let reading = Reading { names: &["time"], ids: None, cancel: Some(&cancel) };
    assert!(matches!(batch.read(&reading, vec![Rows::F64(&mut qpos)]), Err(Error::Cancelled)));
}
