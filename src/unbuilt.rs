//! What options can ask for that no step has yet.

use lanesim_kernels::options::Options;

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
    let (fluid, none) = ("fluid forces are", "remove it");
    let left_out = "left out";
    let (density, viscosity) = (o.density, o.viscosity);
    add(density != 0.0, "option", "density", format!("density {density}: {fluid}"), none, left_out, |o| {
        o.density = 0.0
    });
    add(viscosity != 0.0, "option", "viscosity", format!("viscosity {viscosity}: {fluid}"), none, left_out, |o| {
        o.viscosity = 0.0;
    });
    let f = &o.flags;
    let flag = |name: &str, what: &str| format!("{name}: {what}");
    let sleep = flag("sleep", "sleeping trees are");
    add(f.sleep, "flag", "sleep", sleep, none, "all stay awake", |o| o.flags.sleep = false);
    let exact = flag("diagexact", "the exact diagonal of the constraint space is");
    add(f.diagexact, "flag", "diagexact", exact, none, "approximated", |o| o.flags.diagexact = false);
    let ipc = flag("ipc", "incremental potential contact is");
    add(f.ipc, "flag", "ipc", ipc, none, left_out, |o| o.flags.ipc = false);
    let speculative = flag("speculative", "speculative contact is");
    add(f.speculative, "flag", "speculative", speculative, none, left_out, |o| o.flags.speculative = false);
    out
}
