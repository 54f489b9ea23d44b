//! Pictures of an experiment's page: layers as exports draw them, and drawings of its own.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Encoder, EncodingError};
use protocol::export::{Caption, ExportError, Label, write_picture};
use protocol::layer::{LayerId, Palette, Scheme};
use protocol::mosaic::{MAX_RASTER_CELLS, Raster};
use protocol::tile::{BootId, TILE_SIDE, TileCells, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};

use edge::publishing::cells_to_tiles::set_code;

#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Name of its file, without ending: letters, digits and `-`.
    pub name: String,
    pub caption: String,
    pub image: Image,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Image {
    /// A map layer with title, legend and scale bar.
    Layer {
        raster: Raster,
        palette: Palette,
        title: String,
        /// Where the vehicle is in `odom`, metres.
        vehicle_m: Option<[f64; 2]>,
        labels: Vec<Label>,
    },
    Drawing(Drawing),
}

/// Pixels in a few colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawing {
    pub width: u32,
    /// The colours, sRGB: at most 256.
    pub colors: Vec<[u8; 3]>,
    /// Indices of colours, rows from the top.
    pub pixels: Vec<u8>,
}

impl Picture {
    /// A layer of a published map; `None` where nothing of it is known.
    pub fn of_layer(
        store: &TileStore,
        palette: Palette,
        vehicle_m: Option<[f64; 2]>,
        name: &str,
        caption: &str,
    ) -> anyhow::Result<Option<Self>> {
        let raster = Raster::of_layer(store, palette.layer(), MAX_RASTER_CELLS)?;
        Ok(raster.map(|raster| Self {
            name: name.to_owned(),
            caption: caption.to_owned(),
            image: Image::Layer {
                raster,
                palette,
                title: caption.to_owned(),
                vehicle_m,
                labels: Vec::new(),
            },
        }))
    }

    /// Writes `<name>.png` to `dir`; returns its path.
    pub fn write(&self, dir: &Path) -> Result<PathBuf, ExportError> {
        let path = dir.join(format!("{}.png", self.name));
        match &self.image {
            Image::Layer {
                raster,
                palette,
                title,
                vehicle_m,
                labels,
            } => {
                let caption = Caption {
                    title,
                    vehicle_m: *vehicle_m,
                    labels,
                    ..Caption::default()
                };
                write_picture(&path, raster, palette, &caption)?;
            }
            Image::Drawing(drawing) => drawing.write(&path)?,
        }
        Ok(path)
    }
}

impl Drawing {
    fn write(&self, path: &Path) -> Result<(), ExportError> {
        let file = File::create(path).map_err(ExportError::at(path))?;
        self.encode(BufWriter::new(file))
            .map_err(ExportError::at(path))
    }

    fn encode(&self, file: BufWriter<File>) -> Result<(), EncodingError> {
        let height = self.pixels.len() / (self.width as usize).max(1);
        let mut encoder = Encoder::new(file, self.width, height as u32);
        encoder.set_color(ColorType::Indexed);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_palette(self.colors.concat());
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.pixels)?;
        writer.finish()
    }
}

/// Elevation colours; [`Scheme::GroundPlane`] and its like are those of the document [LOD ch. 5].
pub(super) fn elevation_in(scheme: Scheme) -> Palette {
    palette(LayerId::Elevation, scheme)
}

/// The default elevation colours over the heights that matter to a vehicle, the same in every picture.
pub(super) fn elevation() -> Palette {
    palette(LayerId::Elevation, Scheme::Cividis).fitted(-0.5, 1.5)
}

/// The default obstacle colours.
pub(super) fn obstacle() -> Palette {
    palette(LayerId::Obstacle, Scheme::OkabeIto)
}

fn palette(layer: LayerId, scheme: Scheme) -> Palette {
    layer
        .palettes()
        .find(|palette| palette.scheme() == scheme)
        .unwrap_or_else(|| layer.default_palette())
}

/// A store that holds single cells of one layer, given by index and code: for maps that are not published.
pub(super) fn store_of(
    layer: LayerId,
    cell_m: f64,
    cells: impl IntoIterator<Item = ([i64; 2], u16)>,
) -> anyhow::Result<TileStore> {
    let mut tiles: BTreeMap<TileKey, TileCells> = BTreeMap::new();
    for ([x, y], code) in cells {
        let Some(key) = TileKey::of_cell(layer, x, y) else {
            continue;
        };
        let first = key.first_cell();
        let place = (y - first.1) as usize * TILE_SIDE + (x - first.0) as usize;
        let tile = tiles.entry(key).or_insert_with(TileCells::unknown);
        set_code(tile, place, code);
    }
    let mut store = TileStore::new(BootId([0; 16]), STORE_MB);
    store.set_grid(LayerGrid { layer, cell_m })?;
    for (key, cells) in tiles {
        drop(store.publish(key, cells)?);
    }
    Ok(store)
}

/// Room for 30,000 tiles.
const STORE_MB: u32 = 256;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_where_they_were_put() {
        let height = |metres| LayerId::Elevation.quantisation().encode(metres);
        let cells = [([-1, 64], height(0.5)), ([3, -70], height(-1.0))];
        let store = store_of(LayerId::Elevation, 0.5, cells).unwrap();
        let picture = Picture::of_layer(&store, elevation(), None, "truth", "the truth").unwrap();
        let Some(Image::Layer { raster, .. }) = picture.map(|picture| picture.image) else {
            panic!("no picture");
        };
        assert_eq!(raster.value_at(-0.25, 32.25), Some(0.5));
        assert_eq!(raster.value_at(1.75, -34.75), Some(-1.0));
        assert_eq!(raster.known_codes().count(), 2);
        let nothing = store_of(LayerId::Obstacle, 0.5, []).unwrap();
        assert_eq!(
            Picture::of_layer(&nothing, obstacle(), None, "a", "b").unwrap(),
            None
        );
    }
}
