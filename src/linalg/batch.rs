//! Batches of eight cells, and the layout of the engine's own vectors that suits them.
//!
//! In a vector numbered node by node the dofs of a cell lie far apart, and gathering them one at a
//! time costs more than all the arithmetic of the cell. A [`Layout`] puts the dofs of one kind side
//! by side along the lines of the mesh. Eight congruent cells in a row then read each of their
//! local dofs at once, from eight consecutive positions.

use super::BARE;
use super::vectors::waxpy;
use pulp::Simd;
use std::collections::BTreeMap;
use std::ops::{Add, AddAssign, Div, Mul, Sub};
use std::rc::Rc;

/// Number of cells per batch.
pub(super) const LANES: usize = 8;

/// One number for each cell of a batch, or for each of several systems.
///
/// The operators take values instead of references: the compiler would have to assume that
/// references alias and could not vectorise.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub(crate) struct Lanes(pub [f64; LANES]);

impl Lanes {
    /// Loads eight consecutive numbers of a vector in layout order.
    #[inline(always)]
    fn at(x: &[f64], place: u32) -> Lanes {
        let mut lanes = [0.0; LANES];
        lanes.copy_from_slice(&x[place as usize..][..LANES]);
        Lanes(lanes)
    }

    /// Returns a number in the first lane, and 0 in the others.
    pub fn first(value: f64) -> Lanes {
        let mut lanes = Lanes::default();
        lanes.0[0] = value;
        lanes
    }

    /// Returns the magnitudes.
    #[inline(always)]
    pub fn abs(mut self) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] = self.0[lane].abs();
        }
        self
    }

    /// Sets the numbers to multiples of the magnitudes of others.
    ///
    /// From a loop over many [`Lanes`], the compiler may otherwise make vectors across them, which
    /// it gathers and scatters; so with [`Lanes::add_scaled`].
    #[inline(always)]
    pub fn set_to_scaled_abs<S: Simd>(&mut self, simd: S, scale: f64, of: &Lanes) {
        let scale = simd.splat_f64s(scale);
        for (own, of) in S::as_mut_simd_f64s(&mut self.0).0.iter_mut().zip(S::as_simd_f64s(&of.0).0) {
            *own = simd.mul_f64s(scale, simd.abs_f64s(*of));
        }
    }

    /// Adds multiples of other numbers.
    #[inline(always)]
    pub fn add_scaled<S: Simd>(&mut self, simd: S, scale: f64, other: &Lanes) {
        let scale = simd.splat_f64s(scale);
        for (own, other) in S::as_mut_simd_f64s(&mut self.0).0.iter_mut().zip(S::as_simd_f64s(&other.0).0) {
            *own = simd.add_f64s(*own, simd.mul_f64s(scale, *other));
        }
    }

    /// Returns the larger number of each pair.
    #[inline(always)]
    pub fn max(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] = if self.0[lane] > other.0[lane] { self.0[lane] } else { other.0[lane] };
        }
        self
    }

    /// Returns the smaller number of each pair.
    #[inline(always)]
    pub fn min(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] = if self.0[lane] < other.0[lane] { self.0[lane] } else { other.0[lane] };
        }
        self
    }

    /// Returns the sum over the cells.
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

impl Div for Lanes {
    type Output = Lanes;

    #[inline(always)]
    fn div(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] /= other.0[lane];
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

/// Smallest number of cells for which a row is worth its unused lanes.
const LEAST_ROW: usize = 2;

/// Position of each dof in the engine's own vectors.
///
/// A vector in *layout order* has more positions than there are dofs: some belong to dofs that
/// supports hold, and some at the end to none. An operand is zero there, and what a product writes
/// there is never read.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Position of each dof.
    places: Vec<u32>,
    /// Whether each position belongs to a dof.
    taken: Vec<bool>,
    /// Whether the position of each dof is its index.
    is_identity: bool,
}

impl Layout {
    /// Creates a layout with the given position for each dof; no two dofs share one.
    pub fn new(places: impl IntoIterator<Item = usize>) -> Layout {
        let places: Vec<u32> = places.into_iter().map(|place| place as u32).collect();
        let mut taken = vec![false; places.iter().max().map_or(0, |&last| last as usize + 1)];
        for &place in &places {
            debug_assert!(!taken[place as usize], "two dofs at place {place}");
            taken[place as usize] = true;
        }
        let is_identity = places.iter().enumerate().all(|(dof, &place)| dof == place as usize);
        Layout { places, taken, is_identity }
    }

