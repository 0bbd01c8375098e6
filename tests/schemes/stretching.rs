//! Plates whose mid-plane stretches, in modes: equilibria and frequencies of another program, the
//! energy through impacts, and restarts.

use crate::common::branches::{free, interpolated};
use crate::common::scenes::{
    Drawing, Instant, STILL, all_round, close, grid, inspect, refusal, run, run_to_end,
};
use rebond::continuation::BranchRow;
use serde_json::Value;
use std::f64::consts::PI;

/// Plate of 1 m x 1 m and h = 1 cm with D = 1 N m and rho h = 1 kg/m2, so that lambda = omega.
const SQUARE: &str = "plate = { length = 1, width = 1, thickness = 0.01, youngs_modulus = 10.92e6, \
                      poissons_ratio = 0.3, density = 100 }\n";
const THICKNESS: f64 = 0.01;
/// Lowest lambda of the clamped square.
const CLAMPED_SQUARE: f64 = 35.9851913;

/// Returns a plate with an edge all round, held or free in its plane.
fn scene(kind: &str, in_plane: &str, cells: usize, rest: &str) -> String {
    let supports = all_round(kind).replace("kind =", &format!("in_plane = \"{in_plane}\", kind ="));
    format!(
        "{SQUARE}{supports}{}in_plane.stretching = true\n{rest}\n\
         output = {{ probes = [{{ name = \"centre\", at = [0.5, 0.5] }}] }}\n",
        grid("fvs", cells, cells)
    )
}

/// Asserts that values on 8 and 16 cells tend to the exact one with order 2, and that their
/// extrapolation is within a tolerance.
fn converges(what: &str, exact: f64, tolerance: f64, value: impl Fn(usize) -> f64) {
    let [coarse, fine] = [8, 16].map(&value);
    let order = ((coarse / exact - 1.0) / (fine / exact - 1.0)).abs().log2();
    println!("{what}: {coarse}, {fine} for {exact}, order {order:.2}");
    assert!((1.6..=2.6).contains(&order), "{what}: order {order}");
    close(what, (4.0 * fine - coarse) / 3.0, exact, tolerance);
}

#[test]
fn equilibria_of_squares() {
    let reference: Value = serde_json::from_str(include_str!("../data/inplane.json")).unwrap();
    for (name, kind) in [("SSSS", "simply_supported"), ("CCCC", "clamped")] {
        for in_plane in ["held", "free"] {
            let key = format!("{name} {in_plane}");
            for load in ["10", "40"] {
                let exact = reference["square_static_w_over_h_by_P"][load][&key].as_f64().unwrap();
                // P = q a^4 / (E h^4)
                let pressure = load.parse::<f64>().unwrap() * 10.92e6 * THICKNESS.powi(4);
                let rest = format!(
                    "load.pressure = {pressure}\ninitial.equilibrium = true\n\
                     time = {{ scheme = 'conserving', mass = 'modal', modes = 30, step = 1e-3, end = 1e-3 }}"
                );
                let value = |cells| run(&scene(kind, in_plane, cells, &rest))[0].probes[0] / THICKNESS;
                converges(&format!("{key}, P = {load}"), exact, 2e-4, value);
            }
        }
    }
}

/// Returns a clamped disc of radius 1 m at rest under a pressure P = q / (E h^4).
fn disc(rings: usize, in_plane: &str, load: f64) -> String {
    let file = Drawing::disc(rings).write(&format!("stretched-{rings}-{in_plane}.msh"));
    format!(
        "plate = {{ thickness = 0.01, youngs_modulus = 10.92e6, poissons_ratio = 0.3, density = 100 }}\n\
         mesh.file = \"{file}\"\nin_plane.stretching = true\n\
         support = [{{ edge = \"rim\", kind = \"clamped\", in_plane = \"{in_plane}\" }}]\n\
         load.pressure = {}\ninitial.equilibrium = true\n\
         time = {{ scheme = 'conserving', mass = 'modal', modes = 20, step = 1e-3, end = 1e-3 }}\n\
         output = {{ probes = [{{ name = \"centre\", at = [0, 0] }}] }}\n",
        load * 10.92e6 * THICKNESS.powi(4)
    )
}

