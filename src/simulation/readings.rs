//! Quantities at the probes.

use super::effects::{BuildContext, Lift};
use super::frictional_probes::FrictionalProbes;
use super::nodal_motion::NodalMotion;
use super::stresses::{Measure, MidplaneStresses, PlateCurvatures};
use crate::archive::Archive;
use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::plate::Section;
use crate::scene::{self, FieldInput, ProbeQuantity, StressComponent};
use crate::scheme::{Solution, System};
use crate::stress::Moments;
use std::rc::Rc;

/// Sum over the engine's dofs of this process, with its share of every lift, per metre.
pub type FramedProbe = (Probe, Vec<f64>);

/// Quantity at a probe, as a function of one or three sums over the dofs.
struct Reading {
    quantity: ProbeQuantity,
    /// Deflection, slope, or the components xx, yy and xy of the moments or of the stresses at the
    /// upper surface; empty for membrane forces.
    terms: Vec<FramedProbe>,
    /// Stresses (Pa) or forces (N/m) of the mid-plane that do not depend on the deflection.
    middle: Moments,
    /// The same by stretching in all cells around; `None` without.
    stretched: Option<MidplaneStresses>,
}

/// Quantities at the probes.
pub(super) struct Readings {
    /// One entry per probe.
    readings: Vec<Reading>,
    /// Dofs of the readings of displacements, each once: components and probes share most of them.
    dofs: Vec<usize>,
    /// Motions of the supports.
    motions: Vec<Rc<FieldInput>>,
    motion: Rc<NodalMotion>,
    friction: FrictionalProbes,
}

/// Mean accelerations at the probes over the last step, from the velocities at its two ends.
#[derive(Debug, Default)]
pub(super) struct Accelerations {
    /// Index of each probe that records its acceleration.
    probes: Vec<usize>,
    /// Velocities at the end of the last step, in m/s.
    velocities: Vec<f64>,
    /// Accelerations, in m/s^2; 0 at the start.
    values: Vec<f64>,
    is_started: bool,
}

