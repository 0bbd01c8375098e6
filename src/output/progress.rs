//! Progress of a run: a moving line on a terminal, elsewhere one line per tenth of the steps.

use super::text::{engineering, grouped};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::Write;
use std::ops::Range;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Time between two drawings of the line.
const REDRAW: Duration = Duration::from_millis(100);
/// Time between two readings of the clock while the steps keep their pace.
const LOOK: Duration = Duration::from_millis(20);
/// Limit on the steps between two readings of the clock, in case the steps become slower.
const MOST_STEPS: u64 = 64;

/// Number of lines without a terminal, at equal shares of the steps; the report replaces the last.
const LINES: u64 = 10;
/// Time after which a part of the set-up is reported without a terminal.
const LONG: Duration = Duration::from_secs(2);
/// Ratio of the energy to its start above which the energy is shown in J.
const LARGEST_RATIO: f64 = 100.0;

/// State of the simulation that the line shows.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Time in s.
    pub time: f64,
    /// Number of nodes in contact.
    pub contact_nodes: usize,
    /// Energy in J.
    pub energy: f64,
    /// Initial energy in J.
    pub start: f64,
}

/// Progress line on standard error: time, pace, time left, nodes in contact, energy.
///
/// On a terminal one line moves. Elsewhere, as in a file, a line is added at each tenth of the
/// steps, independent of the clock, and a step costs one comparison. In quiet mode there is no
/// output.
#[derive(Debug)]
pub struct Progress {
    line: ProgressBar,
    steps: Range<u64>,
    span: Range<f64>,
    started: Instant,
    drawn: Instant,
    drawn_step: u64,
    next: u64,
}

impl Progress {
    /// Creates the progress over the remaining `steps` and their `span` of time (in s).
    pub fn new(steps: Range<u64>, span: Range<f64>, quiet: bool) -> Self {
        let line = moving_line("{wide_msg}", None, quiet);
        let now = Instant::now();
        let first = steps.start;
        let mut progress =
            Progress { line, span, started: now, drawn: now, drawn_step: first, next: first, steps };
        if quiet {
            progress.next = u64::MAX;
        } else if progress.line.is_hidden() {
            progress.next = progress.after(progress.steps.start);
        }
        progress
    }

    /// Returns the next step after `step` at which a line is due without a terminal; never the
    /// last.
    fn after(&self, step: u64) -> u64 {
        let Range { start, end } = self.steps;
        let line = |number: u64| {
            start + ((u128::from(end - start) * u128::from(number)).div_ceil(LINES.into())) as u64
        };
        (1..LINES).map(line).find(|&due| due > step && due < end).unwrap_or(u64::MAX)
    }

    /// Reports that `step` is done, and evaluates `state` only if the line is due.
    ///
    /// On a terminal this happens about ten times per second.
    #[inline]
    pub fn tick(&mut self, step: u64, state: impl FnOnce() -> State) {
        if step >= self.next {
            self.tell(step, state);
        }
    }

    fn tell(&mut self, step: u64, state: impl FnOnce() -> State) {
        if !self.line.is_hidden() {
            if self.is_due(step) {
                let line = self.words(step, &state());
                self.line.set_message(line);
            }
            return;
        }
        self.next = self.after(step);
        let line = self.words(step, &state());
        say(&line);
    }

    /// Removes the line.
    pub fn finish(self) {
        self.line.finish_and_clear();
    }

    /// Reads the clock if necessary, and plans the next reading.
    fn is_due(&mut self, step: u64) -> bool {
        let elapsed = self.drawn.elapsed();
        let steps = (step - self.drawn_step) as f64 * LOOK.as_secs_f64() / elapsed.as_secs_f64();
        self.next = step + (steps as u64).clamp(1, MOST_STEPS);
        elapsed >= REDRAW
    }

    /// Formats the line and records when it is drawn.
    fn words(&mut self, step: u64, state: &State) -> String {
        let now = Instant::now();
        let pace = (step - self.drawn_step) as f64 / (now - self.drawn).as_secs_f64();
        let done = ((state.time - self.span.start) / (self.span.end - self.span.start)).clamp(0.0, 1.0);
        (self.drawn, self.drawn_step) = (now, step);
        words(state, done, pace, now - self.started)
    }
}

/// Creates a moving line on standard error over a number of parts, hidden in quiet mode and without
/// a terminal.
pub fn moving_line(template: &str, parts: Option<u64>, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let style = ProgressStyle::with_template(template).expect("the template is well-formed");
    ProgressBar::with_draw_target(parts, target).with_style(style)
}

/// Writes a line to standard error, and ignores errors.
fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Progress of the set-up: at once on a terminal, elsewhere a line for each long part.
#[derive(Debug)]
pub struct SetUp {
    line: ProgressBar,
    watch: Option<(Sender<&'static str>, JoinHandle<()>)>,
}

impl SetUp {
    /// Starts the set-up; there is no output in quiet mode.
    pub fn new(quiet: bool) -> SetUp {
        let line = moving_line("{wide_msg}", None, quiet);
        let watch = (!quiet && line.is_hidden()).then(|| {
            let (sender, receiver) = mpsc::channel();
            (sender, thread::spawn(move || watch(&receiver, LONG, |part| say(&set_up_line(part)))))
        });
        SetUp { line, watch }
    }

    /// Writes a line that stays.
    pub fn say(&self, line: &str) {
        if self.line.is_hidden() { say(line) } else { self.line.println(line) }
    }

