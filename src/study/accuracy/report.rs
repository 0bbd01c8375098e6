//! Reports of a study: its tables as text, `study.csv` and `study.json`.

use super::front::{ACCURACIES, Axis, SpaceOrder, TimeOrder, cheapest, front};
use super::trajectory::{Deviation, Parts};
use super::whole::Floor;
use super::{Accuracy, Run, mesh_name};
use crate::output::text::{Table, grouped, significant};
use crate::scene::Scene;
use crate::scene::{Horizon, Mass};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Formats a number as `1.2e-3`, or `-` if there is none.
fn small(value: Option<f64>) -> String {
    value.map_or("-".into(), |value| if value == 0.0 { "0".into() } else { format!("{value:.1e}") })
}

/// Formats an order as `2.01`, or `-` if there is none.
fn order(value: Option<f64>) -> String {
    value.map_or("-".into(), |value| format!("{value:.2}"))
}

fn milliseconds(seconds: f64) -> String {
    let value = 1e3 * seconds;
    if value < 100.0 { format!("{value:.1}") } else { format!("{value:.0}") }
}

/// Returns the name of a horizon.
pub(super) fn horizon_words(horizon: Horizon) -> &'static str {
    match horizon {
        Horizon::FirstImpact => "up to the first impact",
        Horizon::SecondImpact => "up to the second impact",
        Horizon::End => "over the whole run",
    }
}

impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{}", self.title)?;
        writeln!(f, "  reference: {}", self.reference)?;
        writeln!(
            f,
            "  errors: root mean square at {}, relative to {} m",
            self.probes.join(", "),
            significant(self.scales.deflection)
        )?;
        if let Some(floor) = self.floor() {
            self.write_floor(f, &floor)?;
        }
        for mesh in self.meshes() {
            self.write_mesh(f, &mesh)?;
        }
        self.write_orders(f)?;
        write_cheapest(f, &self.cheapest())?;
        for dropped in &self.dropped {
            writeln!(f, "left out  {}: {}", dropped.what, dropped.why)?;
        }
        for failure in &self.failures {
            writeln!(f, "FAILED  {}: {}", failure.what, failure.why)?;
        }
        Ok(())
    }
}

impl Accuracy {
    fn write_floor(&self, f: &mut fmt::Formatter, floor: &Floor) -> fmt::Result {
        let Floor { deflection, after_impact, kinetic, runs } = floor;
        writeln!(
            f,
            "  floor: {} {}, {} after impact 1, {} in the energy split: the largest distances among the reference and",
            small(Some(*deflection)),
            horizon_words(self.until),
            small(*after_impact),
            small(*kinetic)
        )?;
        runs.iter().try_for_each(|run| writeln!(f, "    {run}"))
    }

    fn write_mesh(&self, f: &mut fmt::Formatter, mesh: &str) -> fmt::Result {
        writeln!(f)?;
        if self.limits.iter().any(|limit| limit.mesh == mesh) {
            self.write_limits(f, mesh)?;
            writeln!(f)?;
        }
        self.write_runs(f, mesh)
    }

    fn write_limits(&self, f: &mut fmt::Formatter, mesh: &str) -> fmt::Result {
        let mut limits = Table::new(&[
            mesh,
            "computed by",
            "own error,\nimpact 1",
            "\nimpact 2",
            "\nend",
            "in space,\nimpact 1",
            "\nimpact 2",
            "\nend",
        ]);
        for limit in self.limits.iter().filter(|limit| limit.mesh == mesh) {
            let name = if limit.mass == Mass::Modal { &limit.family } else { &limit.mass.to_string() };
            let mut cells = vec![format!("limit, {name}"), limit.source.clone()];
            cells.extend(parts(&limit.own_error, 1.0));
            cells.extend(parts(&limit.space.probes, self.scales.deflection));
            limits.row(cells);
        }
        write!(f, "{limits}")?;
        for limit in self.limits.iter().filter(|limit| limit.mesh == mesh) {
            for why in &limit.refused {
                writeln!(f, "    {} not by {why}", limit.family)?;
            }
        }
        Ok(())
    }