#[test]
fn equilibria_of_clamped_discs() {
    let reference: Value = serde_json::from_str(include_str!("../data/inplane.json")).unwrap();
    for (which, in_plane) in ["held", "free"].into_iter().enumerate() {
        for load in [1.0, 5.0, 10.0] {
            let values = &reference["clamped_disc_static_held_free_by_P"][load.to_string()];
            let value = |cells| run(&disc(cells, in_plane, load))[0].probes[0] / THICKNESS;
            converges(&format!("disc, {in_plane}, {load}"), values[which].as_f64().unwrap(), 1e-3, value);
        }
    }
    let error = refusal(&disc(4, "normal", 5.0)).to_string();
    assert!(error.contains("in_plane: \"normal\" at (") && error.contains("oblique"), "{error}");
}

/// Frequency of w'' + w + alpha w^3 = 0 at an amplitude, by the integral over a quarter period.
fn duffing(alpha: f64, amplitude: f64) -> f64 {
    let count = 1000;
    let speed = |k: usize| {
        let sine = (0.5 * PI * (k as f64 + 0.5) / f64::from(count)).sin();
        (1.0 + 0.5 * alpha * amplitude.powi(2) * (1.0 + sine * sine)).sqrt()
    };
    1.0 / ((0..count as usize).map(|k| 1.0 / speed(k)).sum::<f64>() / f64::from(count))
}

/// A single mode moves as an oscillator of Duffing. On clamped edges its shape has no formula, and
/// the probe gives its amplitude.
#[test]
fn frequencies_of_one_mode() {
    let [supported, clamped] = [("simply_supported", 2.0 * PI * PI, 1), ("clamped", CLAMPED_SQUARE, 2)];
    for ((kind, linear, power), in_plane, alpha) in [
        (supported, "held", 1.322948),
        (supported, "normal", 1.31625),
        (supported, "free", 0.1772359),
        (clamped, "held", 0.482796),
        (clamped, "normal", 0.474006),
        (clamped, "free", 0.157306),
    ] {
        for amplitude in [0.2, 0.4, 1.0] {
            let ratio = |cells| {
                let rest = format!(
                    "initial.deflection = '{amplitude:?}*0.01*(sin(pi*x)*sin(pi*y))^{power}'\n\
                     time = {{ scheme = 'conserving', mass = 'modal', modes = 1, step = 1e-3, end = 2 }}"
                );
                let rows = run(&scene(kind, in_plane, cells, &rest));
                let crosses = rows.windows(2).enumerate().filter_map(|(k, pair)| {
                    let [from, to] = [pair[0].probes[0], pair[1].probes[0]];
                    ((from > 0.0) != (to > 0.0)).then(|| k as f64 + from / (from - to))
                });
                let instants: Vec<f64> = crosses.collect();
                let span = (instants[instants.len() - 1] - instants[0]) * 1e-3;
                let frequency = PI * (instants.len() - 1) as f64 / span;
                frequency / linear * duffing(alpha, amplitude) / duffing(alpha, rows[0].probes[0] / THICKNESS)
            };
            let exact = duffing(alpha, amplitude);
            converges(&format!("{kind}, {in_plane}, {amplitude}"), exact, 1e-3, ratio);
        }
    }
}

/// Free vibrations of twenty modes have the frequencies of converged backbones.
#[test]
fn periodic_motions_of_squares() {
    let reference: Value = serde_json::from_str(include_str!("../data/inplane.json")).unwrap();
    let squares =
        [("SSSS", "simply_supported", 2.0 * PI * PI, 1e-2), ("CCCC", "clamped", CLAMPED_SQUARE, 2e-2)];
    for (name, kind, linear, most) in squares {
        for in_plane in ["held", "normal", "free"] {
            let what = format!("{name} {in_plane}");
            let ratios = &reference["backbone_A_0.2_0.4_1.0"][&what];
            let rest =
                "time = { scheme = 'conserving', mass = 'modal', modes = 20, step = 1e-3, end = 1e-3 }";
            let branches =
                [8, 16].map(|cells| free(&scene(kind, in_plane, cells, rest), [1.2e-4, most], 0.2));
            for (which, amplitude) in [0.2, 0.4, 1.0].into_iter().enumerate() {
                let exact = ratios[which].as_f64().unwrap();
                converges(&format!("{what}, {amplitude}"), exact, 1e-3, |cells| {
                    let rows = &branches[usize::from(cells == 16)];
                    let centre = |row: &BranchRow| (row.probes[0][1] / THICKNESS).powi(2);
                    let ratio = |row: &BranchRow| 2.0 * PI / row.period / linear;
                    interpolated(rows, amplitude * amplitude, centre, ratio)
                });
            }
        }
    }
}

