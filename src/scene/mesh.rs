//! Table `[mesh]`: rectangles or a file.

use super::document::{Document, join};
use super::entry::{self, Entry, Kind, flat, flat_if, section, table, via};
use super::kinds::{count, name, of_text, positive, string, truth, word};
use crate::element::{CellShape, ElementByShape, ElementKind};
use crate::error::Result;
use crate::mesh::{Diagonal, Import, Mesh};
use serde::{Deserialize, Serialize};

/// Limit on the rectangles of a mesh after refinement.
const MOST_RECTANGLES: u64 = 4_000_000;

table! {
    /// Table `[mesh]`.
    pub(super) struct MeshTable {
        /// File, if there is one.
        file: Option<MeshFile> = flat_if();
        /// Discretisation.
        grid: Grid = flat();
    }
}

table! {
    /// Mesh from a file.
    #[derive(Debug, Clone, PartialEq)]
    pub struct MeshFile {
        /// Mesh of Gmsh in format 4.1, or 2.0 to 2.2, text or binary; of Abaqus or CalculiX
        /// (`.inp`); of Nastran (`.bdf`, `.nas`, `.dat`). In place of `element`, `cells`,
        /// `diagonal` and the plate's sides.
        file: String,
        /// Path where the file was found.
        path: String = file_name();
        /// With `file`: factor from its coordinates to metres, by default 1, such as 1e-3 for
        /// millimetres; greater than 0.
        scale: Option<f64> = positive("a factor that makes coordinates metres", "")
            .says("makes its coordinates metres").optional();
        /// With `file`: distance, after scaling, below which nodes are merged; less than the
        /// shortest side of a cell. Without this key none are.
        merge: Option<f64> = positive("a distance", "m")
            .says("m, nodes nearer to each other become one").optional();
        /// With `file`: `true` where the plate is slit, so that edges may lie on each other without
        /// common nodes; by default that is an error.
        slits: bool = truth().says("edges may lie on each other").or_silent(false);
        /// With `file`: number of disconnected parts of the mesh.
        parts: usize = count("a number of parts that nothing connects", 1)
            .says("that nothing connects").or_silent(1);
    }
}

table! {
    /// Grid of rectangles that carries the elements.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    pub struct Grid {
        /// Finite element; in a mesh from a file each cell has its own.
        element: ElementKind,
        /// Numbers of rectangles along x and y before refinement; zeros where a file gives the
        /// mesh.
        cells: [usize; 2] = via(rectangles, rectangle_keys);
        /// With `"hct"`: `"right"` (rising), `"left"` (falling) or `"alternating"` cut of each
        /// rectangle into two triangles, by default `"right"`.
        diagonal [serde(skip_serializing_if = "Option::is_none")]: Option<Diagonal> = word().optional();
        /// Number of uniform refinements, each of which cuts a cell in four; the refined mesh has
        /// at most 4 million rectangles.
        refine: u32 = count(REFINEMENTS, 0).says("uniform refinements after that").or(0);
    } then sized
}

/// Meaning of `refine`, in words.
pub(super) const REFINEMENTS: &str = "a number of uniform refinements";

impl MeshFile {
    /// Reads the mesh.
    ///
    /// # Errors
    /// Returns the errors of [`Mesh::load`], and [`crate::Error::Mesh`] where the number of
    /// parts differs from the scene's.
    pub fn load(&self) -> Result<Mesh> {
        let import =
            Import { scale: self.scale.unwrap_or(1.0), merge: self.merge.unwrap_or(0.0), slits: self.slits };
        let mut mesh = Mesh::load(&self.path, import)?;
        mesh.name_rims();
        mesh.require_parts(self.parts)?;
        Ok(mesh)
    }
}

impl Grid {
    /// Returns whether a file gives the mesh before refinement.
    pub fn is_of_file(&self) -> bool {
        self.cells == [0, 0]
    }

    /// Returns a mesh of the same kind with other cells.
    pub fn with(&self, element: ElementKind, cells: [usize; 2], refine: u32) -> Grid {
        let diagonal = (element.shape() == CellShape::Triangle && cells != [0, 0])
            .then(|| self.diagonal.unwrap_or_default());
        Grid { element, cells, diagonal, refine }
    }
}

/// Returns the entry of the table `[mesh]`.
pub(super) fn mesh() -> Entry<(Grid, Option<MeshFile>)> {
    Entry::new(
        |name, help, keys| (section::<MeshTable>().describe)(name, help, keys),
        |doc, _, name| entry::read(doc, name).map(|MeshTable { file, grid }| (grid, file)),
        |name, (grid, file), lines| {
            (section().write)(name, &MeshTable { file: file.clone(), grid: *grid }, lines);
        },
    )
}

