//! Sections of the page as HTML.

use super::frames::Frames;
use super::scene_text::set_keys;
use super::sentence;
use crate::output::answers::{self, KeyFigure};
use crate::output::contacts::Contact;
use crate::output::plot;
use crate::output::run_folder::RunFolder;
use crate::output::text::{engineering, grouped, prefix, quoted, raised, significant, two_digits, typeset};
use crate::scene::unit;
use serde_json::Value;

/// Largest number of supports with cards of their own.
const MOST_SUPPORTS: usize = 2;
/// Largest number of contacts in the table.
const MOST_CONTACTS: usize = 400;
/// Parts of a scene that the page tells in its first section, with their titles.
const PARTS: [(&str, &str); 18] = [
    ("parameters", "Parameters"),
    ("plate", "Plate"),
    ("part", "Parts"),
    ("mesh", "Mesh"),
    ("support", "Supports"),
    ("obstacle", "Obstacles"),
    ("foundation", "Foundations"),
    ("spring", "Springs"),
    ("mass", "Masses"),
    ("rib", "Ribs"),
    ("ball", "Balls"),
    ("load", "Loads"),
    ("initial", "Start"),
    ("damping", "Damping"),
    ("time", "Time"),
    ("solver", "Solver"),
    ("sweep", "Sweep"),
    ("study", "Study"),
];

/// Escapes a text for HTML and its attributes.
pub(super) fn escaped(text: &str) -> String {
    plot::escaped(text).replace('"', "&quot;")
}

/// Returns a section of the page with its heading, which has the name `h-` and the section's.
pub(super) fn section(id: &str, class: &str, heading: &str, body: &str) -> String {
    let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
    format!("<section{class} aria-labelledby=\"h-{id}\"><h2 id=\"h-{id}\">{heading}</h2>\n{body}</section>\n")
}

/// Returns a table that its heads sort, in the section of a name.
pub(super) fn sortable(id: &str, heads: &str, rows: &str) -> String {
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-labelledby=\"h-{id}\"><table class=\"sortable\">\
         <thead><tr>{heads}</tr></thead><tbody>\n{rows}</tbody></table></div>"
    )
}

/// Returns the title of a run, and one sentence of what its plate is.
pub(super) fn head(summary: &Value, frames: Option<&Frames>) -> String {
    let scene = &summary["scene"];
    let title = scene["title"].as_str().filter(|title| !title.is_empty()).unwrap_or("Run of rebond");
    let plate = plate(scene, frames.map(|frames| frames.extent().1));
    let warned = count_of_warnings(summary).map_or_else(String::new, |count| {
        format!("<p class=\"warning\"><a href=\"#warnings\">{count}</a></p>\n")
    });
    header(title, &format!("<p class=\"plate\">{plate}.</p>\n{warned}{}", state(summary)))
}

/// Returns the number of warnings of a run in words; `None` where there is none.
fn count_of_warnings(summary: &Value) -> Option<String> {
    match texts(&summary["warnings"]).count() {
        0 => None,
        1 => Some("1 warning".into()),
        count => Some(format!("{count} warnings")),
    }
}

/// Returns the head of a page with its title and what stands below, up to the beginning of its main
/// part.
pub(super) fn header(title: &str, below: &str) -> String {
    let print = "<button type=\"button\" id=\"print\" class=\"live\">Print</button>";
    format!("<header><h1>{}</h1>\n{below}{print}</header>\n<main>\n", escaped(title))
}

/// Returns one sentence of what the plate of a resolved scene is, without a full stop; `extent`
/// (m) is the size of a mesh from a file, where it is known.
pub(super) fn plate(scene: &Value, extent: Option<[f64; 2]>) -> String {
    escaped(&typeset(&sentence::sentence(scene, extent)))
}

/// Returns why a run ended early, if it did.
pub(super) fn state(summary: &Value) -> String {
    match summary["status"].as_str().unwrap_or("unknown") {
        "done" => String::new(),
        status => format!("<p class=\"warning\">Ended early: {}</p>\n", escaped(status)),
    }
}

