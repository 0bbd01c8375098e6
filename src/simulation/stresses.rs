//! Recovered curvatures of a scene's plate, with its thickness and material.

use super::effects::{BuildContext, Lift};
use super::plate_assembly::PlateAssembly;
use crate::assembly::{self, Probe, Recovery, SITES, SiteBlock};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::{Error, Result};
use crate::geometry;
use crate::kernels::wide::widest;
use crate::linalg::vectors::axpy;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::plate::{Section, Sections};
use crate::scene::{FieldInput, Scene};
use nalgebra::Matrix3;
use pulp::Arch;
use std::cell::{Ref, RefCell};
use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

/// Recovery of the curvatures of a scene's plate, with its sections.
pub(super) struct PlateCurvatures<'s> {
    pub body: PlateAssembly<'s>,
    pub recovery: Recovery,
    /// Number of parts of the plate, the plate outside all of them included.
    pub parts: usize,
}

/// Returns whether a scene asks for moments or stresses.
fn asks(scene: &Scene) -> bool {
    let output = &scene.output;
    output.extremes
        || output.fields.is_some_and(|fields| fields.stresses)
        || output.probes.iter().any(|probe| probe.quantity.is_of_curvature())
}

impl<'s> PlateCurvatures<'s> {
    /// Prepares the recovery if the scene asks for moments or stresses. Collective.
    pub fn if_asked<P: Partition>(ground: &BuildContext<'s, P>) -> Result<Option<PlateCurvatures<'s>>> {
        if asks(ground.scene) { PlateCurvatures::new(ground).map(Some) } else { Ok(None) }
    }

    /// Prepares the recovery. Collective.
    pub fn new<P: Partition>(ground: &BuildContext<'s, P>) -> Result<PlateCurvatures<'s>> {
        let BuildContext { scene, mesh, partition, .. } = *ground;
        let body = PlateAssembly::new(scene, mesh, partition.comm())?;
        let parts = scene.parts.len() + 1;
        let recovery = Recovery::new(mesh, &ground.cells, &|cell| body.part(cell), parts, partition)?;
        Ok(PlateCurvatures { body, recovery, parts })
    }

    /// Returns three linear functions of the curvatures (w_xx, w_xy, w_yy) at a point, given by a
    /// matrix for each section there, as sums over all deflections and slopes of this rank's cells,
    /// which add up over the ranks. Collective.
    ///
    /// Curvatures and sections jump between parts. On their border the functions are the mean over
    /// all cells that contain the point.
    pub fn mapped_at<P: Partition>(
        &self,
        ground: &BuildContext<'s, P>,
        key: &str,
        place: [f64; 2],
        map: impl Fn(&Section) -> Matrix3<f64>,
    ) -> Result<[Probe; 3]> {
        let BuildContext { mesh, partition, .. } = *ground;
        let comm = partition.comm();
        let point = Point::from(place);
        let around: Vec<usize> = mesh.cells_at(point).collect();
        let count = comm.all_reduce_sum(around.len() as f64);
        if count == 0.0 {
            let place = geometry::place(point);
            return Err(Error::Mesh(format!("{key}: the point {place} lies outside the plate")));
        }
        let mut shares = vec![[0.0; 9]; self.recovery.sites().len()];
        let mut add = |&cell: &usize| {
            let map = map(&self.body.section(cell, point)?) / count;
            let weights = assembly::vertex_weights(&mesh.element(cell)?, point);
            for (&site, weight) in self.recovery.of_cell(cell).iter().zip(weights) {
                axpy(weight, map.as_slice(), &mut shares[site]);
            }
            Ok(())
        };
        comm.all_ok(around.iter().try_for_each(&mut add))?;
        assembly::sum_over_ranks(self.recovery.sites(), self.parts, partition, &mut shares)?;
        let mut rows: [BTreeMap<usize, f64>; 3] = Default::default();
        for entry in 0..9 {
            let shares: Vec<f64> = shares.iter().map(|share| share[entry]).collect();
            let weights = self.recovery.weights_of_fits(&shares, partition)?;
            for (fit, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                for (dof, curvature) in self.recovery.row(fit) {
                    *rows[entry % 3].entry(dof).or_default() += weight * curvature[entry / 3];
                }
            }
        }
        Ok(rows.map(|row| Probe::from_terms(row.into_iter().collect())))
    }
}

/// Quantities with three components at the sites of a recovery, linear in the curvatures: the
/// curvatures themselves, or the stresses. Sites lie in blocks of eight, see [`Recovery::slots`].
pub(super) struct SiteValues {
    /// Deflections and slopes that supports leave free: w at all nodes, then w_x, then w_y.
    free: [Vec<FreeRun>; PER_NODE],
    /// Values at the sites from w, w_x and w_y at the nodes, before the matrices. Collective.
    of_nodes: ValuesOfNodes,
    /// Position of each site in the blocks.
    slots: Vec<u32>,
    /// Matrices that map the results of `of_nodes` at the sites of a block to the values.
    maps: Vec<BlockMap>,
    /// Matrix of each block, an index into `maps`; empty where the results are the values.
    map_of: Vec<u32>,
    /// Support motions with the values that they cause, per metre.
    lifts: Vec<(Rc<FieldInput>, Vec<SiteBlock>)>,
    arch: Arch,
    room: RefCell<Room>,
}

/// Successive nodes at which one dof is free, and whose free dofs have equal distances.
struct FreeRun {
    /// First node and its free dof.
    first: (u32, u32),
    count: u32,
    /// Distance from the free dof of a node to that of the next node.
    stride: u32,
    /// Factor of the values of the free dofs.
    factor: f64,
}

/// Entries of a 3x3 matrix, row by row, each for the eight sites of a block.
type BlockMap = [[f64; SITES]; 9];

type ValuesOfNodes = Box<dyn Fn([&[f64]; PER_NODE], &mut [SiteBlock]) -> Result<()>>;

/// Values of w, w_x and w_y at the nodes, and values at the sites.
#[derive(Default)]
struct Room {
    nodal: [Vec<f64>; PER_NODE],
    values: Vec<SiteBlock>,
}

impl SiteValues {
    /// Prepares the values at the sites from matrices that map the curvature (w_xx, w_xy, w_yy) to
    /// them, one per site; without matrices the values are the curvatures. Collective.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        lifts: &[Lift],
        curvatures: &PlateCurvatures,
        maps: &[Matrix3<f64>],
    ) -> Result<SiteValues> {
        let nodes = ground.mesh.nodes.len();
        // Where the matrix is the same at all sites, it joins the weights of the nodes.
        let same = maps.first().filter(|first| maps.iter().all(|map| map == *first));
        let mapped = same.and_then(|map| curvatures.recovery.mapped::<P>(map));
        let (blocks, slots, maps, of_nodes): (_, _, _, ValuesOfNodes) = match mapped {
            Some(sums) => {
                let (blocks, slots) = (sums.blocks(), sums.slots().to_vec());
                let compute = move |nodal: [&[f64]; PER_NODE], values: &mut [SiteBlock]| {
                    sums.compute(nodal, values);
                    Ok(())
                };
                (blocks, slots, &[][..], Box::new(compute))
            }
            None => {
                let (recovery, partition) = (curvatures.recovery.clone(), ground.partition.clone());
                let (blocks, slots) = (recovery.blocks(), recovery.slots().to_vec());
                let compute = move |nodal: [&[f64]; PER_NODE], values: &mut [SiteBlock]| {
                    recovery.curvatures(nodal, &partition, values)
                };
                (blocks, slots, maps, Box::new(compute))
            }
        };
        let (maps, map_of) = block_maps(maps, &slots);
        let mut values = SiteValues {
            free: [0, 1, 2].map(|k| free_runs(nodes, |node| ground.space.dof(PER_NODE * node + k))),
            of_nodes,
            slots,
            maps,
            map_of,
            lifts: Vec::new(),
            arch: Arch::new(),
            room: RefCell::default(),
        };
        let mut room = Room {
            nodal: [0, 1, 2].map(|_| vec![0.0; nodes + SITES]),
            values: vec![SiteBlock::default(); blocks],
        };
        for Lift { motion, shape, .. } in lifts {
            for (k, nodal) in room.nodal.iter_mut().enumerate() {
                nodal.iter_mut().zip(shape.iter().skip(k).step_by(PER_NODE)).for_each(|(to, of)| *to = *of);
            }
            values.follow_nodes(&mut room)?;
            values.lifts.push((motion.clone(), room.values.clone()));
        }
        // Later values at nodes that supports hold are zero.
        room.nodal.iter_mut().for_each(|nodal| nodal.fill(0.0));
        values.room = RefCell::new(room);
        Ok(values)
    }

    /// Returns the values in blocks for displacements over the dofs of this rank's cells at an
    /// instant (s). Collective.
    pub fn blocks_at(&self, u: &[f64], time: f64) -> Result<Ref<'_, [SiteBlock]>> {
        let mut room = self.room.borrow_mut();
        for (runs, nodal) in self.free.iter().zip(&mut room.nodal) {
            for FreeRun { first: (node, dof), count, stride, factor } in runs {
                let own = &mut nodal[*node as usize..][..*count as usize];
                let values = &u[*dof as usize..];
                if *stride as usize == PER_NODE {
                    let values = values.chunks(PER_NODE);
                    own.iter_mut().zip(values).for_each(|(own, values)| *own = factor * values[0]);
                } else {
                    let values = values.iter().step_by(*stride as usize);
                    own.iter_mut().zip(values).for_each(|(own, value)| *own = factor * value);
                }
            }
        }
        self.follow_nodes(&mut room)?;
        for (motion, lift) in &self.lifts {
            let moved = motion.at(Point::origin(), time)?;
            axpy(
                moved,
                lift.as_flattened().as_flattened(),
                room.values.as_flattened_mut().as_flattened_mut(),
            );
        }
        drop(room);
        Ok(Ref::map(self.room.borrow(), |room| &room.values[..]))
    }

