//! Parameters of all magnitudes and extreme meshes: nothing fails, and each scheme keeps its
//! promise on the energy.

use crate::common::Random;
use crate::common::models::{self, literal, unit_plate};
use crate::common::plates::{Alternating, CLAMPED_LEFT, Fvs, Hct, Left, Matrices, Right};
use rebond::assembly;
use rebond::dof_map::DofMap;
use rebond::linalg::Engine;
use rebond::mesh::{Cell, Mesh, Point};
use rebond::obstacle::Bounds;
use rebond::scene::{ContactSolver, EngineName, Scene, SchemeSpec as Name};
use rebond::scheme::{
    Conserving, Exact, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Solution, Start, System,
};
use rebond::simulation::Model;
use rebond::study::stability::{Ending, run_native, variants};

/// Asserts that no method fails in a hundred steps of 1 ms on a coarse mesh of the paper's plate
/// with changed keys, and that methods with a promise on the energy keep it.
fn holds(changes: &[String]) {
    let text = concat!(
        literal!(PAPER_FALL),
        r#"
        mesh = { element = "fvs", cells = [4, 2] }
        time = { scheme = "newmark", mass = "singular", step = 1e-3, end = 0.1 }
    "#
    );
    let scene = Scene::from_str(text, "sweep", changes).unwrap();
    for (scene, method) in variants(&scene, EngineName::Native, ContactSolver::Condensed) {
        let trial = run_native(&scene, method);
        let what = format!("{changes:?}, {}, {method}: {trial:?}", trial.mesh);
        let promises = match method.scheme {
            Name::Newmark { restitution, .. } => restitution == 0.0,
            scheme => matches!(scheme, Name::Conserving | Name::Exact),
        };
        assert!(!matches!(trial.ending, Ending::Fails(_) | Ending::Refused(_)), "{what}");
        assert!(!promises || trial.ending == Ending::Holds, "{what}");
        assert!(trial.figures.unwrap().penetration <= 1e-12, "{what}");
    }
}

fn set(pairs: &[(&str, f64)]) -> Vec<String> {
    pairs.iter().map(|(key, value)| format!("{key}={value:e}")).collect()
}

#[test]
fn steps_from_1e_8_to_1_s() {
    for step in (-8..=0).map(|power| 10f64.powi(power)) {
        holds(&set(&[("time.step", step), ("time.end", 100.0 * step), ("initial.velocity", -1.0)]));
    }
}

#[test]
fn moduli_from_1_to_1e12_pa() {
    for modulus in (0..=12).map(|power| 10f64.powi(power)) {
        let faster = (modulus / 210e9).sqrt();
        let pressure = 14600.0 * modulus / 210e9;
        holds(&set(&[
            ("plate.youngs_modulus", modulus),
            ("initial.static_pressure", pressure),
            ("time.step", 1e-3 / faster),
            ("time.end", 0.1 / faster),
        ]));
    }
}

#[test]
fn plates_from_a_foil_to_a_block() {
    for thickness in [1e-6, 1e-5, 1e-4, 1e-3, 0.03, 0.1, 0.4] {
        let thinner: f64 = thickness / 0.01;
        holds(&set(&[
            ("plate.thickness", thickness),
            ("initial.static_pressure", 14600.0 * thinner.powi(3)),
            ("time.step", 1e-3 / thinner),
            ("time.end", 0.1 / thinner),
        ]));
    }
}

#[test]
fn gaps_down_to_no_width() {
    for gap in [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-15, 0.0] {
        let gap = format!(
            r#"obstacle=[{{ side = "below", height = -{gap:e} }}, {{ side = "above", height = {gap:e} }}]"#
        );
        let mut changes = set(&[("initial.static_pressure", 0.0), ("initial.velocity", 0.1)]);
        changes.extend(set(&[("time.step", 1e-5), ("time.end", 1e-3)]));
        changes.push(gap);
        holds(&changes);
    }
}

#[test]
fn poissons_ratios_up_to_the_limits() {
    for ratio in [-0.99, -0.5, 0.0, 0.25, 0.49, 0.499, 0.4999999] {
        holds(&set(&[("plate.poissons_ratio", ratio), ("initial.static_pressure", 5000.0)]));
    }
}

/// Returns the largest rise of the energy above its lowest value so far, and its largest change,
/// both relative to the energy at the start. The scheme must touch the obstacle.
fn energy_changes(scheme: &mut dyn Scheme, steps: usize) -> [f64; 2] {
    let energy = scheme.energies().unwrap().total();
    let (mut least, mut rise, mut change) = (energy, 0.0f64, 0.0f64);
    let mut touches = false;
    for _ in 0..steps {
        scheme.advance().unwrap();
        let kkt = scheme.step_report().kkt;
        assert!(kkt <= 1e-9, "step {}: {kkt:e}", scheme.step());
        touches |= scheme.reaction().iter().any(|r| *r != 0.0);
        let now = scheme.invariant().unwrap();
        (rise, change) = (rise.max(now - least), change.max((now - energy).abs()));
        least = least.min(now);
    }
    assert!(touches);
    [rise / energy, change / energy]
}

