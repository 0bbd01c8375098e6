//! Work of a step: numbers of solves and of products with matrices, counted by an engine that
//! passes everything on to the native one.
//!
//! Seconds depend on the machine and its load, these counts do not: a step that becomes more
//! expensive fails here. A count that falls is to be written down as the new one.

use super::common::scenes;
use crate::common::models::PAPER_PLATE;
use faer::Mat;
use rebond::error::Result;
use rebond::linalg::{Engine, Factor, Form, LinearCombination, Native, SchurFactor, SingularMassCells};
use rebond::scheme::{Conserving, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Start, System};
use rebond::simulation::Model;
use std::cell::Cell;
use std::rc::Rc;

/// Counts of expensive operations.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Work {
    /// Solves with the whole factor; a pair of forward and back substitution counts as one.
    solves: u64,
    /// Products with one form, K or M.
    products: u64,
    /// Products of the check, with all forms of the step matrix and their magnitudes at once.
    checks: u64,
    /// Projections between displacements and velocities.
    projections: u64,
}

type Counter = Rc<Cell<Work>>;

fn count(counter: &Counter, add: impl FnOnce(&mut Work)) {
    let mut work = counter.get();
    add(&mut work);
    counter.set(work);
}

struct Counted {
    engine: Native,
    work: Counter,
}

struct CountedFactor {
    factor: Box<dyn Factor>,
    work: Counter,
}

impl Engine for Counted {
    type Comm = <Native as Engine>::Comm;

    fn comm(&self) -> &Self::Comm {
        self.engine.comm()
    }

    fn dofs(&self) -> usize {
        self.engine.dofs()
    }

    fn dot(&self, x: &[f64], y: &[f64]) -> Result<f64> {
        self.engine.dot(x, y)
    }

    fn multiply_cells(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64> {
        count(&self.work, |work| work.products += 1);
        self.engine.multiply_cells(form, x, y)
    }

    fn multiply_with_magnitude(
        &self,
        matrix: &LinearCombination,
        x: &[f64],
        products: [&mut [f64]; 2],
    ) -> Result<()> {
        count(&self.work, |work| work.checks += 1);
        self.engine.multiply_with_magnitude(matrix, x, products)
    }

    fn cell_velocities(&self, mass: &SingularMassCells, x: &[f64], v: &mut [f64]) -> Result<()> {
        count(&self.work, |work| work.projections += 1);
        self.engine.cell_velocities(mass, x, v)
    }

    fn cell_momenta(&self, mass: &SingularMassCells, v: &[f64], y: &mut [f64]) -> Result<()> {
        count(&self.work, |work| work.projections += 1);
        self.engine.cell_momenta(mass, v, y)
    }

    fn diagonal(&self, matrix: &LinearCombination) -> Result<Vec<f64>> {
        self.engine.diagonal(matrix)
    }

    fn factor(&self, matrix: &LinearCombination, contact_dofs: &[usize]) -> Result<Box<dyn Factor>> {
        let factor = self.engine.factor(matrix, contact_dofs)?;
        Ok(Box::new(CountedFactor { factor, work: self.work.clone() }))
    }
}

impl Factor for CountedFactor {
    fn schur_factor(&mut self) -> Option<&mut dyn SchurFactor> {
        Some(self)
    }

    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        count(&self.work, |work| work.solves += 1);
        self.factor.solve(x)
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        self.factor.pin(dofs)
    }
}

impl CountedFactor {
    fn inner(&mut self) -> &mut dyn SchurFactor {
        self.factor.schur_factor().expect("a native factor")
    }
}

impl SchurFactor for CountedFactor {
    fn schur(&mut self) -> &Mat<f64> {
        self.inner().schur()
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64], more: &mut [f64]) -> Result<()> {
        self.inner().forward_to_schur(b, h, more)
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        count(&self.work, |work| work.solves += 1);
        self.inner().back_substitute(values, x)
    }

    fn solve_schur(&mut self, h: &mut [f64]) {
        self.inner().solve_schur(h);
    }
}

/// Number of steps over which the work is counted.
const STEPS: u64 = 20;

/// Returns the system of a scene on the counting engine, and its start.
fn counted(obstacle: f64, pressure: f64) -> (System<Counted>, Start, Counter) {
    let Model { system, start, .. } = scenes::model(&format!(
        r#"
        {PAPER_PLATE}
        mesh = {{ element = "fvs", cells = [10, 4] }}
        support = [{{ edge = "left", kind = "clamped" }}]
        obstacle = [{{ side = "below", height = {obstacle} }}]
        initial = {{ static_pressure = {pressure} }}
        load = {{ pressure = {} }}
        time = {{ scheme = "newmark", mass = "singular", step = 1e-5, end = 1e-3 }}
        "#,
        pressure.min(0.0)
    ));
    let work = Counter::default();
    let System { engine, stiffness, mass, damping, load, bounds, bound_numbers, drive } = system;
    let engine = Counted { engine, work: work.clone() };
    (System { engine, stiffness, mass, damping, load, bounds, bound_numbers, drive }, start, work)
}

/// Returns the work per step, after a step that is not counted.
fn work_per_step(mut scheme: impl Scheme, counter: &Counter) -> Work {
    scheme.advance().unwrap();
    counter.set(Work::default());
    for _ in 0..STEPS {
        scheme.advance().unwrap();
    }
    let Work { solves, products, checks, projections } = counter.get();
    let each = |total: u64| {
        assert_eq!(total % STEPS, 0, "the steps differ: {:?} in {STEPS} steps", counter.get());
        total / STEPS
    };
    Work {
        solves: each(solves),
        products: each(products),
        checks: each(checks),
        projections: each(projections),
    }
}

const NEWMARK: NewmarkParameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step: 1e-5 };

#[test]
fn a_free_step_takes_one_solve_one_product_and_one_check() {
    let (system, start, counter) = counted(-0.3, 14600.0);
    let newmark = Newmark::new(&system, NEWMARK, start.clone()).unwrap();
    let work = Work { solves: 1, products: 1, checks: 1, projections: 0 };
    assert_eq!(work_per_step(newmark, &counter), work, "newmark");

    let work = Work { projections: 2, ..work };
    for massless in [Massless::Reflected, Massless::Equilibrium] {
        let midpoint = Midpoint::new(&system, 1e-5, massless, start.clone()).unwrap();
        assert_eq!(work_per_step(midpoint, &counter), work, "midpoint, {massless:?}");
    }
    let conserving = Conserving::new(&system, 1e-5, start).unwrap();
    assert_eq!(work_per_step(conserving, &counter), work, "conserving");
}

#[test]
fn a_step_in_lasting_contact_takes_no_further_solve() {
    let (system, start, counter) = counted(-0.2, -14600.0);
    let newmark = Newmark::new(&system, NEWMARK, start).unwrap();
    let work = Work { solves: 1, products: 1, checks: 1, projections: 0 };
    assert_eq!(work_per_step(newmark, &counter), work);
}