    fn write_runs(&self, f: &mut fmt::Formatter, mesh: &str) -> fmt::Result {
        let (runs, front, floor) = (self.runs_on(mesh), self.front_on(mesh), self.floor());
        let axis = self.ranked_on(mesh).1;
        let has_limits = runs.iter().any(|run| run.time.is_some());
        let (name, errors) = if has_limits { ("", "in time,\nimpact 1") } else { (mesh, "whole,\nimpact 1") };
        let mut table = Table::new(&[
            name,
            "step, s",
            "steps",
            "set-up,\nms",
            "stepping,\nms",
            errors,
            "\nimpact 2",
            "\nend",
            "whole, after\nimpact 1",
            "energy\nsplit",
            "first\nimpact, s",
            "energy\ndrift",
            "VI\niterations",
            "larger\nerror",
            "",
        ]);
        for run in &runs {
            let has_step = run.case.method.scheme.name().has_step();
            let mut cells = vec![run.case.method.to_string()];
            cells.push(if has_step { format!("{:e}", run.case.step) } else { "-".into() });
            cells.push(grouped(run.steps));
            cells.extend([run.set_up_seconds, run.stepping_seconds].map(milliseconds));
            let probes = run.time.as_ref().map_or(&run.whole.probes, |time| &time.probes);
            cells.extend(parts(probes, self.scales.deflection));
            cells.push(small(run.whole.after_impact.map(|d| d.rms / self.scales.deflection)));
            cells.push(small(run.whole.kinetic.map(|d| d.rms)));
            cells.push(small(run.first_impact_error));
            cells.push(small(run.energy_drift.map(|[end, _]| end)));
            cells.push(grouped(run.vi_iterations));
            cells.push(run.dominating().unwrap_or("-").into());
            let on_front = front.iter().any(|other| std::ptr::eq(*other, *run));
            let mark = |is: bool, mark: &str| if is { mark.to_owned() } else { String::new() };
            cells.push(mark(on_front, "*") + &mark(is_at_floor(run, floor.as_ref()), "~"));
            table.row(cells);
        }
        write!(f, "{table}")?;
        writeln!(
            f,
            "    * on the front of {} against seconds   ~ not told from {}",
            axis_words(axis),
            if has_limits { "the limit's own error" } else { "the floor" }
        )?;
        if self.at_once > 1 {
            writeln!(
                f,
                "    {} runs were made at once: the seconds, and the front, are not to be relied on",
                self.at_once
            )?;
        }
        Ok(())
    }

    fn write_orders(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut table = Table::new(&["order in time", "mesh", "up to\nimpact 1", "\nimpact 2", "\nend"]);
        let mut any = false;
        for of in self.time_orders() {
            let orders = [of.first_impact, of.second_impact, of.end];
            if orders.iter().any(Option::is_some) {
                any = true;
                let mut cells = vec![of.method, of.mesh];
                cells.extend(orders.map(order));
                table.row(cells);
            }
        }
        if any {
            write!(f, "\n{table}")?;
        }
        let orders = self.space_orders();
        if !orders.is_empty() {
            let mut table = Table::new(&["order in space, singular mass", "deflection", "energy norm"]);
            for of in orders {
                let family = if of.family == "singular" { String::new() } else { format!(", {}", of.family) };
                table.row([of.meshes.join(" to ") + &family, order(of.l2), order(of.energy)]);
            }
            write!(f, "\n{table}")?;
        }
        Ok(())
    }

    /// Formats `study.csv`: one row per run, every number to the last bit.
    pub fn csv(&self) -> String {
        let mut text = HEADS.join(",") + "\n";
        let floor = self.floor();
        for run in &self.runs {
            let on_mesh = self.front_on(&mesh_name(&run.case.grid));
            let on_front = on_mesh.iter().any(|other| std::ptr::eq(*other, run));
            text += &(row(run, is_at_floor(run, floor.as_ref()), on_front).join(",") + "\n");
        }
        text
    }
}

/// Returns whether a run is not told from its limit or, in a study without limits, from the floor.
fn is_at_floor(run: &Run, floor: Option<&Floor>) -> bool {
    run.at_floor || run.time.is_none() && floor.is_some_and(|floor| run.whole_error < floor.deflection)
}

