//! Calls that are bound once and run many times, in one session or in several: they do what single runs do, and refuse the
//! same.

mod support;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use lanesim_codegen::{
    FieldSlice, Fragment, InstructionSet, Lending, Program, Recorder, Recording, Scratch, Session, Windows,
};
use lanesim_kernels::lane::{Lane, LaneQuery, Mask};
use support::{assert_same, instruction_sets};
use wide::f64x8;

/// A session that lends the fields under numbers from 0 on.
fn session<'a, const N: usize>(
    scratch: &'a mut Scratch,
    owner: &Arc<()>,
    fields: [FieldSlice<'a, f64>; N],
) -> Session<'a, f64> {
    let mut lending = Lending::new(scratch, owner);
    for (number, field) in fields.into_iter().enumerate() {
        lending.lend(number, field);
    }
    lending.finish()
}

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
    windows.add(items.iter().copied());
    windows
}

const MASK: u32 = 0b0110_0101;

#[test]
fn bound_calls_run_as_often_as_asked() {
    let owner = Arc::new(());
    for isa in instruction_sets() {
        let (x, mut y, other) = (ramp(6), ramp(1), ramp(3));
        let (mut z, mut expected) = (other.clone(), y.clone());
        let mut expected_windows = other.clone();
        let add = |y: &mut f64x8, x: f64x8| *y = f64x8::select(f64x8::mask_of(MASK), *y + x, *y);
        let (single, each, mut scratch) = (sum().compile(isa).unwrap(), sums(isa), Scratch::new());
        let mut windows = list(&[[4, 0], [5, 1], [1, 2], [3, 1]]);
        let fields =
            [FieldSlice::read(&x[2..3]), FieldSlice::write(&mut y), FieldSlice::read(&x), FieldSlice::write(&mut z)];
        let mut session = self::session(&mut scratch, &owner, fields);
        session.bind(0, &single, 0..2);
        session.bind(7, &each, 2..4);
        assert!(session.has(0) && session.has(7) && !session.has(3) && !session.has(8));
        drop((single, each));
        for _ in 0..3 {
            add(&mut expected[0], x[2]);
            let positive = f64x8::bits(expected[0].gt(f64x8::zero()));
            assert_eq!(session.run(0, MASK, u32::MAX), Some([positive, 0xff]), "{}", isa.name());
            session.run_each(7, [MASK, u32::MAX], windows.list(0)).unwrap();
            [(0, 4), (1, 5), (2, 1), (1, 3)].into_iter().for_each(|(to, from)| add(&mut expected_windows[to], x[from]));
        }
        windows.retain(0, |item| item % 2 == 1);
        session.run_each(7, [MASK, u32::MAX], windows.list(0)).unwrap();
        [(1, 5), (1, 3)].into_iter().for_each(|(to, from)| add(&mut expected_windows[to], x[from]));
        windows.retain(0, |_| false);
        session.run_each(7, [MASK, u32::MAX], windows.list(0)).unwrap();
        assert_same(isa.name(), &y, &expected);
        assert_same(isa.name(), &z, &expected_windows);
    }
}

#[test]
fn parts_of_a_block_without_any_of_the_lanes_are_left_out() {
    let owner = Arc::new(());
    for isa in instruction_sets() {
        let (x, mut y, mut z) = (ramp(1), ramp(1), ramp(1));
        // Lanes 4 to 7 are a part of their own where a register holds four.
        let touched = if isa == InstructionSet::Avx2 { 0xf0 } else { 0xff };
        let sum = f64x8::select(f64x8::mask_of(touched), y[0] + x[0], y[0]);
        let (single, each, mut scratch) = (self::sum().compile(isa).unwrap(), sums(isa), Scratch::new());
        let fields = [FieldSlice::read(&x), FieldSlice::write(&mut y), FieldSlice::write(&mut z)];
        let mut session = self::session(&mut scratch, &owner, fields);
        session.bind(0, &single, [0, 1].into_iter());
        session.bind(1, &each, [0, 2].into_iter());
        let positive = f64x8::bits(sum.gt(f64x8::zero())) & touched;
        assert_eq!(session.run(0, u32::MAX, 1 << 5), Some([positive, touched]), "{}", isa.name());
        assert_eq!(session.run(0, u32::MAX, 0).map(|[_, known]| known), Some(if touched == 0xff { 0xff } else { 0 }));
        session.run_each(1, [u32::MAX, 1 << 5], list(&[[0, 0]]).list(0)).unwrap();
        assert_same(isa.name(), &z, &[sum]);
    }
}

