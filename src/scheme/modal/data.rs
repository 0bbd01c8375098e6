//! Loads, obstacles and supports in modal coordinates, at one instant.
//!
//! A load F acts on the modes with the force `$h = \Phi^T F$`, and shifts the deflections of the
//! bounded dofs by `$G W$`, where W is the response of the rest of the displacement to F. By the
//! symmetry of that response, `$G W = H^T F$` with the responses H to unit reactions.

use super::all_bounds::AllBounds;
use super::coordinates::Coordinates;
use super::limits::{Limits, mix};
use crate::archive::{Archive, VectorKind};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::vectors::{add, axpy, dot};
use crate::linalg::{Engine, MassModes};
use crate::scheme::System;
use crate::scheme::massless::modal_saddle_point::{ModalSaddlePoint, summed};
use faer::Mat;
use std::rc::Rc;

/// Loads of fixed distribution in modal coordinates: the constant load first, at the factor 1, then
/// the terms in time, then the springs that moving supports stretch.
pub(crate) struct ModalLoads {
    /// Modal forces h, one column per load with one entry per mode, in N per root of kg.
    pub forces: Mat<f64>,
    /// Shifts G W of the bounded deflections, one column per load, in m.
    pub shifts: Mat<f64>,
    /// Responses W, one column per load with one entry per dof of this rank, in m.
    pub responses: Mat<f64>,
    /// Energies `$F_i \cdot W_j$` of the loads in each other's responses, in J.
    pub energies: Mat<f64>,
    /// Modal momenta of the support shapes at 1 m/s, one column per motion.
    pub support_momenta: Mat<f64>,
    global: Rc<AllBounds>,
    /// Limits of all bounds at rest, without loads.
    pub limits: Limits,
}

/// Data of an instant.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct ModalData {
    /// Factors of the loads.
    pub factors: Vec<f64>,
    /// Modal force h, in N per root of kg, one entry per mode.
    #[serde(skip)]
    pub force: Vec<f64>,
    /// Places of the supports, in m, one entry per motion.
    pub places: Vec<f64>,
    /// Response to the load of changing distribution, in m, one entry per dof of this rank; empty
    /// if there is none.
    #[serde(skip)]
    pub wave: Vec<f64>,
    /// Energy of the response to that load, alone and with the others, in J.
    pub wave_energy: f64,
    /// Deflections and bounds of all bounded dofs.
    pub all: Limits,
    /// Deflections and bounds of the candidates.
    pub near: Limits,
}

impl ModalLoads {
    /// Solves for the responses to all loads of a system. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn new<E: Engine>(
        system: &System<E>,
        modes: &MassModes,
        saddle: &ModalSaddlePoint<E>,
        global: &Rc<AllBounds>,
    ) -> Result<ModalLoads> {
        let System { engine, bounds, .. } = system;
        let (dofs, comm) = (engine.dofs(), engine.comm());
        let none = vec![0.0; dofs];
        let mut loads: Vec<&[f64]> = vec![system.load.as_ref().unwrap_or(&none)];
        loads.extend(system.drive.terms.iter().map(|term| &*term.load));
        loads.extend(system.drive.supports.iter().map(|motion| motion.stiffness.as_deref().unwrap_or(&none)));
        let loads = Mat::from_fn(dofs, loads.len(), |i, k| loads[k][i]);
        let responses = saddle.rest(&loads)?;
        let supports = &system.drive.supports;
        let momenta = Mat::from_fn(dofs, supports.len(), |i, k| supports[k].momentum[i]);
        Ok(ModalLoads {
            forces: summed(comm, modes.shapes.transpose() * &loads),
            shifts: global.rows(comm, &responses),
            energies: summed(comm, loads.transpose() * &responses),
            responses,
            support_momenta: summed(comm, modes.shapes.transpose() * momenta),
            limits: global.limits(comm, bounds),
            global: global.clone(),
        })
    }

    /// Returns the data at an instant (s), with the limits of some candidates. Collective.
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
        let comm = system.engine.comm();
        let limits = match drive.bounds {
            Some(_) => self.global.limits(comm, &system.bounds_at(time)?),
            None => self.limits.clone(),
        };
        let mut data = ModalData {
            factors: vec![1.0],
            force: vec![0.0; self.forces.nrows()],
            places: drive.places(time)?,
            all: limits,
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
            let response = saddle.rest(&wave)?;
            let onto = [&modes.shapes, &response, &self.responses];
            let columns =
                onto.into_iter().flat_map(|matrix| (0..matrix.ncols()).map(|k| matrix.col_as_slice(k)));
            let shares: Vec<f64> = columns.map(|column| dot(column, wave.col_as_slice(0))).collect();
            let products = comm.all_reduce_sum_slice(&shares);
            let (forces, energies) = products.split_at(modes.count());
            add(forces, &mut data.force);
            data.wave_energy = 0.5 * energies[0];
            for (factor, energy) in data.factors.iter().zip(&energies[1..]) {
                data.wave_energy += factor * energy;
            }
            add(self.global.rows(comm, &response).col_as_slice(0), &mut data.all.shift);
            data.wave = response.col_as_slice(0).to_vec();
        }
        data.select(candidates);
        Ok(data)
    }

    /// Returns the number of loads.
    pub fn count(&self) -> usize {
        self.forces.ncols()
    }

    /// Returns the deflections of all bounds by the response to the loads, in m, without a load of
    /// changing distribution.
    pub fn shift(&self, data: &ModalData) -> Vec<f64> {
        let mut shift = vec![0.0; self.shifts.nrows()];
        let loads = data.factors.iter().enumerate();
        loads.for_each(|(k, factor)| axpy(*factor, self.shifts.col_as_slice(k), &mut shift));
        shift
    }

    /// Returns the modal force of the constant load.
    pub fn constant_force(&self) -> &[f64] {
        self.forces.col_as_slice(0)
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

    /// Returns the terms of the response at one dof, in m, in the order of [`Self::add_response`].
    pub fn response_at(&self, data: &ModalData, dof: usize) -> impl Iterator<Item = f64> {
        let loads = data.factors.iter().enumerate().map(move |(k, factor)| factor * self.responses[(dof, k)]);
        loads.chain(data.wave.get(dof).copied())
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
        dot(self.constant_force(), q) + reactions + responses.sum::<f64>()
    }
}

impl ModalData {
    /// Saves or restores the data. Collective.
    pub fn archive<E: Engine>(&mut self, archive: &mut Archive, modal: &Coordinates<E>) -> Result<()> {
        let [mut force, mut wave] = [&mut self.force, &mut self.wave].map(std::mem::take);
        archive.value(self)?;
        modal.archive(&mut force, archive)?;
        archive.vector(VectorKind::Dofs, &mut wave)?;
        (self.force, self.wave) = (force, wave);
        Ok(())
    }

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
