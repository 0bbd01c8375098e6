//! Cells taken eight at a time, and the order in which the engine keeps its own vectors for them.
//!
//! The dofs of a cell lie far apart in a vector that goes node by node, and to fetch them one by one costs more than all the
//! arithmetic of the cell. A [`Layout`] puts the dofs of one kind side by side along the lines of the mesh: eight congruent
//! cells in a row then read each of their local dofs in one go, at eight places that follow one another.

use super::BARE;
use std::collections::BTreeMap;
use std::ops::{Add, AddAssign, Mul, Sub};
use std::rc::Rc;

/// Cells in a batch.
pub(super) const LANES: usize = 8;

/// One number for each cell of a batch.
///
/// Its arithmetic takes values: of references the compiler would have to expect that they overlap, and go lane by lane.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub(super) struct Lanes(pub [f64; LANES]);

impl Lanes {
    /// The numbers from a place of a laid out vector on.
    #[inline(always)]
    fn at(x: &[f64], place: u32) -> Lanes {
        let mut lanes = [0.0; LANES];
        lanes.copy_from_slice(&x[place as usize..][..LANES]);
        Lanes(lanes)
    }

    /// Magnitudes.
    #[inline(always)]
    pub fn abs(mut self) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] = self.0[lane].abs();
        }
        self
    }

    /// Sum over the cells.
    pub fn sum(self) -> f64 {
        self.0.iter().sum()
    }
}

impl Add for Lanes {
    type Output = Lanes;

    #[inline(always)]
    fn add(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] += other.0[lane];
        }
        self
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Lanes) {
        *self = *self + other;
    }
}

impl Sub for Lanes {
    type Output = Lanes;

    #[inline(always)]
    fn sub(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] -= other.0[lane];
        }
        self
    }
}

impl Mul for Lanes {
    type Output = Lanes;

    #[inline(always)]
    fn mul(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] *= other.0[lane];
        }
        self
    }
}

impl Mul<Lanes> for f64 {
    type Output = Lanes;

    #[inline(always)]
    fn mul(self, lanes: Lanes) -> Lanes {
        Lanes([self; LANES]) * lanes
    }
}

/// Cells that make a row worth its unused lanes.
const LEAST_ROW: usize = 2;

/// Where the engine keeps each dof in its own vectors.
///
/// Such a *laid out* vector has more places than dofs: some for dofs that supports hold, and at the end some for nothing. A
/// factor reads zero there, and what a product leaves there is never looked at.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Place of each dof.
    places: Vec<u32>,
    /// Whether a dof has the place.
    taken: Vec<bool>,
}

impl Layout {
    /// A layout with the given place for each dof; no two share one.
    pub fn new(places: impl IntoIterator<Item = usize>) -> Layout {
        let places: Vec<u32> = places.into_iter().map(|place| place as u32).collect();
        let mut taken = vec![false; places.iter().max().map_or(0, |&last| last as usize + 1)];
        for &place in &places {
            debug_assert!(!taken[place as usize], "two dofs at place {place}");
            taken[place as usize] = true;
        }
        Layout { places, taken }
    }

    /// Number of dofs.
    pub fn dofs(&self) -> usize {
        self.places.len()
    }

    /// A laid out vector of zeros.
    pub(super) fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.taken.len() + LANES]
    }

    /// Where lanes without a dof point to: as many free places as there are lanes.
    fn nowhere(&self) -> u32 {
        self.taken.len() as u32
    }

    /// Whether no dof has the place.
    fn is_free(&self, place: u32) -> bool {
        self.taken.get(place as usize).is_none_or(|taken| !taken)
    }

    /// The places of a cell's dofs; none for those that are held.
    fn places_of(&self, dofs: &[Option<usize>]) -> impl Iterator<Item = Option<u32>> {
        dofs.iter().map(|dof| dof.map(|dof| self.places[dof]))
    }

    /// Lays a vector out; the places without dofs stay as they are.
    #[inline(always)]
    pub(super) fn lay_out(&self, x: &[f64], laid: &mut [f64]) {
        for (value, &place) in x.iter().zip(&self.places) {
            laid[place as usize] = *value;
        }
    }

    /// x = a laid out vector.
    #[inline(always)]
    pub(super) fn collect(&self, laid: &[f64], x: &mut [f64]) {
        for (value, &place) in x.iter_mut().zip(&self.places) {
            *value = laid[place as usize];
        }
    }
}

