//! `fields.pvd` and `fields/*.vtu`: snapshots of the plate for ParaView and VTK, and their reader.
//!
//! A snapshot is an unstructured grid of small triangles or quadrilaterals, flat at z = 0: warp it
//! by `displacement`. Numbers have 32 bits, or 64 where the scene asks for them, and are
//! compressed. Each of several ranks writes its own piece, and a `.pvtu` file lists them.
//!
//! | point data | meaning |
//! |---|---|
//! | `deflection` | w, in m |
//! | `slope` | w_x, w_y |
//! | `velocity` | time derivative of w, in m/s |
//! | `displacement` | (0, 0, w), in m |
//! | `gap` | distance to the nearest obstacle, in m; NaN where there is none |
//! | `floor` | height of the nearest obstacle below, in m; NaN without one |
//! | `ceiling` | height of the nearest obstacle above, in m; NaN without one |
//! | `reaction` | upward force of the obstacles on a node, in N; zero at other points |
//! | `moment` | recovered moments M_xx, M_yy, M_xy, in N m/m |
//! | `principal_moment` | their largest and least principal value, in N m/m |
//! | `stress_top` | stresses xx, yy, xy at the upper surface, in Pa |
//! | `von_mises` | von Mises stress, in Pa, the larger of both surfaces |
//!
//! | cell data | meaning |
//! |---|---|
//! | `mean_velocity` | mean velocity over the mesh's cell, in m/s |
//! | `cell` | number of the mesh's cell, on its rank |
//! | `rank` | rank that owns the cell, where there are several |
//! | `moment_raw` | moments of the element itself at the centre of the small cell, in N m/m |
//! | `von_mises_raw` | von Mises stress of these, in Pa |
//!
//! Moments and stresses exist where the scene asks for them (`output.stresses`); points on the
//! border of two parts of the plate then occur once per part.
//!
//! `gap` and `reaction` exist where the scene has obstacles, `floor` where it has some below, and
//! `ceiling` where it has some above.

use super::vtk_xml::{Array, ArrayKind, Grid, Precision, collection, parallel, unpacked};
use super::{if_there, remove, sweep, write_atomic};
use crate::error::{Error, Result};
use crate::hash::Extent;
use crate::input;
use crate::simulation::{Lattice, Snapshot};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Name of the index in the run folder.
pub const FILE: &str = "fields.pvd";
/// Folder of the snapshots in the run folder.
pub const FOLDER: &str = "fields";

/// Files of a snapshot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SnapshotFiles {
    /// Time, in s.
    pub time: f64,
    /// Names in the run folder, with what was written. The last file is that of the index.
    pub files: Vec<(String, Extent)>,
}

/// Writer of the snapshots of a run, one series per process.
#[derive(Debug)]
pub struct Series {
    folder: PathBuf,
    rank: usize,
    ranks: usize,
    precision: Precision,
    /// This rank's piece of the last snapshot, and its arrays at points and of cells.
    pub(super) last: Extent,
    arrays: [Vec<ArrayKind>; 2],
    /// Snapshots so far.
    pub(super) snapshots: Vec<SnapshotFiles>,
}

impl Series {
    /// Creates the series of a rank, whose numbers have 32 or 64 bits.
    pub fn new(folder: &Path, rank: usize, ranks: usize, bits: u32) -> Series {
        let (folder, last, arrays) = (folder.to_owned(), Extent::default(), Default::default());
        Series { folder, rank, ranks, precision: precision(bits), last, arrays, snapshots: Vec::new() }
    }

    /// Returns the rank and the number of ranks.
    pub fn place(&self) -> [usize; 2] {
        [self.rank, self.ranks]
    }

    /// Continues a series with these snapshots, and removes those after `step`.
    ///
    /// Only rank 0 calls this.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be removed.
    pub fn resume(&mut self, snapshots: Vec<SnapshotFiles>, step: u64) -> Result<()> {
        self.snapshots = snapshots;
        if self.snapshots.is_empty() {
            remove(&self.folder.join(FILE))?;
        } else {
            self.write_index()?;
        }
        for (number, path) in pieces(&self.folder)? {
            if number > step {
                remove(&path)?;
            }
        }
        Ok(())
    }

