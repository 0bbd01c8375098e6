//! Measurement of parts that take turns, so that other programs slow all of them alike.

use std::hint::black_box;
use std::time::{Duration, Instant};

/// Least time of a part in a turn.
const LEAST: Duration = Duration::from_millis(5);

/// Part whose time is measured: a name, and a function that returns the time of one run, in s.
pub type Part<'p> = (String, Box<dyn FnMut() -> f64 + 'p>);

/// Times of some parts, in s, one row per turn.
#[derive(Default)]
pub struct Times {
    turns: Vec<Vec<f64>>,
}

/// Returns a part that runs a function as often as fills its turn. A first run is not measured,
/// since the parts before it have left their own data in the caches.
pub fn part<'p, R>(name: &str, mut work: impl FnMut() -> R + 'p) -> Part<'p> {
    let run = move || {
        drop(black_box(work()));
        let clock = Instant::now();
        let (mut runs, mut next) = (0_u32, 1);
        while clock.elapsed() < LEAST {
            (0..next).for_each(|_| drop(black_box(work())));
            runs += next;
            next *= 2;
        }
        clock.elapsed().as_secs_f64() / f64::from(runs)
    };
    (name.to_owned(), Box::new(run))
}

impl Times {
    /// Adds turns for some time, at least three.
    pub fn measure(&mut self, parts: &mut [Part], watch: Duration) {
        let clock = Instant::now();
        for turn in 0.. {
            if turn >= 3 && clock.elapsed() > watch {
                break;
            }
            self.turns.push(parts.iter_mut().map(|(_, run)| run()).collect());
        }
    }

    /// Returns the quartiles of a part's time over the turns, in s.
    pub fn quartiles(&self, part: usize) -> [f64; 3] {
        quartiles(self.turns.iter().map(|turn| turn[part]))
    }

    /// Returns the median over the turns of a part's time relative to another's.
    pub fn ratio(&self, part: usize, base: usize) -> f64 {
        quartiles(self.turns.iter().map(|turn| turn[part] / turn[base]))[1]
    }
}

fn quartiles(values: impl Iterator<Item = f64>) -> [f64; 3] {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    [1, 2, 3].map(|quarter| values[(quarter * (values.len() - 1)).div_ceil(4)])
}