/// Eight cells with equally many local dofs.
#[derive(Debug)]
pub(super) struct Batch {
    /// Cell number of each lane; past the end where the lane is unused.
    pub cells: [u32; LANES],
    /// Which of a form's panels has the cells' local values: the number of an entry of [`Batches::panels`].
    pub panel: usize,
    /// 1 for a lane in use, else 0.
    used: Lanes,
    places: Places,
}

#[derive(Debug)]
enum Places {
    /// Place of each local dof in the first lane; those of the others follow it.
    Row(Vec<u32>),
    /// Place of each local dof, lane by lane.
    Scattered(Vec<[u32; LANES]>),
}

impl Batch {
    /// Number of local dofs.
    #[inline(always)]
    pub fn size(&self) -> usize {
        match &self.places {
            Places::Row(starts) => starts.len(),
            Places::Scattered(places) => places.len(),
        }
    }

    /// local = the values of a laid out vector, and zero in unused lanes.
    #[inline(always)]
    pub fn gather(&self, x: &[f64], local: &mut [Lanes]) {
        match &self.places {
            Places::Row(starts) => {
                let starts = &starts[..local.len()];
                for (value, &start) in local.iter_mut().zip(starts) {
                    *value = Lanes::at(x, start) * self.used;
                }
            }
            Places::Scattered(places) => {
                for (value, places) in local.iter_mut().zip(places) {
                    for lane in 0..LANES {
                        value.0[lane] = x[places[lane] as usize];
                    }
                }
            }
        }
    }

    /// Adds to a laid out vector; `local` is zero in unused lanes.
    #[inline(always)]
    pub fn scatter(&self, local: &[Lanes], y: &mut [f64]) {
        match &self.places {
            Places::Row(starts) => {
                let starts = &starts[..local.len()];
                for (value, &start) in local.iter().zip(starts) {
                    let sum = Lanes::at(y, start) + *value;
                    y[start as usize..][..LANES].copy_from_slice(&sum.0);
                }
            }
            Places::Scattered(places) => {
                for (value, places) in local.iter().zip(places) {
                    for lane in 0..LANES {
                        y[places[lane] as usize] += value.0[lane];
                    }
                }
            }
        }
    }
}

/// Cells in a row, as it is being gathered: a cell in lane k has each dof k places after the first lane's.
struct Row<'a> {
    layout: &'a Layout,
    /// Place of each local dof in the first lane; not known yet where all cells so far are held.
    starts: Vec<Option<u32>>,
    /// Cell of each lane in use, ascending.
    lanes: Vec<(usize, usize)>,
}

impl<'a> Row<'a> {
    fn new(layout: &'a Layout, cell: usize, dofs: &[Option<usize>]) -> Row<'a> {
        Row { layout, starts: layout.places_of(dofs).collect(), lanes: vec![(0, cell)] }
    }

    /// Takes a cell if it fits into one of the lanes left.
    fn take(&mut self, cell: usize, dofs: &[Option<usize>]) -> bool {
        let places: Vec<_> = self.layout.places_of(dofs).collect();
        let pairs = || self.starts.iter().copied().zip(places.iter().copied());
        let lane = pairs().find_map(|(start, place)| place?.checked_sub(start?));
        let next = self.lanes.last().map_or(0, |(lane, _)| lane + 1);
        let Some(lane) = lane.filter(|&lane| (next..LANES).contains(&(lane as usize))) else { return false };
        let fits = pairs().all(|(start, place)| match (start, place) {
            (Some(start), Some(place)) => place == start + lane,
            // What is held reads as zero, and nothing else may be there.
            (Some(start), None) => self.layout.is_free(start + lane),
            (None, Some(place)) => place.checked_sub(lane).is_some_and(|start| {
                self.lanes.iter().all(|&(lane, _)| self.layout.is_free(start + lane as u32))
            }),
            (None, None) => true,
        });
        if fits {
            for (start, place) in self.starts.iter_mut().zip(&places) {
                *start = start.or(place.map(|place| place - lane));
            }
            self.lanes.push((lane as usize, cell));
        }
        fits
    }
}

/// A cell of a form: its free dofs, and its class; cells of one class have the same local values.
pub(super) type Cell = (Rc<[Option<usize>]>, usize);

/// All cells of a form in batches. Forms over the same cells share them.
#[derive(Debug)]
pub(super) struct Batches {
    cells: Vec<Cell>,
    /// The batches.
    pub list: Vec<Batch>,
    /// The cells whose local values make up each panel, lane by lane.
    pub panels: Vec<[usize; LANES]>,
    /// Largest number of local dofs.
    pub width: usize,
}

impl Batches {
    /// Cells of one class that lie in a row go together and share one panel; others of one class share the panel too; what
    /// is left of all classes is packed together with a panel for each batch.
    pub fn new(layout: &Layout, cells: Vec<Cell>) -> Batches {
        let width = cells.iter().map(|(dofs, _)| dofs.len()).max().unwrap_or(0);
        let mut classes: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for (number, (dofs, class)) in cells.iter().enumerate() {
            classes.entry((dofs.len(), *class)).or_default().push(number);
        }
        let mut batches = Batches { cells, list: Vec::new(), panels: Vec::new(), width };
        let mut left: BTreeMap<(usize, bool), Vec<usize>> = BTreeMap::new();
        for ((size, number), mut class) in classes {
            batches.sort_along_lines(layout, &mut class);
            let (rows, loose) = batches.rows(layout, &class);
            let whole = loose.chunks_exact(LANES);
            left.entry((size, number >= BARE)).or_default().extend(whole.remainder());
            if rows.is_empty() && whole.len() == 0 {
                continue;
            }
            let panel = batches.panel(&class[..1]);
            for Row { starts, lanes, .. } in rows {
                let starts = starts.iter().map(|start| start.unwrap_or(layout.nowhere())).collect();
                batches.push(panel, &lanes, Places::Row(starts));
            }
            for chunk in whole {
                batches.scatter(layout, panel, chunk);
            }
        }
        for loose in left.values() {
            for chunk in loose.chunks(LANES) {
                let panel = batches.panel(chunk);
                batches.scatter(layout, panel, chunk);
            }
        }
        batches.list.sort_by_key(|batch| batch.cells.iter().min().copied());
        batches
    }

