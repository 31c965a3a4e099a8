//! Histories: rings of samples and their times, of what actuators were told and of what sensors measured, from which late controls and late
//! measures are read. Where in its ring a world reads follows from its own times, so worlds go one by one, in numbers of double precision;
//! models without histories have nothing of it. Layout and rules are MuJoCo's (its manual, "Delays").

use crate::lane::{LaneQuery, Real};
use crate::math::low::remainder;
use crate::model::{Interpolation, Model, Ring};
use crate::sensor::Sensors;
use crate::state::State;

/// By how much times may differ that are the same. In single precision, times have a few digits less than in double precision, by which
/// MuJoCo judges: there a millionth of a step counts for nothing.
fn blur<L: LaneQuery>(model: &Model<L::Real>) -> f64 {
    if L::Real::EPSILON < 1e-10 { 1e-15 } else { 1e-6 * model.options.timestep }
}

fn number<L: LaneQuery>([numbers, low]: [&[L]; 2], i: usize, lane: usize) -> f64 {
    let low = low.get(i).map_or(0.0, |low| low.get(lane).to_f64());
    numbers[i].get(lane).to_f64() + low
}

/// Time of each world, and its low word.
pub fn clock<L: LaneQuery>(state: &State<L>) -> [L; 2] {
    [state.time[0], state.low.first().copied().unwrap_or(L::zero())]
}

/// Time of a world.
fn time<L: LaneQuery>([time, low]: [L; 2], lane: usize) -> f64 {
    time.get(lane).to_f64() + low.get(lane).to_f64()
}

/// A world's samples of one ring, oldest first.
struct Samples<'a, L> {
    ring: &'a Ring,
    /// The ring's numbers, and their low words.
    numbers: [&'a [L]; 2],
    lane: usize,
    /// By how much times may differ that are the same.
    blur: f64,
}

impl<'a, L: LaneQuery> Samples<'a, L> {
    fn new(ring: &'a Ring, past: [&'a [L]; 2], lane: usize, blur: f64) -> Self {
        let numbers = past.map(|all| all.get(ring.span.range()).unwrap_or(&[]));
        Samples { ring, numbers, lane, blur }
    }

    fn get(&self, i: usize) -> f64 {
        number(self.numbers, i, self.lane)
    }

    fn count(&self) -> usize {
        self.ring.samples as usize
    }

    /// Where the oldest sample is in the ring. What comes from outside may be any number.
    fn oldest(&self) -> usize {
        ((self.get(1) as usize).min(self.count() - 1) + 1) % self.count()
    }

    /// Where a sample is in the ring.
    fn place(&self, sample: usize) -> usize {
        (self.oldest() + sample) % self.count()
    }

    fn time(&self, sample: usize) -> f64 {
        self.get(2 + self.place(sample))
    }

    fn value(&self, sample: usize, component: usize) -> f64 {
        self.get(self.ring.value(self.place(sample), component))
    }

    /// How many samples are not later than a time.
    fn until(&self, time: f64) -> usize {
        let (mut lo, mut hi) = (0, self.count());
        while lo < hi {
            let middle = (lo + hi) / 2;
            if self.time(middle) <= time { lo = middle + 1 } else { hi = middle }
        }
        lo
    }

    /// The sample of a time, if there is one: `until` samples are not later.
    fn at(&self, time: f64, until: usize) -> Option<usize> {
        let same = |sample: &usize| (self.time(*sample) - time).abs() < self.blur;
        let (before, after) = (until.checked_sub(1), (until < self.count()).then_some(until));
        after.filter(same).or(before.filter(same))
    }

    /// What the ring tells of a time: beyond its ends, what is there.
    fn read(&self, time: f64, mut put: impl FnMut(usize, f64)) {
        let until = self.until(time);
        let whole = match self.at(time, until) {
            Some(sample) => Some(sample),
            None if until == 0 => Some(0),
            None if until == self.count() || self.ring.interpolation == Interpolation::Hold => Some(until - 1),
            None => None,
        };
        for component in 0..self.ring.dim as usize {
            let value = |sample: usize| self.value(sample, component);
            put(component, whole.map_or_else(|| self.between(until, time, &value), value));
        }
    }

    /// Between sample `after` and the one before: a line, or the cubic with the slopes of the samples around, which are 0 at the ends.
    fn between(&self, after: usize, time: f64, value: &dyn Fn(usize) -> f64) -> f64 {
        let before = after - 1;
        let (start, span) = (self.time(before), self.time(after) - self.time(before));
        let (s, [from, to]) = ((time - start) / span, [value(before), value(after)]);
        if self.ring.interpolation == Interpolation::Linear {
            return from + s * (to - from);
        }
        let slope = |sample: usize| {
            let inner = sample > 0 && sample + 1 < self.count();
            let rate = |a: usize, b: usize| (value(b) - value(a)) / (self.time(b) - self.time(a));
            if inner { span * rate(sample - 1, sample + 1) } else { 0.0 }
        };
        let rest = 1.0 - s;
        let ends = (1.0 + 2.0 * s) * rest * rest * from + s * s * (3.0 - 2.0 * s) * to;
        ends + s * rest * (rest * slope(before) - s * slope(after))
    }
}

/// A world's ring, to be written.
struct Writer<'a, L> {
    ring: &'a Ring,
    /// All histories, and their low words.
    past: [&'a mut [L]; 2],
    lane: usize,
    blur: f64,
}

