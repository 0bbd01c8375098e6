//! Symmetric quadrature rules on a triangle, and Gauss rules on a line.
//!
//! A rule is a list of points in barycentric coordinates with weights that sum to 1, and thus gives
//! the mean over the triangle. All points lie inside and all weights are positive.
//!
//! Sources: G. Strang and G. J. Fix, *An Analysis of the Finite Element Method*, 1973, table 4.1
//! (degrees 2 and 3); D. A. Dunavant, *High degree efficient symmetrical Gaussian quadrature rules
//! for the triangle*, International Journal for Numerical Methods in Engineering 21, 1985 (degree
//! 6). Digits beyond the published ones solve the same equations.

/// Quadrature point in barycentric coordinates, and its weight.
pub type Node = ([f64; 3], f64);

/// Quadrature rules for the pieces of a cell.
#[derive(Clone, Copy, Debug)]
pub enum Rule<'r> {
    /// One rule for all pieces.
    Same(&'r [Node]),
    /// One rule per piece.
    Own(&'r [Vec<Node>]),
}

impl<'r> Rule<'r> {
    /// Returns the rule of a piece.
    pub fn of(self, piece: usize) -> &'r [Node] {
        match self {
            Rule::Same(rule) => rule,
            Rule::Own(rules) => &rules[piece],
        }
    }
}

impl<'r, const K: usize> From<&'r [Node; K]> for Rule<'r> {
    fn from(rule: &'r [Node; K]) -> Rule<'r> {
        Rule::Same(rule)
    }
}

/// Rule exact to degree 2, for the stiffness of a cubic (Strang and Fix).
pub const DEGREE_2: [Node; 3] = orbit_3(1.0 / 6.0, 1.0 / 3.0);

/// Rule exact to degree 3, for the integral of a cubic (Strang and Fix). The coordinates are the
/// roots of x^3 - x^2 + x/4 - 1/60.
pub const DEGREE_3: [Node; 6] = orbit_6(0.23193336855303057, 0.10903900907287721, 1.0 / 6.0);

/// Rule exact to degree 6, for the mass of a cubic (Dunavant).
pub const DEGREE_6: [Node; 12] = {
    let a = orbit_3(0.24928674517091042, 0.11678627572637937);
    let b = orbit_3(0.06308901449150223, 0.05084490637020682);
    let c = orbit_6(0.3103524510337844, 0.05314504984481695, 0.08285107561837357);
    [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], c[3], c[4], c[5]]
};

/// Point on [-1, 1], and its weight.
pub type LineNode = (f64, f64);

/// Gauss rule exact to degree 3: squares of second derivatives of cubics, and their deflections.
pub const GAUSS_2: [LineNode; 2] = [(-0.577_350_269_189_625_8, 1.0), (0.577_350_269_189_625_8, 1.0)];

/// Gauss rule exact to degree 7: squares of cubics.
pub const GAUSS_4: [LineNode; 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_2),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_2),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];

/// Returns the permutations of `(1 - 2a, a, a)` with a common weight.
const fn orbit_3(a: f64, weight: f64) -> [Node; 3] {
    let c = 1.0 - 2.0 * a;
    [([c, a, a], weight), ([a, c, a], weight), ([a, a, c], weight)]
}

/// Returns the permutations of `(1 - a - b, a, b)` with a common weight.
const fn orbit_6(a: f64, b: f64, weight: f64) -> [Node; 6] {
    let c = 1.0 - a - b;
    [
        ([c, a, b], weight),
        ([c, b, a], weight),
        ([a, c, b], weight),
        ([b, c, a], weight),
        ([a, b, c], weight),
        ([b, a, c], weight),
    ]
}
