//! Plates whose mid-plane stretches, on their mesh: equilibria of another program, the invariant of
//! Newmark's scheme and the energy of the conserving one through impacts, the order in time, and
//! restarts.

use crate::common::scenes::{
    Drawing, Instant, all_round, close, grid, model, newmark, refusal, run, run_to_end, scene,
};
use rebond::archive::Archive;
use rebond::linalg::Engine;
use rebond::scheme::Scheme;
use serde_json::Value;
use std::f64::consts::TAU;

/// Plate of 1 m x 1 m and h = 1 cm with D = 1 N m and rho h = 1 kg/m2.
const SQUARE: &str = "plate = { length = 1, width = 1, thickness = 0.01, youngs_modulus = 10.92e6, \
                      poissons_ratio = 0.3, density = 100 }\n";

#[test]
fn equilibria_of_squares() {
    let reference: Value = serde_json::from_str(include_str!("../data/inplane.json")).unwrap();
    for (name, kind) in [("SSSS", "simply_supported"), ("CCCC", "clamped")] {
        for (in_plane, load, element) in
            [("held", "160", "fvs"), ("normal", "40", "hct"), ("free", "160", "hct")]
        {
            let exact = &reference["square_static_w_over_h_by_P"][load][&format!("{name} {in_plane}")];
            let exact = exact.as_f64().unwrap();
            let supports = all_round(kind).replace("kind =", &format!("in_plane = \"{in_plane}\", kind ="));
            // P = q a^4 / (E h^4)
            let pressure = load.parse::<f64>().unwrap() * 10.92e-2;
            let value = |cells| {
                let rows = run(&format!(
                    "{SQUARE}{supports}{}in_plane.stretching = true\nload.pressure = {pressure}\n\
                     initial.equilibrium = true\n{}\
                     output = {{ probes = [{{ name = \"centre\", at = [0.5, 0.5] }}] }}\n",
                    grid(element, cells, cells),
                    newmark("consistent", 1e-4, 1e-3)
                ));
                // A plate in equilibrium stays at rest.
                let kinetic = rows.iter().map(|row| row.kinetic).fold(0.0, f64::max);
                assert!(kinetic <= 1e-16 * rows[0].elastic, "{kinetic:e} of {:e}", rows[0].elastic);
                rows[0].probes[0] / 0.01
            };
            let [coarse, fine] = [12, 24].map(value);
            let order = ((coarse / exact - 1.0) / (fine / exact - 1.0)).abs().log2();
            println!("{name} {in_plane} {element} {load}: {coarse}, {fine} for {exact}, order {order:.2}");
            assert!((1.6..=2.6).contains(&order), "{name} {in_plane} {element}: order {order}");
            close(name, (4.0 * fine - coarse) / 3.0, exact, 1e-3);
        }
    }
}

