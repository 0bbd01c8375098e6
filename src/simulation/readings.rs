//! Quantities at the probes other than deflections.

use super::effects::BuildContext;
use super::stresses::PlateCurvatures;
use crate::archive::Archive;
use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::plate::Section;
use crate::scene::{self, FieldInput, ProbeQuantity, StressComponent};
use crate::scheme::{Scheme, System};
use crate::stress::Moments;
use std::rc::Rc;

/// Support motions, each with its contribution to the probes per metre.
#[derive(Default)]
pub(super) struct SupportFrame(pub Vec<(Rc<FieldInput>, Vec<f64>)>);

/// Sum over the engine's dofs of this process, with its share of every lift, per metre.
pub(super) type FramedProbe = (Probe, Vec<f64>);

/// Quantity at a probe, as a function of one or three sums over the dofs.
struct Reading {
    /// Index of the probe.
    probe: usize,
    quantity: ProbeQuantity,
    /// Deflection, slope, or the components xx, yy and xy of the moments or of the stresses at the
    /// upper surface.
    terms: Vec<FramedProbe>,
}

/// Quantities at the probes other than deflections.
#[derive(Default)]
pub(super) struct Readings(Vec<Reading>);

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
    /// Prepares the quantities of a scene's probes, whose deflections are `deflections`, for lifts
    /// of some shapes. Collective.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        deflections: &[FramedProbe],
        shapes: &[&[f64]],
        curvatures: Option<&PlateCurvatures>,
    ) -> Result<Readings> {
        let mut readings = Vec::new();
        for (index, probe) in ground.scene.output.probes.iter().enumerate() {
            let quantity = probe.quantity;
            let terms = match quantity {
                ProbeQuantity::Deflection => continue,
                ProbeQuantity::Velocity | ProbeQuantity::Acceleration => vec![deflections[index].clone()],
                ProbeQuantity::SlopeX | ProbeQuantity::SlopeY => {
                    let along = usize::from(quantity == ProbeQuantity::SlopeY);
                    vec![ground.slope(probe, along, shapes)?]
                }
                ProbeQuantity::Moment(_) | ProbeQuantity::Stress(..) | ProbeQuantity::VonMises(_) => {
                    // Whoever asks for moments has the curvatures prepared.
                    let Some(curvatures) = curvatures else { continue };
                    components(ground, probe, shapes, curvatures)?
                }
            };
            readings.push(Reading { probe: index, quantity, terms });
        }
        Ok(Readings(readings))
    }

    /// Returns whether all probes record deflections.
    pub fn are_none(&self) -> bool {
        self.0.is_empty()
    }

    /// Replaces the deflections of the other probes in `values` by their quantities. Collective.
    pub fn read<E: Engine>(
        &self,
        system: &System<E>,
        frame: &SupportFrame,
        accelerations: &Accelerations,
        scheme: &mut dyn Scheme,
        values: &mut [f64],
    ) -> Result<()> {
        if self.are_none() {
            return Ok(());
        }
        let is_velocity = |reading: &&Reading| reading.quantity == ProbeQuantity::Velocity;
        let velocities = self.velocities(system, frame, scheme, is_velocity)?;
        let others = || {
            let moves = [ProbeQuantity::Velocity, ProbeQuantity::Acceleration];
            self.0.iter().filter(move |reading| !moves.contains(&reading.quantity))
        };
        let lifted = frame.places(scheme.time())?;
        let own = sums(others(), scheme.displacement(), &lifted);
        let all = system.engine.comm().all_reduce_sum_slice(&own);
        let mut sums = all.as_slice();
        for reading in others() {
            let (of, rest) = sums.split_at(reading.terms.len());
            sums = rest;
            values[reading.probe] = reading.value(of);
        }
        let moving = self.0.iter().filter(is_velocity);
        moving.zip(velocities).for_each(|(reading, velocity)| values[reading.probe] = velocity);
        let probes = accelerations.probes.iter().zip(&accelerations.values);
        probes.for_each(|(&probe, &value)| values[probe] = value);
        Ok(())
    }

    /// Returns the velocities at chosen probes, in m/s. Collective.
    fn velocities<E: Engine>(
        &self,
        system: &System<E>,
        frame: &SupportFrame,
        scheme: &mut dyn Scheme,
        is_chosen: impl Fn(&&Reading) -> bool,
    ) -> Result<Vec<f64>> {
        let chosen = || self.0.iter().filter(&is_chosen);
        if chosen().next().is_none() {
            return Ok(Vec::new());
        }
        let mut rates = scheme.support_rates()?;
        rates.resize(frame.0.len(), 0.0);
        let own = sums(chosen(), &scheme.velocity()?, &rates);
        Ok(system.engine.comm().all_reduce_sum_slice(&own))
    }
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
        frame: &SupportFrame,
        scheme: &mut dyn Scheme,
    ) -> Result<()> {
        if self.probes.is_empty() {
            return Ok(());
        }
        let is_acceleration = |reading: &&Reading| reading.quantity == ProbeQuantity::Acceleration;
        let velocities = readings.velocities(system, frame, scheme, is_acceleration)?;
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
    /// Returns the quantity from the sums of its terms over all ranks.
    fn value(&self, sums: &[f64]) -> f64 {
        let [xx, yy, xy] = [0, 1, 2].map(|k| sums.get(k).copied().unwrap_or(0.0));
        let moments = Moments { xx, yy, xy };
        let of = |component: StressComponent| match component {
            StressComponent::Xx => moments.xx,
            StressComponent::Yy => moments.yy,
            StressComponent::Xy => moments.xy,
            StressComponent::Max => moments.principal()[0],
            StressComponent::Min => moments.principal()[1],
        };
        match self.quantity {
            ProbeQuantity::Moment(component) => of(component),
            ProbeQuantity::Stress(component, surface) => {
                // Principal stresses keep their order where the sign turns.
                let component = match (component, surface.sign() < 0.0) {
                    (StressComponent::Max, true) => StressComponent::Min,
                    (StressComponent::Min, true) => StressComponent::Max,
                    (component, _) => component,
                };
                surface.sign() * of(component)
            }
            ProbeQuantity::VonMises(_) => moments.von_mises(),
            _ => xx,
        }
    }
}

