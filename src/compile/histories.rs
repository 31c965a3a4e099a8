//! Histories: what is refused of them, and the rings that hold them.

use lanesim_kernels::model::{Ring, Sensor, Sizes, Span};

use super::element::Element;
use crate::diagnostics::Diagnostics;
use crate::spec::{History, Spec};

/// Most samples of a history.
const MOST_SAMPLES: usize = 1 << 24;
/// Most numbers of all.
const MOST_NUMBERS: usize = 10_000_000;

/// Refuses a history that cannot be kept, and a delay without one.
pub(super) fn check(history: &History, element: &mut Element) {
    let History { nsample, delay, interval: [period, phase], .. } = *history;
    for (name, x) in [("delay", delay), ("interval", period), ("interval", phase)] {
        element.finite(name, &[x]);
    }
    element.not_negative("delay", &[delay]);
    if delay > 0.0 && nsample == 0 {
        element.refuse(format!("delay {delay}, but it keeps no samples"), "give nsample, at least delay over timestep");
    }
    if nsample > MOST_SAMPLES {
        element.refuse(format!("nsample is {nsample}"), format!("give at most {MOST_SAMPLES}"));
    }
    if period < 0.0 {
        element.refuse(format!("its interval has the period {period}"), "give 0 or more");
    } else if phase > 0.0 || (phase != 0.0 && phase <= -period) {
        let message = format!("its interval has the phase {phase}");
        element.refuse(message, "give 0, or a negative number above minus the period");
    }
}

/// The histories of a model.
#[derive(Default)]
pub(super) struct Histories {
    pub controls: Vec<Ring>,
    pub sensors: Vec<Ring>,
    /// What they hold at first: zeros, of the last steps or periods before time 0.
    pub numbers: Vec<f64>,
}

impl Histories {
    /// Those of a spec that was checked; its actuators have these `controls`.
    pub fn new(spec: &Spec, controls: &[Span], sensors: &[Sensor<f64>], diagnostics: &mut Diagnostics) -> Histories {
        let mut out = Histories::default();
        let controls = || spec.actuators.iter().map(|actuator| &actuator.history).zip(controls.iter().copied());
        let sensors = || spec.sensors.iter().map(|sensor| &sensor.history).zip(sensors.iter().map(|table| table.data));
        let kept = controls().chain(sensors()).filter(|(history, _)| history.nsample > 0);
        let numbers =
            kept.map(|(history, of)| Ring::len(history.nsample, of.len as usize)).fold(0, usize::saturating_add);
        if numbers > MOST_NUMBERS {
            let message = format!("histories have {numbers} numbers");
            diagnostics.push(&Default::default(), "nsample", message, format!("use at most {MOST_NUMBERS}"));
            return out;
        }
        let timestep = spec.option.timestep;
        for (history, of) in controls() {
            out.controls.extend(ring(history, (of, 0.0), timestep, &mut out.numbers));
        }
        for (history, of) in sensors() {
            let [period, phase] = history.interval;
            // Unless it is given, the last measure was one period before time 0.
            let last = if period == 0.0 { -timestep } else { phase };
            let last = if last == 0.0 { -period } else { last };
            out.sensors.extend(ring(history, (of, last), timestep, &mut out.numbers));
        }
        out
    }

    /// Sizes with theirs.
    pub fn counted(&self, sizes: Sizes) -> Sizes {
        let late = self.controls.iter().any(|ring| ring.delay > 0.0);
        Sizes {
            nhistory: self.numbers.len(),
            ndelayed: if late { sizes.nu } else { 0 },
            nmeasured: if self.sensors.is_empty() { 0 } else { sizes.nsensordata },
            ..sizes
        }
    }
}

/// The ring of a history, if anything is kept, of controls or numbers of sensors; `own` is its own number at first. Adds what it holds then.
fn ring(history: &History, (of, own): (Span, f64), timestep: f64, numbers: &mut Vec<f64>) -> Option<Ring> {
    let History { nsample: count, interp, delay, interval: [period, _] } = *history;
    let span = Span { start: numbers.len() as u32, len: Ring::len(count, of.len as usize) as u32 };
    if count == 0 {
        return None;
    }
    numbers.extend([own, (count - 1) as f64]);
    numbers.extend((0..count).map(|sample| {
        let before = (count - 1 - sample) as f64;
        match period {
            0.0 => -timestep * (before + 1.0),
            // When it could have been measured: at the next step. A negative zero becomes a positive one.
            _ => ((own - before * period) / timestep).ceil() * timestep + 0.0,
        }
    }));
    numbers.resize(span.range().end, 0.0);
    Some(Ring { span, samples: count as u32, dim: of.len, first: of.start, interpolation: interp, delay, period })
}
