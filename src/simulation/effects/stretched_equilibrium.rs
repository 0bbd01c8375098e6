//! Equilibria of a plate that stretches.
//!
//! With the modal coordinates q and the massless rest w of `$U = \Phi q + w$`, and the reactions r of
//! the nodes in contact,
//!
//! ```math
//! \Omega^2 q + \nabla V(q) = \Omega^2 q_0 + A^T r, \qquad w = w_0 + R\, r, \qquad
//! l \le G U \le u, \quad r \perp G U - l,\; u - G U ,
//! ```
//!
//! where q_0 and w_0 belong to the plate that only bends and touches nothing, `$A = G \Phi$`, and R
//! is the flexibility of the rest. Newton's method linearises `$\nabla V$`. In each step the nodes in
//! contact solve a dense complementarity problem with the compliance `$A T^{-1} A^T + G R$` of the
//! tangent T. In directions without or with negative stiffness T is replaced by its magnitude, so
//! that the energy descends.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, PER_NODE};
use crate::error::{Error, Result};
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Factor, Form, MassModes};
use crate::membrane::{QuarticForm, Stretch};
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scheme::System;
use crate::vi::{Answer, BoundStatus, DenseProblem};
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side as Triangle};

/// Largest number of Newton's iterations, and of halvings of one.
const ITERATIONS: usize = 100;
const HALVINGS: i32 = 40;

/// Stiffness relative to the largest one, below which a direction counts as without stiffness.
const FLAT: f64 = 1e-12;

/// Residuals of an equilibrium, relative to the forces: the one at which the iteration ends, and
/// the largest where rounding ends it.
const SETTLED: f64 = 1e-13;
const ROUNDING: f64 = 1e-10;

/// Residual, relative to the forces, from which on an equilibrium that is no minimum is left.
const NEAR: f64 = 1e-4;

/// Distance beyond a bound, relative to the deflections, from which a node is taken as a candidate.
const BEYOND: f64 = 1e-12;

/// Moves the equilibrium of a plate that only bends and touches nothing, in m, to the one of the
/// plate that stretches, within the bounds. It is a minimum of the energy, sought from
/// `initial.deflection` on. Without it a plate that buckles without a load takes the side on which
/// its largest deflection points upwards.
///
/// # Errors
/// Returns [`Error::Unfinished`] where Newton's method ends elsewhere, [`Error::Usage`] for contact
/// with a stop that has a law of its own, and the errors of the engine.
pub(super) fn settle<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
    bounds: &Bounds,
    displacement: &mut [f64],
) -> Result<()> {
    let (Some(form), Form::Modal { modes, .. }) = (&system.drive.stretching, &system.mass) else {
        return Ok(());
    };
    let shape = ground.comm().all_ok(ground.shape_of(&ground.scene.initial.deflection))?;
    let guess = ground.owned(&ground.space.interpolate(&shape), system.engine.dofs());
    let (bent, first) = (system.projected(displacement)?, system.projected(&guess)?);
    let mut rest = displacement.to_vec();
    modes.add_shapes(&bent.iter().map(|q| -q).collect::<Vec<_>>(), &mut rest);
    let mut search = Search::new(form, modes, ground.space, &bent);
    let factor = system.engine.factor(&(&*ground.stiffness_at_rest(system)).into(), &[])?;
    let mut contact = Contact { bounds, modes, rest, nodes: Vec::new(), factor };
    search.run(first, Some(&mut contact))?;
    displacement.copy_from_slice(&contact.displacement(&search.q, &search.reaction));
    Ok(())
}

/// Returns the energy of the equilibrium without load and contact, in J.
///
/// # Errors
/// Returns [`Error::Unfinished`] where Newton's method ends elsewhere.
pub(super) fn least_energy(form: &QuarticForm, modes: &MassModes, space: &DofMap) -> Result<f64> {
    let flat = vec![0.0; modes.count()];
    let mut search = Search::new(form, modes, space, &flat);
    search.run(flat, None)?;
    Ok(search.energy(&search.q, 0.0, &mut Stretch::default()))
}

/// Node that may touch.
struct Node {
    /// Index of its bound.
    bound: usize,
    /// Deflections of the modes there.
    shapes: Vec<f64>,
    /// Displacement of the rest per unit reaction, in m/N.
    flexibility: Vec<f64>,
}

