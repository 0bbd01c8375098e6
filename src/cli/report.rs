//! Report printed at the end of a run.

use crate::output::text::{Report, significant, two_digits};
use crate::scene::Scene;
use crate::scheme::RelaxationStatistics;
use crate::simulation::{
    Extremes, HardestImpact, LinearIterations, NamedForce, Outcome, QuickestRanks, Seconds, StressPeak,
};
use std::path::Path;

/// Number of contacts listed in a report.
const MOST_CONTACTS: usize = 6;

/// Time of a run, in s, from which the report says whether ranks would shorten it.
const LONG: f64 = 10.0;

/// Component of a moment, relative to the other one, that is rounding.
const ROUNDING: f64 = 1e-9;

/// Returns the report printed at the end of a run.
pub(super) fn report(scene: &Scene, outcome: &Outcome, folder: &Path) -> Report {
    let Outcome { energy, seconds, .. } = outcome;
    let mut report = Report::new("");
    report.count("dofs", outcome.dofs as u64, "").count("steps", outcome.steps, "");
    report.count("  in contact", outcome.contact_steps, "");
    if outcome.steps > 0 {
        let per_step = |seconds: f64| 1e6 * seconds / outcome.steps as f64;
        report.number("time per step", per_step(seconds.stepping), "us");
        report.number("  in the scheme", per_step(seconds.blocks.advance), "us");
    }
    if let Some(tally) = outcome.tally {
        report.count("events", tally.events, "").count("active sets", tally.active_sets, "");
    }
    if let Some(impact) = outcome.first_impact {
        report
            .number("first impact", impact.time, "s")
            .text("  at", place(impact.at))
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
    add_extremes(&mut report, outcome);
    report.number("energy at start", energy.start, "J").number("energy at end", energy.end, "J");
    // Time-dependent data add and remove energy; compared with that, the energy of a start at rest
    // is rounding.
    let is_measure = energy.start.abs() > 1e-6 * energy.min.abs().max(energy.max.abs());
    if is_measure && scene.changes().is_none() {
        let most = (energy.max - energy.start).max(energy.start - energy.min) / energy.start.abs();
        report.number("  over start", energy.end / energy.start, "");
        report.text("  largest change", two_digits(most));
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
    if let LinearIterations { iterations_mean: Some(mean), iterations_max: Some(most), .. } = outcome.linear {
        report.text("iterations per solve", format!("{mean:.1}, at most {most}"));
    }
    report.text("worst KKT residual", two_digits(outcome.worst_kkt));
    if scene.has_contact() {
        report.text("worst penetration", format!("{} m", two_digits(outcome.worst_penetration)));
    }
    let Seconds { assembly, equilibrium, factor, stepping, .. } = seconds;
    let total = assembly + equilibrium + factor + stepping;
    if let Some(QuickestRanks { ranks, seconds }) =
        QuickestRanks::new(scene, outcome.dofs, outcome.steps, total).filter(|_| total >= LONG)
    {
        report.text(
            "quicker",
            format!("mpirun -n {ranks} rebond run: {seconds:.0} s in place of {total:.0} s"),
        );
    }
    report.text("written to", format!("{}", folder.display()));
    report
}

/// Returns a place on the plate in words.
fn place([x, y]: [f64; 2]) -> String {
    format!("({}, {}) m", significant(x), significant(y))
}

/// Adds the largest stress, and the forces of named supports and obstacles.
fn add_extremes(report: &mut Report, outcome: &Outcome) {
    let seconds = |time: f64| format!("at {} s", significant(time));
    if let Some(Extremes { von_mises: StressPeak { value, time, at: point, surface } }) = outcome.extremes {
        let side = if surface.sign() < 0.0 { "lower" } else { "upper" };
        report
            .number("largest von Mises stress", value, "Pa")
            .text("  at", format!("{}, {} surface, {}", place(point), side, seconds(time)));
    }
    for (name, energy) in &outcome.dissipated {
        report.number(format!("dissipated by {name}"), *energy, "J");
    }
    for (name, force) in &outcome.forces {
        match force {
            NamedForce::Support(forces) => {
                let most = forces.peak_moment.iter().fold(0.0, |most: f64, moment| most.max(moment.abs()));
                let [x, y] = forces
                    .peak_moment
                    .map(|moment| if moment.abs() <= ROUNDING * most { 0.0 } else { moment })
                    .map(significant);
                report
                    .number(format!("{name}, largest force"), forces.peak, "N")
                    .text("  at", format!("{} s", significant(forces.time_of_peak)))
                    .number("  impulse", forces.impulse, "N s")
                    .text("  largest moment", format!("{x} N m about x, {y} N m about y"))
                    .text("    at", format!("{} s", significant(forces.time_of_peak_moment)));
            }
            NamedForce::Obstacle(forces) => {
                report.number(format!("{name}, largest force"), forces.peak, "N");
                if let Some(time) = forces.time_of_peak {
                    report.text("  at", format!("{} s", significant(time)));
                }
                report
                    .number("  impulse", forces.impulse, "N s")
                    .count("  impacts", forces.impacts, "")
                    .number("  time in contact", forces.time_in_contact, "s");
                if let Some(HardestImpact { time, at: point, approach_velocity, impulse, .. }) =
                    forces.hardest
                {
                    report
                        .number("  impulse of the hardest", impulse, "N s")
                        .text("    at", format!("{}, {}", place(point), seconds(time)))
                        .number("    approach velocity", approach_velocity, "m/s");
                }
            }
        }
    }
}
