//! Reach of the bounded nodes that are no candidates for contact.
//!
//! Only candidates enter the contact problem; a certificate proves that no other node touches. The
//! nodes are divided into *tiers*: all of them, the quarter with the least slack, a quarter of
//! these, and so on to some tens of nodes. Each tier has its own certificate for its nodes outside
//! the next tier. The large tiers are far from their obstacles and are checked rarely; those that
//! are checked often are small.
//!
//! A check of a tier approximates the free motion of the modes over a horizon T by the polynomial
//! p(t) of a [forecast](super::forecast), with a bound e of the error, and evaluates
//! `$y_i = \Phi_i\, p(t) + H_i r_0$` at its nodes, with their rows of the mode shapes and of the
//! displacements H per reaction. Until the horizon, no node touches as long as
//!
//! ```math
//! |q - p(t)| + c\, |r - r_0|_1 \le \min_i \min_{t \le T} g_i(t) / |\Phi_i|, \qquad
//!    c = \max_{ik} |H_{ik}| / |\Phi_i| ,
//! ```
//!
//! with the distances g of y from the obstacles; the right-hand side is the *radius*. In free
//! flight under constant data the left-hand side is at most e, so that such a tier needs no test
//! before its horizon. Once a reaction acts, the left-hand side is computed after each step, at as
//! many operations as there are modes. Beyond the radius or the horizon, a new check of the tier
//! and of all smaller ones follows. Horizons double, as long as twice the error e remains below the
//! radius. At the shortest horizon, nodes that would keep the radius below the change of the next
//! steps become candidates. Tiers of many nodes are evaluated by [groups](super::groups) of
//! neighbours, whose bounds take the place of the distances.

use super::contact_model::ContactModel;
use super::forecast::{Forecast, distance};
use super::groups::Groups;
use super::limits::Limits;
use super::products::{dot, dots, norm, sum};
use super::state::State;
use crate::archive::Archive;
use crate::error::Result;
use faer::Mat;
use pulp::Arch;

/// Time in which nodes come near, in steps of the longest length that resolves the fastest mode.
const NEAR: f64 = 2.0;
/// Shortest horizon in such steps, and the number of horizons, each twice the last.
const SHORTEST: f64 = 4.0;
const LEVELS: usize = 14;
/// Share of a tier's nodes outside the next tier is 1 - 1 / `RATIO`; a tier of at most `SMALLEST`
/// nodes is the last.
const RATIO: usize = 4;
const SMALLEST: usize = 32;
/// Number of nodes above which a tier takes no reactions as reference: their displacements would
/// cost more than those by the modes, and are small far from contact.
const LARGE: usize = 4096;
/// Share of the radius that the error of a forecast may take.
const SHARE: f64 = 0.5;
/// Number of nodes from which on a tier is evaluated by groups.
const GROUPED: usize = 1024;
/// Rounding errors of a deflection, relative to that of all modes together.
pub(super) const ROUNDING: f64 = 1e-12;

/// Nodes out of reach; see the [module page](self).
#[derive(Debug)]
pub(super) struct Reach {
    /// Mode shapes at all bounds, one column each, with their norms.
    pub shapes: Mat<f64>,
    pub sizes: Vec<f64>,
    groups: Groups,
    /// Largest displacement per reaction of any candidate, divided by the norm, one entry per
    /// bound.
    flexibilities: Vec<f64>,
    pub forecasts: Vec<Forecast>,
    /// Step, in s, that horizons are measured in.
    pub step: f64,
    /// Whether loads and obstacles are constant.
    is_constant: bool,
    /// Time of the present state since the start, in s.
    pub elapsed: f64,
    /// Bounds that are no candidates, those of each tier followed by those of the next.
    nodes: Vec<usize>,
    tiers: Vec<Tier>,
    /// Earliest end of a certificate, if none needs a test before.
    until: Option<f64>,
    /// Work space: least distance divided by the norm, or a lower bound of it, one entry per bound.
    slacks: Vec<f64>,
    arch: Arch,
}

/// Certificate for the nodes of a tier outside the next one.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
struct Tier {
    /// Index of its first node.
    start: usize,
    /// Index of its horizon, and time of its last check, in s.
    level: usize,
    since: f64,
    /// Coefficients of 1, t and t^2 of the modes.
    motion: [Vec<f64>; 3],
    /// Reactions at the check, one entry per candidate; empty for none.
    reaction: Vec<f64>,
    /// Shifts and bounds of all bounds at the check; empty where they are constant.
    limits: Limits,
    radius: f64,
    /// Weight c of the reactions.
    weight: f64,
    /// Whether the modes have moved freely since the check.
    is_free: bool,
}