/// Returns the row of `study.csv` of a run.
fn row(run: &Run, is_at_floor: bool, on_front: bool) -> Vec<String> {
    let method = &run.case.method;
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:e}"));
    let mut row = vec![
        mesh_name(&run.case.grid),
        method.scheme.name().to_string(),
        method.mass.to_string(),
        method.scheme.restitution().map_or(String::new(), |e| e.to_string()),
        method.engine.to_string(),
        method.vi.to_string(),
        format!("{:e}", run.case.step),
        run.dofs.to_string(),
        run.steps.to_string(),
        run.contact_steps.to_string(),
        run.vi_iterations.to_string(),
        run.factorisations.to_string(),
        format!("{:e}", run.set_up_seconds),
        format!("{:e}", run.stepping_seconds),
        optional(run.time_error),
        optional(run.space_error),
    ];
    let columns = |of: Option<Parts<Deviation>>| {
        let rms = |d: Option<Deviation>| optional(d.map(|d| d.rms));
        let max = |d: Option<Deviation>| optional(d.map(|d| d.max));
        let of = of.map(|of| [of.first_impact, of.second_impact, Some(of.end)]).unwrap_or_default();
        of.into_iter().flat_map(move |d| [rms(d), max(d)]).collect::<Vec<String>>()
    };
    row.extend(columns(run.time.as_ref().map(|time| time.probes)));
    row.extend(columns(run.time.as_ref().and_then(|time| time.l2)));
    row.extend(columns(run.time.as_ref().and_then(|time| time.energy)));
    row.push(optional(run.first_impact_error));
    row.extend([0, 1].map(|k| optional(run.energy_drift.map(|drift| drift[k]))));
    row.extend([format!("{:e}", run.worst_kkt), is_at_floor.to_string(), on_front.to_string()]);
    row.push(method.modes.map_or(String::new(), |modes| modes.to_string()));
    row.push(format!("{:e}", run.whole_error));
    row.extend(columns(Some(run.whole.probes)));
    row.push(optional(run.whole.after_impact.map(|d| d.rms)));
    row.push(optional(run.whole.after_impact.map(|d| d.max)));
    row.push(optional(run.whole.kinetic.map(|d| d.rms)));
    row
}

/// Columns of `study.csv`.
///
/// Errors at the probes are in m, L2 norms in m2, energy norms in J^(1/2); `time_error`,
/// `space_error`, `whole_error` and `energy_split` are relative.
const HEADS: [&str; 51] = [
    "mesh",
    "scheme",
    "mass",
    "restitution",
    "engine",
    "vi",
    "step",
    "dofs",
    "steps",
    "contact_steps",
    "vi_iterations",
    "factorisations",
    "set_up_seconds",
    "stepping_seconds",
    "time_error",
    "space_error",
    "probe_rms_first_impact",
    "probe_max_first_impact",
    "probe_rms_second_impact",
    "probe_max_second_impact",
    "probe_rms",
    "probe_max",
    "l2_rms_first_impact",
    "l2_max_first_impact",
    "l2_rms_second_impact",
    "l2_max_second_impact",
    "l2_rms",
    "l2_max",
    "energy_norm_rms_first_impact",
    "energy_norm_max_first_impact",
    "energy_norm_rms_second_impact",
    "energy_norm_max_second_impact",
    "energy_norm_rms",
    "energy_norm_max",
    "first_impact_error",
    "energy_drift",
    "largest_energy_drift",
    "worst_kkt",
    "at_floor",
    "on_front",
    "modes",
    "whole_error",
    "whole_rms_first_impact",
    "whole_max_first_impact",
    "whole_rms_second_impact",
    "whole_max_second_impact",
    "whole_rms",
    "whole_max",
    "whole_rms_after_impact",
    "whole_max_after_impact",
    "energy_split",
];

/// Formats the root mean squares of the three parts, divided by a scale.
fn parts(of: &Parts<Deviation>, scale: f64) -> [String; 3] {
    let relative = |d: Deviation| d.rms / scale;
    [
        small(of.first_impact.map(relative)),
        small(of.second_impact.map(relative)),
        small(Some(relative(of.end))),
    ]
}

/// Returns the name of the error that ranks runs.
fn axis_words(axis: Axis) -> &'static str {
    match axis {
        Axis::Time => "error in time",
        Axis::Whole => "whole error",
    }
}

