//! Which blocks the Hessian of one world has, and in which order its strips are eliminated.
//!
//! Strips of an island of contacts are eliminated by minimum degree (George and Liu, The evolution of the minimum degree
//! ordering algorithm, 1989): of those that are left, the one that is coupled with the fewest, of several the last. Trees that
//! no contact joins to another go first, from the last dof to the first: such a world has the bits that it would have beside
//! worlds in which nothing is joined.

use crate::constraint::ContactRow;
use crate::model::{Model, Sides, Span};

/// The pattern of one world.
#[derive(Clone, Debug, Default)]
pub struct Pattern {
    /// Pairs of the contacts that couple, in the order of their list; `None`: not found yet.
    known: Option<Vec<u32>>,
    /// Strips in the order of elimination.
    pub order: Vec<u32>,
    /// By strip, its place in that.
    place: Vec<u32>,
    /// By place, its blocks with those that are eliminated later.
    pub columns: Vec<Span>,
    /// Places of these, ascending.
    pub later: Vec<u32>,
    /// By strip, those that it is coupled with and that are left, as bits; `words` of each.
    bits: Vec<u64>,
    words: usize,
    left: Vec<u64>,
    scratch: Vec<u32>,
    /// Strips that are left, and with how many each is coupled.
    degrees: Vec<(u32, u32)>,
}

impl Pattern {
    /// Finds the pattern for the contacts of a world, unless it is known.
    pub fn find<T>(&mut self, model: &Model<T>, rows: &[ContactRow], lane: usize) {
        let couples = |row: &&ContactRow| row.sides != Sides::One && row.lanes >> lane & 1 != 0;
        let pairs = || rows.iter().filter(couples).map(|row| row.pair);
        if self.known.as_ref().is_some_and(|known| pairs().eq(known.iter().copied())) {
            return;
        }
        let mut known = self.known.take().unwrap_or_default();
        known.clear();
        known.extend(pairs());
        self.couple(model, &known);
        self.known = Some(known);
        self.eliminate();
        self.sort();
    }

    /// The block of two strips: its number, `None` if they are one, and whether its rows are those of the first.
    pub fn block(&self, [i, j]: [u32; 2]) -> (u32, Option<usize>, bool) {
        let [a, b] = [i, j].map(|strip| self.place[strip as usize]);
        let (first, second) = (a.min(b), a.max(b));
        let column = self.columns[first as usize].range();
        let found = self.later[column.clone()].binary_search(&second).ok().map(|n| column.start + n);
        (first, found, a <= b)
    }

    /// Sets the bits of what trees and contacts couple, and lets the strips of trees that no contact joins be eliminated first.
    fn couple<T>(&mut self, model: &Model<T>, pairs: &[u32]) {
        let strips = &model.own;
        let count = strips.spans.len();
        self.words = count.div_ceil(64);
        self.bits.clear();
        self.bits.resize(count * self.words, 0);
        self.left.clear();
        self.left.resize(self.words, 0);
        for (i, strip) in strips.spans.iter().enumerate() {
            for dof in model.tree_pattern.row(strip.start as usize).iter().flat_map(|run| run.range()) {
                self.set([i, strips.of(dof as u32) as usize]);
            }
        }
        for pair in pairs.iter().map(|pair| &model.pairs[*pair as usize]) {
            let dofs = &model.pair_dofs[pair.dofs.range()];
            for (r, (i, _)) in strips.runs(dofs).enumerate() {
                strips.runs(dofs).take(r).for_each(|(j, _)| self.set([i as usize, j as usize]));
                if pair.cross {
                    self.left[i as usize / 64] |= 1 << (i % 64);
                }
            }
        }
        self.spread();
    }

    fn set(&mut self, [i, j]: [usize; 2]) {
        self.bits[i * self.words + j / 64] |= 1 << (j % 64);
        self.bits[j * self.words + i / 64] |= 1 << (i % 64);
    }

    /// Marks all that hangs together with what is marked.
    fn spread(&mut self) {
        let Pattern { left, bits, words, scratch, .. } = self;
        scratch.clear();
        scratch.extend(members(left));
        while let Some(i) = scratch.pop() {
            for (w, word) in bits[i as usize * *words..][..*words].iter().enumerate() {
                let new = word & !left[w];
                left[w] |= new;
                scratch.extend(members(&[new]).map(|j| 64 * w as u32 + j));
            }
        }
    }

