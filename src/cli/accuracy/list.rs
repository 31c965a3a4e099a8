//! The scenarios: smooth motion (A), contact (B), joints and loops (C), whole engines (D).

use super::scenario::{Measure, Scenario, Start};
use lanesim::noise;

const ALL: &[f64] = &[0.02, 0.01, 0.005, 0.002, 0.001, 0.0005];
const COARSE: &[f64] = &[0.02, 0.01, 0.005, 0.002, 0.001];
const BOTH: &[&str] = &["elliptic", "pyramidal"];
/// Where a run takes minutes.
const FEW: &[&str] = &["Euler", "midpoint"];
const GRAVITY: f64 = 9.81;

macro_rules! model {
    ($name:literal) => {
        include_str!(concat!("../../../models/accuracy/", $name, ".xml"))
    };
}

const SMOOTH: Scenario = Scenario {
    id: "",
    title: "",
    xml: "",
    seconds: 10.0,
    sample: 0.1,
    hold: 0.02,
    start: Start::Keys,
    control: None,
    error: Measure::Path,
    also: &[],
    cones: &[],
    solvers: false,
    iterations: &[],
    integrators: &[],
    timesteps: ALL,
    reference: ("RK4", 5e-5),
    timed_at: 0.0,
    batch: 512,
    quick: false,
};

const CONTACT: Scenario = Scenario { cones: BOTH, timed_at: 0.5, ..SMOOTH };

/// What is left after so many iterations of a solver.
const SOLVER: Scenario = Scenario {
    start: Start::States(0.3),
    error: Measure::Solve,
    cones: &["elliptic"],
    iterations: &[1, 2, 5, 10, 20, 50, 100],
    timesteps: &[0.002],
    reference: ("implicitfast", 1e-3),
    seconds: 2.0,
    batch: 64,
    ..CONTACT
};

fn sines(time: f64, _: usize, actuator: usize) -> f64 {
    0.01 * (2.0 * time + 0.7 * actuator as f64).sin()
}

/// A robot's servos: a gait that never gets anywhere.
fn gait(time: f64, _: usize, actuator: usize) -> f64 {
    let (leg, joint) = (actuator / 3, actuator % 3);
    let phase = 8.0 * time + std::f64::consts::PI * ((leg == 1) ^ (leg == 2)) as u8 as f64;
    match joint {
        0 => 0.0,
        1 => 0.6 + 0.2 * phase.sin(),
        _ => -1.2 + 0.3 * phase.cos(),
    }
}

/// Full torques of random sign, drawn anew ten times a second.
fn bang_bang(time: f64, world: usize, actuator: usize) -> f64 {
    let tenth = (time / 0.1 + 0.5).floor() as u64;
    if noise::uniform(5, world as u64, tenth, actuator as u64) < 0.5 { -1.0 } else { 1.0 }
}

fn stand(_: f64, _: usize, actuator: usize) -> f64 {
    [0.0, 0.6, -1.2][actuator % 3]
}

fn press(_: f64, _: usize, actuator: usize) -> f64 {
    [1000.0, -5000.0][actuator % 2]
}

fn servos(_: f64, _: usize, actuator: usize) -> f64 {
    [0.3, -0.2][actuator % 2]
}

