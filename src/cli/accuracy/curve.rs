//! Work against error: an engine's lower-left hull, and how much less work another does for the same error.

/// One way to step, its error and its work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Error.
    pub error: f64,
    /// Wall seconds per simulated second, world and core.
    pub work: f64,
}

/// Errors below this are rounding, or nothing at all: they are not worth more work.
pub const FLOOR: f64 = 1e-12;

/// The points that no other beats in error and work, by falling error and so by rising work.
pub fn hull(points: &[Point]) -> Vec<Point> {
    let mut all: Vec<Point> = points.iter().map(|p| Point { error: p.error.max(FLOOR), ..*p }).collect();
    all.sort_by(|a, b| a.work.total_cmp(&b.work).then(a.error.total_cmp(&b.error)));
    let mut out: Vec<Point> = Vec::new();
    for point in all {
        if out.last().is_none_or(|last| point.error < last.error) {
            out.push(point);
        }
    }
    out
}

/// The work for which the error is at most `error`: linear in logarithms between two points of a hull; `None` if nothing is that
/// accurate.
pub fn work(hull: &[Point], error: f64) -> Option<f64> {
    let error = error.max(FLOOR);
    let at = hull.iter().position(|point| point.error <= error)?;
    let good = hull[at];
    let Some(bad) = at.checked_sub(1).map(|before| hull[before]) else { return Some(good.work) };
    let share = (bad.error / error).ln() / (bad.error / good.error).ln();
    Some(bad.work * (good.work / bad.work).powf(share))
}

/// The middle of the numbers that there are.
pub fn median(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    let mut all: Vec<f64> = values.into_iter().flatten().collect();
    all.sort_by(f64::total_cmp);
    let n = all.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(all[n / 2]),
        _ => Some(0.5 * (all[n / 2 - 1] + all[n / 2])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(list: &[(f64, f64)]) -> Vec<Point> {
        list.iter().map(|(error, work)| Point { error: *error, work: *work }).collect()
    }

    #[test]
    fn a_hull_has_what_nothing_beats() {
        let all = points(&[(1e-2, 1.0), (1e-3, 10.0), (2e-3, 20.0), (5e-3, 0.5), (1e-4, 100.0)]);
        assert_eq!(hull(&all), points(&[(5e-3, 0.5), (1e-3, 10.0), (1e-4, 100.0)]));
    }

    #[test]
    fn work_is_read_between_points() {
        let hull = hull(&points(&[(1e-2, 1.0), (1e-4, 100.0)]));
        assert!((work(&hull, 1e-3).unwrap() - 10.0).abs() < 1e-9);
        assert_eq!(work(&hull, 1.0), Some(1.0));
        assert_eq!(work(&hull, 1e-2), Some(1.0));
        assert!((work(&hull, 1e-4).unwrap() - 100.0).abs() < 1e-9);
        assert_eq!(work(&hull, 1e-5), None);
    }

    #[test]
    fn medians_leave_out_what_is_not_there() {
        assert_eq!(median([Some(3.0), None, Some(1.0)]), Some(2.0));
        assert_eq!(median([Some(3.0), Some(7.0), Some(1.0)]), Some(3.0));
        assert_eq!(median([None]), None);
    }
}
