//! Bending moments: exact on the polynomials that the elements contain, convergent, and equal to
//! published values.

use crate::common::models::{UNIT, unit_plate};
use crate::common::plates::{Alternating, Fvs, Hct, Matrices, Right, all_round};
use crate::common::scenes::{self, STILL, close, grid};
use rebond::assembly::{self, Pressure, Recovery};
use rebond::dof_map::Support;
use rebond::mesh::{Import, Mesh, Point};
use rebond::obstacle::Bounds;
use rebond::partition::WholeMesh;
use rebond::scheme;
use std::f64::consts::PI;

pub type Curvature = [f64; 3];

/// Returns the curvatures at the sites of a recovery for values and slopes, three per node.
fn at_sites(recovery: &Recovery, shape: &[f64]) -> Vec<Curvature> {
    recovery.curvatures(shape, &WholeMesh).unwrap()
}

/// Returns the recovered curvature at each node of a plate of one part.
pub fn recovered(plate: &Matrices, shape: &[f64]) -> Vec<Curvature> {
    let recovery = Recovery::new(&plate.mesh, &plate.cells, &|_| 0, 1, &WholeMesh).unwrap();
    let mut at_nodes = vec![[f64::NAN; 3]; plate.mesh.nodes.len()];
    recovery.sites.iter().zip(at_sites(&recovery, shape)).for_each(|(site, of)| at_nodes[site.node] = of);
    at_nodes
}

pub fn distance(a: Curvature, b: Curvature) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

/// Returns the root mean square error of the element's own curvature over the plate.
fn raw_error(plate: &Matrices, shape: &[f64], exact: impl Fn(Point) -> Curvature) -> f64 {
    let (mut square, mut area) = (0.0, 0.0);
    for (number, cell) in plate.mesh.cells.iter().enumerate() {
        let element = plate.mesh.element(number).unwrap();
        let dofs: Vec<f64> =
            cell.nodes().iter().flat_map(|node| shape[3 * node..3 * node + 3].to_vec()).collect();
        for (at, weight) in element.quadrature((&rebond::element::quadrature::DEGREE_2).into()) {
            let basis = element.basis_at(at);
            let own = [0, 1, 2].map(|k| basis.iter().zip(&dofs).map(|(of, u)| of.hessian[k] * u).sum());
            square += weight * distance(own, exact(at)).powi(2);
            area += weight;
        }
    }
    (square / area).sqrt()
}

/// Returns the mesh with its inner nodes displaced by up to a share of 1/n, always in the same way.
pub fn jittered(mut mesh: Mesh, n: usize) -> Mesh {
    let mut state = 88172645463325252_u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    for node in &mut mesh.nodes {
        let [a, b] = [random(), random()];
        let inside = |x: f64| x > 1e-9 && x < 1.0 - 1e-9;
        if inside(node.x) && inside(node.y) {
            *node += nalgebra::Vector2::new(a, b) * (0.2 / n as f64);
        }
    }
    mesh
}

fn gmsh_square(refinements: usize) -> Mesh {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/square_41_text.msh");
    let mesh = Mesh::load(file, Import::default()).unwrap();
    (0..refinements).fold(mesh, |mesh, _| mesh.refine())
}

