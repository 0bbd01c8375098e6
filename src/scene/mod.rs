//! Scenes: TOML text is read into a validated [`Scene`].
//!
//! ```
//! use rebond::scene::Scene;
//!
//! let text = r#"
//!     mesh = { element = "fvs", cells = [10, 4] }
//!     time = { scheme = "midpoint", mass = "singular", step = 1e-5, end = 0.5 }
//!     [plate]
//!     length = 1.2
//!     width = 0.4
//!     thickness = 0.01
//!     youngs_modulus = 210e9
//!     poissons_ratio = 0.3
//!     density = 7770
//! "#;
//! let scene = Scene::from_str(text, "beam.toml", &["time.step=2e-5".into()])?;
//! assert_eq!(scene.time.steps(), 25_000);
//!
//! let error = Scene::from_str(text, "beam.toml", &["plate.width=-1".into()]).unwrap_err();
//! let place = "--set plate.width=-1: plate.width";
//! let fault = "-1 is not positive; expected a width in m greater than 0";
//! assert_eq!(error.to_string(), format!("{place}: {fault}"));
//! # Ok::<(), rebond::Error>(())
//! ```

mod attachments;
mod column;
mod contents;
mod cross_checks;
mod damping;
mod document;
mod effects;
mod entry;
mod extreme;
mod given;
mod in_plane;
mod initial;
mod kinds;
mod loads;
mod mesh;
mod obstacles;
mod ordinal;
mod output;
mod place;
mod plate;
mod quantity;
mod random_keys;
mod slider;
mod solver;
mod study;
mod supports;
mod sweep;
mod time;
mod words;

pub use crate::dof_map::Support as SupportKind;
pub use crate::element::ElementKind;
use crate::error::Result;
use crate::hash;
use crate::input;
pub use crate::membrane::InPlaneHold;
pub use crate::mesh::Diagonal;
pub use crate::plate::Plate;
pub use crate::random::PointSet;
pub use crate::scheme::{Massless, SchemeName, SchemeSpec};
pub use crate::vi::ContactSolver;
pub use attachments::{Attachments, Ball, Dashpot, Foundation, PointMass, Rib, RibPath, Spring};
pub use column::{ColumnNumber, FORCE_COLUMNS, HISTORY_COLUMNS, HistoryRow};
pub use contents::{Scene, schema, unit};
pub use damping::{Damping, ModalRatios};
use document::Document;
use entry::{SceneText, Table};
pub use given::{FieldInput, MeasuredTable, OfDeflection, Region, Still};
pub use in_plane::{InPlane, Traction};
pub use initial::{Initial, StartFrom};
pub use loads::{Force, Load, Moment};
pub use mesh::{Grid, MeshFile};
pub use obstacles::{Compliance, Obstacle, SourcePosition, compliance_units};
pub(crate) use ordinal::ordinal;
pub use output::{Output, Probe, Snapshots};
pub use plate::{Part, PlateSpec};
pub use quantity::{ProbeQuantity, StressComponent};
pub use random_keys::{Draws, RandomKey, RandomKeys};
use serde::{Serialize, Serializer};
pub use slider::Slider;
pub use solver::Solver;
use std::path::Path;
pub use study::Study;
pub use supports::{ElasticEdge, Support, SupportLocation};
pub use sweep::{SweepSpec, SweptKey};
pub use time::Time;
pub use words::{EngineName, Horizon, LinearSolver, Mass, RotationAxis, Side, SweepOrder};

impl Serialize for Scene {
    /// Serialises the table of [`Scene::resolved`].
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let table: toml::Table = toml::from_str(&self.resolved()).map_err(serde::ser::Error::custom)?;
        table.serialize(serializer)
    }
}

impl Scene {
    /// Reads a scene file and applies overrides such as `time.step=1e-6`.
    pub fn load(path: impl AsRef<Path>, overrides: &[String]) -> Result<Scene> {
        Scene::load_for(path, overrides, EngineName::Native)
    }