/// Returns the largest relative change of the energy of the exact scheme. It may refuse motions
/// whose frequencies are too far apart; they count as 0.
fn exact_change(system: &System<rebond::linalg::Native>, start: Start, step: f64, steps: usize) -> f64 {
    match Exact::new(system, step, start) {
        Ok(mut exact) => energy_changes(&mut exact, steps)[1],
        Err(error) => {
            assert!(error.to_string().contains("the slowest motions are lost"), "{error}");
            0.0
        }
    }
}

/// Returns the relative changes of the energies that three schemes promise to conserve, or not to
/// raise.
fn broken(system: &System<rebond::linalg::Native>, start: &Start, step: f64, steps: usize) -> [f64; 3] {
    let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step };
    let mut newmark = Newmark::new(system, parameters, start.clone()).unwrap();
    let mut conserving = Conserving::new(system, step, start.clone()).unwrap();
    let [rise, _] = energy_changes(&mut newmark, steps);
    let [_, change] = energy_changes(&mut conserving, steps);
    [rise, change, exact_change(system, start.clone(), step, steps)]
}

fn system(mesh: Mesh, height: f64) -> (System<rebond::linalg::Native>, Matrices) {
    let plate = Matrices::new(mesh.clone(), models::plate(), CLAMPED_LEFT);
    let bounds = Bounds::uniform(plate.deflections(), height, f64::INFINITY);
    let Matrices { engine, stiffness, singular: mass, .. } =
        Matrices::new(mesh, models::plate(), CLAMPED_LEFT);
    let (damping, drive) = Default::default();
    (System { engine, stiffness, mass, damping, load: None, bounds, bound_numbers: None, drive }, plate)
}

/// Returns a small mesh one interior node of which is displaced until a cell is flat, up to a given
/// share.
fn pinched(kind: &str, share: f64) -> Mesh {
    let element = if kind == "needles" { Hct } else { Fvs };
    let mut mesh = Mesh::rectangle(1.2, 0.4, [4, 2], element, Right).unwrap();
    let node = mesh.nodes.iter().position(|p| (p - Point::new(0.6, 0.2)).norm() < 1e-9).unwrap();
    mesh.nodes[node] = match kind {
        // Triangles get one angle of almost pi; two neighbours of the node are (0.3, 0) and (0.9,
        // 0.4).
        "needles" => Point::new(0.6, 0.2 - 0.2 * (1.0 - share)),
        // The cell above and to the right becomes nearly non-convex: its corners (0.6, 0.4) and
        // (0.9, 0.2) and this one approach a line.
        "nearly not convex" => Point::new(0.75 - 0.15 * share, 0.3 - 0.1 * share),
        // The quadrilateral above becomes a sliver.
        _ => Point::new(0.6, 0.4 - 0.2 * share),
    };
    mesh.check().unwrap();
    mesh
}

/// Returns the largest elastic energy that the rounding of a displacement u (dofs, in m) alone may
/// have, half of eps^2 |u|^T |K| |u|, in J.
fn rounding_energy(plate: &Matrices, u: &[f64]) -> f64 {
    let (mut unit, mut column) = (vec![0.0; u.len()], vec![0.0; u.len()]);
    let mut sum = 0.0;
    for (j, at) in u.iter().enumerate() {
        unit[j] = 1.0;
        plate.engine.multiply(&plate.stiffness, &unit, &mut column).unwrap();
        unit[j] = 0.0;
        sum += column.iter().zip(u).map(|(k, of)| (k * of * at).abs()).sum::<f64>();
    }
    0.5 * f64::EPSILON.powi(2) * sum
}

/// No displacement in doubles has an energy that is known better than the energy of its rounding,
/// which grows as the fifth power of a needle's length. That of needles 15 000 times longer than
/// wide is 5e-10 of the plate's. Over the two hundred steps, sixty starts that differ by a
/// thousandth from each other change the energy by 0.3 to 6 times that with Newmark's scheme, and
/// by at most 0.3 times that with the others.
#[test]
fn cells_that_are_nearly_flat() {
    for kind in ["needles", "nearly not convex", "slivers"] {
        // A needle here is 1.5 / share times longer than wide.
        for share in [1e-1, 1e-2, 1e-3, 1e-4] {
            let (system, plate) = system(pinched(kind, share), -0.1);
            let displacement = plate.statics(14600.0);
            let elastic = 0.5
                * plate.engine.multiply(&plate.stiffness, &displacement, &mut displacement.clone()).unwrap();
            let rounding = rounding_energy(&plate, &displacement) / elastic;
            let start = Start { displacement, velocity: vec![0.0; plate.space.dofs()] };
            let broken = broken(&system, &start, 5e-4, 200);
            println!(
                "{kind}, {share}: rounding {rounding:.1e}, newmark, conserving, exact broken by {broken:?}"
            );
            let kept = [8.0, 1.0, 1.0].map(|roundings| 1e-11 + roundings * rounding);
            assert!(broken.iter().zip(kept).all(|(of, kept)| *of <= kept), "{kind}, {share}: {broken:?}");
        }
    }
}

