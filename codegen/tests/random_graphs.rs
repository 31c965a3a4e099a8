//! Random programs give the same bits over scalar lanes, over `wide` lanes, and as machine code of every instruction set.
//!
//! `LANESIM_FUZZ_SEED` and `LANESIM_FUZZ_GRAPHS` choose other programs, and more of them.

mod support;

use lanesim_codegen::{FieldSlice, Float, Program, Recorder, Recording, Scratch, Windows};
use lanesim_kernels::lane::{Lane, LaneQuery, Mask, Scalar};
use support::{Random, instruction_sets, same};

/// An operation on values and masks that there are already, by index.
#[derive(Clone, Copy, Debug)]
enum Step {
    Constant(f64),
    Binary(u8, usize, usize),
    Unary(u8, usize),
    Fused(bool, usize, usize, usize),
    Exp2(usize),
    Split(usize),
    Select(usize, usize, usize),
    Compare(u8, usize, usize),
    Combine(bool, usize, usize),
    /// Whether one mask holds and not the other, or both or none.
    Differ(bool, usize, usize),
    Not(usize),
    Truth(bool),
}

/// A program: steps, and which of its values and masks are stored.
struct Graph {
    inputs: usize,
    uniforms: usize,
    masks: usize,
    steps: Vec<Step>,
    /// Values for the field of the inputs, and for another field.
    outputs: [Vec<usize>; 2],
    mask_outputs: Vec<usize>,
}

/// What programs may contain. Some rules are exact for finite numbers only, others but for signs of zeros.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Constants, zero and one among them; lanes with anything not finite are not compared.
    Constants,
    /// Any inputs, infinite and NaN too, and no constants; lanes that divide by zero are not compared.
    AnyInputs,
}

fn graph(random: &mut Random, kind: Kind) -> Graph {
    let (inputs, uniforms, masks) = (1 + random.below(6), random.below(3), 1 + random.below(3));
    let (mut values, mut all_masks) = (inputs + uniforms, masks);
    let count = if random.chance(0.03) { 400 } else { 1 + random.below(60) };
    let mut steps = vec![];
    for _ in 0..count {
        // Recent values more often than old ones.
        let near = random.chance(0.5);
        let mut value = || if near { values - 1 - random.below(values.min(5)) } else { random.below(values) };
        let (a, b, c) = (value(), value(), value());
        let (m, n) = (random.below(all_masks), random.below(all_masks));
        let step = match random.below(16) {
            0 if kind == Kind::Constants => {
                let exact = [0.0, 1.0, -1.0, 0.5, 2.0, -4.0, -0.0][random.below(7)];
                Step::Constant(if random.chance(0.6) { exact } else { random.uniform(-3.0, 3.0) })
            }
            0..6 => Step::Binary(random.below(6) as u8, a, b),
            6 | 7 => Step::Unary(random.below(4) as u8, a),
            8..11 => Step::Fused(random.chance(0.5), a, b, c),
            11 => [Step::Exp2(a), Step::Split(a)][random.below(2)],
            12 => Step::Select(m, a, b),
            13 => Step::Compare(random.below(3) as u8, a, b),
            14 if random.chance(0.3) => Step::Differ(random.chance(0.5), m, n),
            14 => Step::Combine(random.chance(0.5), m, n),
            _ if kind == Kind::Constants && random.chance(0.2) => Step::Truth(random.chance(0.5)),
            _ => Step::Not(m),
        };
        match step {
            Step::Compare(..) | Step::Combine(..) | Step::Differ(..) | Step::Not(_) | Step::Truth(_) => all_masks += 1,
            Step::Split(_) => values += 2,
            _ => values += 1,
        }
        steps.push(step);
    }
    let mut some = |n: usize, of: usize| (0..n).map(|_| random.below(of)).collect::<Vec<_>>();
    let (own, other) = (some(inputs, values), some(5, values));
    let mask_outputs = some(2, all_masks);
    Graph { inputs, uniforms, masks, steps, outputs: [own, other], mask_outputs }
}

