//! Optimal motions: against Riccati's equation, against enumeration, and whether tasks reach their goals.

use lanesim::model::Key;
use lanesim::optimise::{
    End, Method, Norm, Problem, Quantity, Settings, TASKS, Task, Term, minimise, optimise, optimise_watched,
};
use lanesim::{Error, Model, Options, Precision};

/// Two carts with a spring and dampers, pushed without bounds: linear.
const CARTS: &str = "<mujoco><option timestep='0.05' gravity='0 0 0'><flag eulerdamp='disable'/></option><worldbody>
    <body><joint name='a' type='slide' axis='1 0 0' damping='0.3' stiffness='2'/><geom size='.1' mass='1' contype='0'/>
      <body><joint name='b' type='slide' axis='1 0 0' damping='0.1'/><geom size='.1' mass='0.5' contype='0'/></body></body>
  </worldbody><actuator><motor joint='a'/><motor joint='b' gear='2'/></actuator></mujoco>";

fn model(xml: &str) -> Model {
    Model::from_xml_string(xml, &Default::default()).expect("a model")
}

/// Terms: what, its goal, weights along the way and at the end.
type Weights<'a> = &'a [(&'a str, &'a [f64], f64, f64)];

fn terms(list: Weights<'_>) -> Vec<Term> {
    list.iter()
        .map(|(what, goal, running, terminal)| Term::new(what, goal, *running, *terminal).expect("a term"))
        .collect()
}

type Matrix = Vec<Vec<f64>>;

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    a.iter().map(|row| (0..b[0].len()).map(|k| row.iter().zip(b).map(|(x, b)| x * b[k]).sum()).collect()).collect()
}

fn transposed(a: &Matrix) -> Matrix {
    (0..a[0].len()).map(|k| a.iter().map(|row| row[k]).collect()).collect()
}

fn plus(a: &Matrix, b: &Matrix, scale: f64) -> Matrix {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a + scale * b).collect()).collect()
}

fn diagonal(values: &[f64]) -> Matrix {
    (0..values.len()).map(|i| (0..values.len()).map(|k| if i == k { values[i] } else { 0.0 }).collect()).collect()
}

/// The inverse of a matrix of two rows.
fn inverse2(a: &Matrix) -> Matrix {
    let det = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    vec![vec![a[1][1] / det, -a[0][1] / det], vec![-a[1][0] / det, a[0][0] / det]]
}

