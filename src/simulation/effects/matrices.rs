//! Matrices and forces of the plate with all effects.

use super::contributions::PointTerm;
use super::ground::BuildContext;
use crate::assembly::{self, Probe};
use crate::error::Result;
use crate::linalg::{ElementMatrix, SingularMassCell};
use crate::partition::Partition;
use crate::scene::Mass;

impl<P: Partition> BuildContext<'_, P> {
    /// Returns K.
    pub(super) fn stiffness(&self) -> Vec<ElementMatrix> {
        let mut blocks = assembly::stiffness(&self.cells);
        for term in &self.terms.stiffness {
            blocks.push(self.cells[term.cell].form(&term.matrix, blocks.len()));
        }
        for PointTerm { amount, spot, .. } in &self.terms.springs {
            blocks.push(spot.free.spring(*amount, blocks.len()));
        }
        blocks.extend(self.terms.linked(|link| link.stiffness, blocks.len()));
        blocks
    }

    /// Returns K without membrane forces, with springs of 1 N/m at the gaps of bodies, and the
    /// geometric stiffness of these forces.
    pub(super) fn without_prestress(&self) -> [Vec<ElementMatrix>; 2] {
        let mut blocks = self.stiffness();
        let count = blocks.len();
        let first = self.cells.len() + self.terms.prestress.start;
        let geometric = blocks.drain(first..first + self.terms.prestress.len()).collect();
        let gaps = self.terms.bodies.iter().map(|body| Probe::default().with(body.gap, 1.0));
        let springs = gaps.enumerate().map(|(k, gap)| gap.spring(1.0, count + k));
        blocks.extend(springs);
        [blocks, geometric]
    }

    /// Returns `$M_r$`.
    pub(super) fn consistent_mass(&self) -> Vec<ElementMatrix> {
        let mut blocks = assembly::consistent_mass(&self.cells);
        for PointTerm { amount, spot, .. } in self.terms.masses() {
            blocks.push(spot.free.spring(*amount, blocks.len()));
        }
        blocks
    }

    /// Returns B and C.
    pub(super) fn singular_mass(&self) -> Vec<SingularMassCell> {
        let mut rows = assembly::singular_mass(&self.cells);
        for PointTerm { amount, spot, .. } in self.terms.masses() {
            rows.push(spot.free.rider(*amount, rows.len()));
        }
        rows
    }

    /// Returns the forces K u of a shape u (three values per node), in N, on the engine's dofs. A
    /// rigid shape, which moves the whole plate up, strains only what stands on the ground.
    /// Collective.
    pub(super) fn forces(&self, shape: &[f64], is_rigid: bool) -> Result<Vec<f64>> {
        let mut force = vec![0.0; self.space.dofs()];
        if !is_rigid {
            assembly::forces(self.mesh, &self.cells, shape, &mut force);
        }
        for term in self.terms.stiffness.iter().filter(|term| term.is_grounded || !is_rigid) {
            let values = assembly::on_nodes(&self.mesh.cells[term.cell], shape);
            self.cells[term.cell].add_product(&term.matrix, &values, &mut force);
        }
        for PointTerm { amount, spot, .. } in &self.terms.springs {
            spot.free.push(amount * spot.of_shape.deflection(shape), &mut force);
        }
        self.partition.add_up(&force)
    }

    /// Returns the momenta M v for a velocity v of some shape (three values per node), on the
    /// engine's dofs. Collective.
    pub(super) fn momenta(&self, shape: &[f64]) -> Result<Vec<f64>> {
        let mut momentum = vec![0.0; self.space.dofs()];
        let of_cells = match self.scene.time.mass {
            Mass::Singular => assembly::singular_momenta,
            Mass::Consistent | Mass::Modal => assembly::consistent_momenta,
        };
        of_cells(self.mesh, &self.cells, shape, &mut momentum);
        for PointTerm { amount, spot, .. } in self.terms.masses() {
            spot.free.push(amount * spot.of_shape.deflection(shape), &mut momentum);
        }
        self.partition.add_up(&momentum)
    }
}
