//! The meaning of formulas, the errors of invalid ones, and tables of time.
//!
//! The file `data/formulas.json` has the reference values; `data/README.md` names their source.

use crate::common::Random;
use crate::common::clock::processor_seconds;
use proptest::prelude::*;
use rebond::field::{Condition, Derivatives, Field, Interpolation, Interval, Names, Parameters, Table};
use rebond::mesh::Point;
use serde_json::Value;

fn reference() -> Value {
    serde_json::from_str(include_str!("../data/formulas.json")).expect("valid JSON")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("an array").iter().map(number).collect()
}

fn parse(text: &str) -> Field {
    Field::parse(text, Names::XYT).unwrap_or_else(|fault| panic!("{text}: {fault}"))
}

fn fault(text: &str) -> String {
    Field::parse(text, Names::XYT).expect_err(text).to_string()
}

#[track_caller]
fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    let error = (found - expected).abs() / expected.abs().max(1.0);
    assert!(error <= tolerance, "{what}: found {found}, expected {expected}");
}

#[test]
fn values_are_python_s() {
    let reference = reference();
    let at = &reference["at"];
    let (point, t) = (Point::new(number(&at["x"]), number(&at["y"])), number(&at["t"]));
    for case in reference["values"].as_array().expect("cases") {
        let text = case["formula"].as_str().expect("a formula");
        let field = parse(text);
        let value = field.value(point, t).expect("finite");
        assert_close(value, number(&case["value"]), 1e-14, text);
        assert_eq!(field.jet(point, t).expect("finite").value, value, "{text}");
    }
}

#[test]
fn derivatives_are_sympy_s() {
    let reference = reference();
    let at = &reference["at"];
    let (point, t) = (Point::new(number(&at["x"]), number(&at["y"])), number(&at["t"]));
    for case in reference["jets"].as_array().expect("cases") {
        let text = case["formula"].as_str().expect("a formula");
        let jet = parse(text).jet(point, t).expect("smooth");
        for (found, expected) in [jet.value, jet.first, jet.second].into_iter().zip(numbers(&case["jet"])) {
            assert_close(found, expected, 1e-12, text);
        }
    }
}

#[test]
fn derivatives_of_pieces() {
    let jet = |text: &str, t| {
        let jet = parse(text).jet(Point::new(0.0, -2.0), t).expect("smooth");
        [jet.value, jet.first, jet.second]
    };
    assert_eq!(jet("abs(t^3)", -2.0), [8.0, -12.0, 12.0]);
    assert_eq!(jet("max(t^2, 3*t)", 2.0), [6.0, 3.0, 0.0]);
    assert_eq!(jet("min(t^2, 3*t)", 2.0), [4.0, 4.0, 2.0]);
    assert_eq!(jet("clamp(t^2, 0, 5)", 2.0), [4.0, 4.0, 2.0]);
    assert_eq!(jet("clamp(t^2, 0, 3)", 2.0), [3.0, 0.0, 0.0]);
    assert_eq!(jet("if(t < 1, t^2, 2*t - 1)", 0.5), [0.25, 1.0, 2.0]);
    assert_eq!(jet("mod(3*t, 2) + floor(t) + sign(t) + step(t)", 1.5), [3.5, 3.0, 0.0]);
    assert_eq!(jet("t^2 + t^1 + t^0 + t^3", 0.0), [1.0, 1.0, 2.0]);
    // A field that does not depend on time has no velocity, however steep it is in space, and a
    // branch that is not taken does not matter.
    assert_eq!(jet("sqrt(x)*t + hypot(x, 0)", 2.0), [0.0, 0.0, 0.0]);
    assert_eq!(jet("if(y > 0, ln(y*t), t)", 2.0), [2.0, 1.0, 0.0]);
}

