//! Energies of systems in lock step, from their coordinates.

use super::lane_contacts::ZERO;
use super::lane_levels::{Equations, LaneLevels, MasslessPart};
use super::lane_sums::along;
use super::mode_runs::ModeRuns;
use crate::energy::Energies;
use crate::kernels::Lanes;

/// Energies of all systems, in J.
struct LaneEnergies {
    kinetic: Lanes,
    elastic: Lanes,
    work: Lanes,
}

impl ModeRuns<'_> {
    /// Returns the energies of each run at the last step, from its coordinates. Those of a
    /// [`ModeLane`](super::ModeLane) come from the matrices instead, at a much higher cost.
    pub fn energies(&self) -> Vec<Energies> {
        let LaneEnergies { kinetic, elastic, work } = self.levels.energies();
        let energies = |(lane, start): (usize, &f64)| Energies {
            kinetic: kinetic.0[lane],
            elastic: elastic.0[lane],
            work: start + work.0[lane],
        };
        self.starts.iter().map(|start| &start.work).enumerate().map(energies).collect()
    }
}

impl LaneLevels {
    /// Returns the energies at the instant n, the work up to that of the start.
    ///
    /// The modes have unit masses, and no displacement but those of one system by reactions, loads
    /// and start are coupled by the stiffness.
    fn energies(&self) -> LaneEnergies {
        let LaneLevels { equations, data, z, d, d_next, .. } = self;
        let Equations { parameters, massless, modes, coordinates, rows, .. } = equations;
        let half_rate = 0.5 / parameters.step;
        let (mut kinetic, mut elastic) = (ZERO, ZERO);
        for (j, coordinate) in coordinates[..*modes].iter().enumerate() {
            let v = half_rate * (d[j] + d_next[j]);
            kinetic += 0.5 * (v * v);
            elastic += (0.5 * coordinate.stiffness) * (z[j] * z[j]);
        }
        // A massless part that follows reactions and loads stores the work that they do on it.
        let mut stored = ZERO;
        if *massless != MasslessPart::None {
            let (reactions, others) = z[*modes..].split_at(rows.len());
            for ((row, varied), r) in rows.iter().zip(&data.rows).zip(reactions) {
                elastic += 0.5 * (*r * along(&row[*modes..], &[], reactions));
                stored += *r * along(&[], varied, others);
            }
            for (row, weight) in data.stiffness.iter().zip(others) {
                stored += 0.5 * (*weight * along(&[], row, others));
            }
        }
        let constant = &data.forces[0];
        let mut work = self.work + along(&[], constant, &z[..constant.len()]);
        if *massless == MasslessPart::Follows {
            work += stored;
        }
        LaneEnergies { kinetic, elastic: elastic + stored, work }
    }
}
