//! Contributions of effects to the equations of motion.
//!
//! ```math
//! M \ddot U + (\alpha M + \beta K + C)\, \dot U + K U = F + G^T r
//! ```
//!
//! Matrices, masses and loads act on the deflections and slopes of all nodes, held or not. The rows
//! of the free dofs make K, M and F; the rows of the held dofs make the reactions of the supports.

use crate::assembly::{CellMatrix, Probe};
use crate::communicator::Communicator;
use crate::dof_map::NodeConstraint;
use crate::linalg::ElementMatrix;
use crate::mesh::Point;
use crate::scene::FieldInput;
use std::collections::HashMap;
use std::ops::Range;
use std::rc::Rc;

/// Contributions of effects to the equations of motion, on this process's part of the plate.
#[derive(Default)]
pub(in crate::simulation) struct Contributions {
    /// Matrices of single cells in K.
    pub stiffness: Vec<CellStiffness>,
    /// Places of the geometric stiffness of membrane forces in `stiffness`; empty without any.
    pub prestress: Range<usize>,
    /// Springs at points in K, in N/m.
    pub springs: Vec<PointTerm>,
    /// Dashpots at points in C, in N s/m.
    pub dashpots: Vec<PointTerm>,
    /// Springs and dashpots between two dofs, in K and C.
    pub links: Vec<Link>,
    /// Cell, point and mass (kg) of the masses that cells carry, in M.
    pub carried: Vec<(usize, Point, f64)>,
    /// Masses at points that the cells do not carry, in M, in kg.
    pub masses: Vec<PointTerm>,
    /// Bodies beside the plate, whose masses are in M.
    pub bodies: Vec<Body>,
    /// Loads in F.
    pub loads: Vec<Load>,
    /// Restraints of rigid motions.
    pub restraints: Vec<Restraint>,
}

/// Matrix of a cell in K, over the deflections and slopes of its nodes.
pub(in crate::simulation) struct CellStiffness {
    pub cell: usize,
    pub matrix: Rc<[f64]>,
    /// Whether it stands on the ground, so that the plate strains it by moving up as a whole.
    pub is_grounded: bool,
    /// Index of the support whose reaction includes its force.
    pub support: Option<usize>,
}

/// Evaluation of the deflection at a point of this process's part of the plate.
#[derive(Clone)]
pub(in crate::simulation) struct PointEvaluation {
    /// Deflection as a linear combination of the free dofs.
    pub free: Probe,
    /// Deflection as a linear combination of all deflections and slopes of the part, three per
    /// node.
    pub of_shape: Probe,
}

/// Spring (N/m), dashpot (N s/m) or mass (kg) at a point of the plate.
#[derive(Clone)]
pub(in crate::simulation) struct PointTerm {
    pub amount: f64,
    pub point: Point,
    pub spot: PointEvaluation,
}

/// Spring and dashpot between a massless tip and what it touches.
pub(in crate::simulation) struct Link {
    /// Dof of a node's deflection, or of the gap of a body.
    pub body: usize,
    pub tip: usize,
    /// Index of the obstacle; balls come after the obstacles.
    pub obstacle: usize,
    /// Stiffness in N/m.
    pub stiffness: f64,
    /// Damping in N s/m.
    pub damping: f64,
}

/// Body beside the plate that moves up and down, with dofs of its own.
pub(in crate::simulation) struct Body {
    /// Index among all bodies of the scene.
    pub number: usize,
    /// Point of the plate under the body.
    pub spot: PointEvaluation,
    /// Mass at the deflection of the body.
    pub mass: PointTerm,
    /// Dof of the gap, i.e. of the height of the body over the plate.
    pub gap: usize,
    /// Dof of the tip that touches the plate, for a body on a spring.
    pub tip: Option<usize>,
    /// Initial height, in m, and velocity, in m/s.
    pub start: [f64; 2],
}

/// Load of an effect.
pub(in crate::simulation) struct Load {
    /// Key of the scene that gives it.
    pub key: String,
    pub law: LoadLaw,
}

/// Law of a load, positive upwards.
pub(in crate::simulation) enum LoadLaw {
    /// Weight of all masses under a gravity in time, in m/s^2, positive downwards.
    Weight(FieldInput),
    /// Pressure, in Pa.
    Pressure(FieldInput),
    /// Force in N and the deflection under it, or moment in N m and the rotation there, on the one
    /// process that evaluates the point.
    Force(FieldInput, Option<Probe>),
}

/// Restraint of rigid motions at a point, beside a node of the same part of the mesh.
pub(in crate::simulation) struct Restraint {
    pub node: usize,
    pub point: Point,
    pub hold: NodeConstraint,
}

impl Contributions {
    /// Adds matrices of cells to K.
    pub fn add_stiffness(&mut self, matrices: Vec<CellMatrix>, is_grounded: bool, support: Option<usize>) {
        let term = |(cell, matrix)| CellStiffness { cell, matrix, is_grounded, support };
        self.stiffness.extend(matrices.into_iter().map(term));
    }

    /// Returns the masses at points that the cells do not carry, then the masses of bodies.
    pub fn masses(&self) -> impl Iterator<Item = &PointTerm> {
        self.masses.iter().chain(self.bodies.iter().map(|body| &body.mass))
    }

    /// Returns one form per link. Equal links share a class.
    pub fn linked(
        &self,
        amount: impl Fn(&Link) -> f64,
        first_class: usize,
    ) -> impl Iterator<Item = ElementMatrix> {
        let mut classes = HashMap::new();
        self.links.iter().enumerate().map(move |(k, link)| {
            let kind = [link.stiffness, link.damping].map(f64::to_bits);
            let class = *classes.entry(kind).or_insert(first_class + k);
            Probe::default().with(link.body, 1.0).with(link.tip, -1.0).spring(amount(link), class)
        })
    }

    /// Returns the damped links; `None` where no process has any. Collective.
    pub fn damped_links(&self, comm: &impl Communicator) -> Option<impl Iterator<Item = &Link>> {
        let damped = self.links.iter().filter(|link| link.damping > 0.0);
        comm.all_reduce_any(damped.clone().next().is_some()).then_some(damped)
    }

    /// Returns the dashpots, and the damping of the links less the Rayleigh damping of their
    /// springs with the coefficient `beta` in s; `None` where all are zero. Collective.
    pub fn dashpots(&self, beta: f64, comm: &impl Communicator) -> Option<Vec<ElementMatrix>> {
        let is_damped = |link: &Link| link.damping > 0.0 || beta > 0.0;
        let is_any = !self.dashpots.is_empty() || self.links.iter().any(is_damped);
        comm.all_reduce_any(is_any).then(|| {
            let links = self.linked(|link| link.damping - beta * link.stiffness, 0);
            let points = self.dashpots.iter().enumerate();
            let points = points.map(|(k, term)| term.spot.free.spring(term.amount, self.links.len() + k));
            links.chain(points).collect()
        })
    }
}