#[test]
fn faults_point_into_the_formula() {
    for (text, expected) in [
        ("2x", "column 2: found x; expected an operator or the end; a product is written with *"),
        ("2(x)", "column 2: found (; expected an operator or the end; a product is written with *"),
        ("x(1 - y)", "column 1: x is no function; a product is written with *"),
        ("1 + sine(x)", "column 5: sine is no function (did you mean sin?)"),
        ("log(x)", "column 1: log is no function (did you mean ln or log10?)"),
        (
            "x + coss",
            "column 5: coss is not known; expected x, y, t, pi or e, or a function (did you mean cos?)",
        ),
        ("x + P1", "column 5: P1 is not known; expected x, y, t, pi or e, or a function"),
        ("é + sin", "column 1: é is not known; expected x, y, t, pi or e, or a function"),
        ("1/é(x)", "column 3: é is no function"),
        ("sin + 1", "column 1: sin is a function; expected ( after it"),
        ("sin(x", "column 4: this ( is never closed; expected )"),
        ("(x + 1))", "column 8: this ) closes nothing"),
        ("1 + * 2", "column 5: found *; expected a number, a name or ("),
        ("1 +", "column 4: the formula ends; expected a number, a name or ("),
        ("", "column 1: the formula ends; expected a number, a name or ("),
        ("x + 1,5", "column 6: found ,; expected an operator or the end; a decimal point is written ."),
        (
            "5*bar",
            "column 3: bar is not known; expected x, y, t, pi or e, or a function; a formula has no units, its key has one",
        ),
        (
            "3 m/s2",
            "column 3: found m; expected an operator or the end; a formula has no units, its key has one",
        ),
        ("3g", "column 2: found g; expected an operator or the end; a formula has no units, its key has one"),
        ("1..2", "column 3: found .2; expected an operator or the end; a product is written with *"),
        ("x + .", "column 5: . is not a number"),
        ("1e400*x", "column 1: 1e400 is too large for a number"),
        ("x**2", "column 2: found **; write ^"),
        ("if(x > 1 && y > 1, 1, 0)", "column 10: found &&; write and"),
        ("if(x = 1, 1, 0)", "column 6: found =; write =="),
        ("2 × x", "column 3: found ×; write *"),
        ("πx + x", "column 1: πx is not known; expected x, y, t, pi or e, or a function"),
        ("y + x²", "column 6: found ²; write ^2"),
        ("x $ y", "column 3: '$' has no meaning in a formula"),
        ("atan2(x)", "column 1: atan2 takes 2 arguments; found 1"),
        ("min(x)", "column 1: min takes at least 2 arguments; found 1"),
        ("sin()", "column 1: sin takes 1 argument; found 0"),
        ("if(x, 1, 0)", "column 4: found a number; expected a condition, such as x > 0.5"),
        ("100*(x > 1)", "column 5: found a condition; expected a number, such as if(x > 0.5, 1, 0)"),
        ("x > 1", "column 1: found a condition; expected a number, such as if(x > 0.5, 1, 0)"),
        ("if(0 < x < 1, 1, 0)", "column 10: < after a comparison; write a < b and b < c"),
        ("x + 1/(2 - 2)", "column 5: 1/(2 - 2) is inf; expected a finite number"),
        ("sqrt(-1)", "column 1: sqrt(-1) is NaN; expected a finite number"),
    ] {
        assert_eq!(fault(text), expected, "{text}");
    }
    let fault = Field::parse("x*t", Names::XY).unwrap_err().to_string();
    assert_eq!(fault, "column 3: t is not known here; expected x, y, pi or e");
}

#[test]
fn faults_of_values_name_the_point() {
    let at = |text: &str, x: f64| parse(text).value(Point::new(x, 0.25), 2.0).expect_err(text).to_string();
    assert_eq!(
        at("3 + t*sin(1/x)", 0.0),
        "column 11: 1/x is inf at x = 0.0, t = 2.0; expected a finite number"
    );
    assert_eq!(
        at("y/(x - 1)", 1.0),
        "column 1: y/(x - 1) is inf at x = 1.0, y = 0.25; expected a finite number"
    );
    assert_eq!(
        at("if(sqrt(x) > 1, 1, 2)", -1.0),
        "column 4: sqrt(x) is NaN at x = -1.0; expected a finite number"
    );
    let points = [Point::new(1.0, 0.0), Point::new(0.0, 0.0)];
    let fault = parse("1/x").values(&points, 0.0, &mut [0.0; 2]).unwrap_err().to_string();
    assert_eq!(fault, "column 1: 1/x is inf at x = 0.0; expected a finite number");
    let fault = parse("sqrt(t)").jet(points[0], 0.0).unwrap_err().to_string();
    assert_eq!(fault, "column 1: no velocity at t = 0.0; expected a smooth formula");
}

