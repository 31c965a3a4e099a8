//! `option` and `flag`: run-time options, and their overrides from outside the file.

use super::report::{Report, file_problem, quoted};
use super::tree::{Element, Tree};
use super::value::{exactly, integer, integers, keyword, leading};
use crate::diagnostics::Diagnostics;
use crate::spec::{Options, Source, Spec};
use crate::suggest::did_you_mean;
use crate::unbuilt::unbuilt;
use lanesim_kernels::options::{Cone, Flags, Integrator, MOST_ITERATIONS, Solver};

/// The attributes of `option`.
pub(super) const NAMES: &str = "actuatorgroupdisable ccd_iterations ccd_tolerance cone density gravity guard impratio \
    integrator iterations jacobian ls_iterations ls_tolerance magnetic noslip_iterations noslip_tolerance o_friction \
    o_margin o_solimp o_solref sdf_initpoints sdf_iterations sleep_tolerance solver timestep tolerance viscosity wind";
/// The attributes of `flag`.
pub(super) const FLAGS: &str = "actuation autoreset clampctrl constraint contact damper diagexact energy equality \
    eulerdamp filterparent frictionloss fwdinv gravity invdiscrete ipc island limit midphase multiccd nativeccd override \
    refsafe sensor sleep speculative spring warmstart";

const INTEGRATORS: &[(&str, Integrator)] = &[
    ("Euler", Integrator::Euler),
    ("RK4", Integrator::Rk4),
    ("implicit", Integrator::Implicit),
    ("implicitfast", Integrator::ImplicitFast),
    ("discrete", Integrator::Discrete),
    ("midpoint", Integrator::Midpoint),
];
const CONES: &[(&str, Cone)] = &[("pyramidal", Cone::Pyramidal), ("elliptic", Cone::Elliptic)];
const SOLVERS: &[(&str, Solver)] = &[("PGS", Solver::Pgs), ("CG", Solver::Cg), ("Newton", Solver::Newton)];
const JACOBIANS: &[(&str, ())] = &[("dense", ()), ("sparse", ()), ("auto", ())];
const SWITCH: &[(&str, bool)] = &[("enable", true), ("disable", false)];

/// Reads all `option` sections, in order.
pub(super) fn read(tree: &Tree, spec: &mut Spec, report: &mut Report) {
    for index in tree.sections("option") {
        let element = &tree[index];
        for (name, value) in &element.attributes {
            report_bad(element, name, set(&mut spec.option, name, value), report);
            spec.written.insert(format!("option {name}"), element.source.clone());
        }
        for flag in tree.children(index).filter(|child| child.tag == "flag") {
            for (name, value) in &flag.attributes {
                report_bad(flag, name, set_flag(&mut spec.option.flags, name, value), report);
                spec.written.insert(format!("flag {name}"), flag.source.clone());
            }
        }
    }
}

/// Notes limits of iterations beyond which a step would not end.
pub(super) fn note_iterations(spec: &Spec, report: &mut Report) {
    let o = &spec.option;
    for (name, limit) in [
        ("iterations", o.iterations),
        ("ls_iterations", o.ls_iterations),
        ("noslip_iterations", o.noslip_iterations),
        ("ccd_iterations", o.ccd_iterations),
    ] {
        if limit > MOST_ITERATIONS {
            let what =
                format!("{name} {limit} count as {MOST_ITERATIONS}: what has not converged by then lost its digits");
            report.note_at(&spec.place("option", name), "option", &what);
        }
    }
}

/// Reports options that ask for what is not built, or with a lenient load resets them.
pub(super) fn reset_unbuilt(spec: &mut Spec, report: &mut Report) {
    for unbuilt in unbuilt(&spec.option) {
        let source = spec.place(unbuilt.element, unbuilt.attribute);
        report.unbuilt(&source, &unbuilt);
        if report.lenient {
            (unbuilt.reset)(&mut spec.option);
        }
    }
    if !spec.option.flags.nativeccd {
        let source = spec.place("flag", "nativeccd");
        report.note_at(&source, "flag", "nativeccd has no effect: convex pairs have one algorithm");
    }
}

fn report_bad(element: &Element, name: &str, result: Result<(), String>, report: &mut Report) {
    if let Err(message) = result {
        report.error(element, format!("attribute {}: {message}", quoted(name)), "");
    }
}

/// A name and its value.
type Override = (String, String);

fn is_switch(value: &str) -> bool {
    SWITCH.iter().any(|(word, _)| *word == value)
}

/// Whether two overrides are of the same option: gravity is an option and a flag.
fn same(a: &Override, b: &Override) -> bool {
    a.0 == b.0 && is_switch(&a.1) == is_switch(&b.1)
}

/// Earlier overrides, but for those that later ones replace, and then these.
pub(super) fn replaced(earlier: &[Override], later: &[Override]) -> Vec<Override> {
    let kept = earlier.iter().filter(|old| !later.iter().any(|new| same(old, new)));
    kept.chain(later).cloned().collect()
}