/// Squares of mesh files: smooth waves, inner nodes drawn anywhere near their place, and one of
/// Gmsh.
#[test]
fn equilibria_on_distorted_meshes() {
    let exact = 1.511702;
    let value = |mesh: String| {
        let rows = run(&format!(
            "{}{}{mesh}in_plane.stretching = true\nload.pressure = {}\ninitial.equilibrium = true\n{}\
             output = {{ probes = [{{ name = \"centre\", at = [0.5, 0.5] }}] }}\n",
            SQUARE.replace("length = 1, width = 1, ", ""),
            all_round("simply_supported"),
            160.0 * 10.92e-2,
            newmark("singular", 1e-3, 1e-3)
        ));
        rows[0].probes[0] / 0.01 / exact - 1.0
    };
    let drawn = |drawing: Drawing, name: String| value(format!("mesh.file = \"{}\"\n", drawing.write(&name)));
    let waves = |x: f64, y: f64| {
        let shift = 0.04 * (TAU * x).sin() * (TAU * y).sin();
        [x + shift, y - shift]
    };
    let jitter = |cells: usize| {
        let shift = move |x: f64, y: f64| 0.2 / cells as f64 * (1e4 * (x + 0.7 * y).sin()).sin();
        let is_inside = |x: f64| x > 1e-9 && x < 1.0 - 1e-9;
        move |x: f64, y: f64| match is_inside(x) && is_inside(y) {
            true => [x + shift(x, y), y + shift(y, 2.0 * x)],
            false => [x, y],
        }
    };
    for triangles in [false, true] {
        let [coarse, fine] = [12, 24].map(|cells| {
            let drawing = Drawing::grid([cells; 2], [1.0; 2], triangles, waves);
            drawn(drawing, format!("stretched-waves-{triangles}-{cells}.msh"))
        });
        println!("waves, {triangles}: {coarse:e}, {fine:e}");
        assert!((1.6..=2.6).contains(&(coarse / fine).log2()), "{coarse:e}, {fine:e}");
        assert!(((4.0 * fine - coarse) / 3.0).abs() <= 1e-3, "{coarse:e}, {fine:e}");
        let [coarse, fine] = [8, 32].map(|cells| {
            let drawing = Drawing::grid([cells; 2], [1.0; 2], triangles, jitter(cells));
            drawn(drawing, format!("stretched-jitter-{triangles}-{cells}.msh"))
        });
        println!("jitter, {triangles}: {coarse:e}, {fine:e}");
        // The error may change its sign.
        assert!(coarse.abs() <= 3e-3 && fine.abs() <= 3e-3 / 16.0, "{coarse:e}, {fine:e}");
    }
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/square_41_text.msh");
    let [coarse, fine] =
        [1, 2].map(|refine| value(format!("mesh = {{ file = \"{file}\", refine = {refine} }}\n")));
    println!("Gmsh: {coarse:e}, {fine:e}");
    assert!(fine.abs() <= coarse.abs() / 3.0 && fine.abs() <= 2e-3, "{coarse:e}, {fine:e}");
}

/// A clamped strip thrown on stops from several thicknesses.
fn strip(scheme: &str, step: f64, end: f64, more: &str) -> String {
    format!(
        "plate = {{ length = 1, width = 0.2, thickness = 2e-3, youngs_modulus = 70e9, poissons_ratio = 0.33, \
         density = 2700 }}\n\
         support = [{{ edge = \"left\", kind = \"clamped\" }}, {{ edge = \"right\", kind = \"clamped\" }}]\n{}\
         in_plane.stretching = true\ninitial.deflection = \"9.6e-3*sin(pi*x)^2\"\n\
         time = {{ scheme = {scheme}, step = {step:?}, end = {end:?} }}\n{more}\n",
        grid("fvs", 20, 4)
    )
}

const STOPS: &str = "obstacle = [{ side = \"below\", height = -3e-3 }]";

/// The strip through its impacts: energy left, and distance of the variable from its energy.
#[test]
fn the_invariant_of_newmark_never_rises() {
    let mut energies = Vec::new();
    for step in [4e-5, 2e-5, 1e-5] {
        for mass in ["singular", "consistent"] {
            let text = strip(&format!("\"newmark\", mass = \"{mass}\""), step, 0.03, STOPS);
            let (scene, model) = (scene(&text), model(&text));
            let mut scheme = model.scheme(&scene).unwrap();
            let start = scheme.energies().unwrap().total();
            let (mut last, mut contacts, mut largest) = (scheme.invariant().unwrap(), 0, 0.0_f64);
            while scheme.time() < 0.03 {
                scheme.advance().unwrap();
                let now = scheme.invariant().unwrap();
                largest = largest.max((now - last) / start);
                contacts += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
                last = now;
            }
            let kept = scheme.energies().unwrap().total() / start;
            println!("{mass}, {step}: rises by {largest:e}, {contacts} steps in contact, {kept:.4} kept");
            assert!(largest <= 1e-12, "{mass}, {step}: {largest:e}");
            assert!(contacts >= 10, "{mass}, {step}: {contacts}");
            if mass == "singular" {
                energies.push(kept);
            }
        }
        let gap = run_to_end(&strip("\"newmark\", mass = \"singular\"", step, 0.03, STOPS)).1.stretching_gap;
        assert!(gap.unwrap() <= 1e-2 * step / 4e-5, "{step}: {gap:?}");
    }
    // With the singular mass less is lost as the step falls.
    assert!(energies.is_sorted() && energies[2] >= 0.9, "{energies:?}");
}

