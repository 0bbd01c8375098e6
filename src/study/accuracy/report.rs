//! Reports of a study: its tables as text, `study.csv` and `study.json`.

use super::front::{ACCURACIES, Axis, SpaceOrder, TimeOrder, front};
use super::plan::Absent;
use super::trajectory::{Deviation, Parts};
use super::whole::Floor;
use super::{Accuracy, Limit, Run};
use crate::output::text::{TableColumns, grouped, significant, two_digits};
use crate::scene::Scene;
use crate::scene::{Horizon, Mass};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt;

/// Formats a number as `1.2e-3`, or `-` if there is none.
fn small(value: Option<f64>) -> String {
    value.map_or("-".into(), two_digits)
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
        let scale = significant(self.scales.deflection);
        writeln!(f, "{}", self.title)?;
        writeln!(f, "  reference: {}", self.reference)?;
        writeln!(f, "  errors: root mean square at {}, relative to {scale} m", self.probes.join(", "))?;
        if let Some(Floor { deflection, after_impact, kinetic, runs }) = self.floor() {
            let [deflection, after, split] = [Some(deflection), after_impact, kinetic].map(small);
            let until = horizon_words(self.until);
            writeln!(
                f,
                "  floor: {deflection} {until}, {after} after impact 1, {split} in the energy split: \
                 the largest distances among the reference and"
            )?;
            runs.iter().try_for_each(|run| writeln!(f, "    {run}"))?;
        }
        for mesh in self.meshes() {
            self.write_limits(f, &mesh)?;
            if !self.runs_on(&mesh).is_empty() {
                self.write_runs(f, &mesh)?;
            }
        }
        self.write_orders(f)?;
        let mut columns = TableColumns::default();
        columns.add("accuracy", |choice: &CheapestRun| format!("{:e}", choice.accuracy));
        columns.add("run", |choice| choice.run.clone().unwrap_or_else(|| "none".into()));
        columns.add("ms", |choice| choice.seconds.map_or("-".into(), milliseconds));
        columns.add("error", |choice| small(choice.error));
        let choices = if self.runs.is_empty() { vec![] } else { self.cheapest() };
        for choices in choices.chunk_by(|a, b| a.among == b.among) {
            write!(f, "\n{}\n{}", choices[0].among, columns.table(choices))?;
        }
        for alike in self.dropped.chunk_by(|a, b| a.why == b.why) {
            let names: Vec<&str> = alike.iter().map(|absent| &*absent.what).collect();
            writeln!(f, "left out  {}: {}", names.join("; "), alike[0].why)?;
        }
        self.failures.iter().try_for_each(|Absent { what, why }| writeln!(f, "FAILED  {what}: {why}"))?;
        let none = "no run reached the end: expected schemes and masses that take the scene";
        writeln!(f, "\n{}", self.advice().as_deref().unwrap_or(none))
    }
}

impl<'a> TableColumns<'a, Run> {
    /// Adds a column of numbers to the last bit, empty where there is none.
    fn number(&mut self, head: impl Into<String>, value: impl Fn(&Run) -> Option<f64> + 'a) {
        self.add(head, move |run| value(run).map_or(String::new(), |value| format!("{value:e}")));
    }

    /// Adds the root mean square and the maximum of a deviation.
    fn deviation(&mut self, head: &str, end: &str, value: impl Fn(&Run) -> Option<Deviation> + Copy + 'a) {
        self.number(format!("{head}_rms{end}"), move |run| value(run).map(|d| d.rms));
        self.number(format!("{head}_max{end}"), move |run| value(run).map(|d| d.max));
    }

    /// Adds the deviations of the three parts of a run.
    fn parts(&mut self, head: &str, values: fn(&Run) -> Option<Parts<Deviation>>) {
        self.deviation(head, "_first_impact", move |run| values(run)?.first_impact);
        self.deviation(head, "_second_impact", move |run| values(run)?.second_impact);
        self.deviation(head, "", move |run| Some(values(run)?.end));
    }
}

/// Returns whether a run is not told from its limit or, in a study without limits, from the floor.
fn is_at_floor(run: &Run, floor: Option<&Floor>) -> bool {
    run.at_floor || run.time.is_none() && floor.is_some_and(|floor| run.whole_error < floor.deflection)
}

impl<'a, T> TableColumns<'a, T> {
    /// Adds the root mean squares of the three parts of a run, of which the first has this head.
    fn impacts(&mut self, head: &str, values: impl Fn(&T) -> Parts<Deviation> + Copy + 'a) {
        self.add(head, move |item| small(values(item).first_impact.map(|d| d.rms)));
        self.add("\nimpact 2", move |item| small(values(item).second_impact.map(|d| d.rms)));
        self.add("\nend", move |item| small(Some(values(item).end.rms)));
    }
}

