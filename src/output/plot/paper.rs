//! Canvas with the few primitives that plots need, rendered as SVG and from there as PNG.
//!
//! Lengths are in points (1/72 inch), with y downwards.

use crate::error::{Error, Result};
use png::{BitDepth, ColorType, DeflateCompression, Encoder, Filter, PixelDimensions, Unit};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};
use std::fmt::Write;
use std::io;
use std::path::Path;
use std::sync::{Arc, LazyLock};

/// Position in points.
pub(super) type At = [f64; 2];

/// Points per millimetre.
const POINTS_PER_MM: f64 = 72.0 / 25.4;
/// Limit on coordinates, far outside any figure.
const FAR: f64 = 1e4;

/// Font by which texts are measured and rasterised, which is part of the program.
///
/// Programs that show the SVG without this font take one that is no wider.
const FONTS: &str = "DejaVu Sans, Verdana, Helvetica, Arial, sans-serif";

static FACE: LazyLock<Option<ttf_parser::Face<'static>>> =
    LazyLock::new(|| ttf_parser::Face::parse(dejavu::sans::regular(), 0).ok());

static FONT_DATABASE: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    for font in [dejavu::sans::regular(), dejavu::sans::bold()] {
        fonts.load_font_source(fontdb::Source::Binary(Arc::new(font)));
    }
    Arc::new(fonts)
});

/// Colour, written as `#RRGGBB`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

impl Color {
    /// Black.
    pub const BLACK: Color = Color(0, 0, 0);
    /// White, the background.
    pub const WHITE: Color = Color(255, 255, 255);
    /// Grey of rules and remarks.
    pub const GREY: Color = Color(110, 110, 110);
    /// Light grey of solid bodies.
    pub const SHADE: Color = Color(222, 222, 222);

    /// Mixes the colour with a `share` of another.
    pub fn towards(self, other: Color, share: f64) -> Color {
        let mix = |a: u8, b: u8| {
            (f64::from(a) + share.clamp(0.0, 1.0) * (f64::from(b) - f64::from(a))).round() as u8
        };
        Color(mix(self.0, other.0), mix(self.1, other.1), mix(self.2, other.2))
    }
}

/// Interpolates between colours at a share from 0 to 1.
pub(super) fn blend(stops: &[Color], share: f64) -> Color {
    let place = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
    let first = (place as usize).min(stops.len().saturating_sub(2));
    stops[first].towards(stops[(first + 1).min(stops.len() - 1)], place - first as f64)
}

impl std::fmt::Display for Color {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "#{:02X}{:02X}{:02X}", self.0, self.1, self.2)
    }
}

/// Pen for lines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pen {
    /// Colour of the line.
    pub color: Color,
    /// Lengths drawn and skipped in turn, in points; empty for a solid line.
    pub dashes: &'static [f64],
    /// Width of the line, in points.
    pub width: f64,
}

impl Pen {
    /// Creates a pen for solid lines.
    pub const fn solid(color: Color, width: f64) -> Pen {
        Pen { color, dashes: &[], width }
    }
}

/// Part of a text that stands at its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// Type of a text: size and appearance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Type {
    pub size: f64,
    pub bold: bool,
    pub color: Color,
    /// Whether a halo separates the text from its background.
    pub halo: bool,
}

impl Type {
    pub const fn new(size: f64) -> Type {
        Type { size, bold: false, color: Color::BLACK, halo: false }
    }

    /// Returns the width of a text, in points.
    pub fn width(&self, text: &str) -> f64 {
        let Some(face) = &*FACE else { return 0.6 * self.size * text.chars().count() as f64 };
        let advance = |c| face.glyph_index(c).and_then(|glyph| face.glyph_hor_advance(glyph)).unwrap_or(600);
        let units: f64 = text.chars().map(|c| f64::from(advance(c))).sum();
        // Bold letters are about a tenth wider.
        let wider = if self.bold { 1.12 } else { 1.0 };
        wider * units * self.size / f64::from(face.units_per_em())
    }

    /// Returns the line spacing, in points.
    pub fn line(&self) -> f64 {
        1.35 * self.size
    }
}

/// Canvas.
pub struct Canvas {
    svg: String,
    clips: usize,
}

