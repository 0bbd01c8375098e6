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
use crate::scheme::exact::reduction::ReducedModel;
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
    /// Shift of the deflections by the loads, in m, one entry per bound.
    pub shift: Vec<f64>,
    /// Bounds, in m, relative to the supports.
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Places of the supports, in m, one entry per motion.
    pub places: Vec<f64>,
    /// Load of changing distribution, in N, one entry per dof; empty if there is none.
    pub wave: Vec<f64>,
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

    /// Returns the data at an instant (s).
    ///
    /// # Errors
    /// Returns the errors of loads, obstacles and support motions.
    pub fn at<E: Engine>(
        &self,
        system: &System<E>,
        modes: &MassModes,
        reduction: &ReducedModel,
        time: f64,
    ) -> Result<ModalData> {
        let drive = &system.drive;
        let mut data = ModalData {
            factors: vec![1.0],
            force: vec![0.0; self.forces.nrows()],
            shift: vec![0.0; self.shifts.nrows()],
            places: drive.places(time)?,
            ..ModalData::default()
        };
        for term in &drive.terms {
            data.factors.push((term.factor)(time)?);
        }
        data.factors.extend(data.places.iter().map(|place| -place));
        for (k, factor) in data.factors.iter().enumerate() {
            axpy(*factor, self.forces.col_as_slice(k), &mut data.force);
            axpy(*factor, self.shifts.col_as_slice(k), &mut data.shift);
        }
        if let Some(load) = &drive.load {
            data.wave.resize(system.engine.dofs(), 0.0);
            load(time, &mut data.wave)?;
            for (k, force) in data.force.iter_mut().enumerate() {
                *force += dot(modes.shapes.col_as_slice(k), &data.wave);
            }
            for (i, shift) in data.shift.iter_mut().enumerate() {
                *shift += dot(reduction.flexibility.col_as_slice(i), &data.wave);
            }
        }
        let bounds = system.bounds_at(time)?;
        (data.lower, data.upper) = (bounds.lower, bounds.upper);
        Ok(data)
    }

    /// Adds the response of the rest of the displacement to the loads of an instant to `u`, in m.
    pub fn add_response<E: Engine>(
        &self,
        data: &ModalData,
        saddle: &ModalSaddlePoint<E>,
        u: &mut [f64],
    ) -> Result<()> {
        for (k, factor) in data.factors.iter().enumerate() {
            axpy(*factor, self.responses.col_as_slice(k), u);
        }
        if !data.wave.is_empty() {
            let wave = Mat::from_fn(data.wave.len(), 1, |i, _| data.wave[i]);
            axpy(1.0, saddle.rest(&wave)?.col_as_slice(0), u);
        }
        Ok(())
    }

    /// Returns the elastic energy of the response to the loads of fixed distribution, in J.
    pub fn elastic(&self, data: &ModalData) -> f64 {
        let factors = || data.factors.iter().enumerate();
        let pairs = factors().flat_map(|(i, a)| factors().map(move |(j, b)| (i, j, a * b)));
        0.5 * pairs.map(|(i, j, factor)| factor * self.energies[(i, j)]).sum::<f64>()
    }

    /// Returns the work F . U of the constant load on modal coordinates and reactions, in J.
    pub fn work(&self, data: &ModalData, q: &[f64], reaction: &[f64]) -> f64 {
        let responses = data.factors.iter().enumerate().map(|(k, factor)| factor * self.energies[(0, k)]);
        dot(self.forces.col_as_slice(0), q)
            + dot(self.shifts.col_as_slice(0), reaction)
            + responses.sum::<f64>()
    }
}

impl ModalData {
    /// Sets the data to those at the fraction `share` of the way from one instant to another.
    pub fn between(&mut self, from: &ModalData, to: &ModalData, share: f64) {
        let mix = |own: &mut [f64], from: &[f64], to: &[f64]| {
            for (own, (from, to)) in own.iter_mut().zip(from.iter().zip(to)) {
                // Absent obstacles have infinite bounds.
                *own = if from.is_finite() { from + share * (to - from) } else { *from };
            }
        };
        mix(&mut self.factors, &from.factors, &to.factors);
        mix(&mut self.force, &from.force, &to.force);
        mix(&mut self.shift, &from.shift, &to.shift);
        mix(&mut self.lower, &from.lower, &to.lower);
        mix(&mut self.upper, &from.upper, &to.upper);
        mix(&mut self.places, &from.places, &to.places);
        mix(&mut self.wave, &from.wave, &to.wave);
    }
}
