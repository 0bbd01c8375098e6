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
use crate::kernels::lanes::{LANES, dot, sum};
use crate::kernels::wide::widest;
use faer::Mat;
use pulp::Arch;

/// Largest number of dofs of a group.
const LARGEST: usize = 128;
/// Number of lowest modes that tell neighbours apart.
const GUIDES: usize = 12;
/// Largest rest of a row, relative to the largest row of its group.
const REST: f64 = 5e-4;
/// Part of the modes that are the lowest ones.
const HEAD: usize = 6;
/// Rounding errors of a row, relative to it.
const ROUNDING: f64 = 1e-12;

/// Work space of [`Groups::slack`].
pub(super) struct Slacks {
    /// Values of the coefficients of 1, t and t^2, one entry per row.
    factors: [[f64; LARGEST]; 3],
    /// Slack of each member.
    pub of_members: [f64; LARGEST],
}

impl Slacks {
    pub fn new() -> Slacks {
        Slacks { factors: [[0.0; LARGEST]; 3], of_members: [0.0; LARGEST] }
    }
}

/// Groups of all bounds; see the [module page](self).
#[derive(Debug)]
pub(super) struct Groups {
    /// Frequencies W, in rad/s, one entry per mode.
    frequencies: Vec<f64>,
    /// Number of the lowest modes.
    pub head: usize,
    groups: Vec<Group>,
    /// Place of each bound among the lanes of all groups, and their number.
    pub places: Vec<usize>,
    pub lanes: usize,
}

/// Group of bounded dofs; entries per member are in the order of the members.
#[derive(Debug)]
struct Group {
    /// Bounds, ascending.
    members: Vec<usize>,
    /// Place of the first member.
    start: usize,
    /// Number of rows B, and these, by lanes: those of each mode are together.
    rank: usize,
    rows: Vec<f64>,
    /// Coefficients S of the members, by lanes: those of each row are together.
    coefficients: Vec<f64>,
    /// Reciprocal norms of the rows `$\Phi_i$`, and those with 0 for candidates for contact. Here
    /// and below the lanes without a member follow.
    scales: Vec<f64>,
    weights: Vec<f64>,
    /// Largest rest, divided by the norm of its row.
    rest: f64,
    /// Largest share of the other than the lowest modes, rest included, divided likewise.
    tail: f64,
    /// Bounds that the deflections by the modes keep between, in m; infinite for candidates. Those
    /// above may all be infinite.
    lower: Vec<f64>,
    upper: Vec<f64>,
    has_upper: bool,
    /// Largest displacement of a member that is no candidate per reaction of one, in m/N, divided
    /// by the norm of the row.
    flexibility: f64,
}

impl Groups {
    /// Divides the bounds, given the mode shapes there in columns with their norms, and the squared
    /// frequencies of the modes, ascending.
    pub fn new(shapes: &Mat<f64>, sizes: &[f64], squares: &[f64]) -> Groups {
        let lowest = squares.iter().copied().find(|square| *square > 0.0).unwrap_or(1.0);
        let frequencies: Vec<f64> = squares.iter().map(|square| square.max(lowest).sqrt()).collect();
        let mut bounds: Vec<usize> = (0..shapes.ncols()).collect();
        let head = frequencies.len().div_ceil(HEAD).next_multiple_of(LANES).min(frequencies.len());
        let mut groups = Vec::new();
        let mut places = vec![0; bounds.len()];
        let mut start = 0;
        divide(shapes, &frequencies, &mut bounds, &mut |members| {
            members.iter().enumerate().for_each(|(m, &i)| places[i] = start + m);
            let size = members.len();
            groups.push(Group { start, ..Group::new(members, shapes, sizes, &frequencies, head) });
            start += size.next_multiple_of(LANES);
        });
        Groups { frequencies, head, groups, places, lanes: start }
    }

    /// Forgets all candidates.
    pub fn restore(&mut self) {
        for group in &mut self.groups {
            group.weights.clone_from(&group.scales);
            group.flexibility = 0.0;
        }
    }

