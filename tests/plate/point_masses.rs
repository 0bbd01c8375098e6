//! Point masses with the singular mass: velocities, energies and the inf-sup constant wherever they
//! lie in the cells.

use crate::common::models::{CLAMPED, PAPER_PLATE, UNIT};
use crate::common::scenes::{STILL, all_round, close, grid, inspect, scene};
use crate::ribs::energies;
use rebond::simulation;
use rebond::study::Inspection;

/// A node, a point on an edge of the cells, the centre of a cell, and a point with no symmetry, on
/// a grid of 10 x 4 cells of 0.12 m x 0.1 m.
const PLACES: [[f64; 2]; 4] = [[0.96, 0.2], [0.9, 0.2], [0.9, 0.25], [0.887, 0.261]];

fn mass(at: [f64; 2], mass: f64) -> String {
    format!("mass = [{{ at = {at:?}, mass = {mass:?} }}]\n")
}

/// Masses add no velocities. In a motion of the plate as a whole they have their kinetic energy;
/// with the consistent mass in any motion. Cells that meet at a mass share it.
#[test]
fn masses_are_those_of_the_cells() {
    let [a, b, c, d] = [0.7, -1.3, 0.4, 0.2];
    for element in ["fvs", "hct"] {
        let plate = [PAPER_PLATE, &grid(element, 10, 4), STILL].concat();
        let bare = [[a, b, c, d], [0.0, 0.0, 0.0, d]].map(|shape| energies(&plate, shape));
        for at @ [x, y] in PLACES {
            let laden = plate.clone() + &mass(at, 5.0);
            let w = a * x * x + b * x * y + c * y * y + d;
            close("any motion", energies(&laden, [a, b, c, d])[1] - bare[0][1], 5.0 * w * w, 1e-9);
            for energy in energies(&laden, [0.0, 0.0, 0.0, d]).iter().zip(bare[1]).skip(1) {
                close("whole", energy.0 - energy.1, 5.0 * d * d, 1e-9);
            }
            let scene = scene(&laden);
            let mesh = simulation::mesh(&scene).unwrap();
            let rows = simulation::matrices(&scene, &mesh, false).unwrap().singular;
            assert_eq!(rows.len(), mesh.cells.len());
            let lightest = rows.iter().fold(f64::INFINITY, |least: f64, row| least.min(row.mass));
            let sharing = || rows.iter().filter(|row| row.mass > lightest + 0.1);
            let holders: Vec<usize> = mesh.cells_at(at.into()).collect();
            assert_eq!(sharing().count(), holders.len());
            sharing().for_each(|row| close("share", row.mass - lightest, 5.0 / holders.len() as f64, 1e-12));
        }
    }
}

/// A mass at a point that supports hold bears on them alone, and takes no velocity from the cells.
#[test]
fn masses_on_supports_leave_the_cells_alone() {
    for element in ["fvs", "hct"] {
        let plate = [PAPER_PLATE, CLAMPED, &grid(element, 10, 4), STILL].concat();
        let bare = inspect(&plate);
        for at in [[0.0, 0.2], [0.0, 0.27]] {
            let laden = inspect(&(plate.clone() + &mass(at, 100.0)));
            close("mass", laden.mass, bare.mass + 100.0, 1e-12);
            for (laden, bare) in laden.singular.lowest.iter().zip(&bare.singular.lowest) {
                close("frequency", *laden, *bare, 1e-8);
            }
        }
    }
}

/// Wherever a mass M lies, shared by n cells of mass m, the constant is that of the bare plate up
/// to the factor 1 + M / (n m), before and after refinement.
#[test]
fn the_inf_sup_condition_holds_with_masses() {
    for element in ["fvs", "hct"] {
        for refine in [1, 2] {
            let plate = [PAPER_PLATE, CLAMPED, &grid(element, 10 * refine, 4 * refine), STILL].concat();
            let constants = |more: &str| inspect(&(plate.clone() + more)).inf_sup;
            let bare = constants("");
            let mesh = simulation::mesh(&scene(&plate)).unwrap();
            let cell = inspect(&plate).mass / mesh.cells.len() as f64;
            for at in PLACES {
                let laden = constants(&mass(at, 5.0));
                let heavier = 1.0 + 5.0 / (mesh.cells_at(at.into()).count() as f64 * cell);
                for (laden, bare) in [(laden.raw, bare.raw), (laden.energy, bare.energy)] {
                    let ratio = laden.unwrap() / bare.unwrap();
                    assert!(ratio > 1.0 / heavier, "{element}, {refine}, {at:?}: {ratio}, {heavier}");
                }
            }
        }
    }
}

/// Light masses and ribs leave the inf-sup constant as it is, also where the rows of B depend on
/// each other: on rectangles in a plate that is simply supported all around. Gravity acts where
/// they are.
#[test]
fn light_masses_follow_the_means_of_the_cells() {
    let plate = [UNIT, &grid("fvs", 7, 5), &all_round("simply_supported"), STILL].concat();
    let bare = inspect(&plate);
    let rib = "rib = [{ line = [[0.1, 0.13], [0.87, 0.71]], bending = 1e-9, mass = 0.02 }]\n".to_owned();
    for light in [mass([0.5, 0.5], 0.01), mass([0.31, 0.12], 0.01), rib] {
        let laden = inspect(&(plate.clone() + &light));
        close("inf-sup", laden.inf_sup.raw.unwrap(), bare.inf_sup.raw.unwrap(), 1e-9);
        let first = |of: &Inspection| [&of.singular, &of.consistent].map(|of| of.lowest[0]);
        let ([singular, consistent], [bare_singular, bare_consistent]) = (first(&laden), first(&bare));
        close("first frequency", singular / bare_singular, consistent / bare_consistent, 1e-3);
    }
    let scene = scene(&(plate + &mass([0.31, 0.12], 0.01) + "load.gravity = 1\n"));
    let mesh = simulation::mesh(&scene).unwrap();
    let load = simulation::matrices(&scene, &mesh, false).unwrap().load;
    let moment: f64 = mesh.nodes.iter().zip(load.chunks(3)).map(|(node, f)| node.x * f[0] + f[1]).sum();
    close("moment of the weight", moment, -0.5 - 0.01 * 0.31, 1e-12);
}

/// The plate mirrored at either axis has the same frequencies and deflections; so has one of
/// triangles turned by 180 degrees.
#[test]
fn mirrored_masses_are_alike() {
    let of = |element: &str, at: [f64; 2]| {
        let plate = [UNIT, &grid(element, 7, 5), &all_round("simply_supported"), STILL].concat();
        let probe = format!("output.probes = [{{ name = \"mass\", at = {at:?} }}]\n");
        let inspection = inspect(&[&plate, &mass(at, 3.0), "load.gravity = 9.81\n", &probe].concat());
        let mut values = inspection.singular.lowest;
        values.push(inspection.deflections[0].loaded.unwrap());
        values
    };
    for at @ [x, y] in [[2.0 / 7.0, 0.4], [2.0 / 7.0, 0.47], [1.5 / 7.0, 0.7], [0.31, 0.12]] {
        let mirrored = [("fvs", [1.0 - x, y]), ("fvs", [x, 1.0 - y]), ("hct", [1.0 - x, 1.0 - y])];
        for (element, image) in mirrored {
            for (value, expected) in of(element, image).into_iter().zip(of(element, at)) {
                close(element, value, expected, 1e-9);
            }
        }
    }
}
