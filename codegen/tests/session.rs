//! Calls that are bound once and run many times: they do what single runs do, and refuse the same.

mod support;

use std::panic::{AssertUnwindSafe, catch_unwind};

use lanesim_codegen::{FieldSlice, Fragment, InstructionSet, Program, Recorder, Recording, Scratch, Session, Windows};
use lanesim_kernels::lane::{Lane, LaneQuery, Mask};
use support::{assert_same, instruction_sets};
use wide::f64x8;

fn ramp(n: usize) -> Vec<f64x8> {
    (0..n).map(|i| f64x8::new(std::array::from_fn(|lane| (10 * i + lane) as f64 - 20.5))).collect()
}

/// y += x where the mask holds; returns where y is positive then, and a mask that holds everywhere.
fn sum() -> Program<f64> {
    let mut r = Recording::new();
    let (x, y, mask) = (r.input(0, 1)[0], r.input(1, 1)[0], r.mask_input());
    let next = Recorder::select(mask, x + y, y);
    r.output(1, &[next]);
    r.mask_output(next.gt(Recorder::zero()));
    r.mask_output(Mask::splat(true));
    r.finish()
}

/// y += x where the mask holds, on windows into both.
fn sums(isa: InstructionSet) -> Fragment<f64> {
    let mut r = Recording::new();
    let (x, y, mask) = (r.input(0, 1)[0], r.input(1, 1)[0], r.mask_input());
    r.output(1, &[Recorder::select(mask, x + y, y)]);
    r.finish().compile_each::<2>(isa, &[Some(0), Some(1)]).unwrap()
}

fn list(items: &[[usize; 2]]) -> Windows<2> {
    let mut windows = Windows::with_capacity(1, items.len());
    windows.begin();
    items.iter().for_each(|item| windows.push(*item));
    windows
}

const MASK: u32 = 0b0110_0101;

#[test]
fn bound_calls_run_as_often_as_asked() {
    for isa in instruction_sets() {
        let (x, mut y) = (ramp(6), ramp(3));
        let mut expected = y.clone();
        let add = |y: &mut f64x8, x: f64x8| *y = f64x8::select(f64x8::mask_of(MASK), *y + x, *y);
        let (single, each, mut scratch) = (sum().compile(isa).unwrap(), sums(isa), Scratch::new());
        let mut windows = list(&[[4, 0], [5, 1], [1, 2], [3, 1]]);
        let (x_field, y_field) = (FieldSlice::read(&x), FieldSlice::write(&mut y));
        let mut session = Session::new(&mut scratch);
        let first = session.next();
        let call = session.bind(&single, [x_field.part(2, 1), y_field.part(1, 1)].iter().map(FieldSlice::again));
        assert_eq!(call, first);
        let fields = [x_field.again(), y_field.again()];
        let bound = session.bind_each(&each, fields.iter().map(FieldSlice::again), windows.list(0));
        assert_eq!(bound, first.later(1));
        for _ in 0..3 {
            add(&mut expected[1], x[2]);
            let positive = f64x8::bits(expected[1].gt(f64x8::zero()));
            assert_eq!(session.run(call, MASK), [positive, 0xff], "{}", isa.name());
            session.run_each(bound, MASK, windows.list(0));
            [(0, 4), (1, 5), (2, 1), (1, 3)].into_iter().for_each(|(to, from)| add(&mut expected[to], x[from]));
        }
        windows.retain(0, |item| item % 2 == 1);
        session.run_each(bound, MASK, windows.list(0));
        [(1, 5), (1, 3)].into_iter().for_each(|(to, from)| add(&mut expected[to], x[from]));
        windows.retain(0, |_| false);
        session.run_each(bound, MASK, windows.list(0));
        assert_same(isa.name(), &y, &expected);
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    for isa in instruction_sets() {
        let refused_fields = |x: usize, y: usize, writable: bool| {
            let (single, x, mut y) = (sum().compile(isa).unwrap(), ramp(x), ramp(y));
            let y = if writable { FieldSlice::write(&mut y) } else { FieldSlice::read(&y) };
            let fields = [FieldSlice::read(&x), y];
            let bind = || Session::new(&mut Scratch::new()).bind(&single, fields.iter().map(FieldSlice::again));
            catch_unwind(AssertUnwindSafe(bind)).is_err()
        };
        assert!(!refused_fields(1, 1, true));
        assert!(refused_fields(2, 1, true) && refused_fields(1, 0, true) && refused_fields(1, 1, false));
        let refused_windows = |bound: &[[usize; 2]], run: &[[usize; 2]]| {
            let (each, x, mut y) = (sums(isa), ramp(4), ramp(4));
            let fields = [FieldSlice::read(&x), FieldSlice::write(&mut y)];
            let run = || {
                let mut scratch = Scratch::new();
                let mut session = Session::new(&mut scratch);
                let call = session.bind_each(&each, fields.iter().map(FieldSlice::again), list(bound).list(0));
                session.run_each(call, 0, list(run).list(0));
            };
            catch_unwind(AssertUnwindSafe(run)).is_err()
        };
        assert!(!refused_windows(&[[3, 2]], &[[0, 2], [3, 0]]));
        assert!(refused_windows(&[[4, 0]], &[]), "a window beyond its field");
        assert!(refused_windows(&[[2, 2]], &[[3, 0]]), "a window beyond those that were bound");
        let field = ramp(4);
        assert!(catch_unwind(AssertUnwindSafe(|| FieldSlice::<f64>::read(&field).part(3, 2))).is_err());
    }
}
