//! Groups of bounded dofs with similar mode shapes, of which one product tells enough.
//!
//! Let c be the mean of the rows `$\Phi_i$` of a group's dofs, and W the frequencies of the modes.
//! Under the motion p(t) of the modes the deflections differ by
//!
//! ```math
//! |\Phi_i\, p - c\, p| \le |W^{-1} (\Phi_i - c)|\; |W p| ,
//! ```
//!
//! where the first factor is small, since neighbours move alike, and the second one is the root of
//! twice the elastic energy. Groups whose distance from the obstacles exceeds this difference need
//! no look at their dofs. Rigid motions take the lowest other frequency for theirs.

use super::forecast::least;
use super::limits::Limits;
use super::products::{dots, sum};
use faer::Mat;
use std::ops::Range;

/// Largest number of dofs of a group.
const LARGEST: usize = 16;
/// Number of lowest modes that tell neighbours apart.
const GUIDES: usize = 12;
/// Relative rounding errors of the differences within a group.
const ROUNDING: f64 = 1e-9;

/// Groups of all bounds; see the [module page](self).
#[derive(Debug)]
pub(super) struct Groups {
    /// Inverse frequencies, in s/rad, one entry per mode.
    inverse: Vec<f64>,
    /// Bounds, those of each group together.
    members: Vec<usize>,
    groups: Vec<Group>,
    /// Index of the group of each bound.
    of: Vec<usize>,
    /// Mean rows of the mode shapes, one column per group.
    centres: Mat<f64>,
    /// Largest |W p| and length (s) of the present motion.
    most: f64,
    end: f64,
    /// Bounds of the slacks in that motion, one entry per group; `None` for those not computed yet.
    slacks: Vec<Option<f64>>,
}

/// Group of bounded dofs.
#[derive(Debug)]
struct Group {
    members: Range<usize>,
    /// Largest difference from the centre and largest norm of a row.
    spread: f64,
    size: f64,
}

impl Groups {
    /// Divides the bounds, given the mode shapes there in columns with their norms, and the squared
    /// frequencies of the modes, ascending.
    pub fn new(shapes: &Mat<f64>, sizes: &[f64], squares: &[f64]) -> Groups {
        let lowest = squares.iter().copied().find(|square| *square > 0.0).unwrap_or(1.0);
        let inverse: Vec<f64> = squares.iter().map(|square| square.max(lowest).sqrt().recip()).collect();
        let mut members: Vec<usize> = (0..shapes.ncols()).collect();
        let mut ranges = Vec::new();
        divide(shapes, &inverse, &mut members, 0, &mut ranges);
        let mut of = vec![0; members.len()];
        let mut centres = Mat::zeros(shapes.nrows(), ranges.len());
        let mut groups = Vec::with_capacity(ranges.len());
        for (g, range) in ranges.into_iter().enumerate() {
            let group = &members[range.clone()];
            let centre = centres.col_as_slice_mut(g);
            for &i in group {
                of[i] = g;
                let share = 1.0 / group.len() as f64;
                centre.iter_mut().zip(shapes.col_as_slice(i)).for_each(|(c, shape)| *c += share * shape);
            }
            let difference = |&i: &usize| {
                let row = shapes.col_as_slice(i);
                let of_mode = |k: usize| -> f64 { inverse[k] * (row[k] - centre[k]) };
                sum(row.len(), |k| of_mode(k).powi(2)).sqrt()
            };
            let spread = group.iter().map(difference).fold(0.0, f64::max) * (1.0 + ROUNDING);
            let size = group.iter().map(|&i| sizes[i]).fold(0.0, f64::max);
            groups.push(Group { members: range, spread, size });
        }
        let slacks = vec![None; groups.len()];
        Groups { inverse, members, groups, of, centres, most: 0.0, end: 0.0, slacks }
    }

    /// Begins a motion with given coefficients of 1, t and t^2 of the modes, between 0 and `end`
    /// (s), without reactions.
    #[inline(always)]
    pub fn begin(&mut self, motion: [&[f64]; 3], end: f64) {
        self.slacks.fill(None);
        self.most = self.largest_root_of_energy(motion, end);
        self.end = end;
    }

    /// Returns a bound of the slack of a bounded dof in the motion that began. No dof of its group
    /// has less slack, unless the bound is negative.
    #[inline(always)]
    pub fn slack(&mut self, bound: usize, motion: [&[f64]; 3], limits: &Limits) -> f64 {
        let g = self.of[bound];
        if let Some(slack) = self.slacks[g] {
            return slack;
        }
        let slack = self.slack_of(g, motion, limits);
        self.slacks[g] = Some(slack);
        slack
    }