/// Contact of the plate with its obstacles.
struct Contact<'a> {
    bounds: &'a Bounds,
    modes: &'a MassModes,
    /// Displacement w_0, in m.
    rest: Vec<f64>,
    nodes: Vec<Node>,
    /// Factor of K.
    factor: Box<dyn Factor>,
}

impl Contact<'_> {
    /// Returns the displacement of modal coordinates and reactions (N), in m.
    fn displacement(&self, q: &[f64], reaction: &[f64]) -> Vec<f64> {
        let mut u = self.rest.clone();
        self.modes.add_shapes(q, &mut u);
        self.nodes.iter().zip(reaction).for_each(|(node, r)| axpy(*r, &node.flexibility, &mut u));
        u
    }

    /// Returns the bound that a displacement (m) crosses most, if any.
    fn crossed(&self, u: &[f64]) -> Option<usize> {
        let size = u.iter().fold(self.bounds.magnitude(), |most, u| most.max(u.abs()));
        let (bound, depth) = self.bounds.worst(u)?;
        (depth > BEYOND * size).then_some(bound)
    }

    /// Adds a bound to the nodes that may touch.
    fn admit(&mut self, bound: usize) -> Result<()> {
        let dof = self.bounds.dofs[bound];
        let mut flexibility = vec![0.0; self.rest.len()];
        flexibility[dof] = 1.0;
        self.factor.solve(&mut flexibility)?;
        let MassModes { shapes, squares, .. } = self.modes;
        let shapes: Vec<f64> = (0..squares.len()).map(|k| shapes[(dof, k)]).collect();
        let of_modes: Vec<f64> = shapes.iter().zip(squares).map(|(shape, square)| -shape / square).collect();
        self.modes.add_shapes(&of_modes, &mut flexibility);
        self.nodes.push(Node { bound, shapes, flexibility });
        Ok(())
    }
}

/// Search for a minimum of the energy.
struct Search<'a> {
    form: &'a QuarticForm,
    modes: &'a MassModes,
    space: &'a DofMap,
    /// Load of the modes.
    load: Vec<f64>,
    /// Modal coordinates, and the reactions of the nodes of the contact in N.
    q: Vec<f64>,
    reaction: Vec<f64>,
}

/// Principal directions of the Hessian at a position, in coordinates of equal bending energy: the
/// first one of a flat plate is its lowest buckling mode.
struct DescentDirections {
    values: Vec<f64>,
    /// Directions in modal coordinates.
    directions: Vec<Vec<f64>>,
}

impl DescentDirections {
    /// Returns the stiffness that a direction counts with, which is positive.
    fn magnitude(&self, k: usize) -> f64 {
        let stiffest = self.values.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
        self.values[k].abs().max(FLAT * stiffest)
    }

    /// Returns the first direction of negative stiffness.
    fn descending(&self) -> Option<usize> {
        (0..self.values.len()).find(|&k| -self.values[k] >= self.magnitude(k))
    }

    /// Returns the modal coordinates of a force.
    fn solve(&self, force: &[f64]) -> Vec<f64> {
        let mut solution = vec![0.0; force.len()];
        for (k, direction) in self.directions.iter().enumerate() {
            axpy(dot(direction, force) / self.magnitude(k), direction, &mut solution);
        }
        solution
    }
}

/// Nodes in contact, as they hold the modes by the flexibility of the rest.
struct HeldModes {
    /// Nodes of the contact.
    places: Vec<usize>,
    /// Deflections of the modes there, one row per node.
    shapes: Mat<f64>,
    /// Bounds less the deflections of the rest, in m.
    gaps: Mat<f64>,
    /// Inverse of the flexibility of the rest, in N/m.
    at_nodes: Mat<f64>,
    /// Stiffness that they give the modes.
    stiffness: Mat<f64>,
}

/// Returns the inverse of a compliance (m/N).
///
/// # Errors
/// Returns [`Error::Singular`] where it is not positive definite.
fn inverse(compliance: &Mat<f64>) -> Result<Mat<f64>> {
    let what = "the compliance of the nodes in contact is not positive definite";
    Ok(compliance.llt(Triangle::Lower).map_err(|_| Error::Singular(what.into()))?.inverse())
}