impl<L: LaneQuery> Writer<'_, L> {
    fn samples(&self) -> Samples<'_, L> {
        let [numbers, low] = &self.past;
        Samples::new(self.ring, [numbers, low], self.lane, self.blur)
    }

    fn set(&mut self, i: usize, x: f64) {
        let ([numbers, low], i) = (&mut self.past, self.ring.span.start as usize + i);
        numbers[i].set(self.lane, L::Real::from_f64(x));
        if let Some(low) = low.get_mut(i) {
            low.set(self.lane, L::Real::from_f64(remainder::<L::Real>(x)));
        }
    }

    /// Takes a sample in: in place of that of its own time, or of the oldest, where its time belongs.
    fn insert(&mut self, time: f64, value: impl Fn(usize) -> f64) {
        let (samples, count) = (self.samples(), self.ring.samples as usize);
        let (until, oldest) = (samples.until(time), samples.oldest());
        let (same, place) = (samples.at(time, until), |sample: usize| (oldest + sample) % count);
        let to = match same {
            Some(sample) => place(sample),
            None if until == count => {
                self.set(1, oldest as f64);
                oldest
            }
            None => {
                (1..until).for_each(|sample| self.copy(place(sample), place(sample - 1)));
                place(until.saturating_sub(1))
            }
        };
        self.set(2 + to, time);
        (0..self.ring.dim as usize).for_each(|i| self.set(self.ring.value(to, i), value(i)));
    }

    /// Copies a sample from place to place.
    fn copy(&mut self, from: usize, to: usize) {
        let time = self.samples().get(2 + from);
        self.set(2 + to, time);
        for i in 0..self.ring.dim as usize {
            let x = self.samples().get(self.ring.value(from, i));
            self.set(self.ring.value(to, i), x);
        }
    }
}

/// Finds the controls that act: those of actuators that are told late are what they were told then.
pub fn recall<L: LaneQuery>(model: &Model<L::Real>, state: &State<L>, told: &mut [L]) {
    if told.is_empty() {
        return;
    }
    told.copy_from_slice(&state.ctrl);
    let now = clock(state);
    for ring in model.ctrl_rings.iter().filter(|ring| ring.delay > 0.0) {
        let told = &mut told[ring.first as usize..];
        for lane in 0..L::WIDTH {
            let samples = Samples::new(ring, state.past(), lane, blur::<L>(model));
            samples.read(time(now, lane) - ring.delay, |i, x| told[i].set(lane, L::Real::from_f64(x)));
        }
    }
}

/// Whether a sensor measures in a world: if it does so periodically, when its period is over.
fn due<L: LaneQuery>(model: &Model<L::Real>, ring: &Ring, past: [&[L]; 2], now: [L; 2], lane: usize) -> bool {
    // In double precision as MuJoCo has it, without any doubt.
    let doubt = if L::Real::EPSILON < 1e-10 { 0.0 } else { blur::<L>(model) };
    ring.period == 0.0 || number(past, ring.span.start as usize, lane) + ring.period <= time(now, lane) + doubt
}

/// Keeps what sensors have measured, and has those that tell it late, or measure it periodically, tell what they did then.
pub fn tell<L: LaneQuery>(model: &Model<L::Real>, state: &State<L>, sensors: &mut Sensors<L>) {
    let Sensors { data, measured, .. } = sensors;
    if measured.is_empty() {
        return;
    }
    measured.copy_from_slice(data);
    let (past, now) = (state.past(), clock(state));
    for ring in &model.sensor_rings {
        let told = &mut data[ring.first as usize..];
        for lane in 0..L::WIDTH {
            if ring.delay == 0.0 && due(model, ring, past, now, lane) {
                continue;
            }
            let samples = Samples::new(ring, past, lane, blur::<L>(model));
            samples.read(time(now, lane) - ring.delay, |i, x| told[i].set(lane, L::Real::from_f64(x)));
        }
    }
}

/// Takes controls, and what sensors have measured, into the histories of `lanes`, whose worlds were advanced from the time `now`.
pub fn record<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    (now, lanes): ([L; 2], u32),
    sensors: &Sensors<L>,
) {
    if model.ctrl_rings.is_empty() && model.sensor_rings.is_empty() {
        return;
    }
    let first = 1 + state.qpos.len();
    let State { history, low, ctrl, .. } = state;
    let (low, blur) = (low.get_mut(first..).unwrap_or(&mut []), blur::<L>(model));
    // Where sensors are switched off, zeros.
    let measured = |i: usize, lane: usize| sensors.measured.get(i).map_or(0.0, |x| x.get(lane).to_f64());
    for lane in (0..L::WIDTH).filter(|lane| lanes >> lane & 1 != 0) {
        let moment = time(now, lane);
        for ring in &model.ctrl_rings {
            let mut writer = Writer { ring, past: [&mut *history, &mut *low], lane, blur };
            writer.insert(moment, |i| ctrl[ring.first as usize + i].get(lane).to_f64());
        }
        for ring in &model.sensor_rings {
            if due(model, ring, [&*history, &*low], now, lane) {
                let mut writer = Writer { ring, past: [&mut *history, &mut *low], lane, blur };
                if ring.period > 0.0 {
                    let last = writer.samples().get(0);
                    writer.set(0, last + ring.period);
                }
                writer.insert(moment, |i| measured(ring.first as usize + i, lane));
            }
        }
    }
}