    /// Writes this rank's piece of a snapshot, whole or not at all.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where the file cannot be written.
    pub fn write(&mut self, snapshot: &Snapshot) -> Result<()> {
        let folder = self.folder.join(FOLDER);
        fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        let grid = grid(snapshot, (self.ranks > 1).then_some(self.rank), self.precision);
        self.arrays = [&grid.point_data, &grid.cell_data].map(|data| data.iter().map(Array::kind).collect());
        let bytes = grid.file();
        self.last = Extent::default();
        self.last.add(&bytes);
        write_atomic(&folder.join(self.piece(snapshot.step, self.rank)), &bytes)
    }

    /// Adds a snapshot to the index once all its pieces are written, given what each rank wrote;
    /// only rank 0 calls this.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where the index cannot be written.
    pub fn index(&mut self, step: u64, time: f64, written: &[Extent]) -> Result<()> {
        let pieces: Vec<String> = (0..self.ranks).map(|rank| self.piece(step, rank)).collect();
        let in_folder = |name: &String| format!("{FOLDER}/{name}");
        let mut files: Vec<_> = pieces.iter().map(in_folder).zip(written.iter().copied()).collect();
        if self.ranks > 1 {
            let name = in_folder(&format!("step-{step:09}.pvtu"));
            let list = parallel(&pieces, &self.arrays, self.precision);
            write_atomic(&self.folder.join(&name), list.as_bytes())?;
            let mut extent = Extent::default();
            extent.add(list.as_bytes());
            files.push((name, extent));
        }
        self.snapshots.push(SnapshotFiles { time, files });
        self.write_index()
    }

    fn write_index(&self) -> Result<()> {
        let file = |snapshot: &SnapshotFiles| Some((snapshot.time, snapshot.files.last()?.0.clone()));
        let index = collection(self.snapshots.iter().filter_map(file));
        write_atomic(&self.folder.join(FILE), index.as_bytes())
    }

    fn piece(&self, step: u64, rank: usize) -> String {
        if self.ranks == 1 { format!("step-{step:09}.vtu") } else { format!("step-{step:09}-{rank}.vtu") }
    }
}

/// Removes the snapshots of an earlier run.
///
/// # Errors
/// Returns [`Error::Io`] where a file cannot be removed.
pub fn clear(folder: &Path) -> Result<()> {
    remove(&folder.join(FILE))?;
    pieces(folder)?.iter().try_for_each(|(_, path)| remove(path))
}

/// Returns steps and files of all snapshots in a run folder, and removes temporary files.
fn pieces(folder: &Path) -> Result<Vec<(u64, PathBuf)>> {
    let folder = folder.join(FOLDER);
    sweep(&folder)?;
    let step = |name: &str| {
        let name = name.strip_suffix(".vtu").or(name.strip_suffix(".pvtu"))?.strip_prefix("step-")?;
        name.split('-').next()?.parse().ok()
    };
    Ok(input::files_of(&folder, step))
}

