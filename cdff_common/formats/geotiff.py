# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""GeoTIFF of maps and of single-band float images.

Written with float32 bands, nodata NaN, pixel-is-area, row 0 at ymax. The CRS is an engineering CRS named
after the frame, or that of its body; a frame that does not face north has rows that are rotated in it. Times,
layer names and the place in the frame are stored in the tags, so that maps are read back identically.
"""

from __future__ import annotations

import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CdffError, InputError, StorageError
from cdff_common.formats.file_source import Readable, Source, load
from cdff_common.raster.geometry import MAX_CELLS, GridGeometry
from cdff_common.raster.resample import area_means

if TYPE_CHECKING:
    from cdff_common.geodesy import Georeference
    from cdff_common.types import ElevationMap, NavigationMap

#: Bands of a ``dem``, in order.
DEM_BANDS = ("mean", "variance", "min", "max", "count", "age_s")
_FALLBACK_FRAME = "site"
#: Tag with cell size, xmin and ymax in the frame, of a file whose rows are rotated in its CRS.
_GRID_TAG = "CDFF_GRID_M"
#: Larger rasters are written in temporary files instead of memory, with a cache of GDAL of this size.
_IN_MEMORY_BYTES, _CACHE_MB = 32 << 20, 64
#: Relative difference of width and height up to which a cell is square.
_SQUARE_TOLERANCE = 1e-9


def engineering_crs(frame: str) -> str:
    """Return the WKT of a metric engineering CRS named after ``frame``: x east-like, y north-like."""
    return f'LOCAL_CS["{frame}",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'


def write_map(value: ElevationMap | NavigationMap, *, place: Georeference | None = None) -> bytes:
    """Return a map as GeoTIFF.

    Parameters
    ----------
    value : ElevationMap or NavigationMap
        The bands of an elevation map are those of ``DEM_BANDS`` that exist, followed by the auxiliary layers.
    place : Georeference, optional
        That of a frame that is anchored on a body; by default an engineering CRS named after the frame.
    """
    names = [
        *(n for n in DEM_BANDS if n in value.layer_names),
        *(n for n in value.layer_names if n not in DEM_BANDS),
    ]
    bands = {name: value.layer(name).astype(np.float32, copy=False) for name in names}
    tags = {
        "CDFF_TYPE": type(value).__name__,
        "CDFF_FRAME": value.geometry.frame,
        "CDFF_T0_NS": str(value.t0_ns),
        "CDFF_T1_NS": str(value.t1_ns),
    }
    dtypes = ",".join(value.layer(name).dtype.str.lstrip("<|") for name in names)
    return write_bands(bands, value.geometry, tags={**tags, "CDFF_DTYPES": dtypes}, place=place)


def read_map(
    source: Readable, type_name: str = "ElevationMap", *, frame: str | None = None
) -> ElevationMap | NavigationMap:
    """Read a map; a foreign GeoTIFF becomes an elevation map of its band ``mean``, else of its first band.

    If the cells of a foreign elevation model are not square, or their edges are not multiples of the cell
    size, its heights are averaged over the cells of a grid that meets both; the layer ``variance`` is then
    the variance of the heights within each cell.

    Parameters
    ----------
    source : bytes or path
    type_name : str
        ``ElevationMap`` or ``NavigationMap``.
    frame : str, optional
        Frame of a file without a frame name.

    Raises
    ------
    CodecError
        With the file name, if it is not a raster in rows from north to south or reverse, or its coordinates
        are not in metres.
    """
    from cdff_common.types import ElevationMap, NavigationMap

    s = load(source)
    raster = _read_raster(s)
    bands, tags = raster.bands, raster.tags
    if type_name not in ("ElevationMap", "NavigationMap"):
        raise InputError(f"type {type_name!r}: expected ElevationMap or NavigationMap")
    if tags.get("CDFF_TYPE", type_name) != type_name:
        raise s.error(f"contains a {tags['CDFF_TYPE']}, expected a {type_name}")
    dtypes = tags.get("CDFF_DTYPES", "").split(",")
    if len(dtypes) == len(bands) and all(re.fullmatch(r"[fiu][1248]", d) for d in dtypes):
        bands = {n: b.astype(d) for (n, b), d in zip(bands.items(), dtypes, strict=True)}
    frame = tags.get("CDFF_FRAME") or frame or _FALLBACK_FRAME
    try:
        if type_name == "ElevationMap" and "CDFF_TYPE" not in tags:
            geometry, bands = _elevation_on_grid(raster, frame)
        else:
            geometry = GridGeometry(frame, *raster.square_placement(), *raster.shape)
        map_class = ElevationMap if type_name == "ElevationMap" else NavigationMap
        t0_ns, t1_ns = int(tags.get("CDFF_T0_NS", "0")), int(tags.get("CDFF_T1_NS", "0"))
        return map_class.from_layers(geometry, bands, t0_ns=t0_ns, t1_ns=t1_ns)
    except (CdffError, ValueError) as error:
        raise s.error(str(error)) from error


def _elevation_on_grid(raster: _Raster, frame: str) -> tuple[GridGeometry, dict[str, NDArray[Any]]]:
    """Return the grid and the layers of a foreign elevation model; raises InputError."""
    if raster.unit_error:
        raise InputError(raster.unit_error)
    bands: dict[str, NDArray[Any]] = dict(raster.bands)
    if "mean" not in bands:
        bands = {"mean": next(iter(bands.values()))}
    cell_m = max(raster.width_m, raster.height_m)
    grid = GridGeometry.aligned(frame, cell_m, raster.bounds)
    is_square = abs(raster.width_m - raster.height_m) <= _SQUARE_TOLERANCE * cell_m
    if is_square and grid.shape == raster.shape:
        return grid, bands
    mean, variance = area_means(bands["mean"], raster.bounds, grid)
    return grid, {"mean": mean.astype(np.float32), "variance": variance.astype(np.float32)}


def write_bands(
    bands: Mapping[str, NDArray[Any]],
    geometry: GridGeometry | None = None,
    *,
    tags: Mapping[str, str] | None = None,
    place: Georeference | None = None,
    degrees: tuple[str, float, float, float, float] | None = None,
    cloud_optimized: bool = True,
) -> bytes:
    """Return a deflated GeoTIFF of float32 bands ``(rows, cols)``; without a geometry in pixel coordinates.

    Parameters
    ----------
    bands : mapping of str to array
    geometry : GridGeometry, optional
    tags : mapping, optional
        Tags of the file.
    place : Georeference, optional
        By default an engineering CRS named after the frame.
    degrees : tuple, optional
        Instead of a geometry: WKT of a geographic CRS, west and north edge, width and height of a cell,
        degrees.
    cloud_optimized : bool
        Write a COG: tiles of 256 cells, header first, and overviews by nearest neighbour, since a mean of
        variances or counts has no meaning.

    Raises
    ------
    StorageError
        If the temporary files of a large raster cannot be written.
    """
    import rasterio
    import rasterio.shutil
    from rasterio.io import MemoryFile

    if not bands:
        raise InputError("no bands to write")
    rows, cols = next(iter(bands.values())).shape
    packing = {"compress": "deflate", "predictor": 3}
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "dtype": "float32",
        "count": len(bands),
        "height": rows,
        "width": cols,
        "nodata": np.nan,
        "tiled": True,
        "blockxsize": 256,
        "blockysize": 256,
        **({} if cloud_optimized else packing),
    }
    tags = {"AREA_OR_POINT": "Area", **(tags or {})}
    if geometry is not None:
        r, x, y = geometry.resolution_m, geometry.xmin_m, geometry.ymax_m
        transform = rasterio.Affine(r, 0.0, x, 0.0, -r, y)
        wkt = engineering_crs(geometry.frame) if place is None else place.wkt
        profile["crs"] = rasterio.crs.CRS.from_wkt(wkt)
        if place is not None and not place.is_identity:
            (a, b, c), (d, e, f) = place.rows
            tags[_GRID_TAG] = " ".join(map(repr, (r, x, y)))
            transform = rasterio.Affine(a * r, -b * r, a * x + b * y + c, d * r, -e * r, d * x + e * y + f)
        profile["transform"] = transform
    if degrees is not None:
        wkt, west, north, width, height = degrees
        profile["crs"] = rasterio.crs.CRS.from_wkt(wkt)
        profile["transform"] = rasterio.Affine(width, 0.0, west, 0.0, -height, north)
    copied = {"driver": "COG", "blocksize": 256, "overview_resampling": "nearest", **packing}

    def fill(file: Any) -> None:
        for index, (name, band) in enumerate(bands.items(), start=1):
            file.write(np.asarray(band, dtype=np.float32), index)
            file.set_band_description(index, name)
        file.update_tags(**tags)

    with _quietly():
        if 4 * rows * cols * len(bands) > _IN_MEMORY_BYTES:
            try:
                with tempfile.TemporaryDirectory() as folder, rasterio.Env(GDAL_CACHEMAX=_CACHE_MB):
                    plain, packed_path = Path(folder) / "plain.tif", Path(folder) / "packed.tif"
                    with rasterio.open(plain, "w", BIGTIFF="IF_SAFER", **profile) as file:
                        fill(file)
                    if not cloud_optimized:
                        return plain.read_bytes()
                    rasterio.shutil.copy(plain, packed_path, **copied)
                    return packed_path.read_bytes()
            except (OSError, rasterio.errors.RasterioError) as error:
                raise StorageError(f"GeoTIFF of {rows} x {cols} cells: {error}") from error
        with MemoryFile() as memory:
            with memory.open(**profile) as file:
                fill(file)
            if not cloud_optimized:
                return bytes(memory.read())
            with MemoryFile() as packed, memory.open() as file:
                rasterio.shutil.copy(file, packed.name, **copied)
                return bytes(packed.read())


def read_bands(
    source: Readable | Source,
) -> tuple[dict[str, NDArray[np.float32]], tuple[float, float, float], dict[str, str]]:
    """Return the bands by name (else ``band1`` …; nodata as NaN), ``(resolution, xmin, ymax)``, and tags.

    Raises
    ------
    CodecError
        If it is not a raster, has more than 2**30 cells, or its cells are not square and in rows parallel to
        the x axis.
    """
    s = load(source)
    raster = _read_raster(s)
    try:
        return raster.bands, raster.square_placement(), raster.tags
    except InputError as error:
        raise s.error(str(error)) from error


@dataclass(frozen=True, slots=True, eq=False)
class _Raster:
    """Bands (rows, cols) from north to south and from west to east, with the placement of the cells."""

    bands: dict[str, NDArray[np.float32]]
    tags: dict[str, str]
    width_m: float  # of a cell along x
    height_m: float  # of a cell along y
    xmin_m: float
    ymax_m: float
    unit_error: str  # why the coordinates are not in metres; empty if they are, or their unit is unknown

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, cols = next(iter(self.bands.values())).shape
        return rows, cols

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Outer edges (xmin, ymin, xmax, ymax)."""
        rows, cols = self.shape
        ymin_m, xmax_m = self.ymax_m - rows * self.height_m, self.xmin_m + cols * self.width_m
        return self.xmin_m, ymin_m, xmax_m, self.ymax_m

    def square_placement(self) -> tuple[float, float, float]:
        """Return ``(resolution, xmin, ymax)``; raises InputError if the cells are not square."""
        if abs(self.width_m - self.height_m) > _SQUARE_TOLERANCE * self.width_m:
            raise InputError(f"cells of {self.width_m} x {self.height_m}: expected square cells")
        return self.width_m, self.xmin_m, self.ymax_m