/// On the simply supported square with w = sin(pi x) sin(pi y), the element's own curvatures
/// converge as h and the recovered ones faster, on every mesh. Each case states the interval of
/// the recovered rate and a cap on the recovered error at the finest mesh, relative to pi^2.
#[test]
fn recovered_curvatures_converge_faster_than_the_elements_own() {
    type Meshes = fn(usize) -> Mesh;
    let cases: [(&str, Meshes, [f64; 2], f64); 6] = [
        ("hct", |n| Mesh::rectangle(1.0, 1.0, [n; 2], Hct, Right).unwrap(), [1.5, 2.5], 5e-3),
        (
            "hct alternating",
            |n| Mesh::rectangle(1.0, 1.0, [n; 2], Hct, Alternating).unwrap(),
            [1.4, 2.5],
            6e-3,
        ),
        ("fvs", |n| Mesh::rectangle(1.0, 1.0, [n; 2], Fvs, Right).unwrap(), [1.7, 2.5], 4e-3),
        (
            "hct jittered",
            |n| jittered(Mesh::rectangle(1.0, 1.0, [n; 2], Hct, Alternating).unwrap(), n),
            [1.2, 2.5],
            8e-3,
        ),
        (
            "fvs jittered",
            |n| jittered(Mesh::rectangle(1.0, 1.0, [n; 2], Fvs, Right).unwrap(), n),
            [1.5, 2.5],
            5e-3,
        ),
        ("gmsh", |n| gmsh_square(n.ilog2() as usize - 3), [1.4, 2.5], 7e-3),
    ];
    let exact = |p: Point| {
        let ([sx, cx], [sy, cy]) =
            ([(PI * p.x).sin(), (PI * p.x).cos()], [(PI * p.y).sin(), (PI * p.y).cos()]);
        [-PI * PI * sx * sy, PI * PI * cx * cy, -PI * PI * sx * sy]
    };
    for (name, mesh, [least, most], cap) in cases {
        let mut before = [f64::NAN; 2];
        for n in [8, 16, 32] {
            let plate = Matrices::new(mesh(n), unit_plate(0.3), &all_round(Support::SimplySupported));
            let mut load = vec![0.0; plate.space.dofs()];
            let pressure = |points: &[Point], values: &mut [f64]| {
                for (p, value) in points.iter().zip(values) {
                    *value = 4.0 * PI.powi(4) * (PI * p.x).sin() * (PI * p.y).sin();
                }
                Ok(())
            };
            Pressure::new(&plate.mesh, &plate.cells)
                .unwrap()
                .load(&Default::default(), pressure, &mut load)
                .unwrap();
            let (u, _, _) =
                scheme::equilibrium(&plate.engine, &plate.stiffness, &load, &Bounds::default()).unwrap();
            let shape = plate.space.shape(&u);
            let nodes = recovered(&plate, &shape).into_iter().zip(&plate.mesh.nodes);
            let squares: f64 = nodes.map(|(own, node)| distance(own, exact(*node)).powi(2)).sum();
            let errors = [
                raw_error(&plate, &shape, exact) / (PI * PI),
                (squares / plate.mesh.nodes.len() as f64).sqrt() / (PI * PI),
            ];
            if n > 8 {
                let rates = [0, 1].map(|k| (before[k] / errors[k]).log2());
                println!("{name} {n}: {:.2e} {:.2e}, rates {rates:.2?}", errors[0], errors[1]);
                assert!((0.9..1.15).contains(&rates[0]), "{name} {n}: raw rate {}", rates[0]);
                assert!((least..most).contains(&rates[1]), "{name} {n}: recovered rate {}", rates[1]);
            }
            before = errors;
        }
        assert!(before[1] < cap, "{name}: {:e}", before[1]);
        assert!(before[1] < 0.3 * before[0], "{name}: {before:?}");
    }
}

/// A quadratic deflection is in every element's space: its moments are exact everywhere, for every
/// material.
#[test]
fn quadratics_have_exact_moments() {
    let plates = [
        "plate = { length = 1, width = 1, thickness = 0.1, youngs_modulus = 1e5, poissons_ratio = 0.3, density = 1 }",
        "plate = { length = 1, width = 1, thickness = 0.1, youngs_modulus = 1e5, youngs_modulus_across = 2e4, shear_modulus = 3e4, grain = 30, poissons_ratio = 0.3, density = 1 }",
    ];
    let d = 1e5 * 1e-3 / (12.0 * 0.91);
    for (plate, is_isotropic) in plates.into_iter().zip([true, false]) {
        for element in ["hct", "fvs"] {
            let quantities = [
                "moment_xx",
                "moment_yy",
                "moment_xy",
                "stress_xx_top",
                "stress_xx_bottom",
                "von_mises_top",
                "slope_x",
            ];
            let probes: Vec<String> = quantities
                .iter()
                .map(|quantity| {
                    format!("{{ name = \"{quantity}\", at = [0.37, 0.61], quantity = \"{quantity}\" }}")
                })
                .collect();
            let text = format!(
                "{plate}\n{}{STILL}initial = {{ deflection = \"0.5*x^2 - 0.2*y^2 + 0.3*x*y\" }}\noutput = {{ probes = [{}] }}",
                grid(element, 3, 4),
                probes.join(", ")
            );
            let [xx, yy, xy, top, bottom, mises, slope] = scenes::start(&text)[..] else { panic!() };
            close("slope", slope, 0.37 + 0.3 * 0.61, 1e-12);
            if is_isotropic {
                close("M_xx", xx, -d * (1.0 - 0.3 * 0.4), 1e-11);
                close("M_yy", yy, -d * (-0.4 + 0.3), 1e-11);
                close("M_xy", xy, -d * 0.7 * 0.3, 1e-11);
            } else {
                let section = scenes::scene(&text).plate.plate.section();
                let energy = 0.5
                    * (section.bending * nalgebra::Vector3::new(1.0, 0.3, -0.4))
                        .dot(&nalgebra::Vector3::new(1.0, 0.3, -0.4));
                close("energy", -0.5 * (xx - 0.4 * yy + 2.0 * 0.3 * xy), energy, 1e-11);
            }
            close("top", top, 6.0 * xx / 0.01, 1e-12);
            close("bottom", bottom, -top, 1e-12);
            close("von Mises", mises, 600.0 * (xx * xx - xx * yy + yy * yy + 3.0 * xy * xy).sqrt(), 1e-12);
        }
    }
}