impl Readings {
    /// Prepares the quantities of a scene's probes, which have these deflections, on supports with
    /// some lifts, given the probes of friction. Collective.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        deflections: &[FramedProbe],
        lifts: &[Lift],
        motion: &Rc<NodalMotion>,
        curvatures: Option<&PlateCurvatures>,
        friction: FrictionalProbes,
    ) -> Result<Readings> {
        let shapes: Vec<&[f64]> = lifts.iter().map(|lift| &*lift.shape).collect();
        let reading = |(probe, deflection): (&scene::Probe, &FramedProbe)| {
            let quantity = probe.quantity;
            let terms = match (quantity, curvatures) {
                (ProbeQuantity::SlopeX, _) => vec![ground.slope(probe, 0, &shapes)?],
                (ProbeQuantity::SlopeY, _) => vec![ground.slope(probe, 1, &shapes)?],
                // Whoever asks for moments has the curvatures prepared.
                (
                    ProbeQuantity::Moment(_) | ProbeQuantity::Stress(..) | ProbeQuantity::VonMises(_),
                    Some(curvatures),
                ) => {
                    let is_moment = matches!(quantity, ProbeQuantity::Moment(_));
                    let map = |section: &Section| {
                        section.moment_per_curvature()
                            * if is_moment { 1.0 } else { section.stress_per_moment() }
                    };
                    let key = format!("probe \"{}\"", probe.name);
                    let components = curvatures.mapped_at(ground, &key, probe.at, map)?;
                    components
                        .iter()
                        .map(|component| ground.framed(Some(component), None, &shapes))
                        .collect::<Result<_>>()?
                }
                (quantity, _) if quantity.is_of_friction() => Vec::new(),
                (ProbeQuantity::Membrane(_), _) => Vec::new(),
                _ => vec![deflection.clone()],
            };
            let measure = match quantity {
                ProbeQuantity::Membrane(_) => Some(Measure::Force),
                ProbeQuantity::Stress(..) | ProbeQuantity::VonMises(_) => Some(Measure::Stress),
                _ => None,
            };
            let mut reading = Reading { quantity, terms, middle: Moments::default(), stretched: None };
            let (Some(curvatures), Some(measure)) = (curvatures, measure) else { return Ok(reading) };
            reading.middle = curvatures.middle_at(ground, probe.at, measure)?;
            if ground.scene.stretches() {
                let point = Point::from(probe.at);
                let around: Vec<_> = ground.mesh.cells_at(point).map(|cell| (cell, point)).collect();
                reading.stretched =
                    Some(curvatures.stretching_of(ground.mesh, around.into_iter(), measure)?);
            }
            Ok(reading)
        };
        let readings = ground.scene.output.probes.iter().zip(deflections).map(reading);
        let readings: Vec<Reading> = readings.collect::<Result<_>>()?;
        let dofs = dofs(readings.iter().filter(|reading| is_of_displacement(reading.quantity)));
        let motions = lifts.iter().map(|lift| lift.motion.clone()).collect();
        Ok(Readings { readings, dofs, motions, motion: motion.clone(), friction })
    }

    /// Returns whether all probes record deflections, beside supports that do not move.
    pub fn are_deflections_only(&self) -> bool {
        let is_deflection = |reading: &Reading| reading.quantity == ProbeQuantity::Deflection;
        self.motions.is_empty() && self.readings.iter().all(is_deflection)
    }

    /// Computes the quantities at the present instant of a scheme. Collective.
    pub fn read<E: Engine>(
        &self,
        system: &System<E>,
        accelerations: &Accelerations,
        scheme: &mut dyn Solution,
        values: &mut [f64],
    ) -> Result<()> {
        let places = self.motions.iter().map(|motion| motion.at(Point::origin(), scheme.time()));
        let places: Vec<f64> = places.collect::<Result<_>>()?;
        let displacement: Vec<f64> = self.dofs.iter().map(|&dof| scheme.displacement_of(dof)).collect();
        let shares = self.sums(is_of_displacement, (&self.dofs, &displacement), &places);
        let totals = system.engine.comm().all_reduce_sum_slice(&shares);
        let mut sums = totals.as_slice();
        let readings = || self.readings.iter().enumerate();
        for (probe, reading) in readings().filter(|(_, reading)| is_of_displacement(reading.quantity)) {
            let (terms, rest) = sums.split_at(reading.terms.len());
            sums = rest;
            let stretched = match &reading.stretched {
                Some(stretched) => {
                    let shape = self.motion.relative(&system.engine.to_local(scheme.displacement())?);
                    mean(&stretched.of_shape(&shape)?, system.engine.comm())
                }
                None => Moments::default(),
            };
            values[probe] = reading.value(terms, stretched);
        }
        self.friction.read(system.engine.comm(), scheme, values);
        let velocities = self.velocities(system, scheme, ProbeQuantity::Velocity)?;
        let moving = readings().filter(|(_, reading)| reading.quantity == ProbeQuantity::Velocity);
        moving.zip(velocities).for_each(|((probe, _), velocity)| values[probe] = velocity);
        let probes = accelerations.probes.iter().zip(&accelerations.values);
        probes.for_each(|(&probe, &value)| values[probe] = value);
        Ok(())
    }

    /// Returns the velocities at the probes that record a quantity, in m/s. Collective.
    fn velocities<E: Engine>(
        &self,
        system: &System<E>,
        scheme: &mut dyn Solution,
        quantity: ProbeQuantity,
    ) -> Result<Vec<f64>> {
        let is_chosen = |other: ProbeQuantity| other == quantity;
        if !self.readings.iter().any(|reading| is_chosen(reading.quantity)) {
            return Ok(Vec::new());
        }
        let mut rates = scheme.support_rates()?;
        rates.resize(self.motions.len(), 0.0);
        let dofs = dofs(self.readings.iter().filter(|reading| is_chosen(reading.quantity)));
        let velocity = scheme.velocity_of(&dofs)?;
        let shares = self.sums(is_chosen, (&dofs, &velocity), &rates);
        Ok(system.engine.comm().all_reduce_sum_slice(&shares))
    }

    /// Returns the probes of deflections with their shares of every lift.
    pub fn deflections(&self) -> impl Iterator<Item = &FramedProbe> {
        let chosen = self.readings.iter().filter(|reading| reading.quantity == ProbeQuantity::Deflection);
        chosen.flat_map(|reading| &reading.terms)
    }

    /// Returns this process's share of the sums of chosen readings, for given sorted dofs with
    /// their values and for values of the support motions.
    fn sums(
        &self,
        is_chosen: impl Fn(ProbeQuantity) -> bool,
        (dofs, values): (&[usize], &[f64]),
        moved: &[f64],
    ) -> Vec<f64> {
        let dof = |dof| dofs.binary_search(&dof).map_or(0.0, |place| values[place]);
        let sum = |(probe, lifts): &FramedProbe| {
            let framed = probe.weights().iter().map(|&(number, weight)| weight * dof(number)).sum();
            lifts.iter().zip(moved).fold(framed, |sum: f64, (lift, moved)| sum + moved * lift)
        };
        let chosen = self.readings.iter().filter(|reading| is_chosen(reading.quantity));
        chosen.flat_map(|reading| reading.terms.iter().map(&sum)).collect()
    }
}

