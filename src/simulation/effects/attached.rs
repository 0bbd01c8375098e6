//! Attachments of the plate: foundations, springs, masses and balls; and the matrices of all
//! together.

use super::elastic_edges::ElasticEdges;
use super::ground::{BuildContext, PointEvaluation};
use super::lumps::{self, AttachedBall, LumpedMass};
use super::parts;
use super::ribs::{self, Ribs};
use super::stop_springs::StopSprings;
use crate::assembly::{self, CellArrays, Probe};
use crate::communicator::Communicator;
use crate::dof_map::Rigid;
use crate::element::adaptive::{self, Integrand, Rules};
use crate::error::{Error, Result};
use crate::linalg::{BARE, ElementMatrix, SingularMassCell};
use crate::mesh::Point;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scene;
use crate::simulation::refinement::seen;
use crate::simulation::regions::cells_in;
use std::rc::Rc;

/// Attachments of this process's part of the plate.
pub(super) struct Attached<'s> {
    /// Contributions of the foundations to K, each with its cell.
    foundations: Vec<(usize, ElementMatrix)>,
    edges: ElasticEdges,
    ribs: Ribs,
    springs: Vec<LumpedMass>,
    /// Masses at held points, then balls; `spot.free` gives their deflection in terms of the dofs.
    /// Other masses are those of the cells.
    masses: Vec<LumpedMass>,
    pub balls: Vec<AttachedBall<'s>>,
    /// Springs between the tips of compliant stops and their nodes.
    pub stops: StopSprings,
    /// First class number that is not used by the cells of a matrix.
    first_class: usize,
}

impl<'s> Attached<'s> {
    /// Locates all attachments. Collective.
    pub fn new<P: Partition>(ground: &BuildContext<'s, P>) -> Result<Attached<'s>> {
        let scene = ground.scene;
        let lump = |key: String, at: [f64; 2], amount: f64| {
            let spot = ground.spot(&format!("{key}.at"), at)?;
            Ok::<_, Error>(spot.map(|spot| LumpedMass { amount, at: at.into(), spot }))
        };
        let (mut springs, mut masses, mut balls) = (Vec::new(), Vec::new(), Vec::new());
        for (number, spring) in scene.attachments.springs.iter().enumerate() {
            springs.extend(lump(format!("spring.{number}"), spring.at, spring.stiffness)?);
        }
        for (number, mass) in scene.attachments.masses.iter().enumerate() {
            let lump = lump(format!("mass.{number}"), mass.at, mass.mass)?;
            masses.extend(lump.filter(|lump| lumps::is_held(&lump.spot.of_shape, ground.holds)));
        }
        for (number, (ball, gap)) in scene.attachments.balls.iter().zip(ground.gaps).enumerate() {
            let lump = lump(format!("ball.{number}"), ball.at, ball.mass)?;
            if let Some((LumpedMass { amount, at, spot }, gap)) = lump.zip(*gap) {
                let rides = PointEvaluation {
                    free: spot.free.clone().with(gap, 1.0),
                    of_shape: spot.of_shape.clone(),
                };
                masses.push(LumpedMass { amount, at, spot: rides });
                balls.push(AttachedBall { number, ball, spot, gap, tip: ground.ball_tip(number) });
            }
        }
        let first_class = BARE + 4 * ground.cells.len();
        let (foundations, edges) = (foundations(ground)?, ElasticEdges::new(ground)?);
        let ribs = Ribs::new(ground)?;
        let stops = StopSprings::new(ground, &balls, first_class + springs.len() + balls.len());
        Ok(Attached { foundations, edges, ribs, springs, masses, balls, stops, first_class })
    }

    /// Returns an error where the mesh has several parts and one of them is not held by itself.
    /// Collective.
    pub fn require_held_parts<P: Partition>(&self, ground: &BuildContext<P>) -> Result<()> {
        let on_foundation = self.foundations.iter().map(|(cell, _)| *cell);
        parts::require_held(ground, &self.springs, &self.edges.holds, on_foundation)
    }

    /// Returns the springs.
    pub fn springs(&self) -> &[LumpedMass] {
        &self.springs
    }

    /// Returns the masses at held points, then the balls.
    pub fn masses(&self) -> &[LumpedMass] {
        &self.masses
    }

    /// Returns the matrices of foundations, elastic edges and ribs, each with its cell.
    pub fn bed_matrices(&self) -> impl Iterator<Item = (usize, Rc<[f64]>)> {
        self.beds().map(|(cell, block)| (*cell, block.matrix.clone()))
    }

    /// Returns the contributions of foundations and elastic edges to K, each with its cell.
    fn grounded(&self) -> impl Iterator<Item = &(usize, ElementMatrix)> {
        self.foundations.iter().chain(&self.edges.blocks)
    }

    /// Returns the contributions of foundations, elastic edges and ribs to K, each with its cell.
    fn beds(&self) -> impl Iterator<Item = &(usize, ElementMatrix)> {
        self.grounded().chain(&self.ribs.blocks)
    }

    /// Returns K of plate, foundations, elastic edges, ribs, springs and stops.
    pub fn stiffness(&self, cells: &[CellArrays]) -> Vec<ElementMatrix> {
        let mut blocks = assembly::stiffness(cells);
        blocks.extend(self.beds().map(|(_, block)| block.clone()));
        blocks.extend(self.forms(self.springs.iter()));
        blocks.extend(self.stops.stiffness());
        blocks
    }

    /// Returns K with a spring of 1 N/m in each ball's gap, which fixes a gap without load.
    pub fn stiffness_that_holds_balls(&self, cells: &[CellArrays]) -> Vec<ElementMatrix> {
        let mut blocks = self.stiffness(cells);
        let first = self.first_class + self.springs.len();
        let gap =
            |(k, ball): (usize, &AttachedBall)| Probe::default().with(ball.gap, 1.0).spring(1.0, first + k);
        blocks.extend(self.balls.iter().enumerate().map(gap));
        blocks
    }

    /// Returns `$M_r$` of the plate and its masses.
    pub fn consistent_mass(&self, cells: &[CellArrays]) -> Vec<ElementMatrix> {
        let mut blocks = assembly::consistent_mass(cells);
        blocks.extend(self.forms(self.masses.iter()));
        blocks
    }

    /// Returns B and C of the plate and its masses.
    pub fn singular_mass(&self, cells: &[CellArrays]) -> Vec<SingularMassCell> {
        let mut rows = assembly::singular_mass(cells);
        let row = |(k, mass): (usize, &LumpedMass)| mass.spot.free.rider(mass.amount, self.first_class + k);
        rows.extend(self.masses.iter().enumerate().map(row));
        rows
    }

    fn forms<'l>(
        &'l self,
        lumps: impl Iterator<Item = &'l LumpedMass> + 'l,
    ) -> impl Iterator<Item = ElementMatrix> + 'l {
        let form =
            |(k, lump): (usize, &'l LumpedMass)| lump.spot.free.spring(lump.amount, self.first_class + k);
        lumps.enumerate().map(form)
    }

