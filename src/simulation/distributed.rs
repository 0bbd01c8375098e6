//! Model of a scene distributed over all ranks.

use super::effects::BuildContext;
use super::meshing;
use super::regions::{self, NodeSums};
use super::stops::{self, Stop};
use super::{DeflectionDof, Model, SolverFactory, levels};
use crate::communicator::Communicator;
use crate::distributed::{Distributed, MeshPart, Part, Refinements, Tips};
use crate::dof_map::NodeConstraint;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::mesh::{Diagonal, Grid, Mark, Mesh, Point};
use crate::petsc::Context;
use crate::scene::{EngineName, Scene};
use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;
use std::time::Instant;

/// Checks that the engine and PETSc's options can run the scene; nothing is built.
///
/// # Errors
/// Returns [`Error::Usage`] for a contact solver that the engine does not have, and for an option
/// that cannot work.
pub fn check_options(scene: &Scene, context: &Context) -> Result<()> {
    super::serves(scene, EngineName::Petsc)?;
    scene.solver.vi.check_options(context)
}

impl Model<Distributed> {
    /// Returns a factory of the contact solver that the scene names.
    pub fn solver(&self, scene: &Scene) -> Box<SolverFactory<Distributed>> {
        scene.solver.vi.factory(scene.solver.tolerance)
    }

    /// Builds the model of a scene on PETSc, one part per rank. Collective.
    ///
    /// # Errors
    /// Returns the same errors as [`check_options`] and [`Model::new`], and [`Error::Petsc`].
    pub fn distributed(scene: &Scene, context: &Rc<Context>) -> Result<Model<Distributed>> {
        check_options(scene, context)?;
        let clock = Instant::now();
        let scheme = scene.time.scheme.capabilities();
        if !scheme.is_distributed {
            return Err(Error::Usage(format!(
                "time.scheme = \"{}\" runs on the native engine, in one process",
                scheme.name
            )));
        }
        super::phase("mesh");
        let comm = context.comm();
        let supports = |mesh: &Mesh| regions::supports(scene, mesh, comm).map_err(|why| scene.explain(why));
        let of_balls = &scene.attachments;
        let name = |number: usize| (format!("ball.{number}.at"), Point::from(of_balls.balls[number].at));
        let balls = (0..of_balls.balls.len()).chain(of_balls.balls_with_tips()).map(name);
        let balls: Vec<(String, Point)> = balls.collect();
        let stops = RefCell::new(Vec::new());
        let tips = |mesh: &Mesh, holds: &[NodeConstraint], sums: &NodeSums| {
            *stops.borrow_mut() = stops::find(scene, mesh, holds, comm, sums)?;
            Ok(stops.borrow().iter().map(|stop: &Stop| stop.node).collect())
        };
        let tips = (!scene.obstacles.is_empty()).then_some(&tips as &Tips);
        let marks = meshing::marks(scene);
        let grid = if scene.file.is_some() { None } else { grid(scene, &marks)? };
        let part = match grid {
            Some(grid) => {
                let cells = meshing::rectangles(&scene.mesh);
                let halvings = levels::halvings(&scene.mesh, comm.size());
                let keep = keeps_levels(scene, context, cells, scene.mesh.refine + halvings)?;
                let halvings = if keep { halvings } else { 0 };
                let refinements = Refinements { count: scene.mesh.refine + halvings, keep };
                Part::new(context, &grid.coarsened(halvings)?, refinements, &supports, &balls, tips)?
            }
            None => {
                let first = if comm.rank() == 0 { whole(scene, &marks) } else { Ok((Mesh::default(), 0)) };
                let (mesh, refine) = comm.all_ok(first)?;
                let (refine, cells) = comm.all_gather_one((refine, meshing::kinds(&mesh)))[0];
                let keep = keeps_levels(scene, context, cells, refine)?;
                let refinements = Refinements { count: refine, keep };
                Part::of_mesh(context, || Ok(mesh), refinements, &supports, &balls, tips)?
            }
        };
        let stops = stops.take();
        let engine = Distributed::new(&part)?;
        if comm.all_reduce_sum(engine.dofs()) == balls.len() {
            return Err(super::nothing_free());
        }
        let partition = MeshPart::new(&part, &engine)?;
        let (mesh, holds) = (&part.mesh, &part.holds);
        let ground = BuildContext::new((scene, mesh), &partition, holds, &part.space, &part.extra, &stops)?;
        let mut model = super::compose(clock, engine, &ground)?;
        number_nodes(&mut model.sites, comm);
        Ok(model)
    }
}

/// Numbers the nodes in the order of the ranks and of their dofs; tips of stops keep their nodes.
/// Collective.
fn number_nodes(sites: &mut [DeflectionDof], comm: &impl Communicator) {
    let mut order: Vec<usize> = (0..sites.len()).filter(|&site| !sites[site].is_tip).collect();
    let counts = comm.all_gather_one(order.len());
    let before: usize = counts[..comm.rank()].iter().sum();
    order.sort_by_key(|&site| sites[site].dof);
    let mut numbers = HashMap::new();
    for (number, site) in order.into_iter().enumerate() {
        numbers.insert(sites[site].node, before + number);
        sites[site].node = before + number;
    }
    for site in sites.iter_mut().filter(|site| site.is_tip) {
        site.node = numbers.get(&site.node).copied().unwrap_or(site.node);
    }
}

/// Returns whether multigrid needs the coarser levels of a mesh of `cells` triangles and
/// quadrilaterals, and refuses a run that cannot fit into memory, with factors or without.
/// Collective.
fn keeps_levels(scene: &Scene, context: &Context, cells: [u64; 2], levels: u32) -> Result<bool> {
    let multigrid = levels::uses_multigrid(scene, context, cells, levels)?;
    let (comm, factors) = (context.comm(), if multigrid { 0 } else { scene.time.factors() });
    comm.all_ok(meshing::require_memory(scene, cells, comm.size(), factors))?;
    Ok(multigrid)
}

/// Returns the grid of a scene without a mesh file; `None` where nodes must be created in it.
fn grid(scene: &Scene, marks: &[(String, Mark)]) -> Result<Option<Grid>> {
    let grid = scene.mesh;
    let sides = [scene.plate.length, scene.plate.width];
    let diagonal = grid.diagonal.unwrap_or(Diagonal::Right);
    let rectangles = Grid::new(sides, grid.cells, grid.element, diagonal)?;
    let fine = Grid::new(sides, grid.cells.map(|count| count << grid.refine), grid.element, diagonal)?;
    Ok(fine.has_nodes(marks).then_some(rectangles))
}

/// Returns the whole mesh of a scene and its remaining number of refinements, which is 0 where
/// nodes were created in it.
fn whole(scene: &Scene, marks: &[(String, Mark)]) -> Result<(Mesh, u32)> {
    if let (Some(file), true) = (&scene.file, marks.is_empty()) {
        return Ok((file.load()?, scene.mesh.refine));
    }
    let (fine, made) = meshing::mesh_and_made(scene)?;
    match &scene.file {
        Some(file) if made.is_empty() => Ok((file.load()?, scene.mesh.refine)),
        _ => Ok((fine, 0)),
    }
}
