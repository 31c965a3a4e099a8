//! Which rows act, so that it can be said where derivatives go across the beginning or the end of a contact.

use lanesim_kernels::constraint::DofRowKind;
use lanesim_kernels::lane::LaneQuery;
use lanesim_kernels::model::Model as KernelModel;
use lanesim_kernels::workspace::Workspace;

use super::LANES;

/// Limits and contacts that push in some lane.
#[derive(Debug, Default)]
pub(super) struct Acting(Vec<(u32, u32)>);

impl Acting {
    /// Those of the states that were last solved: the number of each, limits after contacts, with the lanes in which it pushes.
    pub fn observe<L: LaneQuery>(&mut self, model: &KernelModel<L::Real>, ws: &Workspace<L>) {
        let Workspace { constraint, collision, solver, .. } = ws;
        self.0.clear();
        if constraint.is_empty() {
            return;
        }
        let pushes = |force: &L| L::bits(force.gt(L::zero()));
        let contacts = constraint.contact_rows.iter().map(|row| {
            let slot = &collision.slots[row.contact as usize];
            let number = model.pairs[slot.pair as usize].slots.start + slot.point;
            (number, pushes(&solver.force.component[row.component as usize]) & row.lanes)
        });
        self.0.extend(contacts.filter(|(_, lanes)| *lanes != 0));
        let limits = constraint.dof_rows.iter().zip(&solver.force.dof).zip(model.sizes.nslot as u32..);
        let limits = limits.filter(|((row, _), _)| row.kind != DofRowKind::Friction && constraint.joint_lanes != 0);
        self.0
            .extend(limits.map(|((_, force), number)| (number, pushes(&force.abs()))).filter(|(_, lanes)| *lanes != 0));
        self.0.sort_unstable();
    }

    /// Adds to each lane's count how many push here and not there, or there and not here.
    pub fn compare(&self, other: &Acting, lanes: u32, counts: &mut [u32; LANES]) {
        let (mut here, mut there) = (self.0.iter().peekable(), other.0.iter().peekable());
        loop {
            let next = [here.peek(), there.peek()].into_iter().flatten().map(|(number, _)| *number).min();
            let Some(next) = next else { return };
            let take = |list: &mut std::iter::Peekable<std::slice::Iter<'_, (u32, u32)>>| {
                list.next_if(|(number, _)| *number == next).map_or(0, |(_, lanes)| *lanes)
            };
            let mut differ = (take(&mut here) ^ take(&mut there)) & lanes;
            while differ != 0 {
                counts[differ.trailing_zeros() as usize] += 1;
                differ &= differ - 1;
            }
        }
    }
}
