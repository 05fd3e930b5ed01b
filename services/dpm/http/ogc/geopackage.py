# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Features as GeoPackage 1.3 (OGC 12-128r18): an SQLite database with one table of features.

Coordinates are longitude and latitude on the body, x before y as the standard requires; features without a
place on the body have none. Outlines in frames are in the column ``outline_m``.
"""

from __future__ import annotations

import re
import sqlite3
import struct
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.geodesy import Body

MEDIA_TYPE = "application/geopackage+sqlite3"
#: "GPKG" in ASCII and version 1.3: the header of a GeoPackage (OGC 12-128).
_APPLICATION_ID, _VERSION = 0x47504B47, 10300
#: Identifier of a CRS other than EPSG:4326 in the file; EPSG codes are smaller.
_SRS_ID = 100_000
_TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY,
  organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL,
  description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL,
  identifier TEXT UNIQUE,
  description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER);
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
  geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  PRIMARY KEY (table_name, column_name));
"""
_UNDEFINED = (
    ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined", None),
    ("Undefined geographic SRS", 0, "NONE", 0, "undefined", None),
    (
        "WGS 84 geodetic",
        4326,
        "EPSG",
        4326,
        'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],'
        'UNIT["degree",0.0174532925199433]]',
        None,
    ),
)
_NAME = re.compile(r"[a-z][a-z0-9_]*\Z")


def write_geopackage(
    name: str,
    body: Body | None,
    features: Iterable[tuple[str, BaseGeometry | None, Mapping[str, Any]]],
    columns: Mapping[str, str],
) -> bytes:
    """Return a GeoPackage with one table.

    Parameters
    ----------
    name : str
        Name of the table: lower case letters, digits and ``_``.
    body : Body or None
        Body of the coordinates.
    features : iterable of (id, geometry, properties)
        Geometries in degrees, longitude first.
    columns : mapping of str to str
        SQL types of the properties.
    """
    assert _NAME.match(name)
    assert all(map(_NAME.match, columns))
    srs_id = -1 if body is None else _srs_id(body)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "features.gpkg"
        with closing(sqlite3.connect(path)) as database:
            database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
            database.execute(f"PRAGMA user_version = {_VERSION}")
            database.executescript(_TABLES)
            database.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _UNDEFINED)
            if body is not None and srs_id != 4326:
                database.execute(
                    "INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _srs(body, srs_id)
                )
            types = "".join(f', "{column}" {kind}' for column, kind in columns.items())
            key = "fid INTEGER PRIMARY KEY AUTOINCREMENT"
            database.execute(f'CREATE TABLE "{name}" ({key}, geom GEOMETRY, id TEXT{types})')
            bounds = _insert(database, name, srs_id, features, tuple(columns))
            database.execute(
                "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y, "
                "srs_id) VALUES (?, 'features', ?, ?, ?, ?, ?, ?)",
                (name, name, *bounds, srs_id),
            )
            database.execute(
                "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'GEOMETRY', ?, 0, 0)", (name, srs_id)
            )
            database.commit()
        return path.read_bytes()


def _insert(
    database: sqlite3.Connection,
    name: str,
    srs_id: int,
    features: Iterable[tuple[str, BaseGeometry | None, Mapping[str, Any]]],
    columns: Sequence[str],
) -> tuple[float | None, ...]:
    """Insert features; return their bounds."""
    rows, shapes = [], []
    for identifier, geometry, properties in features:
        data = None
        if geometry is not None:
            shapes.append(geometry)
            data = struct.pack("<2sBBi", b"GP", 0, 1, srs_id) + shapely.to_wkb(geometry, byte_order=1)
        rows.append((data, identifier, *(properties.get(column) for column in columns)))
    names = "".join(f', "{column}"' for column in columns)
    places = ", ".join("?" * (2 + len(columns)))
    database.executemany(f'INSERT INTO "{name}" (geom, id{names}) VALUES ({places})', rows)
    return tuple(float(v) for v in shapely.total_bounds(shapes)) if shapes else (None,) * 4


def _srs_id(body: Body) -> int:
    code = body.geographic_crs.to_authority(min_confidence=90)
    return 4326 if code == ("EPSG", "4326") else _SRS_ID


def _srs(body: Body, srs_id: int) -> tuple[str, int, str, int, str, None]:
    crs = body.geographic_crs
    authority, code = crs.to_authority(min_confidence=90) or ("NONE", srs_id)
    definition = crs.to_wkt("WKT1_GDAL")
    return crs.name, srs_id, str(authority), int(code), definition, None