/// All values and masks of the program; `tame` hears every value, and every divisor.
fn evaluate<L: Lane>(
    graph: &Graph,
    leaves: &[L],
    masks: &[L::Mask],
    hear: &mut dyn FnMut(L, bool),
) -> (Vec<L>, Vec<L::Mask>) {
    let (mut v, mut m) = (leaves.to_vec(), masks.to_vec());
    for step in &graph.steps {
        let value = match *step {
            Step::Constant(x) => L::of(x),
            Step::Binary(op, a, b) => match op {
                0 => v[a] + v[b],
                1 => v[a] - v[b],
                2 => v[a] * v[b],
                3 => {
                    hear(v[b], true);
                    v[a] / v[b]
                }
                4 => v[a].min(v[b]),
                _ => v[a].max(v[b]),
            },
            Step::Unary(op, a) => match op {
                0 => -v[a],
                1 => v[a].abs(),
                2 => v[a].sqrt(),
                _ => v[a].round(),
            },
            Step::Fused(false, a, b, c) => v[a].mul_add(v[b], v[c]),
            Step::Fused(true, a, b, c) => v[a].neg_mul_add(v[b], v[c]),
            Step::Exp2(a) => v[a].clamp(L::of(-100.0), L::of(100.0)).round().exp2_integral(),
            Step::Split(a) => {
                let (mantissa, exponent) = v[a].abs().clamp(L::of(1e-30), L::of(1e30)).split_exponent();
                v.push(mantissa);
                exponent
            }
            Step::Select(mask, a, b) => L::select(m[mask], v[a], v[b]),
            Step::Compare(..) | Step::Combine(..) | Step::Differ(..) | Step::Not(_) | Step::Truth(_) => {
                m.push(match *step {
                    Step::Compare(0, a, b) => v[a].lt(v[b]),
                    Step::Compare(1, a, b) => v[a].le(v[b]),
                    Step::Compare(_, a, b) => v[a].eq(v[b]),
                    Step::Combine(true, a, b) => m[a] & m[b],
                    Step::Combine(false, a, b) => m[a] | m[b],
                    Step::Differ(true, a, b) => (m[a] & !m[b]) | (m[b] & !m[a]),
                    Step::Differ(false, a, b) => (m[a] & m[b]) | (!m[b] & !m[a]),
                    Step::Not(a) => !m[a],
                    _ => L::Mask::splat(matches!(step, Step::Truth(true))),
                });
                continue;
            }
        };
        hear(value, false);
        v.push(value);
    }
    (v, m)
}

fn number(random: &mut Random, kind: Kind, bits: impl Fn(u64) -> f64) -> f64 {
    let special = [0.0, -0.0, 1.0, -1.0, 1e-40, -3e-310, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 1e30, -2.5];
    match random.below(8) {
        0 if kind == Kind::AnyInputs => special[random.below(special.len())],
        0 => [0.0, -0.0, 1.0, -1.0, -2.5, 1e-40][random.below(6)],
        1 if kind == Kind::AnyInputs => bits(random.bits()),
        2 => random.uniform(-1e4, 1e4),
        _ => random.uniform(-2.0, 2.0),
    }
}

/// Values for a program.
struct Data<T: Float> {
    lanes: Vec<T::Block>,
    uniforms: Vec<T>,
    masks: Vec<u32>,
}

impl<T: Float> Data<T> {
    fn new(graph: &Graph, random: &mut Random, kind: Kind) -> Self {
        let mut number = || T::from_f64(number(random, kind, |bits| T::of_bits(bits).to_f64()));
        let mut lane = || {
            let mut lane = T::Block::zero();
            (0..T::Block::WIDTH).for_each(|i| lane.set(i, number()));
            lane
        };
        let lanes = (0..graph.inputs).map(|_| lane()).collect();
        let uniforms = (0..graph.uniforms).map(|_| number()).collect();
        // Bits above the last lane are of no account.
        let masks = (0..graph.masks).map(|_| random.bits() as u32).collect();
        Data { lanes, uniforms, masks }
    }
}

/// What a program stores: fields and masks.
type Stored<L> = ([Vec<L>; 2], Vec<u32>);

fn stored<L: LaneQuery>(graph: &Graph, (v, m): &(Vec<L>, Vec<L::Mask>)) -> Stored<L> {
    let fields = [0, 1].map(|field| graph.outputs[field].iter().map(|i| v[*i]).collect());
    (fields, graph.mask_outputs.iter().map(|i| L::bits(m[*i])).collect())
}

/// One lane over scalars, and whether the comparison is fair there.
fn reference<T: Float + LaneQuery<Mask = bool>>(
    graph: &Graph,
    data: &Data<T>,
    lane: usize,
    kind: Kind,
) -> (Stored<T>, bool) {
    let leaves: Vec<T> = data.lanes.iter().map(|l| l.get(lane)).chain(data.uniforms.iter().copied()).collect();
    let masks: Vec<bool> = data.masks.iter().map(|m| m >> lane & 1 != 0).collect();
    let mut fair = true;
    let all = evaluate(graph, &leaves, &masks, &mut |x: T, divisor| {
        fair &= match kind {
            Kind::Constants => x.to_f64().is_finite(),
            Kind::AnyInputs => !divisor || x != T::default(),
        };
    });
    (stored(graph, &all), fair)
}

