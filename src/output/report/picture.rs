//! Pictures of `rebond plot` and of sweeps and studies inside the page.

use super::html::{escaped, section};
use crate::output::plot;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use std::path::Path;

/// Dots per inch of a picture whose SVG is too long for the page.
const DOTS_PER_INCH: f32 = 200.0;
/// Largest size of such a picture as PNG, in bytes.
const MOST_PNG_BYTES: usize = 300_000;

/// Names of the pictures of sweeps and studies, or their beginnings, with what they show.
const CAPTIONS: [(&str, &str); 12] = [
    ("bifurcation", "Values once per period, over the swept key"),
    ("response", "Response over the swept key"),
    ("map", "Measures over the two swept keys"),
    ("parallel", "Runs as lines from key to key and to their measures"),
    ("histograms", "Numbers of runs by their measures"),
    ("distributions", "Shares of the runs up to each value of their measures"),
    ("sensitivities", "Shares of the variance of measures that each key causes, first order and total"),
    ("work-precision", "Errors against seconds"),
    ("orders", "Errors against the time step"),
    ("energy-drift", "Change of the energy against the time step"),
    ("after-impact", "Errors and energy after the first impact"),
    ("cost", "Cost of a run"),
];

/// Returns what a picture shows, for readers and screen readers; pictures of studies have the name
/// of a mesh at their end.
fn caption(name: &str) -> String {
    let captions = CAPTIONS.iter().chain(&plot::PICTURES);
    match captions.into_iter().find_map(|(word, text)| Some((name.strip_prefix(word)?, text))) {
        Some(("", text)) => (*text).to_owned(),
        Some((mesh, text)) => format!("{text}, {}", mesh.trim_start_matches('-').replace('-', " ")),
        None => name.replace('-', " "),
    }
}

/// Returns the section of pictures, given by the names of their files in `plots/` and their texts
/// as SVG: the first ones, up to `most` bytes, others as PNG where that is small, and the names of
/// the rest. `open` and `close` are the tags around them, `remedy` tells where the rest is.
pub(super) fn pictures<'p>(
    pictures: impl IntoIterator<Item = &'p (String, String)>,
    most: usize,
    [open, close]: [&str; 2],
    remedy: &str,
) -> String {
    let (mut html, mut left_out, mut length) = (String::new(), Vec::new(), 0);
    for (name, svg) in pictures {
        let short = compact(svg, name);
        let drawn = if length + short.len() <= most {
            length += short.len();
            Some(short)
        } else {
            as_png(svg, name)
        };
        match drawn {
            Some(drawn) => html += &figure(&drawn, &format!("{} (plots/{name}.svg)", caption(name))),
            None => left_out.push(format!("plots/{name}.svg")),
        }
    }
    if !left_out.is_empty() {
        let names = escaped(&left_out.join(", "));
        html += &format!("<p class=\"soft\">Left out for their size{remedy}: {names}.</p>\n");
    }
    section("pictures", "", "Pictures", &format!("{open}{html}{close}"))
}

/// Renders a picture, given as SVG, for the page; `None` where it is too large.
fn as_png(svg: &str, name: &str) -> Option<String> {
    let png = plot::png(svg, DOTS_PER_INCH, Path::new(name)).ok()?;
    let tag = || format!("<img alt=\"\" src=\"data:image/png;base64,{}\">", STANDARD.encode(&png));
    (png.len() <= MOST_PNG_BYTES).then(tag)
}

/// Returns a picture, as SVG or as an image, with its caption.
pub(super) fn figure(svg: &str, caption: &str) -> String {
    let caption = escaped(caption);
    format!(
        "<figure><div class=\"picture\" role=\"img\" aria-label=\"{caption}\">{svg}</div>\
         <figcaption>{caption}</figcaption></figure>\n"
    )
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