    /// Returns the number of dofs.
    pub fn dofs(&self) -> usize {
        self.places.len()
    }

    /// Returns a vector of zeros in layout order.
    pub(super) fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.taken.len() + LANES]
    }

    /// Returns the first of the free positions, one per lane, that lanes without a dof use.
    fn nowhere(&self) -> u32 {
        self.taken.len() as u32
    }

    /// Returns whether no dof has the position.
    fn is_free(&self, place: u32) -> bool {
        self.taken.get(place as usize).is_none_or(|taken| !taken)
    }

    /// Returns the position of each dof of a cell in the laid-out vectors; `None` for a constrained
    /// dof.
    fn places_of(&self, dofs: &[Option<usize>]) -> impl Iterator<Item = Option<u32>> {
        dofs.iter().map(|dof| dof.map(|dof| self.places[dof]))
    }

    /// Copies a vector into layout order; positions without dofs stay unchanged.
    #[inline(always)]
    pub(super) fn lay_out(&self, x: &[f64], laid: &mut [f64]) {
        if self.is_identity {
            return laid[..x.len()].copy_from_slice(x);
        }
        for (value, &place) in x.iter().zip(&self.places) {
            laid[place as usize] = *value;
        }
    }

    /// Copies a vector in layout order back into x.
    #[inline(always)]
    pub(super) fn collect(&self, laid: &[f64], x: &mut [f64]) {
        if self.is_identity {
            return x.copy_from_slice(&laid[..x.len()]);
        }
        for (value, &place) in x.iter_mut().zip(&self.places) {
            *value = laid[place as usize];
        }
    }

    /// Copies a vector `part` in layout order back into z, and sets y to `rest` + weight `part`.
    #[inline(always)]
    pub(super) fn collect_with_part(
        &self,
        weight: f64,
        part: &[f64],
        rest: &[f64],
        (y, z): (&mut [f64], &mut [f64]),
    ) {
        if self.is_identity {
            z.copy_from_slice(&part[..z.len()]);
            return waxpy(weight, z, &rest[..z.len()], y);
        }
        // Equal lengths spare a check of each index.
        let rest = &rest[..part.len()];
        for ((y, z), &place) in y.iter_mut().zip(z).zip(&self.places) {
            *z = part[place as usize];
            *y = rest[place as usize] + weight * *z;
        }
    }
}

/// Eight cells with equally many local dofs.
#[derive(Debug)]
pub(super) struct Batch {
    /// Cell number of each lane; the number of cells where the lane is unused.
    pub cells: [u32; LANES],
    /// Index of the batch's entry in [`Batches::panels`]: the panel of each form with the local
    /// values.
    pub panel: usize,
    /// One for a lane in use, zero otherwise.
    used: Lanes,
    places: Places,
}

#[derive(Debug)]
enum Places {
    /// Position of each local dof in the first lane; those of the other lanes follow it.
    Row(Vec<u32>),
    /// Position of each local dof, lane by lane.
    Scattered(Vec<[u32; LANES]>),
}

impl Batch {
    /// Returns the number of local dofs.
    #[inline(always)]
    pub fn size(&self) -> usize {
        match &self.places {
            Places::Row(starts) => starts.len(),
            Places::Scattered(places) => places.len(),
        }
    }

    /// Gathers the local values from a vector in layout order, with zero in unused lanes.
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

    /// Adds local values to a vector in layout order; `local` is zero in unused lanes.
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

/// Cells in a row while it is being built: each dof of the cell in lane k lies k positions after
/// that of the first lane.
struct Row<'a> {
    layout: &'a Layout,
    /// Position of each local dof in the first lane; unknown while all cells so far hold it.
    starts: Vec<Option<u32>>,
    /// Lane and number of each cell, by ascending lane.
    lanes: Vec<(usize, usize)>,
}