/// A linear model: Riccati's equation has the cost and the gains, and a single iteration finds them.
#[test]
fn a_linear_model_has_riccatis_solution() {
    const STEPS: usize = 40;
    let h = 0.05;
    // Of q = (a, b), b relative to a: M = [[1.5, 0.5], [0.5, 0.5]]; the step is v' = v + h M⁻¹ (u − K q − B v), q' = q + h v'.
    let m = inverse2(&vec![vec![1.5, 0.5], vec![0.5, 0.5]]);
    let (kq, kv) = (times(&m, &diagonal(&[2.0, 0.0])), times(&m, &diagonal(&[0.3, 0.1])));
    let push = times(&m, &diagonal(&[1.0, 2.0]));
    let unit = |i: usize, k: usize| if i == k { 1.0 } else { 0.0 };
    let vel = |i: usize, k: usize| if k < 2 { -h * kq[i][k] } else { unit(i + 2, k) - h * kv[i][k - 2] };
    let entry = |i: usize, k: usize| if i < 2 { unit(i, k) + h * vel(i, k) } else { vel(i - 2, k) };
    let a: Matrix = (0..4).map(|i| (0..4).map(|k| entry(i, k)).collect()).collect();
    let b: Matrix = (0..4).map(|i| (0..2).map(|k| if i < 2 { h * h } else { h } * push[i % 2][k]).collect()).collect();
    let (q, r) = (diagonal(&[3.0 * h, 3.0 * h, 0.2 * h, 0.2 * h]), diagonal(&[0.1 * h, 0.1 * h]));
    let mut p = diagonal(&[50.0, 50.0, 5.0, 5.0]);
    let mut gains = vec![];
    for _ in 0..STEPS {
        let bp = times(&transposed(&b), &p);
        let k = times(&inverse2(&plus(&r, &times(&bp, &b), 1.0)), &times(&bp, &a));
        let closed = plus(&a, &times(&b, &k), -1.0);
        p = plus(&q, &times(&transposed(&a), &times(&p, &closed)), 1.0);
        gains.push(k);
    }
    gains.reverse();
    let x0 = vec![vec![0.7], vec![-0.4], vec![0.2], vec![1.0]];
    let expected = 0.5 * times(&transposed(&x0), &times(&p, &x0))[0][0];

    let model = model(CARTS);
    let cost = terms(&[("qpos", &[], 3.0, 50.0), ("qvel", &[], 0.2, 5.0), ("ctrl", &[], 0.1, 0.0)]);
    let start = Key { qpos: vec![0.7, -0.4], qvel: vec![0.2, 1.0], ..model.initial_key() };
    let problem = Problem::new(&model, &cost, STEPS).expect("a problem").start(&start).expect("a start");
    let settings = Settings { regularisation: 0.0, ..Settings::default() };
    let motion = optimise(&problem, &settings).expect("a motion");
    assert!((motion.rows[1].cost / expected - 1.0).abs() < 1e-7, "{} {expected}", motion.rows[1].cost);
    assert!((motion.cost() / expected - 1.0).abs() < 1e-9, "{} {expected}", motion.cost());
    assert!(motion.rows.len() <= 4, "{:?}", motion.rows);
    for (t, gains) in gains.iter().enumerate() {
        for i in 0..2 {
            for k in 0..4 {
                let found = motion.gains[(t * 2 + i) * 4 + k];
                assert!((found + gains[i][k]).abs() < 1e-6, "{t} {i} {k}: {found} {}", gains[i][k]);
            }
        }
    }
}

/// With bounds, against the best of all choices of numbers at bounds.
#[test]
fn bounded_quadratics_are_least_where_enumeration_says() {
    let mut seed = 1_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
    };
    for round in 0..200 {
        let n = 1 + round % 4;
        let root: Matrix = (0..n).map(|_| (0..n).map(|_| random()).collect()).collect();
        let h = plus(&times(&transposed(&root), &root), &diagonal(&vec![0.05; n]), 1.0);
        let g: Vec<f64> = (0..n).map(|_| random()).collect();
        let lo: Vec<f64> = (0..n).map(|_| -0.5 - 0.5 * random()).collect();
        let hi: Vec<f64> = lo.iter().map(|lo| lo + 0.2 + 0.5 * (1.0 + random())).collect();
        let value = |x: &[f64]| -> f64 {
            (0..n).map(|i| x[i] * (g[i] + 0.5 * (0..n).map(|k| h[i][k] * x[k]).sum::<f64>())).sum()
        };
        let mut best = f64::INFINITY;
        for choice in 0..3_usize.pow(n as u32) {
            let of = |i: usize| choice / 3_usize.pow(i as u32) % 3;
            // Gauss-Seidel over what is free converges: the matrix is positive definite.
            let mut x: Vec<f64> = (0..n).map(|i| [0.0, lo[i], hi[i]][of(i)]).collect();
            for _ in 0..2000 {
                for i in (0..n).filter(|i| of(*i) == 0) {
                    let others: f64 = (0..n).filter(|k| *k != i).map(|k| h[i][k] * x[k]).sum();
                    x[i] = -(g[i] + others) / h[i][i];
                }
            }
            if (0..n).all(|i| x[i] >= lo[i] - 1e-12 && x[i] <= hi[i] + 1e-12) {
                best = best.min(value(&x));
            }
        }
        let flat: Vec<f64> = h.iter().flatten().copied().collect();
        let start: Vec<f64> = (0..n).map(|_| 3.0 * random()).collect();
        let found = minimise(&flat, &g, [&lo, &hi], &start).expect("a minimum");
        assert!((0..n).all(|i| found.x[i] >= lo[i] && found.x[i] <= hi[i]), "{round}");
        assert!(value(&found.x) - best < 1e-8, "{round}: {} {best}", value(&found.x));
        for i in 0..n {
            let slope: f64 = g[i] + (0..n).map(|k| h[i][k] * found.x[k]).sum::<f64>();
            assert!(!found.free.contains(&i) || slope.abs() < 1e-7, "{round}: {i} is free and has slope {slope}");
        }
    }
    assert!(minimise(&[-1.0], &[0.0], [&[-1.0], &[1.0]], &[0.5]).is_none());
}