    /// Works as [`Scene::load`], with the default engine for a scene that names none.
    pub fn load_for(path: impl AsRef<Path>, overrides: &[String], engine: EngineName) -> Result<Scene> {
        let path = path.as_ref();
        let bytes = input::read_scene(path)?;
        let name = path.to_string_lossy();
        Scene::of(&Document::parse(&bytes, &name, overrides, engine, unit)?)
    }

    /// Reads a scene from text; messages call it `file_name`.
    pub fn from_str(text: &str, file_name: &str, overrides: &[String]) -> Result<Scene> {
        Scene::from_bytes(text.as_bytes(), file_name, overrides)
    }

    /// Reads a scene from the bytes of a file.
    ///
    /// Any bytes give a scene or [`crate::Error::Scene`]. A scene that names points of a mesh file
    /// can also give the errors of reading that mesh.
    pub fn from_bytes(bytes: &[u8], file_name: &str, overrides: &[String]) -> Result<Scene> {
        Scene::of(&Document::parse(bytes, file_name, overrides, EngineName::Native, unit)?)
    }

    fn of(doc: &Document) -> Result<Scene> {
        let scene = entry::read(doc, "")?;
        cross_checks::check(doc, &scene)?;
        Ok(scene)
    }

    /// Returns the text in TOML, with files by the path where they were found, or as written.
    fn text(&self, by_path: bool) -> String {
        let mut lines = SceneText::new(by_path);
        self.write(&mut lines);
        lines.text()
    }

    /// Returns the scene as TOML with every default filled in, which reads back as an equal scene.
    pub fn resolved(&self) -> String {
        self.text(true)
    }

    /// Works as [`Scene::resolved`], with file names as they were written.
    ///
    /// The text reads back as an equal scene in the folder of the scene's file.
    pub fn written(&self) -> String {
        self.text(false)
    }

    /// Returns a text that is equal for equal supports.
    pub fn supports_in_words(&self) -> String {
        format!("{:?}", self.supports)
    }

    /// Returns the study of the scene, or the default one.
    pub fn study(&self) -> Study {
        self.study.clone().unwrap_or_else(|| Study::usual(&self.mesh, &self.time, &self.solver))
    }

    /// Returns the columns of `history.csv` for named supports, obstacles, balls and sliders, in
    /// the order of the scene.
    pub fn force_columns(&self) -> Vec<String> {
        let columns = |name: &String, count: usize| {
            FORCE_COLUMNS[..count].iter().map(|quantity| format!("{quantity}_{name}")).collect::<Vec<_>>()
        };
        let supports = self.supports.iter().filter_map(|support| support.name.as_ref());
        let obstacles = self.obstacles.iter().filter_map(|obstacle| obstacle.name.as_ref());
        let balls = self.attachments.balls.iter().filter_map(|ball| ball.name.as_ref());
        let of_supports = supports.flat_map(|name| columns(name, 4));
        let sliders = self.sliders.iter().filter_map(|slider| slider.name.as_ref());
        let of_obstacles = obstacles.chain(balls).flat_map(|name| columns(name, 2));
        of_supports.chain(of_obstacles).chain(sliders.flat_map(|name| columns(name, 1))).collect()
    }

    /// Returns the names of all sliders, or the keys of those without one.
    pub fn slider_names(&self) -> impl Iterator<Item = String> {
        let names = self.sliders.iter().map(|slider| slider.name.clone()).enumerate();
        names.map(|(number, name)| name.unwrap_or(format!("slider.{number}")))
    }

    /// Returns the FNV-1a hash of the scene and of the values in its tables, in 16 hexadecimal
    /// digits.
    ///
    /// The hash covers [`Scene::written`] and the state that the run starts from, and is the same
    /// on every machine.
    pub fn hash(&self) -> String {
        let tables = self.of_time().filter_map(|given| given.table.as_ref());
        let values: String = tables.map(|table| format!("{:?}\n", table.rows)).collect();
        let start = self.initial.from.as_ref().map_or(String::new(), |from| format!("{:?}\n", from.motion));
        format!("{:016x}", hash::fnv1a((self.written() + &values + &start).into_bytes()))
    }
}