    /// Returns the number of groups.
    pub fn count(&self) -> usize {
        self.groups.len()
    }

    /// Returns the positions in a group of the bounds that are no candidates, and these bounds,
    /// ascending.
    pub fn members(&self, g: usize) -> impl Iterator<Item = (usize, usize)> {
        let Group { members, weights, .. } = &self.groups[g];
        let pairs = members.iter().copied().enumerate();
        pairs.filter(|(m, _)| weights[*m] > 0.0)
    }

    /// Notes that a bound has become a candidate.
    pub fn remove(&mut self, bound: usize) {
        let place = self.places[bound];
        let g = self.groups.partition_point(|group| group.start <= place) - 1;
        let Group { start, weights, lower, upper, .. } = &mut self.groups[g];
        let m = place - *start;
        (weights[m], lower[m], upper[m]) = (0.0, f64::NEG_INFINITY, f64::INFINITY);
    }

    /// Adds the response of a candidate: the displacements of all bounds per reaction (m/N), in the
    /// order of `places`.
    pub fn yield_to(&mut self, response: &[f64]) {
        for Group { start, weights, flexibility, .. } in &mut self.groups {
            let response = response[*start..*start + weights.len()].as_chunks::<LANES>().0;
            let mut largest = [*flexibility; LANES];
            for (response, weights) in response.iter().zip(weights.as_chunks::<LANES>().0) {
                for lane in 0..LANES {
                    largest[lane] = (response[lane].abs() * weights[lane]).max(largest[lane]);
                }
            }
            *flexibility = largest.into_iter().fold(*flexibility, f64::max);
        }
    }

    /// Returns the largest displacement of any member of some groups per reaction, divided by its
    /// norm.
    pub fn flexibility(&self, groups: &[usize]) -> f64 {
        groups.iter().map(|&g| self.groups[g].flexibility).fold(0.0, f64::max)
    }

    /// Follows the loads and obstacles for some groups.
    pub fn follow(&mut self, groups: &[usize], limits: &Limits) {
        for &g in groups {
            let Group { members, weights, lower, upper, has_upper, .. } = &mut self.groups[g];
            for (k, &i) in members.iter().enumerate() {
                let shift = limits.shift[i];
                [lower[k], upper[k]] = match weights[k] > 0.0 {
                    true => [limits.lower[i] - shift, limits.upper[i] - shift],
                    false => [f64::NEG_INFINITY, f64::INFINITY],
                };
            }
            *has_upper = upper.iter().any(|upper| upper.is_finite());
        }
    }

    /// Returns the largest rest of a member of a group, divided by the norm of its row, and the
    /// largest share of the other than the lowest modes.
    pub fn rests(&self, g: usize) -> [f64; 2] {
        [self.groups[g].rest, self.groups[g].tail]
    }