    /// Returns the values at the sites, like [`SiteValues::blocks_at`]. Collective.
    pub fn at(&self, u: &[f64], time: f64) -> Result<Vec<[f64; 3]>> {
        let blocks = self.blocks_at(u, time)?;
        Ok(self.slots.iter().map(|&slot| assembly::values_in_slot(&blocks, slot)).collect())
    }

    /// Returns the number of blocks.
    pub fn blocks(&self) -> usize {
        self.room.borrow().values.len()
    }

    /// Returns the position of each site in the blocks.
    pub fn slots(&self) -> &[u32] {
        &self.slots
    }

    /// Sets the values to those of the nodes, without any lift. Collective.
    fn follow_nodes(&self, Room { nodal, values }: &mut Room) -> Result<()> {
        (self.of_nodes)(nodal.each_ref().map(Vec::as_slice), values)?;
        widest(
            self.arch,
            #[inline(always)]
            || {
                for (values, map) in values.iter_mut().zip(&self.map_of) {
                    *values = mapped(&self.maps[*map as usize], values);
                }
            },
        );
        Ok(())
    }
}

/// Returns the free dofs of successive nodes as runs; `dof` returns the free dof of a node and its
/// factor.
fn free_runs(nodes: usize, dof: impl Fn(usize) -> Option<(usize, f64)>) -> Vec<FreeRun> {
    let mut runs: Vec<FreeRun> = Vec::new();
    for node in 0..nodes as u32 {
        let Some((dof, of)) = dof(node as usize) else { continue };
        let dof = dof as u32;
        if let Some(FreeRun { first, count, stride, factor }) = runs.last_mut()
            && first.0 + *count == node
            && *factor == of
            && (*count == 1 && dof > first.1 || dof == first.1 + *count * *stride)
        {
            *stride = (dof - first.1) / *count;
            *count += 1;
        } else {
            runs.push(FreeRun { first: (node, dof), count: 1, stride: 1, factor: of });
        }
    }
    runs
}

