//! Newmark steps of several systems, each in a lane of the processor's registers.

use super::lane_contacts::{LaneContacts, LaneReactions, ZERO};
use super::lane_coordinates::{Coordinate, LaneCoordinates};
use super::lane_sums::{all_along, work_along};
use crate::kernels::wide::widest;
use crate::kernels::{LaneMask, Lanes};
use crate::scheme::NewmarkParameters;
use crate::scheme::newmark::levels;
use crate::vi::{BoundStatus, ComplianceProblem, ComplianceSolver, StepReport};
use faer::Mat;
use pulp::Arch;

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
    /// Coordinates at the instants n and n + 1, and their increments to n and from it.
    pub z: Vec<Lanes>,
    z_next: Vec<Lanes>,
    pub d: Vec<Lanes>,
    pub d_next: Vec<Lanes>,
    /// Factors of the loads at the instants n - 1, n and n + 1, and their beta-averages.
    pub factors: [Vec<Lanes>; 3],
    mean: Vec<Lanes>,
    /// Deflections of the bounded dofs at the instants n - 1, n and n + 1, in m.
    pub u_before: Vec<Lanes>,
    pub u: Vec<Lanes>,
    u_next: Vec<Lanes>,
    /// Changes of the unknown of the bounded deflections by the reactions, in m.
    response: Vec<Lanes>,
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
    /// Relative KKT residuals of the step, and numbers of exchanges of contact dofs.
    pub kkt: Lanes,
    exchanges: Lanes,
    /// Bound that each bounded dof touched last, as in [`LaneContacts::solve`].
    sides: Vec<Lanes>,
    solvers: Vec<ComplianceSolver>,
    arch: Arch,
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
            z_next: z.clone(),
            d: vec![ZERO; size],
            d_next: vec![ZERO; size],
            mean: now.clone(),
            factors: [before.collect(), now, next],
            u_before: none.clone(),
            u: none.clone(),
            u_next: none.clone(),
            response: none.clone(),
            admissible: none.clone(),
            reaction: none.clone(),
            reaction_before: none,
            work: ZERO,
            increment: ZERO,
            presses: Default::default(),
            kkt: ZERO,
            exchanges: ZERO,
            sides: vec![ZERO; bounds],
            solvers: vec![ComplianceSolver::new(bounds); systems],
            arch: Arch::new(),
            z,
            equations,
            data,
        };
        all_along(&levels.equations.rows, &levels.data.rows, &levels.z, &mut levels.u);
        levels.start(launch);
        levels.touch(0.5, 0.5);
        levels.look_back(launch);
        levels.account(true);
        levels
    }

    /// Makes the level n + 1 the present one and solves for the next; `ahead` sets the factors of
    /// the loads there.
    pub fn advance(&mut self, ahead: impl FnOnce(&mut [Lanes])) {
        std::mem::swap(&mut self.z, &mut self.z_next);
        std::mem::swap(&mut self.d, &mut self.d_next);
        std::mem::swap(&mut self.u_before, &mut self.u);
        std::mem::swap(&mut self.u, &mut self.u_next);
        std::mem::swap(&mut self.reaction, &mut self.reaction_before);
        self.factors.rotate_left(1);
        ahead(&mut self.factors[2]);
        self.advance_without_contact();
        self.touch(1.0 / (1.0 + self.equations.parameters.restitution), 1.0);
        self.account(false);
    }

    /// Solves for the first step as if nothing touched, given the initial velocities. The level
    /// before the start, a ghost, follows from them.
    fn start(&mut self, launch: &Launch) {
        let LaneLevels { equations, data, z, z_next, d_next, factors, mean, u_before, u_next, .. } = self;
        let Equations { parameters, massless, modes, coordinates, rows, .. } = &*equations;
        let dt = parameters.step;
        let at_loads = equations.first_load();
        average(factors, *parameters, mean);
        let force_on = |j: usize| match massless {
            _ if j < *modes => {
                data.pushing.iter().fold(ZERO, |sum, &load| sum + data.forces[load][j] * mean[load])
            }
            MasslessPart::Swings => {
                j.checked_sub(at_loads).and_then(|load| mean.get(load)).copied().unwrap_or(ZERO)
            }
            _ => ZERO,
        };
        for (j, (coordinate, z)) in coordinates.iter().zip(&*z).enumerate() {
            let force = force_on(j) + (2.0 / dt) * launch.of_mode(j);
            d_next[j] = 0.5 * (coordinate.inverse * (force - coordinate.stiffness * *z));
        }
        let mut travels: Vec<Lanes> = launch.bounded.iter().map(|velocity| (2.0 * dt) * *velocity).collect();
        if *massless == MasslessPart::Follows {
            let [_, now, next] = &*factors;
            for (l, (now, next)) in now.iter().zip(next).enumerate() {
                d_next[at_loads + l] = *next - *now;
                let travel = travels.iter_mut().zip(&data.rows);
                travel.for_each(|(travel, row)| *travel += 2.0 * (row[l] * d_next[at_loads + l]));
            }
        }
        for (z_next, (z, d)) in z_next.iter_mut().zip(z.iter().zip(&*d_next)) {
            *z_next = *z + *d;
        }
        all_along(rows, &data.rows, z_next, u_next);
        for (before, (next, travel)) in u_before.iter_mut().zip(u_next.iter().zip(travels)) {
            *before = *next - travel;
        }
        // A value that is not finite spoils the sum.
        self.kkt = 0.0 * d_next.iter().fold(ZERO, |sum, d| sum + *d);
    }

    /// Sets the increments from the ghost before the start.
    fn look_back(&mut self, launch: &Launch) {
        let LaneLevels { equations, d, d_next, .. } = self;
        let Equations { parameters, massless, .. } = &*equations;
        for (j, (d, next)) in d.iter_mut().zip(&*d_next).enumerate() {
            let follows = *massless == MasslessPart::Follows && j >= equations.first_load();
            let back = (2.0 * parameters.step) * launch.of_mode(j) - *next;
            *d = if follows { *next } else { back };
        }
    }

    /// Moves on to the level n + 1 as if nothing touched.
    fn advance_without_contact(&mut self) {
        let LaneLevels { equations, data, z, z_next, d, d_next, factors, mean, .. } = self;
        let Equations { parameters, massless, modes, coordinates, rows, .. } = &*equations;
        let [before, now, next] = &*factors;
        let at_loads = equations.first_load();
        let (u_next, kkt) = (&mut self.u_next, &mut self.kkt);
        self.exchanges = ZERO;
        widest(
            self.arch,
            #[inline(always)]
            || {
                average(factors, *parameters, mean);
                d_next.fill(ZERO);
                for &load in &data.pushing {
                    for (sum, force) in d_next[..*modes].iter_mut().zip(&data.forces[load]) {
                        *sum += *force * mean[load];
                    }
                }
                if *massless == MasslessPart::Swings {
                    d_next[at_loads..at_loads + mean.len()].copy_from_slice(mean);
                }
                // A value that is not finite spoils the sum.
                *kkt = 0.0 * LaneCoordinates { z, d, d_next, z_next }.advance(coordinates);
                if *massless == MasslessPart::Follows {
                    for (l, (before, (now, next))) in before.iter().zip(now.iter().zip(next)).enumerate() {
                        let of_load = at_loads + l;
                        d_next[of_load] = d[of_load] + ((*next - 2.0 * *now) + *before);
                        z_next[of_load] = *next;
                    }
                }
                all_along(rows, &data.rows, z_next, u_next);
            },
        );
    }

    /// Adds the reactions where the bounded configuration is beyond the bounds. Per unit of the
    /// unknown, this configuration moves by `share`, and the deflections by `part`.
    fn touch(&mut self, share: f64, part: f64) {
        let e = self.equations.parameters.restitution;
        let LaneLevels { data, u_before, u_next, admissible, arch, .. } = self;
        let mut beyond = LaneMask::default();
        widest(
            *arch,
            #[inline(always)]
            || {
                let deflections = u_next.iter().zip(&*u_before);
                let bounds = data.lower.iter().zip(&data.upper);
                for ((place, (next, before)), (lower, upper)) in
                    admissible.iter_mut().zip(deflections).zip(bounds)
                {
                    *place = (1.0 / (1.0 + e)) * (*next + e * *before);
                    beyond = beyond | place.is_below(*lower) | upper.is_below(*place);
                }
            },
        );
        self.presses = [beyond, self.presses[0]];
        if beyond.any() {
            self.solve_contacts(beyond, share);
            self.react(part);
        } else {
            self.reaction.fill(ZERO);
            // The next contact of a system must not depend on those of the others.
            self.sides.fill(ZERO);
        }
    }

    /// Solves for the reactions on chosen systems, whose bounded configuration moves by a share of
    /// the unknown.
    fn solve_contacts(&mut self, chosen: LaneMask, share: f64) {
        let unsolved = match self.response.len() {
            1 => self.solve_contacts_at_once::<1>(chosen, share),
            2 => self.solve_contacts_at_once::<2>(chosen, share),
            3 => self.solve_contacts_at_once::<3>(chosen, share),
            4 => self.solve_contacts_at_once::<4>(chosen, share),
            _ => {
                self.reaction.fill(ZERO);
                self.response.fill(ZERO);
                chosen
            }
        };
        for lane in (0..self.systems).filter(|&lane| unsolved.holds(lane)) {
            self.solve_contact(lane, share);
        }
    }

    /// Solves for the reactions on chosen systems at once. Returns those that are left to
    /// [`LaneLevels::solve_contact`].
    fn solve_contacts_at_once<const N: usize>(&mut self, chosen: LaneMask, share: f64) -> LaneMask {
        let LaneLevels { equations, data, u, response, admissible, reaction, sides, arch, .. } = self;
        let (kkt, exchanges) = (&mut self.kkt, &mut self.exchanges);
        let mut remaining = chosen;
        widest(
            *arch,
            #[inline(always)]
            || {
                let unit = 1.0 / share;
                let problem = LaneContacts::<N> {
                    compliance: LaneContacts::rows(&equations.compliance),
                    lower: std::array::from_fn(|i| unit * (data.lower[i] - admissible[i])),
                    upper: std::array::from_fn(|i| unit * (data.upper[i] - admissible[i])),
                    chosen,
                };
                let LaneReactions { x, reaction: r, residual, iterations, unsolved } = problem.solve(sides);
                reaction.copy_from_slice(&r);
                response.copy_from_slice(&x);
                let solved = chosen & !unsolved;
                let mut largest = data.magnitude;
                for (i, place) in admissible.iter_mut().enumerate() {
                    let [low, high] = [data.lower[i], data.upper[i]];
                    let moved = (*place + share * x[i]).max(low).min(high);
                    let moved = sides[i].is_below(ZERO).pick(low, moved);
                    let moved = ZERO.is_below(sides[i]).pick(high, moved);
                    *place = solved.pick(moved, *place);
                    largest = largest.max(u[i].abs());
                }
                // A reaction that is not finite spoils the sum.
                let sum = r.iter().fold(ZERO, |sum, r| sum + *r);
                // Without any length the residual is 0, too.
                let of_contact = ZERO.is_below(residual).pick(residual / largest, ZERO) + 0.0 * sum;
                *kkt += solved.pick(of_contact, ZERO);
                *exchanges = solved.pick(iterations, ZERO);
                remaining = unsolved;
            },
        );
        remaining
    }

    /// Solves for the reactions on one system, whose bounded configuration moves by a share of the
    /// unknown.
    fn solve_contact(&mut self, lane: usize, share: f64) {
        let LaneLevels { equations, data, u, response, admissible, reaction, kkt, exchanges, .. } = self;
        let bounds = 0..response.len();
        let beyond = |limits: &[Lanes]| -> Vec<f64> {
            bounds.clone().map(|i| (limits[i].0[lane] - admissible[i].0[lane]) / share).collect()
        };
        let (lower, upper) = (&beyond(&data.lower), &beyond(&data.upper));
        let free = &vec![0.0; bounds.len()];
        let (mut x, mut r) = (free.clone(), free.clone());
        let compliance = &equations.compliance;
        let solver = &mut self.solvers[lane];
        solver.solve(
            ComplianceProblem { compliance, free, lower, upper, laws: None, softness: &[] },
            &mut x,
            &mut r,
        );
        let largest = bounds.clone().map(|i| u[i].0[lane].abs()).fold(data.magnitude.0[lane], f64::max);
        if !solver.active.is_empty() {
            kkt.0[lane] += if solver.residual == 0.0 { 0.0 } else { solver.residual / largest };
            exchanges.0[lane] = f64::from(solver.iterations);
        }
        for (last, side) in self.sides.iter_mut().zip(&solver.sides) {
            last.0[lane] = match side {
                BoundStatus::Lower => -1.0,
                BoundStatus::Free => 0.0,
                BoundStatus::Upper => 1.0,
            };
        }
        for i in bounds {
            let [low, high] = [data.lower[i].0[lane], data.upper[i].0[lane]];
            (reaction[i].0[lane], response[i].0[lane]) = (r[i], x[i]);
            admissible[i].0[lane] = match solver.sides[i] {
                BoundStatus::Lower => low,
                BoundStatus::Upper => high,
                BoundStatus::Free => (admissible[i].0[lane] + share * x[i]).max(low).min(high),
            };
        }
    }

    /// Adds the effect of the reactions on the level n + 1, where a `part` of the unknown is the
    /// increment.
    fn react(&mut self, part: f64) {
        let LaneLevels { equations, z, z_next, d, d_next, u_next, reaction, response, .. } = self;
        let Equations { modes, coordinates, rows, .. } = &*equations;
        widest(
            self.arch,
            #[inline(always)]
            || {
                let (inertial, massless_part) = coordinates.split_at(*modes);
                let mut levels = LaneCoordinates { z, d, d_next, z_next };
                levels.push_all(inertial, part, rows, reaction);
                levels.push_each(*modes, massless_part, part, reaction);
                for (u, response) in u_next.iter_mut().zip(&*response) {
                    *u += part * *response;
                }
            },
        );
    }

    /// Returns the report of the step of one system.
    pub fn report(&self, lane: usize) -> StepReport {
        StepReport { iterations: self.exchanges.0[lane] as u32, kkt: self.kkt.0[lane], retries: 0 }
    }

    /// Adds the work of the loads in time up to the instant n.
    fn account(&mut self, is_start: bool) {
        let LaneLevels { equations, data, d, d_next, factors, mean, reaction, work, increment, arch, .. } =
            self;
        let touches = self.presses[0].any();
        widest(
            *arch,
            #[inline(always)]
            || {
                let mut sum = ZERO;
                for &load in data.pushing.iter().filter(|load| **load > 0) {
                    sum += 0.5 * (mean[load] * work_along(&data.forces[load], d, d_next));
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

impl Launch {
    /// Returns the initial velocity of a mode, 0 for all other coordinates.
    fn of_mode(&self, coordinate: usize) -> Lanes {
        self.modes.get(coordinate).copied().unwrap_or(ZERO)
    }
}

impl Equations {
    /// Returns the place of the first load among the coordinates.
    pub fn first_load(&self) -> usize {
        self.modes + self.rows.len()
    }
}

/// Sets the beta-averages of the factors at three instants.
#[inline(always)]
fn average(factors: &[Vec<Lanes>; 3], parameters: NewmarkParameters, mean: &mut [Lanes]) {
    let instants = levels(factors.each_ref().map(|factors| &**factors));
    mean.iter_mut().zip(instants).for_each(|(mean, factors)| *mean = parameters.average(factors));
}

/// Returns a value for each system.
pub(super) fn each(value: impl FnMut(usize) -> f64) -> Lanes {
    Lanes(std::array::from_fn(value))
}