/// Returns the answers of a run and its warnings. Many supports share a card, with a line each that
/// opens on demand; warnings share a box of limited height.
pub(super) fn answers(summary: &Value) -> String {
    let card = |KeyFigure { title, text, .. }: KeyFigure| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escaped(&title), escaped(&typeset(&text)))
    };
    let line = |KeyFigure { title, text, .. }: KeyFigure| {
        let (title, text) = (escaped(&title), escaped(&typeset(&text)));
        let (peak, more) = text.split_once(", ").unwrap_or((&text, ""));
        format!("<dd><details><summary>{title}: {peak}</summary>{more}</details></dd>\n")
    };
    let (held, others): (Vec<_>, Vec<_>) =
        answers::answers(summary).into_iter().partition(|answer| answer.is_support);
    let mut cards: String = others.into_iter().map(card).collect();
    cards += &match held.len() > MOST_SUPPORTS {
        true => format!("<div><dt>supports</dt>\n{}</div>\n", held.into_iter().map(line).collect::<String>()),
        false => held.into_iter().map(card).collect(),
    };
    let mut warnings = warnings(summary);
    if let Some(count) = count_of_warnings(summary) {
        let role = "id=\"warnings\" tabindex=\"0\" role=\"region\" aria-label=\"Warnings\"";
        warnings = format!("<div class=\"scroll warnings\" {role}><b>{count}</b>\n{warnings}</div>\n");
    }
    section("answers", "", "Answers", &format!("<dl class=\"numbers answers\">\n{cards}</dl>\n{warnings}"))
}

/// Returns the warnings of a run.
pub(super) fn warnings(summary: &Value) -> String {
    let warning = |text| format!("<p class=\"warning\">Warning: {}</p>\n", escaped(text));
    let warnings: String = texts(&summary["warnings"]).map(warning).collect();
    if warnings.is_empty() && summary["status"] == "done" {
        return "<p class=\"soft\">The run gave no warnings.</p>\n".into();
    }
    warnings
}

/// Returns the effects and the parts of the scene of a run, folded; `file` is the scene's file.
pub(super) fn scene(summary: &Value, file: &str) -> String {
    let effects: String =
        texts(&summary["effects"]).map(|effect| format!("<li>{}</li>", escaped(effect))).collect();
    let effects = match effects.is_empty() {
        true => "<p>No effects: the plate vibrates freely.</p>\n".to_owned(),
        false => format!("<ul class=\"effects\" aria-label=\"Effects that are on\">{effects}</ul>\n"),
    };
    folded("scene", "The scene", &(effects + &parts(&summary["scene"], file)))
}

/// Returns a section of the page that opens on demand.
fn folded(id: &str, heading: &str, body: &str) -> String {
    format!(
        "<details class=\"folded\"><summary><h2 id=\"h-{id}\">{heading}</h2></summary>\n\
         <section aria-labelledby=\"h-{id}\">{body}</section></details>\n"
    )
}

/// Returns the parts of a resolved scene that somebody set, and folded all of them; `file` is the
/// file of the scene.
pub(super) fn parts(scene: &Value, file: &str) -> String {
    let (set, every) = (list_of_parts(&set_keys(scene, file)), list_of_parts(scene));
    if set == every {
        return every;
    }
    format!("{set}<details><summary>Every key, with the values filled in</summary>\n{every}</details>\n")
}

/// Returns the parts of a scene with all of its keys.
fn list_of_parts(scene: &Value) -> String {
    let mut html = String::from("<dl class=\"scene\">\n");
    for (key, title) in PARTS {
        let words = described(&scene[key], key);
        if !words.is_empty() {
            html += &format!("<dt>{title}</dt><dd>{}</dd>\n", escaped(&words));
        }
    }
    // Further tables, such as springs, keep their own names.
    let is_part =
        |key: &str| PARTS.iter().any(|(part, _)| *part == key) || ["title", "output"].contains(&key);
    for (key, value) in scene.as_object().into_iter().flatten().filter(|(key, _)| !is_part(key)) {
        let words = described(value, key);
        html += &format!("<dt>{}</dt><dd>{}</dd>\n", escaped(&key.replace('_', " ")), escaped(&words));
    }
    html + "</dl>\n"
}

