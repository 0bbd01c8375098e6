//! Gmsh's meshes on 1 to 4 ranks: their parts add up to the whole, the plate on them equals that of
//! the native engine, and an error occurs on all ranks.

use crate::common::models::unit_plate;
use crate::common::plates::Matrices;
use crate::common::ranks::{Case, case};
use faer::Mat;
use rebond::assembly;
use rebond::communicator::Communicator;
use rebond::distributed::{Distributed, Part};
use rebond::dof_map::{DofMap, PER_NODE, Place, Support};
use rebond::linalg::{Engine, Form};
use rebond::mesh::{Cell, Import, Mesh, Point};
use rebond::modes::{self, ModeRange, lowest_basis};
use rebond::obstacle::Bounds;
use rebond::petsc::Context;
use rebond::scheme::equilibrium;
use rebond::{Error, Result};
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::rc::Rc;

pub const CASES: &[Case] = &[
    case("parts_of_triangles_and_quadrilaterals_add_up", &[1, 2, 3], |_| parts("square")),
    case("parts_of_triangles_add_up", &[2, 3], |_| parts("hole")),
    case("parts_of_quadrilaterals_without_names_add_up", &[2, 3], |_| parts("quads")),
    case("every_node_and_edge_has_one_owner", &[2, 3], every_node_and_edge_has_one_owner),
    case("the_plate_is_the_native_one", &[1, 2, 3, 5], the_plate_is_the_native_one),
    case("refined_it_still_is", &[2, 3], refined_it_still_is),
    case("a_file_on_more_ranks_than_cells", &[2, 4], more_ranks_than_cells),
    case("an_error_of_rank_0_is_that_of_all", &[1, 2, 3], an_error_of_rank_0_is_that_of_all),
    case("an_error_of_some_rank_is_that_of_all", &[1, 2, 3], an_error_of_some_rank_is_that_of_all),
];

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/gmsh").join(name)
}

/// Returns the supports along named edges.
fn on_edges<'s>(supports: &'s [(&str, Support)]) -> impl Fn(&Mesh) -> Result<Vec<(Place, Support)>> + 's {
    move |mesh| DofMap::on_edges(mesh, supports.iter().copied())
}

/// Counts, measures and places agree with those of Gmsh (`expected.json`), also after refinement.
fn parts(name: &str) -> Result<()> {
    let context = Context::start(&[])?;
    let expected: Value = serde_json::from_slice(&std::fs::read(path("expected.json")).unwrap()).unwrap();
    let expected = &expected[name];
    let counted = |key: &str| expected[key].as_u64().unwrap() as usize;
    let (triangles, quadrilaterals) = (counted("triangles"), counted("quadrilaterals"));
    for refinements in [0, 2] {
        let read = || Mesh::load(path(&format!("{name}_41_binary.msh")), Import::default());
        let Part { mesh, owns, .. } = Part::of_mesh(&context, read, refinements, &on_edges(&[]), &[], None)?;
        mesh.check()?;
        let mine = mesh.cells.iter().filter(|cell| matches!(cell, Cell::Triangle(_))).count();
        assert_eq!(context.comm().all_reduce_sum(mine), triangles << (2 * refinements));
        assert_eq!(
            context.comm().all_reduce_sum(mesh.cells.len() - mine),
            quadrilaterals << (2 * refinements)
        );
        let nodes = owns.iter().filter(|&&owns| owns).count();
        if refinements == 0 {
            assert_eq!(context.comm().all_reduce_sum(nodes), counted("nodes"));
        }
        let assert_names = |found: Vec<(&String, usize, f64)>, expected: &Value, growth: u32| {
            assert_eq!(found.len(), expected.as_object().unwrap().len());
            for (name, count, measure) in found {
                let count = context.comm().all_reduce_sum(count);
                assert_eq!(expected[name][0].as_u64().unwrap() << (growth * refinements), count as u64);
                let (measure, exact) =
                    (context.comm().all_reduce_sum(measure), expected[name][1].as_f64().unwrap());
                assert!((measure / exact - 1.0).abs() <= 1e-13, "{name}: {measure}, not {exact}");
            }
        };
        let area = |cells: &Vec<usize>| cells.iter().map(|&cell| mesh.area(cell)).sum();
        let groups = mesh.groups.iter().map(|(name, cells)| (name, cells.len(), area(cells)));
        assert_names(groups.collect(), &expected["groups"], 2);
        let length = |[a, b]: &[usize; 2]| (mesh.nodes[*b] - mesh.nodes[*a]).norm();
        let edges = mesh.edges.iter();
        let edges = edges.map(|(name, edges)| (name, edges.len(), edges.iter().map(length).sum()));
        assert_names(edges.collect(), &expected["edges"], 1);
        assert_eq!(mesh.points.len(), expected["points"].as_object().unwrap().len());
        for (name, nodes) in &mesh.points {
            assert!(nodes.iter().all(|&node| owns[node]));
            let places: Vec<[f64; 2]> = nodes.iter().map(|&node| mesh.nodes[node].into()).collect();
            let places: Vec<Value> =
                context.comm().all_gather(&places).into_iter().map(|at| at.to_vec().into()).collect();
            assert_eq!(Value::Array(places), expected["points"][name], "{name}");
        }
        // These sides have a cell of this rank on their left.
        let sides: Vec<[usize; 2]> = mesh.cells.iter().flat_map(Cell::edges).collect();
        assert!(mesh.edges.values().flatten().all(|edge| sides.contains(edge)));
    }
    Ok(())
}

