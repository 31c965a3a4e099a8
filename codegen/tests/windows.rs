//! Code that runs once for every item of a list, on windows into fields: what it does, and what it refuses.

mod support;

use std::panic::{AssertUnwindSafe, catch_unwind};

use lanesim_codegen::{
    FieldSlice, Float, Fragment, InstructionSet, Program, Recorder, Recording, Scratch, Windows, WindowsList,
};
use lanesim_kernels::lane::{Lane, LaneQuery};
use support::{assert_same, instruction_sets};
use wide::f64x8;

fn ramp<L: LaneQuery>(n: usize) -> Vec<L> {
    let lane = |i: usize| {
        let mut x = L::zero();
        (0..L::WIDTH).for_each(|lane| x.set(lane, lanesim_kernels::lane::Real::from_f64((10 * i + lane) as f64 + 0.5)));
        x
    };
    (0..n).map(lane).collect()
}

/// Adds the product of two entries to a sum where the mask holds, and writes half of it elsewhere.
fn sums<T: Float>() -> Program<T> {
    let mut r = Recording::new();
    let (x, sum, factor) = (r.input(0, 2), r.input(1, 1), r.uniform(3, 2));
    let mask = r.mask_input();
    let term = x[0] * x[1] * factor[1];
    r.output(1, &[Recorder::select(mask, sum[0] + term, sum[0])]);
    r.output(2, &[term * Recorder::of(0.5)]);
    r.finish()
}

const MASK: u32 = 0b1010_0110;

fn each<T: Float>(isa: InstructionSet) -> Fragment<T> {
    sums().compile_each::<3>(isa, &[Some(0), Some(1), Some(2), None]).unwrap()
}

fn list(items: &[[usize; 3]]) -> Windows<3> {
    let mut windows = Windows::with_capacity(1, items.len());
    windows.add(items.iter().copied());
    windows
}

fn one_after_the_other<T: Float>() {
    let items = [[0, 1, 3], [4, 1, 1], [3, 0, 2], [0, 1, 0]];
    let factors = [2.0, 0.25].map(T::from_f64);
    for isa in instruction_sets() {
        let (x, mut sum, mut halves) = (ramp::<T::Block>(6), ramp(2), ramp(4));
        let (mut expected, mut parts): (Vec<T::Block>, Vec<T::Block>) = (sum.clone(), halves.clone());
        for [a, b, c] in items {
            let term = x[a] * x[a + 1] * T::Block::splat(factors[1]);
            expected[b] = T::Block::select(T::Block::mask_of(MASK), expected[b] + term, expected[b]);
            parts[c] = term * T::Block::of(0.5);
        }
        let (sum_field, halves_field) = (FieldSlice::write(&mut sum), FieldSlice::write(&mut halves));
        let mut fields = [FieldSlice::read(&x), sum_field, halves_field, FieldSlice::uniform(&factors)];
        each::<T>(isa).run_each(&mut Scratch::new(), &mut fields, &[MASK], list(&items).list(0));
        assert_same(isa.name(), &sum, &expected);
        assert_same(isa.name(), &halves, &parts);
    }
}

#[test]
fn windows_one_after_the_other() {
    one_after_the_other::<f32>();
    one_after_the_other::<f64>();
}

/// Whether a run with these lengths of the fields, the second one lent for writing or not, is refused.
fn refused(isa: InstructionSet, lens: [usize; 4], writable: bool, items: &[[usize; 3]]) -> bool {
    let (x, mut sum, mut halves, factors) = (ramp(lens[0]), ramp(lens[1]), ramp(lens[2]), vec![1.0; lens[3]]);
    let sum = if writable { FieldSlice::write(&mut sum) } else { FieldSlice::read(&sum) };
    let mut fields = [FieldSlice::read(&x), sum, FieldSlice::write(&mut halves), FieldSlice::uniform(&factors)];
    let windows = list(items);
    let run = || each::<f64>(isa).run_each(&mut Scratch::new(), &mut fields, &[0], windows.list(0));
    catch_unwind(AssertUnwindSafe(run)).is_err()
}

#[test]
fn windows_beyond_a_field_are_refused() {
    for isa in instruction_sets() {
        let lens = [6, 2, 4, 2];
        assert!(!refused(isa, lens, true, &[[4, 1, 3], [0, 0, 0]]));
        for start in [[5, 0, 0], [0, 2, 0], [0, 0, 4], [usize::MAX, 0, 0], [1 << 58, 0, 0]] {
            assert!(refused(isa, lens, true, &[[0; 3], start, [0; 3]]), "{start:?}");
        }
        assert!(refused(isa, lens, false, &[[0; 3]]), "a written field lent for reading");
        assert!(refused(isa, [6, 2, 4, 3], true, &[[0; 3]]), "a field without windows of another length");
        assert!(refused(isa, [1, 2, 4, 2], true, &[[0; 3]]), "a field shorter than its window");
        assert!(!refused(isa, [0; 4], false, &[]), "nothing is read without items");
    }
}

