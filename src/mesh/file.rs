//! Meshes from files of every format.

use std::path::Path;

use super::contents::{Contents, Import};
use super::cursor::Cursor;
use super::{Mesh, abaqus, gmsh, nastran};
use crate::error::Result;
use crate::input;

/// Reader of a format.
type Read = fn(Cursor) -> Result<Contents>;

/// Endings of file names with their format; all other files are Gmsh's.
const FORMATS: [(&str, Read); 4] =
    [("inp", abaqus::read), ("bdf", nastran::read), ("nas", nastran::read), ("dat", nastran::read)];

/// Returns the reader of the format that the ending of a file name tells, other than Gmsh's.
fn format_of(file_name: &str) -> Option<Read> {
    FORMATS.iter().find(|(ending, _)| ends_in(file_name, ending)).map(|(_, read)| *read)
}

fn ends_in(file_name: &str, ending: &str) -> bool {
    Path::new(file_name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

impl Mesh {
    /// Returns whether a file is a mesh by its name.
    pub fn is_named(file_name: &str) -> bool {
        format_of(file_name).is_some() || ends_in(file_name, "msh")
    }

    /// Reads a mesh of Abaqus or CalculiX (`.inp`), of Nastran (`.bdf`, `.nas`, `.dat`), or of Gmsh
    /// (all other names): MSH 2.0 to 2.2 or 4.1, text or binary.
    ///
    /// From Gmsh:
    ///
    /// - Triangles and quadrangles become cells, in the order of the file; clockwise ones are
    ///   reversed. Nodes keep their order; those that no cell uses are dropped. A repeated cell, as
    ///   2.2 writes it for each of its groups, counts once.
    /// - Physical curves become named [`edges`](Mesh::edges), physical surfaces
    ///   [`groups`](Mesh::groups) of cells, and physical points named [`points`](Mesh::points). One
    ///   without a name is called by its number (`"7"`); those of one name and kind are united. A
    ///   boundary edge has its cell on the left. A curve in no physical group is an edge that is
    ///   called by its own number, unless a group is.
    /// - Curved boundaries become the straight edges between their nodes. Lengths are in m.
    /// - Whole and partitioned files give the same mesh. Parametric coordinates, periodicity,
    ///   post-processing data and sections of other programs are ignored.
    ///
    /// From the others, element sets and property numbers (`pid_7`) are groups of cells. Element
    /// sets of lines, and node sets that consist of whole sides of the boundary, are named edges;
    /// other node sets are named points. What else the file says is counted in
    /// [`notes`](Mesh::notes).
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] for a file that cannot be read. Returns [`crate::Error::Mesh`],
    /// with the line or the offset where there is one, for
    ///
    /// - a file that does not follow the format, or another version of it;
    /// - elements of higher order or volumes, or no cell at all;
    /// - nodes that do not lie in one plane, which need not be one of constant z;
    /// - a physical group that contains nothing, or no edge or node of a cell;
    /// - nodes of one cell that would be merged;
    /// - a mesh that [`Mesh::check`] refuses.
    pub fn load(path: impl AsRef<Path>, import: Import) -> Result<Mesh> {
        let path = path.as_ref();
        // Only the available memory limits the size of the file.
        let bytes = input::read(path, u64::MAX)?;
        Mesh::from_bytes(&bytes, &path.display().to_string(), import)
    }

    /// Reads a mesh like [`Mesh::load`], from the bytes of a file. Any bytes give either a valid
    /// mesh or [`crate::Error::Mesh`].
    pub fn from_bytes(bytes: &[u8], file_name: &str, import: Import) -> Result<Mesh> {
        let format = format_of(file_name).filter(|_| !bytes.starts_with(b"$MeshFormat"));
        format.unwrap_or(gmsh::read)(Cursor::new(file_name, bytes))?.mesh(import)
    }
}
