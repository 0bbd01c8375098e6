//! Obstacles and supports at points and along lines that are no nodes of the mesh.

use crate::common::models::{CLAMPED, UNIT};
use crate::common::scenes::{
    STILL, close, grid, inspect, model, newmark, refusal, run, run_to_end, scene, start,
};
use rebond::simulation::Model;
use rebond::study;

const PRESSED: &str = "initial.static_pressure = -1\n";
const PROBES: &str = "output.probes = [{ name = \"corner\", at = [1, 1] }, { name = \"in\", at = [0.85, 0.15] }, { name = \"at\", at = [0.7, 0.4] }]\n";

/// Returns the deflections at the probes on a mesh.
fn deflections(mesh: &str, rest: &str) -> Vec<f64> {
    start(&[UNIT, mesh, rest, PRESSED, PROBES, STILL].concat())
}

/// A stop, a support and a rail lie between nodes: the deflections equal those on meshes that have
/// the nodes, and converge to the same values.
#[test]
fn deflections_do_not_depend_on_where_the_nodes_are() {
    let on = [
        "obstacle = [{ side = \"below\", height = -0.01, at = [0.7, 0.4] }]\n",
        "obstacle = [{ side = \"below\", height = -0.01, line = [[0.7, 0.2], [0.7, 0.8]] }]\n",
    ];
    let supported = "support = [{ edge = \"left\", kind = \"clamped\" }, { at = [0.7, 0.4], kind = \"simply_supported\" }]\n";
    let cases = [[CLAMPED, on[0]].concat(), [CLAMPED, on[1]].concat(), supported.to_owned()];
    for rest in cases {
        let fine = deflections(&grid("fvs", 20, 20), &rest);
        let largest = fine.iter().fold(0.0, |most: f64, w| most.max(w.abs()));
        for element in ["fvs", "hct"] {
            for (cells, tolerance) in [([7, 6], 0.025), ([13, 14], 0.006)] {
                let found = deflections(&grid(element, cells[0], cells[1]), &rest);
                for (found, fine) in found.iter().zip(&fine).take(2) {
                    let error = (found - fine).abs() / largest;
                    assert!(
                        error <= tolerance,
                        "{rest}{element}, {cells:?}: {found} for {fine}: {error:.1e}"
                    );
                }
                assert!((found[2] - fine[2]).abs() <= 1e-4, "{} at the point, {}", found[2], fine[2]);
            }
        }
    }
}

/// A plate that a washer clamps has a limit under refinement, and one that a point clamps has none;
/// a mesh too coarse for the washer is told.
#[test]
fn a_washer_holds_slopes() {
    let first = |cells: usize, radius: &str| {
        let support = format!("support = [{{ at = [0.5, 0.5], kind = \"clamped\"{radius} }}]\n");
        let text = [UNIT, &grid("fvs", cells, cells), &support, STILL].concat();
        let check = study::check(&scene(&text)).unwrap();
        (check.frequencies.lowest[0], check.warnings.iter().any(|warning| warning.contains("support.0")))
    };
    let [coarse, fine] = [16, 48].map(|cells| first(cells, ", radius = 0.1251"));
    let [bare_coarse, bare_fine] = [16, 48].map(|cells| first(cells, ""));
    assert!(!coarse.1 && !fine.1 && bare_fine.1 && first(4, ", radius = 0.1251").1);
    let falls = |[coarse, fine]: [f64; 2]| (coarse - fine).abs() / fine;
    let [washer, bare] = [falls([coarse.0, fine.0]), falls([bare_coarse.0, bare_fine.0])];
    assert!(washer < 0.05 && bare > 2.5 * washer, "{washer} with a washer, {bare} without");
}

/// Each stop between nodes bounds one dof at its place; the inf-sup condition holds there too.
#[test]
fn points_are_single_bounds() {
    for element in ["fvs", "hct"] {
        let stops = "obstacle = [{ side = \"below\", height = -0.1, at = [0.31, 0.42] }, { side = \"above\", height = 0.2, at = [0.93, 0.95] }, { side = \"below\", height = -0.1, at = [0.52, 0.49] }]\n";
        let text = [UNIT, &grid(element, 4, 4), CLAMPED, stops, STILL].concat();
        let model = model(&text);
        let bounds = &model.system.bounds;
        let mut found: Vec<_> = (0..bounds.len()).map(|i| (model.sites[i].at, bounds.lower[i])).collect();
        found.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]));
        let places: Vec<[f64; 2]> = found.iter().map(|(at, _)| *at).collect();
        assert_eq!(places, [[0.31, 0.42], [0.52, 0.49], [0.93, 0.95]]);
        assert_eq!(found[2].1, f64::NEG_INFINITY);
        let inspection = inspect(&text);
        assert!(inspection.inf_sup.raw.unwrap() > 1e-6, "{:?}", inspection.inf_sup);
        close("mass", inspection.mass, 1.0, 1e-12);
    }
}

