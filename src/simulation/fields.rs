//! Snapshots of the plate, sampled finely enough that the C1 deflection looks as curved as it is.
//!
//! Each cell is divided into `output.subdivide` squared smaller cells of the same shape;
//! deflection, slopes and velocity are evaluated at their corners with the element's basis
//! functions. Cells share the points on common edges. The first points are the nodes of the mesh,
//! in its order.

use super::effects::BuildContext;
use super::nodal_motion::NodalMotion;
use super::readings::FramedProbe;
use super::regions;
use super::stress_fields::{SnapshotStresses, StressFields};
use super::stresses::PlateCurvatures;
use crate::assembly::{self, CellArrays};
use crate::communicator::Communicator;
use crate::element::{AnyElement, BasisFunction};
use crate::error::Result;
use crate::linalg::{CellClass, Engine};
use crate::mesh::{Cell, Mesh, Point};
use crate::partition::Partition;
use crate::plate::Sections;
use crate::scene::{FieldInput, Probe, Region, Side};
use crate::scheme::{NodalFriction, Solution, System};
use std::collections::HashMap;
use std::rc::Rc;

/// Sampling points and small cells of this process.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lattice {
    /// Positions of the points, in m.
    pub points: Vec<[f64; 2]>,
    /// Corners of each small cell, three or four, counter-clockwise.
    pub cells: Vec<Vec<usize>>,
    /// Cell of the mesh that contains each small cell.
    pub parents: Vec<usize>,
}

/// Snapshot: the plate at an instant, sampled on a [`Lattice`].
#[derive(Debug, Clone)]
pub struct Snapshot<'f> {
    /// Index of the step.
    pub step: u64,
    /// Time, in s.
    pub time: f64,
    /// Sampling points and small cells.
    pub lattice: &'f Lattice,
    /// Deflection, in m, one entry per point.
    pub deflection: Vec<f64>,
    /// Derivatives of the deflection along x and y, one entry per point.
    pub slope: Vec<[f64; 2]>,
    /// Velocity, in m/s, one entry per point; see [`Solution::velocity`].
    pub velocity: Vec<f64>,
    /// Gap to the nearest obstacle, in m, one entry per point, NaN at points without an obstacle;
    /// negative where a compliant stop gives way. `None` without obstacles.
    pub gap: Option<Vec<f64>>,
    /// Heights of the nearest obstacles below and above, in m, one entry per point, NaN at points
    /// without an obstacle; `None` on a side without obstacles.
    pub obstacles: [Option<Vec<f64>>; 2],
    /// Reaction of the obstacles on each node, in N, positive upwards, zero at points that are not
    /// nodes of the mesh; `None` without obstacles.
    pub reaction: Option<Vec<f64>>,
    /// Moments of the friction of obstacles on the slopes of each node, in N m, and whether it is
    /// open (0), sticks (1) or slides (2), zero at points that are not nodes of the mesh; `None`
    /// without friction.
    pub friction: Option<[Vec<f64>; 3]>,
    /// Mean velocity of each cell of the mesh relative to the supports, in m/s; with the singular
    /// mass it is the velocity of the paper.
    pub mean_velocity: Vec<f64>,
    /// Moments and stresses; `None` unless the scene asks for them.
    pub stresses: Option<SnapshotStresses>,
    /// Point of each ball that touches the plate, x, y and height in m, and 1 for a ball above the
    /// plate or -1 for one below; the same on all ranks.
    pub balls: Vec<[f64; 4]>,
}

/// Sampling of the states of a model.
pub struct Fields {
    lattice: Lattice,
    /// Cell that evaluates each point, and index of the point in the table of its class.
    samples: Vec<(u32, u32)>,
    /// Cells over all deflections and slopes of their nodes.
    cells: Vec<CellArrays>,
    motion: Rc<NodalMotion>,
    /// Basis functions at the points, by class of congruent cells.
    tables: HashMap<CellClass, Vec<Rows>>,
    /// Dof of the deflection of each node.
    deflections: Vec<Option<usize>>,
    /// Dof and node of the tips of compliant stops.
    tips: Vec<(usize, usize)>,
    /// Side, height and affected points of each obstacle.
    obstacles: Vec<(Side, FieldInput, Vec<usize>)>,
    stresses: Option<StressFields>,
    /// Place, in m, and side of each ball, with its height.
    balls: Vec<([f64; 2], Side, FramedProbe)>,
}

