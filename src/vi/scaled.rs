//! Common part of SNES and TAO: scaling, the contact-free solve, the final solve on the active set,
//! and retries.
//!
//! PETSc's tolerances are absolute in the unknowns or in the residual, and a plate's unknowns are
//! displacements in m and slopes. Here the methods see `$y = x / (s d)$` with
//! `$d_i = 1/\sqrt{A_{ii}}$`, `$D = \operatorname{diag}(d)$` and s of the size of D b:
//!
//! ```math
//! (D A D)\, y = D b / s,
//! ```
//!
//! whose diagonal and right-hand side have size 1. One set of defaults then serves every mesh, step
//! and unit.
//!
//! A step is first solved with the factor of A that is kept for the run: if that answer lies within
//! the bounds, it is the solution. Otherwise the method finds the dofs that are at their bounds.
//! Its answer is corrected by a solve with these dofs held, unless its residual is at the rounding
//! floor already, and by more of them where rounding spoils the matrix.
//!
//! Bounds that yield are no bounds to the methods: their energy joins the function to minimise,
//! their reaction the residual, and their tangent the diagonal of the matrix. Loaded ones are held
//! at their depth while the other rows are corrected; the check of the answer compares their
//! reactions with the law.

use super::active_set;
use super::kkt::{KktCheck, Residual};
use super::laws::YieldingBound;
use super::{Answer, BoundStatus, Condensed, Problem, Solver};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::distributed::Distributed;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, difference, hadamard};
use crate::linalg::{Engine, Factor, LinearCombination, estimate_factor_error};
use crate::obstacle::Bounds;
use crate::petsc::{Context, INFINITY, Matrix, Reason, Vector};
use std::cell::RefCell;
use std::rc::Rc;

/// Option that makes a method iterate in every step, even in those without contact.
const ALWAYS: &str = "rebond_always_iterate";

/// Tolerance of the methods on their residual, relative to the right-hand side.
pub(super) const RESIDUAL: &str = "1e-10";
const RESIDUAL_VALUE: f64 = 1e-10;

/// Multiple of the rounding of A y above which the tolerance is kept.
const ROUNDINGS: f64 = 8.0;

/// Stationarity up to which an answer needs no correction.
const EXACT: f64 = 1e-14;

/// Share of the largest unknown up to which a violation of a bound counts as rounding.
const ROUNDING: f64 = 1e-13;

/// Scaled problem, as a method sees it.
pub(super) struct Scaled {
    /// Scaled matrix D A D.
    pub matrix: Matrix,
    /// Scaled right-hand side D b / s.
    pub right: RefCell<Vector>,
    pub lower: RefCell<Vector>,
    pub upper: RefCell<Vector>,
    /// Bounds that yield; `None` where all bounds of all ranks are rigid.
    yielding: RefCell<Option<Yielding>>,
}

/// Bounds on y that yield, with work space.
struct Yielding {
    bounds: Vec<YieldingBound>,
    values: [Vector; 2],
}

impl Scaled {
    /// Computes the gradient of the function to minimise, D A D y - D b / s less the reactions of
    /// bounds that yield: the residual of the equations.
    pub fn gradient(&self, y: &Vector, gradient: &mut Vector) -> Result<()> {
        self.matrix.multiply(y, gradient)?;
        gradient.add_scaled(-1.0, &self.right.borrow())?;
        let Some(Yielding { bounds, values: [reactions, _] }) = &mut *self.yielding.borrow_mut() else {
            return Ok(());
        };
        evaluate(bounds, y, reactions, YieldingBound::reaction)?;
        gradient.add_scaled(-1.0, reactions)
    }

    /// Computes the function to minimise, y . D A D y / 2 - y . D b / s and the energy of bounds
    /// that yield, and its gradient.
    pub fn objective(&self, y: &Vector, gradient: &mut Vector) -> Result<f64> {
        self.gradient(y, gradient)?;
        let mut value = 0.5 * (y.dot(gradient)? - y.dot(&self.right.borrow())?);
        if let Some(Yielding { bounds, values: [reactions, roots] }) = &mut *self.yielding.borrow_mut() {
            evaluate(bounds, y, roots, |bound, y| bound.energy(y).sqrt())?;
            // The gradient contains the reactions.
            value += 0.5 * y.dot(reactions)? + roots.dot(roots)?;
        }
        Ok(value)
    }

