//! Largest von Mises stress over all steps of a run, at each node and on the whole plate.

use super::effects::{BuildContext, Lift};
use super::stresses::{PlateCurvatures, SiteValues};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::partition::Partition;
use crate::plate::{Section, Sections};
use crate::scheme::Scheme;
use crate::stress::{Moments, PlateSurface};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Largest stress of a run, with its place and time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StressPeak {
    /// Von Mises stress, in Pa.
    pub value: f64,
    /// Time, in s.
    pub time: f64,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// Surface at which the principal stress of larger magnitude is tensile. The von Mises stress
    /// is the same at both surfaces.
    pub surface: PlateSurface,
}

/// Extremes of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Extremes {
    /// Largest von Mises stress.
    pub von_mises: StressPeak,
}

/// Stresses at the upper surface at the nodes of each part of the plate.
pub(super) struct StressSites {
    stresses: SiteValues,
    /// Position of each site, in m, and its part.
    places: Vec<([f64; 2], usize)>,
    /// Sites of the nodes of each cell.
    cells: Vec<Vec<usize>>,
}

/// Largest von Mises stress at a site so far, in Pa, with its time in s and its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SitePeak {
    value: f64,
    time: f64,
    surface: PlateSurface,
}

/// Largest von Mises stresses so far at all sites.
pub(super) struct StressPeaks(Vec<SitePeak>);

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
        lifts: &[Lift],
        curvatures: Option<&PlateCurvatures>,
    ) -> Result<Option<StressSites>> {
        let BuildContext { scene, mesh, .. } = *ground;
        let Some(curvatures) = curvatures.filter(|_| scene.output.extremes) else { return Ok(None) };
        StressSites::new(ground, mesh.cells.len(), lifts, curvatures).map(Some)
    }

    /// Prepares the stresses at the nodes of a number of cells. Collective.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        cells: usize,
        lifts: &[Lift],
        curvatures: &PlateCurvatures,
    ) -> Result<StressSites> {
        let PlateCurvatures { body, recovery, .. } = curvatures;
        let mesh = ground.mesh;
        let mut cell_of = vec![0; recovery.sites().len()];
        let cells: Vec<Vec<usize>> = (0..cells).map(|cell| recovery.of_cell(cell).to_vec()).collect();
        for (cell, sites) in cells.iter().enumerate() {
            sites.iter().for_each(|&site| cell_of[site] = cell);
        }
        let sections = recovery.sites().iter().zip(&cell_of);
        let sections = sections.map(|(site, &cell)| body.section(cell, mesh.nodes[site.node]));
        let sections: Vec<_> = ground.comm().all_ok(sections.collect::<Result<_>>())?;
        let stress = |section: &Section| {
            let column = |k: usize| {
                let mut curvature = [0.0; 3];
                curvature[k] = 1.0;
                let Moments { xx, yy, xy } = Moments::of_curvature(section, curvature);
                Vector3::new(xx, yy, xy) * section.stress_per_moment()
            };
            Matrix3::from_columns(&[0, 1, 2].map(column))
        };
        let maps = sections.iter().map(stress).collect();
        let place = |site: &crate::assembly::RecoverySite| (mesh.nodes[site.node].coords.into(), site.part);
        Ok(StressSites {
            stresses: SiteValues::new(ground, lifts, curvatures, maps)?,
            places: recovery.sites().iter().map(place).collect(),
            cells,
        })
    }

    /// Returns the largest von Mises stress of a displacement at an instant (s). Collective.
    pub fn largest<E: Engine>(&self, engine: &E, u: &[f64], time: f64) -> Result<Option<StressPeak>> {
        let mut peaks = StressPeaks::new(self);
        peaks.note_displacement(self, engine, u, time)?;
        Ok(peaks.largest(self, engine.comm()))
    }
}

impl StressPeaks {
    /// Returns the peaks before the first instant.
    pub fn new(sites: &StressSites) -> StressPeaks {
        // A negative value whose square is zero, so that every stress exceeds it.
        let nothing = SitePeak { value: -f64::MIN_POSITIVE, time: 0.0, surface: PlateSurface::Top };
        StressPeaks(vec![nothing; sites.places.len()])
    }

    /// Takes the stresses of the present instant. Collective.
    pub fn note<E: Engine>(&mut self, sites: &StressSites, engine: &E, scheme: &dyn Scheme) -> Result<()> {
        self.note_displacement(sites, engine, scheme.displacement(), scheme.time())
    }

