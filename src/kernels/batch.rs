//! Batches of eight cells.
//!
//! A batch gathers its local dofs from vectors in layout order.

use super::CellClass;
use super::lane_mask::LaneMask;
use super::lane_values::{LANES, Lanes};
use super::layout::Layout;
use pulp::Simd;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Cell of a form: its free dofs and its class. Cells of one class have the same local values.
pub(crate) type Cell = (Rc<[Option<usize>]>, CellClass);

/// Smallest number of cells for which a row is worth its unused lanes.
const LEAST_ROW: usize = 2;

/// Eight cells with equally many local dofs.
#[derive(Debug)]
pub(crate) struct Batch {
    /// Number of the cell in each lane; the number of all cells where there is none.
    pub cells: [u32; LANES],
    /// Index of the batch's entry in [`Batches::panels`]: the panel of each form with the local
    /// values.
    pub panel: usize,
    places: Places,
}

/// Positions of local dofs in layout order.
#[derive(Debug)]
enum Places {
    Row(RowPlaces),
    /// Place of each local dof, lane by lane.
    Scattered(Vec<[u32; LANES]>),
}

/// Places of the local dofs of a row.
#[derive(Debug)]
struct RowPlaces {
    /// Lanes in use.
    used: LaneMask,
    /// Place of each local dof in the first lane; the other lanes follow it.
    starts: Vec<u32>,
    /// Places and numbers of two local dofs, the second of which lies one place further. Both are
    /// added at once: a processor waits where it loads places only some of which were just stored.
    pairs: Vec<(u32, [u32; 2])>,
    /// Place and number of each other local dof.
    singles: Vec<(u32, u32)>,
}

impl RowPlaces {
    /// Creates the places of a row from its lanes in use and the place of each local dof in the
    /// first lane.
    fn new(used: [bool; LANES], starts: Vec<u32>) -> RowPlaces {
        let mut order: Vec<u32> = (0..starts.len() as u32).collect();
        order.sort_by_key(|&dof| starts[dof as usize]);
        let (mut pairs, mut singles) = (Vec::new(), Vec::new());
        let mut rest = order.as_slice();
        while let [dof, others @ ..] = rest {
            let start = starts[*dof as usize];
            rest = others;
            match others {
                [next, others @ ..] if starts[*next as usize] == start + 1 => {
                    pairs.push((start, [*dof, *next]));
                    rest = others;
                }
                _ => singles.push((start, *dof)),
            }
        }
        RowPlaces { used: LaneMask::of(used), starts, pairs, singles }
    }
}

impl Batch {
    /// Returns the number of local dofs.
    #[inline(always)]
    pub fn size(&self) -> usize {
        match &self.places {
            Places::Row(row) => row.starts.len(),
            Places::Scattered(places) => places.len(),
        }
    }

