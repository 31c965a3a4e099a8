//! What the interface promises beyond arithmetic: fields in place, refusals, panics, pages of code.

mod support;

use std::panic::{AssertUnwindSafe, catch_unwind};

use lanesim_codegen::{FieldSlice, Fragment, Op, Program, Recorder, Recording, Scratch};
use lanesim_kernels::lane::{Lane, LaneQuery, Mask, exp, log};
use support::{assert_same, instruction_sets};
use wide::{f32x16, f64x8};

fn ramp(n: usize) -> Vec<f64x8> {
    (0..n).map(|i| f64x8::from(std::array::from_fn(|lane| (10 * i + lane) as f64 + 0.5))).collect()
}

/// Threads share what is compiled, and each has a scratch of its own.
const _: fn() = || {
    fn shared<T: Send + Sync>() {}
    shared::<(Program<f64>, Fragment<f32>, Scratch)>();
};

fn record(f: impl FnOnce(&mut Recording<f64>)) -> Program<f64> {
    let mut recording = Recording::new();
    f(&mut recording);
    recording.finish()
}

#[test]
fn inputs_move_within_a_field() {
    // More values than registers, turned around: every store overwrites an input that another store needs.
    let n = 100;
    let program = record(|r| {
        let x = r.input(0, n);
        let reversed: Vec<_> = x.iter().rev().copied().collect();
        r.output(0, &reversed);
    });
    for isa in instruction_sets() {
        let mut x = ramp(n);
        let fragment = program.compile(isa).unwrap();
        fragment.run(&mut Scratch::new(), &mut [FieldSlice::write(&mut x)], &[], &mut []);
        let expected: Vec<_> = ramp(n).into_iter().rev().collect();
        assert_same(isa.name(), &x, &expected);
    }
}

#[test]
fn entries_that_stay_are_not_stored() {
    let program = record(|r| {
        let mut x = r.input(0, 3);
        x[1] += Recorder::of(1.0);
        r.output(0, &x);
        let same = r.input(1, 2);
        r.output(1, &same);
    });
    assert!(program.fields()[0].written && !program.fields()[1].written);
    for isa in instruction_sets() {
        let fragment = program.compile(isa).unwrap();
        assert_eq!(fragment.statistics().stores, 1);
        let (mut x, y) = (ramp(3), ramp(2));
        fragment.run(&mut Scratch::new(), &mut [FieldSlice::write(&mut x), FieldSlice::read(&y)], &[], &mut []);
        let mut expected = ramp(3);
        expected[1] += f64x8::splat(1.0);
        assert_same(isa.name(), &x, &expected);
    }
}

#[test]
fn many_fields_and_long_fields() {
    // More fields than registers for addresses, and lanes beyond short displacements.
    let (fields, len) = (40, 700);
    let program = record(|r| {
        let inputs: Vec<_> = (0..fields).map(|f| r.input(f, len)).collect();
        let sums: Vec<_> =
            (0..len).map(|i| inputs.iter().fold(Recorder::zero(), |sum, field| sum + field[i])).collect();
        r.output(fields, &sums);
    });
    let x = ramp(len);
    let expected: Vec<_> = x.iter().map(|x| (0..fields).fold(f64x8::splat(0.0), |sum, _| sum + *x)).collect();
    for isa in instruction_sets() {
        let mut out = vec![f64x8::splat(0.0); len];
        let mut slices: Vec<_> = (0..fields).map(|_| FieldSlice::read(&x)).collect();
        slices.push(FieldSlice::write(&mut out));
        program.compile(isa).unwrap().run(&mut Scratch::new(), &mut slices, &[], &mut []);
        assert_same(isa.name(), &out, &expected);
    }
}

#[test]
fn more_masks_than_registers() {
    let n = 60;
    let program = record(|r| {
        let x = r.input(0, n);
        let masks: Vec<_> = x.iter().map(|x| x.lt(Recorder::of(300.0))).collect();
        let sum = x.iter().copied().fold(Recorder::zero(), |a, b| a + b);
        let out: Vec<_> = masks.iter().rev().map(|m| Lane::select(*m, sum, Recorder::one())).collect();
        r.output(1, &out);
        masks.iter().for_each(|m| _ = r.mask_output(*m));
        r.mask_output(Mask::splat(true));
    });
    let x = ramp(n);
    let sum = x.iter().copied().fold(f64x8::splat(0.0), |a, b| a + b);
    let masks: Vec<_> = x.iter().map(|x| x.lt(f64x8::splat(300.0))).collect();
    let expected: Vec<_> = masks.iter().rev().map(|m| Lane::select(*m, sum, f64x8::splat(1.0))).collect();
    for isa in instruction_sets() {
        let (mut out, mut words) = (vec![f64x8::splat(0.0); n], vec![0; n + 1]);
        let mut fields = [FieldSlice::read(&x), FieldSlice::write(&mut out)];
        program.compile(isa).unwrap().run(&mut Scratch::new(), &mut fields, &[], &mut words);
        assert_same(isa.name(), &out, &expected);
        assert_eq!(words.pop(), Some(0xff));
        assert_eq!(words, masks.iter().map(|m| f64x8::bits(*m)).collect::<Vec<_>>());
    }
}

