//! Newmark steps of several systems, each in a lane of the processor's registers.

use super::lane_contacts::{LaneContacts, LaneReactions, ZERO};
use super::lane_sums::{Coordinate, all_along, push_all};
use crate::linalg::wide::widest;
use crate::linalg::{Ensemble, LaneMask, Lanes};
use crate::scheme::NewmarkParameters;
use crate::vi::{BoundStatus, ComplianceProblem, ComplianceSolver, StepReport};
use faer::Mat;
use pulp::Arch;

const LANES: usize = Ensemble::SYSTEMS;

/// Motion of the massless part of the displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum MasslessPart {
    /// No displacement, as all have inertia.
    None,
    /// Displacement that follows the loads at once.
    Follows,
    /// Displacement that obeys the scheme.
    Swings,
}

/// Equations of the coordinates, which are the same for all systems: of the modes, then of the
/// massless displacements by reactions, then of those by loads, then of that of the start.
pub(super) struct Equations {
    pub parameters: NewmarkParameters,
    pub massless: MasslessPart,
    /// Number of modes.
    pub modes: usize,
    /// Numbers of each coordinate.
    pub coordinates: Vec<Coordinate>,
    /// Deflections of each bounded dof per unit of the modes and of the reactions.
    pub rows: Vec<Vec<f64>>,
    /// Compliance S of the step at the bounded dofs, in m/N.
    pub compliance: Mat<f64>,
}

/// Loads, bounds and starts, one number per system.
pub(super) struct Data {
    /// Deflections of each bounded dof per unit of the loads and of the start.
    pub rows: Vec<Vec<Lanes>>,
    /// Forces of each load on the modes, and on all other coordinates where these count for the
    /// work.
    pub forces: Vec<Vec<Lanes>>,
    /// Stiffness between the responses to the loads and the start, in J per unit of both.
    pub stiffness: Vec<Vec<Lanes>>,
    /// Loads that are not zero.
    pub pushing: Vec<usize>,
    /// Bounds of each bounded dof, in m.
    pub lower: Vec<Lanes>,
    pub upper: Vec<Lanes>,
    /// Largest finite magnitude of the bounds, in m.
    pub magnitude: Lanes,
}

/// Levels n - 1, n and n + 1 of all systems.
pub(super) struct LaneLevels {
    pub equations: Equations,
    pub data: Data,
    /// Number of systems.
    systems: usize,
    /// Coordinates at the instant n, their increments to it and from it, and the unknown, one entry
    /// per coordinate.
    pub z: Vec<Lanes>,
    pub d: Vec<Lanes>,
    pub d_next: Vec<Lanes>,
    x: Vec<Lanes>,
    /// Factors of the loads at the instants n - 1, n and n + 1, and their beta-averages.
    pub factors: [Vec<Lanes>; 3],
    mean: Vec<Lanes>,
    /// Deflections of the bounded dofs at the instants n and n - 1, in m.
    pub u: Vec<Lanes>,
    pub u_before: Vec<Lanes>,
    /// Unknown of the bounded deflections without reactions, in m.
    unknown: Vec<Lanes>,
    /// Bounded configuration, in m.
    pub admissible: Vec<Lanes>,
    /// Reactions at the instants n and n - 1, in N.
    pub reaction: Vec<Lanes>,
    pub reaction_before: Vec<Lanes>,
    /// Work of the loads in time up to the instant n, and its increment there, in J.
    pub work: Lanes,
    increment: Lanes,
    /// Systems with reactions at the instant n, and at n - 1.
    pub presses: [LaneMask; 2],
    pub reports: [StepReport; LANES],
    /// Bound that each bounded dof touched last, as in [`LaneContacts::solve`].
    sides: Vec<Lanes>,
    solvers: Vec<ComplianceSolver>,
    gathered: Gathered,
    arch: Arch,
}

/// Contact problem of one lane, gathered.
#[derive(Default)]
struct Gathered {
    free: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    x: Vec<f64>,
    reaction: Vec<f64>,
}

/// Initial velocities of the modes, and those of the bounded dofs (m/s).
pub(super) struct Launch {
    pub modes: Vec<Lanes>,
    pub bounded: Vec<Lanes>,
}

