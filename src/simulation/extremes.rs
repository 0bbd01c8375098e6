//! Largest von Mises stress over all steps of a run, at each node and on the whole plate.

use super::effects::{BuildContext, Lift};
use super::stresses::{PlateCurvatures, SiteValues};
use crate::archive::Archive;
use crate::assembly::{SITES, SiteBlock};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::kernels::wide::widest;
use crate::linalg::Engine;
use crate::partition::Partition;
use crate::plate::{Section, Sections};
use crate::stress::{Moments, PlateSurface};
use pulp::Arch;
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

/// Position of a site, in m, and its part.
type Place = ([f64; 2], usize);

/// Stresses at the upper surface at the nodes of each part of the plate.
pub(super) struct StressSites {
    stresses: SiteValues,
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
    /// Sum of the normal stresses at the upper surface, in Pa.
    trace: f64,
}

/// Largest von Mises stresses at the sites of a block, each entry as in [`SitePeak`].
#[derive(Clone, Copy)]
struct BlockPeaks {
    square: [f64; SITES],
    time: [f64; SITES],
    trace: [f64; SITES],
}

/// Largest von Mises stresses so far at all sites, in the blocks of [`SiteValues`].
pub(super) struct StressPeaks {
    blocks: Vec<BlockPeaks>,
    arch: Arch,
}

/// Search for the largest von Mises stress of several displacements.
pub struct StressWatch<'m, E: Engine> {
    sites: &'m StressSites,
    engine: &'m E,
    peaks: StressPeaks,
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
        let stress = |section: &Section| section.moment_per_curvature() * section.stress_per_moment();
        let maps: Vec<_> = sections.iter().map(stress).collect();
        let place = |site: &crate::assembly::RecoverySite| (mesh.nodes[site.node].coords.into(), site.part);
        Ok(StressSites {
            stresses: SiteValues::new(ground, lifts, curvatures, &maps)?,
            places: recovery.sites().iter().map(place).collect(),
            cells,
        })
    }
}

