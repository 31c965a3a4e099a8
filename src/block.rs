//! A block: as many worlds as the lane type is wide, with their state, status and forces from outside.

use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Model, Sizes};
use lanesim_kernels::state::{Applied, BlockStatus, State, Status, copy_lane};

use crate::worlds::Field;

/// Worlds side by side.
#[derive(Clone, Debug)]
pub(crate) struct Block<L> {
    pub state: State<L>,
    pub status: BlockStatus,
    /// Allocated when forces from outside are first set.
    pub applied: Option<Box<Applied<L>>>,
}

impl<L: LaneQuery> Block<L> {
    /// Worlds in the reference configuration, at rest. `worlds` lanes are worlds; the rest are padding that is never
    /// stepped.
    pub fn new(model: &Model<L::Real>, worlds: usize) -> Self {
        let mut state = State::new(&model.sizes);
        for (q, q0) in state.qpos.iter_mut().zip(&model.qpos0) {
            *q = L::splat(*q0);
        }
        let alive = ((1_u64 << worlds) - 1) as u32;
        Block { state, status: BlockStatus { alive, ..BlockStatus::default() }, applied: None }
    }

    /// The field's entries; allocates forces from outside.
    fn lanes(&mut self, field: Field, sizes: &Sizes) -> &mut [L] {
        let state = &mut self.state;
        match field {
            Field::Time => &mut state.time,
            Field::Qpos => &mut state.qpos,
            Field::Qvel => &mut state.qvel,
            Field::Act => &mut state.act,
            Field::Ctrl => &mut state.ctrl,
            Field::QaccWarmstart => &mut state.qacc_warmstart,
            Field::QfrcApplied | Field::XfrcApplied => {
                let applied = self.applied.get_or_insert_with(|| Box::new(Applied::new(sizes)));
                if field == Field::QfrcApplied {
                    &mut applied.qfrc_applied
                } else {
                    applied.xfrc_applied.as_flattened_mut()
                }
            }
        }
    }

    /// Sets a field of one lane.
    pub fn set(&mut self, field: Field, sizes: &Sizes, lane: usize, values: &[f64]) {
        for (entry, x) in self.lanes(field, sizes).iter_mut().zip(values) {
            entry.set(lane, L::Real::from_f64(*x));
        }
    }

    /// A field of one lane.
    pub fn read(&self, field: Field, model: &crate::Model, lane: usize) -> Vec<f64> {
        let state = &self.state;
        let numbers = |lanes: &[L]| lanes.iter().map(|x| x.get(lane).to_f64()).collect();
        let none = || vec![0.0; field.len(model)];
        match (field, &self.applied) {
            (Field::Time, _) => numbers(&state.time),
            (Field::Qpos, _) => numbers(&state.qpos),
            (Field::Qvel, _) => numbers(&state.qvel),
            (Field::Act, _) => numbers(&state.act),
            (Field::Ctrl, _) => numbers(&state.ctrl),
            (Field::QaccWarmstart, _) => numbers(&state.qacc_warmstart),
            (Field::QfrcApplied, Some(applied)) => numbers(&applied.qfrc_applied),
            (Field::XfrcApplied, Some(applied)) => numbers(applied.xfrc_applied.as_flattened()),
            (Field::QfrcApplied | Field::XfrcApplied, None) => none(),
        }
    }

    /// Resets one lane: positions as given, the rest as given or zero, warm start, forces and status cleared.
    pub fn reset(&mut self, sizes: &Sizes, lane: usize, key: &crate::model::Key) {
        self.set(Field::Time, sizes, lane, &[key.time]);
        self.set(Field::Qpos, sizes, lane, &key.qpos);
        self.set(Field::Qvel, sizes, lane, &key.qvel);
        self.set(Field::Act, sizes, lane, &key.act);
        self.set(Field::Ctrl, sizes, lane, &key.ctrl);
        self.set(Field::QaccWarmstart, sizes, lane, &vec![0.0; sizes.nv]);
        if self.applied.is_some() {
            self.set(Field::QfrcApplied, sizes, lane, &vec![0.0; sizes.nv]);
            self.set(Field::XfrcApplied, sizes, lane, &vec![0.0; 6 * sizes.nbody]);
        }
        self.status.set_lane(lane, Status::default());
    }

    /// Lets padding lanes replicate lane 0, so that they never hold anything unusual.
    pub fn pad(&mut self, worlds: usize) {
        for lane in worlds..L::WIDTH {
            copy_lane(&mut self.state, 0, lane);
        }
    }
}