#[test]
fn conditions_choose_points() {
    let holds = |text: &str, x, y| {
        Condition::parse(text, Names::XY, Parameters::NONE).expect(text).holds(Point::new(x, y), 0.0)
    };
    assert_eq!(holds("x > 0.5 and y < 0.2", 0.6, 0.1), Ok(true));
    assert_eq!(holds("x > 0.5 and y < 0.2", 0.5, 0.1), Ok(false));
    assert_eq!(holds("hypot(x - 1, y) <= 0.5 or not (x != 3)", 1.3, 0.4), Ok(true));
    assert_eq!(holds("x > 0 and ln(x) < 1", -1.0, 0.0), Ok(false));
    assert_eq!(holds("x <= 0 or ln(x) < 1", -1.0, 0.0), Ok(true));
    assert!(holds("ln(x) < 1", -1.0, 0.0).is_err());
    let fault = Condition::parse("x - 1", Names::XY, Parameters::NONE).unwrap_err().to_string();
    assert_eq!(fault, "column 1: found a number; expected a condition, such as x > 0.5");
}

#[test]
fn many_points_are_as_one() {
    let points: Vec<Point> =
        (0..37).map(|i| Point::new(0.1 * f64::from(i), 1.0 - 0.03 * f64::from(i))).collect();
    let text = "if(x > 1 and y > 0.5, x^y, mod(x, 0.3)*min(x, y, t)) + atan2(y, x)*exp(-t)";
    for text in [text, "t^2", "3.5", "x"] {
        let field = parse(text);
        let mut values = vec![0.0; points.len()];
        field.values(&points, 0.4, &mut values).expect("finite");
        for (&point, value) in points.iter().zip(&values) {
            assert_eq!(field.value(point, 0.4), Ok(*value), "{text}");
            assert_eq!(field.jet(point, 0.4).map(|jet| jet.value), Ok(*value), "{text}");
        }
    }
    assert_eq!(parse("1/x").values(&[], 0.0, &mut []), Ok(()));
}

#[test]
fn a_field_knows_what_it_depends_on() {
    let field = parse("100*sin(2*pi*50*t)");
    assert!(field.depends_on(Names::T) && !field.depends_on(Names::XY));
    assert!(parse("y").depends_on(Names::XY) && !parse("y").depends_on(Names::T));
    assert_eq!(parse(" -2*pi + 2*pi").constant(), Some(0.0));
    assert_eq!(parse("x - x").constant(), None);
    assert_eq!(Field::from(-1.5).constant(), Some(-1.5));
    assert_eq!(Field::from(-1.5).to_string(), "-1.5");
    assert_eq!(parse("1e-3 * x").to_string(), "1e-3 * x");
    let written = |field: &Field| serde_json::to_string(field).expect("JSON");
    assert_eq!(written(&Field::from(-1.5)), "-1.5");
    assert_eq!(written(&parse("2*x")), "\"2*x\"");
}

fn terms(text: &str) -> Option<Vec<(String, String)>> {
    let terms = parse(text).terms()?;
    Some(terms.iter().map(|term| (term.time.to_string(), term.place.to_string())).collect())
}

