//! Inverse dynamics of all worlds' present states.

use std::sync::atomic::AtomicBool;

use lanesim_kernels::diagnosis;
use lanesim_kernels::inverse::{self, Inverse};
use lanesim_kernels::lane::{LaneQuery, Real};

use super::{Batch, Crew, Job, Worker};
use crate::block::Block;
use crate::options::Tables;
use crate::plan::Plan;
use crate::rows::{Rows, Strided};

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    /// Writes every world's force for its row of accelerations; NaN where the world is frozen or its state cannot be stepped.
    pub(super) fn invert(&mut self, qacc: &Strided<'_>, rows: Rows<'_>, cancel: Option<&AtomicBool>) {
        let plan = Plan::inverse();
        let pace = self.crew.paces.read(&plan).get();
        let spent = self.each(1, pace, vec![rows], cancel, |crew, Job { first_world, group, rows, .. }, worker| {
            for block in group.blocks() {
                let rows = &mut rows[0];
                crew.guard(block, worker, |block, worker| {
                    crew.invert_block(&plan, (qacc, *first_world), rows, block, worker);
                });
            }
        });
        self.crew.paces.read(&plan).note(spent);
    }
}

impl<L: LaneQuery<Real: Tables>> Crew<L> {
    fn invert_block(
        &self,
        plan: &Plan,
        (qacc, first_world): (&Strided<'_>, usize),
        rows: &mut Rows<'_>,
        block: &mut Block<L>,
        worker: &mut Worker<L>,
    ) {
        let Worker { workspace, code, inverse, .. } = worker;
        let nv = self.tables.sizes.nv;
        let inverse = inverse.get_or_insert_with(|| Inverse::new(&self.tables.sizes));
        inverse.given.fill(L::of(0.0));
        for (lane, id) in block.ids.iter().enumerate() {
            qacc.row(first_world + id, nv, |i, x| inverse.given[i].set(lane, L::Real::from_f64(x)));
        }
        let before = block.status;
        let bad = diagnosis::inspect(&self.tables, &block.state, block.applied.as_deref(), &mut block.status);
        // Nobody's step: what cannot be stepped is left out, not frozen.
        let valid = bad.iter().fold(before.alive, |valid, (_, lanes)| valid & !lanes);
        block.status.alive = valid;
        let mut run = self.run(plan, (block.applied.as_deref(), block.varied.as_deref()), code.as_mut());
        let over_step = self.tables.options.flags.invdiscrete;
        inverse::inverse(&self.tables, &mut block.state, over_step, &mut run, &mut block.status, (workspace, inverse));
        block.status.alive = before.alive;
        if block.status != before {
            self.note_step(block, before, workspace);
        }
        let mut force = vec![0.0; nv];
        for (lane, id) in block.ids.iter().enumerate() {
            let known = valid >> lane & 1 != 0;
            let number = |x: &L| if known { x.get(lane).to_f64() + 0.0 } else { f64::NAN };
            force.iter_mut().zip(&inverse.qfrc_inverse).for_each(|(f, x)| *f = number(x));
            rows.write(id * nv, &force);
        }
    }
}
