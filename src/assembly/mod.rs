//! Assembly of cells into matrices and loads; this is the only loop over cells.
//!
//! Congruent cells (translates of one another) share one set of local arrays, so that a regular
//! mesh computes its element matrices only a few times.

mod beam;
mod border;
mod edge;
mod foundation;
mod local;
mod pressure;
mod prestress;
mod probe;
mod products;
mod patches;
mod recovery;
mod samples;
mod site_blocks;
mod sites;

pub use beam::{BeamPiece, BeamStiffness, beams, line_in_cells};
pub use edge::{EdgeSprings, cells_at_sides, edge_springs};
pub use foundation::foundation;
pub use local::Local;
pub use patches::CurvatureRow;
pub use pressure::Pressure;
pub use prestress::prestress;
pub use probe::Probe;
pub use products::{centres_of_mass, consistent_momenta, forces, on_nodes, singular_momenta, squares};
pub use recovery::{Recovery, vertex_weights};
pub use sites::{RecoverySite, sum_over_ranks};

use crate::dof_map::{DofMap, PER_NODE};
use crate::element::AnyElement;
use crate::element::adaptive::{Rules, Triangle};
use crate::element::quadrature::{self, Rule};
use crate::error::Result;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Bending, CellClass, ElementMatrix, SingularMassCell};
use crate::mesh::{Mesh, Point};
use crate::plate::Sections;
use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

/// Cell, and a matrix over its local dofs, symmetric and row by row.
pub type CellMatrix = (usize, Rc<[f64]>);

/// Local arrays of a cell, with its dofs in the numbering of a space.
#[derive(Debug, Clone)]
pub struct CellArrays {
    /// Free dof of each local dof; `None` where a support holds it at zero.
    pub dofs: Rc<[Option<usize>]>,
    /// Factor of each local dof's value relative to its free dof, where not all are 1 (at supports
    /// with oblique axes).
    pub factors: Option<Rc<[f64]>>,
    /// Class of congruent cells.
    pub class: CellClass,
    /// Arrays of the cell, over local dofs.
    pub local: Rc<Local>,
}

impl CellArrays {
    /// Returns a local dof's value for a vector over the free dofs.
    pub fn value(&self, local: usize, x: &[f64]) -> f64 {
        let factor = self.factors.as_ref().map_or(1.0, |factors| factors[local]);
        self.dofs[local].map_or(0.0, |dof| factor * x[dof])
    }

    /// Adds a local vector, such as a load, to a vector over the free dofs.
    pub fn add(&self, local: &[f64], x: &mut [f64]) {
        for (i, value) in local.iter().enumerate() {
            if let Some(dof) = self.dofs[i] {
                x[dof] += self.factors.as_ref().map_or(1.0, |factors| factors[i]) * value;
            }
        }
    }

    /// Adds the product of a symmetric local matrix, row by row, with local values to a vector over
    /// the free dofs.
    pub fn add_product(&self, matrix: &[f64], values: &[f64], x: &mut [f64]) {
        let product: Vec<f64> = matrix.chunks_exact(values.len()).map(|row| dot(row, values)).collect();
        self.add(&product, x);
    }

    /// Returns the values of all local dofs for a vector over the free dofs.
    pub fn values(&self, x: &[f64]) -> Vec<f64> {
        (0..self.dofs.len()).map(|local| self.value(local, x)).collect()
    }

    /// Returns a symmetric local matrix as a form over the free dofs, in a class of its own with
    /// this number.
    pub fn form(&self, matrix: &Rc<[f64]>, number: usize) -> ElementMatrix {
        ElementMatrix { class: CellClass::Bare(number), ..self.block(matrix, None) }
    }

    /// Returns a local vector in terms of the free dofs, with their factors applied.
    fn of_dofs(&self, local: &Rc<[f64]>) -> Rc<[f64]> {
        match &self.factors {
            None => local.clone(),
            Some(factors) => local.iter().zip(&**factors).map(|(value, factor)| value * factor).collect(),
        }
    }

