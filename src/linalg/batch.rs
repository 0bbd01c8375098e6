//! Cells taken eight at a time, and the order in which the engine keeps its own vectors for them.
//!
//! The dofs of a cell lie far apart in a vector that goes node by node, and to fetch them one by one costs more than all the
//! arithmetic of the cell. A [`Layout`] puts the dofs of one kind side by side along the lines of the mesh: eight congruent
//! cells in a row then read each of their local dofs in one go, at eight places that follow one another.

use std::collections::BTreeMap;

/// Cells in a batch.
pub(super) const LANES: usize = 8;

/// One number for each cell of a batch.
pub(super) type Lanes = [f64; LANES];

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

    /// x += a laid out vector.
    #[inline(always)]
    pub(super) fn add(&self, laid: &[f64], x: &mut [f64]) {
        for (value, &place) in x.iter_mut().zip(&self.places) {
            *value += laid[place as usize];
        }
    }
}

/// Eight cells with equally many local dofs.
#[derive(Debug, Clone)]
pub(super) struct Batch {
    /// Cell number of each lane; past the end where the lane is unused.
    pub cells: [u32; LANES],
    /// Which of a form's panels has the cells' local values.
    pub panel: usize,
    /// 1 for a lane in use, else 0.
    used: Lanes,
    places: Places,
}

#[derive(Debug, Clone)]
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

    /// local = scale times the values of a laid out vector, and zero in unused lanes.
    #[inline(always)]
    pub fn gather(&self, scale: f64, x: &[f64], local: &mut [Lanes]) {
        let mut scales = self.used;
        for factor in &mut scales {
            *factor *= scale;
        }
        match &self.places {
            Places::Row(starts) => {
                for (value, &start) in local.iter_mut().zip(starts) {
                    let row = &x[start as usize..][..LANES];
                    for lane in 0..LANES {
                        value[lane] = row[lane] * scales[lane];
                    }
                }
            }
            Places::Scattered(places) => {
                for (value, places) in local.iter_mut().zip(places) {
                    for lane in 0..LANES {
                        value[lane] = x[places[lane] as usize] * scales[lane];
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
                for (value, &start) in local.iter().zip(starts) {
                    let row = &mut y[start as usize..][..LANES];
                    for lane in 0..LANES {
                        row[lane] += value[lane];
                    }
                }
            }
            Places::Scattered(places) => {
                for (value, places) in local.iter().zip(places) {
                    for lane in 0..LANES {
                        y[places[lane] as usize] += value[lane];
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
        Row { layout, starts: places(layout, dofs), lanes: vec![(0, cell)] }
    }

    /// Takes a cell if it fits into one of the lanes left.
    fn take(&mut self, cell: usize, dofs: &[Option<usize>]) -> bool {
        let places = places(self.layout, dofs);
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

/// The places of a cell's dofs; none for those that are held.
fn places(layout: &Layout, dofs: &[Option<usize>]) -> Vec<Option<u32>> {
    dofs.iter().map(|dof| dof.map(|dof| layout.places[dof])).collect()
}

/// Cells of a form: their free dofs, and their class; those of one class have the same local values.
pub(super) trait Cells {
    /// Number of cells.
    fn count(&self) -> usize;
    /// Free dofs of a cell.
    fn dofs(&self, cell: usize) -> &[Option<usize>];
    /// Class of a cell.
    fn class(&self, cell: usize) -> usize;
}

/// Sorts the cells of a class by how far their dofs are displaced from those of the one with the fewest held.
fn sort_along_lines(layout: &Layout, cells: &impl Cells, class: &mut [usize]) {
    let held = |&cell: &usize| cells.dofs(cell).iter().filter(|dof| dof.is_none()).count();
    let Some(model) = class.iter().copied().min_by_key(held).map(|cell| places(layout, cells.dofs(cell)))
    else {
        return;
    };
    class.sort_by_cached_key(|&cell| {
        let pairs = places(layout, cells.dofs(cell)).into_iter().zip(&model);
        pairs.into_iter().find_map(|(place, model)| Some(i64::from(place?) - i64::from((*model)?)))
    });
}

/// Makes batches of all cells. `panel` collects the local values of some cells, lane by lane, and returns its number.
///
/// Cells of one class that lie in a row go together and share one panel; others of one class share the panel too; what is left
/// of all classes is packed together with a panel for each batch.
pub(super) fn batches(
    layout: &Layout,
    cells: &impl Cells,
    mut panel: impl FnMut(&[usize; LANES]) -> usize,
) -> Vec<Batch> {
    let mut classes: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for cell in 0..cells.count() {
        classes.entry((cells.dofs(cell).len(), cells.class(cell))).or_default().push(cell);
    }
    let unused = cells.count();
    let scattered = |chunk: &[usize], panel: usize| {
        let mut batch = Batch {
            cells: [unused as u32; LANES],
            panel,
            used: [0.0; LANES],
            places: Places::Scattered(Vec::new()),
        };
        let mut places = vec![[layout.nowhere(); LANES]; cells.dofs(chunk[0]).len()];
        for (lane, &cell) in chunk.iter().enumerate() {
            (batch.cells[lane], batch.used[lane]) = (cell as u32, 1.0);
            for (place, dof) in places.iter_mut().zip(cells.dofs(cell)) {
                place[lane] = dof.map_or(layout.nowhere(), |dof| layout.places[dof]);
            }
        }
        batch.places = Places::Scattered(places);
        batch
    };
    let mut batches = Vec::new();
    let mut left: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for ((size, _), mut class) in classes {
        let mut shared = None;
        let mut shared = |cell: usize| *shared.get_or_insert_with(|| panel(&[cell; LANES]));
        sort_along_lines(layout, cells, &mut class);
        let mut loose = Vec::new();
        let mut rest = class.as_slice();
        while let Some((&cell, mut others)) = rest.split_first() {
            let mut row = Row::new(layout, cell, cells.dofs(cell));
            while let Some((&other, further)) = others.split_first()
                && row.take(other, cells.dofs(other))
            {
                others = further;
            }
            if row.lanes.len() < LEAST_ROW {
                loose.push(cell);
                rest = &rest[1..];
                continue;
            }
            let starts = row.starts.iter().map(|start| start.unwrap_or(layout.nowhere())).collect();
            let mut batch = Batch {
                cells: [unused as u32; LANES],
                panel: shared(cell),
                used: [0.0; LANES],
                places: Places::Row(starts),
            };
            for (lane, cell) in row.lanes {
                (batch.cells[lane], batch.used[lane]) = (cell as u32, 1.0);
            }
            batches.push(batch);
            rest = others;
        }
        let whole = loose.chunks_exact(LANES);
        left.entry(size).or_default().extend(whole.remainder());
        for chunk in whole {
            batches.push(scattered(chunk, shared(chunk[0])));
        }
    }
    for loose in left.values() {
        for chunk in loose.chunks(LANES) {
            // The values in unused lanes do not matter.
            let mut lanes = [chunk[0]; LANES];
            lanes[..chunk.len()].copy_from_slice(chunk);
            batches.push(scattered(chunk, panel(&lanes)));
        }
    }
    batches.sort_by_key(|batch| batch.cells.iter().min().copied());
    batches
}