/// Values of a cell's basis functions at a point, and their derivatives along x and y.
type Rows = [Vec<f64>; 3];

/// Point of a subdivided cell.
struct Corner {
    point: Point,
    entity: CornerEntity,
}

/// Entity of the cell on which a point lies; points on edges and inside are numbered in order.
enum CornerEntity {
    Node(usize),
    Edge { nodes: [usize; 2], step: usize },
    Inside,
}

impl Fields {
    /// Prepares sampling if the scene asks for snapshots. Collective.
    pub(super) fn new<P: Partition>(
        ground: &BuildContext<P>,
        motion: &Rc<NodalMotion>,
        curvatures: Option<&PlateCurvatures>,
    ) -> Result<Option<Fields>> {
        let BuildContext { scene, partition, mesh, space, ref cells, .. } = *ground;
        let Some(snapshots) = scene.output.fields else { return Ok(None) };
        let parts = snapshots.subdivide;
        let curvatures = curvatures.filter(|_| snapshots.stresses);
        // Stresses jump between parts, which then share no points.
        let part_of = |cell: usize| curvatures.map_or(0, |curvatures| curvatures.body.part(cell));
        let mut copies: HashMap<(usize, usize), usize> = HashMap::new();
        let mut lattice =
            Lattice { points: mesh.nodes.iter().map(|p| [p.x, p.y]).collect(), ..Lattice::default() };
        let mut samples = vec![None; mesh.nodes.len()];
        let mut edges: HashMap<([usize; 2], usize), usize> = HashMap::new();
        let mut tables: HashMap<CellClass, Vec<Rows>> = HashMap::new();
        for (number, cell) in mesh.cells.iter().enumerate() {
            let vertices = mesh.vertices(number);
            let (corners, small) = subdivided(cell, &vertices, parts);
            let class = cells[number].class;
            if let std::collections::hash_map::Entry::Vacant(new) = tables.entry(class) {
                new.insert(basis(&mesh.element(number)?, &corners));
            }
            let mut numbers = Vec::with_capacity(corners.len());
            for (local, corner) in corners.iter().enumerate() {
                let point = match corner.entity {
                    CornerEntity::Node(node) => match samples[node] {
                        Some((cell, _)) if part_of(cell as usize) != part_of(number) => {
                            *copies.entry((node, part_of(number))).or_insert_with(|| {
                                lattice.points.push([f64::NAN; 2]);
                                samples.push(None);
                                samples.len() - 1
                            })
                        }
                        _ => node,
                    },
                    CornerEntity::Edge { nodes: [a, b], step } => {
                        let edge = ([a.min(b), a.max(b)], part_of(number));
                        let first = *edges.entry(edge).or_insert_with(|| {
                            let first = lattice.points.len();
                            lattice.points.resize(first + parts - 1, [f64::NAN; 2]);
                            samples.resize(first + parts - 1, None);
                            first
                        });
                        first + if a < b { step - 1 } else { parts - 1 - step }
                    }
                    CornerEntity::Inside => {
                        lattice.points.push([corner.point.x, corner.point.y]);
                        samples.push(None);
                        samples.len() - 1
                    }
                };
                if samples[point].is_none() {
                    samples[point] = Some((number as u32, local as u32));
                    lattice.points[point] = [corner.point.x, corner.point.y];
                }
                numbers.push(point);
            }
            for corners in small {
                lattice.cells.push(corners.into_iter().map(|local| numbers[local]).collect());
                lattice.parents.push(number);
            }
        }
        let mut fields = Fields {
            lattice,
            // Every node and every edge belongs to a cell.
            samples: samples.into_iter().map(Option::unwrap_or_default).collect(),
            cells: assembly::unheld(mesh, cells),
            motion: motion.clone(),
            tables,
            deflections: (0..mesh.nodes.len()).map(|node| space.deflection(node)).collect(),
            tips: space.tips.clone(),
            obstacles: Vec::new(),
            stresses: None,
            balls: Vec::new(),
        };
        for (number, ball) in scene.attachments.balls.iter().enumerate() {
            let probe = Probe::of_ball(number, ball);
            fields.balls.push((ball.at, ball.side, ground.probe(&probe, &motion.shapes())?));
        }
        if let Some(curvatures) = curvatures {
            let cell_of: Vec<usize> = fields.samples.iter().map(|(cell, _)| *cell as usize).collect();
            let Lattice { points, cells, parents } = &fields.lattice;
            let stresses = StressFields::new(ground, curvatures, (points, &cell_of), (cells, parents))?;
            fields.stresses = Some(stresses);
        }
        for (number, obstacle) in scene.obstacles.iter().enumerate() {
            let points = fields.opposite(&obstacle.region, mesh, partition, &format!("obstacle.{number}"))?;
            fields.obstacles.push((obstacle.side, obstacle.height.clone(), points));
        }
        Ok(Some(fields))
    }