/// Under a load that begins at once the variable of the energy follows it with second order, though
/// the massless deflections of the singular mass then go up and down from step to step. With that
/// mass all schemes converge to one motion, which a pressure lets the centre show.
#[test]
fn sudden_loads_converge_with_order_two() {
    let run = |load: &str, scheme: &str, mass: &str, step: f64| {
        let (rows, outcome) = run_to_end(&format!(
            "{SQUARE}{}{}in_plane.stretching = true\n{load}\n\
             time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = {step:?}, end = 0.1 }}\n\
             output.probes = [{{ name = \"centre\", at = [0.5, 0.5] }}]\n",
            all_round("simply_supported"),
            grid("fvs", 6, 6)
        ));
        (rows[rows.len() - 1].probes[0], outcome.stretching_gap)
    };
    for load in ["load.pressure = 30", "load.force = [{ at = [0.3, 0.45], value = 3 }]"] {
        let (reference, _) = run(load, "conserving", "singular", 2.5e-5);
        for (scheme, mass) in [("newmark", "consistent"), ("newmark", "singular"), ("midpoint", "singular")] {
            let [(far, coarse), (near, fine)] = [2e-4, 5e-5].map(|step| run(load, scheme, mass, step));
            let [coarse, fine] = [coarse, fine].map(|gap| gap.unwrap());
            println!("{load}, {scheme}, {mass}: gap {coarse:e}, {fine:e}; {far}, {near} for {reference}");
            assert!(coarse < 3e-3 && coarse / fine > 12.0, "{scheme}, {mass}: {coarse} {fine}");
            if load.contains("pressure") && mass == "singular" {
                let off = [far, near].map(|place| (place - reference).abs() / reference.abs());
                assert!(off[0] < 5e-3 && off[1] < 3e-4, "{scheme}: {off:?}");
            }
        }
    }
}

/// The strip through its impacts, released from 4.8 thicknesses and thrown to 18 of them, at steps
/// that resolve its vibration and at some that do not.
#[test]
fn the_conserving_scheme_keeps_the_true_energy() {
    let released = strip("\"conserving\", mass = \"singular\"", 1e-5, 0.02, STOPS);
    let thrown = released.replace("deflection = \"9.6e-3*", "velocity = \"-27*");
    for (text, steps) in [(&released, [8e-5, 4e-5, 2e-5, 1e-5]), (&thrown, [4e-5, 2e-5, 1e-5, 5e-6])] {
        for step in steps {
            let text = text.replace("step = 1e-5", &format!("step = {step:e}"));
            let (scene, model) = (scene(&text), model(&text));
            let mut scheme = model.scheme(&scene).unwrap();
            let start = scheme.energies().unwrap().total();
            let (mut contacts, mut largest) = (0, 0.0_f64);
            while scheme.time() < 0.02 {
                scheme.advance().unwrap();
                largest = largest.max((scheme.energies().unwrap().total() / start - 1.0).abs());
                contacts += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
            }
            println!("{step}: {largest:e}, {contacts} steps in contact");
            assert!(largest <= 1e-12, "{step}: {largest:e}");
            assert!(contacts >= 10, "{step}: {contacts}");
        }
    }
}

/// The massless part of the plate bends without regard to stretching. An equilibrium, which regards
/// it, therefore stays at rest only as far as the mesh is fine.
#[test]
fn an_equilibrium_stays_at_rest_as_the_mesh_is_refined() {
    for scheme in ["conserving", "newmark", "midpoint"] {
        let kinetic = [6, 12].map(|cells| {
            let rows = run(&format!(
                "{SQUARE}{}{}in_plane.stretching = true\nload.pressure = 17.47\ninitial.equilibrium = true\n\
                 time = {{ scheme = \"{scheme}\", mass = \"singular\", step = 2e-4, end = 0.1 }}\n",
                all_round("clamped"),
                grid("fvs", cells, cells),
            ));
            rows.iter().map(|row| row.kinetic).fold(0.0, f64::max) / rows[0].elastic
        });
        println!("{scheme}: {kinetic:?}");
        assert!(kinetic[0] <= 2e-9 && kinetic[1] <= 0.02 * kinetic[0], "{scheme}: {kinetic:?}");
    }
}