/// Name of the mesh file, and the path where it was found.
fn file_name() -> Kind<(String, String)> {
    let file = name("expected the name of a mesh file");
    let read = move |doc: &Document, key: &str| {
        let file = doc.required(key, &file)?;
        let path = doc.beside(&file);
        Ok((file, path))
    };
    Kind::new("", of_text, read, |(file, path), by_path| string(if by_path { path } else { file }))
}

table! {
    /// Keys of rectangles.
    struct RectangleKeys {
        /// `"fvs"`: reduced Fraeijs de Veubeke-Sander quadrilaterals; `"hct"`: reduced
        /// Hsieh-Clough-Tocher triangles. Needed without `file`.
        element: Option<ElementKind> = word().optional();
        /// `[nx, ny]`, the numbers of rectangles along x and y; each rectangle is one quadrilateral
        /// or two triangles. Needed without `file`.
        cells: Option<[usize; 2]> = counts().optional();
    } one_of {file} {element, cells}
}

/// Returns the element and the numbers of rectangles, zeros where a file gives the mesh.
fn rectangles(_: RectangleKeys, doc: &Document, table: &str) -> Result<(ElementKind, [usize; 2])> {
    let (element, cells) = (join(table, "element"), join(table, "cells"));
    if doc.get("mesh.file").is_none() {
        return Ok((doc.required(&element, &word())?, doc.required(&cells, &counts())?));
    }
    let elements = ElementByShape::default();
    let [triangles, quadrangles] =
        [CellShape::Triangle, CellShape::Quadrilateral].map(|shape| elements.of(shape));
    let wrong = format!(
        "contradicts mesh.file: its triangles are \"{triangles}\" cells, its quadrangles \"{quadrangles}\""
    );
    for key in [element, cells, join(table, "diagonal")] {
        doc.forbid_with("mesh.file", &key, &wrong)?;
    }
    Ok((triangles, [0, 0]))
}

fn rectangle_keys((element, cells): &(ElementKind, [usize; 2])) -> RectangleKeys {
    let is_given = *cells != [0, 0];
    RectangleKeys { element: is_given.then_some(*element), cells: is_given.then_some(*cells) }
}

/// Sets the default cut of triangles, and refuses a mesh that is too large.
fn sized(grid: Grid, doc: &Document, table: &str) -> Result<Grid> {
    let Grid { element, cells, refine, .. } = grid;
    if !grid.is_of_file() && element.shape() == CellShape::Quadrilateral {
        let cuts = |element: &&ElementKind| element.shape() == CellShape::Triangle;
        let others: Vec<String> =
            ElementKind::ALL.iter().filter(cuts).map(|other| format!("\"{other}\"")).collect();
        let wrong = format!("contradicts mesh.element = \"{element}\", which cuts no rectangle");
        let wrong = format!("{wrong}; expected only with {}", others.join(" or "));
        doc.forbid_with("mesh.element", &join(table, "diagonal"), wrong)?;
    }
    fits(doc, &join(table, "refine"), cells, refine)?;
    Ok(grid.with(element, cells, refine))
}

/// Returns the mesh of a scene.
pub(super) fn grid(doc: &Document) -> Result<Grid> {
    Ok(entry::read::<MeshTable>(doc, "mesh")?.grid)
}

/// Numbers of rectangles along x and y.
pub(super) fn counts() -> Kind<[usize; 2]> {
    let expected = "expected [nx, ny], the numbers of rectangles along x and y";
    let axes = ["a number of rectangles along x", "a number of rectangles along y"];
    let read = move |doc: &Document, key: &str| {
        let [nx, ny] = axes.map(|what| count(what, 1));
        let cells = doc.pair(key, [&nx, &ny], expected)?;
        fits(doc, key, cells, 0).map(|()| cells)
    };
    let kind = count(axes[0], 1).pair(expected).says("rectangles along x and y");
    Kind { read: Box::new(read), ..kind }
}

/// Refuses a mesh that is too large once it is refined; the cells of a file count as one.
pub(super) fn fits(doc: &Document, key: &str, cells: [usize; 2], refine: u32) -> Result<()> {
    let [nx, ny] = cells.map(|count| count.max(1));
    let rectangles = (nx as u64).checked_mul(ny as u64).zip(4_u64.checked_pow(refine));
    let rectangles = rectangles.and_then(|(coarse, times)| coarse.checked_mul(times));
    if rectangles.is_some_and(|rectangles| rectangles <= MOST_RECTANGLES) {
        return Ok(());
    }
    // The message repeats a number beyond the type as it is written.
    let times = doc.figure(key).unwrap_or(f64::from(refine));
    let refined = if refine == 0 { String::new() } else { format!(", refined {times} times,") };
    let wrong = format!("{nx} x {ny} rectangles{refined} are too many");
    Err(doc.fault(key, format!("{wrong}; expected at most {MOST_RECTANGLES} in all")))
}