    #[inline(always)]
    fn slack_of(&self, g: usize, motion: [&[f64]; 3], limits: &Limits) -> f64 {
        let group = &self.groups[g];
        let members = &self.members[group.members.clone()];
        let lower = members.iter().map(|&i| limits.lower[i] - limits.shift[i]);
        let upper = members.iter().map(|&i| limits.upper[i] - limits.shift[i]);
        let lower = lower.fold(f64::NEG_INFINITY, f64::max);
        let upper = upper.fold(f64::INFINITY, f64::min);
        let [y, rate, curve] = dots(self.centres.col_as_slice(g), motion);
        let below = least([y - lower, rate, curve], self.end);
        let above = least([upper - y, -rate, -curve], self.end);
        (below.min(above) - group.spread * self.most) / group.size
    }

    /// Returns a bound of |W p| between 0 and `end`: the largest value at the three control points
    /// of p, whose convex hull contains it.
    #[inline(always)]
    fn largest_root_of_energy(&self, [a, b, c]: [&[f64]; 3], end: f64) -> f64 {
        let points = [[0.0, 0.0], [0.5 * end, 0.0], [end, end * end]];
        let size = |[of_b, of_c]: [f64; 2]| {
            let point = |k: usize| (a[k] + of_b * b[k] + of_c * c[k]) / self.inverse[k];
            sum(a.len(), |k| point(k).powi(2)).sqrt()
        };
        points.map(size).into_iter().fold(0.0, f64::max)
    }
}

/// Divides dofs into groups by halves, each time along the mode whose deflections, in terms of
/// energy, differ most.
fn divide(
    shapes: &Mat<f64>,
    inverse: &[f64],
    members: &mut [usize],
    start: usize,
    groups: &mut Vec<Range<usize>>,
) {
    if members.len() <= LARGEST {
        if !members.is_empty() {
            groups.push(start..start + members.len());
        }
        return;
    }
    let extent = |k: usize| {
        let values = members.iter().map(|&i| shapes[(k, i)]);
        let [least, most] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], value| {
            [value.min(least), value.max(most)]
        });
        inverse[k] * (most - least)
    };
    let extents: Vec<f64> = (0..inverse.len().min(GUIDES)).map(extent).collect();
    let guide = (0..extents.len()).max_by(|&a, &b| extents[a].total_cmp(&extents[b])).unwrap_or(0);
    let middle = members.len() / 2;
    members.select_nth_unstable_by(middle, |&a, &b| {
        shapes[(guide, a)].total_cmp(&shapes[(guide, b)]).then(a.cmp(&b))
    });
    let (left, right) = members.split_at_mut(middle);
    divide(shapes, inverse, left, start, groups);
    divide(shapes, inverse, right, start + middle, groups);
}

#[cfg(test)]
mod tests {
    use super::super::forecast::distance;
    use super::super::products::norm;
    use super::*;

    #[test]
    fn no_dof_has_less_slack_than_its_group_and_few_have_much_more() {
        // Shapes on a strip of 40 x 10 points, a rigid motion first.
        let place = |i: usize| [(i / 10) as f64 / 39.0, (i % 10) as f64 / 39.0];
        let shape = |k: usize, [x, y]: [f64; 2]| match k {
            0 => 1.0,
            k => ((1 + k / 2) as f64 * (x + 0.3)).sin() * if k % 2 == 0 { 1.0 } else { y - 0.12 },
        };
        let shapes = Mat::from_fn(12, 400, |k, i| shape(k, place(i)));
        let squares: Vec<f64> = (0..12).map(|k| (30.0 * k as f64).powi(2)).collect();
        let sizes: Vec<f64> = (0..400).map(|i| norm(shapes.col_as_slice(i))).collect();
        let mut groups = Groups::new(&shapes, &sizes, &squares);
        assert!(groups.groups.len() >= 400 / LARGEST && groups.groups.iter().all(|group| group.size > 0.0));
        let lower: Vec<f64> = (0..400).map(|i| -1.0 - 0.3 * place(i)[0]).collect();
        let shift: Vec<f64> = (0..400).map(|i| 1e-2 * place(i)[1]).collect();
        let limits = Limits { shift, lower, upper: vec![2.0; 400] };
        let mut close = 0;
        for seed in 0..20 {
            let of_mode = |k: usize, scale: f64| scale * ((7 * k + seed) as f64 * 1.7).sin() / (1 + k) as f64;
            let motion =
                [0.5, 20.0, 300.0].map(|scale| (0..12).map(|k| of_mode(k, scale)).collect::<Vec<_>>());
            let motion = motion.each_ref().map(|of| &**of);
            groups.begin(motion, 0.02);
            for i in 0..400 {
                let mut y = dots(shapes.col_as_slice(i), motion);
                y[0] += limits.shift[i];
                let slack = distance(y, &limits, i, 0.02) / sizes[i];
                let bound = groups.slack(i, motion, &limits);
                assert!(bound <= slack.max(0.0), "{i}: {bound} > {slack}");
                close += usize::from(bound > slack - 0.3);
            }
        }
        assert!(close > 4000, "{close} of 8000");
    }
}
