//! The JSON schema for editors accepts what the reader of scenes accepts, as far as types, ranges,
//! words and names of keys go.

use crate::common::models::{CLAMPED, PAPER_PLATE};
use rebond::scene::{Scene, schema};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn root(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Returns the scene files below a folder.
fn scenes(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(scenes(&path));
        } else if path.extension().is_some_and(|extension| extension == "toml") {
            found.push(path);
        }
    }
    found
}

fn json(text: &str) -> Option<Value> {
    let table: toml::Table = toml::from_str(text.trim_start_matches('\u{feff}')).ok()?;
    Some(serde_json::to_value(table).unwrap())
}

/// Returns what contradicts a schema, and panics on keywords that it does not know.
fn faults(schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let number = |limit: &Value| limit.as_f64().unwrap();
    let is = |of: &str| match of {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "number" => value.is_number(),
        "integer" => value.is_i64() || value.is_u64(),
        other => panic!("{other}"),
    };
    let outside = |keyword: &str, limit: f64| {
        value.as_f64().is_some_and(|value| match keyword {
            "minimum" => value < limit,
            "maximum" => value > limit,
            "exclusiveMinimum" => value <= limit,
            _ => value >= limit,
        })
    };
    let items = value.as_array().map(Vec::as_slice).unwrap_or_default();
    let entries = || value.as_object().into_iter().flatten();
    let mut found = Vec::new();
    for (keyword, of) in schema.as_object().unwrap() {
        let holds = match keyword.as_str() {
            "$schema" | "title" | "description" => true,
            "type" => match of {
                Value::Array(types) => types.iter().any(|of| is(of.as_str().unwrap())),
                one => is(one.as_str().unwrap()),
            },
            "enum" => of.as_array().unwrap().contains(value),
            "minimum" | "maximum" | "exclusiveMinimum" | "exclusiveMaximum" => !outside(keyword, number(of)),
            "minItems" => !value.is_array() || items.len() as f64 >= number(of),
            "maxItems" => !value.is_array() || items.len() as f64 <= number(of),
            "uniqueItems" => (1..items.len()).all(|i| !items[..i].contains(&items[i])),
            "items" => {
                let each = items.iter().enumerate();
                found.extend(each.flat_map(|(i, item)| faults(of, item, &format!("{at}.{i}"))));
                true
            }
            "properties" => {
                let known = entries().filter_map(|(key, value)| Some((key, value, of.get(key)?)));
                found.extend(known.flat_map(|(key, value, of)| faults(of, value, &format!("{at}.{key}"))));
                true
            }
            "additionalProperties" => {
                for (key, value) in entries() {
                    if schema["properties"].get(key).is_none() {
                        match of {
                            Value::Bool(false) => found.push(format!("{at}.{key}: unknown")),
                            of => found.extend(faults(of, value, &format!("{at}.{key}"))),
                        }
                    }
                }
                true
            }
            "required" => of
                .as_array()
                .unwrap()
                .iter()
                .all(|key| !value.is_object() || value.get(key.as_str().unwrap()).is_some()),
            "oneOf" | "anyOf" => {
                let fit = of.as_array().unwrap().iter().filter(|of| faults(of, value, at).is_empty()).count();
                fit == 1 || (keyword == "anyOf" && fit > 1)
            }
            other => panic!("{other}"),
        };
        if !holds {
            found.push(format!("{at}: {keyword} {of}"));
        }
    }
    found
}

/// The file of the repository, which editors can read without the program, is what the program
/// prints.
#[test]
fn the_schema_in_the_documentation_is_that_of_the_program() {
    let printed = serde_json::to_string_pretty(&schema()).unwrap() + "\n";
    let kept = fs::read_to_string(root("docs/scene.schema.json")).unwrap();
    assert!(printed == kept, "make docs/scene.schema.json anew: rebond schema > docs/scene.schema.json");
}

#[test]
fn every_scene_of_the_repository_fits_the_schema() {
    let schema = schema();
    let files = scenes(&root("scenes"));
    assert!(files.len() > 60);
    for path in files {
        let scene = json(&fs::read_to_string(&path).unwrap()).unwrap();
        let faults = faults(&schema, &scene, "");
        assert!(faults.is_empty(), "{}: {faults:?}", path.display());
        let resolved = Scene::load(&path, &[]).unwrap().resolved();
        let faults = self::faults(&schema, &json(&resolved).unwrap(), "");
        assert!(faults.is_empty(), "{}, resolved: {faults:?}", path.display());
    }
}

/// Beside unknown keys, the schema finds values of a wrong type or out of range.
#[test]
fn bad_scenes_with_unknown_keys_do_not_fit() {
    let schema = schema();
    let (mut unknown, mut found) = (0, 0);
    for path in scenes(&root("tests/data/bad")) {
        let Ok(text) = fs::read_to_string(&path) else { continue };
        let Some(scene) = json(&text) else { continue };
        let faults = faults(&schema, &scene, "");
        found += usize::from(!faults.is_empty());
        if text.lines().next().unwrap().contains("unknown key") {
            unknown += 1;
            assert!(
                faults.iter().any(|fault| fault.ends_with(": unknown")),
                "{}: {faults:?}",
                path.display()
            );
        }
    }
    assert!(unknown >= 6 && found >= 80, "{unknown}, {found}");
}