/// Runs a scene over 1e5 steps of four lengths with six modes, and asserts that the energy is kept
/// to rounding.
fn keeps_energy(scene: impl Fn(f64, f64) -> String) -> Vec<(f64, Vec<Instant>)> {
    let kept = |step: f64| {
        let rows = run(&scene(step, 1e5 * step).replace("modes = 12", "modes = 6"));
        let worst = rows.iter().map(|row| (row.energy / rows[0].energy - 1.0).abs()).fold(0.0, f64::max);
        println!("{step}: {worst:e}");
        assert!(worst <= 1e-12, "{step}: {worst:e}");
        (step, rows)
    };
    [4e-5, 2e-5, 1e-5, 5e-6].map(kept).into()
}

/// Returns the number of pairs of consecutive rows of a kind.
fn count(rows: &[Instant], is_counted: impl Fn(&Instant, &Instant) -> bool) -> usize {
    rows.windows(2).filter(|pair| is_counted(&pair[0], &pair[1])).count()
}

fn impacts(rows: &[Instant]) -> usize {
    count(rows, |from, to| from.contact_force == 0.0 && to.contact_force > 0.0)
}

/// A strip between held ends, released from five thicknesses above stops.
fn strip(step: f64, end: f64, more: &str) -> String {
    format!(
        "plate = {{ length = 1, width = 0.2, thickness = 0.002, youngs_modulus = 210e9, poissons_ratio = 0.3, \
         density = 7770 }}\n{}in_plane.stretching = true\n\
         support = [{{ edge = \"left\", kind = \"clamped\" }}, {{ edge = \"right\", kind = \"clamped\" }}]\n\
         obstacle = [{{ side = \"below\", height = -3e-3, where = \"x > 0.45 and x < 0.55\" }}]\n\
         initial.deflection = \"0.0096*16*x^2*(1 - x)^2\"\n\
         time = {{ scheme = \"conserving\", mass = \"modal\", modes = 12, step = {step:?}, end = {end:?} }}\n{more}\n",
        grid("fvs", 20, 4)
    )
}

#[test]
fn impacts_keep_the_energy_at_any_step() {
    for (step, rows) in keeps_energy(|step, end| strip(step, end, "")) {
        let impacts = impacts(&rows);
        assert!(impacts > 20, "{step}: {impacts}");
    }
}

/// The motion up to the first impact is of second order in the step.
#[test]
fn motions_converge_with_order_two() {
    let centre = |step: f64| {
        let rows = run(&strip(step, 0.008, "output.probes = [{ name = \"c\", at = [0.5, 0.1] }]"));
        rows[rows.len() - 1].probes[0]
    };
    let [a, b, c] = [4e-5, 2e-5, 1e-5].map(centre);
    let order = ((a - b) / (b - c)).abs().log2();
    assert!((1.7..=2.5).contains(&order), "{order}: {a}, {b}, {c}");
}

/// A simply supported square with held edges, heated to a multiple of its buckling temperature,
/// with a single mode.
fn heated(multiple: f64, cells: usize, more: &str) -> String {
    let supports = all_round("simply_supported");
    let temperature = multiple * 2.0 * (PI * THICKNESS).powi(2) / (12.0 * 1.3 * 1e-5);
    format!(
        "{}{supports}{}in_plane = {{ stretching = true, temperature = {temperature:?} }}\n{more}\n\
         initial.equilibrium = true\n\
         time = {{ scheme = 'conserving', mass = 'modal', modes = 1, step = 1e-3, end = 1e-3 }}\n\
         output = {{ probes = [{{ name = \"centre\", at = [0.5, 0.5] }}] }}\n",
        SQUARE.replace(" }", ", expansion = 1e-5 }"),
        grid("fvs", cells, cells)
    )
}

