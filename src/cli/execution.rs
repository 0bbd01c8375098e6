//! Execution of a run on one of the engines.

use super::arguments::refuse_petsc_options;
use super::job::Job;
#[cfg(feature = "petsc")]
use super::ranks::{ended, in_words};
use super::recorder::Recorder;
use super::set_up::SetUpTold;
use super::{launch, signal};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::output::checkpoint;
use crate::output::claim::RunLock;
use crate::output::vtu::Series;
#[cfg(feature = "petsc")]
use crate::petsc::Context;
use crate::scene::EngineName;
use crate::simulation::{self, Model, SolverFactory};
use crate::study;

impl Job {
    pub(super) fn execute(self) -> Result<()> {
        match self.scene.solver.engine {
            #[cfg(feature = "petsc")]
            EngineName::Petsc => self.on_petsc(),
            #[cfg(not(feature = "petsc"))]
            EngineName::Petsc => Model::new(&self.scene).map(drop), // says that this build has no such engine
            EngineName::Native => {
                launch::one_process("the native engine runs")?;
                refuse_petsc_options(&self.petsc)?;
                let _claim = RunLock::new(&self.folder, &self.identity)?;
                self.announce("")?;
                let set_up = SetUpTold::new(self.voice);
                let cache = self.cache.open(self.voice.is_silent());
                let model = Model::new(&self.scene)?;
                cache.tell(|line| set_up.say(line));
                set_up.part("frequencies");
                let warnings = study::warnings(&self.scene, &model);
                self.simulate(Some(set_up), &model, &simulation::condensed, &warnings, &|| Ok(()))
            }
        }
    }

    /// Runs on all ranks; an error on any of them ends the run on all.
    #[cfg(feature = "petsc")]
    fn on_petsc(self) -> Result<()> {
        let context = Context::start(&self.petsc)?;
        let speaks = context.rank() == 0;
        let run = || {
            let claim = speaks.then(|| RunLock::new(&self.folder, &self.identity)).transpose();
            let _claim = context.comm().all_ok(claim)?;
            if speaks {
                self.announce(&format!("engine: petsc, {}\n", in_words(context.size())))?;
            }
            let set_up = speaks.then(|| SetUpTold::new(self.voice));
            let model = Model::distributed(&self.scene, &context)?;
            let solver = model.solver(&self.scene);
            let dofs = context.comm().all_reduce_sum(model.system.engine.dofs());
            set_up.iter().for_each(|set_up| set_up.part("frequencies"));
            let warnings =
                if speaks { study::warnings_apart(&self.scene, &model.warnings, dofs) } else { Vec::new() };
            self.simulate(set_up, &model, &solver, &warnings, &|| context.refuse_unused_options())
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
        check_options: &dyn Fn() -> Result<()>,
    ) -> Result<()> {
        signal::listen()?;
        if let Some(set_up) = set_up.as_ref().filter(|_| !self.voice.is_silent()) {
            warnings.iter().for_each(|warning| set_up.say(&format!("warning: {warning}")));
        }
        let from = self.from.take();
        let comm = model.system.engine.comm();
        let job = &self;
        let Job { scene, folder, .. } = job;
        let fields = Series::new(folder, comm.rank(), comm.size());
        let mut recorder = Recorder::new(job, fields, set_up, check_options);
        let prepared = if comm.rank() == 0 { recorder.prepare(from.as_ref()) } else { Ok(()) };
        comm.all_ok(prepared)?;
        let (outcome, ended) = match from {
            None => simulation::run(scene, model, solver, &mut recorder)?,
            Some(from) => simulation::resume(scene, model, solver, from.pause, &mut recorder)?,
        };
        let Some(files) = recorder.files else { return ended };
        let status = ended.as_ref().err().map_or("done".into(), ToString::to_string);
        // The cause of the run's end takes precedence over errors of the report.
        let told = files.finish().and_then(|()| job.tell(&outcome, warnings, status));
        ended.and(told)?;
        // A finished run needs no checkpoints.
        checkpoint::clear(folder)
    }
}