    /// Returns the grid with the deflections of a displacement in the frame of the supports, over
    /// the dofs of this rank's cells.
    pub fn surface(&self, u: &[f64]) -> (&Lattice, Vec<f64>) {
        (&self.lattice, self.evaluate(&self.motion.relative(u), 0))
    }

    /// Returns the points opposite to an obstacle of a region. Collective.
    fn opposite(
        &self,
        region: &Region,
        mesh: &Mesh,
        partition: &impl Partition,
        key: &str,
    ) -> Result<Vec<usize>> {
        let points = 0..self.lattice.points.len();
        match region {
            Region::All => Ok(points.collect()),
            Region::Where(condition) => {
                let inside = |point: usize| {
                    let place = self.lattice.points[point].into();
                    Ok(regions::holds(condition, place, key)?.then_some(point))
                };
                partition.comm().all_ok(points.map(inside).filter_map(Result::transpose).collect())
            }
            Region::Group(_) => {
                let inside = regions::cells_in(region, mesh, partition.comm(), key)?;
                let small = self.lattice.cells.iter().zip(&self.lattice.parents);
                let mut chosen: Vec<usize> = small
                    .filter(|(_, parent)| inside[**parent])
                    .flat_map(|(corners, _)| corners.clone())
                    .collect();
                chosen.sort_unstable();
                chosen.dedup();
                Ok(chosen)
            }
            // The first points are the nodes.
            Region::At(_) | Region::Point(_) | Region::Line(_) => {
                regions::nodes_in(region, mesh, partition, key)
            }
        }
    }

    /// Returns the heights of the nearest obstacles below and above at an instant (s), in m, NaN
    /// where there is none.
    fn heights(&self, time: f64) -> Result<[Vec<f64>; 2]> {
        let nowhere = || vec![f64::NAN; self.lattice.points.len()];
        let [mut floor, mut ceiling] = [nowhere(), nowhere()];
        for (side, height, opposite) in &self.obstacles {
            let points: Vec<Point> =
                opposite.iter().map(|&point| self.lattice.points[point].into()).collect();
            let mut heights = vec![0.0; points.len()];
            height.values(&points, time, &mut heights)?;
            for (&point, height) in opposite.iter().zip(heights) {
                match side {
                    Side::Below => floor[point] = height.max(floor[point]),
                    Side::Above => ceiling[point] = height.min(ceiling[point]),
                }
            }
        }
        Ok([floor, ceiling])
    }

