//! Assembly of cells into matrices and loads; this is the only loop over cells.
//!
//! Congruent cells (translates of one another) share one set of local arrays, so that a regular
//! mesh computes its element matrices only a few times.

use crate::dof_map::{DofMap, PER_NODE};
use crate::element::adaptive::{Rules, Triangle};
use crate::element::quadrature::{self, Node, Rule};
use crate::element::{Element, Piece, fvs, hct};
use crate::error::{Error, Result};
use crate::linalg::{BARE, Bending, ElementMatrix, SingularMassCell};
use crate::mesh::{Cell, Mesh, Point};
use crate::plate::{self, Section, Sections};
use nalgebra::{DVector, SMatrix, Vector3};
use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

/// Local arrays of a cell, shared by all cells congruent to it.
#[derive(Debug, Clone)]
pub struct Local {
    /// Stiffness K, n x n, row by row, in N/m between deflections.
    pub stiffness: Rc<[f64]>,
    /// Consistent mass M_r, n x n, row by row, in kg between deflections.
    pub mass: Rc<[f64]>,
    /// Integrals of the basis functions, n entries, in m^2 for deflections.
    pub moments: Rc<[f64]>,
    /// Row of B, the integrals of surface density times basis function, n entries, in kg for
    /// deflections.
    pub coupling: Rc<[f64]>,
    /// Entry of C, the mass of the cell, in kg.
    pub weight: f64,
    /// Stiffness K as the square of its root.
    pub bending: Rc<Bending>,
}

