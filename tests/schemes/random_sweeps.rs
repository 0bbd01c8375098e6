//! Statistics of sweeps with random values, compared with closed forms: a single mass, whose
//! amplitude is proportional to its load.

use super::sweeps::{LOAD, heave, linear, rows_of};
use rebond::scene::Scene;
use rebond::sweep::{MeasureStatistics, SweepReport, SweepRows, SweepStatistics};

const RUNS: usize = 400;

/// Returns the statistics of the single mass at w = 0.5 with a random load, and checks that its
/// amplitude is the known one.
fn statistics(random: &str, more: &str) -> SweepStatistics {
    let sweep = format!(
        "sweep = {{ random = [{random}], runs = {RUNS}, period = \"2*pi/w\", periods = 42, settle = 40, {more} }}\n"
    );
    let text = heave("", &sweep);
    let load = |settings: &[String]| {
        Scene::from_str(&text, "random.toml", &[&["parameters.w=0.5".to_owned()], settings].concat())
    };
    let scene = load(&[]).unwrap();
    let rows = rows_of(&scene, &load);
    for row in &rows {
        let amplitude = row.measures.as_ref().unwrap().probes[0].amplitude;
        assert!((amplitude / (row.values[0] * linear(0.5)) - 1.0).abs() < 1e-3, "{row:?}");
    }
    SweepReport::new(&scene, String::new(), SweepRows::new(rows).unwrap()).statistics.unwrap()
}

/// Returns the least and the largest number of successes that differ from the mean no more than 999
/// of 1000 counts.
fn binomial_limits(probability: f64) -> [usize; 2] {
    let odds = (probability / (1.0 - probability)).ln();
    let mut logarithms = vec![RUNS as f64 * (1.0 - probability).ln()];
    for k in 0..RUNS {
        logarithms.push(logarithms[k] + ((RUNS - k) as f64 / (k + 1) as f64).ln() + odds);
    }
    let terms: Vec<f64> = logarithms.into_iter().map(f64::exp).collect();
    let sums = |terms: &mut dyn Iterator<Item = &f64>| {
        let mut sum = 0.0;
        terms
            .take_while(|term| {
                sum += **term;
                sum < 5e-4
            })
            .count()
    };
    [sums(&mut terms.iter()), RUNS - sums(&mut terms.iter().rev())]
}

/// Standard normal quantiles of 5, 25, 50, 75 and 95 per cent.
const NORMAL: [(f64, f64); 5] = [
    (0.05, -1.644_853_627),
    (0.25, -0.674_489_750),
    (0.5, 0.0),
    (0.75, 0.674_489_750),
    (0.95, 1.644_853_627),
];

/// Probabilities of plain draws are within the binomial interval of 99.9 per cent about the closed
/// form, for each of some levels of the amplitude. Those of Latin and Sobol' points are much
/// closer.
#[test]
fn probabilities_are_those_of_the_distribution() {
    let criteria = |level: fn(f64) -> f64| {
        let levels = NORMAL.map(|(_, z)| format!("\"u_amplitude < {:?}\"", level(z) * linear(0.5)));
        format!("criterion = [{}]", levels.join(", "))
    };
    let normal = criteria(|z| LOAD * (1.0 + 0.1 * z));
    let lognormal = criteria(|z| LOAD * (0.5 * z).exp());
    let random = format!("\"p=normal({LOAD}, {})\"", 0.1 * LOAD);
    let of_logarithm = format!("\"p=lognormal({:?}, 0.5)\"", LOAD.ln());
    let cases = [
        (&random, format!("{normal}, points = \"plain\""), false),
        (&random, format!("{normal}, points = \"plain\", seed = 2"), false),
        (&of_logarithm, format!("{lognormal}, points = \"plain\""), false),
        (&random, format!("{normal}, points = \"latin\""), true),
        (&of_logarithm, format!("{lognormal}, points = \"sobol\""), true),
    ];
    for (random, more, is_stratified) in cases {
        for (criterion, (probability, _)) in statistics(random, &more).criteria.iter().zip(NORMAL) {
            let [least, most] = match is_stratified {
                // The scheme's own error of 1e-3 of the amplitude moves four runs.
                true => [-5.0, 5.0].map(|more| (probability * RUNS as f64 + more) as usize),
                false => binomial_limits(probability),
            };
            assert!((least..=most).contains(&criterion.fulfilled), "{more} {probability}: {criterion:?}");
            assert_eq!((criterion.runs, criterion.undecided), (RUNS, 0));
            let is_within = criterion.low < probability && probability < criterion.high;
            assert!(is_within || !is_stratified, "{criterion:?}");
        }
    }
}

/// Quantiles, mean and deviation of the amplitude are those of the load.
#[test]
fn quantiles_are_those_of_the_distribution() {
    let random = format!("\"p=normal({LOAD}, {})\"", 0.1 * LOAD);
    let statistics = statistics(&random, "points = \"latin\"");
    let of_amplitude = |measure: &&MeasureStatistics| measure.measure == "u_amplitude";
    let measured = statistics.quantiles.iter().find(of_amplitude).unwrap();
    let scale = LOAD * linear(0.5);
    let quantiles = [measured.q05, measured.q25, measured.median, measured.q75, measured.q95];
    for (quantile, (share, z)) in quantiles.into_iter().zip(NORMAL) {
        assert!((quantile / scale - (1.0 + 0.1 * z)).abs() < 3e-3, "{share}: {quantile}");
    }
    assert!((measured.mean / scale - 1.0).abs() < 1e-3 && (measured.deviation / scale - 0.1).abs() < 1e-3);
    assert_eq!((measured.runs, measured.unit.as_str()), (RUNS, "m"));
}
