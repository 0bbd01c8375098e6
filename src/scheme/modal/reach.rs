//! Reach of the bounded nodes that are no candidates for contact.
//!
//! Only candidates enter the contact problem; a certificate proves that no other node touches. The
//! [groups](super::groups) of neighbouring nodes are divided into *tiers*: all of them, the quarter
//! with the least slack, a quarter of these, and so on to a few groups. Each tier has its own
//! certificate for its groups outside the next tier. The large tiers are far from their obstacles
//! and are checked rarely; those that are checked often are small.
//!
//! A check of a tier approximates the free motion of the modes over a horizon T by the polynomial
//! p(t) of a [forecast](super::forecast), with a bound e of the error. The deflections are
//! `$y_i = \Phi_i\, p(t) + H_i r_0$`, with the rows of the mode shapes and of the displacements H
//! per reaction. Until the horizon, no node touches as long as
//!
//! ```math
//! |q - p(t)| + c\, |r - r_0|_1 \le \min_i \min_{t \le T} g_i(t) / |\Phi_i|, \qquad
//!    c = \max_{ik} |H_{ik}| / |\Phi_i| ,
//! ```
//!
//! with the distances g of y from the obstacles; the right-hand side is the *radius*. A bound for
//! each group suffices, unless it is too small: then those nodes of the group are evaluated whose
//! own bounds are too small. In free flight under constant data the left-hand side is at most e, so
//! that such a tier needs no test before its horizon. Once a reaction acts, the left-hand side is
//! computed after each step, at as many operations as there are modes. Beyond the radius or the
//! horizon, a new check of the tier and of all smaller ones follows. Horizons double, as long as
//! twice the error e remains below the radius. At the shortest horizon, nodes that would keep the
//! radius below the change of the next steps become candidates.

mod slacks;

use super::contact_model::{BoundRows, ContactModel};
use super::forecast::Forecast;
use super::groups::Groups;
use super::limits::Limits;
use super::state::State;
use crate::archive::Archive;
use crate::error::Result;
use crate::kernels::lanes::{norm, sum};
use crate::kernels::wide::widest;
use faer::Mat;
use pulp::Arch;

/// Time in which nodes come near, in steps of the longest length that resolves the fastest mode.
const NEAR: f64 = 2.0;
/// Shortest horizon in such steps, and the number of horizons, each twice the last.
const SHORTEST: f64 = 4.0;
const LEVELS: usize = 14;
/// Share of a tier's groups outside the next tier is 1 - 1 / `RATIO`; a tier of at most `SMALLEST`
/// groups is the last.
const RATIO: usize = 4;
const SMALLEST: usize = 4;
/// Number of groups above which a tier takes no reactions as reference: their displacements would
/// cost more than those by the modes, and are small far from contact.
const LARGE: usize = 400;
/// Share of the radius that the error of a forecast may take.
const SHARE: f64 = 0.5;
/// Bound of the slack of a group, divided by twice the error, below which its nodes are evaluated:
/// in free flight, where any radius above the error will do, and in contact.
const ENOUGH: [f64; 2] = [1.0, 2.0];
/// Rounding errors of a deflection, relative to that of all modes together.
pub(super) const ROUNDING: f64 = 1e-12;

/// Nodes out of reach; see the [module page](self).
#[derive(Debug)]
pub(super) struct Reach {
    /// Mode shapes at all bounds, one column each, with their norms.
    pub shapes: Mat<f64>,
    pub sizes: Vec<f64>,
    groups: Groups,
    pub forecasts: Vec<Forecast>,
    /// Step, in s, that horizons are measured in.
    pub step: f64,
    /// Whether loads and obstacles are constant.
    is_constant: bool,
    /// Time of the present state since the start, in s.
    pub elapsed: f64,
    /// Groups, those of each tier followed by those of the next.
    order: Vec<usize>,
    tiers: Vec<Tier>,
    /// Earliest end of a certificate, if none needs a test before.
    until: Option<f64>,
    /// Work space: least distance divided by the norm, or a lower bound of it, one entry per group;
    /// and that of nodes that were evaluated, one entry per bound.
    slacks: Vec<f64>,
    node_slacks: Vec<f64>,
    /// Largest errors of the slacks of the groups.
    errors: Vec<f64>,
    arch: Arch,
}