fn texts(list: &Value) -> impl Iterator<Item = &str> {
    list.as_array().into_iter().flatten().filter_map(Value::as_str)
}

/// Returns the value of a key of a scene in words; several tables are separated by semicolons.
pub(super) fn described(value: &Value, key: &str) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), significant),
        Value::Bool(yes) => if *yes { "yes" } else { "no" }.to_owned(),
        Value::Array(list) if list.iter().any(Value::is_object) => {
            list.iter().map(|item| described(item, key)).collect::<Vec<_>>().join("; ")
        }
        Value::Array(list) => {
            format!("({})", list.iter().map(|item| described(item, key)).collect::<Vec<_>>().join(", "))
        }
        Value::Object(table) => {
            let part = |(name, value): (&String, &Value)| {
                let key = format!("{key}.{name}");
                format!("{} {}{}", name.replace('_', " "), described(value, &key), unit_of(value, &key))
            };
            table.iter().map(part).collect::<Vec<_>>().join(", ")
        }
    }
}

/// Returns the unit of the value of a key behind a space; none where it is no number.
pub(super) fn unit_of(value: &Value, key: &str) -> String {
    let unit = unit(key).filter(|_| value.is_number()).map(|unit| format!(" {unit}"));
    raised(&unit.unwrap_or_default())
}

/// Returns how the answers of a run were computed, folded.
pub(super) fn numbers(summary: &Value) -> String {
    let mut cards = String::new();
    let mut card = |title: &str, value: Option<String>| {
        let Some(value) = value else { return };
        cards += &format!("<div><dt>{title}</dt><dd>{}</dd></div>\n", escaped(&value));
    };
    let count = |key: &str| summary[key].as_u64().map(grouped);
    let digits = |key: &str| summary[key].as_f64().map(two_digits);
    let seconds = |key: &str| Some(typeset(&engineering(summary["seconds"][key].as_f64()?, "s")));
    let touches = summary["first_impact"].is_object();
    card("degrees of freedom", count("dofs"));
    card("steps", count("steps"));
    card("steps in contact", count("contact_steps").filter(|_| summary["bounded_dofs"] != 0));
    card("most nodes in contact", count("most_contact_nodes").filter(|_| touches));
    card("contacts of nodes", count("node_contacts").filter(|_| touches));
    card("factorisations", count("factorisations"));
    card("steps solved again", count("retries"));
    card("worst KKT residual", digits("worst_kkt"));
    card(
        "worst penetration",
        digits("worst_penetration").filter(|_| touches).map(|digits| digits + "\u{a0}m"),
    );
    card("set-up", seconds("assembly"));
    card("all steps", seconds("stepping"));
    card("program", summary["version"].as_str().map(|version| format!("rebond {version}")));
    folded("numbers", "Numerics", &format!("<dl class=\"numbers\">\n{cards}</dl>\n"))
}

