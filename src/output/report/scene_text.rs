//! A resolved scene as text, and its keys that say something: without them it would be another one.

use crate::scene::Scene;
use serde_json::Value;
use std::io;

/// Returns a resolved scene without the keys whose values are those that the program fills in; all
/// keys where files that the scene names are not found.
///
/// `file` is the file of the scene; the files that the scene names are relative to it.
pub(super) fn set_keys(scene: &Value, file: &str) -> Value {
    let read = |scene: &Value| Scene::from_str(&scene_text(scene).ok()?, file, &[]).ok();
    let mut shown = scene.clone();
    if let Some(whole) = read(scene) {
        let mut pointers = Vec::new();
        leaves(scene, String::new(), &mut pointers);
        for pointer in pointers {
            let mut other = scene.clone();
            remove(&mut other, &pointer);
            if read(&other).is_some_and(|other| other == whole) {
                remove(&mut shown, &pointer);
            }
        }
    }
    if let Value::Object(tables) = &mut shown {
        tables.retain(|_, table| table.as_object().is_none_or(|keys| !keys.is_empty()));
    }
    shown
}

/// Collects the places of the keys of all tables, as JSON pointers.
fn leaves(value: &Value, pointer: String, pointers: &mut Vec<String>) {
    match value {
        Value::Object(table) => {
            table.iter().for_each(|(key, value)| leaves(value, format!("{pointer}/{key}"), pointers));
        }
        Value::Array(list) if list.iter().any(Value::is_object) => {
            list.iter().enumerate().for_each(|(i, value)| leaves(value, format!("{pointer}/{i}"), pointers));
        }
        _ => pointers.push(pointer),
    }
}

/// Removes a key at a place.
fn remove(scene: &mut Value, pointer: &str) {
    let Some((table, key)) = pointer.rsplit_once('/') else { return };
    if let Some(Value::Object(table)) = scene.pointer_mut(table) {
        table.retain(|name, _| name != key);
    }
}

/// Returns a resolved scene as the text of a scene file.
pub(super) fn scene_text(scene: &Value) -> io::Result<String> {
    let invalid =
        |why: &dyn std::fmt::Display| io::Error::new(io::ErrorKind::InvalidData, format!("scene: {why}"));
    let mut scene = scene.clone();
    drop_nulls(&mut scene);
    let value = toml::Value::try_from(scene).map_err(|why| invalid(&why))?;
    toml::to_string(&value).map_err(|why| invalid(&why))
}

/// Removes entries without a value, which TOML does not know.
fn drop_nulls(value: &mut Value) {
    match value {
        Value::Object(table) => {
            table.retain(|_, value| !value.is_null());
            table.values_mut().for_each(drop_nulls);
        }
        Value::Array(list) => list.iter_mut().for_each(drop_nulls),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn keys_as_the_program_fills_them_in_are_left_out() {
        let given = "
            plate = { length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, \
             density = 7770.0 }
            mesh = { element = \"hct\", cells = [4, 2], refine = 0 }
            support = [{ edge = \"left\", kind = \"clamped\" }]
            time = { scheme = \"newmark\", mass = \"singular\", step = 1e-4, end = 0.08, restitution = 0.5 }";
        let scene = serde_json::to_value(Scene::from_str(given, "fall.toml", &[]).unwrap()).unwrap();
        let shown = set_keys(&scene, "fall.toml");
        assert!(scene["solver"].is_object() && shown["solver"].is_null() && shown["initial"].is_null());
        assert_eq!(shown["mesh"], json!({ "element": "hct", "cells": [4, 2] }));
        let time = shown["time"].as_object().unwrap();
        assert!(time["restitution"] == 0.5 && !time.contains_key("beta"), "{time:?}");
        assert_eq!(shown["support"], scene["support"]);
    }
}