    /// Returns whether bounds yield, so that the Jacobian depends on y.
    pub fn yields(&self) -> bool {
        self.yielding.borrow().is_some()
    }

    /// Returns the matrix of the Jacobian and the function that updates it. The matrix is a copy
    /// where the method changes its matrix, or bounds yield.
    pub fn derivative(
        self: &Rc<Self>,
        is_changed: bool,
    ) -> Result<(Matrix, impl FnMut(&Vector, &mut Matrix) -> Result<()> + 'static)> {
        let (problem, is_copy) = (self.clone(), is_changed || self.yields());
        let matrix = if is_copy { self.matrix.duplicate()? } else { self.matrix.share()? };
        Ok((matrix, move |y: &_, copy: &mut _| if is_copy { problem.jacobian(y, copy) } else { Ok(()) }))
    }

    /// Computes the Jacobian of the gradient into a matrix of the same pattern.
    fn jacobian(&self, y: &Vector, matrix: &mut Matrix) -> Result<()> {
        matrix.copy_from(&self.matrix)?;
        let Some(Yielding { bounds, values: [tangents, _] }) = &mut *self.yielding.borrow_mut() else {
            return Ok(());
        };
        evaluate(bounds, y, tangents, YieldingBound::stiffness)?;
        matrix.add_to_diagonal(tangents)
    }
}

/// Computes a function of y at the bounds that yield, and 0 elsewhere. Collective.
fn evaluate(
    bounds: &[YieldingBound],
    y: &Vector,
    values: &mut Vector,
    function: impl Fn(&YieldingBound, f64) -> f64,
) -> Result<()> {
    let entries: Vec<f64> =
        y.with_local(|y| bounds.iter().map(|bound| function(bound, y[bound.entry])).collect())?;
    values.with_local_mut(|values| {
        values.fill(0.0);
        bounds.iter().zip(entries).for_each(|(bound, entry)| values[bound.entry] = entry);
    })
}

/// PETSc method for the scaled problem: it solves from the start in y, and returns the reason for
/// stopping and the number of iterations; y is meaningless unless the reason is convergence.
pub(super) type Method = Box<dyn FnMut(&Scaled, &mut Vector) -> Result<(Reason, usize)>>;

/// Option of PETSc without its prefix, and its value.
pub(super) type DefaultOption = (&'static str, &'static str);

/// PETSc methods that share an interface: [`SNES`](super::snes::SNES) or [`TAO`](super::tao::TAO).
#[derive(Clone, Copy)]
pub struct Family {
    pub(super) name: &'static str,
    /// Default options, with which the methods converge on plates, and their values. The first one
    /// names the method.
    pub(super) defaults: &'static [DefaultOption],
    /// Default options of the retry, which starts from zero, where they differ from the others.
    pub(super) safe_defaults: &'static [DefaultOption],
    /// Methods whose answers are right whenever they report convergence.
    pub(super) types: &'static [&'static str],
    /// Methods that a refusal advises, in words.
    pub(super) advised: &'static str,
    /// Returns the reason why another method cannot solve a step.
    pub(super) refusal: fn(&str) -> &'static str,
    /// Refuses further options with a prefix that cannot solve a step.
    pub(super) check: fn(&Context, &str) -> Result<()>,
    /// Creates a method of a name, configured by the options with a prefix.
    pub(super) make: fn(&Rc<Context>, &Rc<Scaled>, &str, &str) -> Result<Method>,
}

