//! One sentence of what the plate of a run is.

use crate::output::text::{engineering, raised};
use crate::scene::compliance_units;
use serde_json::Value;

/// Largest number of equal stops that a sentence names.
const MOST_NAMES: usize = 4;

/// Materials by the ranges of their modulus (GPa) and density (kg/m3).
const MATERIALS: [(&str, [f64; 2], [f64; 2]); 8] = [
    ("steel", [185.0, 220.0], [7600.0, 8100.0]),
    ("aluminium", [65.0, 76.0], [2600.0, 2900.0]),
    ("titanium", [100.0, 125.0], [4300.0, 4700.0]),
    ("copper or bronze", [95.0, 135.0], [8300.0, 9000.0]),
    ("silicon", [125.0, 190.0], [2300.0, 2360.0]),
    ("gold", [70.0, 85.0], [19000.0, 19500.0]),
    ("glass", [60.0, 80.0], [2350.0, 2600.0]),
    ("concrete", [20.0, 45.0], [2200.0, 2600.0]),
];

/// Tables of parts that a sentence counts, with their names for one and for several.
const COUNTED: [(&str, &str, &str); 7] = [
    ("part", "another part", "other parts"),
    ("rib", "a rib", "ribs"),
    ("spring", "a spring", "springs"),
    ("dashpot", "a dashpot", "dashpots"),
    ("foundation", "a foundation", "foundations"),
    ("mass", "an added mass", "added masses"),
    ("slider", "a slider", "sliders"),
];

/// Returns what the plate of a resolved scene is, in a sentence without a full stop; `extent` (m)
/// is the size of a mesh from a file, where it is known.
pub(super) fn sentence(scene: &Value, extent: Option<[f64; 2]>) -> String {
    let mut parts = vec![plate(scene, extent), supports(scene)];
    for (table, one, several) in COUNTED {
        match list(scene, table).count() {
            0 => {}
            1 => parts.push(one.into()),
            count => parts.push(format!("{count} {several}")),
        }
    }
    parts.extend(counted(scene, "obstacle", stop));
    parts.extend(counted(scene, "ball", ball));
    parts.extend(loads(scene));
    let mut sentence = parts.join("; ");
    if let Some(first) = sentence.get(..1).map(str::to_uppercase) {
        sentence.replace_range(..1, &first);
    }
    sentence
}

fn list<'s>(scene: &'s Value, table: &str) -> impl Iterator<Item = &'s Value> {
    scene[table].as_array().into_iter().flatten()
}

/// Returns equal descriptions of the entries of a table once, with their number and their names.
fn counted(scene: &Value, table: &str, description: fn(&Value) -> String) -> Vec<String> {
    let mut kinds: Vec<(String, usize, Vec<&str>)> = Vec::new();
    for entry in list(scene, table) {
        let (description, name) = (description(entry), entry["name"].as_str());
        match kinds.iter_mut().find(|(other, ..)| *other == description) {
            Some((_, count, names)) => {
                *count += 1;
                names.extend(name);
            }
            None => kinds.push((description, 1, name.into_iter().collect())),
        }
    }
    let words = |(mut words, count, names): (String, usize, Vec<&str>)| {
        if count > 1 {
            words = format!("{count} times {words}");
        }
        if (1..=MOST_NAMES).contains(&names.len()) {
            words += &format!(" ({})", names.join(", "));
        }
        words
    };
    kinds.into_iter().map(words).collect()
}

fn plate(scene: &Value, extent: Option<[f64; 2]>) -> String {
    let plate = &scene["plate"];
    let number = |key: &str| plate[key].as_f64();
    let (modulus, density) = (number("youngs_modulus").unwrap_or(0.0), number("density").unwrap_or(0.0));
    let within = |value: f64, [low, high]: [f64; 2]| (low..=high).contains(&value);
    let material = MATERIALS.iter().find(|(_, e, rho)| within(modulus / 1e9, *e) && within(density, *rho));
    let material = material
        .map_or_else(|| format!("E = {}", engineering(modulus, "Pa")), |(name, ..)| (*name).to_owned());
    let thickness = match number("thickness") {
        Some(thickness) => format!("{} thick", engineering(thickness, "m")),
        None => "of varying thickness".into(),
    };
    // The border of a mesh lies within a curved one, so that more digits say nothing.
    let rounded = |side: f64| format!("{side:.2e}").parse().unwrap_or(side);
    let extent = extent.map(|sides| sides.map(rounded));
    let sides = number("length").zip(number("width")).map(<[f64; 2]>::from).or(extent);
    let size = sides.map(|sides| sides.map(|side| engineering(side, "m")).join(" x "));
    [material, thickness].into_iter().chain(size).collect::<Vec<_>>().join(", ")
}