impl LaneLevels {
    /// Solves the first step from the coordinates `z` at the start, given the factors of the loads
    /// there and one step later.
    pub fn new(
        equations: Equations,
        data: Data,
        systems: usize,
        z: Vec<Lanes>,
        [now, next]: [Vec<Lanes>; 2],
        launch: &Launch,
    ) -> LaneLevels {
        let (size, bounds) = (z.len(), data.lower.len());
        // The factors are extrapolated to the instant before the start.
        let before = now.iter().zip(&next).map(|(now, next)| 2.0 * *now - *next);
        let none = vec![ZERO; bounds];
        let mut levels = LaneLevels {
            systems,
            d: vec![ZERO; size],
            d_next: vec![ZERO; size],
            x: vec![ZERO; size],
            mean: now.clone(),
            factors: [before.collect(), now, next],
            u: none.clone(),
            u_before: none.clone(),
            unknown: none.clone(),
            admissible: none.clone(),
            reaction: none.clone(),
            reaction_before: none,
            work: ZERO,
            increment: ZERO,
            presses: Default::default(),
            reports: [StepReport::default(); LANES],
            sides: vec![ZERO; bounds],
            solvers: vec![ComplianceSolver::new(bounds); systems],
            gathered: Gathered::default(),
            arch: Arch::new(),
            z,
            equations,
            data,
        };
        all_along(&levels.equations.rows, &levels.data.rows, &levels.z, &mut levels.u);
        levels.solve(Some(launch));
        levels.account(true);
        levels
    }

    /// Makes the level n + 1 the present one and solves for the next; `ahead` sets the factors of
    /// the loads there.
    pub fn advance(&mut self, ahead: impl FnOnce(&mut [Lanes])) {
        std::mem::swap(&mut self.d, &mut self.d_next);
        std::mem::swap(&mut self.u, &mut self.u_before);
        std::mem::swap(&mut self.reaction, &mut self.reaction_before);
        self.factors.rotate_left(1);
        ahead(&mut self.factors[2]);
        let LaneLevels { equations, data, z, d, u, factors, arch, .. } = self;
        widest(
            *arch,
            #[inline(always)]
            || {
                for (z, d) in z.iter_mut().zip(&*d) {
                    *z += *d;
                }
                if equations.massless == MasslessPart::Follows {
                    let first = equations.first_load();
                    z[first..first + factors[1].len()].copy_from_slice(&factors[1]);
                }
                all_along(&equations.rows, &data.rows, z, u);
            },
        );
        self.solve(None);
        self.account(false);
    }

    /// Solves for the level n + 1; at the start, with initial velocities, for the ghost level too.
    fn solve(&mut self, first: Option<&Launch>) {
        self.solve_without_contact(first);
        let e = self.equations.parameters.restitution;
        let dt = self.equations.parameters.step;
        let share = if first.is_some() { 0.5 } else { 1.0 / (1.0 + e) };
        let LaneLevels { data, u, u_before, unknown, admissible, arch, .. } = self;
        let mut beyond = LaneMask::default();
        widest(
            *arch,
            #[inline(always)]
            || {
                let bounds = data.lower.iter().zip(&data.upper);
                let deflections = u.iter().zip(&*u_before).zip(&*unknown);
                for (i, (place, ((u, u_before), unknown))) in
                    admissible.iter_mut().zip(deflections).enumerate()
                {
                    let drift = match first {
                        Some(launch) => (-2.0 * dt * e / (1.0 + e)) * launch.bounded[i],
                        None => ((1.0 - e) / (1.0 + e)) * (*u - *u_before),
                    };
                    *place = *u + (share * *unknown + drift);
                }
                for (place, (lower, upper)) in admissible.iter().zip(bounds) {
                    beyond = beyond | place.is_below(*lower) | upper.is_below(*place);
                }
            },
        );
        self.presses = [beyond, self.presses[0]];
        if beyond.any() {
            self.solve_contacts(beyond, share);
            self.react();
        } else {
            self.reaction.fill(ZERO);
            // The next contact of a system must not depend on those of the others.
            self.sides.fill(ZERO);
        }
        self.update(first);
    }

    /// Computes the unknown of the step without reactions, and that of the bounded deflections.
    fn solve_without_contact(&mut self, first: Option<&Launch>) {
        let LaneLevels { equations, data, z, d, x, factors, mean, unknown, reports, arch, .. } = self;
        let Equations { parameters, massless, modes, coordinates, rows, .. } = equations;
        let NewmarkParameters { beta, restitution: e, step: dt } = *parameters;
        let [prev, now, next] = &*factors;
        let after = *modes + if *massless == MasslessPart::None { 0 } else { rows.len() };
        widest(
            *arch,
            #[inline(always)]
            || {
                let of_time = prev.iter().zip(now).zip(next);
                for (mean, ((prev, now), next)) in mean.iter_mut().zip(of_time) {
                    *mean = *now + beta * ((*next - 2.0 * *now) + *prev);
                }
                x.fill(ZERO);
                for &load in &data.pushing {
                    let mean = mean[load];
                    for (x, force) in x[..*modes].iter_mut().zip(&data.forces[load]) {
                        *x += *force * mean;
                    }
                }
                if *massless == MasslessPart::Swings {
                    x[after..after + mean.len()].copy_from_slice(mean);
                }
                if let Some(launch) = first {
                    for (x, velocity) in x[..*modes].iter_mut().zip(&launch.modes) {
                        *x += (2.0 / dt) * *velocity;
                    }
                }
                // A value that is not finite spoils the sum.
                let mut sum = ZERO;
                for (x, ((z, d), of)) in x.iter_mut().zip(z.iter().zip(&*d).zip(&*coordinates)) {
                    *x = of.inverse * ((*x - of.decay * *d) - of.stiffness * *z);
                    sum += *x;
                }
                if *massless == MasslessPart::Follows {
                    for (l, x) in x[after..].iter_mut().enumerate() {
                        *x = match first {
                            Some(_) => (2.0 * (1.0 - e) / (1.0 + e)) * (next[l] - now[l]),
                            None => (next[l] - 2.0 * now[l]) + prev[l],
                        };
                    }
                }
                all_along(rows, &data.rows, x, unknown);
                for (report, sum) in reports.iter_mut().zip(sum.0) {
                    *report = StepReport { kkt: 0.0 * sum, ..StepReport::default() };
                }
            },
        );
    }