/// For cells a million times longer than wide, where rounding prevents an accurate answer, the
/// message names the cell.
#[test]
fn cells_that_are_too_flat() {
    let mesh = pinched("needles", 1e-7);
    let error =
        assembly::cells(&mesh, &DofMap::new(&mesh, []).unwrap(), &models::plate()).unwrap_err().to_string();
    assert!(error.starts_with("cell ") && error.contains("too flat"), "{error}");
}

/// Number of starts whose median is judged where one start is a throw of dice.
const STARTS: usize = 21;

/// A strip of one row of cells that are a hundred and a thousand times longer than wide. With nu =
/// 0 a couple at its end bends it to x^2/2, which every cell contains, and a pressure bends it like
/// a beam, to q L^4 / 8 D. A strip of steel makes 10 000 steps against an obstacle.
///
/// On triangles 100 times longer than wide each impact of the exact scheme changes the energy by
/// some 1e-10, at random. Sixty starts that differ by a thousandth end up between 2e-10 and 2e-9,
/// a quarter of them above 1e-9. That case is judged by the median of many starts.
#[test]
fn cells_a_thousand_times_longer_than_wide() {
    for (element, aspect, kept) in [(Fvs, 1e2, 1e-11), (Hct, 1e2, 1e-11), (Fvs, 1e3, 1e-9), (Hct, 1e3, 1e-9)]
    {
        let width = 0.1 / aspect;
        let mesh = Mesh::rectangle(1.0, width, [10, 1], element, Right).unwrap();
        let plate = Matrices::new(mesh.clone(), unit_plate(0.0), CLAMPED_LEFT);
        let mut couple = vec![0.0; plate.space.dofs()];
        for node in mesh.edge_nodes("right").unwrap() {
            let slope = plate.space.dofs_of(&[node]).nth(1).unwrap().unwrap();
            couple[slope] = 0.5 * width;
        }
        let (u, _, _) =
            rebond::scheme::equilibrium(&plate.engine, &plate.stiffness, &couple, &Bounds::default())
                .unwrap();
        let bent = (plate.at(&u, 1.0, 0.0) / 0.5 - 1.0).abs();
        let beam = (plate.at(&plate.statics(1.0), 1.0, 0.0) * 8.0 - 1.0).abs();
        let mesh = Mesh::rectangle(1.2, 1.2 * width, [10, 1], element, Right).unwrap();
        let (system, plate) = system(mesh, -0.1);
        let start = Start { displacement: plate.statics(14600.0), velocity: vec![0.0; plate.space.dofs()] };
        let mut broken = broken(&system, &start, 5e-4, 10_000);
        if element == Hct && aspect == 1e2 {
            let velocity = vec![0.0; plate.space.dofs()];
            let mut changes: Vec<f64> = (1..STARTS)
                .map(|k| plate.statics(14600.0 * (1.0 + 1e-3 * k as f64 / STARTS as f64)))
                .map(|u| Start { displacement: u, velocity: velocity.clone() })
                .map(|start| exact_change(&system, start, 5e-4, 10_000))
                .chain([broken[2]])
                .collect();
            changes.sort_by(f64::total_cmp);
            println!("{element:?} {aspect}: exact from {:e} to {:e}", changes[0], changes[STARTS - 1]);
            assert!(changes[STARTS - 1] <= 5e-9, "{element:?} {aspect}: {changes:?}");
            broken[2] = changes[STARTS / 2];
        }
        println!("{element:?} {aspect}: bent {bent:e}, beam {beam:e}, broken {broken:?}");
        assert!(bent <= kept && beam <= 2e-3, "{element:?} {aspect}: {bent:e}, {beam:e}");
        assert!(broken.iter().all(|broken| *broken <= 1e-9), "{element:?} {aspect}: {broken:?}");
    }
}