    /// Returns the least slack in a group, without rests, in a motion with given coefficients of 1,
    /// t and t^2 of all modes or of the lowest ones, between 0 and `end` (s), under acting
    /// reactions (N), each after the displacements that it causes, see [`Self::yield_to`]. `slacks`
    /// takes that of each member.
    #[inline(always)]
    pub fn slack(
        &self,
        g: usize,
        motion: [&[f64]; 3],
        end: f64,
        acting: &[(&[f64], f64)],
        slacks: &mut Slacks,
    ) -> f64 {
        let Group { start, rank, rows, coefficients, scales, lower, upper, has_upper, .. } = &self.groups[g];
        let (count, modes) = (self.frequencies.len(), motion[0].len());
        let motion = motion.map(|coefficients| &coefficients[..modes]);
        let Slacks { factors, of_members } = slacks;
        for block in 0..rank.div_ceil(LANES) {
            let rows = &rows[LANES * count * block..];
            let mut sums = [[0.0; LANES]; 3];
            for (k, row) in rows.as_chunks::<LANES>().0[..modes].iter().enumerate() {
                accumulate(&mut sums, row, motion.map(|coefficients| coefficients[k]));
            }
            for (factors, sums) in factors.iter_mut().zip(sums) {
                factors[LANES * block..LANES * (block + 1)].copy_from_slice(&sums);
            }
        }
        let mut least_slack = f64::INFINITY;
        for block in 0..scales.len() / LANES {
            let rows = coefficients[LANES * rank * block..].as_chunks::<LANES>().0;
            let mut sums = [[0.0; LANES]; 3];
            for (j, row) in rows[..*rank].iter().enumerate() {
                accumulate(&mut sums, row, [factors[0][j], factors[1][j], factors[2][j]]);
            }
            let members = LANES * block..LANES * (block + 1);
            let [mut y, rate, curve] = sums;
            for (response, r) in acting {
                let response = &response[start + members.start..start + members.end];
                for lane in 0..LANES {
                    y[lane] += r * response[lane];
                }
            }
            let [scales, lower, upper] = [scales, lower, upper].map(|values| &values[members.clone()]);
            let slacks = &mut of_members[members];
            for lane in 0..LANES {
                slacks[lane] = least([y[lane] - lower[lane], rate[lane], curve[lane]], end);
            }
            if *has_upper {
                for lane in 0..LANES {
                    let above = least([upper[lane] - y[lane], -rate[lane], -curve[lane]], end);
                    slacks[lane] = slacks[lane].min(above);
                }
            }
            for lane in 0..LANES {
                slacks[lane] *= scales[lane];
                least_slack = least_slack.min(slacks[lane]);
            }
        }
        least_slack
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
        let [whole, high] =
            [0, 1].map(|part| points.map(|point| size(point)[part]).into_iter().fold(0.0, f64::max));
        [whole, high]
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
        let (mut basis, mut coefficients): (Vec<f64>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
        let arch = Arch::new();
        while coefficients.len() < count {
            let farthest = (0..count).max_by(|&a, &b| norms[a].total_cmp(&norms[b])).unwrap_or(0);
            if norms[farthest] <= enough {
                break;
            }
            let row: Vec<f64> =
                rests.col_as_slice(farthest).iter().map(|rest| rest / norms[farthest]).collect();
            let mut factors = vec![0.0; count];
            widest(
                arch,
                #[inline(always)]
                || {
                    for j in 0..count {
                        let rest = rests.col_as_slice_mut(j);
                        factors[j] = dot(&row, rest);
                        rest.iter_mut().zip(&row).for_each(|(rest, row)| *rest -= factors[j] * row);
                        norms[j] = dot(rest, rest).sqrt();
                    }
                },
            );
            basis.extend(row.iter().zip(frequencies).map(|(row, frequency)| row * frequency));
            coefficients.push(factors);
        }
        let largest = |share: &dyn Fn(usize) -> f64| {
            (0..count).map(|j| share(j) / sizes[members[j]]).fold(0.0, f64::max)
        };
        let rest = |j: usize| norms[j] + rounding[j];
        let scales = filled(members.iter().map(|&i| 1.0 / sizes[i]), 1.0);
        Group {
            rest: largest(&rest),
            tail: largest(&|j| tails[j] + rest(j)),
            rows: by_lanes(coefficients.len(), modes, |j, k| basis[j * modes + k]),
            coefficients: by_lanes(count, coefficients.len(), |m, j| coefficients[j][m]),
            rank: coefficients.len(),
            weights: scales.clone(),
            scales,
            lower: filled((0..count).map(|_| f64::NEG_INFINITY), f64::NEG_INFINITY),
            upper: filled((0..count).map(|_| f64::INFINITY), f64::INFINITY),
            has_upper: false,
            flexibility: 0.0,
            start: 0,
            members,
        }
    }
}

/// Adds a row times three factors to three sums.
#[inline(always)]
fn accumulate(sums: &mut [[f64; LANES]; 3], row: &[f64; LANES], factors: [f64; 3]) {
    for (sums, factor) in sums.iter_mut().zip(factors) {
        for lane in 0..LANES {
            sums[lane] += factor * row[lane];
        }
    }
}

/// Arranges the entries of a matrix by lanes: of each [`LANES`] rows, the last of which are filled
/// with zeros, one column after the other.
fn by_lanes(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let mut entries = Vec::with_capacity(rows.next_multiple_of(LANES) * columns);
    for start in (0..rows).step_by(LANES) {
        for column in 0..columns {
            let lane = |row| if row < rows { entry(row, column) } else { 0.0 };
            entries.extend((start..start + LANES).map(lane));
        }
    }
    entries
}

/// Returns values with a rest of their last lanes.
fn filled(values: impl Iterator<Item = f64>, rest: f64) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.resize(values.len().next_multiple_of(LANES), rest);
    values
}