/// Quantity of a snapshot: its name, its number of components, and its numbers; `None` where the
/// run has none.
type Quantity = (&'static str, usize, fn(&Snapshot) -> Option<Vec<f64>>);

/// Quantities at the points.
const POINT_DATA: [Quantity; 14] = [
    ("deflection", 1, |snapshot| Some(snapshot.deflection.clone())),
    ("slope", 2, |snapshot| Some(snapshot.slope.concat())),
    ("velocity", 1, |snapshot| Some(snapshot.velocity.clone())),
    ("displacement", 3, |snapshot| Some(snapshot.deflection.iter().flat_map(|&w| [0.0, 0.0, w]).collect())),
    ("gap", 1, |snapshot| snapshot.gap.clone()),
    ("floor", 1, |snapshot| snapshot.obstacles[0].clone()),
    ("ceiling", 1, |snapshot| snapshot.obstacles[1].clone()),
    ("reaction", 1, |snapshot| snapshot.reaction.clone()),
    ("friction_moment", 2, |snapshot| {
        let [x, y, _] = snapshot.friction.as_ref()?;
        Some(x.iter().zip(y).flat_map(|(x, y)| [*x, *y]).collect())
    }),
    ("sliding", 1, |snapshot| Some(snapshot.friction.as_ref()?[2].clone())),
    ("moment", 3, |snapshot| Some(snapshot.stresses.as_ref()?.moment.concat())),
    ("principal_moment", 2, |snapshot| Some(snapshot.stresses.as_ref()?.principal.concat())),
    ("stress_top", 3, |snapshot| Some(snapshot.stresses.as_ref()?.stress_top.concat())),
    ("von_mises", 1, |snapshot| Some(snapshot.stresses.as_ref()?.von_mises.clone())),
];

/// Quantities of the small cells.
const CELL_DATA: [Quantity; 3] = [
    ("mean_velocity", 1, |snapshot| {
        Some(snapshot.lattice.parents.iter().map(|&cell| snapshot.mean_velocity[cell]).collect())
    }),
    ("moment_raw", 3, |snapshot| Some(snapshot.stresses.as_ref()?.moment_raw.concat())),
    ("von_mises_raw", 1, |snapshot| Some(snapshot.stresses.as_ref()?.von_mises_raw.clone())),
];

/// Returns the grid of a snapshot on a rank, if there are several.
fn grid<'s>(snapshot: &'s Snapshot, rank: Option<usize>, precision: Precision) -> Grid<'s> {
    let Lattice { points, cells, parents } = snapshot.lattice;
    let arrays = |quantities: &[Quantity]| -> Vec<Array> {
        let array = |&(name, components, values): &Quantity| {
            values(snapshot).map(|values| Array::floats(name, components, precision, values))
        };
        quantities.iter().filter_map(array).collect()
    };
    let mut cell_data = arrays(&CELL_DATA);
    cell_data.push(Array::integers("cell", parents.iter().copied()));
    cell_data.extend(rank.map(|rank| Array::integers("rank", parents.iter().map(|_| rank))));
    Grid {
        time: snapshot.time,
        points,
        cells,
        point_data: arrays(&POINT_DATA),
        cell_data,
        precision,
        balls: snapshot.balls.clone(),
    }
}

/// Returns the precision of numbers of 32 or 64 bits.
fn precision(bits: u32) -> Precision {
    if bits == 64 { Precision::Double } else { Precision::Single }
}

/// Returns the size of the file of a snapshot whose numbers have 32 or 64 bits, in bytes.
pub fn size(snapshot: &Snapshot, bits: u32) -> u64 {
    grid(snapshot, None, precision(bits)).file().len() as u64
}

/// Snapshot read back.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// Coordinates of the points, in m.
    pub points: Vec<[f64; 2]>,
    /// Corners of each small cell.
    pub cells: Vec<Vec<usize>>,
    /// Deflection at each point, in m.
    pub deflection: Vec<f64>,
    /// Upward force on each point, in N; empty without obstacles.
    pub reaction: Vec<f64>,
    /// Heights of the nearest obstacles below and above each point, in m.
    ///
    /// A height is NaN where there is no obstacle; without any on its side the array is empty.
    pub obstacles: [Vec<f64>; 2],
    /// Number of the mesh's cell that contains each small cell, unique among all ranks.
    pub parents: Vec<usize>,
    /// Von Mises stress at each point, in Pa; empty in a snapshot without stresses.
    pub von_mises: Vec<f64>,
    /// Points of balls, as [`Snapshot::balls`] has them.
    pub balls: Vec<[f64; 4]>,
}

