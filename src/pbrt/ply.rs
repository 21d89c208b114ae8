//! PLY meshes: ASCII and binary of both byte orders, faces of any number of corners.
//!
//! Nothing is believed before it is read: counts in the header bound loops, never allocations, and vectors grow
//! with the data that arrives. Elements and properties that mean nothing here are skipped by their sizes.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;

use super::polygon;
use super::source::open_maybe_gzipped;
use crate::memory;

/// Longest line of a header or word of a body.
const MAX_WORD: usize = 4096;

/// Bytes of a vertex, and of a quad, in memory.
const PER_VERTEX: u64 = 64;
const PER_FACE: u64 = 24;

/// Most lines of a header.
const MAX_HEADER_LINES: usize = 10_000;

/// A mesh as it stands in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PlyMesh {
    pub positions: Vec<[f64; 3]>,
    /// Empty, or one for each position.
    pub normals: Vec<[f64; 3]>,
    /// Empty, or one for each position.
    pub uvs: Vec<[f64; 2]>,
    /// Quads are split into 0 1 2 and 0 2 3.
    pub triangles: Vec<[u32; 3]>,
    /// For each quad the number of the first of its two triangles.
    pub quads: Vec<u32>,
    /// How many faces had more than four corners, and were cut into triangles.
    pub polygons: u64,
    /// How many faces were left out: with one or two corners, or with more than four and not plane, or crossing
    /// themselves.
    pub skipped: u64,
}

/// What is wrong with a file, and where in it: `line 12` or `byte 345`, empty for the file as a whole.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlyError {
    pub place: String,
    pub message: String,
}

type Result<T> = std::result::Result<T, PlyError>;

/// Time that [`read`] has taken in this process, in nanoseconds.
static READING: AtomicU64 = AtomicU64::new(0);

/// Time that reading mesh files has taken in this process.
pub(crate) fn reading_time() -> Duration {
    Duration::from_nanos(READING.load(Ordering::Relaxed))
}

/// Reads a file; a name that ends in `.gz` is decompressed.
pub(crate) fn read(path: &Path) -> Result<PlyMesh> {
    let started = Instant::now();
    let mesh = read_file(path);
    READING.fetch_add(started.elapsed().as_nanos() as u64, Ordering::Relaxed);
    mesh
}

fn read_file(path: &Path) -> Result<PlyMesh> {
    let reader = open_maybe_gzipped(path).map_err(|error| PlyError {
        place: String::new(),
        message: format!("cannot read the file: {error}"),
    })?;
    parse(reader)
}

/// Reads a mesh.
pub(crate) fn parse(reader: impl Read) -> Result<PlyMesh> {
    let mut input = Input {
        reader: BufReader::with_capacity(1 << 18, reader),
        line: 1,
        offset: 0,
        binary: false,
        ends_with_return: false,
    };
    let header = read_header(&mut input)?;
    input.binary = header.format != Format::Ascii;
    let mut body = Body { input, format: header.format, word: Vec::new() };
    read_body(&mut body, &header)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &str) -> Option<Scalar> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum PropertyType {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Debug)]
struct Property {
    name: String,
    ty: PropertyType,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Header {
    format: Format,
    elements: Vec<Element>,
}

/// A byte stream that knows where it is.
struct Input<R> {
    reader: BufReader<R>,
    line: u64,
    offset: u64,
    binary: bool,
    /// Lines of the header end with a carriage return alone.
    ends_with_return: bool,
}

impl<R: Read> Input<R> {
    fn error(&self, message: impl Into<String>) -> PlyError {
        let place = if self.binary { format!("byte {}", self.offset) } else { format!("line {}", self.line) };
        PlyError { place, message: message.into() }
    }

    fn byte(&mut self) -> Result<Option<u8>> {
        let first = match self.reader.fill_buf() {
            Ok(buffer) => buffer.first().copied(),
            Err(error) => return Err(self.error(format!("cannot read on: {error}"))),
        };
        if first.is_some() {
            self.reader.consume(1);
            self.offset += 1;
        }
        Ok(first)
    }

    fn next_is_not_line_feed(&mut self) -> bool {
        self.reader.fill_buf().is_ok_and(|buffer| buffer.first() != Some(&b'\n'))
    }