def _read_raster(s: Source) -> _Raster:
    """Return the bands of a GeoTIFF and their placement; raises CodecError."""
    import rasterio
    from rasterio.io import MemoryFile

    try:
        # GeoTIFF only: other GDAL drivers follow references to files and hosts.
        with _quietly(), MemoryFile(s.data) as memory, memory.open(driver="GTiff") as file:
            if file.width * file.height * file.count > MAX_CELLS:
                raise s.error(
                    f"{file.count} bands of {file.height} x {file.width}, expected at most {MAX_CELLS} values"
                )
            size = file.width * file.height * sum(np.dtype(kind).itemsize for kind in file.dtypes)
            s.check_claim(size, f"{file.count} bands of {file.height} x {file.width}")
            tags = {str(k): str(v) for k, v in file.tags().items()}
            t = _grid_of(tags) or file.transform
            if t.b or t.d:
                raise s.error(
                    f"transform {tuple(t)[:6]}: expected rows parallel to the x axis; rotate it with gdalwarp"
                )
            names = [d or f"band{i}" for i, d in enumerate(file.descriptions, start=1)]
            if len(set(names)) != len(names):
                names = [f"band{i}" for i in range(1, file.count + 1)]
            stored_values = file.read(masked=True)
            scale, offset = (np.reshape(v, (-1, 1, 1)) for v in (file.scales, file.offsets))
            if np.any(scale != 1.0) or np.any(offset != 0.0):
                stored_values = stored_values * scale + offset
            stack = stored_values.astype(np.float32).filled(np.nan)
            unit_error = _unit_error(file.crs)
    except rasterio.errors.RasterioError as error:
        raise s.error(f"not a readable raster: {error}") from error
    # GDAL has already converted pixel-is-point to pixel-is-area. The identity is the transform of an image.
    xmin_m, ymax_m = float(t.c), float(t.f)
    if t.e > 0 and not t.is_identity:
        stack, ymax_m = stack[:, ::-1], ymax_m + t.e * stack.shape[1]
    if t.a < 0:
        stack, xmin_m = stack[:, :, ::-1], xmin_m + t.a * stack.shape[2]
    bands = dict(zip(names, np.ascontiguousarray(stack), strict=True))
    return _Raster(bands, tags, abs(float(t.a)), abs(float(t.e)), xmin_m, ymax_m, unit_error)