/// Returns the moments M_xx at a point and M_xy at the corner of the simply supported unit square
/// under a unit pressure, by Navier's double series (Timoshenko and Woinowsky-Krieger, section 30).
fn navier(x: f64, y: f64) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for m in (1..800).step_by(2).map(f64::from) {
        for n in (1..800).step_by(2).map(f64::from) {
            let w = 16.0 / (PI.powi(6) * m * n * (m * m + n * n).powi(2));
            sums[0] += w * PI * PI * (m * m + 0.3 * n * n) * (m * PI * x).sin() * (n * PI * y).sin();
            sums[1] -= w * PI * PI * 0.7 * m * n;
        }
    }
    sums
}

/// Returns the values of moments at points of the unit plate at rest under a unit pressure.
fn at_rest(supports: &str, element: &str, n: usize, wanted: &[(&str, [f64; 2])]) -> Vec<f64> {
    let probe = |(index, (quantity, [x, y])): (usize, &(&str, [f64; 2]))| {
        format!("{{ name = \"{index}\", at = [{x}, {y}], quantity = \"{quantity}\" }}")
    };
    let probes: Vec<String> = wanted.iter().enumerate().map(probe).collect();
    let mesh = grid(element, n, n);
    scenes::start(&format!(
        "{UNIT}{supports}{mesh}{STILL}initial = {{ static_pressure = 1 }}\noutput = {{ probes = [{}] }}",
        probes.join(", ")
    ))
}

/// The errors of published moments at single points shrink 1.6 times at least with each
/// refinement, and are below the cap at 32 x 32. Clamped square: R. L. Taylor and S. Govindjee,
/// *Solution of clamped rectangular plate problems*, Communications in Numerical Methods in
/// Engineering 20, 2004.
#[test]
fn published_moments_of_the_square() {
    let simply = scenes::all_round("simply_supported");
    let clamped = scenes::all_round("clamped");
    let [centre, corner] = navier(0.5, 0.5);
    assert!((centre - 0.0479).abs() < 5e-5 && (corner + 0.0325).abs() < 5e-5, "{centre}, {corner}");
    let cases = [
        (&simply, "moment_xx", [0.5, 0.5], centre, 3e-3),
        (&simply, "moment_xy", [0.0, 0.0], corner, 1.6e-2),
        (&simply, "moment_max", [0.5, 0.5], centre, 3e-3),
        (&clamped, "moment_xx", [0.5, 0.5], 0.0229051, 7e-3),
        (&clamped, "moment_xx", [0.0, 0.5], -0.0513338, 3.5e-2),
        (&clamped, "moment_min", [0.5, 0.0], -0.0513338, 3.5e-2),
    ];
    for (supports, quantity, at, expected, cap) in cases {
        for element in ["hct", "fvs"] {
            let mut before = f64::INFINITY;
            for n in [8, 16, 32] {
                let value = at_rest(supports, element, n, &[(quantity, at)])[0];
                let error = (value / expected - 1.0).abs();
                println!("{quantity} {at:?} {element} {n}: {value:.6} {error:.1e}");
                assert!(error < before / 1.6, "{quantity} {at:?} {element} {n}: {error:e} after {before:e}");
                before = error;
            }
            assert!(before < cap, "{quantity} {at:?} {element}: {before:e}");
        }
    }
}

