//! Damped tips of compliant stops, for the conserving scheme of the modal mass.
//!
//! The tip of a stop of stiffness k and damping c has no mass. The reaction r at the tip, the
//! spring and the dashpot balance, with the elongation e from the tip to its node,
//!
//! ```math
//! c\, \dot e + k\, e = -r, \qquad \dot\lambda = -\frac{k}{c}\, \lambda + \frac{\dot r}{k}, \qquad
//! \lambda = e + \frac{r}{k} .
//! ```
//!
//! The tip lies by the lag `$\lambda$` below the tip of an undamped stop. Between two states the
//! reaction is linear in time, as the kicks of the modes have it. With the time s and x = k s / c
//! the lag is then known in closed form, at any ratio of s and c / k:
//!
//! ```math
//! \lambda^{n+1} = E\, \lambda^n + \varphi\, \frac{r^{n+1} - r^n}{k}, \qquad
//! E = e^{-x}, \qquad \varphi = \frac{1 - E}{x} .
//! ```
//!
//! The contact problem is therefore the undamped one with other deflections without reactions and a
//! compliance less `$\varphi / k$`. The spring stores `$\tfrac12 k\, e^2$`, and the dashpot takes
//!
//! ```math
//! \int c\, \dot e^2\, dt = k \Bigl( \tfrac12 (1 - E^2)\, (\lambda^n)^2
//!     + x \varphi^2\, \lambda^n \delta + \psi\, \delta^2 \Bigr), \qquad \delta = \frac{r^{n+1} - r^n}{k}, \qquad
//! \psi = \frac{1 - \varphi - \tfrac12 x \varphi^2}{x} .
//! ```
//!
//! The scheme keeps the sum of both and of the energy of the plate.

use super::all_bounds::AllBounds;
use super::contact_model::ContactModel;
use super::limits::Limits;
use super::state::State;
use crate::linalg::Engine;
use crate::scheme::{System, ViscousTip};
use crate::vi::{BoundStatus, ComplianceProblem, ComplianceSolver};

/// Damped tips among the candidates; see the [module page](self).
#[derive(Debug, Default)]
pub(super) struct ViscousTips {
    /// Stiffness k (N/m) and rate k / c (1/s) of each bound of all ranks, infinite without damping;
    /// empty where no stop is damped.
    every: Vec<[f64; 2]>,
    /// Index of the obstacle of each bound of all ranks.
    obstacles: Vec<usize>,
    /// Damped tips among the candidates.
    near: Vec<Tip>,
    /// Energy that the dashpots of each obstacle have taken, in J.
    pub taken: Vec<f64>,
}

/// Damped tip at the begin of a step.
#[derive(Debug, Clone, Copy)]
struct Tip {
    /// Index of the candidate.
    candidate: usize,
    /// Index of the obstacle.
    obstacle: usize,
    /// Stiffness k, in N/m, and rate k / c, in 1/s.
    stiffness: f64,
    rate: f64,
    /// Lag, in m.
    lag: f64,
    /// Reaction, in N.
    reaction: f64,
}

/// Factors E, phi and psi of a time.
struct Decay {
    remainder: f64,
    mean: f64,
    square: f64,
    x: f64,
}

impl Decay {
    fn new(x: f64) -> Decay {
        if x.is_infinite() {
            return Decay { remainder: 0.0, mean: 0.0, square: 0.0, x };
        }
        let (remainder, mean) = ((-x).exp(), if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 });
        let square = if x < 1.0 { series(x) } else { (1.0 - mean - 0.5 * x * mean * mean) / x };
        Decay { remainder, mean, square, x }
    }
}

/// Returns psi for x < 1, where its closed form cancels: the sum of
/// `$(-1)^{n+1}\, (2^{n-1} - 2)\, x^{n-2} / n!$` from n = 3.
fn series(x: f64) -> f64 {
    let (mut sum, mut power, mut term) = (0.0, 4.0, x / 6.0);
    for n in 4..40 {
        sum += (power - 2.0) * term;
        term *= -x / f64::from(n);
        power *= 2.0;
    }
    sum
}

impl Tip {
    /// Returns the lag under a reaction (N), in m, some time (s) after the step has begun.
    fn lag(&self, reaction: f64, seconds: f64) -> f64 {
        let Decay { remainder, mean, .. } = Decay::new(self.rate * seconds);
        remainder * self.lag + mean * self.change(reaction)
    }

    /// Returns the change of the reaction (N) over k, in m.
    fn change(&self, reaction: f64) -> f64 {
        (reaction - self.reaction) / self.stiffness
    }

    /// Returns the energy that the dashpot takes until the reaction (N) is another, in J.
    fn dissipated(&self, reaction: f64, seconds: f64) -> f64 {
        let Decay { remainder, mean, square, x } = Decay::new(self.rate * seconds);
        let (lag, change) = (self.lag, self.change(reaction));
        let cross = if x.is_finite() { x * mean * mean } else { 0.0 };
        self.stiffness
            * (0.5 * (1.0 - remainder * remainder) * lag * lag + (cross * lag + square * change) * change)
    }

