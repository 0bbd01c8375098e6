//! Execution of a run on one of the engines.

use super::arguments::refuse_petsc_options;
use super::job::Job;
#[cfg(feature = "petsc")]
use super::ranks::{self, ended, in_words};
use super::set_up::SetUpTold;
use super::terminal::Terminal;
use super::{launch, printing, signal};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::output::checkpoint;
use crate::output::claim::RunLock;
use crate::output::run_files::{RecordedRun, RunFiles};
use crate::scene::EngineName;
use crate::simulation::{self, Both, Model, SolverFactory};
use crate::study;

impl Job {
    pub(super) fn execute(self) -> Result<()> {
        match self.run.scene.solver.engine {
            #[cfg(feature = "petsc")]
            EngineName::Petsc => self.on_petsc(),
            #[cfg(not(feature = "petsc"))]
            EngineName::Petsc => Model::new(&self.run.scene).map(drop), // says that this build has no such engine
            EngineName::Native => {
                launch::one_process("the native engine runs")?;
                let RecordedRun { scene, folder, identity, petsc, .. } = &self.run;
                refuse_petsc_options(petsc)?;
                let _claim = RunLock::new(folder, identity)?;
                self.announce("")?;
                let set_up = SetUpTold::new(self.voice);
                let mut cache = self.cache.open(self.voice.is_silent());
                cache.is_brief = !self.verbose;
                let model = Model::new(scene)?;
                cache.tell(|line| set_up.say(line));
                set_up.part("frequencies");
                let warnings = study::warnings(scene, &model);
                self.simulate(Some(set_up), &model, &simulation::condensed, &warnings)
            }
        }
    }

    /// Runs on all ranks; an error on any of them ends the run on all.
    #[cfg(feature = "petsc")]
    fn on_petsc(self) -> Result<()> {
        let context = ranks::start(&self.run.petsc, None, &self.run.identity)?;
        let speaks = context.rank() == 0;
        let run = || {
            let RecordedRun { scene, folder, identity, .. } = &self.run;
            let claim = speaks.then(|| RunLock::new(folder, identity)).transpose();
            let _claim = context.comm().all_ok(claim)?;
            if speaks {
                self.announce(&format!("engine: petsc, {}\n", in_words(context.size())))?;
            }
            let set_up = speaks.then(|| SetUpTold::new(self.voice));
            let model = Model::distributed(scene, &context)?;
            let solver = model.solver(scene);
            let dofs = context.comm().all_reduce_sum(model.system.engine.dofs());
            set_up.iter().for_each(|set_up| set_up.part("frequencies"));
            let warnings =
                if speaks { study::warnings_apart(scene, &model.warnings, dofs) } else { Vec::new() };
            // Solvers look their options up in the first step at the latest.
            if !context.unused_options()?.is_empty() {
                model.scheme_with(scene, &solver)?.advance()?;
                context.refuse_unused_options()?;
            }
            self.simulate(set_up, &model, &solver, &warnings)
        };
        ended(&context, run())
    }

    /// Runs a model as one of several processes; the first writes files and reports.
    fn simulate<E: Engine>(
        mut self,
        set_up: Option<SetUpTold>,
        model: &Model<E>,
        solver: &SolverFactory<E>,
        warnings: &[String],
    ) -> Result<()> {
        signal::listen()?;
        if let Some(set_up) = set_up.as_ref().filter(|_| !self.voice.is_silent()) {
            model.notes.iter().for_each(|note| set_up.say(&format!("mesh file: {note}")));
            warnings.iter().for_each(|warning| set_up.say(&printing::warning(warning)));
        }
        let from = self.from.take();
        let comm = model.system.engine.comm();
        let RecordedRun { scene, folder, .. } = &self.run;
        let mut terminal = Terminal::new(&self, set_up);
        let mut files = RunFiles::new(&self.run, comm.rank(), comm.size());
        let prepared = if comm.rank() == 0 { files.prepare(from.as_ref()) } else { Ok(()) };
        comm.all_ok(prepared)?;
        if files.has_tables() {
            terminal.begin(from.as_ref());
        }
        let mut observer = Both(terminal, files);
        let pause = from.map(|from| from.pause);
        let (outcome, ended) = simulation::resume(scene, model, solver, pause, &mut observer)?;
        let Both(terminal, files) = observer;
        if !files.has_tables() {
            return ended;
        }
        terminal.finish();
        let status = ended.as_ref().err().map_or("done".into(), ToString::to_string);
        // The cause of the run's end takes precedence over errors of the report.
        let told = files.finish().and_then(|()| self.tell(&outcome, warnings, status));
        ended.and(told)?;
        // A finished run needs no checkpoints.
        checkpoint::clear(folder)
    }
}