/// Neither kicks nor the scaling of the rates move a free plate as a whole.
#[test]
fn a_free_plate_keeps_its_momentum() {
    let text = format!(
        "plate = {{ length = 0.4, width = 0.3, thickness = 1e-3, youngs_modulus = 70e9, poissons_ratio = 0.33, \
         density = 2700 }}\n{}in_plane.stretching = true\n\
         initial.velocity = \"-3 + 60*x - 20*y + 10*sin(20*x)\"\n\
         time = {{ scheme = \"conserving\", mass = \"singular\", step = 2e-5, end = 0.01 }}\n",
        grid("hct", 6, 4)
    );
    let (scene, model) = (scene(&text), model(&text));
    let mut scheme = model.scheme(&scene).unwrap();
    // A free plate has three dofs per node: deflection and slopes.
    let motions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|[w, x, y]| {
        let mut motion = vec![0.0; model.start.displacement.len()];
        for site in &model.sites {
            let deflection = w + x * site.at[0] + y * site.at[1];
            motion[site.dof..site.dof + 3].copy_from_slice(&[deflection, x, y]);
        }
        motion
    });
    let momenta = |scheme: &mut dyn Scheme| {
        let velocity = scheme.velocity().unwrap();
        let mut momentum = vec![0.0; velocity.len()];
        model.system.engine.multiply(&model.system.mass, &velocity, &mut momentum).unwrap();
        [0, 1, 2].map(|k| motions[k].iter().zip(&momentum).map(|(r, p)| r * p).sum::<f64>())
    };
    let start = momenta(&mut *scheme);
    let size = start.iter().fold(0.0_f64, |size, p| size.max(p.abs()));
    while scheme.time() < 0.01 {
        scheme.advance().unwrap();
        let now = momenta(&mut *scheme);
        for (now, start) in now.iter().zip(start) {
            assert!((now - start).abs() <= 1e-10 * size, "{now:e} for {start:e} at {}", scheme.time());
        }
    }
}

/// A square thrown in the shape of its first mode: without contact the true energy and the motion
/// are of second order in the step.
#[test]
fn motions_converge_with_order_two() {
    let pairs = [
        ("newmark", "singular"),
        ("newmark", "consistent"),
        ("midpoint", "singular"),
        ("midpoint", "consistent"),
        ("conserving", "singular"),
    ];
    for (scheme, mass) in pairs {
        let results = [1e-3, 5e-4, 2.5e-4].map(|step| {
            let (rows, outcome) = run_to_end(&format!(
                "{SQUARE}{}{}in_plane.stretching = true\n\
                     initial.velocity = \"0.3*sin(pi*x)*sin(pi*y)\"\n\
                     time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = {step:?}, end = 0.4 }}\n\
                     output = {{ probes = [{{ name = \"centre\", at = [0.5, 0.5] }}] }}\n",
                all_round("simply_supported"),
                grid("fvs", 8, 8)
            ));
            let off = |row: &Instant| (row.energy / rows[0].energy - 1.0).abs();
            let worst = rows.iter().map(off).fold(0.0, f64::max);
            assert!(outcome.stretching_gap.is_some() == (scheme != "conserving"));
            (rows[rows.len() - 1].probes[0], worst, outcome.stretching_gap.unwrap_or(0.0))
        });
        let [(a, first, early), (b, _, _), (c, last, late)] = results;
        let order = ((a - b) / (b - c)).abs().log2();
        println!("{scheme}, {mass}: order {order:.2}, {results:?}");
        assert!((1.6..=2.5).contains(&order), "{scheme}, {mass}: {order}");
        if scheme == "conserving" {
            assert!(first.max(last) <= 1e-12, "{results:?}");
            continue;
        }
        assert!(last <= 0.1 * first && late <= 0.1 * early, "{scheme}, {mass}: {results:?}");
        assert!(last <= 5e-3 && late <= 5e-3, "{scheme}, {mass}: {results:?}");
    }
}