#[test]
fn sums_of_time_and_place_are_found() {
    for (text, expected) in [
        ("3", &[("1.0", "3.0")][..]),
        // Numbers that multiply the law of time go to the other factor.
        ("t*2", &[("t", "2.0")]),
        ("-3*sin(t)/4", &[("sin(t)", "1.0 / 4.0 * -3.0")]),
        ("2*t*sin(t)", &[("2.0 * t * sin(t)", "1.0")]),
        ("100*sin(2*t)*(1 - x)", &[("sin(2.0 * t)", "(1.0 - x) * 100.0")]),
        ("x + t*y + y^2", &[("1.0", "x + y ^ 2.0"), ("t", "y")]),
        ("x*sin(t) - x*cos(t)", &[("sin(t)", "x"), ("cos(t)", "-x")]),
        ("(x - t)*(x + 1)/y", &[("1.0", "x * (x + 1.0) / y"), ("t", "-((x + 1.0) / y)")]),
        ("-(t*x)^-2/(2*t)", &[("t ^ (-2.0) / (2.0 * t)", "-x ^ (-2.0)")]),
        ("if(x > 1, t*y, 0)", &[("t", "if(x > 1.0, y, 0.0)")]),
        ("if(t > 1, t*y, 3)", &[("if(t > 1.0, t, 0.0)", "y"), ("if(t > 1.0, 0.0, 1.0)", "3.0")]),
        ("sin(3*x - 5*t)", &[("sin(-(5.0 * t))", "cos(3.0 * x)"), ("cos(-(5.0 * t))", "sin(3.0 * x)")]),
        ("cos(y + t)", &[("cos(t)", "cos(y)"), ("sin(t)", "-sin(y)")]),
    ] {
        let expected = expected.iter().map(|(time, place)| (time.to_string(), place.to_string()));
        let expected: Vec<_> = expected.collect();
        assert_eq!(terms(text), Some(expected), "{text}");
    }
    for text in [
        "sin(x*t)",
        "sin(x*t + 1)",
        "cos(1 - x*t)",
        "1/(x + t)",
        "abs(x - t)",
        "if(x > t, 1, 0)",
        "(x*t)^0.5",
        "hypot(x, t)",
    ] {
        assert_eq!(terms(text), None, "{text}");
    }
}

#[test]
fn long_and_deep_formulas_end() {
    let begin = processor_seconds();
    for text in [
        format!("{}x{}", "(".repeat(100_000), ")".repeat(100_000)),
        "(".repeat(30_000),
        "-".repeat(30_000) + "x",
        "not ".repeat(10_000) + "x > 1",
        "2^".repeat(30_000) + "x",
        "sin(".repeat(10_000) + "x",
        "9".repeat(100_000),
    ] {
        assert!(Field::parse(&text, Names::XY).is_err());
    }
    let long = "x + t*".repeat(10_000) + "y";
    let field = parse(&long);
    assert_eq!(field.terms(), None);
    assert!(field.value(Point::new(1.0, 1.0), 0.5).is_ok());
    let pure = parse(&("x + ".repeat(10_000) + "1"));
    assert_eq!(pure.terms().expect("one term")[0].place.value(Point::new(2.0, 0.0), 0.0), Ok(20_001.0));
    assert!(parse(&"9".repeat(300)).constant().is_some());
    let levels = |count: usize| format!("{}x{}", "(".repeat(count), ")".repeat(count));
    assert!(Field::parse(&levels(99), Names::XY).is_ok());
    assert_eq!(fault(&levels(100)), "column 101: nested too deep; expected at most 100 levels");
    assert!(processor_seconds() - begin < 5.0);
}

