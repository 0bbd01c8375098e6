//! Pictures of a study: work-precision diagrams, orders, energy drift, cost.

use super::front::{Axis as Ranked, front, pareto};
use super::plan::{Method, distinct};
use super::whole::Floor;
use super::{Accuracy, Run, report};
use crate::output::plot::{Axis, Color, Curve, Figure, Panel};
use crate::scene::{ElementKind, Horizon, Mass};

/// Name of the hatched band within which methods with the same limit differ.
const FLOOR: &str = "best runs of all masses differ";
/// Lower edge of a picture relative to the least error of any method with a step.
const EDGE: f64 = 0.1;

/// Returns the pictures of a study with their names; each shows the command that made it.
pub fn figures(accuracy: &Accuracy, command: &str) -> Vec<(String, Figure)> {
    let mut figures = Vec::new();
    let mut draw = |name: &str, title: &str, panels: Vec<Panel>| {
        if !panels.is_empty() {
            let figure = panels.into_iter().fold(Figure::new(title).note(command), Figure::panel);
            figures.push((name.to_owned(), figure));
        }
    };
    let meshes = accuracy.meshes();
    for mesh in &meshes {
        let (ranked, axis) = accuracy.ranked_on(mesh);
        let on_mesh = OnMesh { accuracy, runs: accuracy.runs_on(mesh), ranked, axis };
        if on_mesh.runs.is_empty() {
            continue;
        }
        let name = |what: &str| format!("{what}-{}", mesh.replace(' ', "-"));
        let work_precision = vec![on_mesh.work_precision()];
        draw(&name("work-precision"), &format!("Work and precision, {mesh}"), work_precision);
        if on_mesh.runs.iter().any(|run| run.time.is_some()) {
            draw(&name("orders"), &format!("Convergence in time, {mesh}"), on_mesh.orders());
        }
        draw(&name("energy-drift"), &format!("Energy drift, {mesh}"), vec![on_mesh.energy_drift()]);
    }
    if meshes.len() > 1 && !accuracy.runs.is_empty() {
        draw("work-precision", "Work and precision", vec![whole(accuracy, &meshes)]);
    }
    draw("after-impact", "After the first impact", after_impact(accuracy));
    draw("cost", "Cost of a run", cost(accuracy));
    figures
}

/// Abbreviates the name of a method; the singular mass is left out.
fn short(method: &Method) -> String {
    method.to_string().replace(&format!(" {}", Mass::Singular), "").replace("consistent", "cons.")
}

/// Groups runs by what they have in common, in their order.
fn grouped<'r, K: PartialEq>(
    runs: impl IntoIterator<Item = &'r Run>,
    key: impl Fn(&Run) -> K,
) -> Vec<(K, Vec<&'r Run>)> {
    let mut groups: Vec<(K, Vec<&Run>)> = Vec::new();
    for run in runs {
        let name = key(run);
        match groups.iter_mut().find(|(other, _)| *other == name) {
            Some((_, runs)) => runs.push(run),
            None => groups.push((name, vec![run])),
        }
    }
    groups
}

/// Creates a panel with logarithmic axes.
fn panel(x: Axis, name: &str, heading: impl Into<String>, height: f64) -> Panel {
    Panel::new(x, Axis::log(name, "")).heading(heading).height(height)
}

/// Creates the curve of a method; names are left out where a panel above shows them.
fn curve(number: usize, name: &str, named: bool, points: Vec<[f64; 2]>) -> Curve {
    Curve::new(if named { name } else { "" }, points).style(number).marks(number)
}

/// Runs on one mesh.
struct OnMesh<'a> {
    accuracy: &'a Accuracy,
    runs: Vec<&'a Run>,
    /// Runs that are ranked.
    ranked: Vec<&'a Run>,
    /// Error that ranks them.
    axis: Ranked,
}

impl<'a> OnMesh<'a> {
    /// Creates one curve per method; names are left out where a panel above shows them.
    fn curves(&self, named: bool, point: impl Fn(&Run) -> [f64; 2]) -> Vec<Curve> {
        let methods = grouped(self.runs.iter().copied(), |run| run.case.method).into_iter().enumerate();
        let of_method = |(number, (method, runs)): (usize, (Method, Vec<&Run>))| {
            curve(number, &short(&method), named, runs.into_iter().map(&point).collect())
        };
        methods.map(of_method).collect()
    }