    /// Finds the order, and what elimination couples.
    fn eliminate(&mut self) {
        let count = self.bits.len() / self.words.max(1);
        self.order.clear();
        self.columns.clear();
        self.later.clear();
        for i in (0..count).rev() {
            if self.left[i / 64] >> (i % 64) & 1 == 0 {
                self.take(i);
            }
        }
        let degree = |bits: &[u64]| bits.iter().map(|word| word.count_ones()).sum::<u32>();
        let mut degrees = std::mem::take(&mut self.degrees);
        degrees.extend(members(&self.left).map(|i| (i, degree(self.row(i as usize)))));
        while !degrees.is_empty() {
            // Of equals the last: strips ascend.
            let best = (0..degrees.len()).fold(0, |best, n| if degrees[n].1 <= degrees[best].1 { n } else { best });
            let (i, _) = degrees.remove(best);
            self.take(i as usize);
            for (j, own) in &mut degrees {
                if self.row(i as usize)[*j as usize / 64] >> (*j % 64) & 1 != 0 {
                    *own = degree(self.row(*j as usize));
                }
            }
        }
        self.degrees = degrees;
    }

    fn row(&self, i: usize) -> &[u64] {
        &self.bits[i * self.words..][..self.words]
    }

    /// Eliminates a strip: those that it is coupled with are coupled with each other.
    fn take(&mut self, i: usize) {
        let Pattern { bits, words, scratch, order, columns, later, .. } = self;
        scratch.clear();
        scratch.extend(members(&bits[i * *words..][..*words]));
        let start = later.len() as u32;
        later.extend_from_slice(scratch);
        columns.push(Span { start, len: scratch.len() as u32 });
        order.push(i as u32);
        for j in scratch.iter().map(|j| *j as usize) {
            for w in 0..*words {
                let row = bits[i * *words + w];
                bits[j * *words + w] |= row;
            }
            bits[j * *words + j / 64] &= !(1 << (j % 64));
            bits[j * *words + i / 64] &= !(1 << (i % 64));
        }
    }

    /// Strips become places.
    fn sort(&mut self) {
        let Pattern { order, place, columns, later, .. } = self;
        place.clear();
        place.resize(order.len(), 0);
        for (p, strip) in (0..).zip(&*order) {
            place[*strip as usize] = p;
        }
        for column in columns {
            let column = &mut later[column.range()];
            column.iter_mut().for_each(|strip| *strip = place[*strip as usize]);
            column.sort_unstable();
        }
    }
}

/// The numbers of bits that are set.
fn members(words: &[u64]) -> impl Iterator<Item = u32> + '_ {
    (0..).step_by(64).zip(words).flat_map(|(first, word)| {
        let mut left = *word;
        std::iter::from_fn(move || {
            let at = (left != 0).then(|| first + left.trailing_zeros());
            left &= left.wrapping_sub(1);
            at
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Strips that are coupled in an island.
    fn eliminated(count: usize, coupled: &[[usize; 2]]) -> Pattern {
        let words = count.div_ceil(64);
        let mut pattern = Pattern { words, bits: vec![0; count * words], left: vec![0; words], ..Pattern::default() };
        for pair in coupled {
            pattern.set(*pair);
            pair.iter().for_each(|i| pattern.left[i / 64] |= 1 << (i % 64));
        }
        pattern.eliminate();
        pattern.sort();
        pattern
    }

    #[test]
    fn the_middle_of_a_star_goes_last() {
        // From the last to the first it would fill in everything.
        let star: Vec<_> = (1..100).map(|i| [0, i]).chain([[99, 100]]).collect();
        let pattern = eliminated(101, &star);
        assert_eq!(pattern.later.len(), star.len());
        assert_eq!(pattern.order.last(), Some(&0));
        for (place, column) in pattern.columns.iter().enumerate() {
            assert!(pattern.later[column.range()].iter().all(|later| *later as usize > place));
        }
    }

    #[test]
    fn a_ring_fills_in_a_row_of_chords() {
        let count = 70;
        let ring: Vec<_> = (0..count).map(|i| [i, (i + 1) % count]).collect();
        let pattern = eliminated(count, &ring);
        assert_eq!(pattern.later.len(), count + (count - 3));
        let (first, block, _) = pattern.block([3, 4]);
        assert_eq!(pattern.block([4, 3]).1, block);
        assert!(block.is_some_and(|block| pattern.columns[first as usize].range().contains(&block)));
        assert_eq!(pattern.block([3, 3]).1, None);
    }

    #[test]
    fn what_no_contact_joins_goes_first_and_last_to_first() {
        let pattern = eliminated(6, &[[1, 4]]);
        assert_eq!(pattern.order, [5, 3, 2, 0, 4, 1]);
    }
}