/// Writes a table for each mesh, and one for all runs.
fn write_cheapest(f: &mut fmt::Formatter, choices: &[CheapestRun]) -> fmt::Result {
    for choices in choices.chunk_by(|a, b| a.among == b.among) {
        let mut table = Table::new(&["accuracy", "run", "ms", "error"]);
        for CheapestRun { accuracy, run, seconds, error, .. } in choices {
            let run = run.clone().unwrap_or_else(|| "none".into());
            let time = seconds.map_or("-".into(), milliseconds);
            table.row([format!("{accuracy:e}"), run, time, small(*error)]);
        }
        write!(f, "\n{}\n{table}", choices[0].among)?;
    }
    Ok(())
}

/// Cheapest run that reaches an accuracy.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheapestRun {
    /// Runs that are compared, and the error that ranks them.
    among: String,
    /// Required relative accuracy.
    accuracy: f64,
    /// Name of the run; `None` if none reaches the accuracy.
    run: Option<String>,
    /// Time of the run, in s.
    seconds: Option<f64>,
    /// Relative error of the run, or the least error of all if none reaches the accuracy.
    error: Option<f64>,
}

/// Content of `study.json`: a study with its evaluation.
#[derive(Debug, Serialize)]
pub struct AccuracySummary<'a> {
    program: &'static str,
    version: &'static str,
    /// Command that made the study.
    command: &'a str,
    /// Hash of the scene.
    scene: &'a str,
    /// Scene with every default filled in.
    resolved: &'a Scene,
    #[serde(flatten)]
    accuracy: &'a Accuracy,
    cheapest: Vec<CheapestRun>,
    time_orders: Vec<TimeOrder>,
    space_orders: Vec<SpaceOrder>,
    floor: Option<Floor>,
}

impl Accuracy {
    /// Returns the content of `study.json`, given the command, the scene and its hash.
    pub fn summary<'a>(
        &'a self,
        command: &'a str,
        resolved: &'a Scene,
        scene: &'a str,
    ) -> AccuracySummary<'a> {
        AccuracySummary {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            command,
            scene,
            resolved,
            accuracy: self,
            cheapest: self.cheapest(),
            time_orders: self.time_orders(),
            space_orders: self.space_orders(),
            floor: self.floor(),
        }
    }

    /// Reads an unfinished study of the same scene from a `study.json`; `None` for any other.
    pub fn stopped(json: &[u8], scene: &str) -> Option<Accuracy> {
        #[derive(Deserialize)]
        struct Stopped {
            version: String,
            scene: String,
            #[serde(flatten)]
            accuracy: Accuracy,
        }
        let known: Stopped = serde_json::from_slice(json).ok()?;
        let same = known.version == env!("CARGO_PKG_VERSION") && known.scene == scene;
        (same && !known.accuracy.complete).then_some(known.accuracy)
    }

    /// Returns the cheapest run at each accuracy.
    ///
    /// On each mesh the [error that ranks](Accuracy::ranked_on) its runs counts, then among all
    /// runs the whole error.
    pub fn cheapest(&self) -> Vec<CheapestRun> {
        let words = horizon_words(self.until);
        let on_mesh = |mesh: &String| {
            let (runs, axis) = self.ranked_on(mesh);
            (format!("cheapest on {mesh}: {}, {words}", axis_words(axis)), runs, axis)
        };
        let mut groups: Vec<(String, Vec<&Run>, Axis)> = self.meshes().iter().map(on_mesh).collect();
        let all = format!("cheapest of all: error in time and space, {words}");
        groups.push((all, self.runs.iter().collect(), Axis::Whole));
        let choices = |(among, runs, axis): (String, Vec<&Run>, Axis)| {
            let front = front(&runs, axis);
            ACCURACIES.map(|accuracy| {
                let run = cheapest(&front, axis, accuracy);
                CheapestRun {
                    among: among.clone(),
                    accuracy,
                    run: run.map(|run| run.case.to_string()),
                    seconds: run.map(Run::seconds),
                    error: run.or(front.last().copied()).map(|run| axis.error(run)),
                }
            })
        };
        groups.into_iter().flat_map(choices).collect()
    }
}
