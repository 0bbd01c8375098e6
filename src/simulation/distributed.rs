//! The model of a scene over all ranks.

use super::{Fields, Model, Site, SolverFactory, edge_name, start};
use crate::assembly::{self, Probe};
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::mesh::{Diagonal, Grid, Mesh, Point};
use crate::petsc::{Context, Distributed, Part};
use crate::scene::{self, EngineName, Scene, ViName};
use crate::space::{PER_NODE, Space};
use crate::vi::{self, scaled::Family};
use std::rc::Rc;
use std::time::Instant;

/// Whether the engine and PETSc's options can do what the scene asks for. Nothing is built.
///
/// # Errors
/// [`Error::Usage`] for a contact solver that the engine does not have, and for an option that cannot work.
pub fn check_options(scene: &Scene, context: &Context) -> Result<()> {
    super::serves(scene, EngineName::Petsc, &[ViName::Condensed, ViName::Snes, ViName::Tao])?;
    family(scene).map_or(Ok(()), |family| family.check_options(context))
}

/// The PETSc solvers that the scene names; none for the condensed one.
fn family(scene: &Scene) -> Option<Family> {
    match scene.solver.vi {
        ViName::Condensed => None,
        ViName::Snes => Some(vi::snes::SNES),
        ViName::Tao => Some(vi::tao::TAO),
    }
}

impl Model<Distributed> {
    /// Makes the contact solver that the scene names.
    pub fn solver(&self, scene: &Scene) -> Box<SolverFactory<Distributed>> {
        let tolerance = scene.solver.tolerance;
        match family(scene) {
            None => Box::new(super::condensed),
            Some(family) => {
                Box::new(move |engine, sum, bounded| family.solver(engine, sum, bounded, tolerance))
            }
        }
    }

    /// Builds what the scene calls for on PETSc, each rank its own part. Collective.
    ///
    /// # Errors
    /// As [`check_options`] and [`Model::new`], and [`Error::Petsc`].
    pub fn distributed(scene: &Scene, context: &Rc<Context>) -> Result<Model<Distributed>> {
        check_options(scene, context)?;
        let clock = Instant::now();
        if scene.time.scheme == scene::Scheme::Exact {
            return Err(Error::Usage(
                "time.scheme = \"exact\" runs on the native engine, in one process".into(),
            ));
        }
        let grid = scene.mesh;
        let sides = [scene.plate.length, scene.plate.width];
        let diagonal = grid.diagonal.unwrap_or(Diagonal::Right);
        let supports: Vec<_> = scene.supports.iter().map(|s| (edge_name(s.edge), s.kind)).collect();
        let rectangles = Grid::new(sides, grid.cells, grid.element, diagonal)?;
        let part = Part::new(context, &rectangles, grid.refine, &supports)?;
        let engine = Distributed::new(&part)?;
        if context.sum_count(engine.dofs()) == 0 {
            return Err(super::nothing_free());
        }
        let cells = assembly::cells(&part.mesh, &part.space, &scene.plate.plate)?;
        let mut unit_load = vec![0.0; engine.dofs()];
        engine.add_up(&assembly::uniform_load(&cells, part.space.dofs(), 1.0), &mut unit_load)?;
        let own_nodes: Vec<(usize, usize)> = (0..part.mesh.nodes.len())
            .filter(|&node| part.owns[node])
            .filter_map(|node| Some((engine.own_dof(PER_NODE * node)?, node)))
            .collect();
        let deflections: Vec<usize> = own_nodes.iter().map(|(dof, _)| *dof).collect();
        let own = || deflections.iter().copied();
        let system = super::system(scene, engine, Distributed::cells, &cells, &unit_load, own());
        let probes = scene
            .output
            .probes
            .iter()
            .map(|probe| own_probe(context, &part, &system.engine, Point::from(probe.at)))
            .collect::<Result<_>>()?;
        let fields = Fields::new(scene, &part.mesh, &part.space, &cells)?;
        let built = clock.elapsed().as_secs_f64();
        // The supports of the unrefined plate leave the same rigid motions.
        let coarse = Mesh::rectangle(sides[0], sides[1], [1, 1], grid.element, diagonal)?;
        let mechanism = Space::new(&coarse, supports)?.mechanism(&coarse);
        let start = start(scene, mechanism, own(), &system, &unit_load)?;
        let seconds = [built, clock.elapsed().as_secs_f64() - built];
        let (counts, before) = system.engine.concatenate(&vec![0.0; own_nodes.len()])?;
        drop(counts);
        let site = |(number, &(dof, node)): (usize, &(usize, usize))| {
            let at = part.mesh.nodes[node];
            Site { dof, node: before + number, at: [at.x, at.y] }
        };
        let sites = own_nodes.iter().enumerate().map(site).collect();
        Ok(Model { system, start, probes, sites, fields, seconds })
    }
}

/// What this rank's dofs add to the deflection at a point: the first rank with a cell there says how.
fn own_probe(context: &Rc<Context>, part: &Part, engine: &Distributed, point: Point) -> Result<Probe> {
    let here = part.mesh.locate(point).is_some();
    let ranks = context.gather(&[u8::from(here)]);
    let first = ranks.iter().position(|&here| here == 1);
    let first = first
        .ok_or_else(|| Error::Mesh(format!("the point ({}, {}) lies outside the plate", point.x, point.y)))?;
    let mut local = vec![0.0; part.space.dofs()];
    if first == context.rank() {
        Probe::new(&part.mesh, &part.space, point)?.add_weights(&mut local);
    }
    let mut own = vec![0.0; engine.dofs()];
    engine.add_up(&local, &mut own)?;
    Ok(Probe::from_weights(&own))
}