    fn exact<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.reader.read_exact(&mut bytes).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => self.error("the file ends too early"),
            _ => self.error(format!("cannot read on: {error}")),
        })?;
        self.offset += N as u64;
        Ok(bytes)
    }

    /// A line of the header without its end; `None` at the end of the file.
    fn line(&mut self) -> Result<Option<String>> {
        let mut bytes = Vec::new();
        loop {
            match self.byte()? {
                Some(b'\n') => break,
                Some(b'\r') if self.ends_with_return => break,
                // The first line tells.
                Some(b'\r') if self.offset == 4 && self.next_is_not_line_feed() => {
                    self.ends_with_return = true;
                    break;
                }
                Some(_) if bytes.len() >= MAX_WORD => {
                    return Err(self.error("line of the header is too long"));
                }
                Some(byte) => bytes.push(byte),
                None if bytes.is_empty() => return Ok(None),
                None => break,
            }
        }
        let text = String::from_utf8_lossy(&bytes).trim_end().to_string();
        Ok(Some(text))
    }
}

fn read_header<R: Read>(input: &mut Input<R>) -> Result<Header> {
    if input.line()?.as_deref() != Some("ply") {
        return Err(input.error("not a PLY file: expected \"ply\" in the first line"));
    }
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    for _ in 0..MAX_HEADER_LINES {
        input.line += 1;
        let Some(line) = input.line()? else {
            return Err(input.error("the file ends inside the header"));
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            [] | ["comment" | "obj_info", ..] => {}
            ["format", name, _version] => format = Some(format_by_name(input, name)?),
            ["element", name, count] => elements.push(element(input, name, count)?),
            ["property", ref rest @ ..] => {
                let property = property(input, rest)?;
                let Some(element) = elements.last_mut() else {
                    return Err(input.error("a property before any element"));
                };
                element.properties.push(property);
            }
            ["end_header"] => {
                let Some(format) = format else {
                    return Err(input.error("the header names no format"));
                };
                input.line += 1;
                return Ok(Header { format, elements });
            }
            _ => return Err(input.error("unknown line in the header")),
        }
    }
    Err(input.error("the header is too long"))
}

fn format_by_name<R: Read>(input: &Input<R>, name: &str) -> Result<Format> {
    match name {
        "ascii" => Ok(Format::Ascii),
        "binary_little_endian" => Ok(Format::LittleEndian),
        "binary_big_endian" => Ok(Format::BigEndian),
        _ => Err(input.error("unknown format: expected ascii, binary_little_endian or binary_big_endian")),
    }
}

fn element<R: Read>(input: &Input<R>, name: &str, count: &str) -> Result<Element> {
    let count = count.parse().map_err(|_| input.error("the number of elements is not a number"))?;
    Ok(Element { name: name.to_string(), count, properties: Vec::new() })
}

fn property<R: Read>(input: &Input<R>, words: &[&str]) -> Result<Property> {
    let scalar =
        |name: &str| Scalar::from_name(name).ok_or_else(|| input.error("unknown type of a property"));
    let (ty, name) = match *words {
        ["list", count, item, name] => {
            let count = scalar(count)?;
            if matches!(count, Scalar::F32 | Scalar::F64) {
                return Err(input.error("the length of a list is not an integer type"));
            }
            (PropertyType::List { count, item: scalar(item)? }, name)
        }
        [ty, name] => (PropertyType::Scalar(scalar(ty)?), name),
        _ => {
            return Err(input.error("a property that is neither \"type name\" nor \"list type type name\""));
        }
    };
    Ok(Property { name: name.to_string(), ty })
}

/// The numbers behind the header. Every type fits into `f64` exactly.
struct Body<R> {
    input: Input<R>,
    format: Format,
    word: Vec<u8>,
}