/// Returns the name of the error that ranks runs.
fn axis_words(axis: Axis) -> &'static str {
    match axis {
        Axis::Time => "error in time",
        Axis::Whole => "whole error",
    }
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

impl Accuracy {
    /// Returns the content of `study.json`: the study with its evaluation, given the command that
    /// made it, the scene with every default filled in, and its hash.
    pub fn summary(&self, command: &str, resolved: &Scene, scene: &str) -> Value {
        let mut summary = json!({
            "program": env!("CARGO_PKG_NAME"),
            "version": env!("CARGO_PKG_VERSION"),
            "command": command,
            "scene": scene,
            "resolved": resolved,
        });
        let evaluation = json!({
            "cheapest": self.cheapest(),
            "time_orders": self.time_orders(),
            "space_orders": self.space_orders(),
            "floor": self.floor(),
            "advice": self.advice(),
        });
        for part in [json!(self), evaluation] {
            let entries = part.as_object().into_iter().flatten();
            entries.for_each(|(key, value)| summary[key] = value.clone());
        }
        summary
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
        let stopped: Stopped = serde_json::from_slice(json).ok()?;
        let same = stopped.version == env!("CARGO_PKG_VERSION") && stopped.scene == scene;
        (same && !stopped.accuracy.complete).then_some(stopped.accuracy)
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
        let heading = format!("cheapest of all: error in time and space, {words}");
        groups.push((heading, self.runs.iter().collect(), Axis::Whole));
        let choices = |(among, runs, axis): (String, Vec<&Run>, Axis)| {
            let front = front(&runs, axis);
            ACCURACIES.map(|accuracy| {
                let run = front.iter().find(|run| axis.error(run) <= accuracy).copied();
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

    fn write_limits(&self, f: &mut fmt::Formatter, mesh: &str) -> fmt::Result {
        let limits: Vec<&Limit> = self.limits.iter().filter(|limit| limit.mesh == mesh).collect();
        if limits.is_empty() {
            return Ok(());
        }
        let scale = self.scales.deflection;
        let mut columns = TableColumns::default();
        columns.add(mesh, |limit: &Limit| match limit.mass {
            Mass::Modal => format!("limit, {}", limit.family),
            mass => format!("limit, {mass}"),
        });
        columns.add("computed by", |limit| limit.source.clone());
        columns.impacts("own error,\nimpact 1", |limit| limit.own_error);
        columns.impacts("in space,\nimpact 1", move |limit| limit.space.probes.over(scale));
        write!(f, "\n{}", columns.table(limits.iter().copied()))?;
        for Limit { family, refused, .. } in limits {
            refused.iter().try_for_each(|why| writeln!(f, "    {family} not by {why}"))?;
        }
        Ok(())
    }

    fn write_runs(&self, f: &mut fmt::Formatter, mesh: &str) -> fmt::Result {
        let (runs, floor, scale) = (self.runs_on(mesh), self.floor(), self.scales.deflection);
        let has_limits = runs.iter().any(|run| run.time.is_some());
        let (name, errors) = if has_limits { ("", "in time,\nimpact 1") } else { (mesh, "whole,\nimpact 1") };
        let probes = |run: &Run| run.time.as_ref().map_or(run.whole.probes, |time| time.probes);
        let has_step = |run: &Run| run.case.method.scheme.name().has_step();
        let mark = |is: bool, mark: &'static str| if is { mark } else { "" };
        let mut columns = TableColumns::default();
        columns.add(name, |run: &Run| run.case.method.to_string());
        columns.add("step, s", |run| if has_step(run) { format!("{:e}", run.case.step) } else { "-".into() });
        columns.add("steps", |run| grouped(run.steps));
        columns.add("set-up,\nms", |run| milliseconds(run.set_up_seconds));
        columns.add("stepping,\nms", |run| milliseconds(run.stepping_seconds));
        columns.impacts(errors, move |run| probes(run).over(scale));
        columns
            .add("whole, after\nimpact 1", move |run| small(run.whole.after_impact.map(|d| d.rms / scale)));
        columns.add("energy\nsplit", |run| small(run.whole.kinetic.map(|d| d.rms)));
        columns.add("first\nimpact, s", |run| small(run.first_impact_error));
        columns.add("energy\ndrift", |run| small(run.energy_drift.map(|[end, _]| end)));
        columns.add("VI\niterations", |run| grouped(run.vi_iterations));
        columns.add("larger\nerror", |run| run.dominating().unwrap_or("-").into());
        columns.add("", |run| {
            mark(self.is_on_front(run), "*").to_owned() + mark(is_at_floor(run, floor.as_ref()), "~")
        });
        write!(f, "\n{}", columns.table(runs.iter().copied()))?;
        let axis = axis_words(self.ranked_on(mesh).1);
        let floor = if has_limits { "the limit's own error" } else { "the floor" };
        writeln!(f, "    * on the front of {axis} against seconds   ~ not told from {floor}")?;
        if self.at_once > 1 {
            let words = "runs were made at once: the seconds, and the front, are not to be relied on";
            writeln!(f, "    {} {words}", self.at_once)?;
        }
        Ok(())
    }

    fn write_orders(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut columns = TableColumns::default();
        columns.add("order in time", |row: &TimeOrder| row.method.clone());
        columns.add("mesh", |row| row.mesh.clone());
        columns.add("up to\nimpact 1", |row| order(row.first_impact));
        columns.add("\nimpact 2", |row| order(row.second_impact));
        columns.add("\nend", |row| order(row.end));
        let mut orders = self.time_orders();
        orders.retain(|row| row.first_impact.or(row.second_impact).or(row.end).is_some());
        if !orders.is_empty() {
            write!(f, "\n{}", columns.table(&orders))?;
        }
        let mut columns = TableColumns::default();
        columns.add("order in space, singular mass", |row: &SpaceOrder| match &*row.family {
            "singular" => row.meshes.join(" to "),
            family => format!("{}, {family}", row.meshes.join(" to ")),
        });
        columns.add("deflection", |row| order(row.l2));
        columns.add("energy norm", |row| order(row.energy));
        let orders = self.space_orders();
        if orders.is_empty() { Ok(()) } else { write!(f, "\n{}", columns.table(&orders)) }
    }

    /// Formats `study.csv`: one row per run, every number to the last bit.
    pub fn csv(&self) -> String {
        let columns = self.columns();
        let rows = self.runs.iter().map(|run| columns.row(run).join(",") + "\n");
        columns.heads().join(",") + "\n" + &rows.collect::<String>()
    }

    /// Returns the columns of `study.csv`.
    ///
    /// Errors at the probes are in m, L2 norms in m2, energy norms in J^(1/2); `time_error`,
    /// `space_error`, `whole_error` and `energy_split` are relative.
    fn columns(&self) -> TableColumns<'_, Run> {
        let floor = self.floor();
        let mut columns = TableColumns::default();
        columns.add("mesh", |run: &Run| run.mesh.clone());
        columns.add("scheme", |run| run.case.method.scheme.name().to_string());
        columns.add("mass", |run| run.case.method.mass.to_string());
        columns.add("restitution", |run| {
            run.case.method.scheme.restitution().map_or(String::new(), |e| e.to_string())
        });
        columns.add("engine", |run| run.case.method.engine.to_string());
        columns.add("vi", |run| run.case.method.vi.to_string());
        columns.number("step", |run| Some(run.case.step));
        columns.add("dofs", |run| run.dofs.to_string());
        columns.add("steps", |run| run.steps.to_string());
        columns.add("contact_steps", |run| run.contact_steps.to_string());
        columns.add("vi_iterations", |run| run.vi_iterations.to_string());
        columns.add("factorisations", |run| run.factorisations.to_string());
        columns.number("set_up_seconds", |run| Some(run.set_up_seconds));
        columns.number("stepping_seconds", |run| Some(run.stepping_seconds));
        columns.number("time_error", |run| run.time_error);
        columns.number("space_error", |run| run.space_error);
        columns.parts("probe", |run| Some(run.time.as_ref()?.probes));
        columns.parts("l2", |run| run.time.as_ref()?.l2);
        columns.parts("energy_norm", |run| run.time.as_ref()?.energy);
        columns.number("first_impact_error", |run| run.first_impact_error);
        columns.number("energy_drift", |run| run.energy_drift.map(|[end, _]| end));
        columns.number("largest_energy_drift", |run| run.energy_drift.map(|[_, largest]| largest));
        columns.number("worst_kkt", |run| Some(run.worst_kkt));
        columns.add("at_floor", move |run| is_at_floor(run, floor.as_ref()).to_string());
        columns.add("on_front", |run| self.is_on_front(run).to_string());
        columns.add("modes", |run| run.case.method.modes.map_or(String::new(), |modes| modes.to_string()));
        columns.number("whole_error", |run| Some(run.whole_error));
        columns.parts("whole", |run| Some(run.whole.probes));
        columns.deviation("whole", "_after_impact", |run| run.whole.after_impact);
        columns.number("energy_split", |run| run.whole.kinetic.map(|d| d.rms));
        columns
    }
}