/// Returns the view of the moving plate, or how to get one; `colors` describes its quantities.
pub(super) fn view(run: &RunFolder, frames: Option<&Frames>, colors: &Value) -> String {
    let Some(frames) = frames else {
        let steps = run.summary["steps"].as_u64().unwrap_or(0);
        let [file, folder] =
            [run.scene_file(), run.folder.to_string_lossy().into()].map(|path| quoted(&path));
        let command = format!(
            "rebond run {file} --set output.fields_every={} --out {folder} --overwrite",
            (steps / 300).max(1)
        );
        let words = format!(
            "<p>This run wrote no snapshots, so that there is no moving view. <code>{}</code> writes about 300 of them.</p>",
            escaped(&command)
        );
        return section("motion", "", "The motion", &words);
    };
    let (shown, count) = (frames.times.len(), frames.snapshots);
    let mut note = match shown == count {
        true => format!("All {count} snapshots of the run"),
        false => format!("{shown} of the {count} snapshots of the run"),
    };
    if frames.points() < frames.points_of_snapshot {
        note += &format!(", at {} of their {} points", frames.points(), frames.points_of_snapshot);
    }
    for color in colors.as_array().into_iter().flatten() {
        let Some(quantum) = color["quantum"].as_f64() else { continue };
        let [label, unit] = ["label", "unit"].map(|key| color[key].as_str().unwrap_or_default());
        note += &typeset(&format!(", {label} in steps of {}", engineering(quantum, unit)));
    }
    let words =
        format!("{VIEW}<p class=\"soft\">{note}; between snapshots the page interpolates. {LEGEND}</p>");
    section("motion", "live", "The motion", &words)
}

/// Returns what is said where the moving parts cannot be shown.
pub(super) fn trouble() -> &'static str {
    "<p id=\"trouble\" class=\"warning\" role=\"alert\" hidden></p>\n\
     <noscript><p class=\"warning\">Without JavaScript the page shows still pictures only.</p></noscript>\n"
}

const LEGEND: &str = "Orange points are in contact, thick dark edges, dots and discs do not move, grey surfaces and pegs are obstacles, white \
    ones lie behind the plate. \
    Drag to turn, pinch to zoom, also by the wheel after a click on the view; keys: arrows turn, + and − zoom, Home \
    resets, space plays, comma and full stop go to the snapshot before and after.";

const VIEW: &str = include_str!("page/view.html");

/// Returns the place of the charts of a run, with a note on the rows left out and links to its
/// files.
pub(super) fn charts(shown: usize, rows: usize, files: &[String]) -> String {
    let note = match shown == rows {
        true => format!("All {} rows of history.csv.", grouped(rows as u64)),
        false => format!(
            "{} of the {} rows of history.csv: among neighbours those with the least and greatest value of a curve.",
            grouped(shown as u64),
            grouped(rows as u64)
        ),
    };
    let links: Vec<String> =
        files.iter().map(|file| format!("<a href=\"{file}\">{file}</a>", file = escaped(file))).collect();
    charts_with(&format!(
        "{note} Drag across a chart to zoom all of them, click to show that instant above. \
         All numbers: {}.",
        links.join(", ")
    ))
}

/// Returns the place of the charts with a note.
pub(super) fn charts_with(note: &str) -> String {
    let words = format!(
        "<div id=\"charts\"></div>\n<p><button type=\"button\" id=\"all\">Show all times</button></p>\n\
         <p class=\"soft\">{note}</p>"
    );
    section("series", "live", "Over time", &words)
}

/// Returns the section of natural modes with their picture.
pub(super) fn modes(figure: &str) -> String {
    let words = "<p class=\"soft\">Of the plate as it is before anything touches, with the consistent mass; \
        <code>rebond modes</code> has more of them, and files for ParaView.</p>\n";
    section("modes", "", "Natural modes", &format!("{figure}{words}"))
}

/// Returns how to get natural modes where the page has none.
pub(super) fn no_modes() -> String {
    let words = "<p>The page computes the natural modes of small plates only, whose files are where they were; \
        <code>rebond modes scene.toml</code> draws them, and writes them for ParaView.</p>\n";
    section("modes", "", "Natural modes", words)
}

/// Returns the table of contacts; `None` is for a scene without obstacles.
pub(super) fn contacts(contacts: Option<&[Contact]>) -> String {
    let body = match contacts {
        None => "<p>The scene has neither obstacles nor balls.</p>".to_owned(),
        Some([]) => "<p>Nothing touched.</p>".to_owned(),
        Some(contacts) => contact_table(contacts),
    };
    section("contacts", "", "Contacts of nodes", &body)
}