#[test]
fn the_cart_pole_swings_up() {
    let task = Task::named("cartpole").expect("a task");
    let problem = task.problem(None).expect("a problem");
    let settings = Settings { iterations: 120, ..Settings::default() };
    let motion = optimise(&problem, &settings).expect("a motion");
    for reached in task.reached(&problem, &motion).expect("goals") {
        assert!(reached.passed(), "{reached:?}");
    }
    assert!(motion.ctrl.iter().all(|u| u.abs() <= 1.0));
    // It is bounded somewhere, or bounds were not tried.
    assert!(motion.ctrl.iter().any(|u| u.abs() == 1.0));
    assert!(motion.rows.windows(2).all(|rows| rows[1].cost <= rows[0].cost));
    // The same whatever does it.
    let alone = Settings { options: Options { threads: Some(1), ..Options::default() }, ..settings };
    assert_eq!(optimise(&problem, &alone).expect("a motion").ctrl, motion.ctrl);
}

/// The motion is what the model does under the controls, and gains bring it back when it starts elsewhere.
#[test]
fn the_motion_is_one_of_the_model() {
    let task = Task::named("cartpole").expect("a task");
    let problem = task.problem(Some(1.0)).expect("a problem");
    let motion = optimise(&problem, &Settings { iterations: 30, ..Settings::default() }).expect("a motion");
    let mut worlds = lanesim::Worlds::new(problem.model(), 1, &Options::default()).expect("a batch");
    worlds.set(lanesim::Field::Qpos, 0, &motion.qpos[..2]).expect("a world");
    for t in 0..problem.steps() {
        worlds.set(lanesim::Field::Ctrl, 0, &motion.ctrl[t..=t]).expect("a world");
        worlds.step(1).expect("a step");
        let qpos = worlds.get(lanesim::Field::Qpos, 0).expect("a field");
        assert_eq!(qpos, &motion.qpos[2 * t + 2..2 * t + 4], "{t}");
    }
    assert_eq!(motion.gains.len(), problem.steps() * 4);
    assert_eq!(motion.qvel.len(), (problem.steps() + 1) * 2);
}

/// Terms about places have the derivatives of sensors, with rotations in the tangent space: the search ends at a target that can be reached.
#[test]
fn places_and_rotations_are_reached() {
    let xml = "<mujoco><option timestep='0.02' gravity='0 0 0'/><worldbody><body name='stick'><joint name='ball' type='ball' damping='0.2'/>
        <geom type='capsule' fromto='0 0 0 1 0 0' size='.05' mass='1'/><site name='tip' pos='1 0 0'/></body></worldbody>
      <actuator><motor joint='ball' gear='1 0 0'/><motor joint='ball' gear='0 1 0'/><motor joint='ball' gear='0 0 1'/></actuator></mujoco>";
    let model = model(xml);
    let half = 0.5_f64.sqrt();
    let cases: [(&str, &[f64]); 4] = [
        ("site:tip", &[0.0, 1.0, 0.0]),
        ("com:stick", &[0.0, 0.0, 0.5]),
        ("qpos:ball", &[half, 0.0, 0.0, half]),
        ("qpos", &[0.0, 1.0, 0.0, 0.0]),
    ];
    for (what, goal) in cases {
        for norm in [Norm::Quadratic, Norm::SmoothAbs(0.1)] {
            let cost = terms(&[(what, goal, 0.0, 1e3), ("qvel", &[], 0.0, 10.0), ("ctrl", &[], 0.01, 0.0)]);
            let cost: Vec<Term> = cost
                .into_iter()
                .enumerate()
                .map(|(i, term)| Term { norm: if i == 0 { norm } else { term.norm }, ..term })
                .collect();
            // Half a turn is where rotations have no derivative: from beside it.
            let start = Key { qpos: vec![1.0, 0.02, 0.03, 0.01], ..model.initial_key() };
            let problem = Problem::new(&model, &cost, 50).and_then(|problem| problem.start(&start)).expect("a problem");
            let motion = optimise(&problem, &Settings::default()).expect("a motion");
            let distance = motion.distance(&problem, &cost[0]).expect("a distance");
            assert!(distance < 0.02, "{what} {norm:?}: {distance}");
        }
    }
}