/// Local arrays of a cell, with its dofs in the numbering of a space.
#[derive(Debug, Clone)]
pub struct CellArrays {
    /// Free dof of each local dof; `None` where a support holds it at zero.
    pub dofs: Rc<[Option<usize>]>,
    /// Factor of each local dof's value relative to its free dof, where not all are 1 (at supports
    /// with oblique axes).
    pub factors: Option<Rc<[f64]>>,
    /// Number of the class of congruent cells.
    pub class: usize,
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
        let dot = |row: &[f64]| row.iter().zip(values).map(|(a, value)| a * value).sum();
        let product: Vec<f64> = matrix.chunks_exact(values.len()).map(dot).collect();
        self.add(&product, x);
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
/// Returns [`Error::Mesh`] naming a cell that cannot carry its element, and the errors of the
/// sections.
pub fn cells(mesh: &Mesh, space: &DofMap, sections: &impl Sections) -> Result<Vec<CellArrays>> {
    let extent = mesh.nodes.iter().fold(0.0, |m: f64, p| m.max(p.x.abs()).max(p.y.abs()));
    // Positions that differ by a few roundings of the largest coordinate count as equal.
    let grain = 16.0 * f64::EPSILON * extent;
    let mut classes: HashMap<Class, (usize, Rc<Local>)> = HashMap::new();
    let mut cells = Vec::with_capacity(mesh.cells.len());
    for (number, cell) in mesh.cells.iter().enumerate() {
        let nodes = cell.nodes();
        let origin = mesh.nodes[nodes[0]];
        let shape = nodes[1..]
            .iter()
            .flat_map(|&node| {
                let arm = mesh.nodes[node] - origin;
                [arm.x, arm.y].map(|a| (a / grain).round() as i64)
            })
            .collect();
        let factors = space.factors_of(nodes).map(Rc::from);
        let kind = match sections.kind(number) {
            Some(kind) if factors.is_none() => Ok(kind),
            _ => Err(number),
        };
        let count = classes.len();
        let (class, local) = match classes.entry((shape, kind)) {
            std::collections::hash_map::Entry::Occupied(known) => known.get().clone(),
            std::collections::hash_map::Entry::Vacant(new) => {
                let local = local_arrays(mesh, number, cell, sections)?;
                let class = if factors.is_some() { BARE + count } else { count };
                new.insert((class, Rc::new(local))).clone()
            }
        };
        cells.push(CellArrays { dofs: space.dofs_of(nodes).collect(), factors, class, local });
    }
    Ok(cells)
}

fn local_arrays(mesh: &Mesh, number: usize, cell: &Cell, sections: &impl Sections) -> Result<Local> {
    let named = |error: Error| Error::Mesh(format!("cell {number}: {error}"));
    match *cell {
        Cell::Triangle(nodes) => {
            let vertices = nodes.map(|node| mesh.nodes[node]);
            arrays(&hct::element(vertices).map_err(named)?, &vertices, number, sections)
        }
        Cell::Quadrilateral(nodes) => {
            let vertices = nodes.map(|node| mesh.nodes[node]);
            arrays(&fvs::element(vertices).map_err(named)?, &vertices, number, sections)
        }
    }
}

fn arrays<const N: usize>(
    element: &Element<N>,
    vertices: &[Point],
    number: usize,
    sections: &impl Sections,
) -> Result<Local> {
    let flat = |matrix: SMatrix<f64, N, N>| matrix.as_slice().into();
    let moments = plate::moments(element);
    let area: f64 = element.pieces.iter().map(Piece::area).sum();
    let first = sections.section(number, vertices[0])?;
    if sections.kind(number).is_some() {
        let energies = first.bending.diagonal() * area;
        return Ok(Local {
            // The matrix is symmetric, so that column by column is row by row.
            stiffness: flat(first.stiffness(element)),
            bending: bending(element, vertices, number, (&quadrature::DEGREE_2).into(), |_| first, energies)?,
            mass: flat(first.consistent_mass(element)),
            moments: moments.as_slice().into(),
            coupling: (moments * first.density).as_slice().into(),
            weight: first.density * area,
        });
    }
    let fault = RefCell::new(None);
    let section = |at: Point| {
        sections.section(number, at).unwrap_or_else(|error| {
            fault.replace(Some(error));
            first
        })
    };
    let density = |at: Point| section(at).density;
    let rule = sections.rules(number).map_or((&quadrature::DEGREE_6).into(), Rule::Own);
    let (mut weight, mut energies) = (0.0, Vector3::zeros());
    for (piece, of) in element.pieces.iter().enumerate() {
        for &(barycentric, share) in rule.of(piece) {
            let section = section(element.point(piece, barycentric));
            weight += share * of.area() * section.density;
            energies += share * of.area() * section.bending.diagonal();
        }
    }
    let stiffness = plate::stiffness(element, rule, section);
    let bending = bending(element, vertices, number, rule, section, energies);
    fault.take().map_or(Ok(()), Err)?;
    let local = Local {
        stiffness: flat(stiffness),
        bending: bending?,
        mass: flat(plate::mass_by(element, rule, density)),
        moments: moments.as_slice().into(),
        coupling: plate::load_by(element, rule, density).as_slice().into(),
        weight,
    };
    fault.into_inner().map_or(Ok(local), Err)
}

/// Largest relative error of the energy of a bent cell; beyond it, its stiffness is mostly
/// rounding.
const LOST: f64 = 1e-3;

/// Returns the stiffness of a cell as the square of its root, checked on the deflections x^2/2, xy
/// and y^2/2, which every cell contains; `energies` are twice their exact energies.
///
/// A cell of aspect ratio a is a^2 times stiffer across than along, and the soft direction suffers
/// from the rounding of the stiff one.
fn bending<const N: usize>(
    element: &Element<N>,
    vertices: &[Point],
    number: usize,
    rule: Rule,
    section: impl Fn(Point) -> Section,
    energies: Vector3<f64>,
) -> Result<Rc<Bending>> {
    let Some(root) = plate::stiffness_root(element, rule, section) else {
        let what = "its stiffness against bending is not positive definite";
        return Err(Error::Mesh(format!("cell {number}: {what}")));
    };
    let arms: Vec<[f64; 2]> = vertices[1..].iter().map(|v| (v - vertices[0]).into()).collect();
    let bent = |[x, y]: [f64; 2]| [[0.5 * x * x, x, 0.0], [x * y, y, x], [0.5 * y * y, 0.0, y]];
    let error = |shape: usize| {
        let dofs = DVector::from_iterator(N - 3, arms.iter().flat_map(|&arm| bent(arm)[shape]));
        ((&root * dofs).norm_squared() / energies[shape] - 1.0).abs()
    };
    if (0..3).map(error).fold(0.0, |a: f64, b| if a > b { a } else { b }) <= LOST {
        // The transpose, column by column, is the root row by row.
        return Ok(Rc::new(Bending { arms, root: root.transpose().as_slice().into() }));
    }
    let list: Vec<String> = vertices.iter().map(|p| format!("({}, {})", p.x, p.y)).collect();
    Err(Error::Mesh(format!(
        "cell {number} is too flat: its stiffness is lost to rounding; its vertices are {}",
        list.join(", ")
    )))
}

/// Returns the cells' contributions to the stiffness K.
pub fn stiffness(cells: &[CellArrays]) -> Vec<ElementMatrix> {
    cells.iter().map(|cell| cell.block(&cell.local.stiffness, Some(&cell.local.bending))).collect()
}

/// Returns the cells' contributions to the consistent mass M_r.
pub fn consistent_mass(cells: &[CellArrays]) -> Vec<ElementMatrix> {
    cells.iter().map(|cell| cell.block(&cell.local.mass, None)).collect()
}

/// Returns the rows of B and the entries of C of the singular mass.
pub fn singular_mass(cells: &[CellArrays]) -> Vec<SingularMassCell> {
    let average = |cell: &CellArrays| SingularMassCell {
        dofs: cell.dofs.clone(),
        row: cell.of_dofs(&cell.local.coupling),
        mass: cell.local.weight,
        class: cell.class,
    };
    cells.iter().map(average).collect()
}

/// Returns the load F of a uniform upward pressure, in Pa, over `dofs` free dofs, in N.
pub fn uniform_load(cells: &[CellArrays], dofs: usize, pressure: f64) -> Vec<f64> {
    let mut load = vec![0.0; dofs];
    for cell in cells {
        let local: Vec<f64> = cell.local.moments.iter().map(|moment| pressure * moment).collect();
        cell.add(&local, &mut load);
    }
    load
}

/// Returns the pieces of all cells, cell by cell.
///
/// # Errors
/// Returns [`Error::Mesh`] for a cell that cannot carry its element.
pub fn pieces(mesh: &Mesh) -> Result<Vec<Triangle>> {
    fn of<const N: usize>(cell: usize, element: &Element<N>, pieces: &mut Vec<Triangle>) {
        pieces.extend(element.pieces.iter().enumerate().map(|(piece, of)| Triangle {
            cell,
            piece,
            vertices: of.vertices.map(|vertex| element.origin + vertex.coords),
        }));
    }
    let mut pieces = Vec::new();
    for (number, cell) in mesh.cells.iter().enumerate() {
        match *cell {
            Cell::Triangle(nodes) => {
                of(number, &hct::element(nodes.map(|node| mesh.nodes[node]))?, &mut pieces);
            }
            Cell::Quadrilateral(nodes) => {
                of(number, &fvs::element(nodes.map(|node| mesh.nodes[node]))?, &mut pieces);
            }
        }
    }
    Ok(pieces)
}

/// Quadrature of a pressure that varies over the plate: its points in every cell, and the load that
/// their values make.
#[derive(Debug, Clone)]
pub struct Pressure {
    /// Mesh with nodes and cells only.
    mesh: Mesh,
    points: Vec<Point>,
    /// Arrays of each cell, the index of its first point, and the weights of its points, one per
    /// point and local dof.
    cells: Vec<(CellArrays, usize, Rc<[f64]>)>,
}

impl Pressure {
    /// Chooses the points of a rule of degree 6 on each piece of the cells, which is exact up to
    /// rounding for a pressure of degree 3.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a cell that cannot carry its element.
    pub fn new(mesh: &Mesh, cells: &[CellArrays]) -> Result<Pressure> {
        fn of<const N: usize>(element: &Element<N>, points: &mut Vec<Point>) -> Vec<f64> {
            let mut weights = Vec::new();
            for (number, piece) in element.pieces.iter().enumerate() {
                for (barycentric, weight) in quadrature::DEGREE_6 {
                    points.push(element.point(number, barycentric));
                    weights.extend((piece.values(barycentric) * (weight * piece.area())).iter());
                }
            }
            weights
        }
        let bare = Mesh { nodes: mesh.nodes.clone(), cells: mesh.cells.clone(), ..Mesh::default() };
        let mut pressure =
            Pressure { mesh: bare, points: Vec::new(), cells: Vec::with_capacity(cells.len()) };
        let mut known: HashMap<usize, Rc<[f64]>> = HashMap::new();
        for (arrays, cell) in cells.iter().zip(&mesh.cells) {
            let first = pressure.points.len();
            let weights = match *cell {
                Cell::Triangle(nodes) => {
                    of(&hct::element(nodes.map(|node| mesh.nodes[node]))?, &mut pressure.points)
                }
                Cell::Quadrilateral(nodes) => {
                    of(&fvs::element(nodes.map(|node| mesh.nodes[node]))?, &mut pressure.points)
                }
            };
            let weights = known.entry(arrays.class).or_insert_with(|| weights.into()).clone();
            pressure.cells.push((arrays.clone(), first, weights));
        }
        Ok(pressure)
    }