impl<R: Read> Body<R> {
    fn scalar(&mut self, ty: Scalar) -> Result<f64> {
        if self.format == Format::Ascii {
            return self.ascii();
        }
        let big = self.format == Format::BigEndian;
        macro_rules! number {
            ($type:ty) => {{
                let bytes = self.input.exact()?;
                f64::from(if big { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) })
            }};
        }
        Ok(match ty {
            Scalar::I8 => number!(i8),
            Scalar::U8 => number!(u8),
            Scalar::I16 => number!(i16),
            Scalar::U16 => number!(u16),
            Scalar::I32 => number!(i32),
            Scalar::U32 => number!(u32),
            Scalar::F32 => number!(f32),
            Scalar::F64 => number!(f64),
        })
    }

    fn ascii(&mut self) -> Result<f64> {
        self.word.clear();
        // The line feed behind a word is counted with the next word, so that errors name the word's own line.
        loop {
            let next = match self.input.reader.fill_buf() {
                Ok(buffer) => buffer.first().copied(),
                Err(error) => return Err(self.input.error(format!("cannot read on: {error}"))),
            };
            match next {
                None if self.word.is_empty() => {
                    return Err(self.input.error("the file ends too early"));
                }
                None => break,
                Some(byte) if byte.is_ascii_whitespace() => {
                    if !self.word.is_empty() {
                        break;
                    }
                    let ends = if self.input.ends_with_return { b'\r' } else { b'\n' };
                    self.input.line += u64::from(byte == ends);
                }
                Some(_) if self.word.len() >= MAX_WORD => {
                    return Err(self.input.error("a word is too long"));
                }
                Some(byte) => self.word.push(byte),
            }
            self.input.reader.consume(1);
        }
        let text = std::str::from_utf8(&self.word).ok();
        text.and_then(|text| text.parse().ok()).ok_or_else(|| {
            let found = super::lexer::shorten(&String::from_utf8_lossy(&self.word));
            self.input.error(format!("`{found}` is not a number"))
        })
    }

    fn list_length(&mut self, ty: Scalar) -> Result<u64> {
        let length = self.scalar(ty)?;
        if length < 0.0 || length.fract() != 0.0 || !length.is_finite() {
            return Err(self.input.error(format!("a list of {length} values")));
        }
        Ok(length as u64)
    }

    fn skip(&mut self, ty: PropertyType) -> Result<()> {
        match ty {
            PropertyType::Scalar(ty) => self.scalar(ty).map(drop),
            PropertyType::List { count, item } => {
                for _ in 0..self.list_length(count)? {
                    self.scalar(item)?;
                }
                Ok(())
            }
        }
    }
}

fn read_body<R: Read>(body: &mut Body<R>, header: &Header) -> Result<PlyMesh> {
    let mut mesh = PlyMesh::default();
    let mut have_vertices = false;
    let mut have_faces = false;
    let mut faces = Faces::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" if !have_vertices => {
                read_vertices(body, element, &mut mesh, &mut faces)?;
                have_vertices = true;
            }
            "face" if !have_faces => {
                let vertices = have_vertices.then_some(mesh.positions.len());
                read_faces(body, element, &mut mesh, &mut faces, vertices)?;
                have_faces = true;
            }
            _ => skip_element(body, element)?,
        }
    }
    if !have_vertices || !have_faces {
        let missing = if have_vertices { "face" } else { "vertex" };
        return Err(PlyError { place: String::new(), message: format!("no element \"{missing}\"") });
    }
    // Needed where the faces stand before the vertices.
    let used = || mesh.triangles.iter().flatten().chain(&faces.polygons);
    if let Some(index) = used().find(|&&index| index as usize >= mesh.positions.len()) {
        let message = format!("vertex index {index}, but there are {} vertices", mesh.positions.len());
        return Err(PlyError { place: String::new(), message });
    }
    // Exporters leave vertices that are no numbers where no face uses them.
    if let Some((first, error)) = faces.not_finite.take() {
        let is_bad = |index: u32| !mesh.positions[index as usize].iter().all(|c| c.is_finite());
        if let Some(index) = used().find(|index| is_bad(**index)) {
            return Err(match *index == first {
                true => error,
                false => PlyError {
                    place: String::new(),
                    message: format!("vertex {index} is not finite, and a face uses it"),
                },
            });
        }
    }
    faces.cut_polygons(&mut mesh);
    Ok(mesh)
}