/// Returns this process's share of the sums of some readings.
fn sums<'r>(readings: impl Iterator<Item = &'r Reading>, dofs: &[f64], lifted: &[f64]) -> Vec<f64> {
    let sum = |(probe, lifts): &FramedProbe| {
        probe.deflection(dofs) + lifts.iter().zip(lifted).map(|(lift, moved)| lift * moved).sum::<f64>()
    };
    readings.flat_map(|reading| reading.terms.iter().map(sum)).collect()
}

/// Returns the components xx, yy and xy at a probe of moments or stresses. Collective.
fn components<P: Partition>(
    ground: &BuildContext<P>,
    probe: &scene::Probe,
    shapes: &[&[f64]],
    curvatures: &PlateCurvatures,
) -> Result<Vec<FramedProbe>> {
    let is_moment = matches!(probe.quantity, ProbeQuantity::Moment(_));
    let map = |section: &Section| {
        section.moment_per_curvature() * if is_moment { 1.0 } else { section.stress_per_moment() }
    };
    let key = format!("probe \"{}\"", probe.name);
    let components = curvatures.mapped_at(ground, &key, probe.at, map)?;
    components.iter().map(|component| ground.framed(Some(component), shapes)).collect()
}

impl SupportFrame {
    /// Returns the motions of the supports at an instant (s), in m.
    fn places(&self, time: f64) -> Result<Vec<f64>> {
        self.0.iter().map(|(motion, _)| motion.at(Point::origin(), time)).collect()
    }
}