    /// Draws the error that ranks the runs over their time, with rounding errors at the lower edge.
    ///
    /// Errors far below those of methods with a step count as rounding; the heading names their
    /// size.
    fn work_precision(&self) -> Panel {
        let errors = |runs: &[&Run]| {
            runs.iter().map(|run| self.axis.error(run)).filter(|error| *error > 0.0).reduce(f64::min)
        };
        let edge = errors(&self.stepping().runs).map_or(0.0, |least| EDGE * least);
        let point = |run: &Run| [run.seconds(), self.axis.error(run).max(edge)];
        let horizon = report::horizon_words(self.accuracy.until);
        let errors = self.runs.iter().map(|run| self.axis.error(run));
        let below = errors.filter(|error| *error < edge).reduce(f64::max);
        let heading = match below {
            Some(error) => format!("{horizon}; exact, at the edge: {error:.0e}"),
            None => horizon.to_owned(),
        };
        let best = front(&self.ranked, self.axis).into_iter().map(point).collect();
        let name = match self.axis {
            Ranked::Time => "relative error in time",
            Ranked::Whole => "relative error",
        };
        let floor = self.accuracy.floor().filter(|_| self.axis == Ranked::Whole);
        panel(Axis::log("time", "s"), name, heading, 150.0)
            .curve(front_curve(best))
            .curves(self.curves(true, point))
            .band_below(floor.map(|floor| floor.deflection), FLOOR)
    }

    /// Returns the runs of methods whose accuracy depends on the step.
    fn stepping(&self) -> OnMesh<'a> {
        let has_step = |run: &&Run| run.case.method.scheme.name().has_step();
        let those = |runs: &[&'a Run]| runs.iter().copied().filter(has_step).collect();
        OnMesh { runs: those(&self.runs), ranked: those(&self.ranked), ..*self }
    }

    fn orders(&self) -> Vec<Panel> {
        let scale = self.accuracy.scales.deflection;
        let stepping = self.stepping();
        let until = self.accuracy.until;
        let has_first = self.accuracy.limits.iter().any(|limit| !limit.impacts.is_empty());
        let horizons: Vec<Horizon> = match until {
            Horizon::FirstImpact => vec![until],
            _ if has_first => vec![Horizon::FirstImpact, until],
            _ => vec![Horizon::End],
        };
        let of_horizon = |(number, horizon): (usize, &Horizon)| {
            let error = |run: &Run| Some(run.time.as_ref()?.probes.at(*horizon).rms / scale);
            let point = |run: &Run| [run.case.step, error(run).unwrap_or(f64::NAN)];
            let heading = format!("({}) {}", ['a', 'b'][number], report::horizon_words(*horizon));
            let mut panel = panel(Axis::log("step", "s"), "relative error in time", heading, 120.0)
                .curves(stepping.curves(number == 0, point));
            let positive = |[x, y]: &[f64; 2]| *x > 0.0 && *y > 0.0;
            let points: Vec<[f64; 2]> = stepping.runs.iter().map(|run| point(run)).filter(positive).collect();
            let extreme =
                |axis: usize, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[axis]).reduce(pick);
            let extremes = extreme(0, f64::min).zip(extreme(0, f64::max)).zip(extreme(1, f64::max));
            if let Some(((least, most), largest)) = extremes {
                // Both lines pass through the upper right; their labels stand where they are apart.
                let (near, far) = ((least / most).powf(0.3), (least / most).powf(0.8));
                panel = panel.slope(1.0, [most * far, largest * far]);
                panel = panel.slope(2.0, [most * near, largest * near * near]);
            }
            panel
        };
        horizons.iter().enumerate().map(of_horizon).collect()
    }

    fn energy_drift(&self) -> Panel {
        let point = |run: &Run| [run.case.step, run.energy_drift.map_or(f64::NAN, |[_, worst]| worst)];
        Panel::new(Axis::log("step", "s"), Axis::log("largest |E / E(0) − 1|", ""))
            .height(150.0)
            .curves(self.stepping().curves(true, point))
    }
}

fn front_curve(points: Vec<[f64; 2]>) -> Curve {
    Curve::new("Pareto front", points).color(Color::BLACK).width(1.6)
}