    /// Adds the weight of masses and balls to `load` for a gravity (m/s^2), downward.
    pub fn add_weight(&self, gravity: f64, load: &mut [f64]) {
        self.masses.iter().for_each(|mass| mass.spot.free.push(-mass.amount * gravity, load));
    }

    /// Adds the forces of foundations, elastic edges and springs under a shape (three values per
    /// node) to `force`, in N.
    pub fn add_forces<P: Partition>(&self, ground: &BuildContext<P>, shape: &[f64], force: &mut [f64]) {
        ribs::add_forces(self.grounded(), ground, shape, force);
        for LumpedMass { amount, spot, .. } in &self.springs {
            spot.free.push(amount * spot.of_shape.deflection(shape), force);
        }
    }

    /// Adds the forces of the ribs under a shape (three values per node) to `force`, in N: a rigid
    /// shape has none.
    pub fn add_rib_forces<P: Partition>(&self, ground: &BuildContext<P>, shape: &[f64], force: &mut [f64]) {
        self.ribs.add_forces(ground, shape, force);
    }

    /// Adds the momenta of masses and balls for a velocity of this shape to `momentum`.
    pub fn add_momenta(&self, shape: &[f64], momentum: &mut [f64]) {
        for LumpedMass { amount, spot, .. } in &self.masses {
            spot.free.push(amount * spot.of_shape.deflection(shape), momentum);
        }
    }

    /// Returns the positions of masses and balls, in m, in the order of their rows of B.
    pub fn carried(&self) -> impl Iterator<Item = [f64; 3]> {
        self.masses.iter().map(|mass| [mass.at.x, mass.at.y, 1.0])
    }

