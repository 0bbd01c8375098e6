//! Contents of a scene: all of its tables.

use super::attachments::Attachments;
use super::damping::Damping;
use super::document::quote;
use super::entry::{Entry, Kind, SceneText, Schema, Table, flat, if_given, object, section, table, tables};
use super::in_plane::InPlane;
use super::initial::Initial;
use super::kinds::{parameter, shortest, string, text};
use super::loads::Load;
use super::mesh::{Grid, MeshFile, mesh};
use super::obstacles::Obstacle;
use super::output::Output;
use super::plate::{Part, PlateSpec};
use super::slider::Slider;
use super::solver::Solver;
use super::study::Study;
use super::supports::Support;
use super::sweep::SweepSpec;
use super::time::Time;
use crate::field::Parameters;
use serde_json::{Value, json};
use std::sync::LazyLock;

table! {
    /// Simulation input, validated and with every default filled in, in SI units.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Scene {
        /// Title, one line of text; by default the name of the file without its extension.
        title: String = title().or_else(|doc| Ok(doc.stem()));
        /// Numbers with names of their own, which every formula of the scene may use.
        parameters: Parameters = parameters();
        /// Plate: sides, thickness and material.
        plate: PlateSpec = section();
        /// Parts of the plate with another thickness or material; the last one wins where they
        /// overlap.
        parts: Vec<Part> = tables("part", "where or group, and what differs there");
        /// Discretisation: rectangles, or a mesh file.
        mesh: Grid,
        /// Mesh file that gives shape and mesh, in place of a rectangle.
        file: Option<MeshFile> = mesh();
        /// Supports: edges and points that are held; all others are free.
        supports: Vec<Support> = tables("support", "edge and kind");
        /// Obstacles, rigid or compliant; where several rigid ones lie on one side, the nearest
        /// counts.
        obstacles: Vec<Obstacle> = tables("obstacle", "side and height");
        /// Loads: pressure, gravity and point forces; `None` costs nothing.
        load: Option<Load> = if_given();
        /// Foundations, springs, dashpots, masses, ribs and balls.
        attachments: Attachments = flat();
        /// Dry friction at nodes.
        sliders: Vec<Slider> = tables("slider", "at and force");
        /// Forces in the plane of the plate; `None` costs nothing.
        in_plane: Option<InPlane> = if_given();
        /// Damping: Rayleigh's coefficients, and damping of single modes; `None` costs nothing.
        damping: Option<Damping> = if_given();
        /// Initial state: deflection and velocity at the start; by default at rest and flat.
        initial: Initial = section();
        /// Time scheme, mass, step and end.
        time: Time = section();
        /// Linear algebra, contact solver and tolerances.
        solver: Solver = section();
        /// Output files.
        output: Output = section();
        /// Runs that `rebond study` compares, where the scene says so.
        study: Option<Study> = if_given();
        /// Runs that `rebond sweep` makes, where the scene says so.
        sweep: Option<SweepSpec> = if_given();
    }
}

/// Title of a scene.
fn title() -> Kind<String> {
    text("expected one line of text", |title, expected| {
        let has_control = title.contains(char::is_control);
        has_control.then(|| format!("{} has a control character; {expected}", quote(title)))
    })
}

/// Table of parameters, which have names of their own.
fn parameters() -> Entry<Parameters> {
    let write = |name: &str, parameters: &Parameters, lines: &mut SceneText| {
        if parameters.iter().next().is_some() {
            lines.behind(&format!("\n[{name}]\n"));
        }
        for (name, value) in parameters.iter() {
            let is_word = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            let name = if is_word { name.to_owned() } else { string(name) };
            lines.behind(&format!("{name} = {}\n", shortest(value)));
        }
    };
    Entry::new(
        |name, help, keys| {
            let of_number = (parameter().schema)().into();
            let schema = object([("type", json!("object")), ("additionalProperties", of_number)]);
            keys.add(name, help, false, schema);
        },
        |doc, _, _| doc.parameters().cloned(),
        write,
    )
}

/// Returns the JSON schema (draft 7) of scene files.
///
/// It is made from the rows of the tables, with their types, ranges and words. The reader checks
/// more: formulas, names, and combinations of keys.
pub fn schema() -> Value {
    let mut schema: Schema = object([
        ("$schema", json!("http://json-schema.org/draft-07/schema#")),
        ("title", json!("Scene of rebond, in SI units")),
    ]);
    schema.extend(Scene::keys().schema());
    Value::Object(schema)
}

/// Returns the unit of a key such as `load.pressure` or `spring.0.stiffness`, with or without the
/// number of the table; `None` without a unit, or with one that depends on other keys.
pub fn unit(key: &str) -> Option<String> {
    static SCHEMA: LazyLock<Value> = LazyLock::new(schema);
    let inner = |node: &'static Value, part: &str| &node.get("items").unwrap_or(node)["properties"][part];
    let parts = key.split('.').filter(|part| part.parse::<usize>().is_err());
    let description = parts.fold(&*SCHEMA, inner)["description"].as_str()?;
    let unit = description.strip_prefix('[')?.split([']', ';', ',']).next()?;
    (!unit.starts_with("default")).then(|| unit.to_owned())
}