fn is_of_displacement(quantity: ProbeQuantity) -> bool {
    ![ProbeQuantity::Velocity, ProbeQuantity::Acceleration].contains(&quantity)
}

/// Returns the dofs of some readings in their order, each once.
fn dofs<'r>(readings: impl Iterator<Item = &'r Reading>) -> Vec<usize> {
    let weights = readings.flat_map(|reading| &reading.terms).flat_map(|(probe, _)| probe.weights());
    let mut dofs: Vec<usize> = weights.map(|(dof, _)| *dof).collect();
    dofs.sort_unstable();
    dofs.dedup();
    dofs
}

/// Returns the mean of the stresses of all processes; zero of none. Collective.
fn mean(stresses: &[Moments], comm: &impl Communicator) -> Moments {
    let sum = stresses.iter().fold(Moments::default(), |sum, stress| sum.plus(*stress));
    let [xx, yy, xy, count] = comm.all_reduce_sum([sum.xx, sum.yy, sum.xy, stresses.len() as f64]);
    Moments { xx, yy, xy }.times(1.0 / count.max(1.0))
}

impl Accelerations {
    /// Returns the accelerations of the probes that record them, before the first step.
    pub fn new(scene: &scene::Scene) -> Accelerations {
        let probes = scene.output.probes.iter().enumerate();
        let chosen = probes.filter(|(_, probe)| probe.quantity == ProbeQuantity::Acceleration);
        let probes: Vec<usize> = chosen.map(|(index, _)| index).collect();
        let zeros = vec![0.0; probes.len()];
        Accelerations { probes, velocities: zeros.clone(), values: zeros, is_started: false }
    }

    /// Takes the velocities at the end of a step. Collective.
    pub fn note<E: Engine>(
        &mut self,
        readings: &Readings,
        system: &System<E>,
        scheme: &mut dyn Solution,
    ) -> Result<()> {
        if self.probes.is_empty() {
            return Ok(());
        }
        let velocities = readings.velocities(system, scheme, ProbeQuantity::Acceleration)?;
        if std::mem::replace(&mut self.is_started, true) {
            let dt = scheme.record().dt;
            let pairs = velocities.iter().zip(&self.velocities);
            self.values = pairs.map(|(now, before)| (now - before) / dt).collect();
        }
        self.velocities = velocities;
        Ok(())
    }

    /// Saves or restores the velocities; without acceleration probes there is nothing to save.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        if self.probes.is_empty() {
            return Ok(());
        }
        archive.value(&mut self.velocities)?;
        archive.value(&mut self.values)?;
        archive.value(&mut self.is_started)
    }
}

impl Reading {
    /// Returns the quantity from the sums of its terms over all ranks and the part of the
    /// mid-plane by stretching.
    fn value(&self, sums: &[f64], stretched: Moments) -> f64 {
        let middle = self.middle.plus(stretched);
        let [xx, yy, xy] = [0, 1, 2].map(|k| sums.get(k).copied().unwrap_or(0.0));
        let moments = Moments { xx, yy, xy };
        let part = |moments: Moments, component: StressComponent| match component {
            StressComponent::Xx => moments.xx,
            StressComponent::Yy => moments.yy,
            StressComponent::Xy => moments.xy,
            StressComponent::Max => moments.principal()[0],
            StressComponent::Min => moments.principal()[1],
        };
        match self.quantity {
            ProbeQuantity::Moment(component) => part(moments, component),
            ProbeQuantity::Membrane(component) => part(middle, component),
            ProbeQuantity::Stress(component, surface) => part(moments.at(surface, middle), component),
            ProbeQuantity::VonMises(surface) => moments.at(surface, middle).von_mises(),
            _ => xx,
        }
    }
}
