//! Pictures of a branch: stable motions solid, unstable ones dashed.

use super::points::PointKind;
use super::report::{BranchReport, BranchRow};
use crate::output::plot::{Axis, Color, Curve, Figure, Panel};
use crate::sweep::SweepReport;

/// Names of the pictures, without their extensions.
pub const PICTURES: [&str; 2] = ["branch", "multipliers"];

/// Largest number of probes with a panel of their own.
const MOST_PROBES: usize = 4;

/// Returns the pictures of a branch with their names, on top of the runs of a sweep over the same
/// key.
pub fn figures(report: &BranchReport, sweep: Option<&SweepReport>) -> Vec<(&'static str, Figure)> {
    let mut branch = Figure::new(&report.title);
    if report.is_free() {
        branch = branch.panel(panel(report, "frequency", "Hz", &|row| 1.0 / row.period));
    }
    for (index, probe) in report.probes.iter().enumerate().take(MOST_PROBES) {
        let name = format!("{probe}: half the range");
        let panel = panel(report, &name, "m", &|row| row.amplitude(index));
        branch = branch.panel(panel.curves(sweep.map(|sweep| runs(sweep, probe))));
    }
    if report.probes.is_empty() && !report.is_free() {
        branch = branch.panel(panel(report, "peak force", "N", &|row| row.peak_force));
    }
    let modulus = panel(report, "largest multiplier", "", &|row| row.multiplier);
    let multipliers = Figure::new(&report.title).panel(modulus);
    let figures = PICTURES.into_iter().zip([branch, multipliers]);
    figures.map(|(name, figure)| (name, figure.note(&report.command))).collect()
}

/// Returns a panel of a quantity of the motions over the parameter, with the special motions.
fn panel(report: &BranchReport, name: &str, unit: &str, value: &dyn Fn(&BranchRow) -> f64) -> Panel {
    let keys = report.rows.iter().map(|row| row.parameter);
    let x = match report.is_free() {
        true => Axis::log("energy", "J"),
        false => Axis::linear(&*report.key, report.unit()),
    };
    let y = if report.is_free() { Axis::linear(name, unit) } else { Axis::linear(name, unit).with([0.0]) };
    let place = |row: &BranchRow| [row.parameter, value(row)];
    let lines = [true, false].map(|stable| line(report, stable, &place));
    let [stable, unstable] = lines.map(|points| (!points.is_empty()).then_some(points));
    let mut curves: Vec<Curve> =
        stable.map(|points| Curve::new("stable", points).width(1.2)).into_iter().collect();
    curves.extend(unstable.map(|points| Curve::new("unstable", points).dashes(1)));
    for (index, kind) in PointKind::ALL.into_iter().enumerate() {
        let points: Vec<[f64; 2]> =
            report.rows.iter().filter(|row| row.point == Some(kind)).map(place).collect();
        if !points.is_empty() {
            curves.push(Curve::new(kind.word(), points).palette(index + 1).marks(index).scattered());
        }
    }
    Panel::new(x.with(keys).tight(), y).height(120.0).curves(curves)
}

/// Returns the line through neighbouring motions that are both stable, or else, with gaps.
fn line(report: &BranchReport, stable: bool, place: &dyn Fn(&BranchRow) -> [f64; 2]) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = Vec::new();
    for pair in report.rows.windows(2).filter(|pair| (pair[0].stable && pair[1].stable) == stable) {
        let [from, to] = [&pair[0], &pair[1]].map(place);
        if points.last() != Some(&from) {
            points.extend([[f64::NAN; 2], from]);
        }
        points.push(to);
    }
    points
}

/// Returns the runs of a sweep as dots: half the range of a probe.
fn runs(sweep: &SweepReport, probe: &str) -> Curve {
    let index = sweep.probes.iter().position(|head| head.name == probe);
    let measured = sweep.rows.iter().filter_map(|row| Some((row.values[0], row.measures?)));
    let points = measured.filter_map(|(key, run)| {
        let probe = run.probes.get(index?)?;
        Some([key, 0.5 * (probe.max - probe.min)])
    });
    Curve::new("runs of the sweep", points.collect()).color(Color::GREY).marks(0).size(0.4).scattered()
}