/// Applies overrides, NAME=VALUE each; a name is one of `option` or, with the value enable or disable, of `flag`.
/// Scripts add options to options, so one that comes again with the same value is no contradiction.
pub(super) fn apply(overrides: &[Override], spec: &mut Spec) -> Result<(), Diagnostics> {
    let mut problems = Diagnostics::default();
    for (i, given) in overrides.iter().enumerate() {
        let (name, value) = given;
        let other = |earlier: &&Override| same(earlier, given) && earlier.1.trim() != value.trim();
        let refusal = match overrides[..i].iter().find(other) {
            Some((_, old)) => {
                let values = format!("both as {} and as {}", quoted(old), quoted(value));
                Some((format!("is given {values}"), "give it once"))
            }
            None if value.trim().is_empty() => Some(("has no value".into(), "give one, or leave the option out")),
            None => None,
        };
        if let Some((what, remedy)) = refusal {
            problems.push(&Source::default(), "", format!("option {} {what}", quoted(name)), remedy);
            continue;
        }
        let options = &mut spec.option;
        let is = |list: &str| list.split_ascii_whitespace().any(|known| known == name);
        let result = match (is(NAMES), is(FLAGS)) {
            (false, false) => {
                let all = NAMES.split_ascii_whitespace().chain(FLAGS.split_ascii_whitespace());
                let remedy = match did_you_mean(name, all) {
                    near if near.is_empty() => "give an attribute of MJCF's option or flag".to_string(),
                    near => near,
                };
                problems.push(&Source::default(), "", format!("unknown option {}", quoted(name)), remedy);
                continue;
            }
            (true, true) if is_switch(value) => set_flag(&mut options.flags, name, value),
            (true, _) => set(options, name, value),
            (false, true) => set_flag(&mut options.flags, name, value),
        };
        spec.written.remove(&format!("option {name}"));
        spec.written.remove(&format!("flag {name}"));
        if let Err(message) = result {
            problems.0.extend(file_problem(&Source::default(), format!("option {}: {message}", quoted(name)), "").0);
        }
    }
    problems.into_result()
}

/// Sets an option by its name. Names that only steer memory layout or shapes that are not supported have no effect.
fn set(o: &mut Options, name: &str, value: &str) -> Result<(), String> {
    match name {
        "timestep" => real(value, &mut o.timestep),
        "gravity" => exactly(value, &mut o.gravity).map(drop),
        "wind" => exactly(value, &mut o.wind).map(drop),
        "magnetic" => exactly(value, &mut o.magnetic).map(drop),
        "density" => real(value, &mut o.density),
        "viscosity" => real(value, &mut o.viscosity),
        "impratio" => real(value, &mut o.impratio),
        "tolerance" => real(value, &mut o.tolerance),
        "ls_tolerance" => real(value, &mut o.ls_tolerance),
        "noslip_tolerance" => real(value, &mut o.noslip_tolerance),
        "ccd_tolerance" => real(value, &mut o.ccd_tolerance),
        "iterations" => count(value, &mut o.iterations),
        "ls_iterations" => count(value, &mut o.ls_iterations),
        "noslip_iterations" => count(value, &mut o.noslip_iterations),
        "ccd_iterations" => count(value, &mut o.ccd_iterations),
        "o_margin" => real(value, &mut o.o_margin),
        "o_solref" => leading(value, &mut o.o_solref).map(drop),
        "o_solimp" => leading(value, &mut o.o_solimp).map(drop),
        "o_friction" => leading(value, &mut o.o_friction).map(drop),
        "actuatorgroupdisable" => groups(value, &mut o.actuatorgroupdisable),
        "integrator" => keyword(value, INTEGRATORS).map(|x| o.integrator = x),
        "guard" => keyword(value, SWITCH).map(|x| o.guard = x),
        "cone" => keyword(value, CONES).map(|x| o.cone = x),
        "solver" => keyword(value, SOLVERS).map(|x| o.solver = x),
        "jacobian" => keyword(value, JACOBIANS),
        "sdf_initpoints" | "sdf_iterations" => count(value, &mut 0),
        "sleep_tolerance" => real(value, &mut o.sleep_tolerance),
        _ => Ok(()),
    }
}

fn real(text: &str, target: &mut f64) -> Result<(), String> {
    exactly(text, std::slice::from_mut(target)).map(drop)
}

fn count(text: &str, target: &mut u32) -> Result<(), String> {
    if let Some(value) = integer(text)? {
        *target = u32::try_from(value).map_err(|_| format!("{value} is negative"))?;
    }
    Ok(())
}

