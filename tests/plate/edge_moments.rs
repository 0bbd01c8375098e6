//! Recovered curvatures at the edges of a clamped square.

use crate::common::models::unit_plate;
use crate::common::plates::{Alternating, Fvs, Hct, Matrices, Right, all_round};
use crate::moments::{distance, jittered, recovered};
use rebond::assembly::Pressure;
use rebond::dof_map::Support;
use rebond::mesh::{Mesh, Point};
use rebond::obstacle::Bounds;
use rebond::scheme;
use std::f64::consts::TAU;

/// On the clamped square with w = sin^2(pi x) sin^2(pi y) the curvatures at the edges, which are
/// continued from inside, converge with an order of at least 1.4 on every mesh.
#[test]
fn curvatures_at_clamped_edges_converge() {
    type Meshes = fn(usize) -> Mesh;
    let cases: [(&str, Meshes); 5] = [
        ("hct", |n| Mesh::rectangle(1.0, 1.0, [n; 2], Hct, Right).unwrap()),
        ("hct alternating", |n| Mesh::rectangle(1.0, 1.0, [n; 2], Hct, Alternating).unwrap()),
        ("fvs", |n| Mesh::rectangle(1.0, 1.0, [n; 2], Fvs, Right).unwrap()),
        ("hct jittered", |n| jittered(Mesh::rectangle(1.0, 1.0, [n; 2], Hct, Alternating).unwrap(), n)),
        ("fvs jittered", |n| jittered(Mesh::rectangle(1.0, 1.0, [n; 2], Fvs, Right).unwrap(), n)),
    ];
    let exact = |p: Point| {
        let ([sx, cx], [sy, cy]) = [p.x, p.y].map(|x| [(TAU * x).sin(), (TAU * x).cos()]).into();
        [cx * (1.0 - cy), sx * sy, cy * (1.0 - cx)].map(|of| 0.25 * TAU * TAU * of)
    };
    let load = |p: &Point| {
        let [cx, cy] = [p.x, p.y].map(|x| (TAU * x).cos());
        0.25 * TAU.powi(4) * (4.0 * cx * cy - cx - cy)
    };
    for (name, mesh) in cases {
        let mut before = f64::NAN;
        for n in [8, 16, 32] {
            let plate = Matrices::new(mesh(n), unit_plate(0.3), &all_round(Support::Clamped));
            let mut force = vec![0.0; plate.space.dofs()];
            let pressure = |points: &[Point], values: &mut [f64]| {
                points.iter().zip(values).for_each(|(p, value)| *value = load(p));
                Ok(())
            };
            Pressure::new(&plate.mesh, &plate.cells)
                .unwrap()
                .load(&Default::default(), pressure, &mut force)
                .unwrap();
            let (u, _, _) =
                scheme::equilibrium(&plate.engine, &plate.stiffness, &force, &Bounds::default()).unwrap();
            let nodes = recovered(&plate, &plate.space.shape(&u)).into_iter().zip(&plate.mesh.nodes);
            let is_edge = |p: &Point| [p.x, p.y].iter().any(|x| !(1e-9..1.0 - 1e-9).contains(x));
            let squares: Vec<f64> = nodes
                .filter(|(_, node)| is_edge(node))
                .map(|(own, node)| distance(own, exact(*node)).powi(2))
                .collect();
            let error = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt() / (0.5 * TAU * TAU);
            println!("{name} {n}: {error:.2e}, rate {:.2}", (before / error).log2());
            if n > 8 {
                let rate = (before / error).log2();
                assert!((1.4..2.3).contains(&rate), "{name} {n}: rate {rate}");
            }
            before = error;
        }
        assert!(before < 1.5e-2, "{name}: {before:e}");
    }
}