/// What is known about the faces while they are read.
#[derive(Default)]
struct Faces {
    /// Corners of all faces with more than four, and how many each of them has.
    polygons: Vec<u32>,
    lengths: Vec<u32>,
    /// The first vertex that is no number, and what to say of it if a face uses it.
    not_finite: Option<(u32, PlyError)>,
}

impl Faces {
    fn cut_polygons(&self, mesh: &mut PlyMesh) {
        let mut rest = &self.polygons[..];
        for length in &self.lengths {
            let (corners, behind) = rest.split_at(*length as usize);
            rest = behind;
            let points: Vec<DVec3> =
                corners.iter().map(|i| DVec3::from_array(mesh.positions[*i as usize])).collect();
            match polygon::triangulate(&points) {
                Some(triangles) => {
                    mesh.polygons += 1;
                    mesh.triangles.extend(triangles.into_iter().map(|t| t.map(|i| corners[i as usize])));
                }
                None => mesh.skipped += 1,
            }
        }
    }
}

fn skip_element<R: Read>(body: &mut Body<R>, element: &Element) -> Result<()> {
    // Without properties there is nothing to read, however many there are.
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            body.skip(property.ty)?;
        }
    }
    Ok(())
}

/// What the value of a vertex' property is.
#[derive(Clone, Copy, PartialEq)]
enum Slot {
    Ignored,
    /// Index into x y z, nx ny nz, u v.
    Value(usize),
}

fn slot(name: &str) -> Slot {
    Slot::Value(match name {
        "x" => 0,
        "y" => 1,
        "z" => 2,
        "nx" => 3,
        "ny" => 4,
        "nz" => 5,
        "u" | "s" | "texture_u" | "texture_s" => 6,
        "v" | "t" | "texture_v" | "texture_t" => 7,
        _ => return Slot::Ignored,
    })
}

fn read_vertices<R: Read>(
    body: &mut Body<R>,
    element: &Element,
    mesh: &mut PlyMesh,
    faces: &mut Faces,
) -> Result<()> {
    let slots: Vec<Slot> = element.properties.iter().map(|p| slot(&p.name)).collect();
    let has = |indices: std::ops::Range<usize>| indices.into_iter().all(|i| slots.contains(&Slot::Value(i)));
    if !has(0..3) {
        return Err(body.input.error("the vertices have no x, y and z"));
    }
    let (has_normals, has_uvs) = (has(3..6), has(6..8));
    let most = memory::limit() / PER_VERTEX;
    for i in 0..element.count {
        if i > most {
            return Err(body.input.error("too many vertices for the memory"));
        }
        let mut values = [0.0; 8];
        for (property, slot) in element.properties.iter().zip(&slots) {
            match (property.ty, *slot) {
                (PropertyType::Scalar(ty), Slot::Value(index)) => {
                    values[index] = body.scalar(ty)?;
                    if index < 3 && !values[index].is_finite() && faces.not_finite.is_none() {
                        let message = format!("\"{}\" of a vertex is not finite", property.name);
                        faces.not_finite = Some((i as u32, body.input.error(message)));
                    }
                }
                (ty, _) => body.skip(ty)?,
            }
        }
        let [x, y, z, nx, ny, nz, u, v] = values;
        mesh.positions.push([x, y, z]);
        if has_normals {
            mesh.normals.push([nx, ny, nz]);
        }
        if has_uvs {
            mesh.uvs.push([u, v]);
        }
    }
    Ok(())
}

fn read_faces<R: Read>(
    body: &mut Body<R>,
    element: &Element,
    mesh: &mut PlyMesh,
    faces: &mut Faces,
    vertices: Option<usize>,
) -> Result<()> {
    let most = memory::limit() / PER_FACE;
    let is_indices = |p: &Property| {
        matches!(p.ty, PropertyType::List { .. })
            && matches!(p.name.as_str(), "vertex_indices" | "vertex_index")
    };
    if !element.properties.iter().any(is_indices) {
        return Err(body.input.error("the faces have no list \"vertex_indices\""));
    }
    for i in 0..element.count {
        if i > most {
            return Err(body.input.error("too many faces for the memory"));
        }
        for property in &element.properties {
            match property.ty {
                PropertyType::List { count, item } if is_indices(property) => {
                    read_face(body, count, item, mesh, faces, vertices)?;
                }
                ty => body.skip(ty)?,
            }
        }
    }
    Ok(())
}

