//! Groups of neighbouring bounded dofs, whose deflections are combinations of a few.
//!
//! Let W be the frequencies of the modes. The rows `$\Phi_i$` of the mode shapes at a group's dofs
//! are combinations of a few rows B, orthonormal after division by W, but for a small rest:
//!
//! ```math
//! \Phi_i = S_i\, B + r_i, \qquad B\, W^{-2} B^T = I, \qquad
//!    |\Phi_i\, p - S_i\, B\, p| \le |W^{-1} r_i|\; |W p|
//! ```
//!
//! under the motion p(t) of the modes. The last factor is the root of twice the elastic energy. A
//! motion takes one product with each row of B, and few operations for each dof. The rows are found
//! by the method of Gram and Schmidt, each from the dof with the largest rest. Rigid motions take
//! the lowest other frequency for theirs.
//!
//! Most groups are so far from obstacles that the lowest modes tell enough, with a bound of the
//! same kind for the share of the others.

use super::forecast::least;
use super::limits::Limits;
use super::products::{LANES, dot, dots, sum};
use crate::linalg::wide::widest;
use faer::Mat;
use pulp::Arch;

/// Largest number of dofs of a group.
const LARGEST: usize = 128;
/// Number of lowest modes that tell neighbours apart.
const GUIDES: usize = 12;
/// Largest rest of a row, relative to the largest row of its group.
const REST: f64 = 2e-3;
/// Part of the modes that are the lowest ones.
const HEAD: usize = 6;
/// Rounding errors of a row, relative to it.
const ROUNDING: f64 = 1e-12;

/// Groups of all bounds; see the [module page](self).
#[derive(Debug)]
pub(super) struct Groups {
    /// Frequencies W, in rad/s, one entry per mode.
    frequencies: Vec<f64>,
    /// Number of the lowest modes.
    pub head: usize,
    groups: Vec<Group>,
    /// Index of the group of each bound.
    of: Vec<usize>,
}

/// Group of bounded dofs; entries per member are in the order of the members.
#[derive(Debug)]
struct Group {
    /// Bounds that are no candidates for contact, ascending.
    members: Vec<usize>,
    /// Rows B, one column each, for the lowest modes and for all, and their coefficients S, one
    /// vector over the members each.
    heads: Mat<f64>,
    rows: Mat<f64>,
    coefficients: Vec<Vec<f64>>,
    /// Norms of the rows `$\Phi_i$`.
    sizes: Vec<f64>,
    /// Largest rest, divided by the norm of its row.
    rest: f64,
    /// Largest share of the other than the lowest modes, rest included, divided likewise.
    tail: f64,
    /// Bounds that the deflections by the modes keep between, in m.
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// Displacements of the members per reaction of each candidate, in m/N, and their largest
    /// magnitude, divided by the norm of the row.
    responses: Vec<Vec<f64>>,
    flexibility: f64,
}

impl Groups {
    /// Divides the bounds, given the mode shapes there in columns with their norms, and the squared
    /// frequencies of the modes, ascending.
    pub fn new(shapes: &Mat<f64>, sizes: &[f64], squares: &[f64]) -> Groups {
        let lowest = squares.iter().copied().find(|square| *square > 0.0).unwrap_or(1.0);
        let frequencies = squares.iter().map(|square| square.max(lowest).sqrt()).collect();
        Groups::with_frequencies(shapes, sizes, frequencies)
    }

    fn with_frequencies(shapes: &Mat<f64>, sizes: &[f64], frequencies: Vec<f64>) -> Groups {
        let mut all: Vec<usize> = (0..shapes.ncols()).collect();
        let head = frequencies.len().div_ceil(HEAD).next_multiple_of(LANES).min(frequencies.len());
        let mut groups = Vec::new();
        divide(shapes, &frequencies, &mut all, &mut |members| {
            groups.push(Group::new(members, shapes, sizes, &frequencies, head));
        });
        let mut of = vec![0; all.len()];
        for (g, group) in groups.iter().enumerate() {
            group.members.iter().for_each(|&i| of[i] = g);
        }
        Groups { frequencies, head, groups, of }
    }

    /// Returns to the groups of all bounds, without candidates.
    pub fn restore(&mut self, shapes: &Mat<f64>, sizes: &[f64]) {
        *self = Groups::with_frequencies(shapes, sizes, std::mem::take(&mut self.frequencies));
    }

    /// Returns the number of groups.
    pub fn count(&self) -> usize {
        self.groups.len()
    }

    /// Returns the bounds of a group that are no candidates, ascending.
    pub fn members(&self, g: usize) -> &[usize] {
        &self.groups[g].members
    }

    /// Removes bounds that have become candidates.
    pub fn remove(&mut self, near: &[usize]) {
        for i in near {
            let group = &mut self.groups[self.of[*i]];
            if let Ok(at) = group.members.binary_search(i) {
                group.remove(at);
            }
        }
    }

