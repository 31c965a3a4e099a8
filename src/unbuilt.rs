//! What options can ask for that no step has yet.

use lanesim_kernels::options::{Integrator, Options};

/// An option that asks for something that is not built.
pub(crate) struct Unbuilt {
    /// The element that has it, `option` or `flag`, and the attribute.
    pub element: &'static str,
    pub attribute: &'static str,
    /// What it asks for, before "not supported".
    pub what: String,
    /// What to do about it.
    pub remedy: &'static str,
    /// What a lenient load does instead.
    pub instead: &'static str,
    /// Sets the option to what is built.
    pub reset: fn(&mut Options),
}

/// All that a model's options ask for and is not built.
pub(crate) fn unbuilt(o: &Options) -> Vec<Unbuilt> {
    let mut out = Vec::new();
    let mut add = |asked: bool, element, attribute, what: String, remedy, instead, reset: fn(&mut Options)| {
        if asked {
            out.push(Unbuilt { element, attribute, what, remedy, instead, reset });
        }
    };
    let (none, left_out) = ("remove it", "left out");
    let what = "the guard under integrator RK4 is".to_string();
    add(
        o.guard && o.integrator == Integrator::Rk4,
        "option",
        "guard",
        what,
        "set integrator=\"midpoint\"",
        left_out,
        |o| {
            o.guard = false;
        },
    );
    let f = &o.flags;
    let flag = |name: &str, what: &str| format!("{name}: {what}");
    let exact = flag("diagexact", "the exact diagonal of the constraint space is");
    add(f.diagexact, "flag", "diagexact", exact, none, "approximated", |o| o.flags.diagexact = false);
    let ipc = flag("ipc", "incremental potential contact is");
    add(f.ipc, "flag", "ipc", ipc, none, left_out, |o| o.flags.ipc = false);
    let speculative = flag("speculative", "speculative contact is");
    add(f.speculative, "flag", "speculative", speculative, none, left_out, |o| o.flags.speculative = false);
    out
}
