//! Resolved scene as TOML, aligned and commented, and its hash.

use super::toml_text::{
    Row, compliance, formula, given, name, number, numbers, place, region, section, string, word, words,
};
use super::{
    ContactSolver, ElasticEdge, ElementKind, FieldInput, Initial, Mass, MeshFile, Output, Plate, PlateSpec,
    Probe, ProbeQuantity, Region, Scene, SchemeName, Solver, StartFrom, Study, Support, SupportKind,
    SupportLocation, SweepSpec, Time, Value,
};
use crate::modes::ModeRange;
use crate::plate::Orthotropy;
use crate::scheme::registry::OptionValue;

/// Formats the scene as TOML, with files by the path where they were found, or as written.
pub(super) fn text(scene: &Scene, found: bool) -> String {
    let mut text = format!("title = {}\n", string(&scene.title));
    if scene.parameters.iter().next().is_some() {
        text += "\n[parameters]\n";
        text.extend(
            scene.parameters.iter().map(|(name, value)| format!("{} = {}\n", key(name), number(value))),
        );
    }
    let mut section = |header: &str, rows: &[Row]| section(&mut text, header, rows);
    section("[plate]", &plate(&scene.plate, found));
    for part in &scene.parts {
        let mut material = material(&part.plate, part.thickness.as_ref(), found);
        // A part inherits the plate's formula; written here, it would become the part's own.
        if part.thickness == scene.plate.thickness && part.thickness.is_some() {
            material.retain(|(key, ..)| *key != "thickness");
        }
        section("[[part]]", &[region(&part.region), material].concat());
    }
    section("[mesh]", &mesh(scene, found));
    for support in &scene.supports {
        section("[[support]]", &self::support(support, found));
    }
    for obstacle in &scene.obstacles {
        let mut rows = name(obstacle.name.as_ref());
        rows.push(("side", word(obstacle.side), "below | above"));
        rows.push(("height", given(&obstacle.height, found), "m"));
        rows.extend(region(&obstacle.region));
        rows.extend(compliance(obstacle.compliance, stop_units(&obstacle.region)));
        section("[[obstacle]]", &rows);
    }
    if let Some(load) = &scene.load {
        let pressure = ("pressure", given(&load.pressure, found), "Pa, upward");
        section("[load]", &[pressure, ("gravity", number(load.gravity), "m/s2, downward")]);
        for force in &load.forces {
            let value = ("value", given(&force.value, found), "N, upward");
            section("[[load.force]]", &[place(&force.at, force.point.as_deref()), value]);
        }
    }
    for (header, rows) in scene.attachments.tables(found) {
        section(header, &rows);
    }
    scene.sliders.iter().for_each(|slider| section("[[slider]]", &slider.rows()));
    if let Some(damping) = &scene.damping {
        let mut rows = vec![
            ("mass", number(damping.mass), "1/s, Rayleigh's alpha"),
            ("stiffness", number(damping.stiffness), "s, Rayleigh's beta"),
        ];
        if !damping.modal.is_empty() {
            rows.push(("modal", numbers(&damping.modal), "damping ratios of the first modes"));
        }
        section("[damping]", &rows);
    }
    section("[initial]", &initial(&scene.initial, found));
    section("[time]", &time(&scene.time));
    section("[solver]", &solver(&scene.solver));
    section("[output]", &output(&scene.output));
    text += &probes(&scene.output);
    if let Some(of) = &scene.study {
        self::section(&mut text, "[study]", &study(of));
    }
    if let Some(of) = &scene.sweep {
        self::section(&mut text, "[sweep]", &sweep(of));
    }
    text
}

/// Returns the hashed text: the scene as written, its table values, and the state it starts from.
pub(super) fn identity(scene: &Scene) -> String {
    let values = |given: &FieldInput| match &given.value {
        Value::Table { table, .. } => format!("{table:?}\n"),
        Value::Formula(_) => String::new(),
    };
    let from = scene.initial.from.as_ref().map_or(String::new(), |from| format!("{:?}\n", from.motion));
    text(scene, false) + &scene.of_time().map(values).collect::<String>() + &from
}

fn plate(panel: &PlateSpec, found: bool) -> Vec<Row> {
    let mut rows = Vec::new();
    if panel.length > 0.0 {
        rows.push(("length", number(panel.length), "m, along x"));
        rows.push(("width", number(panel.width), "m, along y"));
    }
    rows.extend(material(&panel.plate, panel.thickness.as_ref(), found));
    rows
}

