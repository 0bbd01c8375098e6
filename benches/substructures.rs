//! Work, memory and messages of substructured factors on 1 to 64 ranks, counted without any rank:
//! from the patterns of the blocks into which a grid of quadrilaterals is cut.
//!
//! `cargo bench --bench substructures` prints a row for each number of ranks: the dofs of the
//! interface, the entries of the largest factor of a rank and of the interface (in millions), the
//! memory of both on a rank, the multiplications of a factorisation and of a solve on a rank
//! relative to one process, the neighbours of a rank, and the bytes that a solve adds up.

use rebond::Error;
use rebond::assembly;
use rebond::dof_map::{DofMap, PER_NODE};
use rebond::kernels::{CellClass, ElementMatrix};
use rebond::linalg::{FactorSize, Native};
use rebond::mesh::{Diagonal, ElementKind, Grid, Mesh};
use rebond::plate::Plate;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

const GRIDS: [[usize; 2]; 3] = [[80, 32], [320, 128], [960, 384]];
const RANKS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];

/// Returns the size of the factor of a block of a grid, whose nodes that `is_shared` come last.
fn factor_of_block(cells: [usize; 2], is_shared: impl Fn(usize, usize) -> bool) -> Result<FactorSize, Error> {
    let sides = cells.map(|count| count as f64);
    let mesh = Mesh::rectangle(sides[0], sides[1], cells, ElementKind::Fvs, Diagonal::Right)?;
    let space = DofMap::new(&mesh, [])?;
    let plate = Plate::isotropic(1.0, 1.0, 0.3, 1.0);
    let arrays = assembly::cells(&mesh, &space, &plate)?;
    let engine = Native::new(space.dofs());
    let stiffness = engine.form(assembly::stiffness(&arrays));
    let shared = |node: &usize| is_shared(node % (cells[0] + 1), node / (cells[0] + 1));
    let nodes = (0..mesh.nodes.len()).filter(shared);
    let last: Vec<usize> = nodes.flat_map(|node| PER_NODE * node..PER_NODE * (node + 1)).collect();
    engine.factor_size(&(&stiffness).into(), &last)
}

/// Returns the entries of a factor, and the multiplications of the factorisation and of a solve.
fn counts(size: &FactorSize) -> [u64; 3] {
    let [factor, solve] = size.multiplications;
    [size.entries as u64, factor, solve]
}

/// Returns the numbers of the nodes of a grid in a block of rectangles.
fn nodes([columns, rows]: &[Range<usize>; 2], across: usize) -> impl Iterator<Item = usize> {
    let (columns, rows) = (columns.start..=columns.end, rows.start..=rows.end);
    rows.flat_map(move |row| columns.clone().map(move |column| row * (across + 1) + column))
}

/// Returns the size of the factor of the interface, whose nodes couple within each rank.
fn factor_of_interface(interface: &[BTreeSet<usize>]) -> Result<FactorSize, Error> {
    let shared: BTreeSet<usize> = interface.iter().flatten().copied().collect();
    let number: BTreeMap<usize, usize> =
        shared.iter().enumerate().map(|(number, node)| (*node, number)).collect();
    let block = |nodes: &BTreeSet<usize>| ElementMatrix {
        dofs: nodes.iter().map(|node| Some(number[node])).collect(),
        matrix: vec![1.0; nodes.len() * nodes.len()].into(),
        bending: None,
        class: CellClass::Bare(0),
    };
    let engine = Native::new(number.len());
    let form = engine.form(interface.iter().map(block).collect());
    let size = engine.factor_size(&(&form).into(), &[])?;
    // The engine counts one dof per node; each node of the plate has three.
    let [factor, solve] = size.multiplications;
    let multiplications = [PER_NODE.pow(3) as u64 * factor, PER_NODE.pow(2) as u64 * solve];
    let entries = PER_NODE.pow(2) * size.entries;
    Ok(FactorSize { entries, multiplications, ..size })
}

fn print_row(cells: [usize; 2], ranks: usize, alone: &mut Option<[u64; 3]>) -> Result<(), Error> {
    let grid = Grid::new([1.0, 1.0], cells, ElementKind::Fvs, Diagonal::Right)?;
    let blocks = grid.blocks(ranks);
    let mut count = vec![0; grid.nodes()];
    blocks.iter().for_each(|block| nodes(block, cells[0]).for_each(|node| count[node] += 1));
    let (mut largest, mut most_shared, mut interface) = ([0; 3], 0, Vec::new());
    let mut sizes = BTreeMap::new();
    for block in &blocks {
        let shared: BTreeSet<usize> = nodes(block, cells[0]).filter(|node| count[*node] > 1).collect();
        let [columns, rows] = block;
        let is_shared = |column: usize, row: usize| {
            count[(rows.start + row) * (cells[0] + 1) + columns.start + column] > 1
        };
        let sides = [columns.start > 0, columns.end < cells[0], rows.start > 0, rows.end < cells[1]];
        let shape = [columns.len(), rows.len()];
        let size = match sizes.get(&(shape, sides)) {
            Some(size) => *size,
            None => factor_of_block(shape, is_shared)?,
        };
        sizes.insert((shape, sides), size);
        largest = std::array::from_fn(|k| largest[k].max(counts(&size)[k]));
        most_shared = most_shared.max(shared.len());
        interface.push(shared);
    }
    let neighbours = |own: &BTreeSet<usize>| interface.iter().filter(|other| !own.is_disjoint(other)).count();
    let most_neighbours = interface.iter().map(neighbours).max().unwrap_or(1).max(1) - 1;
    let dofs = PER_NODE * count.iter().filter(|count| **count > 1).count();
    let of_interface = if ranks > 1 { factor_of_interface(&interface)? } else { FactorSize::default() };
    let total: [u64; 3] = std::array::from_fn(|k| largest[k] + counts(&of_interface)[k]);
    let one = *alone.get_or_insert(largest);
    let schur: u64 = interface.iter().map(|shared| (PER_NODE * shared.len()).pow(2) as u64 / 2).sum();
    let memory = 8 * (total[0] + 2 * (PER_NODE * most_shared).pow(2) as u64 + schur);
    println!(
        "{:<10}{ranks:>6}{dofs:>11}{:>9.2}{:>11.2}{:>9.0}{:>9.3}{:>9.3}{most_neighbours:>12}{:>9.1}",
        format!("{}x{}", cells[0], cells[1]),
        largest[0] as f64 / 1e6,
        of_interface.entries as f64 / 1e6,
        memory as f64 / 1e6,
        total[1] as f64 / one[1] as f64,
        total[2] as f64 / one[2] as f64,
        8.0 * dofs as f64 / 1e3,
    );
    Ok(())
}

fn main() -> Result<(), Error> {
    println!(
        "{:<10}{:>6}{:>11}{:>9}{:>11}{:>9}{:>9}{:>9}{:>12}{:>9}",
        "cells",
        "ranks",
        "interface",
        "rank, M",
        "shared, M",
        "MB",
        "factor",
        "solve",
        "neighbours",
        "sum, kB"
    );
    for cells in GRIDS {
        let mut alone = None;
        RANKS.into_iter().try_for_each(|ranks| print_row(cells, ranks, &mut alone))?;
    }
    Ok(())
}