/// Every scheme stops the plate at a point between nodes.
#[test]
fn every_scheme_stops_at_the_point() {
    let rest = "obstacle = [{ side = \"below\", height = -0.02, at = [0.7, 0.4] }]\nload.pressure = -1\n";
    for (scheme, mass) in [
        ("newmark", "singular"),
        ("newmark", "consistent"),
        ("midpoint", "singular"),
        ("conserving", "singular"),
        ("exact", "singular"),
    ] {
        let time = format!("time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = 1e-3, end = 0.4 }}\n");
        let (rows, outcome) = run_to_end(&[UNIT, &grid("fvs", 4, 3), CLAMPED, rest, PROBES, &time].concat());
        let lowest = rows.iter().map(|row| row.probes[2]).fold(f64::INFINITY, f64::min);
        assert!(
            (lowest + 0.02).abs() <= 1e-3 && outcome.most_contact_nodes == 1,
            "{scheme}, {mass}: {lowest}"
        );
        if matches!(scheme, "conserving" | "exact") {
            let drift = rows.iter().map(|row| (row.energy - rows[0].energy).abs()).fold(0.0, f64::max);
            assert!(drift <= 1e-8, "{scheme}: {drift:e}");
        }
    }
}

/// A check lists the nodes that were made. Where the mesh has the nodes it lists none, and the run
/// is unchanged to the bit.
#[test]
fn a_check_lists_the_nodes() {
    let text = |at: &str| {
        let stop = format!("obstacle = [{{ side = \"below\", height = -0.01, at = {at} }}]\n");
        [
            UNIT,
            &grid("fvs", 4, 4),
            CLAMPED,
            &stop,
            "load.pressure = -1\n",
            &newmark("singular", 1e-3, 0.1),
            PROBES,
        ]
        .concat()
    };
    let made = |at: &str| study::check(&scene(&text(at))).unwrap().made_nodes;
    assert_eq!(made("[0.75, 0.5]"), [""; 0]);
    assert_eq!(made("[0.63, 0.62]"), ["(0.63, 0.62)"]);
    assert_eq!(made("[0.74, 0.51]"), ["(0.74, 0.51) moved from (0.75, 0.5)"]);
    let by_place = text("[0.75, 0.5]");
    let by_condition = by_place.replace("at = [0.75, 0.5] }", "where = \"x == 0.75 and y == 0.5\" }");
    assert_ne!(by_place, by_condition);
    for (one, other) in run(&by_place).iter().zip(run(&by_condition)) {
        assert_eq!((one.energy, &one.probes), (other.energy, &other.probes));
    }
}

/// Springs, masses, forces and probes may be at any point, with or without nodes made near them.
#[test]
fn what_is_attached_is_where_it_was() {
    let rest = "spring = [{ at = [0.61, 0.33], stiffness = 5 }]\nmass = [{ at = [0.93, 0.71], mass = 0.2 }]\n\
                load = { gravity = 1, force = [{ at = [0.37, 0.84], value = -0.5 }] }\ninitial.equilibrium = true\n";
    let free = start(&[UNIT, &grid("fvs", 8, 8), CLAMPED, rest, PROBES, STILL].concat());
    // A stop that is never reached changes only the mesh.
    let stop = "obstacle = [{ side = \"below\", height = -9, at = [0.66, 0.47] }]\n";
    let stopped = start(&[UNIT, &grid("fvs", 8, 8), CLAMPED, rest, stop, PROBES, STILL].concat());
    for (free, stopped) in free.iter().zip(&stopped) {
        close("deflection", *stopped, *free, 1e-3);
    }
}

#[test]
fn points_that_cannot_be_nodes_are_refused() {
    let of = |at: &str| {
        let stop = format!("obstacle = [{{ side = \"below\", height = -0.01, at = {at} }}]\n");
        let error = refusal(&[UNIT, &grid("fvs", 4, 4), CLAMPED, &stop, STILL].concat());
        assert_eq!(error.exit_code(), 2);
        error.to_string()
    };
    let outside = of("[0.5, 1.1]");
    assert!(outside.starts_with("obstacle.0.at: the point (0.5, 1.1) lies outside the plate"), "{outside}");
    let near = of("[0.5, 0.99995]");
    assert!(
        near.starts_with("obstacle.0.at: a node at (0.5, 0.99995)") && near.ends_with("(0.5, 1)"),
        "{near}"
    );
    // A point on an edge, or within rounding of it, is accepted.
    for y in ["1", "0.9999999", "1.0000001"] {
        let stop = format!("obstacle = [{{ side = \"below\", height = -0.01, at = [0.4, {y}] }}]\n");
        let model = Model::new(&scene(&[UNIT, &grid("hct", 4, 4), CLAMPED, &stop, STILL].concat())).unwrap();
        assert_eq!(model.sites[0].at, [0.4, 1.0]);
        assert_eq!(model.system.bounds.len(), 1);
    }
}