/// The mesh moves as its modes do, from a start that few modes represent.
#[test]
fn the_mesh_moves_as_its_modes() {
    let probe = "output.probes = [{ name = \"c\", at = [0.5, 0.1] }]";
    let place = |scheme: &str| {
        let rows = run(&strip(scheme, 5e-6, 0.006, probe));
        rows[rows.len() - 1].probes[0]
    };
    let mesh = place("\"newmark\", mass = \"consistent\"");
    let modes = [10, 20, 40].map(|m| place(&format!("\"conserving\", mass = \"modal\", modes = {m}")));
    println!("{mesh}, {modes:?}");
    let off = modes.map(|modes| (modes - mesh).abs() / 9.6e-3);
    assert!(off[1] <= 0.3 * off[0] && off[2] <= 2e-3, "{off:?}");
}

/// Small motions are those of a plate that only bends.
#[test]
fn small_motions_are_linear() {
    for scheme in [
        "\"newmark\", mass = \"singular\"",
        "\"midpoint\", mass = \"singular\", massless = \"reflected\"",
        "\"conserving\", mass = \"singular\"",
    ] {
        let probe = "output.probes = [{ name = \"c\", at = [0.5, 0.1] }]";
        let text = strip(scheme, 2e-5, 0.005, probe).replace("9.6e-3*sin", "1e-7*sin");
        let [stretched, bent] =
            [&text, &text.replace("in_plane.stretching = true\n", "")].map(|text| run(text));
        let [stretched, bent] = [stretched, bent].map(|rows| rows[rows.len() - 1].probes[0]);
        assert!((stretched - bent).abs() <= 1e-14, "{scheme}: {stretched:e}, {bent:e}");
    }
}

#[test]
fn checkpoints_restore_the_bits() {
    for scheme in ["newmark", "midpoint", "conserving"] {
        let scheme = &format!("\"{scheme}\", mass = \"singular\"");
        let text = strip(scheme, 4e-5, 0.016, STOPS);
        let (scene, model) = (scene(&text), model(&text));
        let mut scheme = model.scheme(&scene).unwrap();
        let mut archive = Archive::Saves(Vec::new());
        for step in 0..400 {
            if step == 200 {
                scheme.archive(&mut archive).unwrap();
            }
            scheme.advance().unwrap();
        }
        let mut resumed = model.scheme(&scene).unwrap();
        let entries = archive.into_entries().into_iter();
        resumed.archive(&mut Archive::Restores { entries, same_processes: true }).unwrap();
        (200..400).for_each(|_| resumed.advance().unwrap());
        let bits = |scheme: &dyn Scheme| -> Vec<u64> {
            let numbers = scheme.displacement().iter().chain(scheme.reaction()).map(|x| x.to_bits());
            numbers.chain([scheme.invariant().unwrap().to_bits()]).collect()
        };
        assert!(bits(&*resumed) == bits(&*scheme), "{text}");
    }
}

#[test]
fn what_cannot_stretch_on_the_mesh_is_refused() {
    let refused = |text: &str| refusal(text).to_string();
    let error = refused(&strip("\"exact\", mass = \"singular\"", 1e-5, 1e-3, ""));
    assert!(error.contains("time.scheme: contradicts in_plane.stretching"), "{error}");
    let error =
        refused(&strip("\"midpoint\", mass = \"singular\", massless = \"equilibrium\"", 1e-5, 1e-3, ""));
    assert!(error.contains("time.massless") && error.contains("in_plane.stretching"), "{error}");
    let moving = strip("\"newmark\", mass = \"singular\"", 1e-5, 1e-3, "").replacen(
        "kind =",
        "motion = \"1e-3*t\", kind =",
        1,
    );
    let error = refused(&moving);
    assert!(error.contains("motion: contradicts in_plane.stretching"), "{error}");
    // A plate that its forces buckle starts where the scene says.
    let buckled = strip(
        "\"newmark\", mass = \"singular\"",
        1e-5,
        1e-3,
        "initial.equilibrium = true\nin_plane.tension.xx = -1e6",
    );
    let error = refused(&buckled);
    assert!(error.contains("buckle the plate") && error.contains("time.mass = \"modal\""), "{error}");
}
