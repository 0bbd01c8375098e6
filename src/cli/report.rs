//! Report printed at the end of a run.

use crate::output::text::{Report, significant};
use crate::scene::Scene;
use crate::scheme::RelaxationStatistics;
use crate::simulation::Outcome;
use std::path::Path;

/// Number of contacts listed in a report.
const MOST_CONTACTS: usize = 6;

/// Returns the report printed at the end of a run.
pub(super) fn report(scene: &Scene, outcome: &Outcome, folder: &Path) -> Report {
    let Outcome { energy, seconds, .. } = outcome;
    let mut report = Report::new("");
    report.count("dofs", outcome.dofs as u64, "").count("steps", outcome.steps, "").count(
        "  in contact",
        outcome.contact_steps,
        "",
    );
    if outcome.steps > 0 {
        let per_step = |seconds: f64| 1e6 * seconds / outcome.steps as f64;
        report.number("time per step", per_step(seconds.stepping), "us").number(
            "  in the scheme",
            per_step(seconds.blocks.advance),
            "us",
        );
    }
    if let Some(tally) = outcome.tally {
        report.count("events", tally.events, "").count("active sets", tally.active_sets, "");
    }
    if let Some(impact) = outcome.first_impact {
        report
            .number("first impact", impact.time, "s")
            .text("  at", format!("({}, {}) m", significant(impact.at[0]), significant(impact.at[1])))
            .number("  relative velocity", impact.velocity, "m/s")
            .count("most nodes in contact", outcome.most_contact_nodes as u64, "")
            .count("contacts of nodes", outcome.node_contacts, "")
            .count("contacts of the plate", outcome.contacts.len() as u64, "");
        for (number, [begin, end]) in outcome.contacts.iter().enumerate().take(MOST_CONTACTS) {
            report.text(format!("  {}", number + 1), format!("{begin:.6} s to {end:.6} s"));
        }
        if outcome.contacts.len() > MOST_CONTACTS {
            report.text("  ...", "");
        }
    } else if scene.has_contact() {
        report.text("first impact", "none");
    }
    report.number("energy at start", energy.start, "J").number("energy at end", energy.end, "J");
    // Time-dependent data add and remove energy; compared with that, the energy of a start at rest
    // is rounding.
    let is_measure = energy.start.abs() > 1e-6 * energy.min.abs().max(energy.max.abs());
    if is_measure && scene.changes().is_none() {
        let most = (energy.max - energy.start).max(energy.start - energy.min) / energy.start.abs();
        report
            .number("  over start", energy.end / energy.start, "")
            .text("  largest change", format!("{most:.1e}"));
    }
    if let Some(RelaxationStatistics { relaxed_steps, halved_steps, least_gamma, largest_gamma, .. }) =
        outcome.relaxation
    {
        report.count("steps relaxed", relaxed_steps, "");
        report.text("  gamma", format!("{least_gamma:.3} to {largest_gamma:.3}"));
        if halved_steps > 0 {
            report.count("steps halved", halved_steps, "");
        }
    }
    if outcome.retries > 0 {
        report.count("steps solved again", outcome.retries, "");
    }
    report.text("worst KKT residual", format!("{:.1e}", outcome.worst_kkt));
    if scene.has_contact() {
        report.text("worst penetration", format!("{:.1e} m", outcome.worst_penetration));
    }
    report.text("written to", format!("{}", folder.display()));
    report
}