impl Canvas {
    pub(super) fn new() -> Canvas {
        Canvas { svg: String::new(), clips: 0 }
    }

    fn put(&mut self, element: std::fmt::Arguments) {
        self.svg.write_fmt(element).expect("a string takes everything");
        self.svg.push('\n');
    }

    pub(super) fn rectangle(&mut self, [left, top]: At, [right, bottom]: At, fill: Color) {
        let (width, height) = (number(right - left), number(bottom - top));
        let (x, y) = (number(left), number(top));
        self.put(format_args!(
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"{fill}\"/>"
        ));
    }

    pub(super) fn line(&mut self, [x1, y1]: At, [x2, y2]: At, pen: Pen) {
        let [x1, y1, x2, y2] = [x1, y1, x2, y2].map(number);
        let stroke = stroke(pen);
        self.put(format_args!("<line x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\" {stroke}/>"));
    }

    pub(super) fn polyline(&mut self, points: &[At], pen: Pen) {
        let (points, stroke) = (listed(points), stroke(pen));
        self.put(format_args!("<polyline fill=\"none\" {stroke} points=\"{points}\"/>"));
    }

    /// Draws a closed shape, filled and optionally outlined.
    pub(super) fn polygon(&mut self, points: &[At], fill: Color, edge: Option<Pen>) {
        let (points, stroke) = (listed(points), edge.map(stroke).unwrap_or_default());
        self.put(format_args!("<polygon fill=\"{fill}\" {stroke} points=\"{points}\"/>"));
    }

    pub(super) fn circle(&mut self, [x, y]: At, radius: f64, fill: Color, edge: Option<Pen>) {
        let (x, y, r, stroke) = (number(x), number(y), number(radius), edge.map(stroke).unwrap_or_default());
        self.put(format_args!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\" fill=\"{fill}\" {stroke}/>"));
    }

    /// Draws discs of one colour as one shape: ends of lines without length, which are round.
    ///
    /// A diagram of thousands of points is drawn several times faster than by circles, and its file
    /// is a quarter as long.
    pub(super) fn discs(&mut self, centres: &[At], radius: f64, color: Color) {
        let moves: String = centres.iter().map(|&[x, y]| format!("M{} {}h0", number(x), number(y))).collect();
        let width = number(2.0 * radius);
        self.put(format_args!(
            "<path fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linecap=\"round\" d=\"{moves}\"/>"
        ));
    }

    /// Draws a text whose middle height is at the position.
    pub(super) fn text(&mut self, text: &str, [x, y]: At, look: Type, anchor: Anchor) {
        let (x, y) = (number(x), number(y + 0.36 * look.size));
        self.write_text(text, &format!("x=\"{x}\" y=\"{y}\""), look, anchor);
    }

    /// Draws a centred text, rotated to read upwards.
    pub(super) fn text_upwards(&mut self, text: &str, [x, y]: At, look: Type) {
        let (x, y) = (number(x + 0.36 * look.size), number(y));
        self.write_text(text, &format!("transform=\"translate({x} {y}) rotate(-90)\""), look, Anchor::Middle);
    }

    fn write_text(
        &mut self,
        text: &str,
        place: &str,
        Type { size, bold, color, halo }: Type,
        anchor: Anchor,
    ) {
        let (size, text) = (number(size), escaped(&text.replace(char::is_control, "")));
        let anchor = format!("{anchor:?}").to_lowercase();
        let weight = if bold { " font-weight=\"bold\"" } else { "" };
        let halo = if halo { " stroke=\"#FFFFFF\" stroke-width=\"1.6\" paint-order=\"stroke\"" } else { "" };
        self.put(format_args!(
            "<text {place} font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{color}\"{weight}{halo}>{text}</text>"
        ));
    }

    /// Draws with a rectangle as clip path.
    pub(super) fn clipped(&mut self, [left, top]: At, [right, bottom]: At, draw: impl FnOnce(&mut Canvas)) {
        self.clips += 1;
        let id = self.clips;
        let [x, y, width, height] = [left, top, right - left, bottom - top].map(number);
        self.put(format_args!(
            "<clipPath id=\"clip{id}\"><path d=\"M{x} {y}h{width}v{height}h-{width}z\"/></clipPath>"
        ));
        self.put(format_args!("<g clip-path=\"url(#clip{id})\">"));
        draw(self);
        self.put(format_args!("</g>"));
    }

    /// Returns the drawing as an SVG of that size, on white.
    pub(super) fn finish(self, [width, height]: At) -> String {
        let millimetres = [width, height].map(|length| number(length / POINTS_PER_MM));
        let [width, height] = [width, height].map(number);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}mm\" height=\"{}mm\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"{FONTS}\" stroke-linejoin=\"round\" stroke-linecap=\"butt\">\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#FFFFFF\"/>\n{}</svg>\n",
            millimetres[0], millimetres[1], self.svg
        )
    }
}