fn material(plate: &Plate, thickness: Option<&FieldInput>, found: bool) -> Vec<Row> {
    let mut rows = vec![
        ("thickness", thickness.map_or(number(plate.thickness), |field| given(field, found)), "m"),
        ("youngs_modulus", number(plate.youngs_modulus), "Pa"),
        ("poissons_ratio", number(plate.poissons_ratio), ""),
        ("density", number(plate.density), "kg/m3"),
    ];
    if let Some(Orthotropy { across, shear_modulus, grain }) = plate.orthotropy {
        rows.push(("youngs_modulus_across", number(across), "Pa"));
        rows.push(("shear_modulus", number(shear_modulus), "Pa"));
        rows.push(("grain", number(grain), "degrees from x"));
    }
    rows
}

fn mesh(scene: &Scene, found: bool) -> Vec<Row> {
    let grid = scene.mesh;
    let mut rows = match &scene.file {
        Some(MeshFile { file, path, scale, merge, parts }) => {
            let mut rows = vec![("file", string(if found { path } else { file }), "")];
            rows.extend(scale.map(|scale| ("scale", number(scale), "makes its coordinates metres")));
            rows.extend(
                merge.map(|merge| ("merge", number(merge), "m, nodes nearer to each other become one")),
            );
            if *parts > 1 {
                rows.push(("parts", parts.to_string(), "that nothing connects"));
            }
            rows
        }
        None => {
            let [nx, ny] = grid.cells;
            vec![
                ("element", word(grid.element), ElementKind::LIST),
                ("cells", format!("[{nx}, {ny}]"), "rectangles along x and y"),
            ]
        }
    };
    rows.extend(grid.diagonal.map(|diagonal| ("diagonal", word(diagonal), "right | left | alternating")));
    rows.push(("refine", grid.refine.to_string(), "uniform refinements after that"));
    rows
}

fn support(support: &Support, found: bool) -> Vec<Row> {
    let mut rows = name(support.name.as_ref());
    match &support.stand {
        SupportLocation::Edge { edge, part } => {
            rows.push(("edge", string(edge), "left | right | bottom | top | a physical curve"));
            rows.extend(part.as_ref().map(|part| ("where", string(&part.to_string()), "")));
        }
        SupportLocation::At(at) => rows.push(("at", numbers(at), "m")),
        SupportLocation::Point(name) => rows.push(("point", string(name), "")),
    }
    let kind = support.elastic.map_or(support.kind, |_| SupportKind::Elastic);
    rows.push(("kind", word(kind), "clamped | simply_supported | guided | elastic"));
    if let Some(ElasticEdge { stiffness, rotation }) = support.elastic {
        rows.extend(stiffness.map(|stiffness| ("stiffness", number(stiffness), "N/m2, against deflection")));
        rows.push(("rotation", number(rotation), "N m/rad/m, against rotation about the edge"));
    }
    rows.extend(support.motion.as_ref().map(|motion| ("motion", given(motion, found), "m")));
    rows
}

/// Returns the units of stiffness and damping of a linear stop opposite to a region.
fn stop_units(region: &Region) -> [&'static str; 2] {
    match region {
        Region::At(_) | Region::Point(_) => ["N/m", "N s/m"],
        Region::Line(_) => ["N/m2", "N s/m2"],
        Region::All | Region::Where(_) | Region::Group(_) => ["N/m3", "N s/m3"],
    }
}

fn initial(initial: &Initial, found: bool) -> Vec<Row> {
    let Initial { static_pressure, equilibrium, deflection, velocity, from } = initial;
    if let Some(StartFrom { folder, path, .. }) = from {
        return vec![("from", string(if found { path } else { folder }), "run folder")];
    }
    let mut rows = vec![("static_pressure", given(static_pressure, found), "Pa, upward")];
    if *equilibrium {
        rows.push(("equilibrium", "true".into(), "at rest under the loads of the first instant"));
    }
    if !deflection.is_zero() {
        rows.push(("deflection", given(deflection, found), "m"));
    }
    rows.push(("velocity", given(velocity, found), "m/s, upward"));
    rows
}

fn time(time: &Time) -> Vec<Row> {
    let mut rows = vec![("scheme", word(time.scheme.name()), SchemeName::LIST)];
    rows.push(("mass", word(time.mass), "singular | consistent | modal"));
    rows.extend(time.modes.map(|modes| match modes {
        ModeRange::Count(count) => ("modes", count.to_string(), "number of modes with inertia"),
        ModeRange::UpTo(highest) => ("up_to", number(highest), "Hz, highest frequency with inertia"),
    }));
    rows.extend(time.scheme.options().into_iter().map(|(key, value, choices)| match value {
        OptionValue::Number(value) => (key, number(value), choices),
        OptionValue::Massless(massless) => (key, word(massless), choices),
    }));
    rows.extend([("step", number(time.step), "s"), ("end", number(time.end), "s")]);
    rows
}

fn solver(solver: &Solver) -> Vec<Row> {
    vec![
        ("engine", word(solver.engine), "native | petsc"),
        ("linear", word(solver.linear), "auto | direct | multigrid"),
        ("vi", word(solver.vi), ContactSolver::LIST),
        ("tolerance", number(solver.tolerance), "relative KKT residual of each step"),
        ("energy_guard", number(solver.energy_guard), "energy over its start that stops a run"),
    ]
}