#[test]
fn elementary_functions() {
    let x: Vec<f32x16> =
        (0..50).map(|i| f32x16::from(std::array::from_fn(|lane| (i * 16 + lane) as f32 * 0.21 - 80.0))).collect();
    let mut recording = Recording::<f32>::new();
    let input = recording.input(0, 50);
    let results: Vec<_> = input.iter().flat_map(|x| [exp(*x), log(x.abs() + Recorder::of(1e-3))]).collect();
    recording.output(1, &results);
    let program = recording.finish();
    let expected: Vec<_> = x.iter().flat_map(|x| [exp(*x), log(x.abs() + f32x16::splat(1e-3))]).collect();
    for isa in instruction_sets() {
        let mut out = vec![f32x16::ZERO; 100];
        let mut fields = [FieldSlice::read(&x), FieldSlice::write(&mut out)];
        program.compile(isa).unwrap().run(&mut Scratch::new(), &mut fields, &[], &mut []);
        assert_same(isa.name(), &out, &expected);
    }
}

#[test]
fn negations_cost_nothing_where_they_can_join() {
    let program = record(|r| {
        let x = r.input(0, 3);
        let product = -(x[0] * x[1]);
        r.output(1, &[product + x[2], -(x[0] - x[2]), x[0].mul_add(-x[1], -x[2])]);
    });
    for isa in instruction_sets() {
        assert!(!program.compile(isa).unwrap().statistics().operations.contains_key(&Op::BitXor));
    }
}

#[test]
#[should_panic(expected = "field 0")]
fn short_fields_are_refused() {
    let program = record(|r| {
        let x = r.input(0, 3);
        r.output(1, &x[..1]);
    });
    let (x, mut y) = (ramp(2), ramp(1));
    let Some(isa) = instruction_sets().pop() else { panic!("no field 0 without code") };
    let mut fields = [FieldSlice::read(&x), FieldSlice::write(&mut y)];
    program.compile(isa).unwrap().run(&mut Scratch::new(), &mut fields, &[], &mut []);
}

#[test]
#[should_panic(expected = "field 1")]
fn fields_lent_for_reading_are_not_written() {
    let program = record(|r| {
        let x = r.input(0, 3);
        r.output(1, &x[..1]);
    });
    let (x, y) = (ramp(3), ramp(1));
    let Some(isa) = instruction_sets().pop() else { panic!("no field 1 without code") };
    let mut fields = [FieldSlice::read(&x), FieldSlice::read(&y)];
    program.compile(isa).unwrap().run(&mut Scratch::new(), &mut fields, &[], &mut []);
}

#[test]
fn a_panic_ends_its_recording() {
    let failed = catch_unwind(AssertUnwindSafe(|| {
        let mut recording = Recording::<f64>::new();
        recording.input(0, 3);
        panic!("a kernel that fails");
    }));
    assert!(failed.is_err());
    assert!(catch_unwind(Recorder::<f64>::zero).is_err(), "a recording is still open");
    let recording = Recording::<f32>::new();
    assert!(catch_unwind(Recorder::<f64>::zero).is_err(), "precisions mix");
    drop(recording);
    assert_eq!(record(|_| ()).nodes(), 0);
}

#[test]
#[cfg(target_os = "linux")]
fn no_page_is_writable_and_executable() {
    let program = record(|r| {
        let x = r.input(0, 1);
        r.output(0, &[x[0] + x[0]]);
    });
    let fragments: Vec<_> = instruction_sets().into_iter().map(|isa| program.compile(isa).unwrap()).collect();
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    for line in maps.lines() {
        let rights = line.split_whitespace().nth(1).unwrap();
        assert!(!(rights.contains('w') && rights.contains('x')), "{line}");
    }
    assert!(fragments.iter().all(|f| f.disassembly().trim_end().ends_with("ret")));
}