/// State that a check evaluates, with the acceleration of its modes.
pub(super) struct Check<'a> {
    pub model: &'a ContactModel,
    pub state: &'a State,
    /// Pull h - w^2 q on the modes, without reactions.
    pub pull: Vec<f64>,
    /// Norm of the acceleration, with reactions.
    pub acceleration: f64,
}

/// Result of a check.
#[derive(Default)]
pub(super) struct Finding {
    /// Nodes that come near, ascending indices of bounds.
    pub near: Vec<usize>,
    /// Whether some of them may be beyond their obstacle.
    pub is_late: bool,
}

impl Reach {
    /// Creates the reach of all bounds, given the mode shapes there in columns, for steps of at
    /// most `step` seconds.
    pub fn new(shapes: Mat<f64>, [squares, decays]: [&[f64]; 2], step: f64, is_constant: bool) -> Reach {
        let count = shapes.ncols();
        let horizon = |level: usize| SHORTEST * step * f64::exp2(level as f64);
        let sizes: Vec<f64> = (0..count).map(|i| shapes.col(i).norm_l2()).collect();
        Reach {
            groups: Groups::new(&shapes, &sizes, squares),
            sizes,
            shapes,
            flexibilities: vec![0.0; count],
            forecasts: (0..LEVELS).map(|level| Forecast::new(squares, decays, horizon(level))).collect(),
            step,
            is_constant,
            elapsed: 0.0,
            nodes: (0..count).collect(),
            tiers: Vec::new(),
            until: None,
            slacks: vec![0.0; count],
            arch: Arch::new(),
        }
    }

    /// Advances to a state `seconds` after the last one. Returns the first tier that needs a check.
    /// Between the two states the modes have moved freely or not.
    pub fn advance(&mut self, state: &State, seconds: f64, is_free: bool) -> Option<usize> {
        self.elapsed += seconds;
        if !is_free {
            self.until = None;
            self.tiers.iter_mut().for_each(|tier| tier.is_free = false);
        }
        match self.until {
            Some(until) if self.elapsed <= until => None,
            _ => (0..self.tiers.len()).find(|&tier| !self.holds(tier, state)),
        }
    }

    /// Returns to the state before, `seconds` earlier, after a check of a tier: its certificate and
    /// those of all smaller ones begin later and do not hold.
    pub fn retreat(&mut self, seconds: f64, tier: usize) {
        self.elapsed -= seconds;
        self.until = None;
        self.tiers.iter_mut().skip(tier).for_each(|tier| tier.since = f64::NEG_INFINITY);
    }

    /// Returns whether the certificate of a tier holds for the present state.
    fn holds(&self, index: usize, state: &State) -> bool {
        let tier = &self.tiers[index];
        let t = self.elapsed - tier.since;
        if t.is_nan() || t > self.forecasts[tier.level].seconds {
            return false;
        }
        if tier.is_free {
            return true;
        }
        let [a, b, c] = tier.motion.each_ref().map(|of| &of[..state.q.len()]);
        let q = &state.q;
        let strayed = self.arch.dispatch(
            #[inline(always)]
            || sum(q.len(), |k| (q[k] - (a[k] + t * (b[k] + t * c[k]))).powi(2)),
        );
        let moved = |k: usize, r: f64| (r - tier.reaction.get(k).unwrap_or(&0.0)).abs();
        let changed: f64 = state.reaction.iter().enumerate().map(|(k, r)| moved(k, *r)).sum();
        strayed.sqrt() + tier.weight * changed + self.closing(index, state) <= tier.radius
    }

    /// Returns the indices in `nodes` of the nodes of a tier outside the next one.
    fn own(&self, tier: usize) -> std::ops::Range<usize> {
        self.tiers[tier].start..self.tiers.get(tier + 1).map_or(self.nodes.len(), |next| next.start)
    }

    /// Returns the largest approach of nodes and obstacles of a tier by loads and motions of
    /// obstacles since its check, divided by the norm.
    fn closing(&self, tier: usize, state: &State) -> f64 {
        if self.is_constant {
            return 0.0;
        }
        let (from, to) = (&self.tiers[tier].limits, &state.data.all);
        let closing = |&i: &usize| {
            let shift = to.shift[i] - from.shift[i];
            let both = [to.lower[i] - from.lower[i] - shift, from.upper[i] - to.upper[i] + shift];
            // Absent obstacles have infinite bounds.
            both.into_iter().filter(|c| c.is_finite()).fold(0.0, f64::max) / self.sizes[i]
        };
        self.nodes[self.own(tier)].iter().map(closing).fold(0.0, f64::max)
    }

