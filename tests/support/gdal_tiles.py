# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``python gdal_tiles.py COLLECTION NAME=VALUE…``: a raster that the GDAL of pyogrio opens, as JSON.

pyogrio has no interface to rasters, so that its GDAL is called through the C interface. The script runs in a
process of its own, because rasterio contains another GDAL.
"""

import ctypes
import json
import sys
from pathlib import Path

import pyogrio

#: Flag of a raster, of reading, and the type of a byte (gdal.h).
_RASTER, _READ, _BYTE = 2, 0, 1

(library,) = (Path(pyogrio.__file__).parents[1] / "pyogrio.libs").glob("libgdal*")
gdal = ctypes.CDLL(str(library))
for function, result in {
    "GDALOpenEx": ctypes.c_void_p,
    "GDALGetRasterBand": ctypes.c_void_p,
    "GDALGetProjectionRef": ctypes.c_char_p,
    "GDALGetRasterXSize": ctypes.c_int,
    "GDALGetRasterYSize": ctypes.c_int,
}.items():
    getattr(gdal, function).restype = result
gdal.GDALAllRegister()
options = [text.encode() for text in sys.argv[2:]]
listed = (ctypes.c_char_p * (len(options) + 1))(*options, None)
opened = gdal.GDALOpenEx(sys.argv[1].encode(), ctypes.c_uint(_RASTER), None, listed, None)
if opened is None:
    sys.exit(f"{sys.argv[1]}: not opened as a raster")
dataset = ctypes.c_void_p(opened)
columns, rows = gdal.GDALGetRasterXSize(dataset), gdal.GDALGetRasterYSize(dataset)
alpha = (ctypes.c_ubyte * (columns * rows))()
band = ctypes.c_void_p(gdal.GDALGetRasterBand(dataset, 4))
error = gdal.GDALRasterIO(
    band, _READ, 0, 0, columns, rows, alpha, columns, rows, _BYTE, 0, 0
)  # all cells of the window, without resampling
observed = sum(value > 0 for value in alpha) / len(alpha)
crs = gdal.GDALGetProjectionRef(dataset).decode()
print(json.dumps({"size": [columns, rows], "crs": crs, "error": error, "observed": observed}))