/// Returns a strategy for a formula in full parentheses with its value at x = 0.7, y = -1.3, t =
/// 0.35.
fn formulas() -> impl Strategy<Value = (String, f64)> {
    let leaf = prop_oneof![
        Just(("x".to_owned(), 0.7)),
        Just(("y".to_owned(), -1.3)),
        Just(("t".to_owned(), 0.35)),
        (1..100u32).prop_map(|n| (format!("{}", f64::from(n) / 8.0), f64::from(n) / 8.0)),
    ];
    leaf.prop_recursive(6, 40, 3, |inner| {
        prop_oneof![
            (inner.clone(), inner.clone()).prop_map(|(a, b)| (format!("({} + {})", a.0, b.0), a.1 + b.1)),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| (format!("({} - {})", a.0, b.0), a.1 - b.1)),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| (format!("({} * {})", a.0, b.0), a.1 * b.1)),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| (format!("({} / {})", a.0, b.0), a.1 / b.1)),
            (inner.clone(), -2..3i32).prop_map(|(a, n)| (format!("({}^{n})", a.0), a.1.powf(n.into()))),
            (inner.clone(), inner.clone())
                .prop_map(|(a, b)| (format!("(abs({})^{})", a.0, b.0), a.1.abs().powf(b.1))),
            inner.clone().prop_map(|a| (format!("(-{})", a.0), -a.1)),
            inner.clone().prop_map(|a| (format!("sin({})", a.0), a.1.sin())),
            (inner.clone(), inner.clone(), inner.clone(), inner).prop_map(|(a, b, c, d)| {
                let value = if a.1 < b.1 && (a.1 >= 0.0 || d.1 >= 0.0) { c.1 } else { d.1 };
                let text = format!(
                    "if(({} < {}) and (not (({} < 0) and ({} < 0))), {}, {})",
                    a.0, b.0, a.0, d.0, c.0, d.0
                );
                (text, value)
            }),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn parentheses_say_what_is_meant((text, expected) in formulas()) {
        let (point, t) = (Point::new(0.7, -1.3), 0.35);
        prop_assume!(expected.is_finite() && expected.abs() < 1e100);
        let Ok(field) = Field::parse(&text, Names::XYT) else { return Ok(()) };
        let Ok(value) = field.value(point, t) else { return Ok(()) };
        prop_assert!((value - expected).abs() <= 1e-9 * expected.abs().max(1e-9), "{text}: {value}, {expected}");

        // The formula printed with few parentheses has the same value, to the bit.
        let of_place = text.replace('t', "0.35").replace("no0.35", "not");
        let Ok(field) = Field::parse(&of_place, Names::XY) else { return Ok(()) };
        let printed = &field.terms().expect("of place alone")[0].place;
        prop_assert_eq!(printed.value(point, 0.0), field.value(point, 0.0), "{}: {}", of_place, printed);
    }

    #[test]
    fn terms_sum_to_the_field((text, _) in formulas()) {
        let (point, t) = (Point::new(0.7, -1.3), 0.35);
        let Ok(field) = Field::parse(&text, Names::XYT) else { return Ok(()) };
        let (Ok(value), Some(terms)) = (field.value(point, t), field.terms()) else { return Ok(()) };
        let mut size = value.abs();
        let mut sum = 0.0;
        for term in terms {
            prop_assert!(!term.time.depends_on(Names::XY) && !term.place.depends_on(Names::T));
            let (Ok(g), Ok(h)) = (term.time.value(point, t), term.place.value(point, t)) else { return Ok(()) };
            size = size.max((g * h).abs());
            sum += g * h;
        }
        prop_assume!(size < 1e6);
        prop_assert!((sum - value).abs() <= 1e-7 * size.max(1.0), "{text}: {sum}, {value}");
    }

    #[test]
    fn any_text_is_read_or_refused(text in ".{0,60}") {
        let _ = Field::parse(&text, Names::XYT);
        let _ = Table::from_csv(&text, "any.csv", Interpolation::Spline);
    }

    #[test]
    fn any_tokens_are_read_or_refused(tokens in prop::collection::vec(
        prop::sample::select(vec![
            "x", "y", "t", "pi", "1", "2.5e-1", ".", "e", "+", "-", "*", "/", "^", "(", ")", ",", "<", ">=", "==",
            "=", "and", "or", "not", "if(", "sin(", "min(", "clamp(", " ", "é", "²", "!", "0",
        ]), 0..25,
    )) {
        let text = tokens.concat();
        if let Ok(field) = Field::parse(&text, Names::XYT) {
            let _ = field.jet(Point::new(0.0, 1.0), -1.0);
            let _ = field.terms();
        }
        let _ = Condition::parse(&text, Names::XYT, Parameters::NONE);
    }
}

