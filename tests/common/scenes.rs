//! Scenes for tests, written as a user writes them and run in this process.

use rebond::scene::Scene;
use rebond::simulation::{self, Model, Observer, Outcome, Row};
use rebond::study::{self, Inspection};
use rebond::{Error, Result};
use std::fmt::Write;
use std::path::PathBuf;

/// Returns supports on all edges of a rectangle.
pub fn all_round(kind: &str) -> String {
    let support = |edge| format!("{{ edge = \"{edge}\", kind = \"{kind}\" }}");
    format!("support = [{}]\n", ["left", "right", "bottom", "top"].map(support).join(", "))
}

pub fn grid(element: &str, nx: usize, ny: usize) -> String {
    format!("mesh = {{ element = \"{element}\", cells = [{nx}, {ny}] }}\n")
}

/// Time table for tests of statics, which do not depend on it.
pub const STILL: &str = "time = { scheme = \"newmark\", mass = \"singular\", step = 1e-3, end = 1e-3 }\n";

pub fn newmark(mass: &str, step: f64, end: f64) -> String {
    format!("time = {{ scheme = \"newmark\", mass = \"{mass}\", step = {step:?}, end = {end:?} }}\n")
}

pub fn read(text: &str) -> Result<Scene> {
    // Files that the scene names are sought in the folder of this path.
    Scene::from_str(text, concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/scene.toml"), &[])
}

#[track_caller]
pub fn scene(text: &str) -> Scene {
    read(text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[track_caller]
pub fn model(text: &str) -> Model {
    Model::new(&scene(text)).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[track_caller]
pub fn inspect(text: &str) -> Inspection {
    study::inspect(&scene(text)).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// Returns the error of reading a scene or of building its model.
#[track_caller]
pub fn refusal(text: &str) -> Error {
    match read(text).and_then(|scene| Model::new(&scene)) {
        Err(error) => error,
        Ok(_) => panic!("accepted:\n{text}"),
    }
}

/// Returns the initial deflections at the probes.
#[track_caller]
pub fn start(text: &str) -> Vec<f64> {
    run(text)[0].probes.clone()
}

/// Probes and energies at one instant of a run.
#[derive(Debug, Clone)]
pub struct Instant {
    pub time: f64,
    pub energy: f64,
    pub kinetic: f64,
    pub elastic: f64,
    pub contact_force: f64,
    pub probes: Vec<f64>,
}

#[derive(Default)]
struct Rows(Vec<Instant>);

impl Observer for Rows {
    fn row(&mut self, row: &Row) -> Result<()> {
        let Row { time, energy, kinetic, elastic, contact_force, probes, .. } = *row;
        self.0.push(Instant { time, energy, kinetic, elastic, contact_force, probes: probes.to_vec() });
        Ok(())
    }
}

#[track_caller]
pub fn run(text: &str) -> Vec<Instant> {
    run_to_end(text).0
}

#[track_caller]
pub fn run_to_end(text: &str) -> (Vec<Instant>, Outcome) {
    let (rows, outcome, ended) = run_until_it_ends(text);
    ended.unwrap_or_else(|error| panic!("{error}\n{text}"));
    (rows, outcome)
}

/// Returns rows and outcome of a run, and the error that ended it, if any.
#[track_caller]
pub fn run_until_it_ends(text: &str) -> (Vec<Instant>, Outcome, Result<()>) {
    let scene = scene(text);
    let model = Model::new(&scene).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let mut rows = Rows::default();
    let ran = simulation::run(&scene, &model, &simulation::condensed, &mut rows);
    let (outcome, ended) = ran.unwrap_or_else(|error| panic!("{error}\n{text}"));
    (rows.0, outcome, ended)
}

/// Returns the largest difference, over all rows, of the first probe's deflection from a function
/// of time.
pub fn off(rows: &[Instant], expected: impl Fn(f64) -> f64) -> f64 {
    rows.iter().fold(0.0, |m, row| (row.probes[0] - expected(row.time)).abs().max(m))
}

/// Asserts that two runs agree at all probes.
#[track_caller]
pub fn same(one: &[Instant], other: &[Instant], tolerance: f64) {
    assert_eq!(one.len(), other.len());
    for (one, other) in one.iter().zip(other) {
        for (a, b) in one.probes.iter().zip(&other.probes) {
            assert!((a - b).abs() <= tolerance, "t = {}: {a:e}, {b:e}, off {:e}", one.time, a - b);
        }
    }
}

#[track_caller]
pub fn close(what: &str, value: f64, expected: f64, tolerance: f64) {
    let error = (value / expected - 1.0).abs();
    assert!(error <= tolerance, "{what}: {value:.15e}, expected {expected:.15e}: relative error {error:.1e}");
}

/// Mesh to be written as text of Gmsh 2.2, Abaqus or Nastran: nodes, cells of three or four nodes,
/// and named lines.
#[derive(Clone)]
pub struct Drawing {
    pub nodes: Vec<[f64; 2]>,
    pub cells: Vec<Vec<usize>>,
    pub lines: Vec<(&'static str, Vec<[usize; 2]>)>,
}

impl Drawing {
    /// Returns a grid on [0, length] x [0, width] with a map of its points; triangles are cut along
    /// "/".
    pub fn grid(
        [nx, ny]: [usize; 2],
        [length, width]: [f64; 2],
        triangles: bool,
        map: impl Fn(f64, f64) -> [f64; 2],
    ) -> Drawing {
        let number = |i: usize, j: usize| j * (nx + 1) + i;
        let place = |k: usize| {
            let (i, j) = (k % (nx + 1), k / (nx + 1));
            map(length * i as f64 / nx as f64, width * j as f64 / ny as f64)
        };
        let mut cells = Vec::new();
        for (i, j) in (0..nx * ny).map(|k| (k % nx, k / nx)) {
            let [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
            if triangles {
                cells.extend([vec![a, b, c], vec![a, c, d]]);
            } else {
                cells.push(vec![a, b, c, d]);
            }
        }
        let along = |j: usize| (0..nx).map(|i| [number(i, j), number(i + 1, j)]).collect();
        let up = |i: usize| (0..ny).map(|j| [number(i, j), number(i, j + 1)]).collect();
        let lines = vec![("left", up(0)), ("right", up(nx)), ("bottom", along(0)), ("top", along(ny))];
        Drawing { nodes: (0..(nx + 1) * (ny + 1)).map(place).collect(), cells, lines }
    }

    /// Returns a disc of radius 1 in rings of triangles: six around the centre, and six more nodes
    /// in each ring.
    pub fn disc(rings: usize) -> Drawing {
        let first = |ring: usize| if ring == 0 { 0 } else { 1 + 3 * ring * (ring - 1) };
        let node = |ring: usize, k: usize| first(ring) + if ring == 0 { 0 } else { k % (6 * ring) };
        let mut nodes = vec![[0.0, 0.0]];
        let mut cells = Vec::new();
        for ring in 1..=rings {
            let count = 6 * ring;
            for k in 0..count {
                let angle = std::f64::consts::TAU * k as f64 / count as f64;
                let radius = ring as f64 / rings as f64;
                nodes.push([radius * angle.cos(), radius * angle.sin()]);
            }
            for sector in 0..6 {
                for k in 0..ring {
                    let (outer, inner) = (sector * ring + k, sector * (ring - 1) + k);
                    cells.push(vec![node(ring, outer), node(ring, outer + 1), node(ring - 1, inner)]);
                    if k + 1 < ring {
                        cells.push(vec![
                            node(ring, outer + 1),
                            node(ring - 1, inner + 1),
                            node(ring - 1, inner),
                        ]);
                    }
                }
            }
        }
        let rim = (0..6 * rings).map(|k| [node(rings, k), node(rings, k + 1)]).collect();
        Drawing { nodes, cells, lines: vec![("rim", rim)] }
    }

    /// Writes the mesh in the format of the name's ending, and returns the name of its file.
    pub fn write(&self, name: &str) -> String {
        let text = match name.rsplit_once('.') {
            Some((_, "inp")) => self.abaqus(),
            Some((_, "bdf")) => self.nastran(),
            _ => self.gmsh(),
        };
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        std::fs::write(&path, text).unwrap();
        path.to_string_lossy().into_owned()
    }

    /// Returns an input file of Abaqus, whose lines are sets of nodes.
    pub fn abaqus(&self) -> String {
        let mut text = String::from("*Heading\n a plate\n** its nodes\n*Node\n");
        for (node, [x, y]) in self.nodes.iter().enumerate() {
            let _ = writeln!(text, "{}, {x:?}, {y:?}, 0.", node + 1);
        }
        for (number, cell) in self.cells.iter().enumerate() {
            let nodes: Vec<String> = cell.iter().map(|node| (node + 1).to_string()).collect();
            let _ = writeln!(
                text,
                "*Element, type=S{}, elset=plate\n{}, {}",
                cell.len(),
                number + 1,
                nodes.join(", ")
            );
        }
        for (name, sides) in &self.lines {
            let nodes: Vec<String> = sides.concat().iter().map(|node| (node + 1).to_string()).collect();
            let _ = writeln!(text, "*Nset, nset={name}\n{}", nodes.join(",\n"));
        }
        text + "*Material, name=steel\n*Elastic\n210e9, 0.3\n*Density\n7800.\n"
    }

    /// Returns an input file of Nastran with long fields, whose lines are `SPC1` cards.
    pub fn nastran(&self) -> String {
        let mut text = String::from("SOL 103\nCEND\nBEGIN BULK\n$ a plate\nMAT1,1,210.+9,,0.3\n");
        for (node, [x, y]) in self.nodes.iter().enumerate() {
            let _ =
                writeln!(text, "GRID*   {:>16}{:>16}{x:>16?}{y:>16?}\n*       {:>16}", node + 1, "", "0.");
        }
        for (number, cell) in self.cells.iter().enumerate() {
            let name = if cell.len() == 3 { "CTRIA3" } else { "CQUAD4" };
            let _ = write!(text, "{name:<8}{:>8}{:>8}", number + 1, 1);
            cell.iter().for_each(|node| {
                let _ = write!(text, "{:>8}", node + 1);
            });
            text.push('\n');
        }
        for (number, (_, sides)) in self.lines.iter().enumerate() {
            for node in sides.concat() {
                let _ = writeln!(text, "SPC1,{},123456,{}", number + 1, node + 1);
            }
        }
        text + "ENDDATA\n"
    }

    /// Returns a file of Gmsh 2.2.
    fn gmsh(&self) -> String {
        let mut text = String::from("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n");
        let _ = writeln!(text, "{}", self.lines.len() + 1);
        for (tag, (name, _)) in self.lines.iter().enumerate() {
            let _ = writeln!(text, "1 {} \"{name}\"", tag + 1);
        }
        let _ = writeln!(text, "2 99 \"plate\"\n$EndPhysicalNames\n$Nodes\n{}", self.nodes.len());
        for (node, [x, y]) in self.nodes.iter().enumerate() {
            let _ = writeln!(text, "{} {x:?} {y:?} 0", node + 1);
        }
        let sides = self
            .lines
            .iter()
            .enumerate()
            .flat_map(|(tag, (_, sides))| sides.iter().map(move |side| (1, tag + 1, side.to_vec())));
        let cells = self.cells.iter().map(|cell| (cell.len() - 1, 99, cell.clone()));
        let elements: Vec<_> = sides.chain(cells).collect();
        let _ = writeln!(text, "$EndNodes\n$Elements\n{}", elements.len());
        for (number, (kind, tag, nodes)) in elements.into_iter().enumerate() {
            let nodes: Vec<String> = nodes.iter().map(|node| (node + 1).to_string()).collect();
            let _ = writeln!(text, "{} {kind} 2 {tag} {tag} {}", number + 1, nodes.join(" "));
        }
        text + "$EndElements\n"
    }
}
