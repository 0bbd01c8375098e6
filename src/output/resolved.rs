//! Quantities and obstacles of a resolved scene, read back from `summary.json`.

use super::plot::Obstacle;
use crate::scene::ProbeQuantity;
use serde_json::Value;
use std::collections::BTreeMap;

/// Returns the quantity of a probe of a resolved scene, and whether the probe is of a ball.
pub fn quantity(scene: &Value, probe: &str) -> (ProbeQuantity, bool) {
    let probes = scene["output"]["probes"].as_array();
    let row = probes.into_iter().flatten().find(|entry| entry["name"] == probe);
    let named = row.and_then(|row| row["quantity"].as_str()).and_then(ProbeQuantity::named);
    (named.unwrap_or_default(), row.is_some_and(|row| !row["ball"].is_null()))
}

/// Returns the obstacles of a resolved scene that have one constant height, without repetition.
///
/// Obstacles that face a part of the plate count if some probe faces them.
pub fn obstacles(scene: &Value, opposite: &BTreeMap<String, Vec<f64>>) -> Vec<Obstacle> {
    let mut obstacles = Vec::new();
    for obstacle in scene["obstacle"].as_array().into_iter().flatten() {
        let Some(height) = obstacle["height"].as_f64() else { continue };
        let is_part = ["where", "group", "at", "line"].iter().any(|key| !obstacle[key].is_null());
        let obstacle = match (is_part, obstacle["side"] == "below") {
            (true, _) => {
                Obstacle::Part(height, obstacle["name"].as_str().unwrap_or("partial obstacle").to_owned())
            }
            (false, true) => Obstacle::Below(height),
            (false, false) => Obstacle::Above(height),
        };
        let is_seen = !is_part || opposite.values().flatten().any(|other| *other == height);
        if is_seen && !obstacles.contains(&obstacle) {
            obstacles.push(obstacle);
        }
    }
    obstacles
}