impl<'m, E: Engine> StressWatch<'m, E> {
    /// Starts a search at some sites, with the engine of the displacements.
    pub(super) fn new(sites: &'m StressSites, engine: &'m E) -> StressWatch<'m, E> {
        StressWatch { sites, engine, peaks: StressPeaks::new(sites) }
    }

    /// Takes the stresses of a displacement at an instant (s). Collective.
    ///
    /// # Errors
    /// Returns the errors of the support motions and of the engine.
    pub fn note(&mut self, u: &[f64], time: f64) -> Result<()> {
        self.peaks.note(self.sites, self.engine, u, time)
    }

    /// Returns the largest stress so far. Collective.
    pub fn largest(&self) -> Option<StressPeak> {
        self.peaks.largest(self.sites, self.engine.comm())
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

impl BlockPeaks {
    /// Takes the stresses of an instant (s).
    #[inline(always)]
    fn note(&mut self, [xx, yy, xy]: &SiteBlock, time: f64) {
        // Stresses at the upper surface combine like moments.
        let stress = |site: usize| Moments { xx: xx[site], yy: yy[site], xy: xy[site] };
        let mut squares = [0.0; SITES];
        let mut rises = false;
        for site in 0..SITES {
            squares[site] = stress(site).von_mises_square();
            rises |= squares[site] > self.square[site];
        }
        // Few steps bring a new peak.
        if !rises {
            return;
        }
        for site in 0..SITES {
            let rises = squares[site] > self.square[site];
            self.square[site] = if rises { squares[site] } else { self.square[site] };
            self.time[site] = if rises { time } else { self.time[site] };
            self.trace[site] = if rises { xx[site] + yy[site] } else { self.trace[site] };
        }
    }
}

impl StressPeaks {
    /// Returns the peaks before the first instant.
    pub fn new(sites: &StressSites) -> StressPeaks {
        let zeros = [0.0; SITES];
        // No stress exceeds that of a slot without a site.
        let nothing = BlockPeaks { square: [f64::INFINITY; SITES], time: zeros, trace: zeros };
        let mut peaks = StressPeaks { blocks: vec![nothing; sites.stresses.blocks()], arch: Arch::new() };
        // Every square exceeds a negative one, zero too.
        let before = SitePeak { square: -1.0, time: 0.0, trace: 0.0 };
        sites.stresses.slots().iter().for_each(|&slot| peaks.set(slot, before));
        peaks
    }

    /// Returns the peak in a slot.
    fn peak(&self, slot: u32) -> SitePeak {
        let (peaks, site) = (&self.blocks[slot as usize / SITES], slot as usize % SITES);
        SitePeak { square: peaks.square[site], time: peaks.time[site], trace: peaks.trace[site] }
    }

    /// Sets the peak in a slot.
    fn set(&mut self, slot: u32, SitePeak { square, time, trace }: SitePeak) {
        let (peaks, site) = (&mut self.blocks[slot as usize / SITES], slot as usize % SITES);
        (peaks.square[site], peaks.time[site], peaks.trace[site]) = (square, time, trace);
    }

    /// Returns the peak of each site with the site's position and part.
    fn all<'a>(&'a self, sites: &'a StressSites) -> impl Iterator<Item = (SitePeak, &'a Place)> {
        sites.stresses.slots().iter().map(|&slot| self.peak(slot)).zip(&sites.places)
    }

    /// Takes the stresses of a displacement at an instant (s). Collective.
    pub fn note<E: Engine>(&mut self, sites: &StressSites, engine: &E, u: &[f64], time: f64) -> Result<()> {
        let stresses = sites.stresses.blocks_at(&engine.to_local(u)?, time)?;
        widest(
            self.arch,
            #[inline(always)]
            || {
                for (peaks, stresses) in self.blocks.iter_mut().zip(&*stresses) {
                    peaks.note(stresses, time);
                }
            },
        );
        Ok(())
    }

    /// Returns the largest stress of all sites; of those that are equal but for rounding the
    /// earliest, then the first in x and y. Collective.
    pub fn largest(&self, sites: &StressSites, comm: &impl Communicator) -> Option<StressPeak> {
        let sign = |surface: PlateSurface| surface.sign();
        let of = |(peak, (at, _)): (SitePeak, &Place)| (peak.value(), peak.time, *at, sign(peak.surface()));
        type Numbers = (f64, f64, [f64; 2], f64);
        let earlier = |a: &Numbers, b: &Numbers| {
            a.1.total_cmp(&b.1).then(a.2[0].total_cmp(&b.2[0])).then(a.2[1].total_cmp(&b.2[1]))
        };
        let largest = comm.all_reduce_max(self.all(sites).map(|(peak, _)| peak.value()).fold(0.0, f64::max));
        let is_equal = |numbers: &Numbers| numbers.0 >= (1.0 - SAME_STRESS) * largest;
        let own: Vec<Numbers> =
            self.all(sites).map(of).filter(is_equal).min_by(earlier).into_iter().collect();
        let (value, time, at, sign) = comm.all_gather(&own).into_iter().min_by(earlier)?;
        let surface = if sign < 0.0 { PlateSurface::Bottom } else { PlateSurface::Top };
        Some(StressPeak { value, time, at, surface })
    }

    /// Returns the envelope of all instants so far.
    pub fn envelope<'e>(&self, sites: &'e StressSites) -> Envelope<'e> {
        Envelope {
            points: sites.places.iter().map(|(at, _)| *at).collect(),
            cells: &sites.cells,
            von_mises: self.all(sites).map(|(peak, _)| peak.value()).collect(),
            time: self.all(sites).map(|(peak, _)| peak.time).collect(),
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
        let numbers = |(peak, ([x, y], part)): (SitePeak, &Place)| {
            [*x, *y, *part as f64, peak.square, peak.time, peak.trace]
        };
        let mut list: Vec<f64> = self.all(sites).flat_map(numbers).collect();
        archive.list(&mut list)?;
        let Archive::Restores { same_processes, .. } = archive else { return Ok(()) };
        if !*same_processes {
            list = comm.all_gather(&list);
        }
        let extent = sites.places.iter().flat_map(|(at, _)| *at).fold(0.0, |m: f64, x| m.max(x.abs()));
        let grain = NEAR * comm.all_reduce_max(extent);
        let square = |x: f64| (x / grain).round() as i64;
        let mut known = HashMap::new();
        for &[x, y, part, of_peak, time, trace] in list.as_chunks().0 {
            let peak = SitePeak { square: of_peak, time, trace };
            known.insert((square(x), square(y), part as usize), peak);
        }
        let find = |([x, y], part): &Place| {
            // Rounding may place a node on the other side of the border between two squares.
            let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (i, j)));
            let mut found = around.filter_map(|(i, j)| known.get(&(square(*x) + i, square(*y) + j, *part)));
            let missing = || Error::Checkpoint("the checkpoint lacks the stresses at a node".into());
            found.next().copied().ok_or_else(missing)
        };
        let found: Vec<SitePeak> = comm.all_ok(sites.places.iter().map(find).collect())?;
        sites.stresses.slots().iter().zip(found).for_each(|(&slot, peak)| self.set(slot, peak));
        Ok(())
    }
}

/// Relative difference up to which two stresses are equal: places that symmetry makes alike differ
/// by rounding.
const SAME_STRESS: f64 = 1e-9;

/// Distance, relative to the largest coordinate, within which two positions are the same node.
const NEAR: f64 = 1e-9;