    fn note_displacement<E: Engine>(
        &mut self,
        sites: &StressSites,
        engine: &E,
        u: &[f64],
        time: f64,
    ) -> Result<()> {
        let stresses = sites.stresses.at(&engine.to_local(u)?, time)?;
        for (peak, [xx, yy, xy]) in self.0.iter_mut().zip(stresses) {
            // Stresses at the upper surface combine like moments.
            let stress = Moments { xx, yy, xy };
            let square = stress.von_mises_square();
            // Few steps bring a new peak, and a root takes as long as the stress itself.
            if square < peak.value * peak.value {
                continue;
            }
            let value = square.sqrt();
            if value > peak.value {
                *peak = SitePeak { value, time, surface: stress.tension_side() };
            }
        }
        Ok(())
    }

    /// Returns the largest stress of all sites; of equal ones the earliest, then the first in x and
    /// y. Collective.
    pub fn largest(&self, sites: &StressSites, comm: &impl Communicator) -> Option<StressPeak> {
        let sign = |surface: PlateSurface| surface.sign();
        let of = |(peak, (at, _)): (&SitePeak, &([f64; 2], usize))| {
            (peak.value, peak.time, *at, sign(peak.surface))
        };
        let own = self.0.iter().zip(&sites.places).map(of);
        type Numbers = (f64, f64, [f64; 2], f64);
        let better = |a: &Numbers, b: &Numbers| {
            let order = a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1));
            order.then(b.2[0].total_cmp(&a.2[0])).then(b.2[1].total_cmp(&a.2[1]))
        };
        let own: Vec<Numbers> = own.max_by(better).into_iter().collect();
        let largest = comm.all_gather(&own).into_iter().max_by(better)?;
        let (value, time, at, sign) = largest;
        let surface = if sign < 0.0 { PlateSurface::Bottom } else { PlateSurface::Top };
        Some(StressPeak { value, time, at, surface })
    }

    /// Returns the envelope of all instants so far.
    pub fn envelope<'e>(&self, sites: &'e StressSites) -> Envelope<'e> {
        Envelope {
            points: sites.places.iter().map(|(at, _)| *at).collect(),
            cells: &sites.cells,
            von_mises: self.0.iter().map(|peak| peak.value).collect(),
            time: self.0.iter().map(|peak| peak.time).collect(),
        }
    }

    /// Saves or restores the peaks; on another number of ranks they are found again by their
    /// places. Collective.
    pub fn archive(
        &mut self,
        sites: &StressSites,
        comm: &impl Communicator,
        archive: &mut Archive,
    ) -> Result<()> {
        let numbers = |(peak, ([x, y], part)): (&SitePeak, &([f64; 2], usize))| {
            [*x, *y, *part as f64, peak.value, peak.time, peak.surface.sign()]
        };
        let mut list: Vec<f64> = self.0.iter().zip(&sites.places).flat_map(numbers).collect();
        archive.list(&mut list)?;
        let Archive::Restores { same_processes, .. } = archive else { return Ok(()) };
        if !*same_processes {
            list = comm.all_gather(&list);
        }
        let extent = sites.places.iter().flat_map(|(at, _)| *at).fold(0.0, |m: f64, x| m.max(x.abs()));
        let grain = NEAR * comm.all_reduce_max(extent);
        let square = |x: f64| (x / grain).round() as i64;
        let mut known = HashMap::new();
        for [x, y, part, value, time, sign] in list.as_chunks().0 {
            let surface = if *sign < 0.0 { PlateSurface::Bottom } else { PlateSurface::Top };
            let peak = SitePeak { value: *value, time: *time, surface };
            known.insert((square(*x), square(*y), *part as usize), peak);
        }
        let find = |([x, y], part): &([f64; 2], usize)| {
            // Rounding may place a node on the other side of the border between two squares.
            let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (i, j)));
            let mut found = around.filter_map(|(i, j)| known.get(&(square(*x) + i, square(*y) + j, *part)));
            let missing = || Error::Checkpoint("the checkpoint lacks the stresses at a node".into());
            found.next().copied().ok_or_else(missing)
        };
        self.0 = comm.all_ok(sites.places.iter().map(find).collect())?;
        Ok(())
    }
}

/// Distance, relative to the largest coordinate, within which two positions are the same node.
const NEAR: f64 = 1e-9;