impl Family {
    /// Refuses options that cannot solve a step, before anything is built.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] naming the option, or [`Error::Petsc`].
    pub fn check_options(&self, context: &Context) -> Result<()> {
        for prefix in ["", SAFE] {
            let option = format!("{prefix}pc_type");
            let kind = context.option(&option)?.unwrap_or_default();
            let (why, does) = match kind.as_str() {
                "gamg" | "mg" => ("multigrid keeps the sizes of its levels", "changes those of its matrices"),
                "bddc" => ("it takes the matrices of the ranks' cells", "takes rows out of their sum"),
                _ => continue,
            };
            return Err(Error::Usage(format!(
                "-{option} {kind}: {why}, and {} {does} with the contact; take jacobi, or the condensed contact solver",
                self.name
            )));
        }
        for prefix in ["", SAFE] {
            self.kind(context, prefix)?;
            (self.check)(context, prefix)?;
        }
        Ok(())
    }

    /// Returns the method that the option with a prefix names.
    fn kind(&self, context: &Context, prefix: &str) -> Result<String> {
        let (name, usual) = self.defaults[0];
        let option = format!("{prefix}{name}");
        let kind = context.option(&option)?.unwrap_or(usual.into());
        if self.types.contains(&kind.as_str()) {
            return Ok(kind);
        }
        let (why, advised) = ((self.refusal)(&kind), self.advised);
        Err(Error::Usage(format!("-{option} {kind}: {why}; take {advised}")))
    }

    /// Creates the usual method and the one that retries.
    fn methods(&self, context: &Rc<Context>, problem: &Rc<Scaled>) -> Result<[Method; 2]> {
        let method = |prefix: &str| {
            if prefix == SAFE {
                set_defaults(context, prefix, self.safe_defaults)?;
            }
            set_defaults(context, prefix, self.defaults)?;
            let method = (self.make)(context, problem, &self.kind(context, prefix)?, prefix)?;
            context.accept_options(&format!("{prefix}{}_", self.name.to_lowercase()))?;
            Ok(method)
        };
        Ok([method("")?, method(SAFE)?])
    }

    /// Creates the solver of a step; see the [module page](self). Collective.
    ///
    /// The solver assembles and factors the matrix, for bounds on `bounded` dofs, and retries
    /// answers whose KKT residual exceeds the tolerance.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for options that cannot work, [`Error::Singular`], or
    /// [`Error::Petsc`].
    pub fn solver(
        &self,
        engine: &Distributed,
        matrix: &LinearCombination,
        bounded: usize,
        tolerance: f64,
    ) -> Result<Box<dyn Solver<Distributed>>> {
        Ok(Box::new(Bounded::new(self, engine, matrix, bounded, tolerance)?))
    }
}

/// Prefix of the options of the method that retries.
pub(super) const SAFE: &str = "safe_";

/// Sets options under a prefix, except those that the user has set.
pub(super) fn set_defaults(context: &Context, prefix: &str, defaults: &[(&str, &str)]) -> Result<()> {
    defaults.iter().try_for_each(|(name, value)| context.default_option(&format!("{prefix}{name}"), value))
}

/// Returns the product A x, in N, one entry per dof. Collective.
fn product(engine: &Distributed, matrix: &LinearCombination, x: &[f64]) -> Result<Vec<f64>> {
    let [mut product, mut magnitude] = [(); 2].map(|()| vec![0.0; x.len()]);
    engine.multiply_with_magnitude(matrix, x, [&mut product, &mut magnitude])?;
    Ok(product)
}

/// Method of PETSc with the state that it starts from and leaves behind.
struct Bounded {
    family: Family,
    problem: Rc<Scaled>,
    usual: Method,
    safe: Method,
    condensed: Option<Condensed>,
    factor: Box<dyn Factor>,
    check: KktCheck,
    /// Diagonal of D, 1/sqrt(A_ii).
    scale: Vec<f64>,
    norm: f64,
    y: Vector,
    sides: Vec<BoundStatus>,
    always: bool,
    factorisations: u64,
    factor_error: f64,
    tolerance: f64,
    /// Reason why the last attempt failed, for the message to the user.
    complaint: String,
    /// Whether the user has been told about retries.
    has_warned: bool,
}