    /// Adds the load, in N, of a function that computes an upward pressure, in Pa, at points.
    ///
    /// # Errors
    /// Returns the errors of the pressure.
    pub fn load(
        &self,
        pressure: impl Fn(&[Point], &mut [f64]) -> Result<()>,
        load: &mut [f64],
    ) -> Result<()> {
        self.load_by(&Rules::new(), pressure, load)
    }

    /// Adds a load like [`Pressure::load`], with other quadrature rules on some cells.
    ///
    /// # Errors
    /// Returns the errors of [`Pressure::load`].
    pub fn load_by(
        &self,
        rules: &Rules,
        pressure: impl Fn(&[Point], &mut [f64]) -> Result<()>,
        load: &mut [f64],
    ) -> Result<()> {
        let mut values = vec![0.0; self.points.len()];
        pressure(&self.points, &mut values)?;
        let mut local = Vec::new();
        for (number, (cell, first, weights)) in self.cells.iter().enumerate() {
            if let Some(rules) = rules.get(&number) {
                cell.add(&self.by_own_rules(number, rules, &pressure)?, load);
                continue;
            }
            local.clear();
            local.resize(cell.dofs.len(), 0.0);
            for (weights, value) in weights.chunks_exact(local.len()).zip(&values[*first..]) {
                local.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * value);
            }
            cell.add(&local, load);
        }
        Ok(())
    }
}