#[test]
fn a_spline_is_scipy_s() {
    let reference = &reference()["spline"];
    let rows = numbers(&reference["times"]).into_iter().zip(numbers(&reference["values"]));
    let csv: String = rows.clone().map(|(time, value)| format!("{time},{value}\n")).collect();
    let table = Table::from_csv(&csv, "spline.csv", Interpolation::Spline).expect("a table");
    for (time, value) in rows {
        assert_eq!(table.value(time), value);
    }
    for (t, expected) in
        numbers(&reference["at"]).into_iter().zip(reference["jets"].as_array().expect("jets"))
    {
        let jet = table.jet(t);
        for (found, expected) in [jet.value, jet.first, jet.second].into_iter().zip(numbers(expected)) {
            assert_close(found, expected, 1e-12, &format!("t = {t}"));
        }
    }
}

#[test]
fn a_linear_table_holds_its_ends() {
    let csv = "\u{feff}# bench 3\n\"time, s\",pressure\r\n\n0, 10 # start\r\n1,20\n3,16\n";
    let table = Table::from_csv(csv, "load.csv", Interpolation::Linear).expect("a table");
    for (t, value, slope) in [(-1.0, 10.0, 0.0), (0.0, 10.0, 10.0), (0.5, 15.0, 10.0), (1.0, 20.0, -2.0)] {
        assert_eq!(table.jet(t), Derivatives { value, first: slope, second: 0.0 });
    }
    assert_eq!([table.value(2.0), table.value(3.0), table.value(9.0)], [18.0, 16.0, 16.0]);
    assert_eq!(table.jet(3.0), Derivatives { value: 16.0, first: 0.0, second: 0.0 });
}

#[test]
fn faults_of_tables_name_the_line() {
    let expected = "expected a time in s and a value, separated by a comma";
    for (csv, wrong) in [
        ("", "1: the table ends after 0 rows; expected at least 2".to_owned()),
        ("t,p\n0,1\n", "2: the table ends after 1 rows; expected at least 2".to_owned()),
        ("0,1\n1;2\n", format!("2: found 1;2; {expected}, such as 1,2")),
        ("t;p\n0,5;1,25\n", format!("2: found 0,5;1,25; {expected}, such as 0.5,1.25")),
        ("0,1\n0,5,1,25\n", format!("2: found 0,5,1,25; {expected}; a decimal point is written .")),
        ("0,1\n1,1,5\n", format!("2: found 1,1,5; {expected}; a decimal point is written .")),
        ("0,1\n1,2,3\n", format!("2: found 1,2,3; {expected}; a decimal point is written .")),
        ("0,1\n1,inf\n", format!("2: \"inf\" is not a finite number; {expected}")),
        ("0,1\nt,p\n", format!("2: \"t\" is not a finite number; {expected}")),
        (
            "0,1\n\n1,2\n1.0,3\n",
            "4: time 1.0 is not after 1.0 of line 3; expected ascending times".to_owned(),
        ),
        ("0,-1e308\n1e-9,1e308\n", "2: the slope to this row is not a finite number".to_owned()),
    ] {
        let error = Table::from_csv(csv, "load.csv", Interpolation::Linear).expect_err(csv);
        assert_eq!(error.to_string(), format!("load.csv:{wrong}"));
        assert_eq!(error.exit_code(), 2);
    }
    let error = Table::read("no/such.csv".as_ref(), Interpolation::Linear).unwrap_err();
    assert_eq!(error.exit_code(), 4);
}

