//! Pictures of `rebond plot` inside the page.

/// Approximate limit on the length of all pictures, in bytes.
const MOST_BYTES: usize = 480_000;

/// Picture of a run as SVG, with the name of its file in `plots/`.
#[derive(Debug)]
pub struct InlinePicture {
    /// Name without extension.
    pub name: &'static str,
    /// Text of the file.
    pub svg: String,
}

impl InlinePicture {
    /// Returns what the picture shows, for readers and screen readers.
    fn caption(&self) -> &'static str {
        match self.name {
            "history" => "Probes, forces and energies over time",
            "energy" => "Energies, change of their sum, and force of the obstacles over time",
            "contacts" => "Contacts of nodes over time, and where they are on the plate",
            "forces" => "Force of named obstacles over the gap",
            "snapshots" => "Snapshots of the plate, coloured by deflection",
            "stresses" => "Snapshots of the plate, coloured by von Mises stress",
            "extremes" => "Largest von Mises stress of the run over the plate",
            "phase" => "Phase portraits of the probes",
            "spectrum" => "Spectra of the probes",
            _ => "Picture of the run",
        }
    }
}

/// Returns the pictures that fit in a page of moderate size, in order of importance, as HTML, and
/// the names of the others.
pub(super) fn figures(pictures: &[InlinePicture]) -> (String, Vec<&'static str>) {
    const ORDER: [&str; 9] =
        ["history", "snapshots", "contacts", "energy", "extremes", "forces", "spectrum", "stresses", "phase"];
    let (mut html, mut left_out) = (String::new(), Vec::new());
    for name in ORDER {
        let Some(picture) = pictures.iter().find(|picture| picture.name == name) else { continue };
        let (svg, caption) = (compact(&picture.svg, name), picture.caption());
        if html.len() + svg.len() > MOST_BYTES {
            left_out.push(name);
            continue;
        }
        html += &format!(
            "<figure><div class=\"picture\" role=\"img\" aria-label=\"{caption}\">{svg}</div>\
             <figcaption>{caption} (plots/{name}.svg)</figcaption></figure>\n"
        );
    }
    (html, left_out)
}

/// Shortens a picture and makes it fit to stand beside others: names of its own, coordinates to a
/// tenth of a point, a size given by the page.
pub(super) fn compact(svg: &str, name: &str) -> String {
    let svg = svg
        .replace(" xmlns=\"http://www.w3.org/2000/svg\"", "")
        .replace("id=\"clip", &format!("id=\"{name}-clip"))
        .replace("url(#clip", &format!("url(#{name}-clip"));
    let (head, body) = svg.split_once('>').unwrap_or((&svg, ""));
    let sized = |word: &&str| !word.starts_with("width=") && !word.starts_with("height=");
    let mut short: String = head.split(' ').filter(sized).collect::<Vec<_>>().join(" ");
    short.push('>');
    for line in body.lines() {
        let line = without_thin_stroke(line);
        match line.split_once(" points=\"") {
            Some((before, points)) => {
                short += before;
                short += " points=\"";
                rounded(points, &mut short);
            }
            None => short += &line,
        }
    }
    short
}

/// Removes the thin edge of a face, which the style of the page draws alike for all faces.
fn without_thin_stroke(line: &str) -> std::borrow::Cow<'_, str> {
    const THIN: &str = " stroke-width=\"0.15\"";
    match line.split_once(" stroke=\"#").and_then(|(before, rest)| Some((before, rest.split_once(THIN)?.1))) {
        Some((before, after)) => format!("{before}{after}").into(),
        None => line.into(),
    }
}

/// Appends a list of coordinates with one decimal each.
fn rounded(points: &str, short: &mut String) {
    let mut decimals = None;
    for c in points.chars() {
        decimals = match (decimals, c) {
            (_, '.') => Some(0),
            (Some(count), '0'..='9') => Some(count + 1),
            _ => None,
        };
        if decimals.is_none_or(|count| count < 2) {
            short.push(c);
        }
    }
}