#[test]
fn calls_stay_bound_as_long_as_their_fields_are_the_same() {
    let owner = Arc::new(());
    for isa in instruction_sets() {
        let (x, mut y, mut z, longer) = (ramp(1), ramp(1), ramp(1), ramp(2));
        let (single, mut scratch) = (sum().compile(isa).unwrap(), Scratch::new());
        {
            let fields = [FieldSlice::read(&x), FieldSlice::write(&mut y), FieldSlice::write(&mut z)];
            let mut session = self::session(&mut scratch, &owner, fields);
            session.bind(0, &single, [0, 1].into_iter());
            session.bind(1, &single, [0, 2].into_iter());
        }
        drop(single);
        {
            let fields = [FieldSlice::<f64>::read(&x), FieldSlice::write(&mut y), FieldSlice::read(&longer)];
            let mut session = self::session(&mut scratch, &owner, fields);
            assert!(session.has(0) && !session.has(1), "but for the one whose field is another");
            assert!(session.run(0, u32::MAX, u32::MAX).is_some());
            assert_eq!(session.run(1, 0, u32::MAX), None);
        }
        assert_same(isa.name(), &y, &[x[0] + x[0]]);
        let fields = [FieldSlice::<f64>::read(&x), FieldSlice::read(&y), FieldSlice::write(&mut z)];
        assert!(!session(&mut scratch, &owner, fields).has(0), "a field that is lent for reading only");
        assert!(!Lending::<f32>::new(&mut scratch, &owner).finish().has(0), "another type of numbers");
    }
}

/// Where the fields of a step are at another place next time, their calls go there.
#[test]
fn calls_follow_fields_that_move() {
    let owner = Arc::new(());
    for isa in instruction_sets() {
        let (x, mut places, mut scratch) = ([ramp(1), ramp(2)], [ramp(1), ramp(1), ramp(1)], Scratch::new());
        let (single, each) = (sum().compile(isa).unwrap(), sums(isa));
        let mut bound = 0;
        for round in 0..6 {
            let expected = places[round % 3][0] + x[1][1] + x[1][1];
            let place = &mut places[round % 3];
            let mut session =
                self::session(&mut scratch, &owner, [FieldSlice::read(&x[1][1..]), FieldSlice::write(place)]);
            for (call, code) in [(0, &single), (1, &each)] {
                if !session.has(call) {
                    session.bind(call, code, 0..2);
                    bound += 1;
                }
            }
            session.run(0, u32::MAX, u32::MAX).unwrap();
            session.run_each(1, [u32::MAX; 2], list(&[[0, 0]]).list(0)).unwrap();
            assert_same(isa.name(), &places[round % 3], &[expected]);
        }
        assert_eq!(bound, 4, "anew when the field moves for the first time, and no more");
    }
}

/// A session that lends only some of the fields runs calls on these, and no others.
#[test]
fn calls_wait_for_fields_that_are_not_lent() {
    let owner = Arc::new(());
    for isa in instruction_sets() {
        let (x, mut y, single, mut scratch) = (ramp(1), ramp(1), sum().compile(isa).unwrap(), Scratch::new());
        let fields = [FieldSlice::read(&x), FieldSlice::write(&mut y)];
        self::session(&mut scratch, &owner, fields).bind(0, &single, 0..2);
        let mut without = self::session(&mut scratch, &owner, [FieldSlice::read(&x)]);
        assert!(without.has(0));
        assert!(catch_unwind(AssertUnwindSafe(|| without.run(0, 0, 0))).is_err());
        assert!(catch_unwind(AssertUnwindSafe(|| without.bind(1, &single, 0..2))).is_err());
        let fields = [FieldSlice::read(&x), FieldSlice::write(&mut y)];
        assert!(self::session(&mut scratch, &owner, fields).run(0, 0, u32::MAX).is_some());
    }
}

