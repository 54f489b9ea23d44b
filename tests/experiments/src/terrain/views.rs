//! Pictures of a world and of the maps made of it.

use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::TerrainWorld;
use crate::ExperimentError;
use crate::pictures::{Picture, document_elevation, elevation, obstacle, store_of};
use edge::runtime::Pipeline;
use simulation::truth::GroundPlane;

/// The world as it truly is, seen from above: the greatest height in every cell above `plane`.
pub(crate) fn world_from_above(
    world: &TerrainWorld,
    plane: &GroundPlane,
    name: &str,
) -> Result<Vec<Picture>, ExperimentError> {
    let quantisation = LayerId::Elevation.quantisation();
    let cells = world.heights().iter().map(|(cell, heights)| {
        let top = heights.corners_m.iter().map(|&point| plane.height_m(point));
        let top_m = top.fold(f64::NEG_INFINITY, f64::max);
        (cell, quantisation.encode(top_m as f32))
    });
    let store = store_of(LayerId::Elevation, world.cell_m(), cells)?;
    let caption = format!("{}, the truth from above", world.world.name());
    let picture = Picture::of_layer(&store, elevation(), None, name, &caption)?;
    Ok(picture.into_iter().collect())
}

/// Elevation and obstacles as published, the former in the document's colours.
pub(crate) fn maps(
    pipeline: &Pipeline,
    name: &str,
    caption: &str,
) -> Result<Vec<Picture>, ExperimentError> {
    let vehicle = pipeline.mapper().vehicle_in_odom();
    let store = pipeline.publisher().store();
    maps_of(&store, Some([vehicle.x, vehicle.y]), name, caption)
}

/// The same of a store.
pub(crate) fn maps_of(
    store: &TileStore,
    vehicle_m: Option<[f64; 2]>,
    name: &str,
    caption: &str,
) -> Result<Vec<Picture>, ExperimentError> {
    let mut pictures = Vec::new();
    for palette in [document_elevation(), obstacle()] {
        let layer = palette.layer();
        if store.cell_m(layer).is_some() {
            let name = format!("{name}-{layer}");
            pictures.extend(Picture::of_layer(
                store, palette, vehicle_m, &name, caption,
            )?);
        }
    }
    Ok(pictures)
}

/// Elevation alone, in the colours that everybody can tell apart.
pub(crate) fn elevation_of(
    pipeline: &Pipeline,
    name: &str,
    caption: &str,
) -> Result<Vec<Picture>, ExperimentError> {
    let vehicle = pipeline.mapper().vehicle_in_odom();
    let store = pipeline.publisher().store();
    let vehicle_m = Some([vehicle.x, vehicle.y]);
    let name = format!("{name}-heights");
    let picture = Picture::of_layer(&store, elevation(), vehicle_m, &name, caption)?;
    Ok(picture.into_iter().collect())
}