fn compare<T: Float + LaneQuery<Mask = bool>>(
    what: &str,
    graph: &Graph,
    (fields, masks): &Stored<T::Block>,
    expected: &[(Stored<T>, bool)],
) {
    for (lane, ((expected_fields, expected_masks), _)) in expected.iter().enumerate().filter(|(_, (_, fair))| *fair) {
        for (got, expected) in fields.iter().flatten().zip(expected_fields.iter().flatten()) {
            let got = got.get(lane);
            assert!(same(got, *expected), "{what}: lane {lane} is {got:?} instead of {expected:?}\n{:?}", graph.steps);
        }
        for (got, expected) in masks.iter().zip(expected_masks) {
            assert_eq!(got >> lane & 1, *expected, "{what}: mask in lane {lane}\n{:?}", graph.steps);
        }
    }
}

const OWN: usize = 0;
const UNIFORM: usize = 1;
const OTHER: usize = 3;

fn record<T: Float>(graph: &Graph, mask_outputs: &[usize]) -> Program<T> {
    let mut recording = Recording::<T>::new();
    let mut leaves = recording.input(OWN, graph.inputs);
    leaves.extend(recording.uniform(UNIFORM, graph.uniforms));
    let masks: Vec<_> = (0..graph.masks).map(|_| recording.mask_input()).collect();
    let (v, m) = evaluate::<Recorder<T>>(graph, &leaves, &masks, &mut |_, _| {});
    for (field, outputs) in [OWN, OTHER].into_iter().zip(&graph.outputs) {
        recording.output(field, &outputs.iter().map(|i| v[*i]).collect::<Vec<_>>());
    }
    for i in mask_outputs {
        recording.mask_output(m[*i]);
    }
    recording.finish()
}

/// Returns in how many lanes the comparison was fair.
fn check<T: Float + LaneQuery<Mask = bool>>(graph: &Graph, data: &Data<T>, kind: Kind, scratch: &mut Scratch) -> usize {
    let expected: Vec<_> = (0..T::Block::WIDTH).map(|lane| reference(graph, data, lane, kind)).collect();

    let leaves: Vec<T::Block> =
        data.lanes.iter().copied().chain(data.uniforms.iter().map(|x| T::Block::splat(*x))).collect();
    let masks: Vec<_> = data.masks.iter().map(|m| T::Block::mask_of(*m)).collect();
    let wide = stored(graph, &evaluate(graph, &leaves, &masks, &mut |_, _| {}));
    compare("wide", graph, &wide, &expected);

    let program = record::<T>(graph, &graph.mask_outputs);
    for isa in instruction_sets() {
        let fragment = program.compile(isa).unwrap();
        let (mut own, mut other) = (data.lanes.clone(), vec![T::Block::zero(); graph.outputs[1].len()]);
        let mut mask_words = vec![u32::MAX; graph.mask_outputs.len()];
        let mut fields = [
            FieldSlice::write(&mut own),
            FieldSlice::uniform(&data.uniforms),
            FieldSlice::unused(),
            FieldSlice::write(&mut other),
        ];
        fragment.run(scratch, &mut fields, &data.masks, &mut mask_words);
        let got = ([own, other], mask_words);
        compare(&format!("{} {:?}", isa.name(), T::PRECISION), graph, &got, &expected);
        let beyond = !(((1_u64 << T::Block::WIDTH) - 1) as u32);
        assert!(got.1.iter().all(|word| word & beyond == 0), "bits beyond the last lane");
    }
    expected.iter().filter(|(_, fair)| *fair).count()
}

