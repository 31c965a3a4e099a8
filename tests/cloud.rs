//! Points of clouds: the same bits however they are visited, and what follows from them against what is known.

use std::collections::BTreeMap;

use crate::support::{copied, fails, load, moving, options};
use lanesim::cloud::{self, Call, Costs, Follow, Found, Grid, How, Points, Scheme, Seen, Solving, Target};
use lanesim::npz::{Array, Data};
use lanesim::rows::{Rows, Strided, Values};
use lanesim::{Backend, Field, Model, Options, Precision, Worlds};

/// Models that touch the floor, have a free joint, activations, tendons; one without anything that is shared.
const MODELS: [&str; 4] = ["zoo/ant", "zoo/hopper", "unit/muscle", "zoo/pendulums"];

fn with(precision: Precision, backend: Backend, threads: usize) -> Options {
    Options { threads: Some(threads), ..options(precision, backend) }
}

/// All that is found at points.
#[derive(Clone, Debug, Default, PartialEq)]
struct All {
    after: Vec<f64>,
    before: Vec<f64>,
    changed: Vec<f64>,
    sides: Vec<f64>,
    status: Vec<f64>,
}

fn visit(worlds: &mut Worlds, target: &Target<'_>, points: &Points, how: &How) -> All {
    let (model, nworld) = (worlds.model().clone(), worlds.nworld());
    let width = |parts: Vec<(&str, usize)>| parts.iter().map(|(_, n)| n).sum::<usize>();
    let (after, before) = (width(target.after(&model, how)), width(target.before(&model)));
    let room = |width: usize| vec![7.0; nworld * width];
    let mut all = All {
        after: room(points.len() * after),
        before: room(points.len() * before),
        changed: room(points.len()),
        sides: room(target.columns(&model)),
        status: room(1),
    };
    let All { after, before, changed, sides, status } = &mut all;
    let [after, before, changed, sides, status] = [after, before, changed, sides, status].map(|x| Rows::F64(x));
    let found = Found { after, before, changed, sides, status };
    worlds.points_into(target, points, how, found, (None, None)).expect("points");
    all
}

/// Points that move one column, several, none, and all.
fn some_points(columns: usize) -> Points {
    let mut points = Points::default();
    points.push([]);
    (0..columns).for_each(|column| points.push([(column, 1e-4)]));
    (0..columns).for_each(|column| points.push([(column, -1e-4), ((column * 7 + 3) % columns, 2e-4)]));
    points.push((0..columns).map(|column| (column, 1e-5 * (column as f64 - 3.0))));
    points
}

/// Of world `id` of so many.
fn of(all: &All, id: usize, nworld: usize) -> [Vec<u64>; 5] {
    [&all.after, &all.before, &all.changed, &all.sides, &all.status].map(|x| {
        let width = x.len() / nworld;
        x[id * width..(id + 1) * width].iter().map(|x| x.to_bits()).collect()
    })
}

#[test]
fn points_have_the_same_bits_however_they_are_visited() {
    for name in MODELS {
        for (precision, sensors) in [(Precision::F64, true), (Precision::F32, false)] {
            let model = load(name);
            let options = with(precision, Backend::Auto, 2);
            let mut worlds = moving(&model, 19, 1.0, &options);
            let acc: Vec<f64> = (0..19 * model.tables().sizes.nv).map(|i| (i as f64).sin()).collect();
            let stride = model.tables().sizes.nv;
            let qacc = |first: usize| Strided { values: Values::F64(&acc), offset: first * stride, stride };
            for of_what in 0..3 {
                let target = |first| match of_what {
                    0 => Target::Transition,
                    1 => Target::Acceleration,
                    _ => Target::Inverse(qacc(first)),
                };
                let how = How { sensors, tangent: sensors, reach: Some(1e-4), ..How::default() };
                let points = some_points(target(0).columns(&model));
                let all = visit(&mut worlds, &target(0), &points, &how);
                assert!(all.after.iter().all(|x| x.is_finite()), "{name}");
                for (backend, ids) in
                    [(Backend::Auto, &[11][..]), (Backend::Scalar, &[4, 5]), (Backend::Wide, &[2, 3, 4])]
                {
                    let options = with(precision, backend, 1);
                    let mut few = copied(&worlds, ids, &options);
                    let found = visit(&mut few, &target(ids[0]), &points, &how);
                    for (i, id) in ids.iter().enumerate() {
                        let same = of(&found, i, ids.len()) == of(&all, *id, 19);
                        assert!(same, "{name} {precision:?} {of_what} {backend:?} {id}");
                    }
                }
                // A few points of them, in another order.
                let mut fewer = Points::default();
                let chosen: Vec<usize> = (0..points.len()).rev().step_by(3).collect();
                chosen.iter().for_each(|point| fewer.push(points.moves(*point).iter().copied()));
                let found = visit(&mut worlds, &target(0), &fewer, &how);
                let width = all.after.len() / 19 / points.len();
                for (i, point) in chosen.iter().enumerate() {
                    let (here, there) = (i * width..(i + 1) * width, point * width..(point + 1) * width);
                    let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                    assert_eq!(bits(&found.after[here]), bits(&all.after[there]), "{name} {of_what} {point}");
                }
            }
        }
    }
}