/// Asserts the ownership by the names of all nodes and edges, in a mesh without holes: the number
/// of its edges is that of nodes and cells minus one (Euler).
fn every_node_and_edge_has_one_owner(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let read = || {
        let mut mesh = square();
        let mut edges: Vec<[usize; 2]> = mesh.cells.iter().flat_map(Cell::edges).collect();
        edges.sort_by_key(|&[a, b]| [a.min(b), a.max(b)]);
        edges.dedup_by_key(|&mut [a, b]| [a.min(b), a.max(b)]);
        mesh.edges.insert("each".into(), edges);
        mesh.points.insert("each".into(), (0..mesh.nodes.len()).collect());
        Ok(mesh)
    };
    let part = Part::of_mesh(&context, read, 0, &on_edges(&[]), &[], None)?;
    let Part { mesh, owns, .. } = part;
    let (nodes, cells) = (square().nodes, context.comm().all_reduce_sum(mesh.cells.len()));
    assert_eq!(context.comm().all_reduce_sum(mesh.edges["each"].len()), nodes.len() + cells - 1);
    assert_eq!(mesh.points["each"].len(), owns.iter().filter(|&&owns| owns).count());
    assert!(context.comm().all_reduce_sum(mesh.nodes.len()) > nodes.len());
    let own: Vec<[f64; 2]> = mesh.points["each"].iter().map(|&node| mesh.nodes[node].into()).collect();
    let mut found = context.comm().all_gather(&own);
    let mut expected: Vec<[f64; 2]> = nodes.into_iter().map(Into::into).collect();
    for places in [&mut found, &mut expected] {
        places.sort_by(|a, b| a.partial_cmp(b).unwrap());
    }
    assert_eq!(found, expected);
    Ok(())
}

/// A plate natively and on all ranks, with the corresponding dofs.
struct Both {
    native: Matrices,
    engine: Distributed,
    stiffness: Form,
    masses: [Form; 2],
    load: Vec<f64>,
    /// Pairs (own dof, native dof).
    pairs: Vec<(usize, usize)>,
}

