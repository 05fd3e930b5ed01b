# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Features and STAC items as GeoParquet 1.1 (https://geoparquet.org/releases/v1.1.0).

Each property is a column. Geometries are well-known binary in degrees on the body, longitude first
whatever the axis order of the CRS, as GeoParquet requires. Times are timestamps with microseconds, UTC.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import CdffError, InputError
from cdff_common.extras import import_extra
from cdff_common.geodesy import Body

MEDIA_TYPE = "application/vnd.apache.parquet"
#: Largest number of features or items in an exported file.
MOST_EXPORTED = 20_000
#: Version of the metadata of STAC GeoParquet.
_STAC_VERSION = "1.0.0"
_ARROW_TYPES = {"string": "string", "number": "float64", "integer": "int64"}
_TIMES = frozenset(("t0", "t1", "datetime", "start_datetime", "end_datetime"))


def check_support() -> None:
    """Raise InputError if the library that writes Parquet is not installed."""
    try:
        import_extra("pyarrow")
    except CdffError as error:
        raise InputError(f"f=parquet: not available on this server: {error}") from error


def write_features(
    body: Body | None,
    features: Sequence[tuple[str, BaseGeometry | None, Mapping[str, Any]]],
    columns: Mapping[str, str],
) -> bytes:
    """Return features as GeoParquet.

    Parameters
    ----------
    body : Body or None
        Body of the coordinates; None if no feature has a geometry.
    features : sequence of (id, geometry, properties)
        Geometries in degrees, longitude first.
    columns : mapping of str to str
        Types of the properties in JSON Schema.
    """
    pa = import_extra("pyarrow")
    data = {"id": pa.array([identifier for identifier, _, _ in features], pa.string())}
    for name, kind in columns.items():
        values = [properties.get(name) for _, _, properties in features]
        data[name] = (
            _times(values) if name in _TIMES else pa.array(values, pa.type_for_alias(_ARROW_TYPES[kind]))
        )
    return _file(data, [geometry for _, geometry, _ in features], body, {})


def write_items(
    body: Body | None, items: Sequence[Mapping[str, Any]], collections: Mapping[str, Mapping[str, Any]]
) -> bytes:
    """Return STAC items as STAC GeoParquet (https://stac-utils.github.io/stac-geoparquet).

    Parameters
    ----------
    body : Body or None
        Body of the coordinates; None if no item has a geometry.
    items : sequence of mapping
        Items of lists.
    collections : mapping of str to mapping
        The collections of the items by id, for the metadata of the file.
    """
    pa = import_extra("pyarrow")
    data = {
        name: pa.array([item[name] for item in items])
        for name in ("stac_version", "stac_extensions", "id", "collection", "links", "assets")
    }
    for name in sorted({name for item in items for name in item["properties"]}):
        values = [item["properties"].get(name) for item in items]
        data[name] = _times(values) if name in _TIMES else pa.array(values)
    geometries = [
        None if item["geometry"] is None else shapely.geometry.shape(item["geometry"]) for item in items
    ]
    metadata = {"version": _STAC_VERSION, "collections": collections}
    return _file(data, geometries, body, {"stac-geoparquet": json.dumps(metadata)})


def _file(
    data: dict[str, Any],
    geometries: Sequence[BaseGeometry | None],
    body: Body | None,
    metadata: Mapping[str, str],
) -> bytes:
    """Return a Parquet file with the columns ``data``, the geometries and their bounds."""
    pa = import_extra("pyarrow")
    parquet = import_extra("pyarrow.parquet")
    shapes = np.array(geometries, dtype=object)
    empty = np.array([shape is None for shape in geometries], dtype=bool)
    edges = ("xmin", "ymin", "xmax", "ymax")
    sides = [pa.array(side, pa.float64(), mask=empty) for side in shapely.bounds(shapes).reshape(-1, 4).T]
    data["bbox"] = pa.StructArray.from_arrays(sides, edges, mask=pa.array(empty))
    data["geometry"] = pa.array(shapely.to_wkb(shapes, byte_order=1).tolist(), pa.binary())
    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": sorted({shape.geom_type for shape in geometries if shape is not None}),
        "covering": {"bbox": {edge: ["bbox", edge] for edge in edges}},
    }
    if body is None:
        column["crs"] = None
    elif body.geographic_crs.to_authority(min_confidence=90) != ("EPSG", "4326"):
        column["crs"] = body.geographic_crs.to_json_dict()  # the default is longitude and latitude of WGS 84
    if not empty.all():
        column["bbox"] = [float(v) for v in shapely.total_bounds(shapes)]
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
    table = pa.table(data).replace_schema_metadata({"geo": json.dumps(geo), **metadata})
    sink = io.BytesIO()
    parquet.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def _times(texts: Sequence[str | None]) -> Any:
    """Return RFC 3339 times in UTC as an Arrow array."""
    pa = import_extra("pyarrow")
    stamps = np.array(
        [np.datetime64("NaT") if t is None else np.datetime64(t.removesuffix("Z")) for t in texts]
    )
    return pa.array(stamps.astype("datetime64[us]"), pa.timestamp("us", "UTC"))
