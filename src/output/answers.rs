//! Answers of a run, in engineering units: what it was made for, from its summary.

use super::text::{engineering, place, short};
use serde_json::Value;

/// Part of an energy of a run, relative to the largest, below which it is rounding.
const ROUNDING: f64 = 1e-6;

/// Part of an energy, relative to the largest part, below which it is rounding.
pub(super) const EQUAL: f64 = 1e-9;

/// Part of an energy, relative to the largest part, that four digits do not show.
const TINY: f64 = 1e-5;

/// Largest number of stops, and of supports, among the answers.
const MOST_FORCES: usize = 8;

/// Key figure of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyFigure {
    /// Title of one or two words, or the name of a stop or support.
    pub title: String,
    /// Quantity in engineering units, with its place and time.
    pub text: String,
    /// Whether it is the force of a support.
    pub is_support: bool,
}

/// Returns the answers of a run, the most important ones first, from its `summary.json`.
pub fn answers(summary: &Value) -> Vec<KeyFigure> {
    let mut answers = Vec::new();
    let supports = summary["scene"]["support"].as_array().into_iter().flatten();
    let supports: Vec<&str> = supports.filter_map(|support| support["name"].as_str()).collect();
    let mut add = |title: &str, text: Option<String>| {
        let is_support = supports.contains(&title);
        answers.extend(text.map(|text| KeyFigure { title: title.to_owned(), text, is_support }));
    };
    add("largest deflection", located(&summary["largest_deflection"], "m"));
    add("largest stress", stress(&summary["extremes"]["von_mises"]));
    add("first impact", first_impact(summary));
    add("contacts", contacts(summary));
    let mut forces: Vec<(&String, &Value)> = summary["forces"].as_object().into_iter().flatten().collect();
    // Obstacles with names of their own come first, supports last.
    forces.sort_by_key(|(name, _)| name.starts_with("obstacle_"));
    let (held, met): (Vec<_>, Vec<_>) =
        forces.into_iter().partition(|(name, _)| supports.contains(&name.as_str()));
    // Energy over deflection is the size of forces; much smaller ones are rounding.
    let most =
        summary["energy"]["stored"].as_array().into_iter().flatten().chain([&summary["energy"]["max"]]);
    let most = most.filter_map(Value::as_f64).fold(0.0, |most: f64, energy| most.max(energy.abs()));
    let deflection = summary["largest_deflection"]["value"].as_f64().unwrap_or(0.0).abs();
    let least = if deflection > 0.0 { EQUAL * most / deflection } else { 0.0 };
    let lost = &summary["dissipated"];
    for (name, force) in [&met, &held].into_iter().flat_map(|forces| forces.iter().take(MOST_FORCES)) {
        let heat = quantity(&lost[name], "J").map_or(String::new(), |heat| format!(", {heat} dissipated"));
        let is_rounding = force["peak"].as_f64().is_some_and(|peak| peak != 0.0 && peak.abs() <= least);
        let told = if is_rounding { "no force".to_owned() + &moment_of(force) } else { force_of(force) };
        add(name, Some(told + &heat));
    }
    let others: usize = [met, held].iter().map(|forces| forces.len().saturating_sub(MOST_FORCES)).sum();
    add("...", (others > 0).then(|| format!("{others} more stops and supports in summary.json")));
    let of_others = |(name, _): &(&String, &Value)| summary["forces"][name].is_null();
    for (name, lost) in lost.as_object().into_iter().flatten().filter(of_others) {
        add(name, quantity(lost, "J").map(|lost| format!("{lost} dissipated")));
    }
    add("energy", energy(summary));
    answers
}

fn quantity(value: &Value, unit: &str) -> Option<String> {
    Some(engineering(value.as_f64()?, unit))
}

/// Returns the place in a value of coordinates, in m.
fn place_of(point: &Value) -> Option<String> {
    Some(place([point[0].as_f64()?, point[1].as_f64()?]))
}

/// Returns a value with its place and time.
fn located(largest: &Value, unit: &str) -> Option<String> {
    let (value, time) = (quantity(&largest["value"], unit)?, quantity(&largest["time"], "s")?);
    Some(format!("{value} at {}, {time}", place_of(&largest["at"])?))
}

fn stress(largest: &Value) -> Option<String> {
    let side = if largest["surface"] == "bottom" { "lower" } else { "upper" };
    Some(format!("{}, {side} surface (von Mises)", located(largest, "Pa")?))
}

fn first_impact(summary: &Value) -> Option<String> {
    let impact = &summary["first_impact"];
    let Some(time) = quantity(&impact["time"], "s") else {
        return (summary["bounded_dofs"] != 0).then(|| "none: nothing touched".to_owned());
    };
    if impact["time"] == 0.0 && impact["velocity"] == 0.0 {
        return Some("touches from the start".to_owned());
    }
    let speed = engineering(impact["velocity"].as_f64()?.abs(), "m/s");
    Some(format!("{time} at {}, closing at {speed}", place_of(&impact["at"])?))
}