/// The energy of one mode, `$\tfrac12 \omega^2 (1 - \lambda) A^2 + \tfrac14 \alpha \omega^2 A^4$`, is
/// least at `$A^2 = (\lambda - 1) / \alpha$`, where small vibrations have the frequency
/// `$\omega \sqrt{2 (\lambda - 1)}$`.
#[test]
fn a_buckled_mode_rests_at_its_least_energy() {
    let amplitude = (0.5_f64 / 1.322948).sqrt();
    converges("amplitude", amplitude, 1e-3, |cells| run(&heated(1.5, cells, ""))[0].probes[0] / THICKNESS);
    let frequency = |cells| inspect(&heated(1.5, cells, "")).modal.unwrap().about_start.unwrap()[0];
    converges("frequency", PI, 2e-3, frequency);
    let up = run(&heated(1.5, 8, ""))[0].probes[0];
    let down = run(&heated(1.5, 8, "initial.deflection = '-1e-4*sin(pi*x)*sin(pi*y)'"))[0].probes[0];
    close("mirrored", -down, up, 1e-9);
    let pushed = run(&heated(1.5, 8, "load.pressure = -1e-3"))[0].probes[0];
    assert!(pushed < -up, "{pushed}, {up}");
    // Below the buckling temperature the plate is flat.
    assert!(run(&heated(0.9, 8, ""))[0].probes[0].abs() <= 1e-12);
    let energy = run(&heated(1.5, 8, ""))[0].energy;
    assert!(energy.abs() <= 1e-12, "{energy:e}");
}

/// Rounding of the energy, whose terms nearly cancel where the plate buckles, does not end the
/// search for its least value.
#[test]
fn heated_panels_have_their_equilibria() {
    let supports =
        "support = [{ edge = \"left\", kind = \"clamped\" }, { edge = \"right\", kind = \"clamped\" }]\n";
    for temperature in ["0", "3", "4.8", "5", "6", "8", "10"] {
        for pressure in ["0", "0.5", "1", "5", "20", "200"] {
            let text = snapping(1e-5, 1e-5, &format!("load.pressure = {pressure}"))
                .replace(&all_round("clamped"), supports)
                .replace("temperature = 5", &format!("temperature = {temperature}"))
                .replace(", velocity = \"-4000*x*y*(x - 0.3)*(y - 0.2)\"", "");
            let centre = run(&text)[0].probes[0];
            assert!(centre > 0.0 || temperature == "0" && pressure == "0", "{temperature} K, {pressure} Pa");
        }
    }
}

/// A heated panel, thrown so that it snaps between its two states, over a stop.
fn snapping(step: f64, end: f64, more: &str) -> String {
    format!(
        "plate = {{ length = 0.3, width = 0.2, thickness = 1e-3, youngs_modulus = 70e9, poissons_ratio = 0.33, \
         density = 2700, expansion = 23e-6 }}\n{}{}in_plane = {{ stretching = true, temperature = 5 }}\n\
         initial = {{ equilibrium = true, velocity = \"-4000*x*y*(x - 0.3)*(y - 0.2)\" }}\n\
         time = {{ scheme = \"conserving\", mass = \"modal\", modes = 12, step = {step:?}, end = {end:?} }}\n\
         output = {{ probes = [{{ name = \"centre\", at = [0.15, 0.1] }}] }}\n{more}\n",
        all_round("clamped"),
        grid("fvs", 8, 6)
    )
}

#[test]
fn a_snapping_plate_keeps_the_energy_at_any_step() {
    let stop = "obstacle = [{ side = \"below\", height = -1e-3 }]";
    for (step, rows) in keeps_energy(|step, end| snapping(step, end, stop)) {
        let snaps = count(&rows, |from, to| from.probes[0] * to.probes[0] < 0.0);
        let impacts = impacts(&rows);
        println!("{snaps} snaps, {impacts} impacts");
        assert!(snaps > 20 && impacts > 20, "{step}: {snaps} snaps, {impacts} impacts");
    }
}

/// The motion through two snaps is of second order in the step.
#[test]
fn snaps_converge_with_order_two() {
    let centre = |step: f64| {
        let rows = run(&snapping(step, 0.0096, ""));
        rows[rows.len() - 1].probes[0]
    };
    let [a, b, c] = [2e-5, 1e-5, 5e-6].map(centre);
    let order = ((a - b) / (b - c)).abs().log2();
    println!("{order}: {a}, {b}, {c}");
    assert!((1.5..=2.6).contains(&order), "{order}: {a}, {b}, {c}");
}