/// All scenarios.
pub const SCENARIOS: &[Scenario] = &[
    Scenario {
        id: "A1",
        title: "pendulum from 60, 90 and 120 degrees",
        xml: model!("pendulum"),
        also: &[Measure::Energy(7.36)],
        quick: true,
        ..SMOOTH
    },
    Scenario {
        id: "A2",
        title: "double pendulum",
        xml: model!("double_pendulum"),
        seconds: 5.0,
        also: &[Measure::Energy(6.278)],
        quick: true,
        ..SMOOTH
    },
    Scenario {
        id: "A3",
        title: "tumbling free body",
        xml: model!("tumbling"),
        also: &[Measure::Energy(0.75), Measure::Angular],
        quick: true,
        ..SMOOTH
    },
    Scenario {
        id: "A4",
        title: "quadruped in free fall",
        xml: model!("quadruped_air"),
        seconds: 2.0,
        also: &[Measure::Energy(10.0), Measure::Angular],
        quick: true,
        ..SMOOTH
    },
    Scenario {
        id: "A5",
        title: "chain of 10 links",
        xml: model!("chain10"),
        error: Measure::Energy(39.2),
        also: &[Measure::Gain(39.2)],
        ..SMOOTH
    },
    Scenario {
        id: "A6",
        title: "chain of 100 links",
        xml: model!("chain100"),
        seconds: 5.0,
        error: Measure::Energy(245.0),
        also: &[Measure::Gain(245.0)],
        timesteps: COARSE,
        batch: 64,
        ..SMOOTH
    },
    Scenario {
        id: "A7",
        title: "driven humanoid in space",
        xml: model!("humanoid_space"),
        seconds: 5.0,
        control: Some(sines),
        error: Measure::Angular,
        also: &[Measure::Momentum(1.0)],
        timed_at: 1.0,
        ..SMOOTH
    },
    Scenario {
        id: "B1",
        title: "elastic ball",
        xml: model!("elastic_ball"),
        seconds: 20.0,
        sample: 0.02,
        error: Measure::Flight(0.1),
        also: &[Measure::Gain(9.81)],
        cones: &[],
        timed_at: 0.0,
        ..CONTACT
    },
    Scenario {
        id: "B2",
        title: "brick that should stick",
        xml: model!("brick_stick"),
        error: Measure::Creep(1.0),
        quick: true,
        ..CONTACT
    },
    Scenario {
        id: "B3",
        title: "brick that slides",
        xml: model!("brick_slide"),
        seconds: 2.0,
        // g (sin - mu cos) for a slope of 0.75 and friction of 0.5.
        error: Measure::Acceleration(0.4, GRAVITY * (0.6 - 0.5 * 0.8)),
        ..CONTACT
    },
    Scenario {
        id: "B4",
        title: "brick that stops, in three headings",
        xml: model!("brick_stop"),
        seconds: 1.0,
        error: Measure::Distance(4.0 / (2.0 * 0.4 * GRAVITY)),
        timed_at: 0.2,
        quick: true,
        ..CONTACT
    },
    Scenario {
        id: "B5",
        title: "from slip to roll",
        xml: model!("slip_to_roll"),
        seconds: 1.0,
        error: Measure::Speed(3.0 * 5.0 / 7.0),
        timed_at: 0.2,
        ..CONTACT
    },
    Scenario {
        id: "B6",
        title: "stack of 10 boxes",
        xml: model!("stack"),
        seconds: 2.0,
        error: Measure::End,
        also: &[Measure::Rest],
        solvers: true,
        reference: ("RK4", 1e-4),
        batch: 64,
        ..CONTACT
    },
    Scenario {
        id: "B7",
        title: "stack of 1:1000",
        xml: model!("stack_1000"),
        seconds: 5.0,
        error: Measure::Sink(0.1),
        reference: ("RK4", 2e-4),
        also: &[Measure::Rest],
        batch: 128,
        ..CONTACT
    },
    Scenario {
        id: "B8",
        title: "pile of 216 spheres",
        xml: model!("pile"),
        seconds: 1.0,
        error: Measure::Gain(2000.0),
        cones: &[],
        integrators: FEW,
        timesteps: &[0.01, 0.005, 0.002],
        batch: 16,
        timed_at: 0.0,
        ..CONTACT
    },
    Scenario {
        id: "B9",
        title: "27 capsules settle",
        xml: model!("capsules"),
        seconds: 5.0,
        error: Measure::Gain(160.0),
        reference: ("RK4", 1e-3),
        also: &[Measure::Rest],
        cones: &["elliptic"],
        timesteps: &[0.01, 0.005, 0.002, 0.001],
        batch: 64,
        ..CONTACT
    },
    Scenario {
        id: "B10",
        title: "ball hits weightless quadruped",
        xml: model!("quadruped_ball"),
        seconds: 5.0,
        error: Measure::Momentum(50.0),
        also: &[Measure::Angular],
        cones: &["pyramidal"],
        timed_at: 0.2,
        ..CONTACT
    },
    Scenario {
        id: "B11",
        title: "bullets at a plate",
        xml: model!("bullet"),
        seconds: 0.2,
        sample: 0.02,
        error: Measure::Through,
        cones: &[],
        timesteps: &[0.005, 0.002, 0.001],
        timed_at: 0.0,
        ..CONTACT
    },
    Scenario {
        id: "C1",
        title: "four-bar loop",
        xml: model!("four_bar"),
        error: Measure::Gap,
        also: &[Measure::Gain(1.0), Measure::Energy(1.0)],
        ..SMOOTH
    },
    Scenario {
        id: "C2",
        title: "limits under great loads",
        xml: model!("limits"),
        seconds: 2.0,
        control: Some(press),
        error: Measure::End,
        timed_at: 1.0,
        ..SMOOTH
    },
    Scenario {
        id: "C3",
        title: "stiff servos",
        xml: model!("servo"),
        seconds: 5.0,
        // The tip is too stiff for RK4; at rest all steps agree.
        reference: ("discrete", 1e-3),
        control: Some(servos),
        error: Measure::End,
        timed_at: 1.0,
        quick: true,
        ..SMOOTH
    },
    Scenario {
        id: "D1",
        title: "wild humanoids",
        xml: model!("humanoid"),
        hold: 0.1,
        sample: 0.5,
        start: Start::Wild(128, 15.0),
        control: Some(bang_bang),
        error: Measure::Lost,
        timesteps: &[0.02, 0.01, 0.005, 0.002],
        timed_at: 0.0,
        quick: true,
        ..SMOOTH
    },
    Scenario {
        id: "D2",
        title: "a million steps of standing",
        xml: model!("quadruped_servo"),
        seconds: 2000.0,
        sample: 1.0,
        control: Some(stand),
        error: Measure::Drift(5.0),
        integrators: FEW,
        timesteps: &[0.002],
        ..SMOOTH
    },
    Scenario {
        id: "D3",
        title: "boxes far away",
        xml: model!("far_boxes"),
        seconds: 2.0,
        error: Measure::Far,
        cones: &["elliptic"],
        timesteps: &[0.005, 0.002],
        ..CONTACT
    },
    Scenario { id: "D4a", title: "solver, 27 capsules", xml: model!("capsules"), ..SOLVER },
    Scenario { id: "D4b", title: "solver, stack of 10 boxes", xml: model!("stack"), ..SOLVER },
    Scenario { id: "D4c", title: "solver, humanoid on the floor", xml: model!("humanoid"), ..SOLVER },
    Scenario { id: "D4d", title: "solver, stack of 1:1000", xml: model!("stack_1000"), ..SOLVER },
    Scenario {
        id: "D5a",
        title: "falling humanoid, windows",
        xml: model!("humanoid"),
        seconds: 2.0,
        start: Start::Windows(0.1),
        error: Measure::Window,
        solvers: true,
        reference: ("RK4", 1e-4),
        timed_at: 1.0,
        batch: 256,
        ..CONTACT
    },
    Scenario {
        id: "D5b",
        title: "27 capsules, windows",
        xml: model!("capsules"),
        cones: &["elliptic"],
        seconds: 1.5,
        start: Start::Windows(0.1),
        error: Measure::Window,
        reference: ("RK4", 1e-4),
        timed_at: 1.0,
        batch: 64,
        timesteps: COARSE,
        ..CONTACT
    },
    Scenario {
        id: "D5c",
        title: "quadruped on servos, windows",
        xml: model!("quadruped_servo"),
        seconds: 3.0,
        start: Start::Windows(0.1),
        control: Some(gait),
        error: Measure::Window,
        solvers: true,
        reference: ("RK4", 1e-4),
        timed_at: 1.0,
        batch: 256,
        ..CONTACT
    },
];
