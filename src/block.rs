//! A block: as many worlds as the lane type is wide, with their state, status and forces from outside.

use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Model, Sizes};
use lanesim_kernels::state::{Applied, BlockStatus, State, Status, copy_lane};

use crate::rows::Strided;
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

    /// The field's entries; none where no forces from outside were ever set.
    pub fn entries(&self, field: Field) -> Option<&[L]> {
        let (state, applied) = (&self.state, self.applied.as_deref());
        match field {
            Field::Time => Some(&state.time),
            Field::Qpos => Some(&state.qpos),
            Field::Qvel => Some(&state.qvel),
            Field::Act => Some(&state.act),
            Field::Ctrl => Some(&state.ctrl),
            Field::QaccWarmstart => Some(&state.qacc_warmstart),
            Field::QfrcApplied => applied.map(|forces| forces.qfrc_applied.as_slice()),
            Field::XfrcApplied => applied.map(|forces| forces.xfrc_applied.as_flattened()),
        }
    }

    /// A field of one lane.
    pub fn read(&self, field: Field, model: &crate::Model, lane: usize) -> Vec<f64> {
        match self.entries(field) {
            Some(entries) => entries.iter().map(|x| x.get(lane).to_f64()).collect(),
            None => vec![0.0; field.len(model)],
        }
    }

    /// Sets a field of one lane from a world's row.
    pub fn set_row(&mut self, field: Field, sizes: &Sizes, lane: usize, rows: &Strided<'_>, world: usize) {
        let entries = self.lanes(field, sizes);
        rows.row(world, entries.len(), |i, x| entries[i].set(lane, L::Real::from_f64(x)));
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
