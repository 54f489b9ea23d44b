//! Points with classes as binary PLY, which `CloudCompare`, `MeshLab` and `Open3D` open.

use std::io::{self, Write};

use nalgebra::Point3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyPoint {
    /// Metres in the frame of the file; rounded to f32 there, which is 0.1 mm at 1 km.
    pub point: Point3<f64>,
    pub class: u8,
}

#[derive(Clone, Copy, Debug)]
pub struct PlyHeader<'a> {
    pub frame: &'a str,
    /// Side of the voxels that the points stand for, metres.
    pub cell_m: f64,
    pub classes: &'a [(u8, &'a str)],
}

/// Writes `points`: `float x y z` in metres and `uchar class`, little-endian; frame, cell and classes are
/// comments of the header.
pub fn write(
    header: &PlyHeader<'_>,
    points: impl ExactSizeIterator<Item = PlyPoint>,
    out: &mut impl Write,
) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "comment frame {}", one_line(header.frame))?;
    writeln!(out, "comment cell_m {}", header.cell_m)?;
    for (class, name) in header.classes {
        writeln!(out, "comment class {class} {}", one_line(name))?;
    }
    writeln!(out, "element vertex {}", points.len())?;
    writeln!(out, "property float x\nproperty float y\nproperty float z")?;
    writeln!(out, "property uchar class\nend_header")?;
    for PlyPoint { point, class } in points {
        let mut vertex = [0; VERTEX_BYTES];
        for (bytes, coordinate) in vertex.chunks_exact_mut(4).zip(point.iter()) {
            bytes.copy_from_slice(&(*coordinate as f32).to_le_bytes());
        }
        vertex[VERTEX_BYTES - 1] = class;
        out.write_all(&vertex)?;
    }
    Ok(())
}

/// Three floats and a byte.
const VERTEX_BYTES: usize = 13;

/// A comment ends with its line, so that no name can end it early.
fn one_line(name: &str) -> String {
    let printable = |character: char| {
        if character.is_control() {
            ' '
        } else {
            character
        }
    };
    name.chars().map(printable).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Header lines, and x, y, z and class of every vertex.
    fn read(bytes: &[u8]) -> (Vec<&str>, Vec<([f32; 3], u8)>) {
        let end = b"\nend_header\n";
        let header = bytes.windows(end.len()).position(|window| window == end);
        let (header, vertices) = bytes.split_at(header.unwrap() + end.len());
        let vertices = vertices.chunks(VERTEX_BYTES).map(|vertex| {
            let along = |at: usize| f32::from_le_bytes(vertex[at..at + 4].try_into().unwrap());
            ([along(0), along(4), along(8)], vertex[12])
        });
        (
            str::from_utf8(header).unwrap().lines().collect(),
            vertices.collect(),
        )
    }

    #[test]
    fn points_are_written_with_their_classes() {
        let point = |x, y, z, class| PlyPoint {
            point: Point3::new(x, y, z),
            class,
        };
        let header = PlyHeader {
            frame: "odom\nend_header",
            cell_m: 0.1,
            classes: &[(0, "occupied"), (2, "rigid")],
        };
        let points = [point(0.05, -1.25, 3.0, 2), point(1e3, 0.0, -0.5, 0)];
        let mut bytes = Vec::new();
        write(&header, points.into_iter(), &mut bytes).unwrap();
        let (header, vertices) = read(&bytes);
        assert_eq!(
            header,
            [
                "ply",
                "format binary_little_endian 1.0",
                "comment frame odom end_header",
                "comment cell_m 0.1",
                "comment class 0 occupied",
                "comment class 2 rigid",
                "element vertex 2",
                "property float x",
                "property float y",
                "property float z",
                "property uchar class",
                "end_header",
            ]
        );
        assert_eq!(
            vertices,
            [([0.05, -1.25, 3.0], 2), ([1000.0, 0.0, -0.5], 0)]
        );
    }
}