impl Bounded {
    fn new(
        family: &Family,
        engine: &Distributed,
        matrix: &LinearCombination,
        bounded: usize,
        tolerance: f64,
    ) -> Result<Bounded> {
        let context = engine.context();
        let mut factor = engine.factor(matrix, &[])?;
        let factor_error = estimate_factor_error(engine, matrix, factor.as_mut())?;
        super::require_convergence(factor_error, engine.dofs())?;
        let scale: Vec<f64> = engine.diagonal(matrix)?.iter().map(|a| 1.0 / a.sqrt()).collect();
        let mut scaled = engine.matrix(matrix)?;
        let mut vector = engine.vector()?;
        vector.set_local(&scale)?;
        scaled.scale_symmetrically(&vector)?;
        scaled.set_positive_definite()?;
        let norm = scaled.norm_infinity()?;
        let copy = || Ok::<_, Error>(RefCell::new(vector.duplicate()?));
        let problem = Rc::new(Scaled {
            matrix: scaled,
            right: copy()?,
            lower: copy()?,
            upper: copy()?,
            yielding: RefCell::new(None),
        });
        let [usual, safe] = family.methods(context, &problem)?;
        Ok(Bounded {
            family: *family,
            usual,
            safe,
            problem,
            condensed: None,
            factor,
            check: KktCheck::new(engine, matrix)?,
            scale,
            norm,
            y: vector,
            sides: vec![BoundStatus::Free; bounded],
            always: context.option(ALWAYS)?.is_some(),
            factorisations: 1,
            factor_error,
            tolerance,
            complaint: String::new(),
            has_warned: false,
        })
    }

    /// Solves with a method and completes its answer. The start is the contact-free solution and
    /// the last active set, or zero where `safely`.
    fn iterate(
        &mut self,
        safely: bool,
        engine: &Distributed,
        problem: &Problem,
        answer: &mut Answer,
    ) -> Result<u32> {
        let Problem { rhs: b, bounds, .. } = *problem;
        let Answer { x, reaction } = answer;
        // The factor s is large enough for the tolerance to exceed the rounding of A y.
        let mut right = b.to_vec();
        hadamard(&self.scale, &mut right);
        let size: Vec<f64> = x.iter().zip(&self.scale).map(|(x, d)| x / d).collect();
        let right = engine.dot(&right, &right)?.sqrt();
        let size = engine.dot(&size, &size)?.sqrt();
        let floor = ROUNDINGS * f64::EPSILON * self.norm * size / RESIDUAL_VALUE;
        let s = if right.max(floor) > 0.0 { right.max(floor) } else { 1.0 };

        let unit: Vec<f64> = self.scale.iter().map(|d| s * d).collect();
        let (mut lower, mut upper) = (vec![-INFINITY; x.len()], vec![INFINITY; x.len()]);
        for (i, &dof) in bounds.dofs.iter().enumerate() {
            let [below, above] = bounds.rigid(i);
            lower[dof] = (below / unit[dof]).max(-INFINITY);
            upper[dof] = (above / unit[dof]).min(INFINITY);
        }
        self.scale_yielding(engine, bounds, &unit, s)?;
        let mut y: Vec<f64> =
            x.iter().zip(&unit).map(|(x, unit)| if safely { 0.0 } else { x / unit }).collect();
        for (y, (lower, upper)) in y.iter_mut().zip(lower.iter().zip(&upper)) {
            *y = y.clamp(*lower, *upper);
        }
        if !safely {
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                let [below, above] = bounds.rigid(i);
                y[dof] = self.sides[i].within(below, above).value(lower[dof], upper[dof]).unwrap_or(y[dof]);
            }
        }
        let scaled: Vec<f64> = b.iter().zip(&self.scale).map(|(b, d)| b * d / s).collect();
        self.problem.right.borrow_mut().set_local(&scaled)?;
        self.problem.lower.borrow_mut().set_local(&lower)?;
        self.problem.upper.borrow_mut().set_local(&upper)?;
        self.y.set_local(&y)?;

