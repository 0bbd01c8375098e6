//! Largest von Mises stress over all steps of a run, at each node and on the whole plate.

use super::effects::BuildContext;
use super::nodal_motion::NodalMotion;
use super::stresses::{CurvaturesOfShape, MidplaneStresses, PlateCurvatures};
use crate::archive::Archive;
use crate::assembly::RecoverySite;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::partition::Partition;
use crate::plate::Sections;
use crate::stress::{Moments, PlateSurface};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::rc::Rc;

/// Largest stress of a run, with its place and time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StressPeak {
    /// Von Mises stress, in Pa.
    pub value: f64,
    /// Time, in s.
    pub time: f64,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// Surface at which the principal stress of larger magnitude is tensile: the von Mises stress
    /// is the same at both surfaces. With forces in the plane, the surface of the larger stress.
    pub surface: PlateSurface,
}

/// Extremes of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Extremes {
    /// Largest von Mises stress.
    pub von_mises: StressPeak,
}

/// Position of a site, in m, and its part.
type Place = ([f64; 2], usize);

/// Nodes of each part of the plate, with the stresses there.
pub(super) struct StressSites {
    motion: Rc<NodalMotion>,
    curvatures: CurvaturesOfShape,
    /// Stresses at the upper surface per curvature (w_xx, w_xy, w_yy), in N/m, one entry per site.
    stress_per_curvature: Vec<Matrix3<f64>>,
    /// Stresses of the mid-plane at the sites.
    middle: MidplaneStresses,
    places: Vec<Place>,
    /// Sites of the nodes of each cell.
    cells: Vec<Vec<usize>>,
}

/// Largest von Mises stress at a site so far.
#[derive(Debug, Clone, Copy)]
struct SitePeak {
    /// Square of the stress, in Pa^2; negative before the first instant.
    square: f64,
    /// Time, in s.
    time: f64,
    /// Sum of the normal stresses at the upper surface, in Pa. With forces in the plane it only
    /// tells by its sign which surface has the larger stress.
    trace: f64,
}

/// Search for the largest von Mises stress of several displacements.
pub struct StressWatch {
    sites: Rc<StressSites>,
    peaks: Vec<SitePeak>,
}

/// Envelope of the von Mises stress: its largest value over time at each node of each part.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope<'e> {
    /// Positions of the nodes, in m. A node between parts occurs once per part.
    pub points: Vec<[f64; 2]>,
    /// Corners of the mesh's cells, counter-clockwise.
    pub cells: &'e [Vec<usize>],
    /// Largest von Mises stress at each point, in Pa.
    pub von_mises: Vec<f64>,
    /// Time of that stress, in s.
    pub time: Vec<f64>,
}

impl StressSites {
    /// Prepares the stresses if the scene asks for their extremes. Collective.
    pub fn if_asked<P: Partition>(
        ground: &BuildContext<P>,
        motion: &Rc<NodalMotion>,
        curvatures: Option<&PlateCurvatures>,
    ) -> Result<Option<StressSites>> {
        let BuildContext { scene, mesh, .. } = ground;
        let Some(curvatures) = curvatures.filter(|_| scene.output.extremes) else { return Ok(None) };
        let PlateCurvatures { body, recovery, .. } = curvatures;
        let sites = &recovery.sites;
        let mut cell_of = vec![0; sites.len()];
        let cells: Vec<Vec<usize>> =
            (0..mesh.cells.len()).map(|cell| recovery.of_cell(cell).to_vec()).collect();
        for (cell, sites) in cells.iter().enumerate() {
            sites.iter().for_each(|&site| cell_of[site] = cell);
        }
        let stress = |(site, &cell): (&RecoverySite, &usize)| {
            let section = body.section(cell, mesh.nodes[site.node])?;
            Ok(section.moment_per_curvature() * section.stress_per_moment())
        };
        let stresses: Result<Vec<Matrix3<f64>>> = sites.iter().zip(&cell_of).map(stress).collect();
        let places = sites.iter().zip(&cell_of).map(|(site, &cell)| (cell, mesh.nodes[site.node]));
        let middle = curvatures.middle_of(mesh, places);
        Ok(Some(StressSites {
            middle: ground.comm().all_ok(middle)?,
            motion: motion.clone(),
            curvatures: curvatures.of_shape(ground.partition),
            stress_per_curvature: ground.comm().all_ok(stresses)?,
            places: sites.iter().map(|site| (mesh.nodes[site.node].coords.into(), site.part)).collect(),
            cells,
        }))
    }

    /// Returns the stresses by bending at the upper surface for deflections and slopes at all nodes
    /// of this rank's cells, in Pa. Collective.
    fn bending(&self, shape: &[f64]) -> Result<impl Iterator<Item = Moments>> {
        let curvatures = (self.curvatures)(shape)?;
        Ok(self.stress_per_curvature.iter().zip(curvatures).map(|(stress, curvature)| {
            let [xx, yy, xy] = (stress * Vector3::from(curvature)).into();
            Moments { xx, yy, xy }
        }))
    }
}

impl SitePeak {
    /// Returns the von Mises stress, in Pa.
    fn value(&self) -> f64 {
        self.square.max(0.0).sqrt()
    }

    /// Returns the surface at which the principal stress of larger magnitude is tensile.
    fn surface(&self) -> PlateSurface {
        PlateSurface::in_tension(self.trace, self.value())
    }
}

