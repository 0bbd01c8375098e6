//! Unstructured grids in the XML format of VTK, with appended data that zlib compresses.

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use std::io::{self, Read, Write};

/// VTK's codes for triangles and quadrilaterals.
const TRIANGLE: u8 = 5;
const QUADRILATERAL: u8 = 9;

const HEADER: &str = "<?xml version=\"1.0\"?>\n";
const DIALECT: &str = "version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\" \
                                  compressor=\"vtkZLibDataCompressor\"";

/// Bits of the numbers of a grid.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Precision {
    /// 32 bits, seven digits.
    #[default]
    Single,
    /// 64 bits, which read back as the same numbers.
    Double,
}

impl Precision {
    /// Returns the name of the type of its numbers.
    pub fn kind(self) -> &'static str {
        match self {
            Precision::Single => "Float32",
            Precision::Double => "Float64",
        }
    }
}

/// Data array of a grid: name, type, number of components, bytes.
pub(super) struct Array {
    pub name: &'static str,
    pub kind: &'static str,
    pub components: usize,
    bytes: Vec<u8>,
}

impl Array {
    pub fn floats(
        name: &'static str,
        components: usize,
        precision: Precision,
        values: impl IntoIterator<Item = f64>,
    ) -> Array {
        let values = values.into_iter();
        let bytes = match precision {
            Precision::Single => values.flat_map(|value| (value as f32).to_le_bytes()).collect(),
            Precision::Double => values.flat_map(f64::to_le_bytes).collect(),
        };
        Array { name, kind: precision.kind(), components, bytes }
    }

    /// Returns what a list of pieces tells of the array.
    pub fn kind(&self) -> ArrayKind {
        (self.name, self.kind, self.components)
    }

    pub fn integers(name: &'static str, values: impl IntoIterator<Item = usize>) -> Array {
        let bytes = values.into_iter().flat_map(|value| (value as i64).to_le_bytes()).collect();
        Array { name, kind: "Int64", components: 1, bytes }
    }
}

/// Grid of triangles and quadrilaterals with its data.
#[derive(Default)]
pub(super) struct Grid<'g> {
    /// Time, in s.
    pub time: f64,
    /// Positions of the points, in m.
    pub points: &'g [[f64; 2]],
    /// Corners of each cell.
    pub cells: &'g [Vec<usize>],
    pub point_data: Vec<Array>,
    pub cell_data: Vec<Array>,
    /// Precision of the positions.
    pub precision: Precision,
    /// Points of balls, as [`Snapshot::balls`](crate::simulation::Snapshot::balls) has them.
    pub balls: Vec<[f64; 4]>,
}

impl Grid<'_> {
    /// Formats the file of the grid.
    pub fn file(self) -> Vec<u8> {
        let Grid { time, points, cells, point_data, cell_data, precision, balls } = self;
        let ends = cells.iter().scan(0, |end, cell| {
            *end += cell.len();
            Some(*end)
        });
        let shape = |cell: &Vec<usize>| if cell.len() == 3 { TRIANGLE } else { QUADRILATERAL };
        let types = cells.iter().map(shape).collect();
        let position = Array::floats("position", 3, precision, points.iter().flat_map(|&[x, y]| [x, y, 0.0]));
        let corners = vec![
            Array::integers("connectivity", cells.iter().flatten().copied()),
            Array::integers("offsets", ends),
            Array { name: "types", kind: "UInt8", components: 1, bytes: types },
        ];
        let of_mesh = [("Points", vec![position]), ("Cells", corners)];
        let sections = [("PointData", point_data), ("CellData", cell_data)].into_iter().chain(of_mesh);
        let (points, cells) = (points.len(), cells.len());
        let mut text = format!("{HEADER}<VTKFile type=\"UnstructuredGrid\" {DIALECT}>\n<UnstructuredGrid>\n");
        text += &format!(
            "<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">{time}</DataArray>"
        );
        if !balls.is_empty() {
            let (count, numbers) = (balls.len(), balls.as_flattened());
            let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
            text += &format!(
                "<DataArray type=\"Float64\" Name=\"balls\" NumberOfComponents=\"4\" NumberOfTuples=\"{count}\" format=\"ascii\">{}</DataArray>",
                numbers.join(" ")
            );
        }
        text += "</FieldData>\n";
        text += &format!("<Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{cells}\">\n");
        let mut appended = Vec::new();
        for (section, arrays) in sections {
            text += &format!("<{section}>\n");
            for Array { name, kind, components, bytes } in arrays {
                let offset = appended.len();
                text += &format!(
                    "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" offset=\"{offset}\"/>\n"
                );
                append(&bytes, &mut appended);
            }
            text += &format!("</{section}>\n");
        }
        text += "</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_";
        let mut file = text.into_bytes();
        file.extend(appended);
        file.extend(b"\n</AppendedData>\n</VTKFile>\n");
        file
    }
}