/// First differences by points are those of a cloud's derivatives, bit by bit.
#[test]
fn first_differences_are_the_derivatives() {
    for name in MODELS {
        let model = load(name);
        let mut worlds = moving(&model, 3, 1.0, &with(Precision::F64, Backend::Auto, 1));
        let sizes = &model.tables().sizes;
        let (nv, n) = (sizes.nv, 2 * sizes.nv + sizes.na);
        let (eps, target) = (1e-6, Target::Acceleration);
        let mut rows = [nv * n, nv * sizes.nu, n + sizes.nu, n + sizes.nu, 1].map(|width| vec![0.0; 3 * width]);
        let scheme = Scheme { eps, ..Scheme::default() };
        let lent = rows.iter_mut().map(|x| Rows::F64(x)).collect();
        worlds.derivatives_into(&target, &scheme, Solving::FixedWork, lent, Follow::default()).unwrap();
        let grid = Grid::new(&model, &target, None, (eps, true, false)).unwrap();
        let how = How { solving: Solving::FixedWork, reach: Some(grid.reach()), ..How::default() };
        let points = grid.points();
        let all = visit(&mut worlds, &target, &points, &how);
        let sides = all.sides.len() / 3;
        for world in 0..3 {
            let mut gradient = vec![0.0; nv * (n + sizes.nu)];
            let values = &all.after[world * points.len() * nv..(world + 1) * points.len() * nv];
            grid.differentiate(values, &all.sides[world * sides..(world + 1) * sides], &mut gradient, &mut []);
            for row in 0..nv {
                for column in 0..n + sizes.nu {
                    let expected = match column.checked_sub(n) {
                        None => rows[0][(world * nv + row) * n + column],
                        Some(control) => rows[1][(world * nv + row) * sizes.nu + control],
                    };
                    let found = gradient[row * (n + sizes.nu) + column] + 0.0;
                    assert!((found - expected).abs() <= 1e-15 * expected.abs(), "{name} {row} {column}");
                }
            }
        }
    }
}

/// What evaluations take over from the given state changes no more than rounding: whole ones agree, for every kind of column.
#[test]
fn what_is_taken_over_is_what_would_be_found_again() {
    for name in MODELS {
        let model = lanesim::cloud::accurate(&load(name)).unwrap();
        let mut worlds = moving(&model, 2, 1.0, &with(Precision::F64, Backend::Auto, 1));
        for target in [Target::Transition, Target::Acceleration] {
            let points = some_points(target.columns(&model));
            let [part, whole] =
                [false, true].map(|whole| visit(&mut worlds, &target, &points, &How { whole, ..How::default() }));
            for (a, b) in part.after.iter().zip(&whole.after) {
                assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()), "{name}: {a} {b}");
            }
        }
    }
}

/// A force is what is divided by a mass.
#[test]
fn forces_are_columns() {
    let xml = "<mujoco><option gravity='0 0 0'/><worldbody><body><joint type='slide'/><geom size='.1' mass='4'/></body></worldbody>
        <actuator><motor joint='s' ctrlrange='-1 1'/></actuator></mujoco>"
        .replace("<joint", "<joint name='s'");
    let model = Model::from_xml_string(&xml, &Default::default()).unwrap();
    let mut worlds = Worlds::new(&model, 1, &Options::default()).unwrap();
    worlds.set(Field::Ctrl, 0, &[0.5]).unwrap();
    let mut points = Points::default();
    points.push([(3, 1.0)]);
    points.push([(3, -1.0), (2, 0.25)]);
    points.push([(2, 0.75)]);
    let how = How { reach: Some(0.75), ..How::default() };
    let all = visit(&mut worlds, &Target::Acceleration, &points, &how);
    // The control comes too near the end of its range, and is moved the other way.
    assert_eq!(all.after, [0.375, -0.1875, -0.0625]);
    assert_eq!(all.sides, [2.0, 2.0, -1.0, 2.0]);
    assert_eq!(worlds.get(Field::QfrcApplied, 0).unwrap(), [0.0]);
    fails(
        worlds.points_into(&Target::Acceleration, &points, &how, nothing(&mut [0.0; 2]), (None, None)),
        "array for after",
    );
    points.push([(4, 1.0)]);
    fails(
        worlds.points_into(&Target::Acceleration, &points, &how, nothing(&mut []), (None, None)),
        "column 4; there are 4",
    );
    let mut points = Points::default();
    points.push([(0, f64::NAN)]);
    fails(worlds.points_into(&Target::Acceleration, &points, &how, nothing(&mut []), (None, None)), "moved by NaN");
}