/// Certificate for the nodes of a tier's groups outside the next one.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
struct Tier {
    /// Index of its first group.
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
    /// Returns the mode shapes at all bounds, and the order in which the groups have them.
    pub fn rows(&self) -> BoundRows<'_> {
        BoundRows { shapes: &self.shapes, places: &self.groups.places, lanes: self.groups.lanes }
    }

    /// Creates the reach of all bounds, given the mode shapes there in columns, for steps of at
    /// most `step` seconds.
    pub fn new(shapes: Mat<f64>, [squares, decays]: [&[f64]; 2], step: f64, is_constant: bool) -> Reach {
        let count = shapes.ncols();
        let horizon = |level: usize| SHORTEST * step * f64::exp2(level as f64);
        let sizes: Vec<f64> = (0..count).map(|i| shapes.col(i).norm_l2()).collect();
        let groups = Groups::new(&shapes, &sizes, squares);
        Reach {
            order: (0..groups.count()).collect(),
            slacks: vec![0.0; groups.count()],
            node_slacks: vec![0.0; count],
            errors: vec![0.0; groups.count()],
            groups,
            sizes,
            shapes,
            forecasts: (0..LEVELS).map(|level| Forecast::new(squares, decays, horizon(level))).collect(),
            step,
            is_constant,
            elapsed: 0.0,
            tiers: Vec::new(),
            until: None,
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
        let [a, b, c] = tier.motion.each_ref().map(|coefficients| &coefficients[..state.q.len()]);
        let q = &state.q;
        let strayed = widest(
            self.arch,
            #[inline(always)]
            || sum(q.len(), |k| (q[k] - (a[k] + t * (b[k] + t * c[k]))).powi(2)),
        );
        let moved = |k: usize, r: f64| (r - tier.reaction.get(k).unwrap_or(&0.0)).abs();
        let changed: f64 = state.reaction.iter().enumerate().map(|(k, r)| moved(k, *r)).sum();
        strayed.sqrt() + tier.weight * changed + self.closing(index, state) <= tier.radius
    }

    /// Returns the groups of a tier outside the next one.
    fn own(&self, tier: usize) -> &[usize] {
        let end = self.tiers.get(tier + 1).map_or(self.order.len(), |next| next.start);
        &self.order[self.tiers[tier].start..end]
    }

    /// Returns the largest approach of nodes and obstacles of a tier by loads and motions of
    /// obstacles since its check, divided by the norm.
    fn closing(&self, tier: usize, state: &State) -> f64 {
        if self.is_constant {
            return 0.0;
        }
        let (from, to) = (&self.tiers[tier].limits, &state.data.all);
        let closing = |(_, i): (usize, usize)| {
            let shift = to.shift[i] - from.shift[i];
            let both = [to.lower[i] - from.lower[i] - shift, from.upper[i] - to.upper[i] + shift];
            // Absent obstacles have infinite bounds.
            both.into_iter().filter(|c| c.is_finite()).fold(0.0, f64::max) / self.sizes[i]
        };
        let nodes = self.own(tier).iter().flat_map(|&g| self.groups.members(g));
        nodes.map(closing).fold(0.0, f64::max)
    }

    /// Checks a tier and all smaller ones at the present state.
    pub fn check(&mut self, first: usize, check: &Check) -> Finding {
        let mut finding = Finding::default();
        let Check { state, pull, .. } = check;
        let rounding = ROUNDING * norm(&state.q);
        // No tier takes a longer horizon than one after its last, or than that of the tier before.
        let longest = self.tiers.iter().skip(first.saturating_sub(1)).map(|tier| tier.level + 2).max();
        let levels = if first == 0 { LEVELS } else { longest.unwrap_or(LEVELS).min(LEVELS) };
        let error = |forecast: &Forecast| (forecast.error(&state.v, pull) + rounding) / SHARE;
        let errors: Vec<f64> = self.forecasts[..levels].iter().map(error).collect();
        let mut start = self.tiers.get(first).map_or(0, |tier| tier.start);
        for index in first.. {
            if index == self.tiers.len() {
                let level = if index == 0 { LEVELS - 1 } else { self.tiers[index - 1].level };
                self.tiers.push(Tier { level, since: self.elapsed, ..Tier::default() });
            }
            let mut tier = std::mem::take(&mut self.tiers[index]);
            tier.start = start;
            let inner = self.renew(&mut tier, check, &errors, &mut finding);
            self.tiers[index] = tier;
            start = self.order.len() - inner;
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

    /// Renews the certificate of a tier, given twice the errors of all horizons, and sorts the
    /// groups of the next tier to the end. Returns their number.
    fn renew(&mut self, tier: &mut Tier, check: &Check, errors: &[f64], finding: &mut Finding) -> usize {
        let Check { state, pull, .. } = check;
        let size = self.order.len() - tier.start;
        let inner = if size > SMALLEST { size / RATIO } else { 0 };
        let near_time = NEAR * self.step;
        let near = (0.5 * check.acceleration * near_time * near_time).max(errors[0]);
        tier.is_free = self.is_constant && !state.touches();
        if tier.start == 0 || !self.is_constant {
            self.groups.follow(&self.order[tier.start..], &state.data.all);
        }
        tier.level = self.next_level(tier.level, tier.since);
        loop {
            tier.reaction.clear();
            if size <= LARGE || tier.level == 0 {
                tier.reaction.extend_from_slice(&state.reaction);
            }
            self.forecasts[tier.level].motion(&state.q, &state.v, pull, &mut tier.motion);
            self.evaluate(tier);
            self.divide(tier.start, inner);
            let enough = ENOUGH[usize::from(!tier.is_free)] * errors[tier.level];
            self.sharpen(
                tier,
                inner,
                check,
                if tier.level == 0 { [near, near] } else { [errors[tier.level], enough] },
            );
            let outer = &self.order[tier.start..self.order.len() - inner];
            tier.radius = outer.iter().map(|&g| self.slacks[g]).fold(f64::INFINITY, f64::min);
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
        if !self.is_constant {
            tier.limits.clone_from(&state.data.all);
        }
        tier.weight = self.groups.flexibility(&self.order[tier.start..self.order.len() - inner]);
        inner
    }

    /// Returns the longest horizon to try after that of a level, checked at an instant (s): about
    /// twice the time that it lasted.
    pub fn next_level(&self, level: usize, since: f64) -> usize {
        let lasted = self.elapsed - since;
        if lasted == 0.0 {
            return level;
        }
        let longer = self.forecasts.partition_point(|forecast| forecast.seconds <= 2.0 * lasted);
        longer.min(level + 1).min(LEVELS - 1)
    }

    /// Removes nodes that have become candidates, ascending indices of bounds, beside the `old`
    /// candidates.
    pub fn remove(&mut self, model: &ContactModel, old: &[usize], near: &[usize]) {
        for tier in self.tiers.iter_mut().filter(|tier| !tier.reaction.is_empty()) {
            let reaction = |i| old.binary_search(i).map_or(0.0, |k| tier.reaction[k]);
            tier.reaction = model.candidates.iter().map(reaction).collect();
        }
        near.iter().for_each(|&i| self.groups.remove(i));
        for k in near.iter().filter_map(|i| model.candidates.binary_search(i).ok()) {
            self.groups.yield_to(&model.at_bounds[k]);
        }
        for index in 0..self.tiers.len() {
            self.tiers[index].weight = self.groups.flexibility(self.own(index));
        }
    }

    /// Forgets the candidates: any node may touch.
    pub fn forget(&mut self) {
        self.groups.restore();
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
        archive.value(&mut self.order)?;
        archive.value(&mut self.until)?;
        archive.value(&mut self.tiers)
    }
}
