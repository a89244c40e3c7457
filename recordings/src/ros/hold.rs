//! Zero-order hold of commands onto the times of measurements.
//!
//! A command acts from its arrival to the next one, a measurement is taken at an instant. Row k of a recording holds the
//! measurement at t_k and the input that acts from t_k to t_{k+1}: the mean of the held command over that interval. It
//! equals the held value wherever no command arrives inside, and avoids the half period of delay that sampling the
//! command at t_k would put into the data on average.

/// Share of the median row period within which a command that arrives next to a row's time counts as arriving at it.
///
/// Arrival times carry the jitter of the recorder, so a few percent of a period mean nothing; without it, a command sent
/// at each row would leak into the row before by the rounding of stamps.
pub(crate) const SNAP_SHARE: f64 = 0.05;

/// Mean of a held signal over [`grid[k]`, `grid[k + 1]`), for every k; the last row takes the value held there.
///
/// `times` (nondecreasing) and `grid` (strictly increasing) are in one integer unit, such as nanoseconds; `values[i]`
/// holds from `times[i]` on. A change within `snap` of a grid point is moved onto it. Rows whose interval begins before
/// the first change are `None`: what acted then is unknown.
pub(crate) fn held_means(times: &[i64], values: &[f64], grid: &[i64], snap: i64) -> Vec<Option<f64>> {
    let changes: Vec<(i64, f64)> = times.iter().zip(values).map(|(t, v)| (snapped(*t, grid, snap), *v)).collect();
    let mut next = 0;
    let mut held: Option<f64> = None;
    let mut means = Vec::with_capacity(grid.len());
    for (row, start) in grid.iter().enumerate() {
        while let Some((_, value)) = changes.get(next).filter(|change| change.0 <= *start) {
            held = Some(*value);
            next += 1;
        }
        let Some(before) = held else {
            means.push(None);
            continue;
        };
        let Some(end) = grid.get(row + 1) else {
            means.push(Some(before));
            continue;
        };
        let (mut from, mut value, mut sum) = (*start, before, 0.0);
        while let Some((time, changed)) = changes.get(next).filter(|change| change.0 < *end) {
            sum += value * time.abs_diff(from) as f64;
            (from, value) = (*time, *changed);
            next += 1;
        }
        let unchanged = from == *start;
        sum += value * end.abs_diff(from) as f64;
        means.push(Some(if unchanged { value } else { sum / end.abs_diff(*start) as f64 }));
        held = Some(value);
    }
    means
}

/// The grid point within `snap` of `time`, or `time`.
fn snapped(time: i64, grid: &[i64], snap: i64) -> i64 {
    let after = grid.partition_point(|g| *g < time);
    let near = |index: usize| grid.get(index).copied().filter(|g| g.abs_diff(time) <= snap.unsigned_abs());
    let before = after.checked_sub(1).and_then(near);
    match (before, near(after)) {
        (Some(b), Some(a)) => {
            if time.abs_diff(b) < time.abs_diff(a) {
                b
            } else {
                a
            }
        }
        (found, None) | (None, found) => found.unwrap_or(time),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn aligned_changes_give_the_held_values() {
        let means = held_means(&[0, 10, 20], &[1.0, 2.0, 3.0], &[0, 10, 20], 0);
        assert_eq!(means, [Some(1.0), Some(2.0), Some(3.0)]);
    }

    #[test]
    fn a_change_inside_an_interval_is_weighted_by_time() {
        let means = held_means(&[0, 14], &[1.0, 2.0], &[0, 10, 20, 30], 0);
        assert_eq!(means, [Some(1.0), Some(1.6), Some(2.0), Some(2.0)]);
    }

    #[test]
    fn several_changes_inside_one_interval_all_count() {
        let means = held_means(&[0, 2, 4, 8], &[1.0, 10.0, 100.0, 5.0], &[0, 10, 20], 0);
        assert_eq!(means, [Some((2.0 + 20.0 + 400.0 + 10.0) / 10.0), Some(5.0), Some(5.0)]);
    }

    #[test]
    fn rows_before_the_first_command_are_unknown() {
        assert_eq!(held_means(&[15], &[7.0], &[0, 10, 20], 0), [None, None, Some(7.0)]);
        assert_eq!(held_means(&[], &[], &[0, 10], 0), [None, None]);
    }

    #[test]
    fn changes_next_to_a_row_are_snapped_to_it() {
        let means = held_means(&[1, 9, 19], &[1.0, 2.0, 3.0], &[0, 10, 20], 1);
        assert_eq!(means, [Some(1.0), Some(2.0), Some(3.0)]);
        assert_eq!(held_means(&[2, 10], &[1.0, 2.0], &[0, 10, 20], 1), [None, Some(2.0), Some(2.0)]);
    }

    #[test]
    fn extreme_times_do_not_overflow() {
        let means = held_means(&[i64::MIN, i64::MAX], &[1.0, 2.0], &[i64::MIN, 0, i64::MAX], 5);
        assert_eq!(means, [Some(1.0), Some(1.0), Some(2.0)]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        /// Against the definition, one tick at a time.
        #[test]
        fn equals_the_mean_tick_by_tick(
            steps in prop::collection::vec(0i64..7, 1..20), values in prop::collection::vec(-5i32..5, 20), periods in prop::collection::vec(1i64..9, 2..12), origin in -10i64..10
        ) {
            let sum = |steps: &[i64], from: i64| steps.iter().scan(from, |t, s| { *t += s; Some(*t) }).collect::<Vec<i64>>();
            let (times, grid) = (sum(&steps, 0), sum(&periods, origin));
            let values: Vec<f64> = values.iter().take(times.len()).map(|v| f64::from(*v)).collect();
            let at = |tick: i64| times.iter().rposition(|t| *t <= tick).map(|i| values[i]);
            let means = held_means(&times, &values, &grid, 0);
            for row in 0..grid.len() {
                let end = grid.get(row + 1).copied().unwrap_or(grid[row] + 1);
                let expected = at(grid[row]).map(|_| (grid[row]..end).filter_map(at).sum::<f64>() / (end - grid[row]) as f64);
                match (means[row], expected) {
                    (Some(mean), Some(expected)) => prop_assert!((mean - expected).abs() < 1e-12),
                    (mean, expected) => prop_assert_eq!(mean, expected),
                }
            }
        }
    }
}
