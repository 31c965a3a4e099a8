//! `lanesim fd`: derivatives of steps.

use clap::{Args, ValueEnum};
use lanesim::cloud::{self, Call, Scheme, Solving, Target, Times};

use super::destination::Destination;
use super::engine::{self, Loaded};
use super::failure::Failure;
use super::output::{self, Progress};
use super::states::StateArgs;
use super::{ModelArgs, RunArgs, memory};

const EXAMPLES: &str = "\
Examples:
  lanesim fd ant.xml --states motion.npz --centred -o derivatives.npz
  lanesim fd ant.xml --states motion.npz --method exact -o derivatives.npz
  lanesim fd ant.xml --states motion.npz --eps 1e-5 --sensors --option integrator=implicitfast -o derivatives.npz

motion.npz holds qpos [N, nq] and qvel [N, nv], and may hold time [N], act [N, na], ctrl [N, nu], qfrc_applied [N, nv], xfrc_applied
[N, nbody, 6], mocap_pos [N, nmocap, 3], mocap_quat [N, nmocap, 4], eq_active [N, neq] and qacc_warmstart [N, nv]; or all of them with
[nworld, nstep, ...] in place of [N, ...]. The result has, with n = 2 nv + na (qpos in the tangent space, qvel, act):
  A       [N, n, n]   of the next state by the state, as MuJoCo's mjd_transitionFD
  B       [N, n, nu]  of the next state by controls
  C, D                of sensors, likewise: [N, nsensordata, n] and [N, nsensordata, nu]
  sides   [N, n + nu] how each column was perturbed: 2 to both sides, 1 forward, -1 backward (a control at a limit), 0 not at all,
                      as where derivatives are exact
  changed [N, n + nu] how many limits and contacts push beside the state and not in it, or the other way round
  status  [N]         bits of what happened to the states; where there are no derivatives they are NaN";

/// Arguments of `fd`.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Fd {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    #[command(flatten)]
    states: StateArgs,
    /// How derivatives are taken
    #[arg(long, value_enum, default_value_t = Method::Fd)]
    method: Method,
    /// Move every number to both sides: twice the work, exact to second order
    #[arg(long)]
    centred: bool,
    /// How far a number is moved [default: 1e-6; in single precision 1e-3, or 5e-3 to both sides]
    #[arg(long, value_name = "EPS", allow_negative_numbers = true)]
    eps: Option<f64>,
    /// Derivatives of sensors, too
    #[arg(long)]
    sensors: bool,
    /// Print what a column of each kind takes
    #[arg(long)]
    times: bool,
    /// How constraints are solved
    #[arg(long, value_enum, default_value_t = How::Accurate)]
    solving: How,
    #[command(flatten)]
    output: Destination,
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    /// Finite differences
    Fd,
    /// The derivative of what a step computes, exact but for rounding
    Exact,
}

#[derive(Clone, Copy, ValueEnum)]
enum How {
    /// By Newton's method until nothing is left but rounding
    Accurate,
    /// As steps do: the model's solver, tolerance and iterations
    FixedWork,
}

impl Fd {
    /// Checks everything, then computes, then writes.
    pub fn run(self) -> Result<(), Failure> {
        let method = match self.method {
            Method::Fd => cloud::Method::Differences,
            Method::Exact => cloud::Method::Exact,
        };
        let only = [("--eps", self.eps.is_some()), ("--centred", self.centred), ("--times", self.times)];
        if let (Method::Exact, Some((option, _))) = (self.method, only.iter().find(|(_, given)| *given)) {
            return Err(Failure::Usage(format!("{option} is of differences; leave it out, or the method exact")));
        }
        self.output.check([&self.model.model, &self.states.states])?;
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let known: Vec<_> = cloud::inputs().collect();
        let (count, inputs) = self.states.read(&model, &known)?;
        let options = self.run.options(None);
        let eps = self.eps.unwrap_or_else(|| Scheme::eps(options.precision, self.centred));
        let scheme = Scheme { method, eps, centred: self.centred, sensors: self.sensors };
        let arrays = Target::Transition.arrays(&model, self.sensors);
        let width = arrays.iter().map(|(_, dims, _)| dims.iter().product::<usize>()).sum();
        memory::check("the derivatives", &[count, width, size_of::<f64>()], self.run.max_memory)?;
        let solving = match self.solving {
            How::Accurate => Solving::Accurate,
            How::FixedWork => Solving::FixedWork,
        };
        let progress = Progress::new("fd", "states", count as u64, false);
        let times = Times::default();
        let counter = Some(progress.counter());
        let call = Call { scheme, solving, options: &options, progress: counter, times: Some(&times) };
        let arrays = cloud::transition(&model, &inputs, &call);
        progress.finish();
        let mut arrays = arrays?;
        if !self.sensors {
            arrays.retain(|(name, _)| !["C", "D"].contains(&name.as_str()));
        }
        if self.times {
            print(&times)?;
        }
        self.output.write(&arrays)
    }
}

/// Prints what a thread spends on a state, and on a column of each kind beside it.
fn print(times: &Times) -> Result<(), Failure> {
    let all = times.all();
    let position = all.iter().find(|time| time.kind == "position").map(|time| time.each());
    let rows = all.iter().map(|time| {
        let (each, share) = (time.each(), position.map_or(0.0, |position| time.each() / position));
        let share = if time.kind == "state" { String::new() } else { format!(", {share:.2} of a position's") };
        (time.kind, format!("{:9.3} us each{share}", 1e6 * each))
    });
    output::table(&rows.collect::<Vec<_>>())
}
