//! Few corners of a convex polygon that stand for all.

use glam::DVec3;

/// Most corners that are kept.
pub(super) const KEPT: usize = 4;

/// Four of `count` corners that span a large area, by rotating calipers: from the first four on, the last is moved on as long as
/// the area grows, then those before it, then the first. Of four corners or fewer, all.
pub(super) fn spanning(count: usize, at: impl Fn(usize) -> DVec3) -> impl Iterator<Item = usize> {
    let mut calipers = Calipers { count, at, legs: [0, 1, 2, 3], most: 0.0, best: [0, 1, 2, 3] };
    if count > KEPT {
        calipers.turn();
    }
    calipers.best.into_iter().take(count)
}

struct Calipers<F> {
    count: usize,
    at: F,
    legs: [usize; KEPT],
    most: f64,
    best: [usize; KEPT],
}

impl<F: Fn(usize) -> DVec3> Calipers<F> {
    fn turn(&mut self) {
        self.most = self.area(&self.legs);
        for _ in 0..self.count {
            while self.advance(3) {
                while self.advance(2) {}
                while self.advance(1) {}
            }
            for k in 1..KEPT {
                if self.legs[k] != self.legs[k - 1] {
                    break;
                }
                self.legs[k] = self.next(k);
            }
            self.legs[0] = self.next(0);
        }
    }

    fn next(&self, leg: usize) -> usize {
        (self.legs[leg] + 1) % self.count
    }

    fn area(&self, legs: &[usize; KEPT]) -> f64 {
        let [a, b, c, d] = legs.map(&self.at);
        (c - a).cross(d - b).length()
    }

    /// Moves a leg on if that gives more area than ever.
    fn advance(&mut self, leg: usize) -> bool {
        let mut legs = self.legs;
        legs[leg] = self.next(leg);
        let area = self.area(&legs);
        let more = area > self.most;
        if more {
            (self.legs, self.best, self.most) = (legs, legs, area);
        }
        more
    }
}