/// Any number of masks, and items with masks of their own.
#[test]
fn masks_in_and_out() {
    let owner = Arc::new(());
    for isa in instruction_sets() {
        let (x, mut sum) = (ramp(6), ramp(2));
        let mut r = Recording::<f64>::new();
        let lanes = r.input(0, 6);
        for lane in lanes {
            r.mask_output(lane.gt(Recorder::zero()));
        }
        r.mask_output(Mask::splat(true));
        let (many, each, mut scratch) = (r.finish().compile(isa).unwrap(), sums(isa), Scratch::new());
        let (items, masks) = ([[0, 1], [4, 1], [3, 0]], [0b1010_0110, 0, 0b1111_0001]);
        let mut expected = sum.clone();
        for ([from, to], mask) in items.into_iter().zip(masks) {
            expected[to] = f64x8::select(f64x8::mask_of(mask), expected[to] + x[from], expected[to]);
        }
        let mut session = self::session(&mut scratch, &owner, [FieldSlice::read(&x), FieldSlice::write(&mut sum)]);
        session.bind(0, &many, 0..1);
        session.bind(1, &each, 0..2);
        let mut returned = [0; 7];
        session.run_into(0, 0, &mut returned).unwrap();
        for (mask, x) in returned.iter().zip(&x) {
            assert_eq!(*mask, f64x8::bits(x.gt(f64x8::zero())), "{}", isa.name());
        }
        assert_eq!(returned[6], 0xff);
        assert!(catch_unwind(AssertUnwindSafe(|| session.run(0, 0, 0))).is_err(), "more masks than two");
        assert!(catch_unwind(AssertUnwindSafe(|| session.run_into(0, 0, &mut [0; 2]))).is_err());
        session.run_each_masked(1, &masks, list(&items).list(0)).unwrap();
        let few = || session.run_each_masked(1, &masks[1..], list(&items).list(0));
        assert!(catch_unwind(AssertUnwindSafe(few)).is_err(), "a mask for every item");
        assert_same(isa.name(), &sum, &expected);
    }
}

/// Numbers of calls are their owner's: where other code takes over, none of the calls is bound.
#[test]
fn calls_of_other_code_are_dropped() {
    for isa in instruction_sets() {
        let single = sum().compile(isa).unwrap();
        let (x, mut y, mut scratch) = (ramp(1), ramp(1), Scratch::new());
        let [first, second] = [Arc::new(()), Arc::new(())];
        let mut bound = |owner, bind: bool| {
            let fields = [FieldSlice::read(&x), FieldSlice::write(&mut y)];
            let mut session = self::session(&mut scratch, owner, fields);
            let has = session.has(0);
            if bind {
                session.bind(0, &single, 0..2);
            }
            has
        };
        assert_eq!(
            [(&first, true), (&first, false), (&second, true), (&second, false)].map(|(o, b)| bound(o, b)),
            [false, true, false, true]
        );
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let owner = Arc::new(());
    for isa in instruction_sets() {
        let refused_fields = |x: usize, y: usize, writable: bool| {
            let (single, x, mut y) = (sum().compile(isa).unwrap(), ramp(x), ramp(y));
            let y = if writable { FieldSlice::write(&mut y) } else { FieldSlice::read(&y) };
            let bind = || session(&mut Scratch::new(), &owner, [FieldSlice::read(&x), y]).bind(0, &single, 0..2);
            catch_unwind(AssertUnwindSafe(bind)).is_err()
        };
        assert!(!refused_fields(1, 1, true));
        assert!(refused_fields(2, 1, true) && refused_fields(1, 0, true) && refused_fields(1, 1, false));
        let refused_windows = |len: usize, run: &[[usize; 2]]| {
            let (each, x, mut y) = (sums(isa), ramp(len), ramp(4));
            let run = || {
                let mut scratch = Scratch::new();
                let fields = [FieldSlice::read(&x), FieldSlice::write(&mut y)];
                let mut session = session(&mut scratch, &owner, fields);
                session.bind(0, &each, 0..2);
                session.run_each(0, [0, u32::MAX], list(run).list(0)).unwrap();
            };
            catch_unwind(AssertUnwindSafe(run)).is_err()
        };
        assert!(!refused_windows(4, &[[0, 2], [3, 0], [1, 3]]));
        assert!(refused_windows(4, &[[4, 0]]) && refused_windows(4, &[[0, 4]]), "a window beyond its field");
        assert!(refused_windows(0, &[]), "a field without windows");
        let (each, field) = (sums(isa), ramp(1));
        let mismatched = || {
            let mut scratch = Scratch::new();
            let mut session = session(&mut scratch, &owner, [FieldSlice::read(&field)]);
            session.bind(0, &each, [0, 0].into_iter());
            session.run(0, 0, u32::MAX);
        };
        assert!(catch_unwind(AssertUnwindSafe(mismatched)).is_err(), "code for windows, without windows");
    }
}
