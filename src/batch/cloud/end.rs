//! What follows from a block's states, and differences of it.

use lanesim_kernels::integration::difference;
use lanesim_kernels::lane::LaneQuery;
use lanesim_kernels::model::Model as KernelModel;

/// What follows from a block's states.
#[derive(Debug)]
pub(super) struct End<L> {
    /// Positions, of the next state.
    qpos: Vec<L>,
    /// Everything else.
    values: Vec<L>,
}

impl<L> Default for End<L> {
    fn default() -> Self {
        End { qpos: Vec::new(), values: Vec::new() }
    }
}

impl<L: LaneQuery> End<L> {
    /// All numbers: positions, then everything else.
    pub fn numbers(&self) -> [&[L]; 2] {
        [&self.qpos, &self.values]
    }

    /// Keeps positions, if there are any, and everything else.
    pub fn keep(&mut self, qpos: &[L], values: [&[L]; 3]) {
        self.qpos.clear();
        self.qpos.extend_from_slice(qpos);
        self.values.clear();
        values.into_iter().for_each(|values| self.values.extend_from_slice(values));
    }
}

/// Derivatives from what follows on either side, in the lanes that were perturbed to it: differences by their distance. Where a side is
/// missing, the nominal states take its place.
pub(super) fn differentiate<L: LaneQuery>(
    model: &KernelModel<L::Real>,
    [nominal, to, from]: [&mut End<L>; 3],
    [plus, minus]: [u32; 2],
    eps: f64,
    slopes: &mut Vec<L>,
) {
    let [forward, backward] = [plus, minus].map(L::mask_of);
    let (eps, both) = (L::of(eps), L::mask_of(plus & minus));
    let distance = L::select(both, eps + eps, eps);
    // A side to which no lane went may be of another kind of column, or of nothing yet.
    for (lanes, end) in [(plus, &mut *to), (minus, &mut *from)] {
        if lanes == 0 {
            end.keep(&nominal.qpos, [&nominal.values, &[], &[]]);
        }
    }
    slopes.clear();
    if !nominal.qpos.is_empty() {
        for (mask, end) in [(forward, &mut *to), (backward, &mut *from)] {
            end.qpos.iter_mut().zip(&nominal.qpos).for_each(|(own, nominal)| *own = L::select(mask, *own, *nominal));
        }
        slopes.resize(model.sizes.nv, L::zero());
        difference(model, &from.qpos, &to.qpos, slopes);
    }
    slopes.extend(
        nominal
            .values
            .iter()
            .zip(to.values.iter().zip(&from.values))
            .map(|(nominal, (to, from))| L::select(forward, *to, *nominal) - L::select(backward, *from, *nominal)),
    );
    slopes.iter_mut().for_each(|slope| *slope = *slope / distance);
}
