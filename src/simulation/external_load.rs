//! Loads that the caller of a model adds to the loads of its scene.

use super::Model;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::scene::Scene;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// Number of instants whose loads are kept: schemes look back no further than two steps.
const KEPT: usize = 4;

/// Distance from an instant of a step, in steps, that is only rounding of the time.
const ROUNDING: f64 = 1e-6;

/// Load that its holder sets from step to step, linear in time between the instants of the steps.
///
/// A load that is set holds from the instant [`ExternalLoad::next_time`], the first one that the
/// scheme has not asked for, until another is set. It serves one scheme. A scheme asks for the
/// loads of the first step as it starts, and later for the load at the end of each step. Newmark's
/// scheme, which computes `$U^{n+1}$` as it arrives at instant n, asks one step further ahead.
///
/// ```
/// use rebond::{linalg::Engine, scene::Scene, simulation::Model};
///
/// let scene = Scene::load("scenes/csma2013/fig4.toml", &["mesh.cells=[4, 2]".into()])?;
/// let mut model = Model::new(&scene)?;
/// let load = model.external_load(&scene);
/// let mut force = vec![0.0; model.system.engine.dofs()];
/// let mut scheme = model.scheme(&scene)?;
/// for _ in 0..10 {
///     force[0] = 3.0 * load.next_time(); // N, at dof 0
///     load.set(&force);
///     scheme.advance()?;
/// }
/// # Ok::<(), rebond::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ExternalLoad(Rc<RefCell<LoadHistory>>);

/// Loads at the last instants that a scheme has asked for.
#[derive(Debug)]
struct LoadHistory {
    /// Length of a step, in s.
    step: f64,
    /// Load from the next instant on, in N, one entry per dof.
    present: Vec<f64>,
    /// Numbers of the instants, ascending, and their loads (N).
    instants: VecDeque<(u64, Vec<f64>)>,
}

impl LoadHistory {
    /// Returns the number of the first instant that no scheme has asked for.
    fn next(&self) -> u64 {
        self.instants.back().map_or(0, |(number, _)| number + 1)
    }

    /// Fixes the load up to an instant.
    fn extend(&mut self, number: u64) {
        if number >= self.next() {
            if self.instants.len() == KEPT {
                self.instants.pop_front();
            }
            self.instants.push_back((number, self.present.clone()));
        }
    }

    /// Adds the load at a time (s) to `sum`.
    fn add(&mut self, time: f64, sum: &mut [f64]) {
        let position = (time / self.step).max(0.0);
        self.extend((position - ROUNDING).ceil() as u64);
        let after = self.instants.partition_point(|(number, _)| *number as f64 <= position + ROUNDING);
        // The loads around the position; the load is constant before the first of them.
        let (low, high) = (after.max(1) - 1, after.min(self.instants.len() - 1));
        let [(from, at_from), (to, at_to)] = [&self.instants[low], &self.instants[high]];
        let weight = (position - *from as f64) / (to - from).max(1) as f64;
        if weight <= ROUNDING || low == high {
            axpy(1.0, at_from, sum);
        } else {
            axpy(1.0 - weight, at_from, sum);
            axpy(weight, at_to, sum);
        }
    }
}

impl ExternalLoad {
    /// Sets the load from the next instant on, in N, one entry per dof.
    ///
    /// # Panics
    ///
    /// Panics where `force` has another length than the displacement.
    pub fn set(&self, force: &[f64]) {
        self.0.borrow_mut().present.copy_from_slice(force);
    }

    /// Returns the time of the next instant that the scheme asks for, in s.
    pub fn next_time(&self) -> f64 {
        let history = self.0.borrow();
        history.next() as f64 * history.step
    }
}

impl<E: Engine> Model<E> {
    /// Adds a load to the model that the caller sets from step to step, 0 at first.
    pub fn external_load(&mut self, scene: &Scene) -> ExternalLoad {
        let present = vec![0.0; self.system.engine.dofs()];
        let history = LoadHistory { step: scene.time.step, present, instants: VecDeque::new() };
        let load = ExternalLoad(Rc::new(RefCell::new(history)));
        let added = Rc::clone(&load.0);
        self.add_load(move |time, sum| {
            added.borrow_mut().add(time, sum);
            Ok(())
        });
        load
    }

    /// Adds a load to the model: a function that adds the load at an instant (s) to a vector, in N,
    /// one entry per dof of this process. It may be called for an instant more than once.
    pub fn add_load(&mut self, load: impl Fn(f64, &mut [f64]) -> Result<()> + 'static) {
        let of_scene = self.system.drive.load.take();
        self.system.drive.load = Some(Box::new(move |time, sum| {
            of_scene.iter().try_for_each(|of_scene| of_scene(time, sum))?;
            load(time, sum)
        }));
    }
}