fn contacts(summary: &Value) -> Option<String> {
    let count = summary["contacts"].as_array()?.len();
    let (steps, touching) = (summary["steps"].as_f64()?, summary["contact_steps"].as_f64()?);
    let seconds = touching * summary["scene"]["time"]["step"].as_f64()?;
    let share = 100.0 * touching / steps.max(1.0);
    (count > 0).then(|| format!("{count}, {} in all ({share:.1} % of the run)", engineering(seconds, "s")))
}

/// Returns force and impulse of an obstacle or a support.
pub(super) fn force_of(force: &Value) -> String {
    let (Some(peak), Some(time), Some(impulse)) = (
        quantity(&force["peak"], "N"),
        quantity(&force["time_of_peak"], "s"),
        quantity(&force["impulse"], "N s"),
    ) else {
        return "untouched".into();
    };
    let hardest = &force["hardest"];
    let hardest = || Some((quantity(&hardest["impulse"], "N s")?, quantity(&hardest["time"], "s")?));
    let more = match (force["impacts"].as_u64(), hardest()) {
        (Some(1), _) => ", 1 contact".into(),
        (Some(count), Some((impulse, time))) => {
            format!(", {count} contacts, the hardest {impulse} at {time}")
        }
        (Some(count), None) => format!(", {count} contacts"),
        (None, _) => moment_of(force),
    };
    format!("peak force {peak} at {time}, impulse {impulse}{more}")
}

/// Returns the largest moment of a support after a comma; empty where there is none.
fn moment_of(force: &Value) -> String {
    let [x, y] = [0, 1].map(|axis| force["peak_moment"][axis].as_f64().unwrap_or(0.0));
    match x.hypot(y) {
        0.0 => String::new(),
        moment => format!(", moment up to {}", engineering(moment, "N m")),
    }
}

/// Returns how damping, the dashpots of stops, friction and impacts share an energy lost, in J, in
/// parentheses; empty where nothing but what is left of it is known.
fn shares(lost: f64, summary: &Value) -> String {
    let damped = ["obstacle", "ball"].into_iter().flat_map(|kind| {
        let items = summary["scene"][kind].as_array().into_iter().flatten().zip(1..);
        let damped = items.filter(|(item, _)| item["damping"].as_f64().is_some_and(|damping| damping > 0.0));
        damped.map(move |(item, k)| item["name"].as_str().map_or(format!("{kind}_{k}"), str::to_owned))
    });
    let damped: Vec<String> = damped.collect();
    let [mut stops, mut friction] = [0.0; 2];
    for (name, heat) in summary["dissipated"].as_object().into_iter().flatten() {
        *if damped.contains(name) { &mut stops } else { &mut friction } += heat.as_f64().unwrap_or(0.0);
    }
    let rest = lost - stops - friction;
    // The ledger of a scheme that loses nothing itself has damping and stops.
    let ledger = summary["relaxation"]["dissipated"].as_f64();
    let is_damped = ["damping", "dashpot"].iter().any(|key| !summary["scene"][key].is_null());
    let others = match ledger {
        Some(taken) if (taken + friction - lost).abs() <= ROUNDING * lost => "by damping",
        _ if stops + friction == 0.0 => return String::new(),
        _ if is_damped => "by damping and impacts",
        _ => "by impacts",
    };
    // A scheme that gains energy at impacts loses less than the stops take.
    let gained = if -rest > TINY * lost { -rest } else { 0.0 };
    let parts = [
        (rest, others),
        (stops, "by stops"),
        (friction, "by friction"),
        (gained, "less that the scheme gained"),
    ];
    let parts = parts.into_iter().filter(|(part, _)| *part > EQUAL * lost);
    let parts: Vec<String> = parts.map(|(part, by)| format!("{} {by}", engineering(part, "J"))).collect();
    if parts.is_empty() { String::new() } else { format!(" ({})", parts.join(", ")) }
}