/// Appends an array as one compressed block: the number of blocks, the size of a block, 0 for the
/// rest of a block, the compressed size, and the compressed bytes.
fn append(bytes: &[u8], appended: &mut Vec<u8>) {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).expect("a vector takes everything");
    let packed = encoder.finish().expect("a vector takes everything");
    for number in [1, bytes.len(), 0, packed.len()] {
        appended.extend((number as u64).to_le_bytes());
    }
    appended.extend(packed);
}

/// Returns the bytes of an array from appended data, at its beginning.
///
/// # Errors
/// Returns an error for data that [`Grid::file`] does not write.
pub(super) fn unpacked(data: &[u8]) -> io::Result<Vec<u8>> {
    let cut = || io::Error::new(io::ErrorKind::UnexpectedEof, "cut short");
    let (head, rest) = data.split_at_checked(32).ok_or_else(cut)?;
    let [blocks, size, _, packed] = [0, 1, 2, 3].map(|i| u64::from_le_bytes(head.as_chunks().0[i]) as usize);
    let packed = rest.get(..packed).filter(|_| blocks == 1).ok_or_else(cut)?;
    let mut bytes = Vec::new();
    ZlibDecoder::new(packed).take(size as u64).read_to_end(&mut bytes)?;
    if bytes.len() == size { Ok(bytes) } else { Err(cut()) }
}

/// Name, type and number of components of a data array.
pub(super) type ArrayKind = (&'static str, &'static str, usize);

/// Formats the index of files in the run folder, each with its time.
pub(super) fn collection(files: impl Iterator<Item = (f64, String)>) -> String {
    let line = |(time, file)| format!("<DataSet timestep=\"{time}\" part=\"0\" file=\"{file}\"/>\n");
    let lines: String = files.map(line).collect();
    format!(
        "{HEADER}<VTKFile type=\"Collection\" {DIALECT}>\n<Collection>\n{lines}</Collection>\n</VTKFile>\n"
    )
}

/// Formats the file that lists the pieces of all ranks.
pub(super) fn parallel(
    pieces: &[String],
    [point_data, cell_data]: &[Vec<ArrayKind>; 2],
    precision: Precision,
) -> String {
    let mut text = format!(
        "{HEADER}<VTKFile type=\"PUnstructuredGrid\" {DIALECT}>\n<PUnstructuredGrid GhostLevel=\"0\">\n"
    );
    let sections = [
        ("PointData", &point_data[..]),
        ("CellData", cell_data),
        ("Points", &[("position", precision.kind(), 3)]),
    ];
    for (name, arrays) in sections {
        text += &format!("<P{name}>\n");
        for (name, kind, components) in arrays {
            text += &format!(
                "<PDataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\"/>\n"
            );
        }
        text += &format!("</P{name}>\n");
    }
    for piece in pieces {
        text += &format!("<Piece Source=\"{piece}\"/>\n");
    }
    text + "</PUnstructuredGrid>\n</VTKFile>\n"
}