    /// Adds a candidate before that of an index, given the displacements of all bounds per
    /// reaction, in m/N.
    pub fn yield_to(&mut self, index: usize, column: &[f64]) {
        for Group { members, sizes, responses, flexibility, .. } in &mut self.groups {
            let response: Vec<f64> = members.iter().map(|&i| column[i]).collect();
            let relative = response.iter().zip(sizes).map(|(response, size)| response.abs() / *size);
            *flexibility = relative.fold(*flexibility, f64::max);
            responses.insert(index, response);
        }
    }

    /// Returns the displacements of the members of a group per reaction of each candidate, in m/N.
    pub fn responses(&self, g: usize) -> &[Vec<f64>] {
        &self.groups[g].responses
    }

    /// Returns the largest displacement of any member of some groups per reaction, divided by its
    /// norm.
    pub fn flexibility(&self, groups: &[usize]) -> f64 {
        groups.iter().map(|&g| self.groups[g].flexibility).fold(0.0, f64::max)
    }

    /// Follows the loads and obstacles for some groups.
    pub fn follow(&mut self, groups: &[usize], limits: &Limits) {
        for &g in groups {
            let Group { members, lower, upper, .. } = &mut self.groups[g];
            for (k, &i) in members.iter().enumerate() {
                (lower[k], upper[k]) = (limits.lower[i] - limits.shift[i], limits.upper[i] - limits.shift[i]);
            }
        }
    }

    /// Returns the largest rest of a member of a group, divided by the norm of its row, and the
    /// largest share of the other than the lowest modes.
    pub fn rests(&self, g: usize) -> [f64; 2] {
        [self.groups[g].rest, self.groups[g].tail]
    }

    /// Returns the least slack in a group, without rests, in a motion with given coefficients of 1,
    /// t and t^2 of all modes or of the lowest ones, between 0 and `end` (s), under acting
    /// reactions (N) with the indices of their candidates.
    #[inline(always)]
    pub fn slack(&self, g: usize, motion: [&[f64]; 3], end: f64, acting: &[(usize, f64)]) -> f64 {
        let Group { members, heads, rows, coefficients, sizes, lower, upper, responses, .. } =
            &self.groups[g];
        let rows = if motion[0].len() == self.head { heads } else { rows };
        let size = members.len();
        let mut deflections = [[0.0; LARGEST]; 3];
        let [y, rate, curve] = deflections.each_mut().map(|of| &mut of[..size]);
        for (j, of) in coefficients.iter().enumerate() {
            let [a, b, c] = dots(rows.col_as_slice(j), motion);
            let of = &of[..size];
            for k in 0..size {
                y[k] += a * of[k];
                rate[k] += b * of[k];
                curve[k] += c * of[k];
            }
        }
        for (k, r) in acting {
            let response = &responses[*k][..size];
            y.iter_mut().zip(response).for_each(|(y, response)| *y += r * response);
        }
        let (sizes, lower, upper) = (&sizes[..size], &lower[..size], &upper[..size]);
        let mut slack = f64::INFINITY;
        for k in 0..size {
            let below = least([y[k] - lower[k], rate[k], curve[k]], end);
            let above = least([upper[k] - y[k], -rate[k], -curve[k]], end);
            slack = slack.min(below.min(above) / sizes[k]);
        }
        slack
    }

    /// Returns bounds of |W p| between 0 and `end`, over all modes and over the other than the
    /// lowest: the largest values at the three control points of p, whose convex hull contains it.
    #[inline(always)]
    pub fn largest_roots_of_energy(&self, [a, b, c]: [&[f64]; 3], end: f64) -> [f64; 2] {
        let points = [[0.0, 0.0], [0.5 * end, 0.0], [end, end * end]];
        let size = |[of_b, of_c]: [f64; 2]| {
            let point = |k: usize| (a[k] + of_b * b[k] + of_c * c[k]) * self.frequencies[k];
            let low = sum(self.head, |k| point(k).powi(2));
            let high = sum(a.len() - self.head, |k| point(self.head + k).powi(2));
            [(low + high).sqrt(), high.sqrt()]
        };
        let [all, high] = [0, 1].map(|part| points.map(|of| size(of)[part]).into_iter().fold(0.0, f64::max));
        [all, high]
    }
}