fn nothing(after: &mut [f64]) -> Found<'_> {
    let none = || Rows::F64(&mut []);
    Found { after: Rows::F64(after), before: none(), changed: none(), sides: none(), status: none() }
}

#[test]
fn a_world_that_cannot_be_stepped_has_nothing_after_it() {
    let model = load("zoo/hopper");
    let mut worlds = moving(&model, 3, 1.0, &with(Precision::F64, Backend::Auto, 1));
    let target = Target::Transition;
    let points = some_points(target.columns(&model));
    let before = visit(&mut worlds, &target, &points, &How::default());
    worlds.set_unchecked(Field::Qvel, 1, &[f64::NAN; 6]).unwrap();
    let all = visit(&mut worlds, &target, &points, &How::default());
    assert!(of(&all, 1, 3)[0].iter().all(|x| f64::from_bits(*x).is_nan()) && all.status[1] != 0.0);
    for other in [0, 2] {
        assert_eq!(of(&all, other, 3), of(&before, other, 3));
    }
}

/// Hessians of a pendulum's squared acceleration are those of its formula, by all points and, of its first order, by Gauss and Newton.
#[test]
fn a_pendulum_has_the_hessian_of_its_formula() {
    let xml = "<mujoco><worldbody><body><joint axis='0 1 0' damping='0.3' armature='0.1'/>
        <geom size='.05' pos='0 0 -.7' mass='2'/></body></worldbody></mujoco>";
    let model = Model::from_xml_string(xml, &Default::default()).unwrap();
    let (inertia, weight) = (2.0 * 0.49 + 0.4 * 2.0 * 0.0025 + 0.1, 2.0 * 9.81 * 0.7);
    let states: [[f64; 2]; 3] = [[0.3, 0.5], [-1.2, 2.0], [2.0, 0.0]];
    let column = |k: usize| Array::new(vec![3, 1], Data::F64(states.iter().map(|x| x[k]).collect())).unwrap();
    let inputs = BTreeMap::from([("qpos".to_owned(), column(0)), ("qvel".to_owned(), column(1))]);
    for (centred, gauss_newton) in [(true, false), (false, false), (true, true)] {
        let eps = if gauss_newton { 1e-6 } else { 1e-4 };
        let mut residual = |seen: &Seen<'_>, out: &mut [f64]| {
            out[0] = if gauss_newton { seen.after[0] } else { 0.5 * seen.after[0] * seen.after[0] };
            if !gauss_newton {
                out[1] = seen.before[0] * seen.before[1];
            }
        };
        let count = if gauss_newton { 1 } else { 2 };
        let mut costs = Costs { count, of: &mut residual, gauss_newton };
        let scheme = Scheme { eps, centred, ..Scheme::default() };
        let options = with(Precision::F64, Backend::Auto, 1);
        let call = Call { scheme, solving: Solving::Accurate, options: &options, progress: None, times: None };
        let found = cloud::hessian(&model, &inputs, &Target::Acceleration, None, &mut costs, &call).unwrap();
        let found: BTreeMap<_, _> = found.into_iter().collect();
        let own = if gauss_newton { 1 } else { 2 };
        assert_eq!(found["hessian"].shape(), [3, own, 2, 2]);
        assert_eq!(found["sides"].to_f64().as_ref(), [2.0; 6]);
        let (gradient, hessian) = (found["gradient"].to_f64(), found["hessian"].to_f64());
        for (i, [q, v]) in states.iter().enumerate() {
            let a = (-weight * q.sin() - 0.3 * v) / inertia;
            let slope = [-weight * q.cos() / inertia, -0.3 / inertia];
            let bend = if gauss_newton { 0.0 } else { a * weight * q.sin() / inertia };
            let tolerance = if centred { 1e-4 } else { 3e-2 };
            for j in 0..2 {
                assert!((gradient[i * own * 2 + j] - a * slope[j]).abs() < tolerance);
                for k in 0..2 {
                    let expected = slope[j] * slope[k] + if j + k == 0 { bend } else { 0.0 };
                    let off = hessian[i * own * 4 + 2 * j + k] - expected;
                    assert!(off.abs() < tolerance, "{centred} {gauss_newton} {i} {j} {k}: {off}");
                    if !gauss_newton {
                        let product = f64::from(u8::from(j != k));
                        assert!((hessian[i * 8 + 4 + 2 * j + k] - product).abs() < 1e-6, "{centred} {i} {j} {k}");
                    }
                }
            }
        }
    }
}
