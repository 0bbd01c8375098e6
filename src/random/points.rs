//! Points of random sweeps: for each run one number in (0, 1) per random key, of which the
//! distributions make values.
//!
//! A point depends on the seed, the number of its run and the number of keys; a Latin hypercube
//! also on the number of runs.

use super::SplitMix64;

/// Numbers of Sobol' points have this many leading bits.
const BITS: usize = 32;

/// Direction numbers of the dimensions behind the first.
const JOE_KUO: &str = include_str!("joe_kuo.txt");

/// Largest number below 1.
const BELOW_ONE: f64 = 1.0 - 0.5 * f64::EPSILON;

/// Set of points in the unit cube.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointSet {
    /// Independent points.
    Plain,
    /// Latin hypercube: of n points, each n-th of each axis has one.
    Latin,
    /// Sobol' points with a random digital shift.
    Sobol,
    /// Saltelli's scheme for sensitivity indices, of pairs of Sobol' points.
    ///
    /// For k keys, a block of k + 2 runs has the two points of a pair, and then the first one with
    /// one number from the second, for each key (Saltelli et al., Computer Physics Communications
    /// 181 (2010) 259-270).
    Saltelli,
}

impl PointSet {
    /// Returns the largest number of keys.
    pub fn most_keys(self) -> usize {
        let dimensions = 1 + rows().count();
        match self {
            PointSet::Plain | PointSet::Latin => usize::MAX,
            PointSet::Sobol => dimensions,
            PointSet::Saltelli => dimensions / 2,
        }
    }

    /// Returns the number of runs that belong together.
    pub fn block(self, keys: usize) -> usize {
        if self == PointSet::Saltelli { keys + 2 } else { 1 }
    }

    /// Returns whether the point of a run is independent of the points before.
    pub fn is_independent(self, run: usize, keys: usize) -> bool {
        self != PointSet::Saltelli || run % self.block(keys) < 2
    }

    /// Returns the points of a number of runs with a number of keys.
    pub fn points(self, seed: u64, runs: usize, keys: usize) -> DrawnPoints {
        let source = match self {
            PointSet::Plain => PointSource::Plain,
            PointSet::Latin => PointSource::Latin((0..keys).map(|key| shuffled(runs, seed, key)).collect()),
            PointSet::Sobol => PointSource::Sobol(Sobol::new(keys)),
            PointSet::Saltelli => PointSource::Saltelli(Sobol::new(2 * keys)),
        };
        DrawnPoints { source, seed, runs, keys }
    }
}

/// Points of the runs of a sweep, each made when it is asked for.
pub struct DrawnPoints {
    source: PointSource,
    seed: u64,
    runs: usize,
    keys: usize,
}

/// Data of a set of points.
enum PointSource {
    Plain,
    /// Part of each axis that a run is in.
    Latin(Vec<Vec<u32>>),
    Sobol(Sobol),
    Saltelli(Sobol),
}

impl DrawnPoints {
    /// Returns the point of a run, with a number in (0, 1) per key.
    pub fn point(&self, run: usize) -> Vec<f64> {
        let DrawnPoints { source, seed, runs, keys } = self;
        let keys = 0..*keys;
        match source {
            PointSource::Plain => keys.map(|key| unit(*seed, run, key)).collect(),
            PointSource::Latin(orders) => {
                let number = |key: usize| {
                    let place = f64::from(orders[key][run]) + unit(*seed, run, key);
                    (place / *runs as f64).min(BELOW_ONE)
                };
                keys.map(number).collect()
            }
            PointSource::Sobol(sobol) => sobol.shifted(*seed, run),
            PointSource::Saltelli(sobol) => {
                let (block, place) = (run / (keys.len() + 2), run % (keys.len() + 2));
                let pair = sobol.shifted(*seed, block);
                let of_second = |key: usize| place == 1 || place == key + 2;
                keys.clone().map(|key| pair[if of_second(key) { keys.len() + key } else { key }]).collect()
            }
        }
    }
}

/// Returns the generator of a place in a table.
fn generator(seed: u64, run: usize, key: usize) -> SplitMix64 {
    let mixed = SplitMix64::new(SplitMix64::new(seed).bits() ^ run as u64).bits();
    SplitMix64::new(mixed ^ key as u64)
}