    /// Whether the batches are of just these cells.
    pub fn are_of(&self, cells: &[Cell]) -> bool {
        self.cells == cells
    }

    /// Sorts the cells of a class by how far their dofs are displaced from those of the one with the fewest held.
    fn sort_along_lines(&self, layout: &Layout, class: &mut [usize]) {
        let held = |&cell: &usize| self.cells[cell].0.iter().filter(|dof| dof.is_none()).count();
        let Some(model) = class.iter().copied().min_by_key(held) else { return };
        let model: Vec<_> = layout.places_of(&self.cells[model].0).collect();
        class.sort_by_cached_key(|&cell| {
            let mut pairs = layout.places_of(&self.cells[cell].0).zip(&model);
            pairs.find_map(|(place, model)| Some(i64::from(place?) - i64::from((*model)?)))
        });
    }

    /// The rows among the cells of a class, and the cells that lie in none.
    fn rows<'l>(&self, layout: &'l Layout, class: &[usize]) -> (Vec<Row<'l>>, Vec<usize>) {
        let (mut rows, mut loose) = (Vec::new(), Vec::new());
        let mut rest = class;
        while let Some((&first, others)) = rest.split_first() {
            let mut row = Row::new(layout, first, &self.cells[first].0);
            let more = others.iter().take_while(|&&cell| row.take(cell, &self.cells[cell].0)).count();
            if 1 + more >= LEAST_ROW {
                rows.push(row);
                rest = &others[more..];
            } else {
                loose.push(first);
                rest = others;
            }
        }
        (rows, loose)
    }

    /// A panel with the values of some cells; those of the lanes left, the first's, do not matter.
    fn panel(&mut self, cells: &[usize]) -> usize {
        let mut lanes = [cells[0]; LANES];
        lanes[..cells.len()].copy_from_slice(cells);
        self.panels.push(lanes);
        self.panels.len() - 1
    }

    /// Adds a batch of cells wherever their dofs are.
    fn scatter(&mut self, layout: &Layout, panel: usize, cells: &[usize]) {
        let mut places = vec![[layout.nowhere(); LANES]; self.cells[cells[0]].0.len()];
        for (lane, &cell) in cells.iter().enumerate() {
            for (slot, place) in places.iter_mut().zip(layout.places_of(&self.cells[cell].0)) {
                slot[lane] = place.unwrap_or(layout.nowhere());
            }
        }
        let lanes: Vec<_> = cells.iter().copied().enumerate().collect();
        self.push(panel, &lanes, Places::Scattered(places));
    }

    /// Adds a batch with the given cells in some lanes.
    fn push(&mut self, panel: usize, lanes: &[(usize, usize)], places: Places) {
        let mut batch =
            Batch { cells: [self.cells.len() as u32; LANES], panel, used: Lanes::default(), places };
        for &(lane, cell) in lanes {
            (batch.cells[lane], batch.used.0[lane]) = (cell as u32, 1.0);
        }
        self.list.push(batch);
    }
}