/// Returns the distinct matrices of blocks of sites, and the index of that of each block, from the
/// matrix and the position of each site.
fn block_maps(maps: &[Matrix3<f64>], slots: &[u32]) -> (Vec<BlockMap>, Vec<u32>) {
    let count = slots.iter().max().map_or(0, |&last| last as usize / SITES + 1);
    let mut of_blocks: Vec<[Option<&Matrix3<f64>>; SITES]> = vec![[None; SITES]; count];
    for (map, &slot) in maps.iter().zip(slots) {
        of_blocks[slot as usize / SITES][slot as usize % SITES] = Some(map);
    }
    let mut known: HashMap<Vec<u64>, u32> = HashMap::new();
    let (mut distinct, mut map_of) = (Vec::new(), Vec::new());
    for of_sites in of_blocks.iter().filter(|_| !maps.is_empty()) {
        let first = of_sites.iter().flatten().copied().next();
        let entry = |k: usize| of_sites.map(|map| map.or(first).map_or(0.0, |map| map[(k / 3, k % 3)]));
        let map: BlockMap = std::array::from_fn(entry);
        let bits = map.as_flattened().iter().map(|entry| entry.to_bits()).collect();
        let next = distinct.len() as u32;
        map_of.push(*known.entry(bits).or_insert_with(|| {
            distinct.push(map);
            next
        }));
    }
    (distinct, map_of)
}

/// Returns the products of the matrices of eight sites with the triples of the sites.
#[inline(always)]
fn mapped(map: &BlockMap, values: &SiteBlock) -> SiteBlock {
    let mut products = SiteBlock::default();
    for (k, product) in products.iter_mut().enumerate() {
        for site in 0..SITES {
            product[site] = map[3 * k][site] * values[0][site]
                + map[3 * k + 1][site] * values[1][site]
                + map[3 * k + 2][site] * values[2][site];
        }
    }
    products
}