fn read_face<R: Read>(
    body: &mut Body<R>,
    count: Scalar,
    item: Scalar,
    mesh: &mut PlyMesh,
    faces: &mut Faces,
    vertices: Option<usize>,
) -> Result<()> {
    let length = body.list_length(count)?;
    let mut indices = [0u32; 4];
    let first = faces.polygons.len();
    for i in 0..length {
        let value = body.scalar(item)?;
        let limit = vertices.map_or(f64::from(u32::MAX), |count| count as f64);
        if value.fract() != 0.0 || !(0.0..limit).contains(&value) {
            let known = vertices.map(|count| format!(", but there are {count} vertices")).unwrap_or_default();
            return Err(body.input.error(format!("vertex index {value}{known}")));
        }
        if length > 4 {
            if faces.polygons.len() as u64 > memory::limit() / PER_FACE {
                return Err(body.input.error("too many faces for the memory"));
            }
            faces.polygons.push(value as u32);
        } else {
            indices[i as usize] = value as u32;
        }
    }
    let [a, b, c, d] = indices;
    match length {
        0..3 => mesh.skipped += 1,
        3 => mesh.triangles.push([a, b, c]),
        4 => {
            mesh.quads.push(mesh.triangles.len() as u32);
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
        _ => faces.lengths.push((faces.polygons.len() - first) as u32),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty double y\n\
        property float z\nproperty uchar red\nproperty float nx\nproperty float ny\nproperty float nz\n\
        property float s\nproperty float t\nelement face 2\nproperty list uchar int vertex_indices\nproperty int id\n\
        element edge 1\nproperty list uint short q\nend_header\n\
        0 0 0 9 0 0 1 0 0\n1 0 0 9 0 0 1 1 0\n1 1 0 9 0 0 1 1 1\n0 1 0 9 0 0 1 0 1\n\
        4 0 1 2 3 7\n3 0 1 2 8\n2 5 6\n";

    /// The same mesh in binary.
    fn binary(big: bool) -> Vec<u8> {
        let name = if big { "binary_big_endian" } else { "binary_little_endian" };
        let (header, _) = ASCII.split_once("end_header\n").unwrap();
        let mut bytes = header.replace("ascii", name).into_bytes();
        bytes.extend(b"end_header\n");
        macro_rules! put {
            ($value:expr) => {
                bytes.extend(if big { $value.to_be_bytes() } else { $value.to_le_bytes() })
            };
        }
        for [x, y] in [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            put!(x);
            put!(f64::from(y));
            put!(0.0f32);
            put!(9u8);
            for n in [0.0f32, 0.0, 1.0, x, y] {
                put!(n);
            }
        }
        for face in [&[0i32, 1, 2, 3][..], &[0, 1, 2]] {
            put!(face.len() as u8);
            for index in face {
                put!(*index);
            }
            put!(7i32);
        }
        put!(2u32);
        put!(5i16);
        put!(6i16);
        bytes
    }

    #[test]
    fn all_formats_give_the_same_mesh() {
        let mesh = parse(ASCII.as_bytes()).unwrap();
        assert_eq!(mesh.positions[2], [1.0, 1.0, 0.0]);
        assert_eq!(mesh.normals, [[0.0, 0.0, 1.0]; 4]);
        assert_eq!(mesh.uvs[3], [0.0, 1.0]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
        assert_eq!(parse(&binary(false)[..]).unwrap(), mesh);
        assert_eq!(parse(&binary(true)[..]).unwrap(), mesh);
        assert_eq!(parse(ASCII.replace('\n', "\r\n").as_bytes()).unwrap(), mesh);
        assert_eq!(parse(ASCII.replace('\n', "\r").as_bytes()).unwrap(), mesh);
    }

    fn failure(text: &str) -> (String, String) {
        let error = parse(text.as_bytes()).unwrap_err();
        (error.place, error.message)
    }

    #[test]
    fn faults_are_placed() {
        for (from, to, place, phrase) in [
            ("0 1 0 9", "0 nan 0 9", "line 23", "not finite"),
            ("0 0 0 9", "inf 0 0 9", "line 20", "not finite"),
            ("0 1 0 9", "0 zwei 0 9", "line 23", "`zwei`"),
            ("4 0 1 2 3", "4 0 1 2 4", "line 24", "index 4, but there are 4"),
            ("3 0 1 2 8", "3 0 -1 2 8", "line 25", "index -1"),
            ("3 0 1 2 8", "99 0 1 8", "line 25", "vertex index 8"),
            ("element edge 1", "element edge 9999999999", "line 27", "ends too early"),
            ("property double y", "property double w", "line 20", "no x, y and z"),
            ("property double y", "property half y", "line 6", "unknown type"),
            ("format ascii", "format text", "line 2", "unknown format"),
            ("end_header", "header_end", "line 19", "unknown line"),
        ] {
            let (found, message) = failure(&ASCII.replace(from, to));
            assert!(found == place && message.contains(phrase), "{from} -> {to}: {found}: {message}");
        }
    }

    #[test]
    fn faces_of_any_number_of_corners_are_cut_or_counted() {
        let header = "ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\nproperty float z\n\
            element face 4\nproperty list uchar int vertex_indices\nend_header\n";
        // An L, the same with a corner out of its plane, a line, and a triangle; the last vertex is of no use.
        let text = format!(
            "{header}0 0 0\n2 0 0\n2 1 0\n1 1 0\n1 2 0\n0 2 1e-6\nnan 0 0\n6 0 1 2 3 4 5\n2 0 1\n3 0 1 2\n0\n"
        );
        let mesh = parse(text.as_bytes()).unwrap();
        assert_eq!((mesh.polygons, mesh.skipped, mesh.triangles.len()), (1, 2, 5));
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| DVec3::from_array(mesh.positions[i as usize]));
            0.5 * (b - a).cross(c - a).z
        };
        assert!((mesh.triangles.iter().map(area).sum::<f64>() - 4.0).abs() < 1e-6);
        let bent = parse(text.replace("1e-6", "1").as_bytes()).unwrap();
        assert_eq!((bent.polygons, bent.skipped, bent.triangles.len()), (0, 3, 1));
        let used = parse(text.replace("3 0 1 2", "3 0 1 6").as_bytes()).unwrap_err();
        assert_eq!(
            (used.place.as_str(), used.message.as_str()),
            ("line 16", "\"x\" of a vertex is not finite")
        );
    }

    #[test]
    fn a_header_is_not_believed() {
        let header = "ply\nformat binary_little_endian 1.0\nelement nothing 18446744073709551615\n\
            element vertex 18446744073709551615\nproperty float x\nproperty float y\nproperty float z\n\
            element face 18446744073709551615\nproperty list uint int vertex_indices\nend_header\n";
        let (place, message) = failure(header);
        assert_eq!((place, message.as_str()), (format!("byte {}", header.len()), "the file ends too early"));
        let bytes = binary(false);
        for length in 0..bytes.len() {
            assert!(parse(&bytes[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn damaged_files_never_panic() {
        // xorshift64*: fixed, so that a failure can be repeated.
        let mut state = 0x1234_5678_9abc_def1_u64;
        let mut below = |limit: usize| {
            state ^= state >> 12;
            state ^= state << 25;
            state ^= state >> 27;
            (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % limit
        };
        for original in [ASCII.as_bytes().to_vec(), binary(false), binary(true)] {
            for _ in 0..3000 {
                let mut bytes = original.clone();
                for _ in 0..=below(3) {
                    let at = below(bytes.len());
                    match below(4) {
                        0 => bytes[at] = below(256) as u8,
                        1 => bytes[at] ^= 1 << below(8),
                        2 => drop(bytes.remove(at)),
                        _ => bytes.insert(at, b"0919-."[below(6)]),
                    }
                }
                if let Ok(mesh) = parse(&bytes[..]) {
                    let count = mesh.positions.len();
                    assert!(mesh.triangles.iter().flatten().all(|i| (*i as usize) < count));
                    let is_finite = |i: u32| mesh.positions[i as usize].iter().all(|c| c.is_finite());
                    assert!(mesh.triangles.iter().flatten().all(|i| is_finite(*i)));
                }
            }
        }
    }
}