/// Numbers of groups, each a bit of the mask.
fn groups(text: &str, target: &mut u32) -> Result<(), String> {
    let mut mask = 0;
    for group in integers(text)? {
        let shift = u32::try_from(group).ok().filter(|&g| g <= 30).ok_or(format!("{group} is not from 0 to 30"))?;
        mask |= 1 << shift;
    }
    *target = mask;
    Ok(())
}

/// Switches a flag by its name.
fn set_flag(f: &mut Flags, name: &str, value: &str) -> Result<(), String> {
    let on = keyword(value, SWITCH)?;
    if let Some(flag) = flag_mut(f, name) {
        *flag = on;
    }
    Ok(())
}

/// A flag by its name.
fn flag_mut<'a>(f: &'a mut Flags, name: &str) -> Option<&'a mut bool> {
    Some(match name {
        "constraint" => &mut f.constraint,
        "equality" => &mut f.equality,
        "frictionloss" => &mut f.frictionloss,
        "limit" => &mut f.limit,
        "contact" => &mut f.contact,
        "spring" => &mut f.spring,
        "damper" => &mut f.damper,
        "gravity" => &mut f.gravity,
        "clampctrl" => &mut f.clampctrl,
        "warmstart" => &mut f.warmstart,
        "filterparent" => &mut f.filterparent,
        "actuation" => &mut f.actuation,
        "refsafe" => &mut f.refsafe,
        "sensor" => &mut f.sensor,
        "midphase" => &mut f.midphase,
        "eulerdamp" => &mut f.eulerdamp,
        "autoreset" => &mut f.autoreset,
        "nativeccd" => &mut f.nativeccd,
        "island" => &mut f.island,
        "multiccd" => &mut f.multiccd,
        "override" => &mut f.override_,
        "energy" => &mut f.energy,
        "fwdinv" => &mut f.fwdinv,
        "invdiscrete" => &mut f.invdiscrete,
        "sleep" => &mut f.sleep,
        "diagexact" => &mut f.diagexact,
        "ipc" => &mut f.ipc,
        "speculative" => &mut f.speculative,
        _ => return None,
    })
}

/// What becomes of an option where a model and one that it attaches differ, and neither has the default.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Choice {
    Least,
    Most,
    /// Neither.
    Conflict,
}

/// Gives a model's options those of a model that it attaches, as `compiler/conflict` says: `merge` takes what one of both says; `error`
/// refuses two that differ, and any other keeps the model's own.
pub(super) fn merge(own: &mut Options, other: &Options, policy: Option<&str>, element: &Element, report: &mut Report) {
    let (default, merges) = (Options::default(), policy == Some("merge"));
    let (mut conflicts, mut kept) = (Vec::new(), false);
    macro_rules! each {
        ($($choice:ident: $($field:ident)*;)*) => {
            $($(if own.$field != other.$field && other.$field != default.$field {
                let (of_own, written) = (own.$field.clone(), own.$field != default.$field);
                let chosen = match Choice::$choice {
                    Choice::Least if other.$field < of_own => other.$field.clone(),
                    Choice::Most if other.$field > of_own => other.$field.clone(),
                    _ => of_own.clone(),
                };
                match (written, merges) {
                    (false, true) => own.$field = other.$field.clone(),
                    (true, true) if Choice::$choice != Choice::Conflict => own.$field = chosen,
                    (true, _) if merges || policy == Some("error") => conflicts.push(stringify!($field)),
                    _ => kept = true,
                }
            })*)*
        };
    }
    each! {
        Least: timestep tolerance ls_tolerance noslip_tolerance ccd_tolerance sleep_tolerance;
        Most: iterations ls_iterations noslip_iterations ccd_iterations;
        Conflict: gravity wind magnetic density viscosity impratio o_margin o_solref o_solimp o_friction actuatorgroupdisable;
    }
    macro_rules! words {
        ($($field:ident)*) => {
            $(if own.$field != other.$field && other.$field != default.$field {
                match (own.$field != default.$field, merges) {
                    (false, true) => own.$field = other.$field,
                    (true, _) if merges || policy == Some("error") => conflicts.push(stringify!($field)),
                    _ => kept = true,
                }
            })*
        };
    }
    words!(integrator cone solver);
    let (mut others, mut defaults) = (other.flags.clone(), default.flags.clone());
    for name in FLAGS.split_ascii_whitespace() {
        let of_other = flag_mut(&mut others, name).map(|flag| *flag);
        if of_other != flag_mut(&mut defaults, name).map(|flag| *flag)
            && let (Some(flag), Some(on)) = (flag_mut(&mut own.flags, name), of_other)
            && *flag != on
        {
            if merges { *flag = on } else { kept = true }
        }
    }
    if !conflicts.is_empty() {
        let message = format!("options of the attached model differ from the model's own: {}", conflicts.join(", "));
        report.error(element, message, "make them alike");
    } else if kept {
        report.note_on(element, "options of the attached model give way to those of this one");
    }
}
