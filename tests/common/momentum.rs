//! Balance of momentum of a whole plate: supports, obstacles, loads and damping change it step by
//! step, on one process or on ranks.

use rebond::Result;
use rebond::archive::Archive;
use rebond::energy::Energies;
use rebond::linalg::{Engine, Form};
use rebond::obstacle::Bounds;
use rebond::scene::Scene;
use rebond::scheme::{Approach, Scheme, SchemeSpec, Solution, Statistics, StepBalance, StepRecord};
use rebond::simulation::{self, Model, Observer, Row};
use std::cell::RefCell;

/// Relative rounding error of a balance.
pub const ROUNDING: f64 = 1e-10;

/// Every row of a run: forces and impulses by column.
#[derive(Default)]
struct Rows(Vec<Vec<f64>>);

impl Observer for Rows {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.0.push(row.forces.to_vec());
        Ok(())
    }
}

/// Returns the columns of forces and impulses of every row of a run.
pub fn force_rows<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    solver: &simulation::SolverFactory<E>,
) -> Result<Vec<Vec<f64>>> {
    let mut rows = Rows::default();
    let (_, ended) = simulation::run(scene, model, solver, &mut rows)?;
    ended?;
    Ok(rows.0)
}

/// Loads and damping of a plate of 1 m2, all of whose supports move together.
pub struct Acting<'a> {
    /// Sum of the constant loads, in N.
    pub constant: f64,
    /// Pressure in time, in Pa.
    pub pressure: &'a dyn Fn(f64) -> f64,
    /// Place of the supports, in m.
    pub place: &'a dyn Fn(f64) -> f64,
    /// Damping by the mass, in 1/s.
    pub drag: f64,
}

/// Nothing acts.
pub const STILL: Acting = Acting { constant: 0.0, pressure: &|_| 0.0, place: &|_| 0.0, drag: 0.0 };

/// Upward momentum of the plate as a function of velocities.
///
/// The weight at 1 m/s^2 is minus the sum of the rows of the mass: its product with a rate over the
/// free dofs is the momentum of the whole plate, held cells included, for the consistent mass and
/// for the means over cells of the singular mass.
pub struct Upward<'m, E: Engine> {
    model: &'m Model<E>,
    /// Weight at 1 m/s^2, in N, one entry per dof.
    weight: Vec<f64>,
    /// Mass of the whole plate, in kg.
    mass: f64,
}