impl StressWatch {
    /// Starts a search at some sites.
    pub(super) fn new(sites: &Rc<StressSites>) -> StressWatch {
        // Every square exceeds a negative one, zero too.
        let before = SitePeak { square: -1.0, time: 0.0, trace: 0.0 };
        StressWatch { sites: sites.clone(), peaks: vec![before; sites.places.len()] }
    }

    /// Returns the peak of each site with the site's position and part.
    fn all(&self) -> impl Iterator<Item = (&SitePeak, &Place)> {
        self.peaks.iter().zip(&self.sites.places)
    }

    /// Takes the stresses of a displacement at an instant (s). Collective.
    ///
    /// # Errors
    /// Returns the errors of the support motions and of the engine.
    pub fn note<E: Engine>(&mut self, engine: &E, u: &[f64], time: f64) -> Result<()> {
        let displacement = engine.to_local(u)?;
        let shape = self.sites.motion.at(&displacement, time)?;
        let (bending, middle) = (self.sites.bending(&shape)?, self.sites.middle.of_shape(&shape)?);
        for (site, (peak, stress)) in self.peaks.iter_mut().zip(bending).enumerate() {
            let mut now = SitePeak { square: stress.von_mises_square(), time, trace: stress.xx + stress.yy };
            if let Some(middle) = middle.get(site) {
                let (surface, value) = stress.larger(*middle);
                (now.square, now.trace) = (value * value, surface.sign() * value);
            }
            if now.square > peak.square {
                *peak = now;
            }
        }
        Ok(())
    }

    /// Returns the largest stress of all sites; of those that are equal but for rounding the
    /// earliest, then the first in x and y. Collective.
    pub fn largest(&self, comm: &impl Communicator) -> Option<StressPeak> {
        let sign = |surface: PlateSurface| surface.sign();
        let row = |(peak, (p, _)): (&SitePeak, &Place)| (peak.value(), peak.time, *p, sign(peak.surface()));
        type Numbers = (f64, f64, [f64; 2], f64);
        let earlier = |a: &Numbers, b: &Numbers| {
            a.1.total_cmp(&b.1).then(a.2[0].total_cmp(&b.2[0])).then(a.2[1].total_cmp(&b.2[1]))
        };
        let largest = comm.all_reduce_max(self.all().map(|(peak, _)| peak.value()).fold(0.0, f64::max));
        let is_equal = |numbers: &Numbers| numbers.0 >= (1.0 - SAME_STRESS) * largest;
        let best: Vec<Numbers> = self.all().map(row).filter(is_equal).min_by(earlier).into_iter().collect();
        let (value, time, place, sign) = comm.all_gather(&best).into_iter().min_by(earlier)?;
        let surface = if sign < 0.0 { PlateSurface::Bottom } else { PlateSurface::Top };
        Some(StressPeak { value, time, at: place, surface })
    }

    /// Returns the envelope of all instants so far.
    pub(super) fn envelope(&self) -> Envelope<'_> {
        let sites = &self.sites;
        Envelope {
            points: sites.places.iter().map(|(point, _)| *point).collect(),
            cells: &sites.cells,
            von_mises: self.all().map(|(peak, _)| peak.value()).collect(),
            time: self.all().map(|(peak, _)| peak.time).collect(),
        }
    }

    /// Saves or restores the peaks; on another number of ranks they are found again by their
    /// places. Collective.
    pub(super) fn archive(&mut self, comm: &impl Communicator, archive: &mut Archive) -> Result<()> {
        let sites = &self.sites;
        let numbers = |(peak, ([x, y], part)): (&SitePeak, &Place)| {
            [*x, *y, *part as f64, peak.square, peak.time, peak.trace]
        };
        let mut list: Vec<f64> = self.all().flat_map(numbers).collect();
        archive.list(&mut list)?;
        let Archive::Restores { same_processes, .. } = archive else { return Ok(()) };
        if !*same_processes {
            list = comm.all_gather(&list);
        }
        let extent = sites.places.iter().flat_map(|(x, _)| *x).fold(0.0, |m: f64, x| m.max(x.abs()));
        let grain = NEAR * comm.all_reduce_max(extent);
        let square = |x: f64| (x / grain).round() as i64;
        let mut peaks = HashMap::new();
        for &[x, y, part, of_peak, time, trace] in list.as_chunks().0 {
            let peak = SitePeak { square: of_peak, time, trace };
            peaks.insert((square(x), square(y), part as usize), peak);
        }
        let find = |([x, y], part): &Place| {
            // Rounding may place a node on the other side of the border between two squares.
            let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (i, j)));
            let mut nodes = around.filter_map(|(i, j)| peaks.get(&(square(*x) + i, square(*y) + j, *part)));
            let missing = || Error::Checkpoint("the checkpoint lacks the stresses at a node".into());
            nodes.next().copied().ok_or_else(missing)
        };
        self.peaks = comm.all_ok(sites.places.iter().map(find).collect())?;
        Ok(())
    }
}

/// Relative difference up to which two stresses are equal: places that symmetry makes alike differ
/// by rounding.
const SAME_STRESS: f64 = 1e-9;

/// Distance, relative to the largest coordinate, within which two positions are the same node.
const NEAR: f64 = 1e-9;