    /// Solves for the reactions on chosen systems, whose bounded configuration moves by a share of
    /// the unknown.
    fn solve_contacts(&mut self, chosen: LaneMask, share: f64) {
        let left = match self.unknown.len() {
            1 => self.solve_contacts_at_once::<1>(chosen, share),
            2 => self.solve_contacts_at_once::<2>(chosen, share),
            3 => self.solve_contacts_at_once::<3>(chosen, share),
            4 => self.solve_contacts_at_once::<4>(chosen, share),
            _ => {
                self.reaction.fill(ZERO);
                chosen
            }
        };
        for lane in (0..self.systems).filter(|&lane| left.holds(lane)) {
            self.solve_contact(lane, share);
        }
    }

    /// Solves for the reactions on chosen systems at once. Returns those that are left to
    /// [`LaneLevels::solve_contact`].
    fn solve_contacts_at_once<const N: usize>(&mut self, chosen: LaneMask, share: f64) -> LaneMask {
        let LaneLevels { equations, data, u, unknown, admissible, reaction, reports, sides, arch, .. } = self;
        let mut left = chosen;
        let (mut kkt, mut exchanges) = (ZERO, ZERO);
        widest(
            *arch,
            #[inline(always)]
            || {
                let free: [Lanes; N] = std::array::from_fn(|i| unknown[i]);
                let unit = 1.0 / share;
                let problem = LaneContacts {
                    compliance: LaneContacts::rows(&equations.compliance),
                    lower: std::array::from_fn(|i| free[i] + unit * (data.lower[i] - admissible[i])),
                    upper: std::array::from_fn(|i| free[i] + unit * (data.upper[i] - admissible[i])),
                    free,
                    chosen,
                };
                let LaneReactions { x, reaction: r, residual, iterations, unsolved } = problem.solve(sides);
                reaction.copy_from_slice(&r);
                let solved = chosen & !unsolved;
                let mut largest = data.magnitude;
                for (i, place) in admissible.iter_mut().enumerate() {
                    let [low, high] = [data.lower[i], data.upper[i]];
                    let moved = (*place + share * (x[i] - free[i])).max(low).min(high);
                    let moved = sides[i].is_below(ZERO).pick(low, moved);
                    let moved = ZERO.is_below(sides[i]).pick(high, moved);
                    *place = solved.pick(moved, *place);
                    largest = largest.max(u[i].abs());
                }
                // A reaction that is not finite spoils the sum.
                let sum = r.iter().fold(ZERO, |sum, r| sum + *r);
                // Without any length the residual is 0, too.
                kkt = ZERO.is_below(residual).pick(residual / largest, ZERO) + 0.0 * sum;
                (exchanges, left) = (iterations, unsolved);
            },
        );
        for lane in (0..LANES).filter(|&lane| chosen.holds(lane) && !left.holds(lane)) {
            let solved = StepReport { iterations: exchanges.0[lane] as u32, kkt: kkt.0[lane], retries: 0 };
            reports[lane] = reports[lane].and(solved);
        }
        left
    }