/// The clamped disc under a uniform pressure q: w = q (a^2 - r^2)^2 / (64 D), so that the moment is
/// q a^2 (1 + nu) / 16 at the centre and, radially, -q a^2 / 8 at the rim.
#[test]
fn the_clamped_disc() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/gallery/disc.msh");
    let mut mesh = Mesh::load(file, Import::default()).unwrap();
    let radius = 0.2;
    let mut errors = Vec::new();
    for _ in 0..3 {
        let supports: Vec<(&str, Support)> =
            mesh.edges.keys().map(|edge| (edge.as_str(), Support::Clamped)).collect();
        let plate = Matrices::new(mesh.clone(), unit_plate(0.3), &supports);
        let shape = plate.space.shape(&plate.statics(1.0));
        let moments: Vec<Curvature> = recovered(&plate, &shape)
            .into_iter()
            .map(|[xx, xy, yy]| [-(xx + 0.3 * yy), -0.7 * xy, -(yy + 0.3 * xx)])
            .collect();
        let rim = mesh.edge_nodes("rim").unwrap();
        let at_rim = |&node: &usize| {
            let [c, s] = (mesh.nodes[node].coords / radius).into();
            let [xx, xy, yy] = moments[node];
            ((xx * c * c + 2.0 * xy * c * s + yy * s * s) / (-radius * radius / 8.0) - 1.0).abs()
        };
        let edge = rim.iter().map(at_rim).fold(0.0, f64::max);
        let nearest =
            |a: &usize, b: &usize| mesh.nodes[*a].coords.norm().total_cmp(&mesh.nodes[*b].coords.norm());
        let middle = (0..mesh.nodes.len()).min_by(nearest).unwrap();
        let centre = (moments[middle][0] / (radius * radius * 1.3 / 16.0) - 1.0).abs();
        println!("{} nodes: centre {centre:.1e}, rim {edge:.1e}", mesh.nodes.len());
        errors.push([centre, edge]);
        mesh = mesh.refine();
        for node in mesh.edge_nodes("rim").unwrap() {
            let stretch = radius / mesh.nodes[node].coords.norm();
            mesh.nodes[node] *= stretch;
        }
    }
    let [first, .., last] = &errors[..] else { panic!() };
    assert!(last[0] < 6e-3 && last[0] < first[0] / 4.0, "centre: {errors:?}");
    assert!(last[1] < 6e-2 && last[1] < first[1] / 3.0, "rim: {errors:?}");
}

