//! Slacks of the groups of a tier over its horizon.

use super::super::forecast::distance;
use super::super::groups::Slacks;
use super::{Check, Finding, Reach, Tier};
use crate::kernels::lanes::{dot, dots};
use crate::kernels::wide::widest;

impl Reach {
    /// Computes bounds of the slacks of the groups of a tier over its horizon.
    pub(super) fn evaluate(&mut self, tier: &Tier) {
        let Reach { order, slacks, errors, groups, .. } = self;
        let end = self.forecasts[tier.level].seconds;
        let motion = tier.motion.each_ref().map(|coefficients| &**coefficients);
        let pressure: f64 = tier.reaction.iter().map(|r| r.abs()).sum();
        widest(
            self.arch,
            #[inline(always)]
            || {
                let [whole, high] = groups.largest_roots_of_energy(motion, end);
                let low = motion.map(|coefficients| &coefficients[..groups.head]);
                let mut work = Slacks::new();
                for &g in &order[tier.start..] {
                    let [rest, tail] = groups.rests(g);
                    errors[g] = rest * whole + tail * high + groups.flexibility(&[g]) * pressure;
                    slacks[g] = groups.slack(g, low, end, &[], &mut work) - errors[g];
                }
            },
        );
    }

    /// Computes the slacks of the groups of a tier outside the next one that do not exceed
    /// `enough`, unless they are certain not to reach `needed`. Of nodes whose bound of the slack
    /// exceeds `enough`, the bound serves.
    pub(super) fn sharpen(&mut self, tier: &Tier, inner: usize, check: &Check, [needed, enough]: [f64; 2]) {
        let Reach { order, shapes, slacks, node_slacks, errors, sizes, groups, .. } = self;
        let end = self.forecasts[tier.level].seconds;
        let motion = tier.motion.each_ref().map(|coefficients| &**coefficients);
        let limits = &check.state.data.all;
        let reactions = tier.reaction.iter().copied().enumerate();
        let pressing = reactions.filter(|(_, r)| *r != 0.0);
        let acting: Vec<(&[f64], f64)> = pressing.map(|(k, r)| (&*check.model.at_bounds[k], r)).collect();
        let is_known =
            |slack: f64, error: f64| slack > enough || tier.level > 0 && slack + 2.0 * error <= needed;
        widest(
            self.arch,
            #[inline(always)]
            || {
                let [whole, _] = groups.largest_roots_of_energy(motion, end);
                let mut work = Slacks::new();
                for &g in &order[tier.start..order.len() - inner] {
                    if is_known(slacks[g], errors[g]) {
                        continue;
                    }
                    let [rest, _] = groups.rests(g);
                    errors[g] = rest * whole;
                    slacks[g] = groups.slack(g, motion, end, &acting, &mut work) - errors[g];
                    if is_known(slacks[g], errors[g]) {
                        continue;
                    }
                    slacks[g] = f64::INFINITY;
                    for (m, i) in groups.members(g) {
                        node_slacks[i] = work.of_members[m] - errors[g];
                        if node_slacks[i] > enough {
                            slacks[g] = slacks[g].min(node_slacks[i]);
                            continue;
                        }
                        let mut y = dots(shapes.col_as_slice(i), motion);
                        y[0] += limits.shift[i];
                        y[0] +=
                            acting.iter().map(|(response, r)| r * response[groups.places[i]]).sum::<f64>();
                        node_slacks[i] = distance(y, limits, i, end) / sizes[i];
                        slacks[g] = slacks[g].min(node_slacks[i]);
                    }
                }
            },
        );
    }

    /// Sorts the given number of groups of those from `start` on with the least slack to the end.
    pub(super) fn divide(&mut self, start: usize, inner: usize) {
        let slacks = &self.slacks;
        let groups = &mut self.order[start..];
        let outer = groups.len() - inner;
        if inner > 0 && outer > 0 {
            groups.select_nth_unstable_by(outer - 1, |&a, &b| slacks[b].total_cmp(&slacks[a]));
        }
    }

    /// Finds the nodes of a tier's groups outside the next one whose slack is too small, and sets
    /// the radius to that of the others.
    pub(super) fn find_near(
        &self,
        tier: &mut Tier,
        inner: usize,
        most: f64,
        check: &Check,
        finding: &mut Finding,
    ) {
        tier.radius = f64::INFINITY;
        let Check { model, state, .. } = check;
        let limits = &state.data.all;
        for &g in &self.order[tier.start..self.order.len() - inner] {
            if self.slacks[g] > most {
                tier.radius = tier.radius.min(self.slacks[g]);
                continue;
            }
            for (_, i) in self.groups.members(g) {
                if self.node_slacks[i] > most {
                    tier.radius = tier.radius.min(self.node_slacks[i]);
                    continue;
                }
                finding.near.push(i);
                let mut y = limits.shift[i] + dot(self.shapes.col_as_slice(i), &state.q);
                for (k, r) in state.reaction.iter().enumerate() {
                    y += r * model.at_bounds[k][self.groups.places[i]];
                }
                finding.is_late |= y < limits.lower[i] || y > limits.upper[i];
            }
        }
    }
}