/// Draws the whole error over the run time: the front over all meshes, and that of each mesh.
fn whole(accuracy: &Accuracy, meshes: &[String]) -> Panel {
    let points = |runs: &[&Run]| {
        front(runs, Ranked::Whole).into_iter().map(|run| [run.seconds(), run.error()]).collect()
    };
    let runs: Vec<&Run> = accuracy.runs.iter().collect();
    let of_mesh =
        |(number, mesh): (usize, &String)| curve(number, mesh, true, points(&accuracy.runs_on(mesh)));
    let name = if accuracy.limits.is_empty() { "relative error" } else { "relative error, time and space" };
    panel(Axis::log("time", "s"), name, report::horizon_words(accuracy.until), 150.0)
        .curve(front_curve(points(&runs)))
        .curves(meshes.iter().enumerate().map(of_mesh))
        .band_below(accuracy.floor().map(|floor| floor.deflection), FLOOR)
}

/// Draws the whole error of the deflection after the first impact, and the energy split, over the
/// run time.
///
/// Each scheme with each mass has a curve, its front over all meshes, numbers of modes and steps.
fn after_impact(accuracy: &Accuracy) -> Vec<Panel> {
    let scale = accuracy.scales.deflection;
    let floor = accuracy.floor();
    let of_floor = |part: fn(&Floor) -> Option<f64>| floor.as_ref().and_then(part);
    let methods = grouped(&accuracy.runs, |run| short(&Method { modes: None, ..run.case.method }));
    let drawn = |heading: &str, error: &dyn Fn(&Run) -> Option<f64>, named: bool| {
        let of_method = |(number, (name, runs)): (usize, &(String, Vec<&Run>))| {
            let costs: Vec<(f64, f64)> =
                runs.iter().filter_map(|run| Some((run.seconds(), error(run)?))).collect();
            let points = pareto(&costs).into_iter().map(|k| [costs[k].0, costs[k].1]).collect();
            curve(number, name, named, points)
        };
        panel(Axis::log("time", "s"), "relative error", heading, 120.0)
            .curves(methods.iter().enumerate().map(of_method))
    };
    let deflection = |run: &Run| Some(run.whole.after_impact?.rms / scale);
    let split = |run: &Run| Some(run.whole.kinetic?.rms);
    let has = |error: &dyn Fn(&Run) -> Option<f64>| accuracy.runs.iter().any(|run| error(run).is_some());
    let mut panels = Vec::new();
    if has(&deflection) {
        let drawn = drawn("(a) deflection after the first impact", &deflection, true);
        panels.push(drawn.band_below(of_floor(|floor| floor.after_impact), FLOOR));
    }
    if has(&split) {
        let drawn = drawn("(b) energy split of the first impact", &split, false);
        panels.push(drawn.band_below(of_floor(|floor| floor.kinetic), FLOOR));
    }
    panels
}

/// Draws the time of all steps over dofs, at the smallest step.
///
/// Each element with several meshes has a panel.
fn cost(accuracy: &Accuracy) -> Vec<Panel> {
    let mut elements = grouped(&accuracy.runs, |run| run.case.grid.element);
    elements.sort_by_key(|(element, _)| *element as u8);
    elements.retain(|(_, runs)| runs.iter().any(|run| run.dofs != runs[0].dofs));
    let methods = distinct(accuracy.runs.iter().map(|run| run.case.method));
    let of_element = |(place, (element, runs)): (usize, &(ElementKind, Vec<&Run>))| {
        let of_method = |(number, &method): (usize, &Method)| {
            let drawn: Vec<&&Run> = runs.iter().filter(|run| run.case.method == method).collect();
            let smallest = drawn.iter().map(|run| run.case.step).fold(f64::INFINITY, f64::min);
            let mut points: Vec<[f64; 2]> = drawn
                .iter()
                .filter(|run| run.case.step == smallest)
                .map(|run| [run.dofs as f64, run.stepping_seconds])
                .collect();
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            curve(number, &short(&method), place == 0, points)
        };
        let several = elements.len() > 1;
        let name = if several { format!("{element}, ") } else { String::new() };
        Panel::new(Axis::log("degrees of freedom", ""), Axis::log("time of all steps", "s"))
            .heading(format!("{name}at the smallest step"))
            .height(if several { 110.0 } else { 150.0 })
            .curves(methods.iter().enumerate().map(of_method))
    };
    elements.iter().enumerate().map(of_element).collect()
}
