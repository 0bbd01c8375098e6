//! Loads, obstacles and supports in modal coordinates, at one instant.
//!
//! A load F acts on the modes with the force `$h = \Phi^T F$`, and shifts the deflections of the
//! bounded dofs by `$G W$`, where W is the response of the rest of the displacement to F. By the
//! symmetry of that response, `$G W = H^T F$` with the responses H to unit reactions.

use crate::error::Result;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Engine, MassModes};
use crate::scheme::System;
use crate::scheme::exact::modal_saddle_point::ModalSaddlePoint;
use faer::Mat;

/// Loads of fixed distribution in modal coordinates: the constant load first, at the factor 1, then
/// the terms in time, then the springs that moving supports stretch.
pub(super) struct ModalLoads {
    /// Modal forces h, one column per load with one entry per mode, in N per root of kg.
    forces: Mat<f64>,
    /// Shifts G W of the bounded deflections, one column per load, in m.
    shifts: Mat<f64>,
    /// Responses W, one column per load with one entry per dof, in m.
    responses: Mat<f64>,
    /// Energies `$F_i \cdot W_j$` of the loads in each other's responses, in J.
    energies: Mat<f64>,
    /// Modal momenta of the support shapes at 1 m/s, one column per motion.
    pub support_momenta: Mat<f64>,
}

/// Data of an instant.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct ModalData {
    /// Factors of the loads.
    pub factors: Vec<f64>,
    /// Modal force h, in N per root of kg, one entry per mode.
    pub force: Vec<f64>,
    /// Places of the supports, in m, one entry per motion.
    pub places: Vec<f64>,
    /// Response to the load of changing distribution, in m, one entry per dof; empty if there is
    /// none.
    pub wave: Vec<f64>,
    /// Energy of the response to that load, alone and with the others, in J.
    pub wave_energy: f64,
    /// Deflections and bounds of all bounded dofs.
    pub all: Limits,
    /// Deflections and bounds of the candidates.
    pub near: Limits,
}

/// Deflections of bounded dofs from the loads alone, and their bounds.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Limits {
    /// Deflections by the response to the loads, in m.
    pub shift: Vec<f64>,
    /// Bounds, in m, relative to the supports.
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
}

impl Limits {
    /// Returns the entries of some bounds.
    fn select(&self, which: &[usize]) -> Limits {
        let each = |of: &[f64]| which.iter().map(|&i| of[i]).collect();
        Limits { shift: each(&self.shift), lower: each(&self.lower), upper: each(&self.upper) }
    }

    /// Sets the entries to the differences of two instants; absent obstacles stay.
    pub fn difference(&mut self, from: &Limits, to: &Limits) {
        let each = |own: &mut Vec<f64>, from: &[f64], to: &[f64]| {
            own.clear();
            own.extend(from.iter().zip(to).map(|(a, b)| if a.is_finite() { b - a } else { 0.0 }));
        };
        each(&mut self.shift, &from.shift, &to.shift);
        each(&mut self.lower, &from.lower, &to.lower);
        each(&mut self.upper, &from.upper, &to.upper);
    }

    fn between(&mut self, from: &Limits, to: &Limits, share: f64) {
        mix(&mut self.shift, &from.shift, &to.shift, share);
        mix(&mut self.lower, &from.lower, &to.lower, share);
        mix(&mut self.upper, &from.upper, &to.upper, share);
    }
}

/// Sets values to those at the fraction `share` of the way from one instant to another.
fn mix(own: &mut [f64], from: &[f64], to: &[f64], share: f64) {
    for (own, (from, to)) in own.iter_mut().zip(from.iter().zip(to)) {
        // Absent obstacles have infinite bounds.
        *own = if from.is_finite() { from + share * (to - from) } else { *from };
    }
}