    /// Returns a local matrix as a form over the free dofs, with their factors applied.
    fn block(&self, matrix: &Rc<[f64]>, bending: Option<&Rc<Bending>>) -> ElementMatrix {
        let (dofs, class) = (self.dofs.clone(), self.class);
        match &self.factors {
            None => ElementMatrix { dofs, matrix: matrix.clone(), bending: bending.cloned(), class },
            Some(factors) => {
                let size = factors.len();
                let entry = |(k, value): (usize, &f64)| value * factors[k / size] * factors[k % size];
                let matrix = matrix.iter().enumerate().map(entry).collect();
                ElementMatrix { dofs, matrix, bending: None, class }
            }
        }
    }
}

/// Key of a class of congruent cells: the shape, and the number of the uniform section. A varying
/// section makes a class of its own, and so do dofs with factors.
type Class = (Vec<i64>, std::result::Result<usize, usize>);

/// Returns all cells of a mesh with their local arrays, in the order of the cells.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) naming a cell that cannot carry its element, and the
/// errors of the sections.
pub fn cells(mesh: &Mesh, space: &DofMap, sections: &impl Sections) -> Result<Vec<CellArrays>> {
    let grain = mesh.grain();
    let mut classes: HashMap<Class, (CellClass, Rc<Local>)> = HashMap::new();
    let mut cells = Vec::with_capacity(mesh.cells.len());
    for (number, cell) in mesh.cells.iter().enumerate() {
        let nodes = cell.nodes();
        let factors = space.factors_of(nodes).map(Rc::from);
        let kind = match sections.kind(number) {
            Some(kind) if factors.is_none() => Ok(kind),
            _ => Err(number),
        };
        let count = classes.len();
        let (class, local) = match classes.entry((mesh.shape(number, grain), kind)) {
            std::collections::hash_map::Entry::Occupied(class) => class.get().clone(),
            std::collections::hash_map::Entry::Vacant(new) => {
                let local = local::arrays(mesh, number, sections)?;
                let class = if factors.is_some() { CellClass::Bare(count) } else { CellClass::Plate(count) };
                new.insert((class, Rc::new(local))).clone()
            }
        };
        cells.push(CellArrays { dofs: space.dofs_of(nodes).collect(), factors, class, local });
    }
    Ok(cells)
}

/// Returns the cells over all deflections and slopes of a mesh, three per node, held or not.
pub fn unheld(mesh: &Mesh, cells: &[CellArrays]) -> Vec<CellArrays> {
    let whole = |(cell, arrays): (&crate::mesh::Cell, &CellArrays)| {
        let dofs = cell.nodes().iter().flat_map(|node| (0..PER_NODE).map(move |k| Some(PER_NODE * node + k)));
        CellArrays { dofs: dofs.collect(), factors: None, ..arrays.clone() }
    };
    mesh.cells.iter().zip(cells).map(whole).collect()
}

/// Returns the cells' contributions to the stiffness K.
pub fn stiffness(cells: &[CellArrays]) -> Vec<ElementMatrix> {
    cells.iter().map(|cell| cell.block(&cell.local.stiffness, Some(&cell.local.bending))).collect()
}

/// Returns the cells' contributions to the consistent mass M_r.
pub fn consistent_mass(cells: &[CellArrays]) -> Vec<ElementMatrix> {
    cells.iter().map(|cell| cell.block(&cell.local.mass, None)).collect()
}

/// Returns the matrices of all cells, given a value at points of cells, quadrature rules of some
/// cells, and the matrix of a cell by its rule and its values.
fn by_values<V: Default>(
    mesh: &Mesh,
    value: &dyn Fn(usize, Point) -> Result<V>,
    rules: &Rules,
    matrix: impl Fn(&AnyElement, Rule, &dyn Fn(Point) -> V) -> Rc<[f64]>,
) -> Result<Vec<CellMatrix>> {
    let fault = RefCell::new(None);
    let of_cell = |number: usize| -> Result<CellMatrix> {
        let value = |point: Point| {
            value(number, point).unwrap_or_else(|error| {
                fault.replace(Some(error));
                V::default()
            })
        };
        let rule = rules.get(&number).map_or((&quadrature::DEGREE_6).into(), |rule| Rule::Own(rule));
        Ok((number, matrix(&mesh.element(number)?, rule, &value)))
    };
    let matrices = (0..mesh.cells.len()).map(of_cell).collect::<Result<_>>()?;
    fault.take().map_or(Ok(matrices), Err)
}