#[test]
fn other_code_is_refused() {
    let panics = |f: &mut dyn FnMut()| catch_unwind(AssertUnwindSafe(f)).is_err();
    for isa in instruction_sets() {
        let (x, mut sum, mut halves) = (ramp(2), ramp(1), ramp(1));
        let mut fields = [
            FieldSlice::read(&x),
            FieldSlice::write(&mut sum),
            FieldSlice::write(&mut halves),
            FieldSlice::uniform(&[1.0; 2]),
        ];
        let (once, looped, mut scratch) = (sums::<f64>().compile(isa).unwrap(), each::<f64>(isa), Scratch::new());
        let mut narrow = Windows::<2>::default();
        narrow.add([[0; 2]].into_iter());
        assert!(panics(&mut || looped.run(&mut scratch, &mut fields, &[0], &mut [])), "a single run of a loop");
        assert!(panics(&mut || once.run_each(&mut scratch, &mut fields, &[0], list(&[[0; 3]]).list(0))));
        assert!(panics(&mut || looped.run_each(&mut scratch, &mut fields, &[0], narrow.list(0))), "columns");
        assert!(panics(&mut || looped.run_each(&mut scratch, &mut fields[..3], &[0], list(&[[0; 3]]).list(0))));
        let compile = |columns: &[Option<usize>]| sums::<f64>().compile_each::<3>(isa, columns).map(|_| ());
        assert!(panics(&mut || compile(&[Some(3), None, None, None]).unwrap()), "no such column");
        assert!(panics(&mut || compile(&[None; 3]).unwrap()), "a field too few");
    }
}

#[test]
fn windows_of_uniform_numbers_start_at_whole_blocks() {
    for isa in instruction_sets() {
        let code = sums::<f64>().compile_each::<3>(isa, &[None, None, Some(1), Some(2)]).unwrap();
        let (x, mut sum, mut halves) = (ramp::<<f64 as Float>::Block>(2), ramp(1), ramp(2));
        let numbers: Vec<f64> = (0..10).map(f64::from).collect();
        let (half, number) = (<f64 as Float>::Block::of(0.5), |i: usize| <f64 as Float>::Block::splat(numbers[i]));
        let halves_of = |k: usize| x[0] * x[1] * number(8 * k + 1) * half;
        let expected = [halves_of(1), halves_of(0)];
        let mut run = |numbers: &[f64]| {
            let (sum, halves) = (FieldSlice::write(&mut sum), FieldSlice::write(&mut halves));
            let mut fields = [FieldSlice::read(&x), sum, halves, FieldSlice::uniform(numbers)];
            let windows = list(&[[0, 0, 1], [0, 1, 0]]);
            let run = || code.run_each(&mut Scratch::new(), &mut fields, &[MASK], windows.list(0));
            catch_unwind(AssertUnwindSafe(run)).is_ok()
        };
        assert!(!run(&numbers[..9]), "a number short");
        assert!(run(&numbers));
        assert_same(isa.name(), &halves, &expected);
    }
}

#[test]
fn lists_keep_their_own_items() {
    let mut windows = list(&[[4, 1, 3]]);
    windows.add(std::iter::empty());
    windows.add([[1, 0, 0]].into_iter());
    assert_eq!([0, 1, 2].map(|i| windows.list(i).len()), [1, 0, 1]);
    assert!(windows.list(1).is_empty());
    for isa in instruction_sets() {
        let (x, mut sum, mut halves) = (ramp(3), ramp(1), ramp(1));
        let (sum, halves) = (FieldSlice::write(&mut sum), FieldSlice::write(&mut halves));
        let mut fields = [FieldSlice::read(&x), sum, halves, FieldSlice::uniform(&[1.0; 2])];
        // The first list reaches farther than these fields; the third does not.
        each::<f64>(isa).run_each(&mut Scratch::new(), &mut fields, &[0], windows.list(2));
    }
    windows.clear();
    windows.add(std::iter::empty());
    assert!(windows.list(0).is_empty());
}

/// A part of a list has the largest starts of its own items, not of the others.
#[test]
fn parts_of_lists() {
    for isa in instruction_sets() {
        let (x, mut sum, mut halves, factors) = (ramp::<f64x8>(6), ramp(2), ramp(4), [2.0, 0.25]);
        let windows = list(&[[9, 9, 9], [0, 1, 3], [4, 1, 1], [3, 0, 2], [9, 9, 9]]);
        let (mut one, mut two) = ((sum.clone(), halves.clone()), (sum.clone(), halves.clone()));
        let run = |list: WindowsList<'_, 3>, sum: &mut Vec<f64x8>, halves: &mut Vec<f64x8>| {
            let (sum, halves) = (FieldSlice::write(sum), FieldSlice::write(halves));
            let mut fields = [FieldSlice::read(&x), sum, halves, FieldSlice::uniform(&factors)];
            let run = || each::<f64>(isa).run_each(&mut Scratch::new(), &mut fields, &[MASK], list);
            catch_unwind(AssertUnwindSafe(run)).is_ok()
        };
        assert!(run(windows.list(0).part(1, 4), &mut one.0, &mut one.1));
        assert!(run(list(&[[0, 1, 3], [4, 1, 1], [3, 0, 2]]).list(0), &mut two.0, &mut two.1));
        assert_same(isa.name(), &one.0, &two.0);
        assert_same(isa.name(), &one.1, &two.1);
        assert!(!run(windows.list(0).part(1, 5), &mut sum, &mut halves), "a window beyond its field");
        assert!(catch_unwind(|| windows.list(0).part(3, 6)).is_err());
    }
}
