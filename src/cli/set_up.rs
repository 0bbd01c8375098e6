//! Progress report of the set-up of a run.

use super::printing::OutputMode;
use crate::output::progress::SetUp;
use crate::simulation;
use std::rc::Rc;

/// Progress report of a set-up, while it lasts.
pub(super) struct SetUpTold(Rc<SetUp>);

impl SetUpTold {
    /// Starts listening to the phases of the set-up.
    pub fn new(voice: OutputMode) -> SetUpTold {
        let set_up = Rc::new(SetUp::new(voice.is_silent()));
        let told = Rc::clone(&set_up);
        simulation::on_phase(Some(Box::new(move |part| told.part(part))));
        SetUpTold(set_up)
    }

    /// Reports a phase of the command itself.
    pub fn part(&self, part: &'static str) {
        self.0.part(part);
    }

    /// Prints a line beside the report.
    pub fn say(&self, line: &str) {
        self.0.say(line);
    }
}

impl Drop for SetUpTold {
    fn drop(&mut self) {
        simulation::on_phase(None);
    }
}