/// Both methods on the same problems: with all joints driven, with one that is not, with a free body that turns as its arm does, and with
/// bounds.
#[test]
fn methods_agree() {
    let half = CARTS.replace("<motor joint='b' gear='2'/>", "");
    let bounded = half.replace("<motor joint='a'/>", "<motor joint='a' gear='2' ctrlrange='-0.5 0.5'/>");
    let arm = "<mujoco><option timestep='0.02' gravity='0 0 0'/><worldbody><body><freejoint/><geom type='box' size='.2 .1 .15' mass='1'/>
        <body pos='.2 0 0'><joint name='elbow' axis='0.3 1 0.2' damping='0.05'/><geom type='capsule' fromto='0 0 0 .4 .1 0' size='.03' mass='0.3'/></body>
      </body></worldbody><actuator><motor joint='elbow'/></actuator></mujoco>";
    let swing = &[("qpos", &[][..], 3.0, 50.0), ("qvel", &[], 0.2, 5.0), ("ctrl", &[], 0.1, 0.0)];
    let bend = &[("qpos:elbow", &[1.5][..], 1.0, 100.0), ("qvel", &[], 0.1, 1.0), ("ctrl", &[], 0.5, 0.0)];
    let cases: [(&str, Weights<'_>, f64); 4] =
        [(CARTS, swing, 1e-6), (&half, swing, 1e-5), (arm, bend, 1e-4), (&bounded, swing, 5e-3)];
    for (xml, cost, tolerance) in cases {
        let model = model(xml);
        let mut start = model.initial_key();
        start.qvel[0] = 0.4;
        let problem =
            Problem::new(&model, &terms(cost), 40).and_then(|problem| problem.start(&start)).expect("a problem");
        let run = |method| {
            optimise(&problem, &Settings { method, tolerance: 1e-9, ..Settings::default() }).expect("a motion")
        };
        let (ilqg, positions) = (run(Method::Ilqg), run(Method::GaussNewton));
        let (a, b) = (ilqg.cost(), positions.cost());
        assert!((a / b - 1.0).abs() < tolerance, "{xml}: {a} {b}, {:?} {}", positions.end, positions.residual);
        // What positions alone say is what steps do, but for the force that is missing; with bounds it takes longer than this, and the end says so.
        let said = positions.rows.last().expect("a row").cost;
        let apart = (said / b - 1.0).abs();
        let unfinished = xml == bounded && positions.end != End::Converged;
        assert!(apart < 1e-3 || unfinished, "{xml}: {said} {b}, {:?} {}", positions.end, positions.residual);
    }
}

/// By positions, too, the pole is swung up, and the motion is one that the model has.
#[test]
fn positions_swing_the_pole_up() {
    let task = Task::named("cartpole").expect("a task");
    let problem = task.problem(None).expect("a problem");
    let settings = Settings { method: Method::GaussNewton, iterations: task.iterations, ..Settings::default() };
    let motion = optimise(&problem, &settings).expect("a motion");
    for reached in task.reached(&problem, &motion).expect("goals") {
        assert!(reached.passed(), "{reached:?}");
    }
    assert!(motion.residual < 1e-2, "{}", motion.residual);
    assert!(motion.ctrl.iter().all(|u| u.abs() <= 1.0));
}

fn message<T>(result: Result<T, Error>) -> String {
    result.err().expect("an error").to_string()
}

#[test]
fn bad_input_is_named() {
    let model = model(CARTS);
    let good = terms(&[("qpos", &[], 1.0, 1.0)]);
    let problem = |terms: &[Term]| Problem::new(&model, terms, 10);
    assert!(message(Task::named("cartpol")).contains("did you mean \"cartpole\"?"));
    assert!(message(Task::named("juggler")).contains("valid: cartpole"));
    assert!(message(TASKS[0].problem(Some(0.0))).contains("the horizon is 0 s"));
    assert!(message(TASKS[0].problem(Some(f64::NAN))).contains("the horizon is NaN s"));
    assert!(message(Problem::new(&model, &good, 0)).contains("no step"));
    assert!(message(problem(&[])).contains("no terms"));
    let still = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>";
    assert!(message(Problem::new(&self::model(still), &good, 10)).contains("no actuators"));

    assert!(message(Quantity::parse("qpo")).contains("did you mean \"qpos\"?"));
    assert!(message(Quantity::parse("site")).contains("site:NAME"));
    for (what, words) in [
        ("qpos:c", "there is no joint \"c\""),
        ("site:tip", "there is no site \"tip\""),
        ("sensor:s", "no sensor \"s\""),
    ] {
        assert!(message(problem(&terms(&[(what, &[], 1.0, 1.0)]))).contains(words), "{what}");
    }
    assert!(message(problem(&terms(&[("qpos", &[1.0], 1.0, 1.0)]))).contains("has 1 numbers; expected 2"));
    assert!(message(problem(&terms(&[("qvel", &[f64::NAN], 1.0, 1.0)]))).contains("holds NaN"));
    assert!(message(problem(&terms(&[("qvel", &[], -1.0, 1.0)]))).contains("the running weight of qvel is -1"));
    let flat = Term { norm: Norm::SmoothAbs(0.0), ..good[0].clone() };
    assert!(message(problem(&[flat])).contains("the width of the norm of qpos is 0"));

    let start = |qpos: Vec<f64>| problem(&good).expect("a problem").start(&Key { qpos, ..model.initial_key() });
    assert!(message(start(vec![0.0, f64::NAN])).contains("array `qpos` holds NaN at [1]"));
    assert!(message(start(vec![0.0])).contains("qpos"));
    let controls = |controls: &[f64]| problem(&good).expect("a problem").controls(controls);
    assert!(message(controls(&[0.0; 19])).contains("ctrl"));
    assert!(message(controls(&[f64::INFINITY; 20])).contains("array `ctrl` holds inf at [0, 0]"));

    let run = |settings: Settings| optimise(&problem(&good).expect("a problem"), &settings);
    let single = Options { precision: Precision::F32, ..Options::default() };
    assert!(message(run(Settings { options: single, ..Settings::default() })).contains("double precision"));
    assert!(message(run(Settings { tolerance: f64::NAN, ..Settings::default() })).contains("tolerance is NaN"));
    let scheme = lanesim::cloud::Scheme { eps: 0.0, ..Default::default() };
    assert!(message(run(Settings { scheme, ..Settings::default() })).contains("eps is 0"));
    let rk4 = CARTS.replace("<option ", "<option integrator='RK4' ");
    let by_positions = Settings { method: Method::GaussNewton, ..Settings::default() };
    let problem_of = |xml: &str| Problem::new(&self::model(xml), &good, 10).expect("a problem");
    assert!(message(optimise(&problem_of(&rk4), &by_positions)).contains("integrator RK4"));
    let servo = CARTS.replace("<motor joint='a'/>", "<position name='servo' joint='a'/>");
    assert!(message(optimise(&problem_of(&servo), &by_positions)).contains("actuator 0 \"servo\": Gauss-Newton"));
    let twice = CARTS.replace("joint='b' gear", "joint='a' gear");
    assert!(message(optimise(&problem_of(&twice), &by_positions)).contains("actuators 0 and 1 drive the same joint"));
    let cancelled = std::sync::atomic::AtomicBool::new(true);
    let stopped = optimise_watched(&problem(&good).expect("a problem"), &Settings::default(), None, Some(&cancelled));
    assert!(matches!(stopped, Err(Error::Cancelled)));
}