/// Returns a number in (0, 1) for a place in a table.
fn unit(seed: u64, run: usize, key: usize) -> f64 {
    // Half a unit of 52 bits is exact, so that neither end occurs.
    ((generator(seed, run, key).bits() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
}

/// Returns the numbers below `count` in a random order.
fn shuffled(count: usize, seed: u64, key: usize) -> Vec<u32> {
    let mut random = generator(seed, usize::MAX, key);
    let mut order: Vec<u32> = (0..count as u32).collect();
    for last in (1..count).rev() {
        order.swap(last, (random.bits() % (last as u64 + 1)) as usize);
    }
    order
}

/// Returns the numbers of each row of the table of directions.
fn rows() -> impl Iterator<Item = Vec<u32>> {
    let lines = JOE_KUO.lines().filter(|line| !line.starts_with('#'));
    lines.map(|line| line.split(' ').filter_map(|number| number.parse().ok()).collect())
}

/// Sobol' points (I. M. Sobol', USSR Computational Mathematics and Mathematical Physics 7 (1967)
/// 86-112), in the order of Gray codes.
struct Sobol(Vec<[u32; BITS]>);

impl Sobol {
    fn new(dimensions: usize) -> Sobol {
        let first = std::array::from_fn(|i| 1 << (BITS - 1 - i));
        let others = rows().map(|row| {
            let (degree, polynomial, start) = (row[1] as usize, row[2], &row[3..]);
            let mut directions = [0; BITS];
            for i in 0..BITS {
                directions[i] = if i < degree {
                    start[i] << (BITS - 1 - i)
                } else {
                    let inner = (1..degree).filter(|k| (polynomial >> (degree - 1 - k)) & 1 == 1);
                    let last = directions[i - degree];
                    inner.fold(last ^ (last >> degree), |sum, k| sum ^ directions[i - k])
                };
            }
            directions
        });
        Sobol(std::iter::once(first).chain(others).take(dimensions).collect())
    }

    /// Returns the leading bits of a coordinate of a point.
    fn bits(&self, number: usize, dimension: usize) -> u32 {
        let gray = number ^ (number >> 1);
        let directions = self.0[dimension].iter().enumerate().filter(|(i, _)| (gray >> i) & 1 == 1);
        directions.fold(0, |sum, (_, direction)| sum ^ direction)
    }

    /// Returns a point whose leading bits are shifted, by the same ones for all points, and whose
    /// other bits are random.
    fn shifted(&self, seed: u64, number: usize) -> Vec<f64> {
        let coordinate = |dimension: usize| {
            let shift = (generator(seed, usize::MAX, dimension).bits() >> 32) as u32;
            let bits = f64::from(self.bits(number, dimension) ^ shift) + unit(seed, number, dimension);
            (bits / (1_u64 << BITS) as f64).min(BELOW_ONE)
        };
        (0..self.0.len()).map(coordinate).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{BITS, PointSet, Sobol, rows};

    /// Returns the points of a number of runs.
    fn table(set: PointSet, seed: u64, runs: usize, keys: usize) -> Vec<Vec<f64>> {
        let points = set.points(seed, runs, keys);
        (0..runs).map(|run| points.point(run)).collect()
    }

    /// Returns how many points are in each n-th of an axis.
    fn counts(points: &[Vec<f64>], axis: usize, parts: usize) -> Vec<usize> {
        let mut counts = vec![0; parts];
        points.iter().for_each(|point| counts[(point[axis] * parts as f64) as usize] += 1);
        counts
    }

    #[test]
    fn a_latin_hypercube_has_one_point_in_each_part_of_each_axis() {
        let points = table(PointSet::Latin, 3, 1000, 5);
        for axis in 0..5 {
            assert_eq!(counts(&points, axis, 1000), [1; 1000]);
        }
        assert_ne!(points, table(PointSet::Latin, 4, 1000, 5));
    }

    /// Points without a shift, in the order of Gray codes, by the crate sobol 1.0.2 with the table
    /// of Joe and Kuo.
    #[test]
    fn sobol_points_are_those_of_another_program() {
        let sobol = Sobol::new(32);
        let value = |number: usize, dimension: usize| {
            f64::from(sobol.bits(number, dimension)) / (1_u64 << BITS) as f64
        };
        let first = [
            [0.5, 0.5, 0.5, 0.5, 0.5],
            [0.75, 0.25, 0.25, 0.25, 0.75],
            [0.25, 0.75, 0.75, 0.75, 0.25],
            [0.375, 0.375, 0.625, 0.875, 0.375],
            [0.875, 0.875, 0.125, 0.375, 0.875],
            [0.625, 0.125, 0.875, 0.625, 0.625],
            [0.125, 0.625, 0.375, 0.125, 0.125],
        ];
        for (number, point) in (1..).zip(first) {
            assert_eq!([0, 1, 2, 3, 4].map(|dimension| value(number, dimension)), point, "{number}");
        }
        let last = [0.0595703125, 0.3408203125, 0.1474609375, 0.1455078125];
        assert_eq!([28, 29, 30, 31].map(|dimension| value(1000, dimension)), last);
    }

    /// Each of 2^m parts of each axis has one of 2^m points, and so has each of 2^m equal
    /// rectangles of the first two axes: they are a (0, m, 2)-net. A shift keeps this.
    #[test]
    fn sobol_points_are_stratified() {
        let most = PointSet::Sobol.most_keys();
        assert_eq!((most, rows().count()), (32, 31));
        let points = table(PointSet::Sobol, 7, 256, most);
        for axis in 0..most {
            assert_eq!(counts(&points, axis, 256), [1; 256], "{axis}");
        }
        for across in 0..=8 {
            let sides = [1 << across, 256 >> across];
            let mut boxes = vec![0; 256];
            for point in &points {
                let [x, y] = [0, 1].map(|axis| (point[axis] * sides[axis] as f64) as usize);
                boxes[x * sides[1] + y] += 1;
            }
            assert_eq!(boxes, [1; 256], "{across}");
        }
    }

    #[test]
    fn a_plain_point_depends_on_seed_and_number_alone() {
        let [few, many] = [10, 1000].map(|runs| table(PointSet::Plain, 1, runs, 3));
        assert_eq!(few, many[..10]);
        assert_ne!(few, table(PointSet::Plain, 2, 10, 3));
        let mean = many.iter().flatten().sum::<f64>() / 3000.0;
        // Three standard deviations.
        assert!((mean - 0.5).abs() < 3.0 / (12.0 * 3000_f64).sqrt(), "{mean}");
    }

    #[test]
    fn a_block_of_saltellis_scheme_exchanges_one_number_after_the_other() {
        let points = table(PointSet::Saltelli, 1, 10, 3);
        for block in points.chunks(5) {
            for key in 0..3 {
                for other in 0..3 {
                    assert_eq!(block[2 + key][other], block[usize::from(key == other)][other]);
                }
            }
        }
    }
}