fn output(output: &Output) -> Vec<Row> {
    let mut rows = vec![("every", output.every.to_string(), "steps between rows of history.csv")];
    if let Some(fields) = output.fields {
        rows.push(("fields_every", fields.every.to_string(), "steps between snapshots"));
        rows.push(("subdivide", fields.subdivide.to_string(), "parts of each edge in snapshots"));
        if fields.stresses {
            rows.push(("stresses", fields.stresses.to_string(), "moments and stresses in snapshots"));
        }
    }
    if output.extremes {
        rows.push(("extremes", output.extremes.to_string(), "largest stress over all steps"));
    }
    if let Some(every) = output.checkpoint_every {
        rows.push(("checkpoint_every", every.to_string(), "steps between checkpoints"));
    }
    rows
}

fn probes(output: &Output) -> String {
    if output.probes.is_empty() {
        return "probes = []\n".to_owned();
    }
    let row = |probe: &Probe| {
        let place = match probe.ball {
            Some(ball) => format!("ball = {ball}"),
            None => {
                let (key, value, _) = self::place(&probe.at, probe.point.as_deref());
                format!("{key} = {value}")
            }
        };
        let quantity = match probe.quantity {
            ProbeQuantity::Deflection => String::new(),
            quantity => format!(", quantity = {}", string(quantity.name())),
        };
        format!("  {{ name = {}, {place}{quantity} }},\n", string(&probe.name))
    };
    let rows: String = output.probes.iter().map(row).collect();
    let are_deflections = output.probes.iter().all(|probe| probe.quantity == ProbeQuantity::Deflection);
    format!("probes = [{}\n{rows}]\n", if are_deflections { " # m" } else { "" })
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
        ("refinements", format!("[{}]", refinements.join(", ")), ""),
        ("engines", words(&study.engines), ""),
        ("vi", words(&study.vi), ""),
    ];
    if study.masses.contains(&Mass::Modal) {
        let modes: Vec<String> = study.modes.iter().map(usize::to_string).collect();
        rows.insert(2, ("modes", format!("[{}]", modes.join(", ")), "numbers of modes with inertia"));
    }
    let measures = "mesh that measures the error in space";
    if study.reference_cells == [0, 0] {
        rows.push(("reference_refine", study.reference_refine.to_string(), measures));
    } else {
        rows.push(("elements", words(&study.elements), ""));
        rows.push(("cells", format!("[{}]", cells.join(", ")), ""));
        rows.push(("reference_cells", format!("[{nx}, {ny}]"), measures));
    }
    if study.reference_mass == Mass::Modal {
        rows.push(("reference_mass", word(study.reference_mass), "singular | modal"));
        rows.push(("reference_modes", study.reference_modes.to_string(), ""));
    }
    if !study.limits {
        rows.push(("limits", study.limits.to_string(), "errors in time and in space are not told apart"));
    }
    if study.floor {
        rows.push(("floor", study.floor.to_string(), "distance between the best runs of all masses"));
    }
    if !study.skip.is_empty() {
        let skip: Vec<String> = study.skip.iter().map(|words| string(words)).collect();
        rows.push(("skip", format!("[{}]", skip.join(", ")), "words of runs that are left out"));
    }
    if !study.at.is_empty() {
        rows.push(("at", numbers(&study.at), "s, instants at which errors of the deflection are told"));
    }
    rows.push(("until", word(study.until), "first_impact | second_impact | end: what ranks the runs"));
    rows.push(("repeat", study.repeat.to_string(), "timed repetitions"));
    rows
}

/// Formats a key of a table, quoted where it is no plain word of TOML.
fn key(name: &str) -> String {
    if name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') { name.to_owned() } else { string(name) }
}

fn sweep(sweep: &SweepSpec) -> Vec<Row> {
    let over: Vec<String> = sweep.over.iter().map(|of| string(&format!("{}={}", of.name, of.text))).collect();
    // A formula of the parameters stays one, since its value changes with them.
    let period = sweep.period.to_string();
    let period = if period.parse::<f64>().is_ok() { formula(&sweep.period) } else { string(&period) };
    let mut rows = vec![
        ("over", format!("[{}]", over.join(", ")), ""),
        ("direction", word(sweep.direction), "apart | up | down | up_and_down"),
        ("period", period, "s, of the drive"),
        ("periods", sweep.periods.to_string(), "of each run"),
        ("settle", sweep.settle.to_string(), "periods before the measured ones"),
        ("tolerance", number(sweep.tolerance), "of equal points, relative to the range of the motion"),
    ];
    if sweep.lyapunov {
        rows.push(("lyapunov", sweep.lyapunov.to_string(), "largest Lyapunov exponent"));
    }
    rows
}