impl Pressure {
    /// Returns the load on a cell by its own rules.
    fn by_own_rules(
        &self,
        number: usize,
        rules: &[Vec<Node>],
        pressure: &impl Fn(&[Point], &mut [f64]) -> Result<()>,
    ) -> Result<Vec<f64>> {
        fn of<const N: usize>(
            element: &Element<N>,
            rules: &[Vec<Node>],
            pressure: &impl Fn(&[Point], &mut [f64]) -> Result<()>,
        ) -> Result<Vec<f64>> {
            let mut local = nalgebra::SVector::<f64, N>::zeros();
            for (number, (piece, rule)) in element.pieces.iter().zip(rules).enumerate() {
                let points: Vec<Point> = rule.iter().map(|(at, _)| element.point(number, *at)).collect();
                let mut values = vec![0.0; points.len()];
                pressure(&points, &mut values)?;
                for ((barycentric, weight), value) in rule.iter().zip(values) {
                    local += piece.values(*barycentric) * (weight * piece.area() * value);
                }
            }
            Ok(local.as_slice().to_vec())
        }
        match self.mesh.cells[number] {
            Cell::Triangle(nodes) => {
                of(&hct::element(nodes.map(|node| self.mesh.nodes[node]))?, rules, pressure)
            }
            Cell::Quadrilateral(nodes) => {
                of(&fvs::element(nodes.map(|node| self.mesh.nodes[node]))?, rules, pressure)
            }
        }
    }
}

/// Returns the weight of the plate under gravity g, in m/s^2 downward, over `dofs` free dofs, in N.
pub fn weight(cells: &[CellArrays], dofs: usize, g: f64) -> Vec<f64> {
    let mut load = vec![0.0; dofs];
    for cell in cells {
        let local: Vec<f64> = cell.local.coupling.iter().map(|b| -g * b).collect();
        cell.add(&local, &mut load);
    }
    load
}

/// Returns the contributions of an elastic foundation to the stiffness, each with its cell.
///
/// `stiffness` is the foundation's stiffness, in N/m^3; cells where it is 0 have no contribution.
/// `rules` gives other quadrature rules for some cells.
///
/// # Errors
/// Returns [`Error::Mesh`] for a cell that cannot carry its element, and the errors of the
/// stiffness.
pub fn foundation(
    mesh: &Mesh,
    cells: &[CellArrays],
    stiffness: &dyn Fn(usize, Point) -> Result<f64>,
    rules: &Rules,
) -> Result<Vec<(usize, ElementMatrix)>> {
    let matrices = on_elements(mesh, stiffness, |number, element, value| {
        let rule = rules.get(&number).map_or((&quadrature::DEGREE_6).into(), |own| Rule::Own(own));
        match element {
            AnyElement::Triangle(element) => plate::mass_by(element, rule, value).as_slice().to_vec(),
            AnyElement::Quadrilateral(element) => plate::mass_by(element, rule, value).as_slice().to_vec(),
        }
    })?;
    let under =
        matrices.into_iter().enumerate().filter(|(_, matrix)| matrix.iter().any(|entry| *entry != 0.0));
    // Each block is a class of its own, numbered after those of the cells.
    let block = |(number, matrix): (usize, Vec<f64>)| {
        let class = BARE + cells.len() + number;
        (number, ElementMatrix { class, ..cells[number].block(&matrix.into(), None) })
    };
    Ok(under.map(block).collect())
}