impl<'m, E: Engine> Upward<'m, E> {
    /// Takes the weight of the plate under a gravity (m/s^2), in N, one entry per dof, and its
    /// mass, in kg.
    pub fn new(model: &'m Model<E>, weight: &[f64], gravity: f64, mass: f64) -> Upward<'m, E> {
        Upward { model, weight: weight.iter().map(|of| of / gravity).collect(), mass }
    }

    /// Returns the momentum for a rate relative to supports that all move at the velocities (m/s)
    /// of `supports`, in kg m/s. With the modal mass only the modes carry inertia. Collective.
    pub fn momentum(&self, rate: &[f64], supports: &[f64]) -> Result<f64> {
        let engine = &self.model.system.engine;
        let relative = match &self.model.system.mass {
            Form::Modal { modes, .. } => {
                assert!(supports.is_empty(), "the modes alone carry the inertia of supports");
                let mut v = vec![0.0; modes.count()];
                engine.project(&self.model.system.mass, rate, &mut v)?;
                let mut sum = 0.0;
                for (k, v) in v.iter().enumerate() {
                    sum += v * engine.dot(&self.weight, modes.shapes.col_as_slice(k))?;
                }
                sum
            }
            _ => engine.dot(&self.weight, rate)?,
        };
        Ok(supports.iter().fold(-relative, |sum, rate| sum + self.mass * rate))
    }

    /// Returns what the balance needs of a scheme at its instant. Collective.
    fn sample(&self, scheme: &mut dyn Scheme, acting: &Acting) -> Result<Sample> {
        let (rate, rates) = (scheme.velocity()?, scheme.support_rates()?);
        let balance = scheme.balance()?;
        let loads = balance.loads.iter().map(|(t, weight)| weight * (acting.pressure)(*t));
        // A scheme whose steps are not those of the grid follows the supports from step to step,
        // and damping acts relative to where it has them.
        let mut slip = 0.0;
        if let Some(motion) = self.model.system.drive.supports.first() {
            let travelled =
                (acting.place)(scheme.time()) - (acting.place)(scheme.time() - scheme.record().dt);
            let frame = balance.support_rates.first().map_or(0.0, |rate| rate * scheme.record().dt);
            slip = (travelled - frame) * self.momentum(&motion.shape, &[])?;
        }
        Ok(Sample {
            // All supports of these scenes move together.
            momentum: self.momentum(&rate, &rates[..rates.len().min(1)])?,
            relative: self.momentum(&rate, &[])?,
            place: self.momentum(scheme.displacement(), &[])?,
            slip,
            load: acting.constant + loads.sum::<f64>(),
        })
    }

    /// Runs a scheme and asserts at every step that the forces by name, the loads and the damping
    /// add up to the change of momentum. Returns the columns of forces of every row. `at` is called
    /// at each instant. Collective.
    pub fn check(
        &self,
        scene: &Scene,
        scheme: Box<dyn Scheme + '_>,
        acting: &Acting,
        at: &mut dyn FnMut(&mut dyn Scheme),
    ) -> Result<Vec<Vec<f64>>> {
        let samples = RefCell::new(Vec::new());
        let mut note = |scheme: &mut dyn Scheme| {
            at(scheme);
            samples.borrow_mut().push(self.sample(scheme, acting)?);
            Ok(())
        };
        let mut rows = Rows::default();
        let mut watched = Watched { scheme, note: &mut note };
        let (_, ended) = simulation::run_scheme(scene, self.model, &mut watched, 0.0, &mut rows)?;
        drop(watched);
        ended?;
        let (Rows(rows), samples) = (rows, samples.into_inner());
        assert_eq!(rows.len(), samples.len());
        let columns = scene.force_columns();
        let impulse = |row: &[f64]| -> f64 {
            let named = columns.iter().zip(row).filter(|(name, _)| name.starts_with("impulse"));
            named.map(|(_, value)| value).sum()
        };
        let step = scene.time.step;
        let is_newmark = matches!(scene.time.scheme, SchemeSpec::Newmark { .. });
        let mut scale = samples[0].momentum.abs();
        for (n, (pair, row)) in samples.windows(2).zip(&rows[1..]).enumerate() {
            let [before, now] = pair else { continue };
            let chord = (now.place - before.place) / step;
            let (lost, pushed) = match is_newmark {
                // The first equation of motion damps the first increment.
                true if n == 0 => (0.5 * (chord + now.relative), 0.5 * (before.load + now.load)),
                true => (0.5 * (before.relative + now.relative), 0.5 * (before.load + now.load)),
                false => (chord + now.slip / step, now.load),
            };
            let given = impulse(row);
            scale = scale.max(now.momentum.abs()).max(given.abs()).max((step * pushed).abs());
            let error = now.momentum - before.momentum - given - step * (pushed - acting.drag * lost);
            assert!(error.abs() <= ROUNDING * scale, "step {}: {error:e} of {scale:e} N s", n + 1);
        }
        Ok(rows)
    }
}

/// Quantities of one instant.
struct Sample {
    /// Momentum, and momentum relative to the supports, in kg m/s.
    momentum: f64,
    relative: f64,
    /// Product of the masses and their deflections relative to the supports, in kg m.
    place: f64,
    /// Product of the masses and the path by which the scheme lags behind the supports, in kg m.
    slip: f64,
    /// Loads as the scheme samples them, in N.
    load: f64,
}

/// Scheme that is seen at the start and after every step of a run.
struct Watched<'w> {
    scheme: Box<dyn Scheme + 'w>,
    note: &'w mut dyn FnMut(&mut dyn Scheme) -> Result<()>,
}

impl Solution for Watched<'_> {
    fn record(&self) -> &StepRecord {
        self.scheme.record()
    }

    fn displacement(&self) -> &[f64] {
        self.scheme.displacement()
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        self.scheme.velocity()
    }

    fn support_rates(&self) -> Result<Vec<f64>> {
        self.scheme.support_rates()
    }

    fn limits(&self) -> &Bounds {
        self.scheme.limits()
    }

    fn energies(&self) -> Result<Energies> {
        self.scheme.energies()
    }

    fn approach(&self, bound: usize) -> Approach {
        self.scheme.approach(bound)
    }
}

impl Scheme for Watched<'_> {
    fn advance(&mut self) -> Result<()> {
        if self.scheme.step() == 0 {
            (self.note)(self.scheme.as_mut())?;
        }
        self.scheme.advance()?;
        (self.note)(self.scheme.as_mut())
    }

    fn keep_balance(&mut self) -> Result<()> {
        self.scheme.keep_balance()
    }

    fn balance(&mut self) -> Result<StepBalance> {
        self.scheme.balance()
    }

    fn has_mean_reactions(&self) -> bool {
        self.scheme.has_mean_reactions()
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.scheme.archive(archive)
    }

    fn statistics(&self) -> Statistics {
        self.scheme.statistics()
    }
}