impl Both {
    fn new(
        context: &Rc<Context>,
        mesh: Mesh,
        refinements: u32,
        supports: &[(&str, Support)],
    ) -> Result<Both> {
        let part = Part::of_mesh(context, || Ok(mesh.clone()), refinements, &on_edges(supports), &[], None)?;
        let native =
            Matrices::new((0..refinements).fold(mesh, |mesh, _| mesh.refine()), unit_plate(0.3), supports);
        let engine = Distributed::new(&part)?;
        let cells = assembly::cells(&part.mesh, &part.space, &unit_plate(0.3))?;
        let stiffness = engine.cells().form(assembly::stiffness(&cells));
        let consistent = engine.cells().form(assembly::consistent_mass(&cells));
        let singular = engine.cells().averages(assembly::singular_mass(&cells));
        let mut load = vec![0.0; engine.dofs()];
        engine.add_up(&assembly::uniform_load(&cells, part.space.dofs(), 1.0), &mut load);
        let mut pairs = Vec::new();
        for (node, place) in part.mesh.nodes.iter().enumerate().filter(|(node, _)| part.owns[*node]) {
            let near = |twin: &usize| (native.mesh.nodes[*twin] - place).norm() <= 1e-14;
            let twin = (0..native.mesh.nodes.len()).find(near).expect("the node of the whole");
            for (k, dof) in native.space.dofs_of(&[twin]).enumerate() {
                let own = engine.own_dof(PER_NODE * node + k);
                assert_eq!(own.is_some(), dof.is_some(), "dof {k} at {place}");
                pairs.extend(own.zip(dof));
            }
        }
        assert_eq!(context.comm().all_reduce_sum(pairs.len()), native.space.dofs());
        assert_eq!(pairs.len(), engine.dofs());
        Ok(Both { native, engine, stiffness, masses: [consistent, singular], load, pairs })
    }

    /// Returns this rank's part of a native vector.
    fn own(&self, native: &[f64]) -> Vec<f64> {
        let mut own = vec![0.0; self.engine.dofs()];
        self.pairs.iter().for_each(|&(dof, twin)| own[dof] = native[twin]);
        own
    }

    #[track_caller]
    fn assert_same(&self, own: &[f64], native: &[f64], tolerance: f64) {
        let scale = native.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for &(dof, twin) in &self.pairs {
            let error = (own[dof] - native[twin]).abs() / scale;
            assert!(error <= tolerance, "{:e}, not {:e}: {error:e}", own[dof], native[twin]);
        }
    }

    /// Asserts that products, an equilibrium and the lowest frequency agree.
    fn agree(&self) -> Result<()> {
        let Both { native, engine, .. } = self;
        let x: Vec<f64> = (0..native.space.dofs()).map(|dof| (1.0 + 0.7 * dof as f64).sin()).collect();
        let [consistent, singular] = &self.masses;
        let forms = [
            (&self.stiffness, &native.stiffness),
            (consistent, &native.consistent),
            (singular, &native.singular),
        ];
        for (form, twin) in forms {
            let (mut y, mut z) = (vec![0.0; engine.dofs()], vec![0.0; x.len()]);
            let value = engine.multiply(form, &self.own(&x), &mut y)?;
            let exact = native.engine.multiply(twin, &x, &mut z)?;
            assert!((value / exact - 1.0).abs() <= 1e-13);
            self.assert_same(&y, &z, 1e-14);
        }
        let (u, _, _) = equilibrium(engine, &self.stiffness, &self.load, &Bounds::default())?;
        self.assert_same(&u, &native.statics(1.0), 1e-12);

        let lowest = modes::lowest(&native.engine, [&native.stiffness, &native.consistent], 1, false)?[0];
        let mut factor = engine.factor(&(&self.stiffness).into(), &[])?;
        let (mut u, mut y) = (u, vec![0.0; engine.dofs()]);
        let mut found = 0.0;
        for _ in 0..40 {
            let stretch = engine.multiply(&self.stiffness, &u, &mut y)?;
            let inertia = engine.multiply(consistent, &u, &mut y)?;
            found = (stretch / inertia).sqrt() / TAU;
            y.iter_mut().for_each(|y| *y /= inertia.sqrt());
            factor.solve(&mut y)?;
            u.copy_from_slice(&y);
        }
        assert!((found / lowest - 1.0).abs() <= 1e-11, "{found} Hz, not {lowest}");
        self.agree_in_factors()?;
        self.agree_in_modes()
    }

