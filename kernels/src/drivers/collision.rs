//! From poses to the block's list of contacts: bounding tests of the pairs that are due, then the narrow phase of those that are
//! near in some world.

use crate::collision::{Collision, ConvexCollider, Near, shapes};
use crate::lane::LaneQuery;
use crate::model::{NONE, Shape};
use crate::part::{Executor, Item, Op, Part, Step};
use crate::workspace::Workspace;

/// Finds the contacts of the worlds in `alive`, in some of which bounding tests are due by their
/// [`way`](crate::collision::way). Returns the worlds that had more than `capacity` contacts; those beyond it, in the order of
/// pairs, are left out.
pub fn collide<L: LaneQuery>(
    step: &mut Step<'_, L>,
    alive: u32,
    capacity: usize,
    convex: &dyn ConvexCollider,
    executor: &mut dyn Executor<L>,
) -> u32 {
    step.ws.collision.slots.clear();
    let groups = executor.in_groups() && !step.ws.collision.groups.is_empty();
    let any = if groups { test_groups(step, alive, executor) } else { test_pairs(step, alive) };
    if !any {
        return 0;
    }
    let collision = &mut step.ws.collision;
    let single = collision.list_near(alive);
    let mut near = std::mem::take(&mut collision.near);
    find_points(step, &near, executor);
    if single {
        let Workspace { collision, position, .. } = &mut *step.ws;
        for near in near.iter().filter(|near| near.class == NONE) {
            collision.world_by_world(step.model, near, position, convex);
        }
    }
    let collision = &mut step.ws.collision;
    std::mem::swap(&mut collision.near, &mut near);
    L::bits(collision.list_contacts(&step.model, capacity))
}

/// Bounding tests pair by pair, of those that are due. Whether any pair may be near.
fn test_pairs<L: LaneQuery>(step: &mut Step<'_, L>, alive: u32) -> bool {
    let Collision { broad, colliders, .. } = &mut step.ws.collision;
    broad.test(step.model, ((&*step.state).into(), &step.ws.position), L::mask_of(alive), colliders)
}

/// Bounding tests in groups, of those that are due. Whether any pair is near.
fn test_groups<L: LaneQuery>(step: &mut Step<'_, L>, alive: u32, executor: &mut dyn Executor<L>) -> bool {
    let Collision { broad, colliders, groups, words, .. } = &mut step.ws.collision;
    let count = groups.len();
    broad.begin(count, ((&*step.state).into(), &step.ws.position), colliders);
    let mut words = std::mem::take(words);
    let mut any = false;
    for group in 0..count {
        let Collision { broad, colliders, groups, .. } = &mut step.ws.collision;
        if broad.is_due(group, L::mask_of(alive), colliders) {
            let words = &mut words[..groups[group].len()];
            executor.run(Part::of(Op::Near, group as u32), 0, words, step);
            let Collision { broad, colliders, groups, .. } = &mut step.ws.collision;
            any |= broad.note(group, (&groups[group], words), alive, colliders);
        }
        step.ws.collision.broad.foresee(group);
    }
    let Collision { broad, colliders, .. } = &mut step.ws.collision;
    broad.end(colliders);
    step.ws.collision.words = words;
    any
}

/// Contacts of the pairs with a formula in lanes, class by class.
fn find_points<L: LaneQuery>(step: &mut Step<'_, L>, near: &[Near], executor: &mut dyn Executor<L>) {
    for class in 0..step.ws.collision.classes.len() as u32 {
        let mut mine = near.iter().filter(|near| near.class == class).peekable();
        let Some(first) = mine.peek() else { continue };
        let capsules = shapes(&step.model, first.pair) == (Shape::Capsule, Shape::Capsule);
        executor.each(Part::of(Op::Narrow, class), &mut mine.map(Item::Near), u32::MAX, step);
        if capsules {
            for near in near.iter().filter(|near| near.class == class) {
                let parallel = step.ws.collision.parallel[near.first as usize];
                if L::any(parallel.gt(L::zero())) {
                    let mut near = std::iter::once(Item::Near(near));
                    executor.each(Part::of(Op::Parallel, class), &mut near, u32::MAX, step);
                }
            }
        }
    }
}
