//! Table `[mesh]`: rectangles or a Gmsh file.

use super::quantities::{MERGE, SCALE};
use super::region::name;
use crate::element::{CellShape, ElementByShape, ElementKind};
use crate::error::{Error, Result};
use crate::scene::document::Document;
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::{Diagonal, Grid, MeshFile};

/// Limit on the rectangles of a mesh after refinement.
const MOST_RECTANGLES: u64 = 4_000_000;

pub(super) static MESH: TableKeys = TableKeys {
    groups: &[&[
        key(
            "element",
            ValueKind::Word(words::<ElementKind>),
            "finite element: quadrilaterals (fvs) or triangles (hct)",
        ),
        key("cells", ValueKind::Pair(&ValueKind::Count(1)), "numbers of rectangles along x and y"),
        key(
            "diagonal",
            ValueKind::Word(words::<Diagonal>),
            "with triangles: cut of each rectangle; default right, /",
        ),
        key("refine", ValueKind::Count(0), "number of uniform refinements; default 0"),
        key(
            "file",
            ValueKind::Text,
            "Gmsh mesh (2.2 or 4.1) in place of element, cells and the plate's sides",
        ),
        key(
            "scale",
            ValueKind::Number(&SCALE),
            "with file: factor from its coordinates to metres, 1e-3 for millimetres",
        ),
        key("merge", ValueKind::Number(&MERGE), "with file: distance in m below which nodes are merged"),
        key("parts", ValueKind::Count(1), "with file: number of disconnected parts; default 1"),
    ]],
    needed: &[],
    one_of: &[&["file"], &["element", "cells"]],
};

pub(super) fn read_file(doc: &Document) -> Result<Option<MeshFile>> {
    if doc.get("mesh.file").is_none() {
        return Ok(None);
    }
    let file = name(doc, "mesh.file", "expected the name of a Gmsh mesh")?;
    let path = doc.beside(&file);
    let scale = doc.optional_number("mesh.scale", &SCALE)?;
    let merge = doc.optional_number("mesh.merge", &MERGE)?;
    let parts = doc.optional_count("mesh.parts", "a number of parts that nothing connects", 1)?.unwrap_or(1);
    Ok(Some(MeshFile { file, path, scale, merge, parts: parts as usize }))
}

pub(super) fn read(doc: &Document, has_file: bool) -> Result<Grid> {
    doc.allow("mesh", &MESH)?;
    if !has_file {
        for key in ["mesh.scale", "mesh.merge", "mesh.parts"] {
            doc.forbid(key, "has no use without mesh.file")?;
        }
    }
    if has_file {
        let elements = ElementByShape::default();
        let [triangles, quadrangles] =
            [CellShape::Triangle, CellShape::Quadrilateral].map(|shape| elements.of(shape));
        let wrong = format!(
            "contradicts mesh.file: its triangles are \"{triangles}\" cells, its quadrangles \"{quadrangles}\""
        );
        for key in ["mesh.element", "mesh.cells", "mesh.diagonal"] {
            doc.forbid_with("mesh.file", key, &wrong)?;
        }
    }
    let element = if has_file {
        ElementByShape::default().of(CellShape::Triangle)
    } else {
        doc.choice("mesh.element")?
    };
    let cells = if has_file { [0, 0] } else { cells(doc, "mesh.cells")? };
    let diagonal = if has_file { None } else { diagonal(doc, element)? };
    let refine = doc.optional_count("mesh.refine", "a number of uniform refinements", 0)?.unwrap_or(0);
    let sized = if has_file { [1, 1] } else { cells };
    let refine = refinements(sized, refine).ok_or_else(|| too_many(doc, "mesh.refine", sized, refine))?;
    Ok(Grid { element, cells, diagonal, refine })
}

fn diagonal(doc: &Document, element: ElementKind) -> Result<Option<Diagonal>> {
    match element.shape() {
        CellShape::Triangle => Ok(Some(doc.optional_choice("mesh.diagonal")?.unwrap_or(Diagonal::Right))),
        CellShape::Quadrilateral => {
            let cuts = |element: &ElementKind| element.shape() == CellShape::Triangle;
            let those: Vec<String> =
                ElementKind::ALL.iter().filter(|of| cuts(of)).map(|of| format!("\"{of}\"")).collect();
            let wrong = format!(
                "contradicts mesh.element = \"{element}\", which cuts no rectangle; expected only with {}",
                those.join(" or ")
            );
            doc.forbid_with("mesh.element", "mesh.diagonal", wrong)?;
            Ok(None)
        }
    }
}

/// Reads the numbers of rectangles along x and y.
pub(super) fn cells(doc: &Document, key: &str) -> Result<[usize; 2]> {
    doc.pair(key, "expected [nx, ny], the numbers of rectangles along x and y")?;
    let nx = doc.count(&format!("{key}.0"), "a number of rectangles along x", 1)?;
    let ny = doc.count(&format!("{key}.1"), "a number of rectangles along y", 1)?;
    let cells = [nx as usize, ny as usize];
    refinements(cells, 0).map(|_| cells).ok_or_else(|| too_many(doc, key, cells, 0))
}

/// Returns the refinements as a number, if the refined mesh is not too large.
pub(super) fn refinements([nx, ny]: [usize; 2], refine: u64) -> Option<u32> {
    let refine = u32::try_from(refine).ok()?;
    let rectangles = (nx as u64).checked_mul(ny as u64)?.checked_mul(4_u64.checked_pow(refine)?)?;
    (rectangles <= MOST_RECTANGLES).then_some(refine)
}

/// Creates the error for a mesh that is too large.
pub(super) fn too_many(doc: &Document, key: &str, [nx, ny]: [usize; 2], refine: u64) -> Error {
    let refined = if refine == 0 { String::new() } else { format!(", refined {refine} times,") };
    let wrong = format!("{nx} x {ny} rectangles{refined} are too many");
    doc.fault(key, format!("{wrong}; expected at most {MOST_RECTANGLES} in all"))
}