/// A cantilever strip without lateral contraction under a pressure q has M_xx = q (L - x)^2 / 2
/// upward whatever its parts are made of. Where the thickness jumps, the moment is continuous and
/// the stress jumps as 1/h^2, each side with a fit of its own.
#[test]
fn moments_are_continuous_between_parts_and_stresses_jump() {
    for element in ["hct", "fvs"] {
        let text = format!(
            "plate = {{ length = 1, width = 0.1, thickness = 0.01, youngs_modulus = 1e9, poissons_ratio = 0, density = 1000 }}
             part = [{{ where = \"x > 0.5\", thickness = 0.02, youngs_modulus = 3e9 }}]
             support = [{{ edge = \"left\", kind = \"clamped\" }}]
             {}{STILL}initial = {{ static_pressure = 8 }}
             output = {{ probes = [
               {{ name = \"a\", at = [0.4999999, 0.05], quantity = \"moment_xx\" }},
               {{ name = \"b\", at = [0.5000001, 0.05], quantity = \"moment_xx\" }},
               {{ name = \"c\", at = [0.4999999, 0.05], quantity = \"stress_xx_top\" }},
               {{ name = \"d\", at = [0.5000001, 0.05], quantity = \"stress_xx_top\" }},
             ] }}",
            grid(element, 64, 4)
        );
        let [a, b, c, d] = scenes::start(&text)[..] else { panic!() };
        // Pressure upward bends the tip up: the lower surface is in tension.
        let exact = -8.0 * 0.25 / 2.0;
        close("thin side", a, exact, 2e-2);
        close("thick side", b, exact, 2e-2);
        close("stress on the thin side", c, exact * 6.0 / 1e-4, 2e-2);
        close("stress on the thick side", d, exact * 6.0 / 4e-4, 2e-2);
    }
}

/// A probe on the border between parts reads the mean over the cells that meet there, of moments
/// and of stresses, also in the mirror. The last part has one of the cells around the probe.
#[test]
fn probes_between_parts_read_the_mean() {
    let rigidity = |h: f64, e: f64| e * h.powi(3) / 12.0;
    let moments = [rigidity(0.01, 1e9), rigidity(0.02, 3e9)];
    let stresses = [6.0 / 1e-4 * moments[0], 6.0 / 4e-4 * moments[1]];
    let cases = [("x", "right", 5.0 / 6.0), ("(1 - x)", "left", 5.0 / 6.0)];
    let of_triangles = cases.map(|(x, diagonal, most)| {
        (x, format!("mesh = {{ element = \"hct\", cells = [4, 4], diagonal = \"{diagonal}\" }}"), most)
    });
    let of_squares = ["x", "(1 - x)"].map(|x| (x, grid("fvs", 4, 4), 0.75));
    for (x, mesh, most) in of_triangles.into_iter().chain(of_squares) {
        let half = format!("{x} > 0.5");
        let quarter = format!("{x} > 0.5 and y < 0.5");
        for (part, y, thin) in [(&half, 0.3, 0.5), (&half, 0.5, 0.5), (&quarter, 0.5, most)] {
            let text = format!(
                "plate = {{ length = 1, width = 1, thickness = 0.01, youngs_modulus = 1e9, poissons_ratio = 0, density = 1000 }}
                 part = [{{ where = \"{part}\", thickness = 0.02, youngs_modulus = 3e9 }}]
                 {mesh}\n{STILL}initial = {{ deflection = \"0.5*x^2 + x*y\" }}
                 output = {{ probes = [
                   {{ name = \"a\", at = [0.5, {y}], quantity = \"moment_xx\" }},
                   {{ name = \"b\", at = [0.5, {y}], quantity = \"stress_xy_bottom\" }},
                 ] }}"
            );
            let [moment, stress] = scenes::start(&text)[..] else { panic!() };
            let mean = |[plate, part]: [f64; 2]| thin * plate + (1.0 - thin) * part;
            close("moment", moment, -mean(moments), 1e-11);
            close("stress", stress, mean(stresses), 1e-11);
        }
    }
}

/// The curvature at a site, which blocks of eight sites compute side by side, is the sum of the
/// rows of its fits, which a probe adds up one by one: on a regular mesh, on one with rows of
/// other lengths, and on one without any rows.
#[test]
fn curvatures_of_blocks_are_those_of_single_sites() {
    let meshes = [
        Mesh::rectangle(1.0, 1.0, [13, 5], Fvs, Right).unwrap(),
        Mesh::rectangle(1.0, 1.0, [4, 6], Hct, Alternating).unwrap(),
        jittered(Mesh::rectangle(1.0, 1.0, [6, 5], Hct, Right).unwrap(), 6),
        gmsh_square(0),
    ];
    for mesh in meshes {
        let plate = Matrices::new(mesh, unit_plate(0.3), &[]);
        let part = |cell: usize| usize::from(cell % 4 >= 2);
        let recovery = Recovery::new(&plate.mesh, &plate.cells, &part, 2, &WholeMesh).unwrap();
        let shape: Vec<f64> = (0..3 * plate.mesh.nodes.len()).map(|dof| (dof % 7) as f64).collect();
        for (site, curvature) in at_sites(&recovery, &shape).into_iter().enumerate() {
            let mut shares = vec![0.0; recovery.sites.len()];
            shares[site] = 1.0;
            let mut sums = [0.0; 3];
            for (fit, share) in recovery.weights_of_fits(&shares, &WholeMesh).unwrap().iter().enumerate() {
                for (dof, weights) in recovery.row(fit).into_iter().filter(|_| *share != 0.0) {
                    (0..3).for_each(|k| sums[k] += share * weights[k] * shape[dof]);
                }
            }
            assert!(distance(sums, curvature) <= 1e-11 * distance(sums, [0.0; 3]), "{sums:?} {curvature:?}");
        }
    }
}

/// A rigid motion has no recovered curvature, and a node between two parts has one per part.
#[test]
fn sites_of_parts() {
    let plate = Matrices::square(4, Fvs, &[]);
    let part = |cell: usize| usize::from(cell % 4 >= 2);
    let recovery = Recovery::new(&plate.mesh, &plate.cells, &part, 2, &WholeMesh).unwrap();
    assert_eq!(recovery.sites.len(), 25 + 5);
    let rigid: Vec<f64> =
        plate.mesh.nodes.iter().flat_map(|p| [1.0 + 0.5 * p.x - 0.25 * p.y, 0.5, -0.25]).collect();
    for curvature in at_sites(&recovery, &rigid) {
        assert!(curvature.iter().all(|sum| sum.abs() < 1e-11), "{curvature:?}");
    }
    let weights = assembly::vertex_weights(&plate.mesh.element(0).unwrap(), Point::new(0.1, 0.2));
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
}