impl<'a> Row<'a> {
    fn new(layout: &'a Layout, cell: usize, dofs: &[Option<usize>]) -> Row<'a> {
        Row { layout, starts: layout.places_of(dofs).collect(), lanes: vec![(0, cell)] }
    }

    /// Adds a cell to the batch if one of the remaining lanes fits it, and returns whether one did.
    fn take(&mut self, cell: usize, dofs: &[Option<usize>]) -> bool {
        let places: Vec<_> = self.layout.places_of(dofs).collect();
        let pairs = || self.starts.iter().copied().zip(places.iter().copied());
        let lane = pairs().find_map(|(start, place)| place?.checked_sub(start?));
        let next = self.lanes.last().map_or(0, |(lane, _)| lane + 1);
        let Some(lane) = lane.filter(|&lane| (next..LANES).contains(&(lane as usize))) else { return false };
        let fits = pairs().all(|(start, place)| match (start, place) {
            (Some(start), Some(place)) => place == start + lane,
            // A dof that is held reads as zero, so no other dof may have its position.
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

/// Cell of a form: its free dofs and its class. Cells of one class have the same local values.
pub(super) type Cell = (Rc<[Option<usize>]>, usize);

/// All cells of a form in batches, shared by forms over the same cells.
#[derive(Debug)]
pub(super) struct Batches {
    cells: Vec<Cell>,
    /// Batches of eight cells.
    pub list: Vec<Batch>,
    /// Cells whose local values make up each panel, lane by lane.
    pub panels: Vec<[usize; LANES]>,
    /// Largest number of local dofs.
    pub width: usize,
}

impl Batches {
    /// Creates the batches of some cells.
    ///
    /// Cells of one class that lie in a row form a batch, and all batches of one class share one
    /// panel. The cells left over from all classes are packed together with one panel per batch.
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

    /// Creates the batches of equal systems side by side, one batch per cell. Entry 8 i + k of a
    /// vector belongs to dof i of system k, and lane k of every batch to system k.
    pub fn side_by_side(dofs: usize, cells: Vec<Cell>) -> Batches {
        let width = cells.iter().map(|(dofs, _)| dofs.len()).max().unwrap_or(0);
        let mut batches = Batches { cells, list: Vec::new(), panels: Vec::new(), width };
        let mut panel_of: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for number in 0..batches.cells.len() {
            let (own, class) = batches.cells[number].clone();
            let panel = *panel_of
                .entry((own.len(), class))
                .or_insert_with(|| batches.panel(std::slice::from_ref(&number)));
            let start = |dof: &Option<usize>| (LANES * dof.unwrap_or(dofs)) as u32;
            batches.list.push(Batch {
                cells: std::array::from_fn(|system| (LANES * number + system) as u32),
                panel,
                used: Lanes([1.0; LANES]),
                places: Places::Row(own.iter().map(start).collect()),
            });
        }
        batches
    }

    /// Returns whether the batches contain exactly these cells.
    pub fn are_of(&self, cells: &[Cell]) -> bool {
        self.cells == cells
    }

    /// Sorts the cells of a class by the offset of their dofs from those of the cell with the
    /// fewest held dofs.
    fn sort_along_lines(&self, layout: &Layout, class: &mut [usize]) {
        let held = |&cell: &usize| self.cells[cell].0.iter().filter(|dof| dof.is_none()).count();
        let Some(model) = class.iter().copied().min_by_key(held) else { return };
        let model: Vec<_> = layout.places_of(&self.cells[model].0).collect();
        class.sort_by_cached_key(|&cell| {
            let mut pairs = layout.places_of(&self.cells[cell].0).zip(&model);
            pairs.find_map(|(place, model)| Some(i64::from(place?) - i64::from((*model)?)))
        });
    }

    /// Returns the rows among the cells of a class, and the cells that lie in no row.
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

    /// Adds a panel with the values of some cells and returns its index. Unused lanes repeat the
    /// first cell, whose values do not matter there.
    fn panel(&mut self, cells: &[usize]) -> usize {
        let mut lanes = [cells[0]; LANES];
        lanes[..cells.len()].copy_from_slice(cells);
        self.panels.push(lanes);
        self.panels.len() - 1
    }

    /// Adds a batch of cells whose dofs lie anywhere.
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