/// A heated panel pressed between two stops stays at rest, but for the error of the scheme.
#[test]
fn equilibria_on_stops_are_equilibria() {
    let stops = "obstacle = [{ side = \"below\", height = -2e-4 }, { side = \"above\", height = 1e-3 }]";
    let mut pressed = 0;
    for temperature in ["1", "5", "10"] {
        for pressure in ["0", "-100", "-3000", "-20000", "3000"] {
            let text = snapping(1e-5, 2e-3, &format!("{stops}\nload.pressure = {pressure}"))
                .replace("temperature = 5", &format!("temperature = {temperature}"))
                .replace(", velocity = \"-4000*x*y*(x - 0.3)*(y - 0.2)\"", "");
            let rows = run(&text);
            let kinetic = rows.iter().map(|row| row.kinetic).fold(0.0, f64::max);
            pressed += usize::from(rows[0].contact_force != 0.0);
            assert!(kinetic <= 1e-9 * rows[0].elastic, "{temperature} K, {pressure} Pa: {kinetic:e}");
        }
    }
    assert!(pressed >= 8, "{pressed}");
}

/// Where the plate hardly stretches, its equilibria on stops are those of a plate that only bends.
#[test]
fn small_equilibria_on_stops_are_linear() {
    let stops = "obstacle = [{ side = \"below\", height = -1e-6, where = \"x > 0.1\" }]";
    let text = snapping(1e-5, 1e-5, &format!("{stops}\nload.pressure = -20"))
        .replace(", velocity = \"-4000*x*y*(x - 0.3)*(y - 0.2)\"", "")
        .replace("temperature = 5", "temperature = -1");
    let [stretched, bent] =
        [&text, &text.replace("stretching = true", "stretching = false")].map(|text| run(text));
    close("force", stretched[0].contact_force, bent[0].contact_force, 1e-4);
    close("energy", stretched[0].elastic, bent[0].elastic, 1e-4);
    assert!(stretched[0].contact_force > 0.0);
}

/// A strip with held ends in the shape a sin(pi x) has the membrane force `$E h \pi^2 a^2 / 4$`
/// everywhere, and the curvature stress `$E h \pi^2 a \sin(\pi x) / 2$` at its faces.
#[test]
fn stresses_have_the_part_of_stretching() {
    let [modulus, thickness, height, tension] = [70e9_f64, 2e-3, 4e-3, 3e3];
    let probe = |name: &str| format!("{{ name = \"{name}\", at = [0.3125, 0.1], quantity = \"{name}\" }}");
    let text = |cells: usize| {
        format!(
            "plate = {{ length = 1, width = 0.2, thickness = {thickness:?}, youngs_modulus = {modulus:?}, poissons_ratio = 0, \
             density = 2700 }}\n{}in_plane = {{ stretching = true, tension = {{ xx = {tension:?} }} }}\n\
             support = [{{ edge = \"left\", kind = \"simply_supported\" }}, {{ edge = \"right\", kind = \"simply_supported\" }}]\n\
             initial.deflection = \"{height:?}*sin(pi*x)\"\n\
             time = {{ scheme = \"conserving\", mass = \"modal\", modes = 2, step = 1e-5, end = 1e-5 }}\n\
             output = {{ extremes = true, probes = [{}, {}, {}] }}\n",
            grid("fvs", cells, 4),
            probe("stress_xx_top"),
            probe("stress_xx_bottom"),
            probe("membrane_xx")
        )
    };
    let middle = modulus * PI * PI * height.powi(2) / 4.0 + tension / thickness;
    let face = modulus * thickness * PI * PI * height / 2.0;
    for cells in [16, 32] {
        let (rows, outcome) = run_to_end(&text(cells));
        let [top, bottom] = [rows[0].probes[0], rows[0].probes[1]];
        let fine = (16.0 / cells as f64).powi(2);
        close("middle", 0.5 * (top + bottom), middle, 2e-2 * fine);
        close("force", rows[0].probes[2], middle * thickness, 2e-2 * fine);
        close("force and stress", rows[0].probes[2], 0.5 * (top + bottom) * thickness, 1e-12);
        close("face", 0.5 * (top - bottom), face * (0.3125 * PI).sin(), 2e-2 * fine);
        // The upper face is in tension by both parts.
        let peak = outcome.extremes.unwrap().von_mises;
        close("largest", peak.value, middle + face, 2e-2);
        assert!((peak.at[0] - 0.5).abs() < 1e-6, "{peak:?}");
    }
}