    /// Returns the rates of the lag with the time (m/s) and of the energy of spring and dashpot
    /// (J, with the reaction r, as r e + F) with time and reaction.
    fn rates(&self, reaction: f64, seconds: f64) -> [f64; 3] {
        let Decay { remainder, mean, square, x } = Decay::new(self.rate * seconds);
        let (k, lag, change) = (self.stiffness, self.lag, self.change(reaction));
        let elongation = remainder * lag + mean * change - reaction / k;
        // Derivatives with respect to x.
        let lag_rate = -remainder * lag + (remainder - mean) / x * change;
        let taken = remainder * remainder * lag * lag
            + (2.0 * remainder * mean - mean * mean) * lag * change
            + (mean * mean - 2.0 * square / x) * change * change;
        let with_time = (reaction + k * elongation) * lag_rate + k * taken;
        let with_reaction =
            (reaction / k + elongation) * (mean - 1.0) + x * mean * mean * lag + 2.0 * square * change;
        [self.rate * lag_rate, self.rate * with_time, with_reaction]
    }
}

impl ViscousTips {
    /// Collects the damped tips of all ranks. Collective.
    pub fn new<E: Engine>(system: &System<E>, global: &AllBounds) -> ViscousTips {
        let Some(tips) = &system.drive.viscous_tips else { return ViscousTips::default() };
        let gather = |value: fn(&ViscousTip) -> f64| {
            let mut values = vec![f64::INFINITY; system.bounds.len()];
            tips.iter().for_each(|tip| values[tip.bound] = value(tip));
            global.gather(system.engine.comm(), values)
        };
        // Infinite numbers of bounds without dashpots are never asked for.
        let obstacles: Vec<usize> =
            gather(|tip| tip.obstacle as f64).into_iter().map(|k| k as usize).collect();
        let last = obstacles.iter().filter(|k| **k < usize::MAX).max();
        let stiffnesses = gather(|tip| tip.stiffness);
        let rates = gather(|tip| tip.stiffness / tip.damping);
        let every = stiffnesses.into_iter().zip(rates).map(|(stiffness, rate)| [stiffness, rate]).collect();
        ViscousTips { every, near: Vec::new(), taken: vec![0.0; last.map_or(0, |last| last + 1)], obstacles }
    }

    /// Returns whether any stop is damped.
    pub fn are_there(&self) -> bool {
        !self.every.is_empty()
    }

    /// Follows the candidates, ascending numbers of bounds, of which the `old` ones have lags in
    /// the states.
    pub fn extend(&mut self, candidates: &[usize], old: &[usize], states: [&mut State; 2]) {
        if !self.are_there() {
            return;
        }
        let tip = |(candidate, &number): (usize, &usize)| {
            let [stiffness, rate] = self.every[number];
            Tip { candidate, obstacle: self.obstacles[number], stiffness, rate, lag: 0.0, reaction: 0.0 }
        };
        self.near = candidates.iter().enumerate().map(tip).filter(|tip| tip.rate.is_finite()).collect();
        for State { lags, .. } in states {
            let lag = |number| old.binary_search(number).map_or(0.0, |k| lags[k]);
            *lags = candidates.iter().map(lag).collect();
        }
    }

    /// Begins a step from a state.
    pub fn begin(&mut self, before: &State) {
        for tip in &mut self.near {
            (tip.lag, tip.reaction) = (before.lags[tip.candidate], before.reaction[tip.candidate]);
        }
    }

    /// Moves the tips of a state in free flight, some time (s) after the step has begun.
    pub fn fly(&self, state: &mut State, seconds: f64) {
        for tip in &self.near {
            state.lags[tip.candidate] = tip.lag(0.0, seconds);
        }
    }

    /// Solves the contact problem of a state, given its deflections without reactions, some time
    /// (s) after the step has begun; an infinite time leads to equilibrium.
    pub fn solve(
        &self,
        contact: &mut ComplianceSolver,
        model: &ContactModel,
        state: &mut State,
        limits: &Limits,
        seconds: f64,
    ) {
        let State { y, x, reaction, lags, .. } = state;
        let Limits { lower, upper, .. } = limits;
        if self.near.is_empty() {
            return contact.solve(model.problem(y, lower, upper), x, reaction);
        }
        let (mut free, mut softness) = (y.clone(), vec![0.0; y.len()]);
        for tip in &self.near {
            free[tip.candidate] -= tip.lag(0.0, seconds);
            softness[tip.candidate] = -Decay::new(tip.rate * seconds).mean / tip.stiffness;
        }
        let problem = model.problem(&free, lower, upper);
        contact.solve(ComplianceProblem { softness: &softness, ..problem }, x, reaction);
        for tip @ &Tip { candidate, .. } in &self.near {
            lags[candidate] = tip.lag(reaction[candidate], seconds);
            match contact.sides[candidate] {
                BoundStatus::Free => {}
                BoundStatus::Lower => x[candidate] = lower[candidate],
                BoundStatus::Upper => x[candidate] = upper[candidate],
            }
        }
    }