impl Group {
    /// Finds the few rows for some bounds.
    fn new(members: Vec<usize>, shapes: &Mat<f64>, sizes: &[f64], frequencies: &[f64], head: usize) -> Group {
        let (modes, count) = (frequencies.len(), members.len());
        let mut rests = Mat::from_fn(modes, count, |k, j| shapes[(k, members[j])] / frequencies[k]);
        let mut norms: Vec<f64> = (0..count).map(|j| rests.col(j).norm_l2()).collect();
        let rounding: Vec<f64> = norms.iter().map(|norm| ROUNDING * norm).collect();
        let tails: Vec<f64> =
            (0..count).map(|j| rests.col(j).subrows(head, modes - head).norm_l2()).collect();
        let enough = REST * norms.iter().copied().fold(0.0, f64::max);
        let (mut found, mut coefficients) = (Vec::new(), Vec::new());
        let arch = Arch::new();
        while coefficients.len() < count {
            let farthest = (0..count).max_by(|&a, &b| norms[a].total_cmp(&norms[b])).unwrap_or(0);
            if norms[farthest] <= enough {
                break;
            }
            let row: Vec<f64> =
                rests.col_as_slice(farthest).iter().map(|rest| rest / norms[farthest]).collect();
            let mut of = vec![0.0; count];
            widest(
                arch,
                #[inline(always)]
                || {
                    for j in 0..count {
                        let rest = rests.col_as_slice_mut(j);
                        of[j] = dot(&row, rest);
                        rest.iter_mut().zip(&row).for_each(|(rest, row)| *rest -= of[j] * row);
                        norms[j] = dot(rest, rest).sqrt();
                    }
                },
            );
            found.extend(row.iter().zip(frequencies).map(|(row, frequency)| row * frequency));
            coefficients.push(of);
        }
        let largest =
            |of: &dyn Fn(usize) -> f64| (0..count).map(|j| of(j) / sizes[members[j]]).fold(0.0, f64::max);
        let rest = |j: usize| norms[j] + rounding[j];
        Group {
            rest: largest(&rest),
            tail: largest(&|j| tails[j] + rest(j)),
            heads: Mat::from_fn(head, coefficients.len(), |k, j| found[j * modes + k]),
            rows: Mat::from_fn(modes, coefficients.len(), |k, j| found[j * modes + k]),
            coefficients,
            sizes: members.iter().map(|&i| sizes[i]).collect(),
            lower: vec![f64::NEG_INFINITY; count],
            upper: vec![f64::INFINITY; count],
            responses: Vec::new(),
            flexibility: 0.0,
            members,
        }
    }

    /// Removes a member.
    fn remove(&mut self, at: usize) {
        let Group { members, coefficients, sizes, lower, upper, responses, .. } = self;
        members.remove(at);
        for values in coefficients.iter_mut().chain(responses).chain([sizes, lower, upper]) {
            values.remove(at);
        }
    }
}

/// Divides dofs into groups by halves, each time along the mode whose deflections, in terms of
/// energy, differ most, and passes on the ascending members of each.
fn divide(shapes: &Mat<f64>, frequencies: &[f64], all: &mut [usize], found: &mut dyn FnMut(Vec<usize>)) {
    if all.len() <= LARGEST {
        if !all.is_empty() {
            all.sort_unstable();
            found(all.to_vec());
        }
        return;
    }
    let extent = |k: usize| {
        let values = all.iter().map(|&i| shapes[(k, i)]);
        let [least, most] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], value| {
            [value.min(least), value.max(most)]
        });
        (most - least) / frequencies[k]
    };
    let extents: Vec<f64> = (0..frequencies.len().min(GUIDES)).map(extent).collect();
    let guide = (0..extents.len()).max_by(|&a, &b| extents[a].total_cmp(&extents[b])).unwrap_or(0);
    let middle = all.len() / 2;
    all.select_nth_unstable_by(middle, |&a, &b| {
        shapes[(guide, a)].total_cmp(&shapes[(guide, b)]).then(a.cmp(&b))
    });
    let (left, right) = all.split_at_mut(middle);
    divide(shapes, frequencies, left, found);
    divide(shapes, frequencies, right, found);
}

#[cfg(test)]
mod tests {
    use super::super::forecast::distance;
    use super::super::products::norm;
    use super::*;

    #[test]
    fn no_group_has_less_slack_than_its_bound_or_much_more() {
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
        assert!(
            groups.count() >= 400 / LARGEST
                && groups.groups.iter().all(|group| group.coefficients.len() <= 10)
        );
        let lower: Vec<f64> = (0..400).map(|i| -1.0 - 0.3 * place(i)[0]).collect();
        let shift: Vec<f64> = (0..400).map(|i| 1e-2 * place(i)[1]).collect();
        let limits = Limits { shift, lower, upper: vec![2.0; 400] };
        let all: Vec<usize> = (0..groups.count()).collect();
        groups.follow(&all, &limits);
        for seed in 0..20 {
            let of_mode = |k: usize, scale: f64| scale * ((7 * k + seed) as f64 * 1.7).sin() / (1 + k) as f64;
            let motion =
                [0.5, 20.0, 300.0].map(|scale| (0..12).map(|k| of_mode(k, scale)).collect::<Vec<_>>());
            let motion = motion.each_ref().map(|of| &**of);
            let [most, high] = groups.largest_roots_of_energy(motion, 0.02);
            for g in 0..groups.count() {
                let slack = |&i: &usize| {
                    let mut y = dots(shapes.col_as_slice(i), motion);
                    y[0] += limits.shift[i];
                    distance(y, &limits, i, 0.02) / sizes[i]
                };
                let slack = groups.members(g).iter().map(slack).fold(f64::INFINITY, f64::min);
                let [rest, tail] = groups.rests(g);
                let bound = groups.slack(g, motion, 0.02, &[]) - rest * most;
                let low = motion.map(|of| &of[..groups.head]);
                let rough = groups.slack(g, low, 0.02, &[]) - rest * most - tail * high;
                assert!(rough <= slack, "{g}: {rough} > {slack}");
                assert!(bound <= slack, "{g}: {bound} > {slack}");
                assert!(bound >= slack - 2.0 * rest * most, "{g}: {bound}, far below {slack}");
            }
        }
    }
}