/// A loop over windows leaves the bits that single runs on the same windows leave, one after the other.
fn check_windows<T: Float>(graph: &Graph, random: &mut Random, data: &Data<T>, scratch: &mut Scratch) {
    let program = record::<T>(graph, &[]);
    let (own, other) = (graph.inputs, graph.outputs[1].len());
    let (spare, items) = (3, 1 + random.below(5));
    let lanes = |n: usize| (0..n + spare).map(|i| data.lanes[i % own]).collect::<Vec<_>>();
    let mut windows = Windows::<3>::default();
    windows.add([[usize::MAX; 3]].into_iter());
    // The first column is of no field.
    let starts: Vec<_> = (0..items).map(|_| [usize::MAX, random.below(spare + 1), random.below(spare + 1)]).collect();
    windows.add(starts.iter().copied());
    for isa in instruction_sets() {
        let (single, each) =
            (program.compile(isa).unwrap(), program.compile_each::<3>(isa, &[Some(2), None, None, Some(1)]));
        let (mut a, mut b) = ((lanes(own), lanes(other)), (lanes(own), lanes(other)));
        for [_, start, own_start] in &starts {
            let mut fields = [
                FieldSlice::write(&mut a.0[*own_start..own_start + own]),
                FieldSlice::uniform(&data.uniforms),
                FieldSlice::unused(),
                FieldSlice::write(&mut a.1[*start..start + other]),
            ];
            single.run(scratch, &mut fields, &data.masks, &mut []);
        }
        let uniforms = FieldSlice::uniform(&data.uniforms);
        let mut fields = [FieldSlice::write(&mut b.0), uniforms, FieldSlice::unused(), FieldSlice::write(&mut b.1)];
        each.unwrap().run_each(scratch, &mut fields, &data.masks, windows.list(1));
        for (a, b) in a.0.iter().zip(&b.0).chain(a.1.iter().zip(&b.1)) {
            for (a, b) in (0..T::Block::WIDTH).map(|lane| (a.get(lane), b.get(lane))) {
                // Which NaN comes out depends on the order of operands, which the two need not share.
                let nan = a.to_f64().is_nan() && b.to_f64().is_nan();
                assert!(nan || a.bits() == b.bits(), "{}: {a:?} and {b:?}\n{:?}", isa.name(), graph.steps);
            }
        }
    }
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|x| x.parse().ok()).unwrap_or(default)
}

fn random_graphs<T: Float + LaneQuery<Mask = bool> + Scalar>(kind: Kind) {
    let count = setting("LANESIM_FUZZ_GRAPHS", 10_000);
    let mut scratch = Scratch::new();
    let mut compared = 0;
    for i in 0..count {
        let mut random = Random::new(setting("LANESIM_FUZZ_SEED", 1) << 32 | i);
        let graph = graph(&mut random, kind);
        let data = Data::<T>::new(&graph, &mut random, kind);
        compared += check(&graph, &data, kind, &mut scratch);
        check_windows(&graph, &mut random, &data, &mut scratch);
    }
    assert!(compared as u64 > count * T::Block::WIDTH as u64 / 2, "only {compared} lanes were compared");
}

#[test]
fn single_with_constants() {
    random_graphs::<f32>(Kind::Constants);
}

#[test]
fn double_with_constants() {
    random_graphs::<f64>(Kind::Constants);
}

#[test]
fn single_with_any_inputs() {
    random_graphs::<f32>(Kind::AnyInputs);
}

#[test]
fn double_with_any_inputs() {
    random_graphs::<f64>(Kind::AnyInputs);
}

/// A chain's values, summed up from its end: all of them are alive at once.
fn there_and_back<L: Lane>(x: L, y: L) -> L {
    let mut values = vec![x];
    for i in 0..4000 {
        values.push(values[i].mul_add(y, x));
    }
    values.iter().rev().fold(y, |sum, value| sum.mul_add(y, *value))
}

fn many_values<T: Float + LaneQuery<Mask = bool>>() {
    let mut recording = Recording::<T>::new();
    let inputs = recording.input(0, 2);
    let sum = there_and_back(inputs[0], inputs[1]);
    recording.output(1, &[sum]);
    let program = recording.finish();
    let mut random = Random::new(1);
    let mut lanes = vec![T::Block::zero(); 2];
    for lane in &mut lanes {
        (0..T::Block::WIDTH).for_each(|i| lane.set(i, T::from_f64(random.uniform(-0.9, 0.9))));
    }
    for isa in instruction_sets() {
        let fragment = program.compile(isa).unwrap();
        assert!(fragment.statistics().slots > 3900, "all but what fits into registers is spilled");
        let mut out = vec![T::Block::zero()];
        fragment.run(&mut Scratch::new(), &mut [FieldSlice::read(&lanes), FieldSlice::write(&mut out)], &[], &mut []);
        for i in 0..T::Block::WIDTH {
            let expected = there_and_back(lanes[0].get(i), lanes[1].get(i));
            assert_eq!(out[0].get(i).bits(), expected.bits(), "{} lane {i}", isa.name());
        }
    }
}

/// Slots that no short displacement reaches, more stretches of them than there are registers for addresses.
#[test]
fn many_values_alive() {
    many_values::<f32>();
    many_values::<f64>();
}