/// Divides dofs into groups by halves, each time along the mode whose deflections, in terms of
/// energy, differ most, and passes on the ascending members of each.
fn divide(shapes: &Mat<f64>, frequencies: &[f64], bounds: &mut [usize], add: &mut dyn FnMut(Vec<usize>)) {
    if bounds.len() <= LARGEST {
        if !bounds.is_empty() {
            bounds.sort_unstable();
            add(bounds.to_vec());
        }
        return;
    }
    let extent = |k: usize| {
        let values = bounds.iter().map(|&i| shapes[(k, i)]);
        let [least, most] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], value| {
            [value.min(least), value.max(most)]
        });
        (most - least) / frequencies[k]
    };
    let extents: Vec<f64> = (0..frequencies.len().min(GUIDES)).map(extent).collect();
    let guide = (0..extents.len()).max_by(|&a, &b| extents[a].total_cmp(&extents[b])).unwrap_or(0);
    let middle = bounds.len() / 2;
    bounds.select_nth_unstable_by(middle, |&a, &b| {
        shapes[(guide, a)].total_cmp(&shapes[(guide, b)]).then(a.cmp(&b))
    });
    let (left, right) = bounds.split_at_mut(middle);
    divide(shapes, frequencies, left, add);
    divide(shapes, frequencies, right, add);
}

#[cfg(test)]
mod tests {
    use super::super::forecast::distance;
    use super::*;
    use crate::kernels::lanes::{dots, norm};

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
        assert!(groups.count() >= 400 / LARGEST && groups.groups.iter().all(|group| group.rank <= 10));
        let lower: Vec<f64> = (0..400).map(|i| -1.0 - 0.3 * place(i)[0]).collect();
        let shift: Vec<f64> = (0..400).map(|i| 1e-2 * place(i)[1]).collect();
        let limits = Limits { shift, lower, upper: vec![2.0; 400] };
        let numbers: Vec<usize> = (0..groups.count()).collect();
        groups.follow(&numbers, &limits);
        for seed in 0..20 {
            let of_mode = |k: usize, scale: f64| scale * ((7 * k + seed) as f64 * 1.7).sin() / (1 + k) as f64;
            let motion =
                [0.5, 20.0, 300.0].map(|scale| (0..12).map(|k| of_mode(k, scale)).collect::<Vec<_>>());
            let motion = motion.each_ref().map(|coefficients| &**coefficients);
            let [most, high] = groups.largest_roots_of_energy(motion, 0.02);
            let mut slacks = Slacks::new();
            for g in 0..groups.count() {
                let slack = |(_, i): (usize, usize)| {
                    let mut y = dots(shapes.col_as_slice(i), motion);
                    y[0] += limits.shift[i];
                    distance(y, &limits, i, 0.02) / sizes[i]
                };
                let slack = groups.members(g).map(slack).fold(f64::INFINITY, f64::min);
                let [rest, tail] = groups.rests(g);
                let bound = groups.slack(g, motion, 0.02, &[], &mut slacks) - rest * most;
                let low = motion.map(|coefficients| &coefficients[..groups.head]);
                let rough = groups.slack(g, low, 0.02, &[], &mut slacks) - rest * most - tail * high;
                assert!(rough <= slack, "{g}: {rough} > {slack}");
                assert!(bound <= slack, "{g}: {bound} > {slack}");
                assert!(bound >= slack - 2.0 * rest * most, "{g}: {bound}, far below {slack}");
            }
        }
    }
}
