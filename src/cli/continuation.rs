//! Command `rebond continue`.

use super::arguments::{SceneArgs, refuse_petsc_options, toml};
use super::command::{Execute, Program};
use super::printing::command_line;
use super::{launch, signal};
use crate::continuation::{
    self, BranchLimits, BranchReport, BranchRow, Driven, DrivenScene, Family, Follower, Free,
};
use crate::error::{Error, Result};
use crate::output::checkpoint::Identity;
use crate::output::claim::{RunLock, refuse_foreign};
use crate::output::plot::{self, Figure};
use crate::output::progress::moving_line;
use crate::output::{remove, report};
use crate::scene::{EngineName, Mass, ProbeQuantity, Scene};
use crate::simulation::Model;
use crate::sweep::{self, SweepReport};
use clap::Args;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  rebond continue shaker.toml --over frequency=20..80 --period 1/frequency
  rebond continue shaker.toml --over frequency=20..80 --period 1/frequency --periods 2
  rebond continue panel.toml --energy 1e-6..1e-2 --mode 1   # free vibrations

Stable and unstable periodic motions, with folds, flips and grazing.";

/// Follow periodic motions over a key, stable or not: resonance curves with their unstable parts;
/// or free vibrations over their energy
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ContinueArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Key or parameter with its range: load.pressure=90..250
    #[arg(long, value_name = "KEY=FROM..TO", required_unless_present = "energy", conflicts_with = "energy")]
    over: Option<String>,
    /// Free vibrations over their energy in J
    #[arg(long, value_name = "FROM..TO")]
    energy: Option<String>,
    /// Natural mode that the free vibrations begin with, from 1 on
    #[arg(long, value_name = "N", default_value_t = 1, requires = "energy")]
    mode: usize,
    /// Period of the drive in s: a number, or a formula of the parameters such as 1/frequency;
    /// default: the one of the scene's [sweep]
    #[arg(long, value_name = "SECONDS", conflicts_with = "energy")]
    period: Option<String>,
    /// Periods of the drive in one period of the motion
    #[arg(long, value_name = "N", default_value_t = 1)]
    periods: usize,
    /// Periods of the drive that the plate settles at the first value of the key
    #[arg(long, value_name = "N", default_value_t = 200)]
    settle: usize,
    /// Largest change from motion to motion, relative to the motion
    #[arg(long, value_name = "NUMBER", default_value_t = 0.05)]
    step: f64,
    /// Largest number of motions
    #[arg(long, value_name = "N", default_value_t = 1000)]
    most: usize,
    /// Folder of a sweep over the same key, whose runs are drawn too
    #[arg(long, value_name = "DIR", requires = "over")]
    sweep: Option<PathBuf>,
    /// Folder of branch.csv, branch.json and plots; default: continuations/ and the scene file's
    /// name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace what the folder holds
    #[arg(long)]
    overwrite: bool,
}

impl Execute for ContinueArgs {
    fn execute(&self, _: Program) -> Result<()> {
        launch::one_process("continue runs")?;
        refuse_petsc_options(&self.scene.petsc)?;
        if !(self.step > 0.0 && self.step <= 1.0) {
            return Err(Error::Usage(format!("--step {}: expected a number above 0, at most 1", self.step)));
        }
        if self.periods == 0 || self.most < 2 {
            return Err(Error::Usage("--periods: expected at least 1; --most: at least 2".into()));
        }
        let sweep = self.sweep.as_deref().map(SweepReport::read).transpose()?;
        match (&self.over, &self.energy) {
            (Some(over), _) => self.driven(over, sweep.as_ref()),
            (None, Some(energy)) => self.free(energy),
            (None, None) => Err(Error::Usage("expected --over or --energy".into())),
        }
    }
}

impl ContinueArgs {
    /// Follows driven motions over a key.
    fn driven(&self, over: &str, sweep: Option<&SweepReport>) -> Result<()> {
        let expected = "expected KEY=FROM..TO, such as load.pressure=90..250";
        let wrong = || Error::Usage(format!("--over {over}: {expected}"));
        let (key, text) = over.split_once('=').ok_or_else(wrong)?;
        let range = range(text).ok_or_else(wrong)?;
        if let Some(other) = sweep.filter(|sweep| sweep.keys.first().is_none_or(|first| first != key)) {
            let keys = other.keys.join(", ");
            return Err(Error::Usage(format!("--sweep: its key is {keys}; expected a sweep over {key}")));
        }
        let mut settings = vec![format!("sweep.over=[{:?}]", format!("{key}={},{}", range[0], range[1]))];
        let period = |period: &String| format!("sweep.period={}", toml::word(period).unwrap_or_default());
        settings.extend(self.period.iter().map(period));
        let load = |more: &[String]| self.scene.load_with(&[&settings, more]);
        let scene = load(&[])?;
        require_modes(&scene)?;
        let spec = scene.sweep.clone().ok_or_else(wrong)?;
        let scene_of = |value: f64| sweep::scene_at(&spec, &load, &[value]);
        let mut steps = 1;
        for end in range {
            let (scene, spec) = scene_of(end)?;
            steps = steps.max((spec.period() / scene.time.step).round() as usize);
        }
        let build = |value: f64| {
            let (scene, spec) = scene_of(value)?;
            Ok(DrivenScene { model: Model::new(&scene)?, period: spec.period() })
        };
        let mut family = Driven::new(&build, range, [self.periods, steps, self.settle]);
        self.follow(&scene, key, range, &mut family, sweep)
    }

