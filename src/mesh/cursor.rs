//! Cursor over the bytes of a file, which reads words of text or numbers of fixed width and reports
//! errors with their position.

use std::fmt::Display;
use std::path::Path;
use std::str::FromStr;

use crate::error::{Error, Result};

/// Encoding of numbers.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Words between white space.
    #[default]
    Text,
    /// Fixed width, lowest byte first.
    LittleEndian,
    /// Fixed width, highest byte first.
    BigEndian,
}

/// Files that are no meshes of Gmsh: their endings, their first bytes, what they are, and what to
/// do.
const FOREIGN: [(&str, &str, &str, &str); 19] = [
    ("geo", "Point(|//|SetFactory", "a script of Gmsh", MESHED),
    ("step|stp", "ISO-10303-21", "a geometry (STEP) without a mesh", MESHED),
    ("igs|iges", "", "a geometry (IGES) without a mesh", MESHED),
    ("brep", "DBRep_DrawableShape", "a geometry (BREP) without a mesh", MESHED),
    ("dxf", "", "a drawing (DXF) without a mesh", "save it as STEP in a CAD program, and mesh that in Gmsh"),
    ("stl", "solid", "a surface (STL) without a mesh of the plane", "mesh it in Gmsh, and save it as .msh"),
    ("vtk", "# vtk", "a grid of VTK", CONVERTED),
    ("vtu|xdmf|xml", "<?xml", "an XML file", CONVERTED),
    ("med", "", "a mesh of Salome (MED)", CONVERTED),
    ("su2", "NDIME", "a mesh of SU2", CONVERTED),
    ("mesh", "MeshVersionFormatted", "a mesh of Medit", CONVERTED),
    ("off", "OFF", "a surface (OFF)", CONVERTED),
    ("obj", "", "a surface (OBJ)", CONVERTED),
    ("unv", "", "a universal file of I-DEAS", "`gmsh -save {in} -o {out}` converts it"),
    ("cdb", "/COM|/PREP7", "an archive of Ansys", SAVED),
    ("k|key", "*KEYWORD", "an input file of LS-DYNA", SAVED),
    ("json", "{", "a JSON file", SAVED),
    ("", "*", "an input file of Abaqus or CalculiX", "its name should end in .inp"),
    ("", "SOL|BEGIN|GRID", "an input file of Nastran", "its name should end in .bdf, .nas or .dat"),
];
const MESHED: &str = "`gmsh -2 {in} -o {out}` makes its mesh";
const CONVERTED: &str = "`meshio convert {in} {out}` converts it";
const SAVED: &str = "save its mesh as .inp, .bdf or .msh";

/// Position in a file, which every read advances. The `expected` arguments say in error messages
/// what should stand there.
#[derive(Default)]
pub struct Cursor<'a> {
    file: &'a str,
    bytes: &'a [u8],
    at: usize,
    pub encoding: Encoding,
}

/// Reads a binary number of one type in the byte order of the file.
macro_rules! fixed_width {
    ($cursor:expr, $number:ty, $expected:expr) => {
        $cursor.bytes($expected).map(|bytes| match $cursor.encoding {
            Encoding::BigEndian => <$number>::from_be_bytes(bytes),
            _ => <$number>::from_le_bytes(bytes),
        })
    };
}

