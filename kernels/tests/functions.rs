//! Errors of the elementary functions, against the standard library in double precision.
//!
//! The wide lanes give the same bits as the scalar ones (`lanes.rs`), so the scalar ones are enough here.

mod support;

use lanesim_kernels::lane::{Real, acos, atan2, exp, log, powf, sin_cos};
use support::Random;

/// Points per check.
const POINTS: usize = 200_000;

/// Distance of `got` from `exact` in units of the last place of `exact`; near zero the relative error counts as well.
fn ulps<R: Real>(got: R, exact: f64) -> f64 {
    let unit = exact.abs().max(1e-300).log2().floor().exp2() * R::EPSILON;
    (got.to_f64() - exact).abs() / unit
}

/// Largest error of `f` against `exact` over arguments drawn by `draw`, which must be below `bound`.
#[track_caller]
fn check<R: Real, const N: usize>(
    name: &str,
    bound: f64,
    mut draw: impl FnMut(&mut Random) -> [f64; N],
    f: impl Fn([R; N]) -> R,
    exact: impl Fn([f64; N]) -> f64,
) {
    let mut random = Random(4);
    let mut worst = (0.0, [0.0; N]);
    for _ in 0..POINTS {
        let x = draw(&mut random).map(R::from_f64);
        let rounded = x.map(Real::to_f64);
        let error = ulps(f(x), exact(rounded));
        assert!(!error.is_nan(), "{name} of {rounded:?} in {} is not a number", R::NAME);
        if error > worst.0 {
            worst = (error, rounded);
        }
    }
    println!("{name} {}: {:.2} ulp at {:?}", R::NAME, worst.0, worst.1);
    assert!(worst.0 <= bound, "{name} in {}: {:.2} ulp at {:?}, more than {bound}", R::NAME, worst.0, worst.1);
}

/// Runs a check in both number types: bounds for f64 and f32.
macro_rules! both {
    ($name:literal, $bounds:expr, $draw:expr, |$x:ident| $f:expr, |$y:ident| $exact:expr) => {
        check::<f64, _>($name, $bounds[0], $draw, |$x| $f, |$y| $exact);
        check::<f32, _>($name, $bounds[1], $draw, |$x| $f, |$y| $exact);
    };
}

/// Angles within e^-3 of a multiple of a quarter turn.
fn near_quarters(r: &mut Random) -> [f64; 1] {
    let k = r.uniform(-6e4, 6e4).round() * std::f64::consts::FRAC_PI_2;
    [k + r.uniform(-30.0, -3.0).exp()]
}

#[test]
fn sine_and_cosine() {
    for size in [0.8, 7.0, 1e3, 1e5] {
        both!("sin", [3.0, 3.0], |r| [r.uniform(-size, size)], |x| sin_cos(x[0]).0, |x| x[0].sin());
        both!("cos", [3.0, 3.0], |r| [r.uniform(-size, size)], |x| sin_cos(x[0]).1, |x| x[0].cos());
    }
    both!("sin", [1.5, 1.5], |r| [r.uniform(-30.0, -1.0).exp()], |x| sin_cos(x[0]).0, |x| x[0].sin());
    both!("sin", [3.0, 3.0], near_quarters, |x| sin_cos(x[0]).0, |x| x[0].sin());
    both!("cos", [3.0, 3.0], near_quarters, |x| sin_cos(x[0]).1, |x| x[0].cos());
}

#[test]
fn inverse_functions() {
    let plane = |r: &mut Random| {
        let size = r.uniform(-10.0, 10.0).exp();
        [r.uniform(-size, size), r.uniform(-1.0, 1.0)]
    };
    both!("atan2", [4.0, 4.0], plane, |x| atan2(x[0], x[1]), |x| x[0].atan2(x[1]));
    both!("acos", [4.0, 4.0], |r| [r.uniform(-1.0, 1.0)], |x| acos(x[0]), |x| x[0].acos());
    both!("acos", [4.0, 4.0], |r| [1.0 - r.uniform(-20.0, 0.0).exp()], |x| acos(x[0]), |x| x[0].acos());
}

#[test]
fn exponentials() {
    both!("exp", [2.0, 2.0], |r| [r.uniform(-87.0, 87.0)], |x| exp(x[0]), |x| x[0].exp());
    check::<f64, 1>("exp", 2.0, |r| [r.uniform(-708.0, 708.0)], |x| exp(x[0]), |x| x[0].exp());
    both!("log", [4.0, 4.0], |r| [r.uniform(-87.0, 87.0).exp()], |x| log(x[0]), |x| x[0].ln());
    both!("log", [4.0, 4.0], |r| [r.uniform(0.5, 2.0)], |x| log(x[0]), |x| x[0].ln());
    // |p log x| up to 14.
    let base = |r: &mut Random| [r.uniform(0.1, 1.0), r.uniform(1.0, 6.0)];
    both!("pow", [30.0, 30.0], base, |x| powf(x[0], x[1]), |x| x[0].powf(x[1]));
}

#[test]
fn angles_by_quadrant_and_on_the_axes() {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    let cases = [
        (1.0, 1.0, FRAC_PI_4),
        (1.0, -1.0, 3.0 * FRAC_PI_4),
        (-1.0, -1.0, -3.0 * FRAC_PI_4),
        (-1.0, 1.0, -FRAC_PI_4),
        (0.0, 2.0, 0.0),
        (2.0, 0.0, FRAC_PI_2),
        (0.0, -2.0, PI),
        (-0.0, -2.0, PI),
        (-2.0, 0.0, -FRAC_PI_2),
        (0.0, 0.0, 0.0),
        (-0.0, -0.0, 0.0),
        (1e-300, 1e300, 0.0),
        (1e300, 1e-300, FRAC_PI_2),
    ];
    for (y, x, expected) in cases {
        let got: f64 = atan2(y, x);
        assert!((got - expected).abs() < 1e-15, "atan2({y}, {x}) is {got}, not {expected}");
    }
    assert_eq!((acos(1.0), acos(2.0), acos(-1.0), acos(-2.0)), (0.0, 0.0, PI, PI));
}

#[test]
fn ends_of_the_range() {
    assert_eq!((exp(-1e9), exp(-709.0), exp(0.0)), (0.0, 0.0, 1.0));
    assert_eq!((exp(f64::NEG_INFINITY), exp(f64::INFINITY)), (0.0, exp(708.0)));
    assert_eq!((exp(-88.0_f32), exp(f32::INFINITY)), (0.0, exp(87.0_f32)));
    assert_eq!((log(1.0), powf(0.0, 2.5), powf(1e-310, 1.0), powf(1.0, 7.0)), (0.0, 0.0, 0.0, 1.0));
}

/// What is not a number must not turn into one on the way.
#[test]
fn not_a_number_stays_so() {
    let nan = f64::NAN;
    let results = [
        sin_cos(nan).0,
        sin_cos(nan).1,
        sin_cos(f64::INFINITY).0,
        atan2(nan, 1.0),
        atan2(1.0, nan),
        acos(nan),
        exp(nan),
        powf(nan, 2.5),
    ];
    for (i, x) in results.iter().enumerate() {
        assert!(x.is_nan(), "result {i} is {x}");
    }
}