fn contact_table(contacts: &[Contact]) -> String {
    let cut = match contacts.len() > MOST_CONTACTS {
        true => format!(
            "<p>The first {MOST_CONTACTS} of {} contacts of nodes; contacts.csv has the others.</p>\n",
            grouped(contacts.len() as u64)
        ),
        false => String::new(),
    };
    let largest = |value: &dyn Fn(&Contact) -> f64| {
        prefix(contacts.iter().map(value).fold(0.0, |largest: f64, value| largest.max(value.abs())))
    };
    let times = largest(&|contact| contact.end);
    let lengths = largest(&|contact| contact.at[0].abs().max(contact.at[1].abs()));
    let impulses = largest(&|contact| contact.impulse);
    let head = |(name, (_, prefix), unit): (&str, (f64, &str), &str)| {
        format!("<th scope=\"col\">{name} ({}{unit})</th>", prefix.replace('u', "\u{b5}"))
    };
    let [begin, end] = ["begin", "end"].map(|name| head((name, times, "s")));
    let [x, y] = ["x", "y"].map(|name| head((name, lengths, "m")));
    let impulse = head(("impulse", impulses, "N s"));
    let heads = [begin, end, "<th scope=\"col\">node</th>".into(), x, y, impulse].concat();
    let cell = |value: f64, (scale, _): (f64, &str)| {
        format!("<td data-v=\"{value}\">{}</td>", significant(value / scale))
    };
    let row = |&Contact { node, at: [x, y], begin, end, impulse }: &Contact| {
        let time = significant(begin / times.0);
        let [x, y] = [x, y].map(|x| cell(x, lengths));
        let (end, impulse) = (cell(end, times), cell(impulse, impulses));
        format!(
            "<tr><td data-v=\"{begin}\"><a href=\"#t={begin}\">{time}</a></td>{end}<td>{node}</td>{x}{y}{impulse}</tr>\n"
        )
    };
    let rows: String = contacts.iter().take(MOST_CONTACTS).map(row).collect();
    cut + &sortable("contacts", &heads, &rows)
}

/// Returns the resolved scene and how to run it again.
pub(super) fn again(summary: &Value, scene: &str) -> String {
    let version = summary["version"].as_str().unwrap_or_default();
    let hash = summary["scene_hash"].as_str().unwrap_or_default();
    let commands = "rebond run scene.toml --out runs/again\nrebond report runs/again";
    again_by(commands, [version, hash], &summary["scene"], scene)
}

/// Returns a scene as text and the commands that run it again, with the version of the program
/// and the hash of the scene.
pub(super) fn again_by(commands: &str, [version, hash]: [&str; 2], resolved: &Value, scene: &str) -> String {
    let mut files = Vec::new();
    named_files(resolved, &mut files);
    let beside = match files.is_empty() {
        true => String::new(),
        false => {
            format!(" (it names other files, which must be at their places: {})", escaped(&files.join(", ")))
        }
    };
    let [version, hash, commands] = [version, hash, commands].map(escaped);
    let words = format!(
        "<p>The scene below has every default filled in (rebond {version}, scene {hash}). Save it as \
         <code>scene.toml</code>{beside}, and run:</p>\n\
         <pre>{commands}</pre>\n\
         <p class=\"live\"><button type=\"button\" id=\"save\">Save scene.toml</button></p>\n\
         <details><summary>The resolved scene</summary><pre id=\"scene-text\">{}</pre></details>",
        escaped(scene)
    );
    section("again", "", "How to run it again", &words)
}

/// Collects the names of meshes and tables in a scene.
fn named_files(value: &Value, files: &mut Vec<String>) {
    match value {
        Value::Object(table) => {
            for (key, value) in table {
                let file = value.as_str().filter(|_| ["file", "table", "from"].contains(&key.as_str()));
                match file {
                    Some(file) => files.push(file.to_owned()),
                    None => named_files(value, files),
                }
            }
        }
        Value::Array(list) => list.iter().for_each(|value| named_files(value, files)),
        _ => {}
    }
}
