//! Writes meshes as binary PLY.

use crate::atomic_file::write_whole;
use crate::scene::Mesh;
use std::io::{self, Write};
use std::path::Path;

/// Writes a mesh to `path` as binary little-endian PLY. The file appears whole or not at all.
pub fn write(path: &Path, mesh: &Mesh) -> io::Result<()> {
    write_whole(path, |out| encode(out, mesh))
}

/// Writes a mesh as binary little-endian PLY: vertices `x y z`, `nx ny nz` if it has normals, `u v` if it has texture
/// coordinates; faces `list uchar int vertex_indices`. All floats are 32 bits wide.
///
/// Fails with `InvalidInput` if the mesh has more vertices or triangles than PLY's signed indices reach.
pub fn encode(out: &mut (impl Write + ?Sized), mesh: &Mesh) -> io::Result<()> {
    let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
    if vertices > i32::MAX as usize || faces > i32::MAX as usize {
        let message = "a PLY file holds at most 2147483647 vertices and as many faces";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    }
    writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment made by wavepath mesh")?;
    writeln!(out, "element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z")?;
    if !mesh.normals.is_empty() {
        writeln!(out, "property float nx\nproperty float ny\nproperty float nz")?;
    }
    if !mesh.uvs.is_empty() {
        writeln!(out, "property float u\nproperty float v")?;
    }
    writeln!(out, "element face {faces}\nproperty list uchar int vertex_indices\nend_header")?;
    let mut floats = |values: &[f32]| values.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()));
    for (i, position) in mesh.positions.iter().enumerate() {
        floats(&position.map(|x| x as f32))?;
        if let Some(normal) = mesh.normals.get(i) {
            floats(normal)?;
        }
        if let Some(uv) = mesh.uvs.get(i) {
            floats(uv)?;
        }
    }
    for t in &mesh.triangles {
        let mut face = [3u8; 13];
        for (bytes, index) in face[1..].chunks_exact_mut(4).zip(t) {
            bytes.copy_from_slice(&(*index as i32).to_le_bytes());
        }
        out.write_all(&face)?;
    }
    Ok(())
}

/// Reads back what [`encode`] wrote, and nothing else.
#[cfg(test)]
pub(super) fn decode(bytes: &[u8]) -> Mesh {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let count = |element: &str| -> usize {
        let line = header.lines().find(|l| l.starts_with(element)).unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let mut rest = bytes[end..].iter().copied();
    let mut four = || -> [u8; 4] { std::array::from_fn(|_| rest.next().unwrap()) };
    let mut mesh = Mesh::default();
    for _ in 0..count("element vertex") {
        mesh.positions.push(std::array::from_fn(|_| f32::from_le_bytes(four()).into()));
        if header.contains("float nx") {
            mesh.normals.push(std::array::from_fn(|_| f32::from_le_bytes(four())));
        }
        if header.contains("float u") {
            mesh.uvs.push(std::array::from_fn(|_| f32::from_le_bytes(four())));
        }
    }
    for _ in 0..count("element face") {
        assert_eq!(rest.next(), Some(3));
        let mut index = || u32::from_le_bytes(std::array::from_fn(|_| rest.next().unwrap()));
        mesh.triangles.push(std::array::from_fn(|_| index()));
    }
    assert_eq!(rest.next(), None);
    mesh
}

#[cfg(test)]
mod tests {
    use super::super::{Terrain, TorusKnot};
    use super::*;
    use std::fs;

    #[test]
    fn what_is_written_is_read_back() {
        let mut meshes = vec![
            Terrain { cells: 5, uv: true, ..Terrain::default() }.build().unwrap(),
            TorusKnot { segments: 30, sides: 4, ..TorusKnot::default() }.build().unwrap(),
        ];
        meshes.push(Mesh { normals: Vec::new(), ..meshes[1].clone() });
        for mesh in meshes {
            let mut bytes = Vec::new();
            encode(&mut bytes, &mesh).unwrap();
            assert_eq!(decode(&bytes), mesh);
        }
    }

    #[test]
    fn a_file_appears_whole_and_leaves_nothing_beside_it() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let mesh = TorusKnot { segments: 30, sides: 4, ..TorusKnot::default() }.build().unwrap();
        let path = folder.join("knot.ply");
        write(&path, &mesh).unwrap();
        assert_eq!(decode(&fs::read(&path).unwrap()), mesh);
        // A folder stands where the file should go: the write fails and cleans up.
        fs::create_dir(folder.join("taken")).unwrap();
        assert!(write(&folder.join("taken"), &mesh).is_err());
        assert!(write(&folder.join("no/such/folder.ply"), &mesh).is_err());
        let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["knot.ply", "taken"]);
    }
}
