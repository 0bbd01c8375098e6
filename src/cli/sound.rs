//! Command `rebond sound`.

use super::cache::CacheArgs;
use super::command::{Execute, Program};
use super::printing::OutputMode;
use super::set_up::SetUpTold;
use crate::error::{Error, Result};
use crate::input::create_parent;
use crate::study::{Sound, Source};
use clap::Args;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  rebond sound runs/plate --probe corner --out corner.wav
  rebond sound runs/plate --at 0.6,0.2,1 --out plate.wav     # sound pressure 1 m above the plate
  rebond sound runs/switch --probe tip --slow 1000 --out switch.wav";

/// Make a finished run heard: the velocity of a probe, or the sound pressure at a point; WAV
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct SoundArgs {
    /// Folder of a finished run
    folder: PathBuf,
    /// Probe of a deflection or a velocity, whose velocity is the sound unless --at is given
    #[arg(long, value_name = "NAME")]
    probe: Option<String>,
    /// Point in m, z above the plate or, negative, below it: repeats the run for the sound pressure
    /// there, the plate in an infinite rigid baffle
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    at: Option<String>,
    /// WAV file, 44,100 Hz and 16 bits
    #[arg(long, value_name = "FILE.wav")]
    out: PathBuf,
    /// Times that the sound is slower than the motion
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    slow: f64,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    voice: OutputMode,
}

impl Execute for SoundArgs {
    fn execute(&self, _: Program) -> Result<()> {
        let slow = self.slow;
        if !(slow.is_finite() && slow > 0.0) {
            return Err(Error::Usage(format!("--slow {slow}: expected a number greater than 0")));
        }
        let shown = self.out.display();
        if self.out.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("wav")) {
            return Err(Error::Usage(format!("--out {shown}: expected a name that ends in .wav")));
        }
        let source = match (&self.at, &self.probe) {
            (Some(text), _) => Source::Point(point(text)?),
            (None, Some(name)) => Source::Probe(name.clone()),
            (None, None) => return Err(Error::Usage("expected --probe NAME, or --at X,Y,Z".into())),
        };
        let _cache = self.cache.open(self.voice.is_silent());
        let set_up = SetUpTold::new(self.voice);
        let sound = Sound::new(&self.folder, &source, slow)?;
        drop(set_up);
        create_parent(&self.out)?;
        sound.write(&self.out)?;
        self.voice.print(&format!("{sound}written to {shown}\n"), &sound)
    }
}

/// Parses the coordinates of a point in the air, in m.
fn point(text: &str) -> Result<[f64; 3]> {
    let bare = text.trim().trim_start_matches('[').trim_end_matches(']');
    let numbers: Option<Vec<f64>> = bare.split(',').map(|number| number.trim().parse().ok()).collect();
    let point: Option<[f64; 3]> = numbers.and_then(|numbers| numbers.try_into().ok());
    match point {
        Some(point) if point.iter().all(|x| x.is_finite()) && point[2] != 0.0 => Ok(point),
        _ => Err(Error::Usage(format!("--at {text}: expected x,y,z in m with z other than 0"))),
    }
}