    /// Reports the part that begins, in a word or two.
    pub fn part(&self, part: &'static str) {
        self.line.set_message(set_up_line(part));
        if let Some((sender, _)) = &self.watch {
            let _ = sender.send(part);
        }
    }
}

impl Drop for SetUp {
    fn drop(&mut self) {
        self.line.finish_and_clear();
        if let Some((sender, thread)) = self.watch.take() {
            drop(sender);
            let _ = thread.join();
        }
    }
}

fn set_up_line(part: &str) -> String {
    format!("setting up: {part}")
}

/// Reports each part once it has lasted longer than `long`.
fn watch(parts: &Receiver<&'static str>, long: Duration, mut say: impl FnMut(&'static str)) {
    let mut present = None;
    loop {
        let next = match present {
            Some(_) => parts.recv_timeout(long),
            None => parts.recv().map_err(RecvTimeoutError::from),
        };
        match (next, present.take()) {
            (Ok(part), _) => present = Some(part),
            (Err(RecvTimeoutError::Timeout), Some(part)) => say(part),
            (Err(_), _) => return,
        }
    }
}

/// Formats the line.
fn words(state: &State, done: f64, pace: f64, elapsed: Duration) -> String {
    let rest = Duration::try_from_secs_f64((elapsed.as_secs_f64() * (1.0 / done - 1.0)).ceil());
    let ratio = state.energy / state.start;
    // A start at rest has no energy, or only its rounding error.
    let energy = if ratio.abs() < LARGEST_RATIO {
        format!("energy {:.2} %", 100.0 * ratio)
    } else {
        format!("energy {}", engineering(state.energy, "J"))
    };
    let touch = if state.contact_nodes == 1 { "node touches" } else { "nodes touch" };
    format!(
        "{:3.0} %, t = {}, {} steps/s, {} left, {} {touch}, {energy}",
        100.0 * done,
        engineering(state.time, "s"),
        grouped(pace as u64),
        rest.map_or("?".into(), |rest| HumanDuration(rest).to_string()),
        state.contact_nodes,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_where_the_run_stands() {
        let state = State { time: 0.125, contact_nodes: 3, energy: 1.9753, start: 2.0 };
        assert_eq!(
            words(&state, 0.25, 182_345.6, Duration::from_secs(10)),
            " 25 %, t = 125 ms, 182 345 steps/s, 30 seconds left, 3 nodes touch, energy 98.77 %"
        );
        for start in [0.0, -0.0, 1e-30] {
            let line = words(&State { start, ..state }, 0.25, 182_345.6, Duration::from_secs(10));
            assert!(line.ends_with("3 nodes touch, energy 1.975 J") && line.len() <= 90, "{line}");
            let still = words(&State { start, energy: start, ..state }, 0.25, 1.0, Duration::ZERO);
            assert!(!still.contains("NaN") && !still.contains("inf"), "{still}");
        }
        assert!(words(&state, 0.0, 0.0, Duration::ZERO).contains("? left"));
        assert!(
            words(&State { time: f64::NAN, ..state }, f64::NAN, f64::INFINITY, Duration::ZERO)
                .contains("? left")
        );
    }

    #[test]
    fn quiet_progress_never_asks_for_the_state() {
        let mut progress = Progress::new(0..1000, 0.0..1.0, true);
        for step in 0..1000 {
            progress.tick(step, || unreachable!());
        }
        progress.finish();
    }

    #[test]
    fn the_clock_is_read_now_and_then() {
        let mut progress = Progress::new(0..2_000_000, 0.0..1.0, true);
        assert!(!progress.is_due(1_000_000) && progress.next == 1_000_064);
        std::thread::sleep(REDRAW);
        assert!(progress.is_due(1_000_064));
        assert!(progress.is_due(1_000_064) && progress.next > 1_000_064);
    }
    /// Returns the steps at which a run without a terminal has lines.
    fn lines(steps: Range<u64>) -> Vec<u64> {
        let progress = Progress::new(steps.clone(), 0.0..1.0, true);
        let next = |step: &u64| Some(progress.after(*step));
        std::iter::successors(next(&steps.start), next).take_while(|step| *step < u64::MAX).collect()
    }

    #[test]
    fn lines_come_by_steps_and_not_by_the_clock() {
        assert_eq!(lines(0..1000), [100, 200, 300, 400, 500, 600, 700, 800, 900]);
        assert_eq!(lines(100..120), [102, 104, 106, 108, 110, 112, 114, 116, 118]);
        assert_eq!(lines(7..10), [8, 9]);
        assert!(lines(0..1).is_empty() && lines(5..5).is_empty());
        assert_eq!(lines(0..u64::MAX).len(), 9);
    }

    #[test]
    fn only_long_parts_of_the_set_up_are_told() {
        let ((to, parts), (told, said)) = (mpsc::channel(), mpsc::channel());
        let patient = thread::spawn(move || watch(&parts, Duration::MAX, |part| panic!("{part}")));
        ["mesh", "matrices"].iter().for_each(|part| to.send(part).unwrap());
        drop(to);
        patient.join().unwrap();
        let (to, parts) = mpsc::channel();
        let impatient =
            thread::spawn(move || watch(&parts, Duration::from_millis(1), |part| told.send(part).unwrap()));
        for part in ["mesh", "matrices"] {
            to.send(part).unwrap();
            assert_eq!(said.recv(), Ok(part));
        }
        drop(to);
        impatient.join().unwrap();
    }
}