#[test]
fn what_does_not_stretch_is_refused() {
    let time = "time = { scheme = 'newmark', mass = 'modal', modes = 4, step = 1e-3, end = 1e-3 }";
    let error = refusal(&scene("clamped", "held", 4, time)).to_string();
    assert!(error.contains("time.scheme: contradicts in_plane.stretching"), "{error}");
    let loose = scene(
        "clamped",
        "held",
        4,
        "initial.equilibrium = true\nload.gravity = 9.81\nobstacle = [{ side = \"below\", height = -1e-3 }]\n\
         time = { scheme = 'conserving', mass = 'modal', modes = 4, step = 1e-3, end = 1e-3 }",
    );
    let start = loose.find("support").unwrap();
    let end = start + loose[start..].find('\n').unwrap();
    let error = refusal(&loose.replace(&loose[start..end], "")).to_string();
    assert!(
        error.contains("in_plane.stretching finds its equilibrium only where supports hold it"),
        "{error}"
    );
    let many = "time = { scheme = 'conserving', mass = 'modal', modes = 61, step = 1e-3, end = 1e-3 }";
    let error = refusal(&scene("clamped", "held", 12, many)).to_string();
    assert!(error.contains("time.modes: 61 modes"), "{error}");
    let without = scene("clamped", "held", 4, time).replace("in_plane.stretching = true\n", "");
    let error = refusal(&without).to_string();
    assert!(error.contains("support.0.in_plane") && error.contains("in_plane.stretching"), "{error}");
}

/// Sum of products of sines with amplitudes in m, and `$[w, w] / 2 = w_{xx} w_{yy} - w_{xy}^2$`.
fn sines(terms: &[(i32, i32, f64)]) -> [String; 2] {
    let sum = |f: &str, factor: &dyn Fn(f64, f64) -> f64| {
        let term = |&(m, n, a): &(i32, i32, f64)| {
            format!("{:?}*{f}({m}*pi*x)*{f}({n}*pi*y)", a * factor(m.into(), n.into()))
        };
        terms.iter().map(term).collect::<Vec<_>>().join(" + ")
    };
    let [xx, yy] = [sum("sin", &|m, _| -(PI * m).powi(2)), sum("sin", &|_, n| -(PI * n).powi(2))];
    let xy = sum("cos", &|m, n| PI * PI * m * n);
    [sum("sin", &|_, _| 1.0), format!("({xx})*({yy}) - ({xy})^2")]
}

/// The energy of stretching is the complementary energy of Airy's function, the deflection of a
/// plate with D = 1/(E h) and -nu under the load `$-[w, w] / 2$`, free where the membrane is held
/// and clamped where it is free. On elements it is too small.
#[test]
fn airys_function_bounds_the_energy() {
    let [shape, bracket] = sines(&[(1, 1, 0.008), (2, 1, 0.004)]);
    let corners = ["[0, 0]", "[1, 0]", "[0, 1]"]
        .map(|place| format!("{{ at = {place}, kind = \"simply_supported\" }}"));
    let corners = format!("support = [{}]\n", corners.join(", "));
    // E h^3 = 12 (1 - nu^2) D for a plate 1 m thick.
    let modulus = 12.0 * 0.91 / (10.92e6 * THICKNESS);
    for (in_plane, supports) in [("held", corners), ("free", all_round("clamped"))] {
        let airy = |cells| {
            let text = format!(
                "plate = {{ length = 1, width = 1, thickness = 1, youngs_modulus = {modulus:?}, poissons_ratio = -0.3, \
                 density = 1 }}\n{}{supports}load.pressure = \"-({bracket})\"\ninitial.equilibrium = true\n{STILL}",
                grid("fvs", cells, cells)
            );
            run(&text)[0].elastic
        };
        let bounds = [8, 16, 32].map(airy);
        assert!(bounds[0] < bounds[1] && bounds[1] < bounds[2], "{bounds:?}");
        let exact = (4.0 * bounds[2] - bounds[1]) / 3.0;
        let stretched = |cells| {
            let rest = format!(
                "initial.deflection = \"{shape}\"\n\
                 time = {{ scheme = 'conserving', mass = 'modal', modes = 3, step = 1e-3, end = 1e-3 }}"
            );
            let text = scene("simply_supported", in_plane, cells, &rest);
            let held = format!("in_plane = \"{in_plane}\", ");
            let bent = text.replace("in_plane.stretching = true\n", "").replace(&held, "");
            run(&text)[0].elastic - run(&bent)[0].elastic
        };
        let [coarse, fine] = [8, 16].map(stretched);
        println!("{in_plane}: {bounds:?}, {coarse}, {fine} of {exact}");
        assert!((fine / exact - 1.0).abs() <= 0.25 * (coarse / exact - 1.0).abs(), "{coarse}, {fine}");
        close(in_plane, fine, exact, 1e-3);
    }
}
