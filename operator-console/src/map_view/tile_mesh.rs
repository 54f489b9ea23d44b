//! Textures as quadrangles on the screen: whole ones and parts of them, of a map that may be turned.

use eframe::egui::{Color32, Mesh, Painter, Pos2, Rect, TextureHandle, epaint::Vertex, pos2};

use super::camera::Camera;
use super::chunks::ChunkKey;

/// All of a texture.
pub(super) const WHOLE: Rect = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));

/// Which part of the texture of `whole` shows `part`, which lies in it.
pub(super) fn part_of(whole: ChunkKey, part: ChunkKey) -> Rect {
    let ((left, bottom), (x, y)) = (whole.first_tile(), part.first_tile());
    let side = whole.level.tiles_per_chunk() as f32;
    let part_side = part.level.tiles_per_chunk() as f32;
    let (from_left, from_bottom) = ((x - left) as f32, (y - bottom) as f32);
    Rect::from_min_max(
        pos2(from_left / side, 1.0 - (from_bottom + part_side) / side),
        pos2((from_left + part_side) / side, 1.0 - from_bottom / side),
    )
}

/// The corners of a rectangle of `odom`, from the one with the lowest x and greatest y clockwise.
pub(super) fn corners(
    [low_x, low_y, high_x, high_y]: [f64; 4],
    camera: &Camera,
    screen: Rect,
) -> [Pos2; 4] {
    [
        [low_x, high_y],
        [high_x, high_y],
        [high_x, low_y],
        [low_x, low_y],
    ]
    .map(|corner_m| camera.to_screen(screen, corner_m))
}

pub(super) fn paint_quad(
    painter: &Painter,
    texture: &TextureHandle,
    corners: [Pos2; 4],
    part: Rect,
    color: Color32,
) {
    let mut mesh = Mesh::with_texture(texture.id());
    let uvs = [
        part.left_top(),
        part.right_top(),
        part.right_bottom(),
        part.left_bottom(),
    ];
    let vertex = |(pos, uv)| Vertex { pos, uv, color };
    mesh.vertices = corners.into_iter().zip(uvs).map(vertex).collect();
    mesh.indices = vec![0, 1, 2, 0, 2, 3];
    painter.add(mesh);
}