/// Returns the supports, grouped by kind.
fn supports(scene: &Value) -> String {
    let mut kinds: Vec<(String, Vec<&str>, [usize; 2])> = Vec::new();
    for support in list(scene, "support") {
        let kind = support["kind"].as_str().unwrap_or("supported").replace('_', " ");
        if kinds.last().is_none_or(|(last, ..)| *last != kind) {
            kinds.push((kind, Vec::new(), [0; 2]));
        }
        let Some((_, edges, spots)) = kinds.last_mut() else { continue };
        match support["edge"].as_str() {
            Some(edge) => edges.push(edge),
            None => spots[usize::from(support["radius"].is_null())] += 1,
        }
    }
    let words = |(kind, edges, spots): (String, Vec<&str>, [usize; 2])| {
        let edges = (!edges.is_empty()).then(|| format!("along {}", along(&edges)));
        let spots = spots.into_iter().zip(["bolt", "point"]).filter_map(|(count, place)| match count {
            0 => None,
            1 => Some(format!("at a {place}")),
            count => Some(format!("at {count} {place}s")),
        });
        format!("{kind} {}", edges.into_iter().chain(spots).collect::<Vec<_>>().join(" and "))
    };
    if kinds.is_empty() {
        "free edges".into()
    } else {
        kinds.into_iter().map(words).collect::<Vec<_>>().join(", ")
    }
}

/// Returns edges in words: sides of a rectangle, and curves of a mesh, which have an article where
/// their name is a word.
fn along(edges: &[&str]) -> String {
    let is_side = |edge: &&str| ["left", "right", "bottom", "top"].contains(edge);
    let (sides, curves): (Vec<&str>, Vec<&str>) = edges.iter().partition(|edge| is_side(edge));
    let sides = match sides.as_slice() {
        [] => None,
        [side] => Some(format!("the {side} edge")),
        [.., _, _, _, _] => Some("all edges".into()),
        [others @ .., last] => Some(format!("the {} and {last} edges", others.join(", "))),
    };
    let curve = |name: &str| match name.chars().all(|letter| letter.is_ascii_lowercase()) {
        true => format!("the {name}"),
        false => name.to_owned(),
    };
    sides.into_iter().chain(curves.into_iter().map(curve)).collect::<Vec<_>>().join(", ")
}

fn stop(obstacle: &Value) -> String {
    let side = obstacle["side"].as_str().unwrap_or("below");
    let place = if obstacle["at"].is_array() || obstacle["point"].is_string() { "at a point " } else { "" };
    let stop = match obstacle["stiffness"].as_f64() {
        Some(stiffness) => {
            let law = obstacle["law"].as_str().unwrap_or_default();
            let damping = obstacle["damping"].as_f64().filter(|damping| *damping > 0.0);
            let units = compliance_units(law, |key| !obstacle[key].is_null());
            let numbers = [stiffness].into_iter().chain(damping).zip(units);
            let numbers: Vec<_> = numbers.map(|(number, unit)| engineering(number, &raised(unit))).collect();
            format!("compliant stop of {},", numbers.join(", "))
        }
        None => "rigid stop".into(),
    };
    match obstacle["height"].as_f64() {
        Some(0.0) => format!("a {stop} {place}touching from {side}"),
        Some(height) => format!("a {stop} {place}{} {side}", engineering(height.abs(), "m")),
        None => format!("a {stop} {place}of given height {side}"),
    }
}

fn ball(ball: &Value) -> String {
    let mass = ball["mass"].as_f64().unwrap_or(0.0);
    format!("a ball of {}", engineering(1e3 * mass, "g"))
}

fn loads(scene: &Value) -> Vec<String> {
    let mut parts = Vec::new();
    let mut add = |what: &str, value: &Value, unit: &str| match value.as_f64() {
        Some(0.0) => {}
        Some(number) => parts.push(format!("{what} of {}", engineering(number, unit))),
        None if value.is_null() => {}
        None => {
            let law = if value.is_string() { "formula" } else { "table" };
            parts.push(format!("{what} by a {law}"));
        }
    };
    add("under a pressure", &scene["load"]["pressure"], "Pa");
    add("bent at the start by a pressure", &scene["initial"]["static_pressure"], "Pa");
    add("starts with a velocity", &scene["initial"]["velocity"], "m/s");
    if list(&scene["load"], "force").next().is_some() {
        parts.push("point forces".into());
    }
    let base = &scene["load"]["base_acceleration"];
    if !base.is_null() && base.as_f64() != Some(0.0) {
        parts.push("on a base that accelerates".into());
    }
    if scene["load"]["gravity"].as_f64().is_some_and(|gravity| gravity != 0.0) {
        parts.push("gravity".into());
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::along;

    #[test]
    fn edges_are_told_together() {
        assert_eq!(along(&["left"]), "the left edge");
        assert_eq!(along(&["left", "bottom", "right"]), "the left, bottom and right edges");
        assert_eq!(along(&["left", "right", "bottom", "top"]), "all edges");
        assert_eq!(along(&["boundary", "left", "hole_1"]), "the left edge, the boundary, hole_1");
    }
}