    /// Asserts that factors agree, with contact dofs inside and on the interfaces of ranks, and
    /// with pinned dofs.
    fn agree_in_factors(&self) -> Result<()> {
        let Both { native, engine, .. } = self;
        let sum = &self.stiffness + &self.masses[1] * 1e3;
        let twin = &native.stiffness + &native.singular * 1e3;
        let chosen = |dof: &usize| dof % 7 == 3;
        let dofs: Vec<usize> =
            self.pairs.iter().filter(|(_, twin)| chosen(twin)).map(|(dof, _)| *dof).collect();
        let dofs = sorted(dofs);
        let twin_of = |dof: &usize| self.pairs.iter().find(|(other, _)| other == dof).unwrap().1;
        // The contact dofs of all ranks, rank by rank.
        let order = engine.comm().all_gather(&dofs.iter().map(twin_of).collect::<Vec<_>>());
        let b: Vec<f64> = (0..native.space.dofs()).map(|dof| (0.3 + 1.7 * dof as f64).cos()).collect();
        let mut exact = b.clone();
        native.engine.factor(&twin, &[])?.solve(&mut exact)?;

        let mut whole = engine.factor(&sum, &dofs)?;
        let (factor, mut h) = (whole.schur_factor().expect("a Schur complement"), vec![0.0; order.len()]);
        let mut count = [1.0, engine.comm().rank() as f64];
        factor.forward_to_schur(&self.own(&b), &mut h, &mut count)?;
        let size = engine.comm().size() as f64;
        assert_eq!(count, [size, 0.5 * size * (size - 1.0)]);
        let product: f64 = (0..h.len()).map(|j| factor.schur()[(0, j)] * exact[order[j]]).sum();
        let most = h.iter().fold(0.0_f64, |most, h| most.max(h.abs()));
        assert!((product - h[0]).abs() <= 1e-10 * most, "{product}, not {}", h[0]);
        factor.solve_schur(&mut h);
        let largest = exact.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        h.iter().zip(&order).for_each(|(x, dof)| assert!((x - exact[*dof]).abs() <= 1e-10 * largest));
        let mut x = vec![0.0; engine.dofs()];
        factor.back_substitute(&h, &mut x)?;
        self.assert_same(&x, &exact, 1e-10);

        let mut factor = engine.factor(&sum, &[])?;
        let mut pinned = native.engine.factor(&twin, &[])?;
        for chosen in [dofs, Vec::new()] {
            factor.pin(&chosen)?;
            pinned.pin(&engine.comm().all_gather(&chosen.iter().map(twin_of).collect::<Vec<_>>()))?;
            let (mut x, mut exact) = (self.own(&b), b.clone());
            factor.solve(&mut x)?;
            pinned.solve(&mut exact)?;
            self.assert_same(&x, &exact, 1e-10);
        }
        Ok(())
    }

    /// Asserts that many modes agree and are orthonormal over all ranks.
    fn agree_in_modes(&self) -> Result<()> {
        let Both { native, engine, .. } = self;
        let count = native.space.dofs().min(20);
        let range = ModeRange::Count(count);
        let modes = lowest_basis(engine, [&self.stiffness, &self.masses[0]], range, false)?;
        let twins = lowest_basis(&native.engine, [&native.stiffness, &native.consistent], range, false)?;
        assert_eq!([modes.squares.len(), modes.residuals.len(), twins.squares.len()], [count; 3]);
        assert!(modes.is_complete && twins.is_complete);
        let middle = 0.5 * (twins.squares[count / 2] + twins.squares[count / 2 - 1]);
        // The indefinite factor counts, and solves: (K - sigma M) x = (lambda - sigma) M x.
        let mut factor = engine.factor_beyond(&self.stiffness, &self.masses[0], middle)?.unwrap();
        assert_eq!(factor.negative, count / 2);
        let mut solved =
            Mat::from_fn(engine.dofs(), count, |i, j| (modes.squares[j] - middle) * modes.momenta[(i, j)]);
        (factor.solve)(&mut solved)?;
        let most = modes.shapes.norm_max();
        assert!(
            (&solved - &modes.shapes).norm_max() <= 1e-9 * most,
            "{:e}",
            (&solved - &modes.shapes).norm_max()
        );
        for (square, twin) in modes.squares.iter().zip(&twins.squares) {
            assert!((square / twin - 1.0).abs() <= 1e-11, "{square}, not {twin}");
        }
        assert!(modes.residuals.iter().all(|residual| *residual <= 1e-9), "{:?}", modes.residuals);
        for i in 0..count {
            for j in 0..count {
                let momentum = modes.momenta.col_as_slice(j);
                let mass = engine.dot(modes.shapes.col_as_slice(i), momentum)?;
                assert!((mass - f64::from(u8::from(i == j))).abs() <= 1e-14, "shapes {i}, {j}: {mass}");
            }
        }
        Ok(())
    }
}

