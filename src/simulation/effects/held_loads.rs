//! Loads at the dofs that named supports hold.

use super::loads::LocalLoads;
use crate::dof_map::PER_NODE;
use crate::error::Result;
use crate::linalg::vectors::axpy;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::FieldInput;
use std::cell::RefCell;

/// Number of instants whose wave loads are kept: those of one step of any scheme.
const KEPT_INSTANTS: usize = 4;

/// Function that returns the load of changing distribution at an instant (s), in N, over all dofs
/// of the mesh; `None` if there is none. Collective.
type WaveOfTime = dyn Fn(f64) -> Result<Option<Vec<f64>>>;

/// Loads at the held nodes: for each in N, then in N m for the slopes.
pub(super) struct HeldLoads {
    /// Held nodes, in the order of their forces.
    nodes: Vec<usize>,
    constant: Vec<f64>,
    /// Factor of time and load of each product of time and place.
    terms: Vec<(FieldInput, Vec<f64>)>,
    wave: Box<WaveOfTime>,
    /// Wave loads of the last instants, by the bits of the instant (s).
    known: RefCell<Vec<(u64, Vec<f64>)>>,
}

impl HeldLoads {
    /// Takes the loads over all dofs of the mesh at some nodes.
    pub fn new<P: Partition>(loads: LocalLoads<P>, nodes: Vec<usize>) -> HeldLoads {
        let terms = loads.terms.iter().map(|(factor, load)| (factor.clone(), at_nodes(&nodes, load)));
        HeldLoads {
            constant: at_nodes(&nodes, &loads.constant),
            terms: terms.collect(),
            wave: Box::new(move |t| loads.wave(t)),
            known: RefCell::default(),
            nodes,
        }
    }

    /// Subtracts the constant load, and those in time at instants (s) with their weights.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the loads' formulas.
    pub fn subtract(&self, instants: &[(f64, f64)], force: &mut [f64]) -> Result<()> {
        axpy(-1.0, &self.constant, force);
        for (time, weight) in instants {
            for (factor, load) in &self.terms {
                axpy(-weight * factor.at(Point::origin(), *time)?, load, force);
            }
            if let Some(wave) = self.wave_at(*time)? {
                axpy(-weight, &wave, force);
            }
        }
        Ok(())
    }

    /// Returns the load of changing distribution at an instant (s). Collective.
    fn wave_at(&self, time: f64) -> Result<Option<Vec<f64>>> {
        let mut known = self.known.borrow_mut();
        if let Some((_, wave)) = known.iter().find(|(of, _)| *of == time.to_bits()) {
            return Ok(Some(wave.clone()));
        }
        let Some(wave) = (self.wave)(time)? else { return Ok(None) };
        let wave = at_nodes(&self.nodes, &wave);
        known.truncate(KEPT_INSTANTS - 1);
        known.insert(0, (time.to_bits(), wave.clone()));
        Ok(Some(wave))
    }
}

/// Returns the entries at some nodes of a vector over all dofs of the mesh.
fn at_nodes(nodes: &[usize], of_mesh: &[f64]) -> Vec<f64> {
    nodes.iter().flat_map(|&node| &of_mesh[PER_NODE * node..][..PER_NODE]).copied().collect()
}