    /// Returns the snapshot of the present state of a scheme. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine and of formulas in time.
    pub fn sample<E: Engine>(&self, system: &System<E>, scheme: &mut dyn Solution) -> Result<Snapshot<'_>> {
        let System { engine, bounds, .. } = system;
        let velocity = scheme.velocity()?;
        let (u, rate) = (engine.to_local(scheme.displacement())?, engine.to_local(&velocity)?);
        let (shape, mut rate) = (self.motion.at(&u, scheme.time())?, self.motion.relative(&rate));
        let [deflection, slope_x, slope_y] = [0, 1, 2].map(|row| self.evaluate(&shape, row));
        let mean_velocity = self.cells.iter().map(|cell| mean(cell, &rate)).collect();
        self.motion.carry(&scheme.support_rates()?, &mut rate);
        let velocity = self.evaluate(&rate, 0);
        let (mut gap, mut obstacles, mut reaction) = (None, [None, None], None);
        if !self.obstacles.is_empty() {
            let [floor, ceiling] = self.heights(scheme.time())?;
            let room = |((w, floor), ceiling): ((&f64, &f64), &f64)| (w - floor).min(ceiling - w);
            gap = Some(deflection.iter().zip(&floor).zip(&ceiling).map(room).collect());
            let has = |side: Side| self.obstacles.iter().any(|(other, ..)| *other == side);
            obstacles = [has(Side::Below).then_some(floor), has(Side::Above).then_some(ceiling)];
            let mut force = vec![0.0; engine.dofs()];
            bounds.add_transposed(scheme.reaction(), &mut force);
            let force = engine.to_local(&force)?;
            let mut at_points = vec![0.0; self.lattice.points.len()];
            for (value, dof) in at_points.iter_mut().zip(&self.deflections) {
                *value = dof.map_or(0.0, |dof| force[dof]);
            }
            self.tips.iter().for_each(|&(dof, node)| at_points[node] += force[dof]);
            reaction = Some(at_points);
        }
        let friction = system.drive.friction.as_ref().map(|_| self.friction(system, scheme)).transpose()?;
        let stresses = self.stresses.as_ref().map(|fields| fields.sample(&self.cells, &shape)).transpose()?;
        Ok(Snapshot {
            step: scheme.step(),
            time: scheme.time(),
            lattice: &self.lattice,
            deflection,
            slope: slope_x.into_iter().zip(slope_y).map(|(x, y)| [x, y]).collect(),
            velocity,
            gap,
            obstacles,
            reaction,
            friction,
            mean_velocity,
            stresses,
            balls: self.ball_points(engine, scheme)?,
        })
    }

    /// Returns the friction at the points, see [`Snapshot::friction`]. Collective.
    fn friction<E: Engine>(&self, system: &System<E>, scheme: &dyn Solution) -> Result<[Vec<f64>; 3]> {
        let System { engine, bounds, .. } = system;
        let mut by_dof = [0; 3].map(|_| vec![0.0; engine.dofs()]);
        for NodalFriction { bound, moment: [x, y], sticks, .. } in scheme.friction_at_nodes() {
            let values = [x, y, if sticks { 1.0 } else { 2.0 }];
            by_dof.iter_mut().zip(values).for_each(|(to, value)| to[bounds.dofs[bound]] = value);
        }
        let mut at_points = [0; 3].map(|_| vec![0.0; self.lattice.points.len()]);
        for (to, values) in at_points.iter_mut().zip(by_dof) {
            let values = engine.to_local(&values)?;
            for (value, dof) in to.iter_mut().zip(&self.deflections) {
                *value = dof.map_or(0.0, |dof| values[dof]);
            }
            for &(dof, node) in self.tips.iter().filter(|(dof, _)| values[*dof] != 0.0) {
                to[node] = values[dof];
            }
        }
        Ok(at_points)
    }

    /// Returns the touching points of all balls, see [`Snapshot::balls`]. Collective.
    fn ball_points<E: Engine>(&self, engine: &E, scheme: &dyn Solution) -> Result<Vec<[f64; 4]>> {
        if self.balls.is_empty() {
            return Ok(Vec::new());
        }
        let (u, lifts) = (scheme.displacement(), self.motion.lifts(scheme.time())?);
        let share = |(.., (probe, shares)): &(_, _, FramedProbe)| {
            let moved = lifts.iter().zip(shares).map(|((height, _), share)| height * share);
            moved.fold(probe.deflection(u), |sum, term| sum + term)
        };
        let shares: Vec<f64> = self.balls.iter().map(share).collect();
        let heights = engine.comm().all_reduce_sum_slice(&shares);
        let point = |(([x, y], side, _), height): (&([f64; 2], Side, _), f64)| {
            [*x, *y, height, if *side == Side::Above { 1.0 } else { -1.0 }]
        };
        Ok(self.balls.iter().zip(heights).map(point).collect())
    }

    /// Returns, per point, the product of one row of the basis functions with the dofs of its cell.
    fn evaluate(&self, dofs: &[f64], row: usize) -> Vec<f64> {
        let value = |&(cell, local): &(u32, u32)| {
            let cell = &self.cells[cell as usize];
            let weights = &self.tables[&cell.class][local as usize][row];
            weights.iter().enumerate().map(|(i, weight)| weight * cell.value(i, dofs)).sum()
        };
        self.samples.iter().map(value).collect()
    }
}