/// Renders an SVG of [`Canvas`] as PNG with a number of dots per inch; `path` appears in errors.
pub(in crate::output) fn png(svg: &str, dots_per_inch: f32, path: &Path) -> Result<Vec<u8>> {
    // SVG has 96 pixels per inch.
    let (size, rgb) = rgb(svg, dots_per_inch / 96.0, path)?;
    let per_metre = (dots_per_inch / 0.0254).round() as u32;
    let mut bytes = Vec::new();
    let mut encoder = encoder(&mut bytes, size);
    encoder.set_pixel_dims(Some(PixelDimensions { xppu: per_metre, yppu: per_metre, unit: Unit::Meter }));
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&rgb));
    written.map_err(|why| failed(path, &why))?;
    Ok(bytes)
}

/// Returns an encoder of PNG for three bytes per pixel.
///
/// Most pixels of a figure are like their neighbours, which filters of PNG hide: without them files
/// are a fifth smaller, and a higher level than this gains 3 % more in twice the time.
pub(super) fn encoder(bytes: &mut Vec<u8>, [width, height]: [u32; 2]) -> Encoder<'static, &mut Vec<u8>> {
    let mut encoder = Encoder::new(bytes, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_deflate_compression(DeflateCompression::Level(4));
    encoder.set_filter(Filter::NoFilter);
    encoder
}

/// Renders an SVG of [`Canvas`] at `scale` times its size in pixels. Returns width and height and
/// three bytes per pixel, row by row.
pub(super) fn rgb(svg: &str, scale: f32, path: &Path) -> Result<([u32; 2], Vec<u8>)> {
    let options =
        Options { fontdb: FONT_DATABASE.clone(), font_family: "DejaVu Sans".into(), ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(|why| failed(path, &why))?;
    let size = tree.size();
    let size = [size.width(), size.height()].map(|length| (length * scale).round() as u32);
    let mut pixels =
        Pixmap::new(size[0], size[1]).ok_or_else(|| failed(path, &"the picture is too large"))?;
    // The last row and column may lie partly beyond the canvas.
    pixels.fill(resvg::tiny_skia::Color::WHITE);
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    // The canvas is opaque, so that colours need not be divided by their opacity.
    let rgb = pixels.data().chunks_exact(4).flat_map(|rgba| [rgba[0], rgba[1], rgba[2]]).collect();
    Ok((size, rgb))
}

fn failed(path: &Path, why: &dyn std::fmt::Display) -> Error {
    Error::io(path)(io::Error::other(why.to_string()))
}

fn stroke(Pen { color, dashes, width }: Pen) -> String {
    let mut stroke = format!("stroke=\"{color}\" stroke-width=\"{}\"", number(width));
    if !dashes.is_empty() {
        let dashes: Vec<String> = dashes.iter().map(|&dash| number(dash)).collect();
        stroke += &format!(" stroke-dasharray=\"{}\"", dashes.join(" "));
    }
    stroke
}

fn listed(points: &[At]) -> String {
    let pairs: Vec<String> = points.iter().map(|&[x, y]| format!("{},{}", number(x), number(y))).collect();
    pairs.join(" ")
}

/// Formats a coordinate to a hundredth of a point, as short as possible.
fn number(value: f64) -> String {
    let text = format!("{:.2}", value.clamp(-FAR, FAR));
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Escapes a text for XML, outside attributes.
pub(in crate::output) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
