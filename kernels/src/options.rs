//! Simulation options: the run-time part of MJCF's `option` and `flag`.

/// Numerical integrator (MJCF `option/integrator`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    /// Semi-implicit Euler, with joint damping taken implicitly.
    Euler,
    /// Runge-Kutta of order four.
    Rk4,
    /// Implicit in velocity, full derivative.
    Implicit,
    /// Implicit in velocity, without Coriolis derivatives.
    ImplicitFast,
    /// Discrete-time constraint formulation.
    Discrete,
    /// Staggered midpoint: of order two, with one evaluation at the middle of the step.
    Midpoint,
}

impl Integrator {
    /// Whether a solver works in a metric of the step in place of the inertia matrix.
    pub fn has_metric(self) -> bool {
        matches!(self, Integrator::Discrete | Integrator::Midpoint)
    }
}

impl std::fmt::Display for Integrator {
    /// The name in MJCF.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Integrator::Euler => "Euler",
            Integrator::Rk4 => "RK4",
            Integrator::Implicit => "implicit",
            Integrator::ImplicitFast => "implicitfast",
            Integrator::Discrete => "discrete",
            Integrator::Midpoint => "midpoint",
        })
    }
}

/// Friction cone (MJCF `option/cone`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cone {
    /// Polyhedral cone with two edges per friction direction.
    Pyramidal,
    /// Quadratic cone.
    Elliptic,
}

/// Constraint solver (MJCF `option/solver`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solver {
    /// Projected Gauss-Seidel on the dual problem.
    Pgs,
    /// Nonlinear conjugate gradients on the primal problem.
    Cg,
    /// Newton's method on the primal problem.
    Newton,
}

/// Switches of MJCF `option/flag`; `true` means enabled.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // each field is the MJCF attribute of the same name
pub struct Flags {
    pub constraint: bool,
    pub equality: bool,
    pub frictionloss: bool,
    pub limit: bool,
    pub contact: bool,
    pub spring: bool,
    pub damper: bool,
    pub gravity: bool,
    pub clampctrl: bool,
    pub warmstart: bool,
    pub filterparent: bool,
    pub actuation: bool,
    pub refsafe: bool,
    pub sensor: bool,
    pub midphase: bool,
    pub eulerdamp: bool,
    pub autoreset: bool,
    pub nativeccd: bool,
    pub island: bool,
    pub multiccd: bool,
    pub override_: bool,
    pub energy: bool,
    pub fwdinv: bool,
    pub invdiscrete: bool,
    pub sleep: bool,
    pub diagexact: bool,
    pub ipc: bool,
    pub speculative: bool,
}

impl Default for Flags {
    fn default() -> Self {
        Flags {
            constraint: true,
            equality: true,
            frictionloss: true,
            limit: true,
            contact: true,
            spring: true,
            damper: true,
            gravity: true,
            clampctrl: true,
            warmstart: true,
            filterparent: true,
            actuation: true,
            refsafe: true,
            sensor: true,
            midphase: true,
            eulerdamp: true,
            autoreset: true,
            nativeccd: true,
            island: true,
            multiccd: true,
            override_: false,
            energy: false,
            fwdinv: false,
            invdiscrete: false,
            sleep: false,
            diagexact: false,
            ipc: false,
            speculative: false,
        }
    }
}

/// Simulation options (MJCF `option`), with MuJoCo 4.0.0's defaults. Always f64: kernels convert where they use them.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Time step, s.
    pub timestep: f64,
    /// Gravity, m/s², world axes.
    pub gravity: [f64; 3],
    /// Wind velocity, m/s, world axes.
    pub wind: [f64; 3],
    /// Magnetic field, world axes.
    pub magnetic: [f64; 3],
    /// Density of the medium, kg/m³.
    pub density: f64,
    /// Viscosity of the medium, kg/(m s).
    pub viscosity: f64,
    /// Ratio of normal to frictional constraint impedance.
    pub impratio: f64,
    /// Solver tolerance, scaled (see `solver`).
    pub tolerance: f64,
    /// Line search tolerance, relative. The first searches of Newton's method are rougher.
    pub ls_tolerance: f64,
    /// No-slip post-pass tolerance.
    pub noslip_tolerance: f64,
    /// Convex collision tolerance, m.
    pub ccd_tolerance: f64,
    /// Speed below which a tree rests (MJCF `sleep_tolerance`), m/s.
    pub sleep_tolerance: f64,
    /// Most solver iterations.
    pub iterations: u32,
    /// Most line search evaluations per solver iteration.
    pub ls_iterations: u32,
    /// No-slip iterations.
    pub noslip_iterations: u32,
    /// Convex collision iterations.
    pub ccd_iterations: u32,
    /// Margin of every contact when the `override` flag is set, m.
    pub o_margin: f64,
    /// `solref` of every contact when the `override` flag is set.
    pub o_solref: [f64; 2],
    /// `solimp` of every contact when the `override` flag is set.
    pub o_solimp: [f64; 5],
    /// Friction of every contact when the `override` flag is set.
    pub o_friction: [f64; 5],
    /// Bit mask of disabled actuator groups.
    pub actuatorgroupdisable: u32,
    /// Integrator.
    pub integrator: Integrator,
    /// Whether inertial forces are kept from creating energy and momentum.
    pub guard: bool,
    /// Friction cone.
    pub cone: Cone,
    /// Constraint solver.
    pub solver: Solver,
    /// Switches.
    pub flags: Flags,
}

/// More iterations than this are not made: what has not converged by then has lost its digits, and a step must end.
pub const MOST_ITERATIONS: u32 = 10_000;

impl Options {
    /// With limits of iterations that a step keeps.
    pub fn limited(mut self) -> Options {
        for limit in
            [&mut self.iterations, &mut self.ls_iterations, &mut self.noslip_iterations, &mut self.ccd_iterations]
        {
            *limit = (*limit).min(MOST_ITERATIONS);
        }
        self
    }
}

impl Default for Options {
    fn default() -> Self {
        Options {
            timestep: 0.002,
            gravity: [0.0, 0.0, -9.81],
            wind: [0.0; 3],
            magnetic: [0.0, -0.5, 0.0],
            density: 0.0,
            viscosity: 0.0,
            impratio: 1.0,
            tolerance: 1e-8,
            ls_tolerance: 0.01,
            noslip_tolerance: 1e-6,
            ccd_tolerance: 1e-6,
            sleep_tolerance: 1e-3,
            iterations: 100,
            ls_iterations: 50,
            noslip_iterations: 0,
            ccd_iterations: 35,
            o_margin: 0.0,
            o_solref: [0.02, 1.0],
            o_solimp: [0.9, 0.95, 0.001, 0.5, 2.0],
            o_friction: [1.0, 1.0, 0.005, 1e-4, 1e-4],
            actuatorgroupdisable: 0,
            integrator: Integrator::Euler,
            guard: false,
            cone: Cone::Pyramidal,
            solver: Solver::Newton,
            flags: Flags::default(),
        }
    }
}