/// All inner nodes are displaced at random, until cells are nearly flat.
#[test]
fn jitter() {
    let mut random = Random::new(11);
    for (element, diagonal) in [(Fvs, Right), (Hct, Right), (Hct, Left), (Hct, Alternating)] {
        for _ in 0..4 {
            let mut mesh = Mesh::rectangle(1.2, 0.4, [6, 4], element, diagonal).unwrap();
            for node in 0..mesh.nodes.len() {
                let at = mesh.nodes[node];
                if at.x <= 0.0 || at.x >= 1.2 - 1e-9 || at.y <= 0.0 || at.y >= 0.4 - 1e-9 {
                    continue;
                }
                // The displacement is as large as the cells allow.
                let [dx, dy] = [0.15 * random.signed(), 0.08 * random.signed()];
                for share in [1.0, 0.5, 0.25, 0.0] {
                    mesh.nodes[node] = Point::new(at.x + share * dx, at.y + share * dy);
                    if mesh.check().is_ok() {
                        break;
                    }
                }
            }
            let (system, plate) = system(mesh, -0.1);
            let start =
                Start { displacement: plate.statics(14600.0), velocity: vec![0.0; plate.space.dofs()] };
            let broken = broken(&system, &start, 5e-4, 150);
            println!("{element:?} {diagonal:?}: {broken:?}");
            assert!(broken.iter().all(|broken| *broken <= 1e-7), "{element:?} {diagonal:?}: {broken:?}");
        }
    }
}

/// One node is displaced or struck, which excites all high frequencies of the mesh, in contact from
/// the start.
#[test]
fn one_node_displaced_or_struck() {
    for (element, diagonal) in [(Fvs, Right), (Hct, Right), (Hct, Alternating)] {
        let mesh = Mesh::rectangle(1.2, 0.4, [6, 3], element, diagonal).unwrap();
        let (system, plate) = system(mesh, -1e-4);
        let dofs = plate.space.dofs();
        for which in [3, plate.deflections().len() - 1] {
            let dof = plate.deflections()[which];
            let mut unit = vec![0.0; dofs];
            unit[dof] = 1e-3;
            let struck = unit.iter().map(|u| 1e3 * u).collect();
            for start in [
                Start { displacement: unit.clone(), velocity: vec![0.0; dofs] },
                Start { displacement: vec![0.0; dofs], velocity: struck },
            ] {
                let broken = broken(&system, &start, 1e-4, 200);
                assert!(broken.iter().all(|broken| *broken <= 1e-9), "{element:?}: {broken:?}");
                // The midpoint rule may gain energy, but each of its steps must be solved.
                for massless in [Massless::Equilibrium, Massless::Reflected] {
                    let mut midpoint = Midpoint::new(&system, 1e-4, massless, start.clone()).unwrap();
                    for _ in 0..200 {
                        midpoint.advance().unwrap();
                        assert!(midpoint.step_report().kkt <= 1e-10);
                    }
                }
            }
        }
    }
}

/// Cells of both kinds with some needles, such as Gmsh's recombination leaves.
#[test]
fn triangles_and_quadrilaterals_together() {
    let mut mesh = Mesh::rectangle(1.2, 0.4, [6, 2], Fvs, Right).unwrap();
    let cells = std::mem::take(&mut mesh.cells);
    for (number, cell) in cells.into_iter().enumerate() {
        match cell {
            Cell::Quadrilateral([a, b, c, d]) if number % 3 != 0 => {
                mesh.cells.extend([Cell::Triangle([a, b, c]), Cell::Triangle([a, c, d])]);
            }
            cell => mesh.cells.push(cell),
        }
    }
    mesh.check().unwrap();
    let (system, plate) = system(mesh, -0.1);
    let start = Start { displacement: plate.statics(14600.0), velocity: vec![0.0; plate.space.dofs()] };
    let broken = broken(&system, &start, 5e-4, 200);
    assert!(broken.iter().all(|broken| *broken <= 1e-10), "{broken:?}");
}

/// Two triangles on a guided edge have rigid motions only: their eigenvalues are all rounding, and
/// the impact occurs at the correct time.
#[test]
fn all_motions_are_rigid() {
    let text = r#"
        plate = { length = 1, width = 0.3, thickness = 0.005, youngs_modulus = 1e7, poissons_ratio = 0, density = 1 }
        mesh = { element = "hct", cells = [1, 1] }
        support = [{ edge = "bottom", kind = "guided" }]
        obstacle = [{ side = "below", height = -0.02 }]
        initial = { velocity = -1 }
        time = { scheme = "exact", mass = "singular", step = 1e-3, end = 0.05 }
    "#;
    let scene = Scene::from_str(text, "rigid", &[]).unwrap();
    let model = Model::new(&scene).unwrap();
    let mut scheme = model.scheme(&scene).unwrap();
    let start = scheme.energies().unwrap().total();
    let mut first = None;
    for _ in 0..scene.time.steps() {
        scheme.advance().unwrap();
        first = first.or(scheme.take_events().first().map(|event| event.time));
        assert!((scheme.energies().unwrap().total() / start - 1.0).abs() <= 1e-10);
    }
    assert!((first.unwrap() - 0.02).abs() <= 1e-12, "{first:?}");
}
