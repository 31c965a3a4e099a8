//! What a scenario is: a model, how it starts and is driven, and what counts as its error.

use std::borrow::Cow;

use lanesim::noise;

/// How far a run is from the truth, by which measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// Root mean square, over samples, of the distance of hinges and slides from the reference; where there are none, the
    /// largest angle between the orientation and the reference's, rad.
    Path,
    /// The largest change of total energy, as a share of this many joules.
    Energy(f64),
    /// The largest rise of total energy above any earlier value, as a share of this many joules.
    Gain(f64),
    /// The largest change of the total momentum, as a share of this many kg m/s.
    Momentum(f64),
    /// The largest change of the angular momentum about the centre of mass, kg m²/s.
    Angular,
    /// The largest distance between the sites `loop_a` and `loop_b`, m.
    Gap,
    /// The speed at which the first free body drifts after this time, m/s.
    Creep(f64),
    /// The relative error of the mean acceleration along x after this time, which should be as given, m/s².
    Acceleration(f64, f64),
    /// The relative error of the distance travelled, which should be as given, m.
    Distance(f64),
    /// The relative error of the final speed along x, which should be as given, m/s.
    Speed(f64),
    /// The largest relative error of energy while a sphere of this radius is in the air.
    Flight(f64),
    /// The largest distance of a coordinate at the end from the reference.
    End,
    /// The largest speed at the end.
    Rest,
    /// The largest change of a coordinate between this time and the end.
    Drift(f64),
    /// By how much what starts far away ends elsewhere than what starts at the origin, m.
    Far,
    /// How far the last body sinks, as a share of this length.
    Sink(f64),
    /// The share of starts that end beyond x = 0 m.
    Through,
    /// The share of worlds that are lost.
    Lost,
    /// The median over windows of the root mean square distance from the reference at the end of the window.
    Window,
    /// The median over states of what a step leaves unsolved: the distance of its velocity from the converged one, as a share of
    /// what constraints do to it, both measured by kinetic energy.
    Solve,
}

impl Measure {
    /// Its name in tables and records.
    pub fn name(self) -> &'static str {
        match self {
            Measure::Path => "path",
            Measure::Energy(_) => "energy",
            Measure::Gain(_) => "gain",
            Measure::Momentum(_) => "momentum",
            Measure::Angular => "angular momentum",
            Measure::Gap => "gap",
            Measure::Creep(_) => "creep",
            Measure::Acceleration(..) => "acceleration",
            Measure::Distance(_) => "distance",
            Measure::Speed(_) => "speed",
            Measure::Flight(_) => "energy in flight",
            Measure::End => "end",
            Measure::Rest => "rest",
            Measure::Drift(_) => "drift",
            Measure::Far => "far",
            Measure::Sink(_) => "sink",
            Measure::Through => "through",
            Measure::Lost => "lost",
            Measure::Window => "window",
            Measure::Solve => "unsolved",
        }
    }

    /// Whether it compares with a reference.
    pub fn needs_reference(self) -> bool {
        matches!(self, Measure::Path | Measure::End | Measure::Window | Measure::Solve)
    }

    /// Whether a lost run counts, instead of having no error.
    pub fn counts_losses(self) -> bool {
        matches!(self, Measure::Lost | Measure::Through)
    }
}

/// How worlds start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// One world in each keyframe of the model, or in the reference configuration if it has none.
    Keys,
    /// One world in the reference's state at the end of every such time, s, for as long.
    Windows(f64),
    /// One world in each of the reference's states after this time, s, for a single step.
    States(f64),
    /// So many worlds in the reference configuration, with joint velocities of this standard deviation, rad/s.
    Wild(usize, f64),
}

/// Controls: a function of time, s, world and actuator. They are held from one multiple of the holding time to the next, so
/// that every engine and time step is given the same ones.
pub type Control = fn(f64, usize, usize) -> f64;

/// One line of the table.
#[derive(Clone, Copy, Debug)]
pub struct Scenario {
    /// Short name: a letter and a number.
    pub id: &'static str,
    /// What happens, in a few words.
    pub title: &'static str,
    /// The model, MJCF.
    pub xml: &'static str,
    /// Simulated time, s.
    pub seconds: f64,
    /// Time between samples, s.
    pub sample: f64,
    /// For how long controls are held, s; a multiple of every time step.
    pub hold: f64,
    /// How worlds start.
    pub start: Start,
    /// What drives it.
    pub control: Option<Control>,
    /// What counts as its error.
    pub error: Measure,
    /// What is measured beside it.
    pub also: &'static [Measure],
    /// Contact cones to try; none: the model's.
    pub cones: &'static [&'static str],
    /// Whether other solvers than Newton's are tried.
    pub solvers: bool,
    /// Iterations to try, with every solver, instead of integrators and time steps; none: as many as it takes.
    pub iterations: &'static [usize],
    /// Integrators to try of those that are asked for, where all would take too long; none: all.
    pub integrators: &'static [&'static str],
    /// Time steps, s.
    pub timesteps: &'static [f64],
    /// Integrator and time step of the reference, s.
    pub reference: (&'static str, f64),
    /// When a step is timed: from this time on, s.
    pub timed_at: f64,
    /// Worlds of a batch whose steps are timed.
    pub batch: usize,
    /// Whether it is part of the short run.
    pub quick: bool,
}

impl Scenario {
    /// Start velocities, `[world][dof]`, of wild worlds: none for the six dofs of the root.
    pub fn wild_velocity(world: usize, dof: usize, deviation: f64) -> f64 {
        if dof < 6 { 0.0 } else { deviation * noise::normal(17, world as u64, 0, dof as u64) }
    }

    /// Controls of a world over the whole run, `[interval][actuator]`.
    pub fn controls(&self, nu: usize, world: usize, from: f64, intervals: usize) -> Vec<Vec<f64>> {
        let Some(control) = self.control else { return Vec::new() };
        let at = |k: usize| from + self.hold * k as f64;
        (0..intervals).map(|k| (0..nu).map(|i| control(at(k), world, i)).collect()).collect()
    }

    /// The model, MJCF. Where iterations are counted, every step starts from what is not solved at all.
    pub fn model(&self) -> Cow<'static, str> {
        if self.iterations.is_empty() {
            return self.xml.into();
        }
        self.xml.replace("</mujoco>", "<option><flag warmstart=\"disable\"/></option></mujoco>").into()
    }

    /// The timesteps of a run, all or a few.
    pub fn timesteps(&self, quick: bool) -> Vec<f64> {
        let few = |dt: &f64| !quick || [0.01, 0.005, 0.002].contains(dt);
        self.timesteps.iter().copied().filter(few).collect()
    }
}