    /// Gathers the local values of a vector, with zero in unused lanes.
    #[inline(always)]
    pub fn gather(&self, x: &[f64], local: &mut [Lanes]) {
        match &self.places {
            Places::Row(row) => {
                for (value, &start) in local.iter_mut().zip(&row.starts) {
                    *value = row.used.keep(Lanes::at(x, start));
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

    /// Adds some local vectors, which are zero in unused lanes, each to a vector.
    #[inline(always)]
    pub fn scatter<S: Simd, const N: usize>(&self, simd: S, locals: [&[Lanes]; N], sums: [&mut [f64]; N]) {
        match &self.places {
            Places::Row(row) => {
                let first_lane = simd.mask_between_m64s(0, 1).mask();
                for &(start, [dof, next]) in &row.pairs {
                    for k in 0..N {
                        let (dof, next) = (&locals[k][dof as usize], &locals[k][next as usize]);
                        let places = &mut sums[k][start as usize..][..LANES + 1];
                        places[LANES] += next.0[LANES - 1];
                        let sum = Lanes::at(places, 0) + *dof + next.moved_up(simd, first_lane);
                        places[..LANES].copy_from_slice(&sum.0);
                    }
                }
                for &(start, dof) in &row.singles {
                    for k in 0..N {
                        let sum = Lanes::at(sums[k], start) + locals[k][dof as usize];
                        sums[k][start as usize..][..LANES].copy_from_slice(&sum.0);
                    }
                }
            }
            Places::Scattered(places) => {
                for (dof, places) in places.iter().enumerate() {
                    for k in 0..N {
                        for lane in 0..LANES {
                            sums[k][places[lane] as usize] += locals[k][dof].0[lane];
                        }
                    }
                }
            }
        }
    }
}

/// Cells in a row while it is being built: each dof of the cell in lane k lies k positions after
/// the dof of the first lane.
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

    /// Adds a cell to the row if one of the remaining lanes fits it. Returns whether one did.
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

/// All cells of a form in batches, shared by forms over the same cells.
#[derive(Debug)]
pub(crate) struct Batches {
    /// Cells of the batches.
    pub cells: Vec<Cell>,
    /// Batches of eight cells.
    list: Vec<Batch>,
    /// Cells whose local values make up each panel, lane by lane.
    pub panels: Vec<[usize; LANES]>,
    /// Largest number of local dofs.
    pub width: usize,
}

impl Batches {
    /// Creates the batches of some cells.
    ///
    /// A batch has up to eight cells, and all batches of a class share the local values of one
    /// panel. Cells of a class that lie in a row come first, then all others of the class, eight at
    /// a time. What is left of all classes is packed into batches that have a panel each.
    pub fn new(layout: &Layout, cells: Vec<Cell>) -> Batches {
        let width = cells.iter().map(|(dofs, _)| dofs.len()).max().unwrap_or(0);
        let mut batches = Batches { cells, list: Vec::new(), panels: Vec::new(), width };
        let mut classes: BTreeMap<(usize, CellClass), Vec<usize>> = BTreeMap::new();
        for (number, (dofs, class)) in batches.cells.iter().enumerate() {
            classes.entry((dofs.len(), *class)).or_default().push(number);
        }
        let mut remainders: BTreeMap<(usize, bool), Vec<usize>> = BTreeMap::new();
        for ((size, kind), mut class) in classes {
            batches.sort_along_lines(layout, &mut class);
            let (rows, loose) = batches.rows(layout, &class);
            let whole = loose.chunks_exact(LANES);
            let kind = (size, matches!(kind, CellClass::Bare(_)));
            remainders.entry(kind).or_default().extend(whole.remainder());
            if rows.is_empty() && whole.len() == 0 {
                continue;
            }
            let panel = batches.panel(&class[..1]);
            for Row { starts, lanes, .. } in rows {
                let starts = starts.iter().map(|start| start.unwrap_or(layout.nowhere()));
                let mut used = [false; LANES];
                lanes.iter().for_each(|(lane, _)| used[*lane] = true);
                batches.push(panel, &lanes, Places::Row(RowPlaces::new(used, starts.collect())));
            }
            for chunk in whole {
                batches.scatter(layout, panel, chunk);
            }
        }
        for loose in remainders.values() {
            for chunk in loose.chunks(LANES) {
                let panel = batches.panel(chunk);
                batches.scatter(layout, panel, chunk);
            }
        }
        batches.list.sort_by_cached_key(|batch| batch.cells.iter().min().copied());
        batches
    }

    /// Calls a product with each batch and its number of dofs. The compiler unrolls the loops of
    /// the product for the numbers of dofs that plate elements have.
    #[inline(always)]
    pub fn for_each(&self, mut product: impl FnMut(&Batch, usize)) {
        for batch in &self.list {
            match batch.size() {
                9 => product(batch, 9),
                12 => product(batch, 12),
                size => product(batch, size),
            }
        }
    }

    /// Sorts the cells of a class by the offset of their dofs from the dofs of the cell that has
    /// the fewest held ones.
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
        let mut cells = [self.cells.len() as u32; LANES];
        lanes.iter().for_each(|&(lane, cell)| cells[lane] = cell as u32);
        self.list.push(Batch { cells, panel, places });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    struct Scatter<'a>(&'a Batch, &'a [Lanes], &'a mut [f64]);

    impl WithSimd for Scatter<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            self.0.scatter(simd, [self.1], [self.2]);
        }
    }

    /// Local dofs of a row reach their positions, whether those overlap, follow each other or lie
    /// apart, with any vector registers.
    #[test]
    fn rows_are_added_where_they_belong() {
        let starts = [9, 8, 30, 7, 31, 50, 30];
        let row = RowPlaces::new([true; LANES], starts.to_vec());
        assert_eq!((row.pairs.len(), row.singles.len()), (2, 3));
        let batch = Batch { cells: [0; LANES], panel: 0, places: Places::Row(row) };
        let value = |dof: usize, lane: usize| (1 << dof) as f64 * (1.0 + lane as f64);
        let local: Vec<Lanes> =
            (0..starts.len()).map(|dof| Lanes(std::array::from_fn(|lane| value(dof, lane)))).collect();
        let mut expected = vec![0.5; 60];
        for (dof, start) in starts.into_iter().enumerate() {
            (0..LANES).for_each(|lane| expected[start as usize + lane] += value(dof, lane));
        }
        for arch in [Arch::Scalar, Arch::new()] {
            let mut sum = vec![0.5; 60];
            arch.dispatch(Scatter(&batch, &local, &mut sum));
            assert_eq!(sum, expected, "{arch:?}");
        }
    }
}