    /// Follows free vibrations over their energy.
    fn free(&self, energy: &str) -> Result<()> {
        let wrong = || Error::Usage(format!("--energy {energy}: expected FROM..TO in J, such as 1e-6..1e-2"));
        let range = range(energy).filter(|[from, to]| 0.0 < *from && from < to).ok_or_else(wrong)?;
        let scene = self.scene.load()?;
        require_modes(&scene)?;
        let cache = self.scene.open_cache();
        let model = Model::new(&scene)?;
        drop(cache);
        let mut family = Free::new(&model, scene.time.step, range[0], self.mode)?;
        self.follow(&scene, "energy", range, &mut family, None)
    }

    /// Follows a family and writes what is found.
    fn follow(
        &self,
        scene: &Scene,
        key: &str,
        range: [f64; 2],
        family: &mut dyn Family,
        sweep: Option<&SweepReport>,
    ) -> Result<()> {
        let folder = self.scene.folder(self.out.as_deref(), "continuations");
        let _lock = RunLock::new(&folder, &Identity::of(scene)?)?;
        let names = [continuation::JSON, continuation::CSV, plot::FOLDER, report::FILE, ".lock"];
        refuse_foreign(&folder, "continuation", "--out", |name| names.contains(&name))?;
        if folder.join(continuation::JSON).exists() && !self.overwrite {
            let shown = folder.display();
            let wrong =
                format!("{shown} holds a branch: --out DIR names another folder, --overwrite replaces it");
            return Err(Error::Usage(wrong));
        }
        signal::listen()?;
        let _cache = self.scene.open_cache();
        let probes = scene.output.probes.iter().map(|probe| probe.name.clone()).collect();
        let mut report = BranchReport::new(scene, command_line(), key.into(), probes);
        let line = moving_line("{pos} motions  {elapsed}  {wide_msg}", None, self.scene.voice.is_silent());
        let limits = BranchLimits { range, step: self.step, most: self.most };
        let ended = Follower::new(family, limits).follow(
            &mut |motion| {
                report.rows.push(BranchRow::new(motion));
                line.set_position(report.rows.len() as u64);
                line.set_message(format!("{key} = {}", motion.parameter));
                Ok(())
            },
            &|| signal::signal_received(),
        );
        line.finish_and_clear();
        report.ending = ended.as_ref().map_or_else(ToString::to_string, Clone::clone);
        if ended.is_err() && report.rows.is_empty() {
            return ended.map(drop);
        }
        remove(&folder.join(report::FILE))?;
        report.write(&folder)?;
        let pictures = Figure::write_all(&folder.join(plot::FOLDER), &continuation::figures(&report, sweep))?;
        let shown = Path::new(&folder).display();
        let text = format!("{report}{shown}/{}, {}\n{pictures}", continuation::CSV, continuation::JSON);
        self.scene.voice.print(&text, &report)?;
        ended.map(drop)
    }
}

/// Refuses another mass than the modal one, another engine than the native one, and probes of
/// anything but deflections.
fn require_modes(scene: &Scene) -> Result<()> {
    let wrong = match () {
        () if scene.time.mass != Mass::Modal => {
            "time.mass: periodic motions are those of modes; expected \"modal\""
        }
        () if scene.solver.engine != EngineName::Native => "solver.engine: expected \"native\"",
        () if scene.output.probes.iter().any(|probe| probe.quantity != ProbeQuantity::Deflection) => {
            "output.probes: expected probes of deflections"
        }
        () => return Ok(()),
    };
    Err(Error::Usage(wrong.into()))
}

/// Returns the ends of a range `FROM..TO`.
fn range(text: &str) -> Option<[f64; 2]> {
    let (from, to) = text.split_once("..")?;
    let ends = [from, to].map(|end| end.trim().parse::<f64>().ok().filter(|end| end.is_finite()));
    let [Some(from), Some(to)] = ends else { return None };
    (from != to).then_some([from, to])
}
