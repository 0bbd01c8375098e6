//! The line that moves on the terminal while a run goes on.

use super::text::{grouped, significant};
use indicatif::{FormattedDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::ops::Range;
use std::time::{Duration, Instant};

/// Time between two drawings of the line.
const REDRAW: Duration = Duration::from_millis(100);
/// Time between two looks at the clock, if the steps go on at their pace so far.
const LOOK: Duration = Duration::from_millis(20);
/// Most steps between two looks at the clock, lest the line sleep when the steps grow slow.
const MOST_STEPS: u64 = 64;

/// What the line shows of the simulation.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Time, s.
    pub time: f64,
    /// Nodes that touch an obstacle.
    pub contact_nodes: usize,
    /// Energy over its start, dimensionless.
    pub energy_ratio: f64,
}

/// A line on the terminal: time, pace, time left, nodes in contact, energy.
///
/// Silent when standard error is no terminal or when asked to be quiet, and then it costs one comparison a step.
#[derive(Debug)]
pub struct Progress {
    line: ProgressBar,
    span: Range<f64>,
    started: Instant,
    drawn: Instant,
    drawn_step: u64,
    next: u64,
}

impl Progress {
    /// Progress from `step`, at the start of the `span` of time (s), to the span's end.
    pub fn new(step: u64, span: Range<f64>, quiet: bool) -> Self {
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style = ProgressStyle::with_template("{wide_msg}").expect("the template is well-formed");
        let line = ProgressBar::with_draw_target(None, target).with_style(style);
        let next = if line.is_hidden() { u64::MAX } else { step };
        let now = Instant::now();
        Progress { line, span, started: now, drawn: now, drawn_step: step, next }
    }

    /// Tells that `step` is done; asks for the `state` only when the line is due, some ten times a second.
    #[inline]
    pub fn tick(&mut self, step: u64, state: impl FnOnce() -> State) {
        if step >= self.next && self.is_due(step) {
            self.draw(step, &state());
        }
    }

    /// Removes the line.
    pub fn finish(self) {
        self.line.finish_and_clear();
    }

    /// Looks at the clock, and plans when to look again.
    fn is_due(&mut self, step: u64) -> bool {
        let elapsed = self.drawn.elapsed();
        let steps = (step - self.drawn_step) as f64 * LOOK.as_secs_f64() / elapsed.as_secs_f64();
        self.next = step + (steps as u64).clamp(1, MOST_STEPS);
        elapsed >= REDRAW
    }

    fn draw(&mut self, step: u64, state: &State) {
        let now = Instant::now();
        let pace = (step - self.drawn_step) as f64 / (now - self.drawn).as_secs_f64();
        let done = ((state.time - self.span.start) / (self.span.end - self.span.start)).clamp(0.0, 1.0);
        self.line.set_message(words(state, done, pace, now - self.started));
        (self.drawn, self.drawn_step) = (now, step);
    }
}

/// The words of the line, which fit 80 columns.
fn words(state: &State, done: f64, pace: f64, elapsed: Duration) -> String {
    let left = Duration::try_from_secs_f64((elapsed.as_secs_f64() * (1.0 / done - 1.0)).ceil());
    format!(
        "{:3.0} %  t = {:>8} s  {:>7} steps/s  {} left  contact {}  E/E0 {:.4}",
        100.0 * done,
        significant(state.time),
        grouped(pace as u64),
        left.map_or("?".into(), |left| FormattedDuration(left).to_string()),
        state.contact_nodes,
        state.energy_ratio,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_where_the_run_stands() {
        let state = State { time: 0.125, contact_nodes: 3, energy_ratio: 0.98765 };
        assert_eq!(
            words(&state, 0.25, 182_345.6, Duration::from_secs(10)),
            " 25 %  t =    0.125 s  182 345 steps/s  00:00:30 left  contact 3  E/E0 0.9877"
        );
        assert!(words(&state, 0.0, 0.0, Duration::ZERO).contains("? left"));
        assert!(
            words(&State { time: f64::NAN, ..state }, f64::NAN, f64::INFINITY, Duration::ZERO)
                .contains("? left")
        );
    }

    #[test]
    fn quiet_progress_never_asks_for_the_state() {
        let mut progress = Progress::new(0, 0.0..1.0, true);
        for step in 0..1000 {
            progress.tick(step, || unreachable!());
        }
        progress.finish();
    }

    #[test]
    fn the_clock_is_read_now_and_then() {
        let mut progress = Progress::new(0, 0.0..1.0, true);
        assert!(!progress.is_due(1_000_000) && progress.next == 1_000_064);
        std::thread::sleep(REDRAW);
        assert!(progress.is_due(1_000_064));
        assert!(progress.is_due(1_000_064) && progress.next > 1_000_064);
    }
}
