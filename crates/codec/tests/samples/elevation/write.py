#!/usr/bin/env python3
"""Writes the elevation models beside this script, by GDAL.

    pip install rasterio==1.4.4 numpy==2.4.6
    crates/codec/tests/samples/elevation/write.py

Each has the heights of one formula, which the tests know as well, in 40 columns and 30 rows, or 70 by
50 where there are tiles. Where a model has a nodata value, a block of 5 by 4 pixels from column 8 and
row 6 on is missing.
"""

import pathlib

import numpy
import rasterio
from rasterio.transform import Affine

FOLDER = pathlib.Path(__file__).parent
DEGREES = Affine(0.001, 0, 12.5, 0, -0.001, 47.25)
METRES = Affine(30, 0, 500000, 0, -30, 5200000)


def heights(columns, rows):
    """Multiples of a quarter from -20 to 229.25."""
    y, x = numpy.mgrid[:rows, :columns]
    return ((x * x * 7 + y * 13 + x * y) % 998) / 4 - 20


def write(name, kind, size=(40, 30), scale=1, offset=0, nodata=None, **options):
    columns, rows = size
    stored = (heights(columns, rows) - offset) / scale
    if not kind.startswith("float"):
        stored = numpy.floor(stored)
    if kind == "int8":
        stored = numpy.minimum(stored, 127)
    if nodata is not None:
        stored[6:10, 8:13] = nodata
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": kind}
    with rasterio.open(FOLDER / name, "w", **profile, nodata=nodata, **options) as file:
        file.write(stored.astype(kind), 1)
        if (scale, offset) != (1, 0):
            file.scales, file.offsets = (scale,), (offset,)


def main():
    tiled = {"tiled": True, "blockxsize": 32, "blockysize": 16}
    of_tiles = {"size": (70, 50), **tiled}
    place = {"crs": "EPSG:4326", "transform": DEGREES}
    write("f32_tiled.tif", "float32", nodata=-9999, compress="deflate", predictor=3, **of_tiles, **place)
    write("f64_strips.tif", "float64", compress="lzw", predictor=3, crs="EPSG:32633", transform=METRES)
    write("f32_nan.tif", "float32", nodata=float("nan"), compress="zstd", predictor=2)
    write("i8.tif", "int8", nodata=-128)
    write("i16_strips.tif", "int16", nodata=-32768, compress="lzw", predictor=2)
    write("i32_big.tif", "int32", compress="deflate", predictor=2, bigtiff="yes", **of_tiles)
    write("u32.tif", "uint32", offset=-20, scale=0.25, endianness="big")
    write("u16_scaled.tif", "uint16", offset=-20, scale=0.25, nodata=65535)


if __name__ == "__main__":
    main()
