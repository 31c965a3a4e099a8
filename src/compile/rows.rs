//! Storage and sparsity of the inertia matrix and of the solver's Hessian.

use lanesim_kernels::model::{Dof, NONE, Pair, PairDof, Pattern, Rows, Span};

/// Most entries of the storage.
const MAX_ENTRIES: usize = 1 << 26;

/// The skyline: every row starts at the lowest dof that can be coupled to it, by the tree, by contacts and the `listed` dofs of equality
/// constraints and tendons between branches, or by fill when dofs are eliminated from the last to the first. With it the number of entries; `Err` with the number
/// of dofs if there are too many.
pub(crate) fn skyline(
    dofs: &[Dof<f64>],
    (pairs, pair_dofs): (&[Pair<f64>], &[PairDof]),
    listed: &[Vec<u32>],
) -> Result<(Rows, usize), usize> {
    let n = dofs.len();
    let mut first: Vec<u32> = Vec::with_capacity(n);
    for (i, dof) in dofs.iter().enumerate() {
        first.push(if dof.parent == NONE { i as u32 } else { first[dof.parent as usize] });
    }
    // Lists ascend, so the first is the lowest.
    let mut couple = |lowest: u32, dof: u32| first[dof as usize] = first[dof as usize].min(lowest);
    for pair in pairs.iter().filter(|p| p.cross) {
        let coupled = &pair_dofs[pair.dofs.range()];
        coupled.iter().for_each(|entry| couple(coupled[0].dof, entry.dof));
    }
    for coupled in listed {
        coupled.iter().for_each(|dof| couple(coupled[0], *dof));
    }
    let entries = |first: &[u32]| -> usize { first.iter().enumerate().map(|(i, &f)| i + 1 - f as usize).sum() };
    if entries(&first) > MAX_ENTRIES {
        return Err(n);
    }
    for k in (0..n).rev() {
        let lowest = first[k];
        for row in &mut first[lowest as usize..k] {
            *row = (*row).min(lowest);
        }
    }
    let total = entries(&first);
    if total > MAX_ENTRIES {
        return Err(n);
    }
    let mut start = Vec::with_capacity(n);
    let mut offset = 0;
    for (i, &f) in first.iter().enumerate() {
        start.push(offset);
        offset += i as u32 + 1 - f;
    }
    Ok((Rows { start, first }, total))
}

/// Whether some of these dofs, which ascend, lie on different branches.
pub(super) fn joins(dofs: &[Dof<f64>], moved: &[u32]) -> bool {
    let above = |low: u32, high: u32| {
        let mut at = high;
        while at != NONE && at > low {
            at = dofs[at as usize].parent;
        }
        at == low
    };
    // Ascending, so that of a chain each is above the next.
    moved.windows(2).any(|two| !above(two[0], two[1]))
}

/// The ancestors of every dof, itself left out, as runs.
pub(crate) fn tree_pattern(dofs: &[Dof<f64>]) -> Pattern {
    let (mut runs, mut rows): (Vec<Span>, Vec<Span>) = (Vec::new(), Vec::with_capacity(dofs.len()));
    for dof in dofs {
        let start = runs.len();
        if dof.parent != NONE {
            let inherited = rows[dof.parent as usize].range();
            runs.extend_from_within(inherited);
            match runs[start..].last_mut() {
                Some(run) if run.start + run.len == dof.parent => run.len += 1,
                _ => runs.push(Span { start: dof.parent, len: 1 }),
            }
        }
        rows.push(Span { start: start as u32, len: (runs.len() - start) as u32 });
    }
    Pattern::new(runs, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lanesim_kernels::model::DofKind;

    fn dofs(parents: &[u32]) -> Vec<Dof<f64>> {
        let dof = |&parent: &u32| Dof {
            kind: DofKind::Hinge,
            link: 0,
            joint: 0,
            parent,
            simple: false,
            damped: false,
            free_base: NONE,
            damping_linear: true,
            armature: 0.0,
            damping: [0.0; 3],
            invweight: 0.0,
        };
        parents.iter().map(dof).collect()
    }

    /// 0 - 1 - 2 and 0 - 3 - 4, then a tree of its own: 5 - 6.
    const FOREST: [u32; 7] = [NONE, 0, 1, 0, 3, NONE, 5];

    #[test]
    fn runs_are_maximal() {
        let pattern = tree_pattern(&dofs(&FOREST));
        let run = |start, len| Span { start, len };
        assert_eq!(pattern.row(0), []);
        assert_eq!(pattern.row(2), [run(0, 2)]);
        assert_eq!(pattern.row(3), [run(0, 1)]);
        assert_eq!(pattern.row(4), [run(0, 1), run(3, 1)]);
        assert_eq!(pattern.row(6), [run(5, 1)]);
    }

    #[test]
    fn rows_start_at_the_root() {
        let (rows, n) = skyline(&dofs(&FOREST), (&[], &[]), &[]).unwrap();
        assert_eq!(rows.first, [0, 0, 0, 0, 0, 5, 5]);
        assert_eq!(rows.start, [0, 1, 3, 6, 10, 15, 16]);
        assert_eq!((n, rows.at(4, 3), rows.diagonal(6)), (18, 13, 17));
    }
}