/// Returns the mean of a field over a cell.
fn mean(cell: &CellArrays, dofs: &[f64]) -> f64 {
    let sum: f64 = cell.local.row.iter().enumerate().map(|(i, c)| c * cell.value(i, dofs)).sum();
    sum / cell.local.weight
}

/// Returns the points of a cell divided into `parts` along each edge, and the corners of its small
/// cells.
fn subdivided(cell: &Cell, vertices: &[Point], parts: usize) -> (Vec<Corner>, Vec<Vec<usize>>) {
    let share = |i: usize| i as f64 / parts as f64;
    let mut corners = Vec::new();
    let mut numbers = HashMap::new();
    let mut small = Vec::new();
    let edge = |nodes: [usize; 2], step: usize| match step {
        0 => CornerEntity::Node(nodes[0]),
        step if step == parts => CornerEntity::Node(nodes[1]),
        step => CornerEntity::Edge { nodes, step },
    };
    match *cell {
        Cell::Triangle([a, b, c]) => {
            for j in 0..=parts {
                for i in 0..=parts - j {
                    let entity = match (i, j) {
                        (i, 0) => edge([a, b], i),
                        (0, j) => edge([a, c], j),
                        (i, j) if i + j == parts => edge([b, c], j),
                        _ => CornerEntity::Inside,
                    };
                    let point = vertices[0]
                        + (vertices[1] - vertices[0]) * share(i)
                        + (vertices[2] - vertices[0]) * share(j);
                    numbers.insert((i, j), corners.len());
                    corners.push(Corner { point, entity });
                }
            }
            for j in 0..parts {
                for i in 0..parts - j {
                    small.push([(i, j), (i + 1, j), (i, j + 1)].map(|ij| numbers[&ij]).to_vec());
                    if i + j + 2 <= parts {
                        small.push([(i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|ij| numbers[&ij]).to_vec());
                    }
                }
            }
        }
        Cell::Quadrilateral([a, b, c, d]) => {
            for j in 0..=parts {
                for i in 0..=parts {
                    let entity = match (i, j) {
                        (i, 0) => edge([a, b], i),
                        (i, j) if j == parts => edge([d, c], i),
                        (0, j) => edge([a, d], j),
                        (i, j) if i == parts => edge([b, c], j),
                        _ => CornerEntity::Inside,
                    };
                    let low = vertices[0] + (vertices[1] - vertices[0]) * share(i);
                    let high = vertices[3] + (vertices[2] - vertices[3]) * share(i);
                    numbers.insert((i, j), corners.len());
                    corners.push(Corner { point: low + (high - low) * share(j), entity });
                }
            }
            for j in 0..parts {
                for i in 0..parts {
                    let square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                    small.push(square.map(|ij| numbers[&ij]).to_vec());
                }
            }
        }
    }
    (corners, small)
}

/// Returns the basis functions of a cell at its points.
fn basis(element: &AnyElement, corners: &[Corner]) -> Vec<Rows> {
    let rows = |corner: &Corner| {
        let functions = element.basis_at(corner.point);
        let row = |value: fn(&BasisFunction) -> f64| functions.iter().map(value).collect();
        [row(|basis| basis.value), row(|basis| basis.gradient[0]), row(|basis| basis.gradient[1])]
    };
    corners.iter().map(rows).collect()
}