        let method = if safely { &mut self.safe } else { &mut self.usual };
        let (reason, iterations) = method(&self.problem, &mut self.y)?;
        self.factorisations += iterations as u64;
        if !reason.converged() {
            self.complaint = format!("{} after {iterations} iterations", reason.text);
            x.fill(f64::NAN);
            reaction.fill(0.0);
            self.sides.fill(BoundStatus::Free);
            return Ok(iterations as u32);
        }
        self.complaint = format!("{} after {iterations} iterations, with too large a residual", reason.text);
        self.y.copy_to(&mut y)?;
        x.copy_from_slice(&y);
        hadamard(&unit, x);
        self.complete(engine, problem, answer)?;
        // At least one iteration is reported, because contact was met.
        Ok((iterations as u32).max(1))
    }

    /// Sets the bounds that yield, given the unit of each entry of y and the factor s. With the
    /// first ones both methods begin anew, since their Jacobian is no longer constant.
    fn scale_yielding(&mut self, engine: &Distributed, bounds: &Bounds, unit: &[f64], s: f64) -> Result<()> {
        if bounds.laws.are_rigid() {
            return Ok(());
        }
        let is_new = !self.problem.yields();
        let scaled = |i: usize| {
            let (entry, unit) = (bounds.dofs[i], unit[bounds.dofs[i]]);
            let laws = bounds.laws.numbered(bounds.laws.numbers(i));
            let laws = laws.map(|law| Some(law?.scaled(unit, self.scale[entry] / s)));
            YieldingBound { entry, limits: [bounds.lower[i] / unit, bounds.upper[i] / unit], laws }
        };
        let scaled = (0..bounds.len()).filter(|&i| bounds.laws.has(i)).map(scaled).collect();
        let values = match self.problem.yielding.take() {
            Some(Yielding { values, .. }) => values,
            None => [self.y.duplicate()?, self.y.duplicate()?],
        };
        self.problem.yielding.replace(Some(Yielding { bounds: scaled, values }));
        if is_new {
            [self.usual, self.safe] = self.family.methods(engine.context(), &self.problem)?;
        }
        Ok(())
    }

    /// Finds the active set and the reactions of an answer, and corrects it on that set unless its
    /// residual is at the rounding floor.
    fn complete(&mut self, engine: &Distributed, problem: &Problem, answer: &mut Answer) -> Result<()> {
        let Problem { matrix, rhs: b, bounds, .. } = *problem;
        let x = &mut *answer.x;
        let size = engine.comm().all_reduce_max(x.iter().fold(0.0, |m, x| x.abs().max(m)));
        let forces = product(engine, matrix, x)?;
        for (i, &dof) in bounds.dofs.iter().enumerate() {
            let force = forces[dof] - b[dof];
            let near = |bound: f64| (x[dof] - bound).abs() <= ROUNDING * size;
            let [lower, upper] = bounds.rigid(i);
            self.sides[i] = if near(lower) && force > 0.0 {
                BoundStatus::Lower
            } else if near(upper) && force < 0.0 {
                BoundStatus::Upper
            } else {
                BoundStatus::Free
            };
        }
        self.hold(bounds, size, x);
        let mut forces = self.update_reactions(engine, problem, answer)?;
        let corrections = super::corrections(self.factor_error);
        let Residual { stationarity, .. } =
            self.check.parts(engine, &Problem { length: 1.0, ..*problem }, &[], answer)?;
        // A small residual of a spoilt matrix may still hide large errors of slow motions.
        if corrections == 0 && engine.comm().all_reduce_max(stationarity) <= EXACT {
            return Ok(());
        }
        let is_held = |i: usize| self.sides[i] != BoundStatus::Free || answer.reaction[i] != 0.0;
        let held: Vec<usize> = (0..bounds.len()).filter(|&i| is_held(i)).map(|i| bounds.dofs[i]).collect();
        self.factor.pin(&held)?;
        self.factorisations += 1;
        for _ in 0..=corrections {
            // Solve A dx = b + G^T r - A x for the dofs that are not held.
            let mut correction = difference(b, &forces);
            held.iter().for_each(|&dof| correction[dof] = 0.0);
            self.factor.solve(&mut correction)?;
            add(&correction, answer.x);
            self.hold(bounds, size, answer.x);
            forces = self.update_reactions(engine, problem, answer)?;
        }
        self.factor.pin(&[])
    }

    /// Puts x onto its bounds where it is held or outside by rounding only.
    fn hold(&self, bounds: &Bounds, size: f64, x: &mut [f64]) {
        for (i, &dof) in bounds.dofs.iter().enumerate() {
            let [lower, upper] = bounds.rigid(i);
            x[dof] = match self.sides[i].value(lower, upper) {
                Some(bound) => bound,
                None if (lower - x[dof]).max(x[dof] - upper) <= ROUNDING * size => {
                    x[dof].max(lower).min(upper)
                }
                None => x[dof],
            };
        }
    }

    /// Computes the reactions A x - b where x is held or a bound that yields is loaded. Returns
    /// A x.
    fn update_reactions(
        &self,
        engine: &Distributed,
        problem: &Problem,
        answer: &mut Answer,
    ) -> Result<Vec<f64>> {
        let forces = product(engine, problem.matrix, answer.x)?;
        active_set::set_reactions(&self.sides, problem, &forces, answer);
        Ok(forces)
    }

    /// Solves without bounds. Returns whether the solution lies within them.
    fn free(&mut self, engine: &Distributed, problem: &Problem, x: &mut [f64]) -> Result<bool> {
        x.copy_from_slice(problem.rhs);
        self.factor.solve(x)?;
        Ok(!engine.comm().all_reduce_any(problem.bounds.are_crossed(x)))
    }
}

