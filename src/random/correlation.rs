//! Correlation of random numbers (a Gaussian copula).

use super::normal;
use nalgebra::DMatrix;

/// Lower Cholesky factor of the correlation matrix of normal numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Correlation(DMatrix<f64>);

impl Correlation {
    /// Creates the correlation of a number of keys, given the correlated pairs; `None` where no
    /// random numbers can have it.
    pub fn new(keys: usize, pairs: &[([usize; 2], f64)]) -> Option<Correlation> {
        let mut matrix = DMatrix::identity(keys, keys);
        for ([i, j], correlation) in pairs {
            (matrix[(*i, *j)], matrix[(*j, *i)]) = (*correlation, *correlation);
        }
        matrix.cholesky().map(|factor| Correlation(factor.l()))
    }

    /// Correlates independent numbers that are uniform in (0, 1), so that each stays uniform.
    ///
    /// Numbers with normal distributions get the correlation itself.
    pub fn apply(&self, point: &mut [f64]) {
        let normals: Vec<f64> = point.iter().map(|share| normal::quantile(*share)).collect();
        for (i, share) in point.iter_mut().enumerate() {
            let sum = (0..=i).map(|j| self.0[(i, j)] * normals[j]).sum();
            *share = normal::probability_below(sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Distribution, PointSet};
    use super::Correlation;

    /// Normal numbers have the correlation that is asked for: by Sobol' points to 1 per cent.
    #[test]
    fn normal_numbers_are_correlated() {
        let correlation = Correlation::new(3, &[([0, 2], 0.6)]).unwrap();
        let normal = Distribution::parse("normal(0, 1)").unwrap();
        let sobol = PointSet::Sobol.points(1, 4096, 3);
        let mut points: Vec<Vec<f64>> = (0..4096).map(|run| sobol.point(run)).collect();
        for point in &mut points {
            correlation.apply(point);
            point.iter_mut().for_each(|share| *share = normal.quantile(*share));
        }
        let mean = |i: usize, j: usize| points.iter().map(|point| point[i] * point[j]).sum::<f64>() / 4096.0;
        for (i, j, wanted) in [(0, 0, 1.0), (2, 2, 1.0), (0, 2, 0.6), (0, 1, 0.0), (1, 2, 0.0)] {
            assert!((mean(i, j) - wanted).abs() < 0.01, "{i} {j}: {}", mean(i, j));
        }
        assert!(Correlation::new(3, &[([0, 1], 0.9), ([1, 2], 0.9), ([0, 2], -0.9)]).is_none());
    }
}