    /// Returns the energy of the stops beyond `$\tfrac12 r\,(x - y)$`, in J.
    pub fn stored(&self, state: &State) -> f64 {
        let energy = |tip: &Tip| {
            let (lag, reaction) = (state.lags[tip.candidate], state.reaction[tip.candidate]);
            0.5 * lag * (tip.stiffness * lag - reaction)
        };
        self.near.iter().map(energy).sum()
    }

    /// Returns the energy that the dashpots take within some time (s) after the step has begun, in
    /// J, given the state then.
    pub fn dissipated(&self, state: &State, seconds: f64) -> f64 {
        self.near.iter().map(|tip| tip.dissipated(state.reaction[tip.candidate], seconds)).sum()
    }

    /// Adds the energy of [`ViscousTips::dissipated`] to the ledger, and returns it.
    pub fn take(&mut self, state: &State, seconds: f64) -> f64 {
        for tip in &self.near {
            self.taken[tip.obstacle] += tip.dissipated(state.reaction[tip.candidate], seconds);
        }
        self.dissipated(state, seconds)
    }

    /// Returns what the dashpots add to the derivative of the energy with respect to gamma, in J,
    /// in a step of `length` (s). The dofs in contact have the derivatives `rises` of bounds less
    /// deflections without reactions, in m.
    pub fn slope(
        &self,
        contact: &ComplianceSolver,
        state: &State,
        mut rises: Vec<f64>,
        length: f64,
        gamma: f64,
    ) -> f64 {
        let place = |tip: &Tip| contact.active.iter().position(|&dof| dof == tip.candidate);
        let rates = |tip: &Tip| tip.rates(state.reaction[tip.candidate], gamma * length);
        let tips: Vec<_> = self.near.iter().map(|tip| (place(tip), rates(tip))).collect();
        for (place, [lag, ..]) in &tips {
            place.iter().for_each(|&p| rises[p] += length * lag);
        }
        contact.solve_active(&mut rises);
        let slope = |&(place, [_, with_time, with_reaction]): &(Option<usize>, [f64; 3])| {
            length * with_time + place.map_or(0.0, |p| rises[p] * with_reaction)
        };
        tips.iter().map(slope).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIP: Tip = Tip { candidate: 0, obstacle: 0, stiffness: 3.0, rate: 7.0, lag: 0.02, reaction: 0.4 };

    /// Steps of Euler's scheme for the lag, and the energy that the dashpot takes meanwhile.
    fn in_small_steps(reaction: f64, seconds: f64) -> [f64; 2] {
        const STEPS: u32 = 200_000;
        let (dt, rise) = (seconds / f64::from(STEPS), TIP.change(reaction) / seconds);
        let (mut lag, mut taken) = (TIP.lag, 0.0);
        for _ in 0..STEPS {
            let middle = lag + 0.5 * dt * (rise - TIP.rate * lag);
            taken += dt * TIP.stiffness * TIP.rate * middle * middle;
            lag += dt * (rise - TIP.rate * middle);
        }
        [lag, taken]
    }

    #[test]
    fn lag_and_energy_are_those_of_many_small_steps() {
        for seconds in [1e-9, 1e-3, 0.14, 0.16, 3.0] {
            for reaction in [0.0, 0.4, 2.0] {
                let [lag, taken] = in_small_steps(reaction, seconds);
                let (exact, lost) = (TIP.lag(reaction, seconds), TIP.dissipated(reaction, seconds));
                assert!((lag - exact).abs() <= 1e-8 * (TIP.lag + exact.abs()), "{seconds}, {reaction}");
                assert!((taken - lost).abs() <= 1e-7 * lost, "{seconds}, {reaction}: {taken:e}, {lost:e}");
            }
        }
    }

    #[test]
    fn the_rates_are_those_of_differences() {
        let energy = |reaction: f64, seconds: f64| {
            let elongation = TIP.lag(reaction, seconds) - reaction / TIP.stiffness;
            0.5 * TIP.stiffness * elongation * elongation + TIP.dissipated(reaction, seconds)
        };
        for seconds in [0.01, 0.1, 1.0] {
            let (reaction, step) = (1.1, 1e-5);
            let elongation = |r: f64, s: f64| TIP.lag(r, s) - r / TIP.stiffness;
            let rate = |f: &dyn Fn(f64) -> f64| (f(step) - f(-step)) / (2.0 * step);
            let lag = rate(&|d| TIP.lag(reaction, seconds + d));
            let with_time = rate(&|d| energy(reaction, seconds + d)) + reaction * lag;
            let pushed = rate(&|d| elongation(reaction + d, seconds));
            let with_reaction = rate(&|d| energy(reaction + d, seconds)) + reaction * pushed;
            let differences = [lag, with_time, with_reaction];
            for (rate, differences) in TIP.rates(reaction, seconds).into_iter().zip(differences) {
                assert!(
                    (rate - differences).abs() <= 1e-7 * (1.0 + differences.abs()),
                    "{seconds}: {rate} for {differences}"
                );
            }
        }
    }
}