/// Returns the sides of some cells, given by the numbers of their corners, that belong to one of
/// the cells only, ordered by their first corners.
pub fn boundary<'c, N: Copy + Ord + 'c>(cells: impl IntoIterator<Item = &'c Vec<N>>) -> Vec<[N; 2]> {
    let mut sides: BTreeMap<[N; 2], usize> = BTreeMap::new();
    for face in cells {
        for (i, &a) in face.iter().enumerate() {
            let b = face[(i + 1) % face.len()];
            *sides.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    sides.into_iter().filter(|(_, cells)| *cells == 1).map(|(side, _)| side).collect()
}

impl Surface {
    /// Returns the boundary of the plate as pairs of points, in m.
    pub fn outline(&self) -> Vec<[[f64; 2]; 2]> {
        boundary(&self.cells).into_iter().map(|side| side.map(|point| self.points[point])).collect()
    }

    /// Returns the cells that face an obstacle below (side 0) or above (side 1) with all corners,
    /// and the other points that face one: stops at single points and along lines.
    pub fn wall(&self, side: usize) -> (Vec<&Vec<usize>>, Vec<usize>) {
        let heights = &self.obstacles[side];
        let is_wall = |point: &usize| heights.get(*point).is_some_and(|height| height.is_finite());
        let faces: Vec<&Vec<usize>> = self.cells.iter().filter(|cell| cell.iter().all(is_wall)).collect();
        let mut is_met = vec![false; self.points.len()];
        faces.iter().copied().flatten().for_each(|&point| is_met[point] = true);
        let stops = (0..heights.len()).filter(|point| is_wall(point) && !is_met[*point]).collect();
        (faces, stops)
    }
}

/// Largest deflection of a point of an edge that is held, relative to the largest one: values
/// between the nodes are interpolated, and rounded.
const HELD: f64 = 1e-12;

/// Returns whether each point stays at zero in all snapshots, given their deflections, while others
/// move.
pub fn held_points<'d>(snapshots: impl Iterator<Item = &'d [f64]> + Clone) -> Vec<bool> {
    let largest = snapshots.clone().flatten().fold(0.0, |most: f64, w| most.max(w.abs()));
    let mut held = vec![largest > 0.0; snapshots.clone().next().map_or(0, <[f64]>::len)];
    for deflection in snapshots {
        for (point, held) in held.iter_mut().enumerate() {
            *held &= deflection.get(point).is_some_and(|w| w.abs() <= HELD * largest);
        }
    }
    held
}

/// Returns times (in s) and files of the snapshots in a run folder; none where it has no index.
///
/// # Errors
/// Returns [`Error::Io`] where the index cannot be read.
pub fn read_index(folder: &Path) -> Result<Vec<(f64, PathBuf)>> {
    let path = folder.join(FILE);
    let Some(text) = if_there(&path, fs::read_to_string(&path))? else { return Ok(Vec::new()) };
    let entry =
        |tag: &str| Some((attribute(tag, "timestep")?.parse().ok()?, folder.join(attribute(tag, "file")?)));
    let wrong = || Error::invalid(&path, "a DataSet without time or file");
    tags(&text, "DataSet").into_iter().map(|tag| entry(tag).ok_or_else(wrong)).collect()
}

/// Reads a snapshot or an envelope that this program wrote: a `.vtu`, or the pieces of a `.pvtu`.
///
/// # Errors
/// Returns [`Error::Io`] where a file cannot be read or has another format.
pub fn read(path: &Path) -> Result<Surface> {
    let bytes = fs::read(path).map_err(Error::io(path))?;
    if path.extension().is_some_and(|extension| extension == "pvtu") {
        let text = String::from_utf8_lossy(&bytes);
        let mut sum = Surface::default();
        for piece in tags(&text, "Piece").into_iter().filter_map(|tag| attribute(tag, "Source")) {
            let Surface { points, cells, deflection, reaction, obstacles, parents, von_mises, balls } =
                read(&path.with_file_name(piece))?;
            let before = sum.points.len();
            let parents_before = sum.parents.iter().max().map_or(0, |last| last + 1);
            sum.parents.extend(parents.into_iter().map(|parent| parent + parents_before));
            sum.obstacles.iter_mut().zip(obstacles).for_each(|(faces, piece)| faces.extend(piece));
            sum.cells.extend(cells.into_iter().map(|cell| cell.iter().map(|point| point + before).collect()));
            sum.points.extend(points);
            sum.deflection.extend(deflection);
            sum.reaction.extend(reaction);
            sum.von_mises.extend(von_mises);
            sum.balls = balls;
        }
        return Ok(sum);
    }
    piece(&bytes).map_err(|what| Error::invalid(path, what))
}

fn piece(bytes: &[u8]) -> std::result::Result<Surface, &'static str> {
    const START: &[u8] = b"<AppendedData encoding=\"raw\">\n_";
    let split =
        bytes.windows(START.len()).position(|window| window == START).ok_or("no raw appended data")?;
    let text = std::str::from_utf8(&bytes[..split]).map_err(|_| "not text before its data")?;
    let data = &bytes[split + START.len()..];
    // Bytes of an array, and of each of its numbers.
    let array = |name: &str| -> std::result::Result<Option<(Vec<u8>, bool)>, &'static str> {
        let Some(tag) = tags(text, "DataArray").into_iter().find(|tag| attribute(tag, "Name") == Some(name))
        else {
            return Ok(None);
        };
        let offset =
            attribute(tag, "offset").and_then(|offset| offset.parse::<usize>().ok()).ok_or("no offset")?;
        let bytes = data.get(offset..).and_then(|data| unpacked(data).ok()).ok_or("cut short")?;
        Ok(Some((bytes, attribute(tag, "type") == Some("Float32"))))
    };
    let floats = |name| {
        let numbers = |(bytes, is_single): (Vec<u8>, bool)| -> Vec<f64> {
            match is_single {
                true => bytes.as_chunks().0.iter().map(|value| f32::from_le_bytes(*value).into()).collect(),
                false => bytes.as_chunks().0.iter().map(|value| f64::from_le_bytes(*value)).collect(),
            }
        };
        Ok::<_, &'static str>(array(name)?.map(numbers))
    };
    let integers = |name| {
        let (bytes, _) = array(name)?.ok_or("no cells")?;
        let numbers = bytes.as_chunks().0.iter().map(|value| i64::from_le_bytes(*value) as usize);
        Ok::<_, &'static str>(numbers.collect::<Vec<usize>>())
    };
    let (corners, ends) = (integers("connectivity")?, integers("offsets")?);
    let begins = std::iter::once(0).chain(ends.iter().copied());
    let cells = begins.zip(&ends).map(|(begin, &end)| corners.get(begin..end).map(<[usize]>::to_vec));
    let position: Vec<f64> = floats("position")?.ok_or("no points")?;
    let von_mises = floats("von_mises")?.unwrap_or_default();
    let cells: Vec<Vec<usize>> = cells.collect::<Option<_>>().ok_or("cells that do not fit")?;
    // The envelope of the stress lies flat, on the cells of the mesh themselves.
    let is_envelope = array("deflection")?.is_none() && !von_mises.is_empty();
    let flat = || is_envelope.then(|| vec![0.0; von_mises.len()]);
    let surface = Surface {
        points: position.chunks_exact(3).map(|p| [p[0], p[1]]).collect(),
        deflection: floats("deflection")?.or_else(flat).ok_or("no deflection")?,
        reaction: floats("reaction")?.unwrap_or_default(),
        obstacles: [floats("floor")?.unwrap_or_default(), floats("ceiling")?.unwrap_or_default()],
        parents: if is_envelope { (0..cells.len()).collect() } else { integers("cell")? },
        von_mises,
        cells,
        balls: balls(text),
    };
    let points = surface.points.len();
    let [floor, ceiling] = &surface.obstacles;
    let of_points = [&surface.reaction, floor, ceiling, &surface.von_mises];
    let fits = surface.deflection.len() == points
        && of_points.iter().all(|values| values.is_empty() || values.len() == points)
        && surface.parents.len() == surface.cells.len()
        && corners.iter().all(|&corner| corner < points);
    fits.then_some(surface).ok_or("arrays that do not fit")
}