/// Returns the rows of B and the entries of C of the singular mass.
pub fn singular_mass(cells: &[CellArrays]) -> Vec<SingularMassCell> {
    let average = |cell: &CellArrays| SingularMassCell {
        dofs: cell.dofs.clone(),
        row: cell.of_dofs(&cell.local.row),
        mass: cell.local.weight,
        class: cell.class,
    };
    cells.iter().map(average).collect()
}

/// Part of a cell's own mass up to which carried masses are light.
const LIGHT: f64 = 0.7;

/// Sets the rows of B of cells that carry masses, given the bare cells.
///
/// The singular mass takes the mean over plate and carried masses together, so that B gets no
/// further row, which would nearly depend on the rows of the cells. Light masses follow the mean of
/// the plate instead, with an error below the error of the means. Otherwise they would allow
/// motions with hardly any inertia where the rows of the plate depend on each other, as on
/// rectangles with simply supported edges.
pub fn average_carried(cells: &mut [CellArrays], bare: &[CellArrays]) {
    for (cell, CellArrays { local: bare, .. }) in cells.iter_mut().zip(bare) {
        let factor = cell.local.weight / bare.weight;
        if factor != 1.0 {
            let local = Rc::make_mut(&mut cell.local);
            local.row = match factor <= 1.0 + LIGHT {
                true => bare.coupling.iter().map(|b| factor * b).collect(),
                false => local.coupling.clone(),
            };
        }
    }
}

/// Adds a mass at a point of a cell, in kg, to the arrays of the cell.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) for a cell that cannot carry its element.
pub fn add_point_mass(
    mesh: &Mesh,
    cells: &mut [CellArrays],
    number: usize,
    point: Point,
    mass: f64,
) -> Result<()> {
    let classes = cells.len();
    let cell = &mut cells[number];
    // The cell has no congruent ones any more; a bare one never had.
    if let CellClass::Plate(class) = &mut cell.class {
        *class = classes + number;
    }
    let values: Vec<f64> = mesh.element(number)?.basis_at(point).iter().map(|basis| basis.value).collect();
    let local = Rc::make_mut(&mut cell.local);
    add_square(mass, &values, Rc::make_mut(&mut local.mass));
    axpy(mass, &values, Rc::make_mut(&mut local.coupling));
    local.weight += mass;
    Ok(())
}

/// Adds scale v v^T to a matrix, stored by rows.
fn add_square(scale: f64, v: &[f64], matrix: &mut [f64]) {
    for (row, value) in matrix.chunks_exact_mut(v.len()).zip(v) {
        axpy(scale * value, v, row);
    }
}

/// Returns the load F of a uniform upward pressure, in Pa, over `dofs` free dofs, in N.
pub fn uniform_load(cells: &[CellArrays], dofs: usize, pressure: f64) -> Vec<f64> {
    load_of(cells, dofs, pressure, |local| &local.moments)
}

/// Returns the weight of the cells under gravity g, in m/s^2 downward, over `dofs` free dofs, in N.
pub fn weight(cells: &[CellArrays], dofs: usize, g: f64) -> Vec<f64> {
    load_of(cells, dofs, -g, |local| &local.coupling)
}

/// Returns a multiple of integrals over the cells as a vector over `dofs` free dofs.
fn load_of(
    cells: &[CellArrays],
    dofs: usize,
    factor: f64,
    integrals: impl Fn(&Local) -> &Rc<[f64]>,
) -> Vec<f64> {
    let mut load = vec![0.0; dofs];
    for cell in cells {
        let local: Vec<f64> = integrals(&cell.local).iter().map(|integral| factor * integral).collect();
        cell.add(&local, &mut load);
    }
    load
}

/// Returns the pieces of all cells, cell by cell.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) for a cell that cannot carry its element.
pub fn pieces(mesh: &Mesh) -> Result<Vec<Triangle>> {
    let mut pieces = Vec::new();
    for cell in 0..mesh.cells.len() {
        pieces.extend(mesh.element(cell)?.pieces().into_iter().map(|vertices| Triangle { cell, vertices }));
    }
    Ok(pieces)
}