    /// Checks a tier and all smaller ones at the present state.
    pub fn check(&mut self, first: usize, check: &Check) -> Finding {
        let mut finding = Finding::default();
        let mut start = self.tiers.get(first).map_or(0, |tier| tier.start);
        for index in first.. {
            if index == self.tiers.len() {
                let level = if index == 0 { LEVELS - 1 } else { self.tiers[index - 1].level };
                self.tiers.push(Tier { level, since: self.elapsed, ..Tier::default() });
            }
            let mut tier = std::mem::take(&mut self.tiers[index]);
            tier.start = start;
            let inner = self.renew(&mut tier, check, &mut finding);
            self.tiers[index] = tier;
            start = self.nodes.len() - inner;
            if inner == 0 {
                self.tiers.truncate(index + 1);
                break;
            }
        }
        let end = |tier: &Tier| tier.since + self.forecasts[tier.level].seconds;
        let all_free = self.tiers.iter().all(|tier| tier.is_free);
        self.until = all_free.then(|| self.tiers.iter().map(end).fold(f64::INFINITY, f64::min));
        finding.near.sort_unstable();
        finding
    }

    /// Renews the certificate of a tier, and sorts the nodes of the next tier to the end. Returns
    /// their number.
    fn renew(&mut self, tier: &mut Tier, check: &Check, finding: &mut Finding) -> usize {
        let Check { state, pull, .. } = check;
        let size = self.nodes.len() - tier.start;
        let inner = if size > SMALLEST { size / RATIO } else { 0 };
        let rounding = ROUNDING * norm(&state.q);
        let errors: Vec<f64> =
            self.forecasts.iter().map(|of| (of.error(&state.v, pull) + rounding) / SHARE).collect();
        let near_time = NEAR * self.step;
        let near = (0.5 * check.acceleration * near_time * near_time).max(errors[0]);
        tier.level = self.next_level(tier.level, tier.since);
        loop {
            tier.reaction.clear();
            if size <= LARGE || tier.level == 0 {
                tier.reaction.extend_from_slice(&state.reaction);
            }
            self.forecasts[tier.level].motion(&state.q, &state.v, pull, &mut tier.motion);
            // Only nodes that may come near need their own slacks.
            self.evaluate(tier, check, if tier.level == 0 { near } else { f64::NEG_INFINITY });
            tier.radius = self.divide(tier.start, inner);
            if tier.radius >= errors[tier.level] || tier.level == 0 {
                break;
            }
            // A node that touches before the horizon tells nothing of shorter ones.
            let shorter = errors[..tier.level].iter().rposition(|error| *error <= tier.radius);
            tier.level = shorter.unwrap_or(tier.level.saturating_sub(2));
        }
        if tier.level == 0 {
            self.find_near(tier, inner, near, check, finding);
        }
        tier.since = self.elapsed;
        tier.is_free = self.is_constant && !state.touches();
        if !self.is_constant {
            tier.limits.clone_from(&state.data.all);
        }
        let own = &self.nodes[tier.start..self.nodes.len() - inner];
        tier.weight = own.iter().map(|&i| self.flexibilities[i]).fold(0.0, f64::max);
        inner
    }

    /// Returns the longest horizon to try after that of a level, checked at an instant (s): about
    /// twice the time that it lasted.
    pub fn next_level(&self, level: usize, since: f64) -> usize {
        let lasted = self.elapsed - since;
        if lasted == 0.0 {
            return level;
        }
        let longer = self.forecasts.partition_point(|of| of.seconds <= 2.0 * lasted);
        longer.min(level + 1).min(LEVELS - 1)
    }