/// Returns what is left of the energy where nothing but the scheme may lose any, otherwise its
/// balance.
fn energy(summary: &Value) -> Option<String> {
    let energy = &summary["energy"];
    let number = |key: &str| energy[key].as_f64();
    let (start, end, min, max) = (number("start")?, number("end")?, number("min")?, number("max")?);
    let stored = |end: usize| energy["stored"][end].as_f64();
    // Energies that come and go within the run leave rounding.
    let rounding = EQUAL * min.abs().max(max.abs());
    let parts = [stored(0)?, number("put_in")?, number("lost")?, stored(1)?]
        .map(|part| if part.abs() > rounding { part } else { 0.0 });
    let largest = parts.iter().fold(0.0, |largest: f64, part| largest.max(part.abs()));
    // Where a load does most of the work, the energy at the start is no measure.
    let is_measure = start > ROUNDING * min.abs().max(max.abs()) && parts[0] > 0.1 * largest;
    if is_measure && summary["conservative"] == true {
        let most = (max - start).max(start - min) / start.abs();
        let (kept, most) = (100.0 * end / start, short(100.0 * most));
        return Some(format!("{kept:.2} % of {} kept, largest change {most} %", engineering(start, "J")));
    }
    let [from, put_in, lost, to] =
        parts.map(|part| engineering(if part.abs() > TINY * largest { part } else { 0.0 }, "J"));
    let lost = match parts[2] / largest.max(f64::MIN_POSITIVE) {
        share if share > EQUAL => format!("{lost} lost{}", shares(parts[2], summary)),
        share if share < -EQUAL => format!("{} gained by the scheme", engineering(-parts[2], "J")),
        _ => "0 J lost".to_owned(),
    };
    Some(format!("{from} at the start, {put_in} put in, {lost}, {to} at the end"))
}

#[cfg(test)]
mod tests {
    use super::answers;
    use serde_json::json;

    #[test]
    fn named_things_come_first_and_supports_last() {
        let mut forces = json!({ "bolt": {}, "wall": {} });
        (1..=9).for_each(|number| forces[format!("obstacle_{number}")] = json!({}));
        let scene = json!({ "support": [{ "edge": "left" }, { "name": "bolt" }] });
        let answers = answers(&json!({ "forces": forces, "scene": scene }));
        let place = |title: &str| answers.iter().position(|answer| answer.title == title);
        let places = ["wall", "obstacle_1", "bolt", "..."].map(place);
        assert!(places[0].is_some() && places.is_sorted(), "{answers:?}");
        assert_eq!(answers.iter().filter(|answer| answer.is_support).count(), 1);
        assert!(answers.last().is_some_and(|answer| answer.text.starts_with("2 more")), "{answers:?}");
    }

    #[test]
    fn a_loss_is_told_by_who_took_it() {
        let told = |lost: f64, scene, ledger: Option<f64>| {
            let dissipated = json!({ "obstacle_2": 0.5, "rail": 0.25 });
            super::shares(
                lost,
                &json!({ "dissipated": dissipated, "scene": scene, "relaxation":
                { "dissipated": ledger } }),
            )
        };
        let stops = json!([{ "name": "rail" }, { "damping": 3.0 }]);
        let scene = json!({ "obstacle": stops, "damping": { "mass": 1.0 } });
        let undamped = json!({ "obstacle": stops });
        let taken = "500 mJ by stops, 250 mJ by friction";
        assert_eq!(told(1.0, scene.clone(), Some(0.75)), format!(" (250 mJ by damping, {taken})"));
        assert_eq!(told(1.0, scene, None), format!(" (250 mJ by damping and impacts, {taken})"));
        assert_eq!(told(1.0, undamped.clone(), None), format!(" (250 mJ by impacts, {taken})"));
        assert_eq!(told(0.7, undamped, None), format!(" ({taken}, 50 mJ less that the scheme gained)"));
        assert_eq!(super::shares(1.0, &json!({})), "");
    }

    #[test]
    fn energy_is_told_by_what_it_is_a_share_of() {
        let told = |start: f64, put_in: f64, lost: f64| {
            let end = start + put_in - lost;
            let energy = json!({ "start": start, "end": start - lost, "min": 0.0, "max": start, "put_in": put_in,
                "lost": lost, "stored": [start, end] });
            super::energy(&json!({ "conservative": true, "energy": energy })).unwrap()
        };
        assert_eq!(told(2.0, 0.0, 0.5), "75.00 % of 2 J kept, largest change 100 %");
        assert_eq!(told(1e-6, 2.0, 0.0), "0 J at the start, 2 J put in, 0 J lost, 2 J at the end");
        assert_eq!(
            told(0.0, 1.0, -2.0),
            "0 J at the start, 1 J put in, 2 J gained by the scheme, 3 J at the end"
        );
        // A load has put in 0.4 nJ and taken it back, up to rounding.
        let energy = json!({ "start": 0.0, "end": 1.6e-20, "min": -4e-10, "max": 1.7e-20, "put_in": -1.6e-20,
            "lost": -1.6e-20, "stored": [0.0, 1e-29] });
        assert_eq!(
            super::energy(&json!({ "conservative": false, "energy": energy })).unwrap(),
            "0 J at the start, 0 J put in, 0 J lost, 0 J at the end"
        );
    }
}
