//! Plates with ribs in motion: one beam with its strip, with the exact scheme, and energies kept
//! through impacts on a mesh of triangles and quadrilaterals.

use crate::common::models::{CLAMPED, STRIP, UNIT_SECTION};
use crate::common::scenes::{grid, run, run_to_end, same};

/// A rib along the middle of a strip whose stiffness and mass are three times those of the strip
/// moves with it as one: from a start that does not depend on y, the motion is that of a strip with
/// four times the stiffness and mass, with every scheme and mass.
#[test]
fn a_rib_in_proportion_moves_with_its_strip() {
    let heavier =
        STRIP.replace("youngs_modulus = 12", "youngs_modulus = 48").replace("density = 1 ", "density = 4 ");
    assert_ne!(heavier, STRIP);
    let rib = "rib = [{ line = [[0, 0.05], [1, 0.05]], bending = 0.3, mass = 0.3 }]\n";
    for (element, across) in [("fvs", 1), ("fvs", 2)] {
        for time in [
            "scheme = \"exact\", mass = \"singular\", step = 1e-2",
            "scheme = \"exact\", mass = \"modal\", modes = 4, step = 1e-2",
            "scheme = \"conserving\", mass = \"modal\", modes = 4, step = 1e-2",
            "scheme = \"newmark\", mass = \"consistent\", step = 2e-3",
        ] {
            let text = |plate: &str, rib: &str| {
                format!(
                    "{plate}{CLAMPED}{}{rib}initial = {{ deflection = \"0.02*x^2*(6 - 4*x + x^2)\" }}\n\
                     time = {{ {time}, end = 1 }}\noutput.every = 5\n\
                     output.probes = [{{ name = \"tip\", at = [1, 0.05] }}, {{ name = \"inside\", at = [0.43, 0.02] }}]\n",
                    grid(element, 8, across)
                )
            };
            let (ribbed, whole) = (run(&text(STRIP, rib)), run(&text(&heavier, "")));
            same(&ribbed, &whole, 1e-6);
            let bare = run(&text(STRIP, &rib.replace("0.3,", "0.1,")));
            let last = |rows: &[crate::common::scenes::Instant]| rows.last().unwrap().probes[0];
            assert!((last(&bare) - last(&whole)).abs() > 1e-3, "{time}: a lighter rib changes nothing");
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
    let off = |a: &(Vec<crate::common::scenes::Instant>, _), b: &(Vec<crate::common::scenes::Instant>, _)| {
        let pairs = a.0.iter().zip(&b.0).filter(|(row, _)| row.time <= 1.0);
        pairs.fold(0.0, |most: f64, (a, b)| most.max((a.probes[0] - b.probes[0]).abs()))
    };
    let [splitting, cells] = [off(&exact, &conserving), off(&exact, &cells)];
    println!("splitting {splitting:e}, cells {cells:e}");
    assert!(splitting <= 1e-4 && cells <= 2e-2, "{splitting:e}, {cells:e}");
}