/// Element of a cell.
enum AnyElement<'e> {
    Triangle(&'e Element<9>),
    Quadrilateral(&'e Element<12>),
}

/// Returns integrals over each cell, where `value` gives the integrand at a point of a cell.
fn on_elements(
    mesh: &Mesh,
    value: &dyn Fn(usize, Point) -> Result<f64>,
    integrate: impl Fn(usize, AnyElement, &dyn Fn(Point) -> f64) -> Vec<f64>,
) -> Result<Vec<Vec<f64>>> {
    let fault = RefCell::new(None);
    let integral = |(number, cell): (usize, &Cell)| {
        let value = |at: Point| {
            value(number, at).unwrap_or_else(|error| {
                fault.replace(Some(error));
                0.0
            })
        };
        Ok(match *cell {
            Cell::Triangle(nodes) => {
                let element = hct::element(nodes.map(|node| mesh.nodes[node]))?;
                integrate(number, AnyElement::Triangle(&element), &value)
            }
            Cell::Quadrilateral(nodes) => {
                let element = fvs::element(nodes.map(|node| mesh.nodes[node]))?;
                integrate(number, AnyElement::Quadrilateral(&element), &value)
            }
        })
    };
    let integrals = mesh.cells.iter().enumerate().map(integral).collect::<Result<_>>()?;
    fault.into_inner().map_or(Ok(integrals), Err)
}

/// Adds the forces K U over the free dofs, in N for deflections. U holds the values at all dofs of
/// the mesh, three per node, held ones included.
pub fn forces(mesh: &Mesh, cells: &[CellArrays], shape: &[f64], force: &mut [f64]) {
    for (cell, of) in cells.iter().zip(&mesh.cells) {
        cell.add(&cell.local.bending.product(&on_nodes(of, shape)), force);
    }
}

/// Returns U^T K U in N m and U^T M_r U in kg m^2 for a displacement U given as in [`forces`].
pub fn squares(mesh: &Mesh, cells: &[CellArrays], shape: &[f64]) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for (cell, of) in cells.iter().zip(&mesh.cells) {
        let values = on_nodes(of, shape);
        let dot = |row: &[f64]| row.iter().zip(&values).map(|(a, value)| a * value).sum::<f64>();
        let rows = cell.local.mass.chunks_exact(values.len());
        sums[0] += dot(&cell.local.bending.product(&values));
        sums[1] += rows.zip(&values).map(|(row, value)| value * dot(row)).sum::<f64>();
    }
    sums
}

/// Adds the momenta M_r V over the free dofs for velocities V given as in [`forces`].
pub fn consistent_momenta(mesh: &Mesh, cells: &[CellArrays], shape: &[f64], momentum: &mut [f64]) {
    for (cell, of) in cells.iter().zip(&mesh.cells) {
        cell.add_product(&cell.local.mass, &on_nodes(of, shape), momentum);
    }
}

/// Adds the momenta of the singular mass over the free dofs for velocities given as in [`forces`].
pub fn singular_momenta(mesh: &Mesh, cells: &[CellArrays], shape: &[f64], momentum: &mut [f64]) {
    for (cell, of) in cells.iter().zip(&mesh.cells) {
        let Local { coupling, weight, .. } = &*cell.local;
        let velocity = coupling.iter().zip(on_nodes(of, shape)).map(|(b, v)| b * v).sum::<f64>() / weight;
        let local: Vec<f64> = coupling.iter().map(|b| b * velocity).collect();
        cell.add(&local, momentum);
    }
}

/// Returns the entries at the dofs of a cell of a vector over all dofs of the mesh.
fn on_nodes(cell: &Cell, shape: &[f64]) -> Vec<f64> {
    cell.nodes().iter().flat_map(|&node| &shape[PER_NODE * node..][..PER_NODE]).copied().collect()
}