def _grid_of(tags: Mapping[str, str]) -> Any:
    """Return the transform of the cells in the frame that the writer has noted, None without one."""
    from rasterio import Affine

    try:
        r, xmin_m, ymax_m = map(float, tags[_GRID_TAG].split())
    except (KeyError, ValueError):
        return None
    is_valid = bool(np.isfinite([r, xmin_m, ymax_m]).all()) and r > 0.0
    return Affine(r, 0.0, xmin_m, 0.0, -r, ymax_m) if is_valid else None


def _unit_error(crs: Any) -> str:
    """Return why the coordinates of a CRS are not in metres, or an empty string."""
    if not crs:
        return ""
    if crs.is_geographic:
        return (
            "its coordinates are degrees of longitude and latitude, expected metres: project it, for example "
            "with `gdalwarp -t_srs EPSG:326NN -r bilinear IN OUT` (NN: UTM zone), or on another body with a "
            "local projection"
        )
    name, factor = crs.linear_units_factor if crs.is_projected else ("metre", 1.0)
    if abs(factor - 1.0) > 1e-9:
        return f"its coordinates are in {name}, expected metres: project it with gdalwarp -t_srs"
    return ""


@contextmanager
def _quietly() -> Iterator[None]:
    """Suppress rasterio's warning about rasters without georeference."""
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield
