//! Plates with ribs in motion: one beam with its strip, with the exact scheme, and energies kept
//! through impacts on a mesh of triangles and quadrilaterals.

use crate::common::models::{CLAMPED, STRIP, UNIT_SECTION};
use crate::common::scenes::{Instant, grid, model, run, run_to_end, same};
use rebond::linalg::Engine;
use rebond::simulation::Model;

/// Rib along the middle of a strip whose stiffness and mass are three times those of the strip.
const RIB: &str = "rib = [{ line = [[0, 0.05], [1, 0.05]], bending = 0.3, mass = 0.3 }]\n";

/// Returns a scene of a strip with 8 n x `across` cells that starts from a deflection that does not
/// depend on y, and has the first angular frequency 3.516 rad/s.
fn released(plate: &str, rib: &str, time: &str, [n, across]: [usize; 2]) -> String {
    format!(
        "{plate}{CLAMPED}{}{rib}initial = {{ deflection = \"0.02*x^2*(6 - 4*x + x^2)\" }}\n\
         time = {{ {time}, end = 1 }}\noutput.every = 5\n\
         output.probes = [{{ name = \"tip\", at = [1, 0.05] }}, {{ name = \"inside\", at = [0.43, 0.02] }}]\n",
        grid("fvs", 8 * n, across)
    )
}

/// Returns the strip with four times the stiffness and mass, as one plate.
fn heavier() -> String {
    let heavier =
        STRIP.replace("youngs_modulus = 12", "youngs_modulus = 48").replace("density = 1 ", "density = 4 ");
    assert_ne!(heavier, STRIP);
    heavier
}

/// Returns a bound on how far rounding moves the tip of a released strip within 1 s, in m.
///
/// Rounding changes entries of K, and products with it, by the relative precision e. The elastic
/// energy of the shape U then changes by the part e |U|^T |K| |U| / (U^T K U) at most, and so does
/// the square of the frequency. Half of that, times the phase of 3.516 rad, is the shift relative
/// to the amplitude.
fn rounding(text: &str) -> f64 {
    let Model { system, start, .. } = model(text);
    let u = &start.displacement;
    let (mut force, mut terms) = (vec![0.0; u.len()], vec![0.0; u.len()]);
    system.engine.multiply_with_magnitude(&(&system.stiffness).into(), u, [&mut force, &mut terms]).unwrap();
    let energy: f64 = u.iter().zip(&force).map(|(u, force)| u * force).sum();
    let magnitude: f64 = u.iter().zip(&terms).map(|(u, terms)| u.abs() * terms).sum();
    let amplitude = u.iter().fold(0.0, |most: f64, u| most.max(u.abs()));
    0.5 * 3.516 * amplitude * f64::EPSILON * magnitude / energy
}

/// A strip and its rib along the sides of cells move as one: from a start that does not depend on
/// y, the motion is that of a strip with four times the stiffness and mass, with every scheme and
/// mass, to rounding.
#[test]
fn a_rib_in_proportion_moves_with_its_strip() {
    let heavier = heavier();
    for time in [
        "scheme = \"exact\", mass = \"singular\", step = 1e-2",
        "scheme = \"exact\", mass = \"modal\", modes = 4, step = 1e-2",
        "scheme = \"conserving\", mass = \"modal\", modes = 4, step = 1e-2",
        "scheme = \"newmark\", mass = \"consistent\", step = 2e-3",
        "scheme = \"midpoint\", mass = \"consistent\", step = 2e-3",
    ] {
        let ribbed = released(STRIP, RIB, time, [1, 2]);
        let whole = released(&heavier, "", time, [1, 2]);
        let tolerance = rounding(&ribbed) + rounding(&whole);
        assert!(tolerance <= 1e-9, "{tolerance:e}");
        let whole = run(&whole);
        same(&run(&ribbed), &whole, tolerance);
        let lighter = run(&released(STRIP, &RIB.replace("0.3,", "0.1,"), time, [1, 2]));
        let last = |rows: &[Instant]| rows.last().unwrap().probes[0];
        assert!((last(&lighter) - last(&whole)).abs() > 1e-3, "{time}: a lighter rib changes nothing");
    }
}

