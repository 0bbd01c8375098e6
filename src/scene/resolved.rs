//! The resolved scene as TOML, aligned and commented, and its hash.

use super::typed::Choice;
use super::words::SchemeName;
use super::{Grid, Output, Panel, Scene, Scheme, Solver, Study, Time};

/// One line of a table: key, value, comment.
type Row = (&'static str, String, &'static str);

/// The scene as TOML.
pub(super) fn text(scene: &Scene) -> String {
    let mut text = format!("title = {}\n", string(&scene.title));
    section(&mut text, "[plate]", &plate(&scene.plate));
    section(&mut text, "[mesh]", &mesh(&scene.mesh));
    for support in &scene.supports {
        let kind = ("kind", word(support.kind), "clamped | simply_supported | guided");
        section(
            &mut text,
            "[[support]]",
            &[("edge", word(support.edge), "left | right | bottom | top"), kind],
        );
    }
    for obstacle in &scene.obstacles {
        let height = ("height", number(obstacle.height), "m");
        section(&mut text, "[[obstacle]]", &[("side", word(obstacle.side), "below | above"), height]);
    }
    if let Some(load) = scene.load {
        section(&mut text, "[load]", &[("pressure", number(load.pressure), "Pa, upward")]);
    }
    let static_pressure = ("static_pressure", number(scene.initial.static_pressure), "Pa, upward");
    section(
        &mut text,
        "[initial]",
        &[static_pressure, ("velocity", number(scene.initial.velocity), "m/s, upward")],
    );
    section(&mut text, "[time]", &time(&scene.time));
    section(&mut text, "[solver]", &solver(&scene.solver));
    section(&mut text, "[output]", &output(&scene.output));
    text += &probes(&scene.output);
    if let Some(of) = &scene.study {
        section(&mut text, "[study]", &study(of));
    }
    text
}

/// FNV-1a, 64 bits.
pub(super) fn fnv1a(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

fn plate(panel: &Panel) -> Vec<Row> {
    vec![
        ("length", number(panel.length), "m, along x"),
        ("width", number(panel.width), "m, along y"),
        ("thickness", number(panel.plate.thickness), "m"),
        ("youngs_modulus", number(panel.plate.youngs_modulus), "Pa"),
        ("poissons_ratio", number(panel.plate.poissons_ratio), ""),
        ("density", number(panel.plate.density), "kg/m3"),
    ]
}

fn mesh(grid: &Grid) -> Vec<Row> {
    let [nx, ny] = grid.cells;
    let mut rows = vec![
        ("element", word(grid.element), "hct | fvs"),
        ("cells", format!("[{nx}, {ny}]"), "rectangles along x and y"),
    ];
    rows.extend(grid.diagonal.map(|diagonal| ("diagonal", word(diagonal), "right | left | alternating")));
    rows.push(("refine", grid.refine.to_string(), "uniform refinements after that"));
    rows
}

fn time(time: &Time) -> Vec<Row> {
    let (scheme, parameters) = match time.scheme {
        Scheme::Newmark { beta, restitution } => {
            let beta = ("beta", number(beta), "");
            (SchemeName::Newmark, vec![beta, ("restitution", number(restitution), "0 to 1")])
        }
        Scheme::Midpoint { massless } => {
            let massless = ("massless", word(massless), "equilibrium | reflected");
            (SchemeName::Midpoint, vec![massless])
        }
        Scheme::Conserving => (SchemeName::Conserving, vec![]),
        Scheme::Exact => (SchemeName::Exact, vec![]),
    };
    let mut rows = vec![("scheme", word(scheme), "newmark | midpoint | conserving | exact")];
    rows.push(("mass", word(time.mass), "singular | consistent"));
    rows.extend(parameters);
    rows.extend([("step", number(time.step), "s"), ("end", number(time.end), "s")]);
    rows
}

fn solver(solver: &Solver) -> Vec<Row> {
    vec![
        ("engine", word(solver.engine), "native | petsc"),
        ("vi", word(solver.vi), "condensed | snes | tao"),
        ("tolerance", number(solver.tolerance), "relative KKT residual of each step"),
        ("energy_guard", number(solver.energy_guard), "energy over its start that stops a run"),
    ]
}

fn output(output: &Output) -> Vec<Row> {
    let mut rows = vec![("every", output.every.to_string(), "steps between rows of history.csv")];
    if let Some(fields) = output.fields {
        rows.push(("fields_every", fields.every.to_string(), "steps between snapshots"));
        rows.push(("subdivide", fields.subdivide.to_string(), "parts of each edge in snapshots"));
    }
    rows
}

fn probes(output: &Output) -> String {
    if output.probes.is_empty() {
        return "probes = []\n".to_owned();
    }
    let row =
        |[x, y]: [f64; 2], name| format!("  {{ name = {name}, at = [{}, {}] }},\n", number(x), number(y));
    let rows: String = output.probes.iter().map(|probe| row(probe.at, string(&probe.name))).collect();
    format!("probes = [ # m\n{rows}]\n")
}

fn study(study: &Study) -> Vec<Row> {
    let cells: Vec<String> = study.cells.iter().map(|[nx, ny]| format!("[{nx}, {ny}]")).collect();
    let refinements: Vec<String> = study.refinements.iter().map(u32::to_string).collect();
    let [nx, ny] = study.reference_cells;
    let mut rows = vec![
        ("schemes", words(&study.schemes), ""),
        ("masses", words(&study.masses), ""),
        ("restitutions", numbers(&study.restitutions), "newmark"),
        ("steps", numbers(&study.steps), "s"),
        ("elements", words(&study.elements), ""),
        ("cells", format!("[{}]", cells.join(", ")), ""),
        ("refinements", format!("[{}]", refinements.join(", ")), ""),
        ("engines", words(&study.engines), ""),
        ("vi", words(&study.vi), ""),
        ("reference_cells", format!("[{nx}, {ny}]"), "mesh that measures the error in space"),
    ];
    if !study.at.is_empty() {
        rows.push(("at", numbers(&study.at), "s, instants at which errors of the deflection are told"));
    }
    rows.push(("until", word(study.until), "first_impact | second_impact | end: what ranks the runs"));
    rows.push(("repeat", study.repeat.to_string(), "timed repetitions"));
    rows
}

fn words(choices: &[impl Choice]) -> String {
    let words: Vec<String> = choices.iter().map(|choice| word(*choice)).collect();
    format!("[{}]", words.join(", "))
}

fn numbers(values: &[f64]) -> String {
    let numbers: Vec<String> = values.iter().map(|value| number(*value)).collect();
    format!("[{}]", numbers.join(", "))
}

/// A table whose equal signs and comments stand below one another.
fn section(text: &mut String, header: &str, rows: &[Row]) {
    let key_width = rows.iter().map(|(key, ..)| key.len()).max().unwrap_or(0);
    let value_width = rows.iter().map(|(_, value, _)| value.len()).max().unwrap_or(0);
    *text += &format!("\n{header}\n");
    for (key, value, comment) in rows {
        let hash = if comment.is_empty() { "" } else { "  # " };
        let row = format!("{key:key_width$} = {value:value_width$}{hash}{comment}");
        *text += row.trim_end();
        *text += "\n";
    }
}

/// The shortest text that reads back to the same number.
fn number(value: f64) -> String {
    let (plain, scientific) = (format!("{value:?}"), format!("{value:e}"));
    if plain.len() > 9 && scientific.len() < plain.len() { scientific } else { plain }
}

fn word(choice: impl Choice) -> String {
    string(choice.word())
}

fn string(text: &str) -> String {
    toml::Value::from(text).to_string()
}