    /// Solves for the reactions on one system, whose bounded configuration moves by a share of the
    /// unknown.
    fn solve_contact(&mut self, lane: usize, share: f64) {
        let LaneLevels {
            equations, data, u, unknown, admissible, reaction, reports, sides, gathered, ..
        } = self;
        let Gathered { free, lower, upper, x, reaction: r } = gathered;
        let bounds = 0..unknown.len();
        for of in [&mut *free, &mut *lower, &mut *upper, &mut *x, &mut *r] {
            of.clear();
        }
        for i in bounds.clone() {
            let (unknown, place) = (unknown[i].0[lane], admissible[i].0[lane]);
            free.push(unknown);
            lower.push(unknown + (data.lower[i].0[lane] - place) / share);
            upper.push(unknown + (data.upper[i].0[lane] - place) / share);
        }
        x.resize(free.len(), 0.0);
        r.resize(free.len(), 0.0);
        let compliance = &equations.compliance;
        let solver = &mut self.solvers[lane];
        solver.solve(ComplianceProblem { compliance, free, lower, upper, hertz: &[] }, x, r);
        let largest = bounds.clone().map(|i| u[i].0[lane].abs()).fold(data.magnitude.0[lane], f64::max);
        if !solver.active().is_empty() {
            let kkt = if solver.residual == 0.0 { 0.0 } else { solver.residual / largest };
            let solved = StepReport { iterations: solver.iterations, kkt, retries: 0 };
            reports[lane] = reports[lane].and(solved);
        }
        for (own, side) in sides.iter_mut().zip(&solver.sides) {
            own.0[lane] = match side {
                BoundStatus::Lower => -1.0,
                BoundStatus::Free => 0.0,
                BoundStatus::Upper => 1.0,
            };
        }
        for i in bounds {
            let [low, high] = [data.lower[i].0[lane], data.upper[i].0[lane]];
            reaction[i].0[lane] = r[i];
            admissible[i].0[lane] = match solver.sides[i] {
                BoundStatus::Lower => low,
                BoundStatus::Upper => high,
                BoundStatus::Free => {
                    (admissible[i].0[lane] + share * (x[i] - unknown[i].0[lane])).max(low).min(high)
                }
            };
        }
    }

    /// Adds what the reactions do to the unknown.
    fn react(&mut self) {
        let LaneLevels { equations, x, reaction, arch, .. } = self;
        let Equations { massless, modes, coordinates, rows, .. } = equations;
        widest(
            *arch,
            #[inline(always)]
            || {
                let (of_modes, others) = x.split_at_mut(*modes);
                let (modal, massless_part) = coordinates.split_at(*modes);
                push_all(rows, reaction, modal, of_modes);
                if *massless != MasslessPart::None {
                    for ((x, r), of) in others.iter_mut().zip(&*reaction).zip(massless_part) {
                        *x += of.inverse * *r;
                    }
                }
            },
        );
    }

    /// Moves the coordinates to the level n + 1.
    fn update(&mut self, first: Option<&Launch>) {
        let LaneLevels { equations, x, d, d_next, factors, arch, .. } = self;
        let dt = equations.parameters.step;
        widest(
            *arch,
            #[inline(always)]
            || {
                for (d_next, (d, x)) in d_next.iter_mut().zip(d.iter().zip(&*x)) {
                    *d_next = if first.is_some() { 0.5 * *x } else { *d + *x };
                }
            },
        );
        let Some(launch) = first else { return };
        for (j, (d, x)) in d.iter_mut().zip(&*x).enumerate() {
            let rate = launch.modes.get(j).copied().unwrap_or(ZERO);
            *d = (2.0 * dt) * rate - 0.5 * *x;
        }
        if equations.massless == MasslessPart::Follows {
            let first = equations.first_load();
            for l in 0..factors[1].len() {
                d[first + l] = factors[2][l] - factors[1][l];
                d_next[first + l] = d[first + l];
            }
        }
    }

    /// Adds the work of the loads in time up to the instant n.
    fn account(&mut self, is_start: bool) {
        let LaneLevels { equations, data, d, d_next, factors, mean, reaction, work, increment, arch, .. } =
            self;
        let touches = reaction.iter().any(|of| *of != ZERO);
        widest(
            *arch,
            #[inline(always)]
            || {
                let mut sum = ZERO;
                for &load in data.pushing.iter().filter(|load| **load > 0) {
                    let mut moved = ZERO;
                    for (force, (d, next)) in data.forces[load].iter().zip(d.iter().zip(&*d_next)) {
                        moved += *force * (*d + *next);
                    }
                    sum += 0.5 * (mean[load] * moved);
                }
                if equations.massless == MasslessPart::Follows && touches {
                    // Reactions work on the response of the massless part to the loads.
                    let [prev, _, next] = &*factors;
                    for (row, r) in data.rows.iter().zip(&*reaction) {
                        for (of_load, (prev, next)) in row.iter().zip(prev.iter().zip(next)) {
                            sum = sum - 0.5 * (*r * (*of_load * (*next - *prev)));
                        }
                    }
                }
                if !is_start {
                    *work += 0.5 * (*increment + sum);
                }
                *increment = sum;
            },
        );
    }
}

impl Equations {
    /// Returns the place of the first load among the coordinates.
    pub fn first_load(&self) -> usize {
        self.modes + self.rows.len()
    }
}

/// Returns a value for each system.
pub(super) fn each(value: impl FnMut(usize) -> f64) -> Lanes {
    Lanes(std::array::from_fn(value))
}