impl<'a> Search<'a> {
    /// Prepares the search, given the modal coordinates of the plate that only bends.
    fn new(form: &'a QuarticForm, modes: &'a MassModes, space: &'a DofMap, bent: &[f64]) -> Search<'a> {
        let load = bent.iter().zip(&modes.squares).map(|(q, square)| square * q).collect();
        Search { form, modes, space, load, q: Vec::new(), reaction: Vec::new() }
    }

    /// Finds the equilibrium from modal coordinates on.
    fn run(&mut self, first: Vec<f64>, mut contact: Option<&mut Contact>) -> Result<()> {
        self.q = first;
        let mut stretch = Stretch::default();
        let mut is_within = contact
            .as_ref()
            .is_none_or(|contact| contact.crossed(&contact.displacement(&self.q, &[])).is_none());
        let mut last = f64::INFINITY;
        for _ in 0..ITERATIONS {
            let least = self.energy(&self.q, self.strain_of_rest(&contact, &self.reaction), &mut stretch);
            let [pull, forces] = self.pull(&self.q, &stretch);
            let size = dot(&forces, &forces).sqrt().max(dot(&self.load, &self.load).sqrt());
            let residual = self.residual(&self.q, &self.reaction, &contact);
            let hessian = self.hessian(&stretch);
            let held = self.held(&contact)?;
            let with_contact = held.as_ref().map_or(hessian.clone(), |held| &hessian + &held.stiffness);
            let with_contact = self.directions(&with_contact)?;
            if let Some(k) = with_contact.descending().filter(|_| is_within && residual <= NEAR * size) {
                self.depart(with_contact.values[k], &with_contact.directions[k]);
                (is_within, last) = (contact.is_none(), f64::INFINITY);
                continue;
            }
            // Where rounding keeps the residual from falling, the iteration ends.
            let falls = residual > ROUNDING * size || residual < 0.5 * last;
            let is_open = !is_within || residual > SETTLED * size && falls;
            last = residual;
            let mut next = None;
            if is_open {
                let polished = held.filter(|_| is_within && with_contact.descending().is_none());
                let polished = polished.and_then(|held| self.polished(&held, &with_contact, &pull, &contact));
                next = polished.filter(|(q, reaction)| self.residual(q, reaction, &contact) < 0.5 * residual);
            }
            if next.is_none() && is_open {
                let tangent = self.directions(&hessian)?;
                let reaction = self.reactions(&tangent, &pull, &mut contact)?;
                let nodes = contact.as_ref().map_or(&[][..], |contact| &contact.nodes);
                let mut force = pull.clone();
                nodes.iter().zip(&reaction).for_each(|(node, r)| axpy(*r, &node.shapes, &mut force));
                let step = tangent.solve(&force);
                self.reaction.resize(reaction.len(), 0.0);
                let lengths = (0..if is_within { HALVINGS } else { 1 }).map(|k| 0.5_f64.powi(k));
                // At the end rounding hides the descent.
                let terms = dot(&self.load, &self.q).abs() + stretch.size();
                let most = least + f64::EPSILON * (least.abs() + terms);
                next = lengths.map(|length| self.moved(length, &step, &reaction)).find(|(q, reaction)| {
                    let rest = self.strain_of_rest(&contact, reaction);
                    !is_within || self.energy(q, rest, &mut stretch) <= most
                });
            }
            match next {
                Some(next) => ((self.q, self.reaction), is_within) = (next, true),
                None if residual <= ROUNDING * size => return Ok(()),
                None => break,
            }
        }
        Err(Error::Unfinished("initial: no equilibrium of the plate that stretches was reached".into()))
    }

    /// Returns the energy of modal coordinates, given the one of the rest by reactions, in J.
    fn energy(&self, q: &[f64], rest: f64, stretch: &mut Stretch) -> f64 {
        self.form.evaluate(q, stretch);
        let bending: f64 = q.iter().zip(&self.modes.squares).map(|(q, square)| 0.5 * square * q * q).sum();
        bending + stretch.energy() - dot(&self.load, q) + rest
    }

    /// Returns the energy of the rest by reactions, in J.
    fn strain_of_rest(&self, contact: &Option<&mut Contact>, reaction: &[f64]) -> f64 {
        let Some(contact) = contact else { return 0.0 };
        let bend = |node: &Node| -> f64 {
            let dof = contact.bounds.dofs[node.bound];
            contact.nodes.iter().zip(reaction).map(|(other, r)| r * other.flexibility[dof]).sum()
        };
        0.5 * contact.nodes.iter().zip(reaction).map(|(node, r)| r * bend(node)).sum::<f64>()
    }

    /// Returns the force that drives the modes without reactions, and its part by bending and load,
    /// against which the sum is rounding.
    fn pull(&self, q: &[f64], stretch: &Stretch) -> [Vec<f64>; 2] {
        let bending = q.iter().zip(&self.modes.squares).map(|(q, square)| square * q);
        let forces: Vec<f64> = self.load.iter().zip(bending).map(|(load, bending)| load - bending).collect();
        let mut pull = forces.clone();
        stretch.add_gradient(-1.0, &mut pull);
        [pull, forces]
    }

    /// Returns the forces of the modes at coordinates and reactions that no equilibrium leaves, by
    /// their norm.
    fn residual(&self, q: &[f64], reaction: &[f64], contact: &Option<&mut Contact>) -> f64 {
        let mut stretch = Stretch::default();
        self.form.evaluate(q, &mut stretch);
        let [mut out, _] = self.pull(q, &stretch);
        let nodes = contact.as_ref().map_or(&[][..], |contact| &contact.nodes);
        nodes.iter().zip(reaction).for_each(|(node, r)| axpy(*r, &node.shapes, &mut out));
        dot(&out, &out).sqrt()
    }

    /// Returns the Hessian of the energy of bending and stretching.
    fn hessian(&self, stretch: &Stretch) -> Mat<f64> {
        let mut hessian = self.form.hessian(stretch);
        self.modes.squares.iter().enumerate().for_each(|(k, square)| hessian[(k, k)] += square);
        hessian
    }

    /// Returns the principal directions of a Hessian.
    fn directions(&self, hessian: &Mat<f64>) -> Result<DescentDirections> {
        let squares = &self.modes.squares;
        let lowest = squares.iter().copied().find(|square| *square > 0.0).unwrap_or(1.0);
        let scales: Vec<f64> = squares.iter().map(|square| square.max(lowest).sqrt().recip()).collect();
        let size = scales.len();
        let scaled = Mat::from_fn(size, size, |i, j| scales[i] * scales[j] * hessian[(i, j)]);
        let (values, vectors) = symmetric_eigen(scaled.as_ref())?;
        let direction = |k| vectors.col_as_slice(k).iter().zip(&scales).map(|(v, scale)| v * scale).collect();
        Ok(DescentDirections { values, directions: (0..size).map(direction).collect() })
    }

    /// Returns how the present contact holds the modes; `None` without contact.
    fn held(&self, contact: &Option<&mut Contact>) -> Result<Option<HeldModes>> {
        let Some(Contact { nodes, bounds, rest, .. }) = contact.as_deref() else { return Ok(None) };
        let places: Vec<usize> = (0..nodes.len()).filter(|&i| self.reaction[i] != 0.0).collect();
        if places.is_empty() {
            return Ok(None);
        }
        let dof = |i: usize| bounds.dofs[nodes[i].bound];
        let flexibility = Mat::from_fn(places.len(), places.len(), |i, j| {
            let [i, j] = [places[i], places[j]];
            0.5 * (nodes[j].flexibility[dof(i)] + nodes[i].flexibility[dof(j)])
        });
        let stiffness = inverse(&flexibility)?;
        let shapes = Mat::from_fn(places.len(), self.q.len(), |i, k| nodes[places[i]].shapes[k]);
        let bound = |i: usize| {
            let side = if self.reaction[i] > 0.0 { &bounds.lower } else { &bounds.upper };
            side[nodes[i].bound] - rest[dof(i)]
        };
        let gaps = Mat::from_fn(places.len(), 1, |i, _| bound(places[i]));
        Ok(Some(HeldModes {
            stiffness: shapes.transpose() * &stiffness * &shapes,
            at_nodes: stiffness,
            shapes,
            gaps,
            places,
        }))
    }

    /// Returns coordinates and reactions by a step of Newton's method with the nodes in contact
    /// held; `None` where others touch or some leave.
    fn polished(
        &self,
        held: &HeldModes,
        tangent: &DescentDirections,
        pull: &[f64],
        contact: &Option<&mut Contact>,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let forces = |q: &[f64]| {
            let q = Mat::from_fn(q.len(), 1, |k, _| q[k]);
            &held.at_nodes * (&held.gaps - &held.shapes * q)
        };
        let pressed = held.shapes.transpose() * forces(&self.q);
        let mut force = pull.to_vec();
        axpy(1.0, pressed.col_as_slice(0), &mut force);
        let mut q = self.q.clone();
        axpy(1.0, &tangent.solve(&force), &mut q);
        let mut reaction = vec![0.0; self.reaction.len()];
        let forces = forces(&q);
        held.places.iter().zip(forces.col_as_slice(0)).for_each(|(&i, r)| reaction[i] = *r);
        let keeps = |(now, then): (&f64, &f64)| *then == 0.0 || now * then > 0.0;
        let is_same = self.reaction.iter().zip(&reaction).all(keeps);
        let is_within = contact
            .as_ref()
            .is_none_or(|contact| contact.crossed(&contact.displacement(&q, &reaction)).is_none());
        (is_same && is_within).then_some((q, reaction))
    }

    /// Returns the reactions of the linearised problem, in N, with all nodes that cross their
    /// bounds admitted.
    fn reactions(
        &self,
        tangent: &DescentDirections,
        pull: &[f64],
        contact: &mut Option<&mut Contact>,
    ) -> Result<Vec<f64>> {
        let Some(contact) = contact else { return Ok(Vec::new()) };
        let mut q = self.q.clone();
        axpy(1.0, &tangent.solve(pull), &mut q);
        loop {
            let Contact { nodes, bounds, .. } = &**contact;
            let solutions: Vec<Vec<f64>> = nodes.iter().map(|node| tangent.solve(&node.shapes)).collect();
            let dofs: Vec<usize> = nodes.iter().map(|node| bounds.dofs[node.bound]).collect();
            let compliance = Mat::from_fn(nodes.len(), nodes.len(), |i, j| {
                dot(&nodes[i].shapes, &solutions[j])
                    + 0.5 * (nodes[j].flexibility[dofs[i]] + nodes[i].flexibility[dofs[j]])
            });
            let free = contact.displacement(&q, &[]);
            let mut reaction = vec![0.0; nodes.len()];
            if !nodes.is_empty() {
                let matrix = inverse(&compliance)?;
                let limits = |side: &[f64]| nodes.iter().map(|node| side[node.bound]).collect::<Vec<_>>();
                let (lower, upper) = (limits(&bounds.lower), limits(&bounds.upper));
                let rhs = &matrix * Mat::from_fn(dofs.len(), 1, |i, _| free[dofs[i]]);
                let mut x = vec![0.0; dofs.len()];
                let mut sides = vec![BoundStatus::Free; dofs.len()];
                let mut answer = Answer { x: &mut x, reaction: &mut reaction };
                DenseProblem { matrix: &matrix, rhs: rhs.col_as_slice(0), lower: &lower, upper: &upper }
                    .solve(&mut sides, &mut answer);
            }
            let mut bent = q.clone();
            solutions.iter().zip(&reaction).for_each(|(solution, r)| axpy(*r, solution, &mut bent));
            let Some(bound) = contact.crossed(&contact.displacement(&bent, &reaction)) else {
                return Ok(reaction);
            };
            if nodes.iter().any(|node| node.bound == bound) {
                return Ok(reaction);
            }
            if bounds.laws.has(bound) {
                return Err(Error::Usage(
                    "initial: in_plane.stretching finds no equilibrium on a stop with a law; expected law = \"linear\""
                        .into(),
                ));
            }
            contact.admit(bound)?;
        }
    }

    /// Returns coordinates and reactions along a step.
    fn moved(&self, length: f64, step: &[f64], reaction: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut q = self.q.clone();
        axpy(length, step, &mut q);
        let between = |(now, then): (&f64, &f64)| now + length * (then - now);
        (q, self.reaction.iter().zip(reaction).map(between).collect())
    }

    /// Leaves an equilibrium that is no minimum, along a direction with its negative stiffness, for
    /// a place of less energy; the largest deflection of the step points upwards.
    fn depart(&mut self, stiffness: f64, direction: &[f64]) {
        let mut shape = vec![0.0; self.modes.shapes.nrows()];
        self.modes.add_shapes(direction, &mut shape);
        let deflections = self.space.shape(&shape).into_iter().step_by(PER_NODE);
        let largest = deflections.fold(0.0_f64, |most, w| if w.abs() > most.abs() { w } else { most });
        let mut stretch = Stretch::default();
        self.form.evaluate(direction, &mut stretch);
        // Along the direction the energy is -|k| a^2/2 + s a^4/2, with the least value at this a.
        let size = (-stiffness / (2.0 * stretch.strain_square())).sqrt();
        axpy(size.copysign(largest), direction, &mut self.q);
    }
}