/// Deflection at a point, as a weighted sum of dofs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Probe {
    weights: Vec<(usize, f64)>,
}

/// Share of the cell's largest basis function at a point below which another counts as zero there:
/// the point is a node.
const ROUNDING: f64 = 1e-14;

impl Probe {
    /// Creates the deflection at a point of the mesh, over the free dofs of a space.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a point outside the mesh.
    pub fn new(mesh: &Mesh, space: &DofMap, point: Point) -> Result<Probe> {
        Ok(Probe::of_shape(mesh, point)?.within(space))
    }

    /// Creates the deflection at a point of the mesh over all deflections and slopes, three per
    /// node, held or not.
    ///
    /// # Errors
    /// Returns the errors of [`Probe::new`].
    pub fn of_shape(mesh: &Mesh, point: Point) -> Result<Probe> {
        let outside = || Error::Mesh(format!("the point ({}, {}) lies outside the plate", point.x, point.y));
        let cell = mesh.cells[mesh.locate(point).ok_or_else(outside)?];
        let values: Vec<f64> = match cell {
            Cell::Triangle(nodes) => {
                let element = hct::element(nodes.map(|node| mesh.nodes[node]))?;
                element.basis_at(point).value.iter().copied().collect()
            }
            Cell::Quadrilateral(nodes) => {
                let element = fvs::element(nodes.map(|node| mesh.nodes[node]))?;
                element.basis_at(point).value.iter().copied().collect()
            }
        };
        let zero = ROUNDING * values.iter().fold(0.0, |m: f64, value| m.max(value.abs()));
        let dofs = cell.nodes().iter().flat_map(|node| (0..PER_NODE).map(move |k| PER_NODE * node + k));
        Ok(Probe { weights: dofs.zip(values).filter(|(_, value)| value.abs() > zero).collect() })
    }

    /// Restricts a probe over all dofs of the mesh to the free dofs of a space.
    pub fn within(&self, space: &DofMap) -> Probe {
        let free = |&(of_shape, weight): &(usize, f64)| {
            let (dof, factor) = space.dof(of_shape)?;
            Some((dof, factor * weight))
        };
        Probe { weights: self.weights.iter().filter_map(free).collect() }
    }

    /// Creates the probe that multiplies each dof by a weight.
    pub fn from_weights(weights: &[f64]) -> Probe {
        let nonzero = weights.iter().copied().enumerate().filter(|(_, weight)| *weight != 0.0);
        Probe { weights: nonzero.collect() }
    }

    /// Adds a force at the point, in N, to a load.
    pub fn push(&self, force: f64, load: &mut [f64]) {
        for &(dof, weight) in &self.weights {
            load[dof] += force * weight;
        }
    }

    /// Returns the deflection, in m.
    pub fn deflection(&self, u: &[f64]) -> f64 {
        self.weights.iter().map(|&(dof, weight)| weight * u[dof]).sum()
    }

    /// Returns the dofs and their weights.
    pub fn weights(&self) -> &[(usize, f64)] {
        &self.weights
    }

    /// Adds one more dof with its weight to the probe.
    pub fn with(mut self, dof: usize, weight: f64) -> Probe {
        self.weights.push((dof, weight));
        self
    }

    /// Returns the form k w w^T of a spring of stiffness k at the point, in N/m, or of a consistent
    /// mass k, in kg.
    ///
    /// `class` must belong to this form alone and be at least [`BARE`] plus twice the number of
    /// cells; the classes below are taken.
    pub fn spring(&self, k: f64, class: usize) -> ElementMatrix {
        let entries = self.weights.iter().flat_map(|(_, a)| self.weights.iter().map(move |(_, b)| k * a * b));
        ElementMatrix { dofs: self.dofs(), matrix: entries.collect(), bending: None, class }
    }

    /// Returns one more row of B and entry of C, for the velocity of a mass of m kg at the point.
    pub fn rider(&self, m: f64, class: usize) -> SingularMassCell {
        SingularMassCell {
            dofs: self.dofs(),
            row: self.weights.iter().map(|(_, weight)| m * weight).collect(),
            mass: m,
            class,
        }
    }

    fn dofs(&self) -> Rc<[Option<usize>]> {
        self.weights.iter().map(|(dof, _)| Some(*dof)).collect()
    }
}