    /// Computes the slacks of the nodes of a tier over its horizon; for the nodes of a large tier,
    /// lower bounds of them, unless these do not exceed `enough`.
    fn evaluate(&mut self, tier: &Tier, check: &Check, enough: f64) {
        let Reach { nodes, shapes, slacks, sizes, groups, flexibilities, .. } = self;
        let nodes = &nodes[tier.start..];
        let end = self.forecasts[tier.level].seconds;
        let motion = tier.motion.each_ref().map(|of| &**of);
        let limits = &check.state.data.all;
        let acting: Vec<(f64, &[f64])> = tier
            .reaction
            .iter()
            .enumerate()
            .filter(|(_, r)| **r != 0.0)
            .map(|(k, r)| (*r, &*check.model.at_bounds[k]))
            .collect();
        let pressure: f64 = acting.iter().map(|(r, _)| r.abs()).sum();
        let by_groups = nodes.len() >= GROUPED;
        self.arch.dispatch(
            #[inline(always)]
            || {
                if by_groups {
                    groups.begin(motion, end);
                }
                for &i in nodes {
                    if by_groups {
                        slacks[i] = groups.slack(i, motion, limits) - flexibilities[i] * pressure;
                    }
                    if by_groups && slacks[i] > enough {
                        continue;
                    }
                    let mut y = dots(shapes.col_as_slice(i), motion);
                    y[0] += limits.shift[i];
                    y[0] += acting.iter().map(|(r, column)| r * column[i]).sum::<f64>();
                    slacks[i] = distance(y, limits, i, end) / sizes[i];
                }
            },
        );
    }

    /// Sorts the given number of nodes with the least slack to the end. Returns the least slack of
    /// the others of those from `start` on.
    fn divide(&mut self, start: usize, inner: usize) -> f64 {
        let slacks = &self.slacks;
        let nodes = &mut self.nodes[start..];
        let own = nodes.len() - inner;
        if inner == 0 || own == 0 {
            return nodes.iter().map(|&i| slacks[i]).fold(f64::INFINITY, f64::min);
        }
        let (_, last, _) = nodes.select_nth_unstable_by(own - 1, |&a, &b| slacks[b].total_cmp(&slacks[a]));
        slacks[*last]
    }

    /// Finds the nodes of a tier outside the next one whose slack is too small, and sets the radius
    /// to that of the others.
    fn find_near(&self, tier: &mut Tier, inner: usize, most: f64, check: &Check, finding: &mut Finding) {
        tier.radius = f64::INFINITY;
        let Check { model, state, .. } = check;
        let limits = &state.data.all;
        for &i in &self.nodes[tier.start..self.nodes.len() - inner] {
            let slack = self.slacks[i];
            if slack > most {
                tier.radius = tier.radius.min(slack);
                continue;
            }
            finding.near.push(i);
            let mut y = limits.shift[i] + dot(self.shapes.col_as_slice(i), &state.q);
            for (k, r) in state.reaction.iter().enumerate() {
                y += r * model.at_bounds[k][i];
            }
            finding.is_late |= y < limits.lower[i] || y > limits.upper[i];
        }
    }

    /// Removes nodes that have become candidates, ascending indices of bounds, beside the `old`
    /// candidates.
    pub fn remove(&mut self, model: &ContactModel, old: &[usize], near: &[usize]) {
        let is_near = |i: &usize| near.binary_search(i).is_ok();
        for tier in &mut self.tiers {
            tier.start -= self.nodes[..tier.start].iter().filter(|i| is_near(i)).count();
            if !tier.reaction.is_empty() {
                let known = |i| old.binary_search(i).map_or(0.0, |k| tier.reaction[k]);
                tier.reaction = model.candidates.iter().map(known).collect();
            }
        }
        self.nodes.retain(|i| !is_near(i));
        for k in near.iter().filter_map(|i| model.candidates.binary_search(i).ok()) {
            let column = &model.at_bounds[k];
            for &i in &self.nodes {
                let flexibility = column[i].abs() / self.sizes[i];
                self.flexibilities[i] = self.flexibilities[i].max(flexibility);
            }
        }
        for index in 0..self.tiers.len() {
            let own = self.nodes[self.own(index)].iter();
            self.tiers[index].weight = own.map(|&i| self.flexibilities[i]).fold(0.0, f64::max);
        }
    }

    /// Forgets the candidates: any node may touch.
    pub fn forget(&mut self) {
        self.nodes = (0..self.sizes.len()).collect();
        self.flexibilities.fill(0.0);
        self.renew_all();
    }

    /// Forgets the certificates, so that all must be renewed.
    pub fn renew_all(&mut self) {
        self.tiers.clear();
        self.until = None;
    }

    /// Saves or restores the certificates. What else there is follows from the candidates.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.elapsed)?;
        archive.value(&mut self.nodes)?;
        archive.value(&mut self.until)?;
        archive.value(&mut self.tiers)
    }
}