    /// Returns the rigid motions that nothing restrains, in words. Collective.
    pub fn mechanism<P: Partition>(&self, ground: &BuildContext<P>) -> Option<&'static str> {
        self.held(ground, &[]).mechanism()
    }

    /// Returns the rigid motions that supports, springs and foundations restrain. Collective.
    pub fn rigid<P: Partition>(&self, ground: &BuildContext<P>) -> Rigid {
        self.held(ground, &[])
    }

    /// Returns an error where nothing restrains a rigid motion and the singular mass gives it no
    /// inertia either: its means over all cells vanish, as for a single row of cells rotating about
    /// its centre line. Collective.
    pub fn refuse_weightless<P: Partition>(&self, ground: &BuildContext<P>) -> Result<()> {
        let fixed = self.masses[..self.masses.len() - self.balls.len()].iter().map(|mass| mass.at);
        let centres = assembly::centres_of_mass(ground.mesh, ground.cells);
        match self.held(ground, &fixed.chain(centres).collect::<Vec<_>>()).mechanism() {
            None => Ok(()),
            Some(motion) => Err(Error::Singular(format!(
                "a rigid motion has neither stiffness nor inertia: {motion}, with zero mean velocity in every cell; \
                 take more rows of cells, hold the plate, or set time.mass = \"consistent\""
            ))),
        }
    }

    /// Returns the rigid motions that the supports, attachments and some fixed points restrain.
    /// Collective.
    fn held<P: Partition>(&self, ground: &BuildContext<P>, at_rest: &[Point]) -> Rigid {
        let nodes = &ground.mesh.nodes;
        let [right, top, left, bottom] = ground.farthest();
        let centre = Point::new(0.5 * (right - left), 0.5 * (top - bottom));
        let mut rigid = Rigid::new(centre, 0.5 * (right + left).hypot(top + bottom));
        for (node, hold) in ground.holds.iter().enumerate().filter(|(_, hold)| hold.is_any()) {
            if ground.partition.owns_node(node) {
                rigid.hold(nodes[node], hold);
            }
        }
        self.springs.iter().for_each(|spring| rigid.hold_deflection(spring.at));
        for (node, hold) in &self.edges.holds {
            rigid.hold(nodes[*node], hold);
        }
        for (cell, _) in &self.foundations {
            ground.mesh.vertices(*cell).into_iter().for_each(|vertex| rigid.hold_deflection(vertex));
        }
        at_rest.iter().for_each(|&point| rigid.hold_deflection(point));
        let seen = ground.comm().all_reduce_sum_slice(rigid.seen());
        rigid.see(&seen);
        rigid
    }

    /// Returns an error where a rigid ball can hit a held point of the plate, since its velocity
    /// would jump. Collective.
    pub fn refuse_stopped<P: Partition>(&self, ground: &BuildContext<P>, bounds: &Bounds) -> Result<()> {
        let stops = |dof: usize| {
            let bound = ground.partition.own_dof(dof).and_then(|dof| bounds.dofs.binary_search(&dof).ok());
            bound.is_some_and(|bound| {
                !bounds.laws.has(bound) || bounds.rigid(bound).iter().any(|limit| limit.is_finite())
            })
        };
        let stopped = |mass: &LumpedMass| matches!(mass.spot.free.weights(), [(dof, _)] if stops(*dof));
        if ground.comm().all_reduce_any(self.masses.iter().any(stopped)) {
            return Err(Error::Usage(format!(
                "time.scheme = \"{}\" needs velocities that do not jump, and a [[ball]] is above a point that supports \
                 hold; give the ball a stiffness, or set time.scheme = \"newmark\"",
                ground.scene.time.scheme.name()
            )));
        }
        Ok(())
    }
}

/// Returns the contributions of the foundations to K, each with its cell. Collective.
fn foundations<P: Partition>(ground: &BuildContext<P>) -> Result<Vec<(usize, ElementMatrix)>> {
    let foundations = &ground.scene.attachments.foundations;
    if foundations.is_empty() {
        return Ok(Vec::new());
    }
    let reach = |(number, of): (usize, &scene::Foundation)| {
        cells_in(&of.region, ground.mesh, ground.comm(), &format!("foundation.{number}"))
    };
    let reaches: Vec<Vec<bool>> = foundations.iter().enumerate().map(reach).collect::<Result<_>>()?;
    let rules = foundation_rules(ground, &reaches)?;
    let stiffness = |cell: usize, at| {
        let mut sum = 0.0;
        for (of, _) in foundations.iter().zip(&reaches).filter(|(_, reach)| reach[cell]) {
            let stiffness = of.stiffness.at(at, 0.0)?;
            if stiffness < 0.0 {
                let wrong = format!("{stiffness:?} N/m3 at ({}, {}); expected at least 0", at.x, at.y);
                return Err(Error::Scene(format!("{}: {wrong}", of.stiffness.key)));
            }
            sum += stiffness;
        }
        Ok(sum)
    };
    ground.comm().all_ok(assembly::foundation(ground.mesh, ground.cells, &stiffness, &rules))
}

/// Returns special quadrature rules for cells in which foundations need them. Collective.
fn foundation_rules<P: Partition>(ground: &BuildContext<P>, reaches: &[Vec<bool>]) -> Result<Rules> {
    let foundations = &ground.scene.attachments.foundations;
    if foundations.iter().all(|of| of.stiffness.is_low()) {
        return Ok(Rules::new());
    }
    // One sum serves all cells that the same foundations cover.
    let mut sums = Vec::new();
    let mut known: Vec<Vec<bool>> = Vec::new();
    let mut sum_of = Vec::with_capacity(ground.mesh.cells.len());
    for cell in 0..ground.mesh.cells.len() {
        let reached: Vec<bool> = reaches.iter().map(|reach| reach[cell]).collect();
        let number = known.iter().position(|other| *other == reached).unwrap_or_else(|| {
            let under = foundations.iter().zip(&reached).filter(|(_, reached)| **reached);
            sums.push(under.map(|(of, _)| of.stiffness.still(0.0)).collect::<Vec<_>>());
            known.push(reached);
            sums.len() - 1
        });
        sum_of.push(number);
    }
    let function = |cell: usize| {
        let sum = &sums[sum_of[cell]];
        (!sum.is_empty()).then_some(sum as &dyn Integrand)
    };
    let pieces = ground.comm().all_ok(assembly::pieces(ground.mesh))?;
    let refined = adaptive::refine(&pieces, &function, adaptive::ONCE, ground.comm());
    seen("foundation", ground.comm().all_ok(refined)?)
}
