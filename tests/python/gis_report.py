"""What GDAL makes of an exported folder, as JSON: its own validator of Cloud-Optimised GeoTIFF, values, and places.

Beside NAME.tif may stand what its values must be: NAME.f32, the cells row by row, or NAME.pgm, for Nav2's map server.
"""

import json
import sys
from pathlib import Path

import numpy
from osgeo import gdal, ogr, osr
from osgeo_utils.samples.validate_cloud_optimized_geotiff import ValidateCloudOptimizedGeoTIFFException, validate

gdal.UseExceptions()
ogr.UseExceptions()


def expected_cells(tiff: Path, values):
    """The values in the form of the file beside, and what that file holds; `None` without such a file."""
    if (raw := tiff.with_suffix(".f32")).exists():
        return values.astype("<f4").view("<u4"), numpy.fromfile(raw, "<u4").reshape(values.shape)
    if (pgm := tiff.with_suffix(".pgm")).exists():
        # By the thresholds of the YAML beside; unknown cells are NaN, or the class 0.
        trinary = numpy.where(values >= 0.65, 0, numpy.where(values <= 0.196, 254, 205))
        if values.dtype.kind != "f":
            trinary[values == 0] = 205
        return trinary, gdal.Open(str(pgm)).ReadAsArray()
    return None


def raster_report(path: Path) -> dict:
    try:
        warnings, errors, _ = validate(str(path), full_check=True)
    except ValidateCloudOptimizedGeoTIFFException as error:
        warnings, errors = [], [str(error)]
    raster = gdal.Open(str(path))
    band = raster.GetRasterBand(1)
    values = band.ReadAsArray()
    overviews = [band.GetOverview(index) for index in range(band.GetOverviewCount())]
    report = {
        "problems": warnings + errors,
        "size": [raster.RasterXSize, raster.RasterYSize],
        "block": band.GetBlockSize(),
        "overviews": [[overview.XSize, overview.YSize] for overview in overviews],
        "extremes": [level.ComputeRasterMinMax(False) for level in [band, *overviews]],
        "transform": raster.GetGeoTransform(),
        "crs": raster.GetProjection(),
        "method": raster.GetSpatialRef().GetAttrValue("PROJECTION"),
        "type": gdal.GetDataTypeName(band.DataType),
        "unit": band.GetUnitType(),
    }
    if cells := expected_cells(path, values):
        is_other = cells[0] != cells[1]
        report |= {"cells": int(is_other.size), "other_cells": int(is_other.sum())}
    return report


def signed_area(ring) -> float:
    return sum(x * v - u * y for (x, y, *_), (u, v, *_) in zip(ring, ring[1:])) / 2


def vector_report(path: Path) -> dict:
    source = ogr.Open(str(path))
    layer = source.GetLayer()
    crs = layer.GetSpatialRef()
    # A geometry goes with its feature.
    shapes = [feature.GetGeometryRef().Clone() for feature in layer]
    outer = [shape.GetGeometryRef(0).GetPoints() for shape in shapes if shape.GetGeometryName() == "POLYGON"]
    return {
        "crs": crs.GetName(),
        "shapes": [shape.GetGeometryName() for shape in shapes],
        "invalid": sum(not shape.IsValid() for shape in shapes),
        "clockwise": sum(signed_area(ring) < 0 for ring in outer),
        "extent": layer.GetExtent() if shapes else None,
    }


def place_error_m(folder: Path, crs: str) -> float:
    """Farthest distance of a pose in `odom` (TUM) from the point of the path on Earth, brought to the rasters' projection."""
    source = ogr.Open(str(folder / "trajectory.geojson"))
    path = source.GetLayer()
    poses = [tuple(map(float, line.split()[1:3])) for line in open(folder / "trajectory.tum")]
    lonlat = path.GetSpatialRef()
    lonlat.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    to_raster = osr.CoordinateTransformation(lonlat, osr.SpatialReference(wkt=crs))
    feature = path.GetNextFeature()
    points = [to_raster.TransformPoint(*point[:2], 0)[:2] for point in feature.GetGeometryRef().GetPoints()]
    return max(min(numpy.hypot(x - u, y - v) for u, v in poses) for x, y in points)


def main(folder: Path) -> dict:
    rasters = {path.name: raster_report(path) for path in sorted(folder.glob("*.tif"))}
    vectors = {path.name: vector_report(path) for path in sorted(folder.glob("*.geojson"))}
    report = {"gdal": gdal.__version__, "rasters": rasters, "vectors": vectors}
    crs = {raster["crs"] for raster in rasters.values()}
    if vectors.get("trajectory.geojson", {}).get("crs") == "WGS 84":
        report["place_error_m"] = place_error_m(folder, *crs)
    return report


json.dump(main(Path(sys.argv[1])), sys.stdout)