/// Returns a formula of x, y and t with every operation, nested `depth` times. It is added to
/// `parts` after its own parts.
fn any_formula(random: &mut Random, depth: usize, parts: &mut Vec<Field>) -> String {
    fn pick<'a>(random: &mut Random, words: &[&'a str]) -> &'a str {
        words[random.below(words.len())]
    }
    let mut part = |random: &mut Random| any_formula(random, depth - 1, parts);
    let text = match random.below(if depth == 0 { 3 } else { 24 }) {
        0 => pick(random, &["0", "1", "2", "0.3", "0.5", "-0.7", "3"]).into(),
        1 | 2 => pick(random, &["x", "y", "t"]).into(),
        3..12 => {
            let trigonometric = ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"];
            let others = ["exp", "ln", "log10", "sqrt", "abs", "sign", "floor", "ceil", "round", "step", "-"];
            let function = pick(random, &[&trigonometric[..], &others].concat());
            format!("({function}({}))", part(random))
        }
        12..15 => {
            let n = pick(random, &["2", "3", "4", "0", "1", "-1", "-2", "0.5", "1.5", "-0.5"]);
            format!("({})^({n})", part(random))
        }
        15..19 => {
            let op = pick(random, &["+", "-", "*", "/", "^"]);
            format!("(({}) {op} ({}))", part(random), part(random))
        }
        19..22 => {
            let function = pick(random, &["min", "max", "hypot", "atan2", "mod"]);
            format!("{function}({}, {})", part(random), part(random))
        }
        _ => {
            let relation = pick(random, &["<", "<=", ">", ">=", "==", "!="]);
            let join = pick(random, &["and", "or", "and not"]);
            let [a, b, yes, no] = [(); 4].map(|()| part(random));
            format!("if({a} {relation} {b} {join} x > 0.4, {yes}, {no})")
        }
    };
    parts.extend(Field::parse(&text, Names::XYT));
    text
}

#[test]
fn bounds_hold_at_every_point() {
    let mut random = Random::new(7);
    let (mut values, mut slopes) = (0, 0);
    for _ in 0..20_000 {
        let mut parts = Vec::new();
        let text = any_formula(&mut random, 4, &mut parts);
        let Ok(field) = Field::parse(&text, Names::XYT) else { continue };
        let starts: [f64; 3] = std::array::from_fn(|_| (10.0 * random.signed()).round() / 10.0);
        let sizes: [f64; 3] = std::array::from_fn(|_| [0.0, 1e-6, 1e-3, 0.1, 0.1, 0.5, 2.0][random.below(7)]);
        let at = |shares: [f64; 3]| -> (Point, f64) {
            let [x, y, t] = std::array::from_fn(|k| starts[k] + shares[k] * sizes[k]);
            (Point::new(x, y), t)
        };
        let ((low, from), (high, to)) = (at([0.0; 3]), at([1.0; 3]));
        let bounds = field.enclose(low, high, Interval { low: from, high: to });
        let in_time = field.range(low, from, to);
        // Bounds over a rectangle hold except on lines, where two numbers may be equal.
        let has_equality = text.contains("==") || text.contains("!=");
        let assert_holds = |bounds: Interval, value: f64, (place, t): (Point, f64)| {
            let slack = 1e-9 * (1.0 + value.abs());
            let holds = bounds.low - slack <= value && value <= bounds.high + slack;
            assert!(holds, "{text} at {place}, t = {t:?}: {value:?}, expected in {bounds:?}");
        };
        for _ in 0..30 {
            let is_corner = random.below(2) == 0;
            let share = |_| if is_corner { random.below(2) as f64 } else { random.unit() };
            let (place, t) = at(std::array::from_fn(share));
            let is_finite = |place: Point| parts.iter().all(|part| part.value(place, t).is_ok());
            if let Ok(value) = field.value(low, t)
                && is_finite(low)
            {
                assert_holds(in_time, value, (low, t));
            }
            let Ok(value) = field.value(place, t) else { continue };
            if has_equality || !is_finite(place) {
                continue;
            }
            assert_holds(bounds.value, value, (place, t));
            values += usize::from(bounds.value.magnitude().is_finite());
            if let Ok([_, gradient @ ..]) = field.gradient(place, t)
                && !is_corner
                && !bounds.jumps()
            {
                slopes += 1;
                (0..2).for_each(|k| {
                    assert_holds(bounds.slope[k], 0.5 * sizes[k] * gradient[k], (place, t));
                });
            }
        }
    }
    assert!(values > 100_000 && slopes > 50_000, "{values} values, {slopes} slopes");
}
