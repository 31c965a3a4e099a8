//! An element of a model under examination: what is refused of single attributes.

use crate::diagnostics::Diagnostics;
use crate::spec::{Source, Tri, is_limited};
use crate::suggest::did_you_mean;

/// One element under examination.
pub(super) struct Element<'a> {
    pub label: String,
    pub source: &'a Source,
    pub diagnostics: &'a mut Diagnostics,
}

impl<'a> Element<'a> {
    pub fn new(label: String, source: &'a Source, diagnostics: &'a mut Diagnostics) -> Self {
        Element { label, source, diagnostics }
    }

    pub fn refuse(&mut self, message: impl Into<String>, remedy: impl Into<String>) {
        self.diagnostics.push(self.source, self.label.clone(), message, remedy);
    }

    /// Refuses a reference to what is not there. Only the first few come with a suggestion: each costs a search.
    pub fn unknown<'b>(&mut self, message: String, name: &str, candidates: impl Iterator<Item = &'b str>) {
        const SUGGESTED: usize = 20;
        let few = self.diagnostics.0.len() < SUGGESTED;
        let hint = if few { did_you_mean(name, candidates) } else { String::new() };
        self.refuse(message, hint);
    }

    /// Refuses NaN and infinity; whether all numbers are finite.
    pub fn finite(&mut self, attribute: &str, values: &[f64]) -> bool {
        let ok = values.iter().all(|x| x.is_finite());
        if !ok {
            self.refuse(format!("{attribute} is not finite"), "give finite numbers");
        }
        ok
    }

    pub fn not_negative(&mut self, attribute: &str, values: &[f64]) {
        if self.finite(attribute, values)
            && let Some(x) = values.iter().find(|&&x| x < 0.0)
        {
            self.refuse(format!("{attribute} is negative: {x}"), "give 0 or more");
        }
    }

    pub fn quat(&mut self, attribute: &str, quat: &[f64]) {
        if self.finite(attribute, quat) {
            let norm = quat.iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm < 1e-15 || !norm.is_finite() {
                self.refuse(format!("{attribute} has no direction"), "give a quaternion of length one");
            }
        }
    }

    pub fn pose(&mut self, pos: &[f64; 3], quat: &[f64; 4]) {
        self.finite("pos", pos);
        self.quat("quat", quat);
    }

    pub fn solref(&mut self, attribute: &str, solref: &[f64; 2]) {
        if self.finite(attribute, solref) && (solref[0] > 0.0) != (solref[1] > 0.0) {
            self.refuse(
                format!("{attribute} mixes its two forms: {} {}", solref[0], solref[1]),
                "give two positive numbers (time constant, damping ratio) or none (-stiffness, -damping)",
            );
        }
    }

    pub fn condim(&mut self, condim: i32) {
        if ![1, 3, 4, 6].contains(&condim) {
            self.refuse(format!("condim is {condim}"), "use 1, 3, 4 or 6");
        }
    }

    /// Whether a range is in force; refuses what cannot be. `0 0` counts as not given.
    pub fn range(
        &mut self,
        attribute: &str,
        limited: &str,
        range: Option<[f64; 2]>,
        flag: Tri,
        autolimits: bool,
    ) -> bool {
        if range.is_some_and(|range| range.iter().any(|x| x.is_nan())) {
            self.refuse(format!("{attribute} is not a number"), "give numbers, or inf for no bound");
            return false;
        }
        if flag == Tri::Auto && range.is_some_and(|range| range != [0.0, 0.0]) && !autolimits {
            self.refuse(
                format!("{attribute} without {limited}, and autolimits is off"),
                format!("set {limited}, or autolimits=\"true\""),
            );
            return false;
        }
        is_limited(range, flag)
    }

    /// As [`range`](Self::range); a range in force must not be empty.
    pub fn bounds(&mut self, attribute: &str, limited: &str, range: Option<[f64; 2]>, flag: Tri, autolimits: bool) {
        let [lo, hi] = range.unwrap_or_default();
        if self.range(attribute, limited, range, flag, autolimits) && lo >= hi {
            self.refuse(format!("{attribute} is empty: {lo} {hi}"), format!("give {attribute} as lower upper"));
        }
    }
}
