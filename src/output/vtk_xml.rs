//! Unstructured grids in the XML format of VTK, with raw appended data.

/// VTK's codes for triangles and quadrilaterals.
const TRIANGLE: u8 = 5;
const QUADRILATERAL: u8 = 9;

pub(super) const HEADER: &str = "<?xml version=\"1.0\"?>\n";
pub(super) const DIALECT: &str = "version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\"";

/// Data array of a grid: name, type, number of components, bytes.
pub(super) struct Array {
    pub name: &'static str,
    pub kind: &'static str,
    pub components: usize,
    bytes: Vec<u8>,
}

impl Array {
    pub fn floats(name: &'static str, components: usize, values: impl IntoIterator<Item = f64>) -> Array {
        let bytes = values.into_iter().flat_map(f64::to_le_bytes).collect();
        Array { name, kind: "Float64", components, bytes }
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
pub(super) struct Grid<'g> {
    /// Time, in s.
    pub time: f64,
    /// Positions of the points, in m.
    pub points: &'g [[f64; 2]],
    /// Corners of each cell.
    pub cells: &'g [Vec<usize>],
    pub point_data: Vec<Array>,
    pub cell_data: Vec<Array>,
}

impl Grid<'_> {
    /// Formats the file of the grid.
    pub fn file(self) -> Vec<u8> {
        let Grid { time, points, cells, point_data, cell_data } = self;
        let ends = cells.iter().scan(0, |end, cell| {
            *end += cell.len();
            Some(*end)
        });
        let shape = |cell: &Vec<usize>| if cell.len() == 3 { TRIANGLE } else { QUADRILATERAL };
        let types = cells.iter().map(shape).collect();
        let sections = [
            ("PointData", point_data),
            ("CellData", cell_data),
            ("Points", vec![Array::floats("position", 3, points.iter().flat_map(|&[x, y]| [x, y, 0.0]))]),
            (
                "Cells",
                vec![
                    Array::integers("connectivity", cells.iter().flatten().copied()),
                    Array::integers("offsets", ends),
                    Array { name: "types", kind: "UInt8", components: 1, bytes: types },
                ],
            ),
        ];
        let (points, cells) = (points.len(), cells.len());
        let mut text = format!("{HEADER}<VTKFile type=\"UnstructuredGrid\" {DIALECT}>\n<UnstructuredGrid>\n");
        text += &format!(
            "<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">{time}</DataArray></FieldData>\n"
        );
        text += &format!("<Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{cells}\">\n");
        let mut appended = Vec::new();
        for (section, arrays) in sections {
            text += &format!("<{section}>\n");
            for Array { name, kind, components, bytes } in arrays {
                let offset = appended.len();
                text += &format!(
                    "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" offset=\"{offset}\"/>\n"
                );
                appended.extend((bytes.len() as u64).to_le_bytes());
                appended.extend(bytes);
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

/// Name, type and number of components of a data array.
pub(super) type ArrayKind = (&'static str, &'static str, usize);

/// Formats the file that lists the pieces of all ranks.
pub(super) fn parallel(pieces: &[String], [point_data, cell_data]: &[Vec<ArrayKind>; 2]) -> String {
    let mut text = format!(
        "{HEADER}<VTKFile type=\"PUnstructuredGrid\" {DIALECT}>\n<PUnstructuredGrid GhostLevel=\"0\">\n"
    );
    let sections =
        [("PointData", &point_data[..]), ("CellData", cell_data), ("Points", &[("position", "Float64", 3)])];
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