/// Along the middle of cells the shapes of the element that bulge across the strip are not cubics
/// in x. The inertia of the rib excites them, which that of the strip, averaged over y, does not:
/// with the consistent mass the strip with its rib moves as one only in the limit of small cells.
/// With the singular mass it does so to rounding.
#[test]
fn a_rib_between_nodes_moves_with_its_strip_in_the_limit() {
    let heavier = heavier();
    for (time, is_consistent) in [
        ("scheme = \"exact\", mass = \"singular\", step = 1e-2", false),
        ("scheme = \"newmark\", mass = \"singular\", step = 2e-3", false),
        ("scheme = \"exact\", mass = \"modal\", modes = 4, step = 1e-2", true),
        ("scheme = \"newmark\", mass = \"consistent\", step = 2e-3", true),
    ] {
        let mut errors = Vec::new();
        for n in [1, 2, 4] {
            let [ribbed, whole] = [(STRIP, RIB), (&heavier, "")].map(|(plate, rib)| {
                let text = released(plate, rib, time, [n, 1]);
                (run(&text), rounding(&text))
            });
            let pairs = ribbed.0.iter().zip(&whole.0).flat_map(|(a, b)| a.probes.iter().zip(&b.probes));
            let off = pairs.fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
            let tolerance = ribbed.1 + whole.1;
            println!("{time}, {n}: {off:e}, rounding {tolerance:e}");
            assert!(is_consistent || off <= tolerance, "{time}, {n}: {off:e}, rounding {tolerance:e}");
            errors.push(off);
        }
        if is_consistent {
            assert!(errors[0] <= 1e-7, "{time}: {errors:?}");
            assert!(errors.windows(2).all(|pair| pair[1] <= pair[0] / 4.0), "{time}: {errors:?}");
        }
    }
}

/// Energies through impacts, and the motion of two schemes, on a refined mesh from Gmsh with
/// triangles and quadrilaterals, which a rib crosses in any direction and another one borders.
#[test]
fn ribs_on_a_mesh_of_two_kinds_of_cells() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/square_41_text.msh");
    let text = |time: &str| {
        format!(
            "plate = {{ {UNIT_SECTION} }}\n{CLAMPED}mesh = {{ file = \"{file}\", refine = 1 }}\n\
             rib = [{{ line = [[0.05, 0.1], [0.93, 0.81]], bending = 0.4, torsion = 0.1, mass = 0.5 }}, \
             {{ edge = \"top\", bending = 0.2, mass = 0.1 }}]\n\
             obstacle = [{{ side = \"below\", height = -0.05, where = \"x > 0.9\" }}]\n\
             initial = {{ static_pressure = 1 }}\ntime = {{ {time}, end = 1.6 }}\noutput.every = 10\n\
             output.probes = [{{ name = \"corner\", at = [1, 1] }}, {{ name = \"joint\", at = [0.55, 0] }}]\n"
        )
    };
    let exact = run_to_end(&text("scheme = \"exact\", mass = \"modal\", modes = 20, step = 1e-3"));
    let conserving = run_to_end(&text("scheme = \"conserving\", mass = \"modal\", modes = 20, step = 1e-3"));
    let cells = run_to_end(&text("scheme = \"conserving\", mass = \"singular\", step = 1e-3"));
    for (rows, outcome) in [&exact, &conserving, &cells] {
        assert!(outcome.contact_steps > 10, "{}", outcome.contact_steps);
        for row in rows {
            let drift = (row.energy / rows[0].energy - 1.0).abs();
            assert!(drift <= 1e-10, "t = {}: {drift:e}", row.time);
        }
    }
    let off = |a: &(Vec<Instant>, _), b: &(Vec<Instant>, _)| {
        let pairs = a.0.iter().zip(&b.0).filter(|(row, _)| row.time <= 1.0);
        pairs.fold(0.0, |most: f64, (a, b)| most.max((a.probes[0] - b.probes[0]).abs()))
    };
    let [splitting, cells] = [off(&exact, &conserving), off(&exact, &cells)];
    println!("splitting {splitting:e}, cells {cells:e}");
    assert!(splitting <= 1e-4 && cells <= 2e-2, "{splitting:e}, {cells:e}");
}