fn sorted(mut dofs: Vec<usize>) -> Vec<usize> {
    dofs.sort_unstable();
    dofs
}

fn square() -> Mesh {
    Mesh::load(path("square_41_binary.msh"), Import::default()).unwrap()
}

fn the_plate_is_the_native_one(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    use Support::{Clamped, Guided, SimplySupported};
    // The joint lies inside the plate, so ranks share its edges.
    for supports in [
        &[("left", Clamped)][..],
        &[("left", SimplySupported), ("right", Guided), ("bottom", SimplySupported)],
        &[("joint", Clamped), ("left", SimplySupported)],
    ] {
        Both::new(&context, square(), 0, supports)?.agree()?;
    }
    Ok(())
}

fn refined_it_still_is(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    Both::new(&context, square(), 2, &[("joint", Support::Clamped), ("right", Support::SimplySupported)])?
        .agree()
}

fn more_ranks_than_cells(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let nodes = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.5]].map(Point::from).to_vec();
    let cells = vec![Cell::Quadrilateral([0, 1, 2, 3]), Cell::Triangle([1, 4, 2])];
    let edges = [("wall".into(), vec![[3, 0]])].into();
    let mesh = Mesh { nodes, cells, edges, ..Mesh::default() };
    mesh.check()?;
    for refinements in [0, 1] {
        Both::new(&context, mesh.clone(), refinements, &[("wall", Support::Clamped)])?.agree()?;
    }
    Ok(())
}

/// Returns the error of a part, which all ranks must have in the same words.
fn error_of(
    context: &Rc<Context>,
    read: impl FnOnce() -> Result<Mesh>,
    supports: &[(&str, Support)],
) -> Error {
    let error = Part::of_mesh(context, read, 1, &on_edges(supports), &[], None).err().expect("an error");
    let words = error.to_string();
    let all = context.comm().all_gather(words.as_bytes());
    assert_eq!(String::from_utf8(all).unwrap(), words.repeat(context.size()));
    assert!(context.comm().all_reduce_max(error.exit_code().into()) == f64::from(error.exit_code()));
    error
}

fn an_error_of_rank_0_is_that_of_all(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    for (name, code) in [("second_order.msh", 2), ("expected.json", 2), ("nowhere.msh", 4)] {
        let read = || Mesh::load(path(name), Import::default());
        let error = error_of(&context, read, &[]);
        assert_eq!((error.to_string(), error.exit_code()), (read().unwrap_err().to_string(), code));
    }
    // The ranks can continue after the error.
    Part::of_mesh(&context, || Ok(square()), 0, &on_edges(&[]), &[], None).map(drop)
}

fn an_error_of_some_rank_is_that_of_all(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let read = || Mesh::load(path("hole_41_text.msh"), Import::default());
    let unknown = [("right", Support::Clamped)];
    let error = error_of(&context, read, &unknown);
    assert_eq!(error.to_string(), DofMap::new(&read()?, unknown).unwrap_err().to_string());
    Ok(())
}