/// A scene with an entry in every table.
const FULL: &str = r#"
title = "all tables"
parameters = { a = 1.0 }
mesh = { element = "hct", cells = [4, 2] }
part = [{ where = "x > 0.9", thickness = 0.02 }]
obstacle = [{ side = "below", height = -0.1, at = [1.2, 0.0], friction = 0.0, velocity = [0.0, 0.0] }]
load = { pressure = 0.0, force = [{ at = [1.2, 0.0], value = 1.0 }], moment = [{ at = [1.2, 0.0], about = "y", value = 1.0 }] }
in_plane = { stretching = false, temperature = 1.0, traction = [{ edge = "right", force = [1.0, 0.0] }], tension = { xx = 1.0 } }
foundation = [{ stiffness = 1.0 }]
spring = [{ at = [1.2, 0.0], stiffness = 1.0 }]
dashpot = [{ at = [1.2, 0.0], damping = 1.0 }]
mass = [{ at = [1.2, 0.0], mass = 1.0 }]
rib = [{ edge = "top", bending = 1.0 }]
ball = [{ at = [0.6, 0.2], mass = 1.0, height = 0.1 }]
slider = [{ at = [0.6, 0.2], force = 1.0 }]
damping = { mass = 0.0 }
initial = { velocity = 0.0 }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 1e-2 }
solver = { vi = "condensed" }
output = { every = 1, fields_every = 10, probes = [{ name = "p", at = [1.2, 0.0] }] }
study = { repeat = 1, steps = [1e-4] }
sweep = { over = ["a=1,2"], period = 1e-2 }
"#;

/// Returns the paths of all keys below a schema, with 0 for the entry of an array of tables.
fn keys(schema: &Value, at: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (key, of) in schema["properties"].as_object().into_iter().flatten() {
        let path = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
        found.extend(keys(of, &path));
        found.extend(keys(&of["items"], &format!("{path}.0")));
        found.push(path);
    }
    found
}

/// Sets a key of a scene, as `--set` does.
fn set(mut scene: &mut Value, key: &str, value: Value) {
    for part in key.split('.') {
        scene = match part.parse::<usize>() {
            Ok(index) => &mut scene[index],
            Err(_) => &mut scene[part],
        };
    }
    *scene = value;
}

/// Each key gets values of all types and on both sides of the usual limits. What the schema refuses
/// the reader refuses too, so that an editor marks no valid scene; and a type, a range or a word
/// that the reader refuses at this key is refused by the schema.
#[test]
fn schema_and_reader_agree_on_every_key() {
    let schema = schema();
    let plate = PAPER_PLATE.replace(" }", ", expansion = 1e-5 }");
    let text = [&plate, CLAMPED, FULL].concat();
    let base = json(&text).unwrap();
    assert_eq!(faults(&schema, &base, ""), [""; 0]);
    Scene::from_str(&text, "full.toml", &[]).unwrap();
    let values = [
        "-2",
        "-1",
        "0",
        "0.25",
        "0.3",
        "0.5",
        "1",
        "2.5",
        "7",
        "\"nonsense\"",
        "\"below\"",
        "\"x\"",
        "true",
        "[]",
        "[1, 1]",
        "[1.5, 2.5]",
        "[1, 2, 3]",
        "[\"singular\"]",
        "[\"singular\", \"singular\"]",
        "{}",
        "{ nonsense = 1 }",
        "{ table = \"a.csv\", interpolation = \"line\" }",
    ];
    let keys = keys(&schema, "");
    assert!(keys.len() > 130, "{}", keys.len());
    let (mut refused, mut wrong) = (0, Vec::new());
    for key in &keys {
        for value in values {
            let mut scene = base.clone();
            set(&mut scene, key, json(&format!("value = {value}")).unwrap()["value"].clone());
            let faults = faults(&schema, &scene, "");
            let read = Scene::from_str(&text, "full.toml", &[format!("{key}={value}")]);
            let why = read.as_ref().err().map(ToString::to_string).unwrap_or_default();
            refused += usize::from(!faults.is_empty());
            if read.is_ok() && !faults.is_empty() {
                wrong.push(format!("{key} = {value} is valid, but the schema says {faults:?}"));
            }
            // The key of an entry that an array misses is that of the array.
            let own = why.split_once(&format!("={value}: ")).map_or("", |(_, rest)| rest);
            let (of, said) = own.split_once(": ").unwrap_or_default();
            let by_kind = [
                "found ",
                "is not valid",
                "is negative",
                "is not positive",
                "is out of range",
                "is too small",
            ];
            let is_own = of == key || of.strip_prefix(key.as_str()).is_some_and(|rest| rest.starts_with('.'));
            // Texts of formulas and names of edges are beyond a schema.
            let is_text = said.starts_with("column ") || (of == "support.0.edge" && value.starts_with('"'));
            if is_own && !is_text && by_kind.iter().any(|by| said.contains(by)) && faults.is_empty() {
                wrong.push(format!("{key} = {value} fits the schema, but: {why}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(refused > 1500, "{refused}");
}