impl<'a> Cursor<'a> {
    pub fn new(file: &'a str, bytes: &'a [u8]) -> Cursor<'a> {
        Cursor { file, bytes, at: 0, encoding: Encoding::Text }
    }

    /// Returns the offset of the next word or number.
    pub fn place(&mut self) -> usize {
        if self.encoding == Encoding::Text {
            self.skip_blanks();
        }
        self.at
    }

    /// Returns an error at an offset, with the line in a text file or the offset in a binary one.
    pub fn fault(&self, place: usize, wrong: impl Display) -> Error {
        let file = self.file;
        Error::Mesh(if self.encoding == Encoding::Text {
            let line = 1 + self.bytes[..place].iter().filter(|&&byte| byte == b'\n').count();
            format!("{file}:{line}: {wrong}")
        } else {
            format!("{file}: byte {place}: {wrong}")
        })
    }

    /// Returns the lines of the file with their offsets, without the characters that end them.
    pub fn lines(&self) -> impl Iterator<Item = (usize, &'a [u8])> + use<'a> {
        let mut place = 0;
        self.bytes.split_inclusive(|&byte| byte == b'\n').map(move |line| {
            let start = place;
            place += line.len();
            (start, line.trim_ascii_end())
        })
    }

    /// Returns an error about the file as a whole.
    pub fn fault_of_file(&self, wrong: impl Display) -> Error {
        Error::Mesh(format!("{}: {wrong}", self.file))
    }

    /// Returns the next word of text, whatever the encoding of numbers; `None` at the end of the
    /// file.
    fn next_word(&mut self) -> Option<&'a [u8]> {
        self.skip_blanks();
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at += length;
        (length > 0).then_some(&rest[..length])
    }

    /// Reads a word of text as a value.
    pub fn word<T: FromStr>(&mut self, expected: &str) -> Result<T> {
        let word = self.next_word().ok_or_else(|| self.end(expected))?;
        let value = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        value.ok_or_else(|| self.unexpected(self.at - word.len(), expected, word))
    }

    /// Reads an `int`.
    pub fn int(&mut self, expected: &str) -> Result<i64> {
        match self.encoding {
            Encoding::Text => self.word(expected),
            _ => fixed_width!(self, i32, expected).map(i64::from),
        }
    }

    /// Reads a `size_t`.
    pub fn size(&mut self, expected: &str) -> Result<u64> {
        match self.encoding {
            Encoding::Text => self.word(expected),
            _ => fixed_width!(self, u64, expected),
        }
    }

    /// Reads a finite `double`.
    pub fn real(&mut self, expected: &str) -> Result<f64> {
        let place = self.place();
        let value: f64 = match self.encoding {
            Encoding::Text => self.word(expected),
            _ => fixed_width!(self, f64, expected),
        }?;
        if value.is_finite() {
            Ok(value)
        } else {
            Err(self.fault(place, format_args!("expected {expected}, found {value}")))
        }
    }

    /// Checks that `count` things of `numbers` numbers each can fit in the rest of the file. The
    /// count is the last number read.
    pub fn claim(&self, count: u64, things: &str, numbers: usize) -> Result<usize> {
        let rest = self.bytes.len() - self.at;
        // A number takes at least a digit and a space, or the bytes of an int.
        let each = numbers * if self.encoding == Encoding::Text { 2 } else { 4 };
        let fits = usize::try_from(count).ok().filter(|count| *count <= rest.div_ceil(each));
        fits.ok_or_else(|| {
            self.fault(
                self.at,
                format_args!("{count} {things} are announced, but only {rest} bytes are left"),
            )
        })
    }

    /// Reads text in double quotes that ends on its line.
    pub fn quoted(&mut self, expected: &str) -> Result<&'a str> {
        self.skip_blanks();
        let rest = &self.bytes[self.at..];
        let line = rest.split(|&byte| byte == b'\n').next().unwrap_or_default().trim_ascii_end();
        let text = line.strip_prefix(b"\"").and_then(|text| text.strip_suffix(b"\""));
        match text.map(std::str::from_utf8) {
            Some(Ok(text)) => {
                self.at += line.len();
                Ok(text)
            }
            _ => Err(self.unexpected(self.at, expected, line)),
        }
    }

    /// Returns whether a text in double quotes comes next.
    pub fn is_before_quote(&mut self) -> bool {
        self.skip_blanks();
        self.bytes.get(self.at) == Some(&b'"')
    }

    /// Reads the name of the next section, with its position; `None` at the end of the file.
    pub fn section(&mut self) -> Result<Option<(&'a str, usize)>> {
        let Some(word) = self.next_word() else { return Ok(None) };
        let place = self.at - word.len();
        let name = word.strip_prefix(b"$").and_then(|name| std::str::from_utf8(name).ok());
        match name {
            Some(name) => Ok(Some((name, place))),
            None => Err(self.unexpected(place, "a section ($Nodes, $Elements, ...)", word)),
        }
    }

    /// Refuses a file of another kind than Gmsh's, which its ending or its first bytes tell.
    pub fn refuse_foreign(&self) -> Result<()> {
        let path = Path::new(self.file);
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let bytes = self.bytes.trim_ascii_start();
        let is_one =
            |words: &str, holds: &dyn Fn(&str) -> bool| words.split('|').any(|w| !w.is_empty() && holds(w));
        let is_of = |(endings, beginnings, ..): &&(&str, &str, &str, &str)| {
            is_one(endings, &|word| word == ending)
                || is_one(beginnings, &|word| bytes.starts_with(word.as_bytes()))
        };
        let foreign = FOREIGN.iter().filter(|_| !bytes.starts_with(b"$MeshFormat")).find(is_of);
        foreign.map_or(Ok(()), |(_, _, what, remedy)| {
            let out = path.with_extension("msh").display().to_string();
            let remedy = remedy.replace("{out}", &out).replace("{in}", self.file);
            Err(self.fault(self.bytes.len() - bytes.len(), format_args!("the file is {what}; {remedy}")))
        })
    }

    /// Moves past the end of the line, after which binary numbers start.
    pub fn end_line(&mut self) -> Result<()> {
        let line = &self.bytes[self.at..];
        let length = line.iter().take_while(|byte| matches!(byte, b' ' | b'\r')).count();
        if line.get(length) != Some(&b'\n') {
            return Err(self.fault(self.at, "expected the end of the line"));
        }
        self.at += length + 1;
        Ok(())
    }

    /// Reads the `$End` of a section, which must come next.
    pub fn end_section(&mut self, name: &str) -> Result<()> {
        let expected = format!("$End{name}");
        let word = self.next_word().ok_or_else(|| self.end(&expected))?;
        if word == expected.as_bytes() {
            Ok(())
        } else {
            Err(self.unexpected(self.at - word.len(), &expected, word))
        }
    }

    /// Moves past the `$End` of a section that is ignored.
    pub fn skip_section(&mut self, name: &str) -> Result<()> {
        let end = format!("$End{name}");
        let offset = self.bytes[self.at..].windows(end.len()).position(|window| window == end.as_bytes());
        self.at += offset.ok_or_else(|| self.end(&end))? + end.len();
        Ok(())
    }

    fn skip_blanks(&mut self) {
        self.at += self.bytes[self.at..].iter().take_while(|byte| byte.is_ascii_whitespace()).count();
    }

    fn bytes<const N: usize>(&mut self, expected: &str) -> Result<[u8; N]> {
        let bytes = self.bytes[self.at..].first_chunk().ok_or_else(|| self.end(expected))?;
        self.at += N;
        Ok(*bytes)
    }

    fn end(&self, expected: &str) -> Error {
        self.fault(self.bytes.len(), format_args!("the file ends where {expected} should stand"))
    }

    /// Returns an error about bytes that stand where something else is expected.
    pub fn unexpected(&self, place: usize, expected: &str, bytes: &[u8]) -> Error {
        const MOST: usize = 40;
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(MOST)]);
        let is_decimal = shown.contains(',') && shown.replacen(',', ".", 1).parse::<f64>().is_ok();
        let rest = match (bytes.len() > MOST, is_decimal) {
            (true, _) => "...",
            (false, true) => "; a decimal point is written .",
            (false, false) => "",
        };
        self.fault(place, format_args!("expected {expected}, found {shown:?}{rest}"))
    }
}