impl Solver<Distributed> for Bounded {
    fn solve(&mut self, engine: &Distributed, problem: &Problem, answer: &mut Answer) -> Result<u32> {
        if self.free(engine, problem, answer.x)? && !self.always {
            answer.reaction.fill(0.0);
            self.sides.fill(BoundStatus::Free);
            return Ok(0);
        }
        self.iterate(false, engine, problem, answer)
    }

    fn factorisations(&self) -> u64 {
        self.factorisations + self.condensed.as_ref().map_or(0, Solver::<Distributed>::factorisations)
    }

    fn archive(
        &mut self,
        engine: &Distributed,
        matrix: &LinearCombination,
        bounds: &Bounds,
        archive: &mut Archive,
    ) -> Result<()> {
        archive.value(&mut self.factorisations)?;
        BoundStatus::archive(&mut self.sides, archive)?;
        let mut has_retried = self.condensed.is_some();
        archive.value(&mut has_retried)?;
        if has_retried && self.condensed.is_none() {
            self.condensed = Some(Condensed::new(engine, matrix, bounds.len())?);
        }
        self.condensed.as_mut().map_or(Ok(()), |condensed| condensed.archive(engine, matrix, bounds, archive))
    }

    fn factor_error(&self) -> f64 {
        self.factor_error
    }

    fn tolerance(&self) -> f64 {
        self.tolerance
    }

    fn retry(
        &mut self,
        attempt: u32,
        engine: &Distributed,
        problem: &Problem,
        answer: &mut Answer,
    ) -> Result<Option<u32>> {
        if !self.has_warned && engine.context().rank() == 0 {
            eprintln!(
                "rebond: {} ended a step with {}; such steps are solved again, from a cold start and then by the \
                 condensed solver, and counted as retries",
                self.family.name, self.complaint
            );
        }
        self.has_warned = true;
        match attempt {
            0 => {
                self.free(engine, problem, answer.x)?;
                self.iterate(true, engine, problem, answer).map(Some)
            }
            1 => {
                let condensed = match &mut self.condensed {
                    Some(condensed) => condensed,
                    none => none.insert(Condensed::new(engine, problem.matrix, problem.bounds.len())?),
                };
                let iterations = condensed.solve(engine, problem, answer)?;
                for (side, r) in self.sides.iter_mut().zip(answer.reaction.iter()) {
                    *side = BoundStatus::of_sign(-r);
                }
                Ok(Some(iterations))
            }
            // From then on the condensed solver retries by its own safer method.
            _ => match &mut self.condensed {
                Some(condensed) => condensed.retry(attempt - 2, engine, problem, answer),
                None => Ok(None),
            },
        }
    }
}