impl ModalLoads {
    /// Solves for the responses to all loads of a system.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn new<E: Engine>(
        system: &System<E>,
        modes: &MassModes,
        saddle: &ModalSaddlePoint<E>,
    ) -> Result<ModalLoads> {
        let dofs = system.engine.dofs();
        let none = vec![0.0; dofs];
        let mut loads: Vec<&[f64]> = vec![system.load.as_ref().unwrap_or(&none)];
        loads.extend(system.drive.terms.iter().map(|term| &*term.load));
        loads.extend(system.drive.supports.iter().map(|motion| motion.stiffness.as_deref().unwrap_or(&none)));
        let loads = Mat::from_fn(dofs, loads.len(), |i, k| loads[k][i]);
        let responses = saddle.rest(&loads)?;
        let supports = &system.drive.supports;
        let momenta = Mat::from_fn(dofs, supports.len(), |i, k| supports[k].momentum[i]);
        let bounds = &system.bounds;
        Ok(ModalLoads {
            forces: modes.shapes.transpose() * &loads,
            shifts: Mat::from_fn(bounds.len(), loads.ncols(), |i, k| responses[(bounds.dofs[i], k)]),
            energies: loads.transpose() * &responses,
            responses,
            support_momenta: modes.shapes.transpose() * momenta,
        })
    }

    /// Returns the data at an instant (s), with the limits of some candidates.
    ///
    /// # Errors
    /// Returns the errors of loads, obstacles and support motions.
    pub fn at<E: Engine>(
        &self,
        system: &System<E>,
        modes: &MassModes,
        saddle: &ModalSaddlePoint<E>,
        candidates: &[usize],
        time: f64,
    ) -> Result<ModalData> {
        let drive = &system.drive;
        let bounds = system.bounds_at(time)?;
        let shift = vec![0.0; bounds.len()];
        let mut data = ModalData {
            factors: vec![1.0],
            force: vec![0.0; self.forces.nrows()],
            places: drive.places(time)?,
            all: Limits { shift, lower: bounds.lower, upper: bounds.upper },
            ..ModalData::default()
        };
        for term in &drive.terms {
            data.factors.push((term.factor)(time)?);
        }
        data.factors.extend(data.places.iter().map(|place| -place));
        for (k, factor) in data.factors.iter().enumerate() {
            axpy(*factor, self.forces.col_as_slice(k), &mut data.force);
            axpy(*factor, self.shifts.col_as_slice(k), &mut data.all.shift);
        }
        if let Some(load) = &drive.load {
            let mut wave = Mat::zeros(system.engine.dofs(), 1);
            load(time, wave.col_as_slice_mut(0))?;
            for (k, force) in data.force.iter_mut().enumerate() {
                *force += dot(modes.shapes.col_as_slice(k), wave.col_as_slice(0));
            }
            data.wave = saddle.rest(&wave)?.col_as_slice(0).to_vec();
            data.wave_energy = 0.5 * dot(&data.wave, wave.col_as_slice(0));
            for (k, factor) in data.factors.iter().enumerate() {
                data.wave_energy += factor * dot(self.responses.col_as_slice(k), wave.col_as_slice(0));
            }
            for (shift, &dof) in data.all.shift.iter_mut().zip(&bounds.dofs) {
                *shift += data.wave[dof];
            }
        }
        data.select(candidates);
        Ok(data)
    }

    /// Adds the response of the rest of the displacement to the loads of an instant to `u`, in m.
    pub fn add_response(&self, data: &ModalData, u: &mut [f64]) {
        for (k, factor) in data.factors.iter().enumerate() {
            axpy(*factor, self.responses.col_as_slice(k), u);
        }
        if !data.wave.is_empty() {
            axpy(1.0, &data.wave, u);
        }
    }

    /// Returns the elastic energy of the response to the loads, in J.
    pub fn elastic(&self, data: &ModalData) -> f64 {
        let factors = || data.factors.iter().enumerate();
        let pairs = factors().flat_map(|(i, a)| factors().map(move |(j, b)| (i, j, a * b)));
        0.5 * pairs.map(|(i, j, factor)| factor * self.energies[(i, j)]).sum::<f64>() + data.wave_energy
    }

    /// Returns the work F . U of the constant load on modal coordinates and on the reactions of
    /// candidates, in J.
    pub fn work(&self, data: &ModalData, q: &[f64], candidates: &[usize], reaction: &[f64]) -> f64 {
        let responses = data.factors.iter().enumerate().map(|(k, factor)| factor * self.energies[(0, k)]);
        let shift = self.shifts.col_as_slice(0);
        let reactions: f64 = candidates.iter().zip(reaction).map(|(&i, r)| shift[i] * r).sum();
        dot(self.forces.col_as_slice(0), q) + reactions + responses.sum::<f64>()
    }
}

impl ModalData {
    /// Sets the limits of the candidates.
    pub fn select(&mut self, candidates: &[usize]) {
        self.near = self.all.select(candidates);
    }

    /// Returns the data at the fraction `share` of the way from one instant to another.
    pub fn between(from: &ModalData, to: &ModalData, share: f64) -> ModalData {
        let mut data = from.clone();
        mix(&mut data.factors, &from.factors, &to.factors, share);
        mix(&mut data.force, &from.force, &to.force, share);
        mix(&mut data.places, &from.places, &to.places, share);
        mix(&mut data.wave, &from.wave, &to.wave, share);
        data.wave_energy += share * (to.wave_energy - from.wave_energy);
        data.all.between(&from.all, &to.all, share);
        data.near.between(&from.near, &to.near, share);
        data
    }
}
