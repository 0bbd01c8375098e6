//! Report printed at the end of a run: its answers, and on demand how they were computed.

use crate::output::answers::KeyFigure;
use crate::output::text::{Report, two_digits};
use crate::scene::Scene;
use crate::scheme::RelaxationStatistics;
use crate::simulation::{LinearIterations, Outcome, QuickestRanks, Seconds};
use std::path::Path;

/// Time of a run, in s, from which the report says whether ranks would shorten it.
const LONG: f64 = 10.0;

/// Returns the report printed at the end of a run with its answers and its number of warnings, and
/// with the numerics if it is `verbose`.
pub(super) fn report(
    scene: &Scene,
    outcome: &Outcome,
    answers: Vec<KeyFigure>,
    warnings: usize,
    folder: &Path,
    verbose: bool,
) -> Report {
    let mut report = Report::new("");
    for KeyFigure { title, text, .. } in answers {
        report.text(title, text);
    }
    if scene.load.as_ref().is_some_and(|load| !load.base_acceleration.is_zero()) {
        report.text("results", "relative to the accelerated base");
    }
    if verbose {
        add_numerics(&mut report, scene, outcome);
    }
    add_attention(&mut report, scene, outcome, warnings);
    report.text("next", format!("rebond report {}", folder.display()));
    report
}

/// Adds what a reader should look at.
fn add_attention(report: &mut Report, scene: &Scene, outcome: &Outcome, warnings: usize) {
    if warnings > 0 {
        let above =
            if warnings == 1 { "the warning above".into() } else { format!("the {warnings} warnings above") };
        report.text("attention", above);
    }
    if outcome.retries > 0 {
        report.text("attention", format!("{} steps were solved again by a safer method", outcome.retries));
    }
    let Seconds { assembly, equilibrium, factor, stepping, .. } = outcome.seconds;
    let total = assembly + equilibrium + factor + stepping;
    if let Some(QuickestRanks { ranks, seconds }) =
        QuickestRanks::new(scene, outcome.dofs, outcome.steps, total).filter(|_| total >= LONG)
    {
        let quicker = format!("mpirun -n {ranks} rebond run: {seconds:.0} s in place of {total:.0} s");
        report.text("quicker", quicker);
    }
}

/// Adds how the answers were computed.
fn add_numerics(report: &mut Report, scene: &Scene, outcome: &Outcome) {
    report.count("dofs", outcome.dofs as u64, "").count("  bounded", outcome.bounded_dofs as u64, "");
    report.count("steps", outcome.steps, "").count("  in contact", outcome.contact_steps, "");
    if outcome.steps > 0 {
        let per_step = |seconds: f64| 1e6 * seconds / outcome.steps as f64;
        report.number("  time per step", per_step(outcome.seconds.stepping), "us");
        report.number("    in the scheme", per_step(outcome.seconds.blocks.advance), "us");
    }
    if scene.has_contact() {
        report.count("most nodes in contact", outcome.most_contact_nodes as u64, "");
        report.count("contacts of nodes", outcome.node_contacts, "");
    }
    if let Some(tally) = outcome.tally {
        report.count("events", tally.events, "").count("active sets", tally.active_sets, "");
    }
    if let Some(RelaxationStatistics { relaxed_steps, halved_steps, least_gamma, largest_gamma, .. }) =
        outcome.relaxation
    {
        report.count("steps relaxed", relaxed_steps, "");
        report.text("  gamma", format!("{least_gamma:.3} to {largest_gamma:.3}"));
        report.count("steps halved", halved_steps, "");
    }
    if let LinearIterations { iterations_mean: Some(mean), iterations_max: Some(most), .. } = outcome.linear {
        report.text("iterations per solve", format!("{mean:.1}, at most {most}"));
    }
    if !scene.supports.is_empty() && scene.supports.iter().all(|support| support.name.is_none()) {
        report.text("force of a support", "add a name: --set 'support.0.name=\"clamp\"'");
    }
    report.text("worst KKT residual", two_digits(outcome.worst_kkt));
    if scene.has_contact() {
        report.text("worst penetration", format!("{} m", two_digits(outcome.worst_penetration)));
    }
}