/// Returns the points of balls in the head of a snapshot.
fn balls(text: &str) -> Vec<[f64; 4]> {
    let array = text.split("Name=\"balls\"").nth(1).and_then(|rest| rest.split('>').nth(1));
    let numbers = array.into_iter().flat_map(|array| array.trim_end_matches("</DataArray").split(' '));
    let numbers: Vec<f64> = numbers.filter_map(|number| number.parse().ok()).collect();
    numbers.as_chunks().0.to_vec()
}

/// Returns the attributes of all tags of a name, one text for each tag.
fn tags<'t>(text: &'t str, name: &str) -> Vec<&'t str> {
    text.split(&format!("<{name}")).skip(1).filter_map(|rest| rest.split('>').next()).collect()
}

fn attribute<'t>(tag: &'t str, name: &str) -> Option<&'t str> {
    let start = format!(" {name}=\"");
    let offset = tag.find(&start)? + start.len();
    tag[offset..].split('"').next()
}

#[cfg(test)]
mod tests {
    use super::held_points;

    #[test]
    fn points_are_held_to_rounding() {
        let snapshots = [vec![0.0, -0.0, 1e-19, 1e-3, 0.0], vec![0.0, 2e-18, -1e-19, 0.0, 1e-9]];
        let held = held_points(snapshots.iter().map(Vec::as_slice));
        assert_eq!(held, [true, true, true, false, false]);
        let at_rest = [vec![0.0; 3]];
        assert_eq!(held_points(at_rest.iter().map(Vec::as_slice)), [false; 3], "nothing moves");
        assert_eq!(held_points([].into_iter()), Vec::<bool>::new());
    }
}
