//! Thickness and material of a scene's plate.

use super::refinement;
use super::regions::cells_in;
use crate::communicator::Communicator;
use crate::element::adaptive::{Integrand, Rules};
use crate::element::quadrature::Node;
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Point};
use crate::plate::{Plate, Section, Sections};
use crate::scene::{FieldInput, Part, Scene};

/// Thickness and material of a scene's plate, cell by cell.
pub(super) struct PlateAssembly<'s> {
    scene: &'s Scene,
    /// Index of the part of each cell, from 1 on; 0 for none.
    part_of: Vec<usize>,
    /// Special quadrature rules on the cells where the thickness needs them.
    rules: Rules,
}

impl<'s> PlateAssembly<'s> {
    /// Determines the part of each cell. Collective.
    pub fn new(scene: &'s Scene, mesh: &Mesh, comm: &impl Communicator) -> Result<PlateAssembly<'s>> {
        let mut part_of = vec![0; mesh.cells.len()];
        for (number, part) in scene.parts.iter().enumerate() {
            let hits = cells_in(&part.region, mesh, comm, &format!("part.{number}"))?;
            part_of.iter_mut().zip(hits).filter(|(_, hit)| *hit).for_each(|(part, _)| *part = number + 1);
        }
        let mut body = PlateAssembly { scene, part_of, rules: Rules::new() };
        body.rules = body.find_rules(mesh, comm)?;
        Ok(body)
    }

    /// Determines special quadrature rules for cells in which the thickness jumps, or varies too
    /// fast for the usual rule. Collective.
    fn find_rules(&self, mesh: &Mesh, comm: &impl Communicator) -> Result<Rules> {
        let rough = |given: &&FieldInput| !given.is_polynomial();
        let of_parts = self.scene.parts.iter().map(|part| part.thickness.as_ref());
        let thicknesses = std::iter::once(self.scene.plate.thickness.as_ref()).chain(of_parts);
        let rough: Vec<_> =
            thicknesses.map(|given| given.filter(rough).map(|given| given.still(0.0))).collect();
        if rough.iter().all(Option::is_none) {
            return Ok(Rules::new());
        }
        let function = |cell: usize| rough[self.part_of[cell]].as_ref().map(|still| still as &dyn Integrand);
        refinement::rules("plate.thickness", mesh, &function, comm)
    }

    /// Returns the plate of a cell, and its thickness field where it is no constant.
    fn plate(&self, cell: usize) -> (&'s Plate, Option<&'s FieldInput>) {
        match self.part_of[cell].checked_sub(1).map(|part| &self.scene.parts[part]) {
            Some(Part { plate, thickness, .. }) => (plate, thickness.as_ref()),
            None => (&self.scene.plate.plate, self.scene.plate.thickness.as_ref()),
        }
    }
}

impl Sections for PlateAssembly<'_> {
    fn kind(&self, cell: usize) -> Option<usize> {
        self.plate(cell).1.is_none().then(|| self.part_of[cell])
    }

    fn part(&self, cell: usize) -> usize {
        self.part_of[cell]
    }

    fn section(&self, cell: usize, point: Point) -> Result<Section> {
        let (plate, thickness) = self.plate(cell);
        let Some(given) = thickness else { return Ok(plate.section()) };
        let thickness = given.at(point, 0.0)?;
        if thickness <= 0.0 {
            let wrong =
                format!("{thickness:?} m at ({}, {}); expected a thickness greater than 0", point.x, point.y);
            return Err(Error::Scene(format!("{}: {wrong}", given.key)));
        }
        Ok(Plate { thickness, ..*plate }.section())
    }

    fn rules(&self, cell: usize) -> Option<&[Vec<Node>]> {
        self.rules.get(&cell).map(Vec::as_slice)
    }
}
