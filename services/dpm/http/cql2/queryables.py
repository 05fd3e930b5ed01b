# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Properties that filters and orders may use, with their types, as JSON Schema (OGC 19-079r2 §6)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.errors import InputError
from dpm_store.search.filters import Field

TEXT, NUMBER, TIME = "text", "number", "time"
_SCHEMAS: dict[str, dict[str, Any]] = {
    TEXT: {"type": "string"},
    NUMBER: {"type": "number"},
    TIME: {"type": "string", "format": "date-time"},
}
#: Names of the quality's metrics in filters, and those of the metrics themselves.
METRICS = "cdff:metric:"
_METRIC = re.compile(rf"{METRICS}([A-Za-z0-9_.]{{1,64}})\Z")
GEOMETRY = "geometry"


@dataclass(frozen=True, slots=True)
class Queryable:
    """A property of products.

    Attributes
    ----------
    field : Field
    kind : str
        ``TEXT``, ``NUMBER`` or ``TIME``, whose field is in nanoseconds.
    title : str
    """

    field: Field
    kind: str
    title: str


def _of(column: str, kind: str, title: str) -> Queryable:
    return Queryable(Field(column), kind, title)


#: Properties of STAC items.
STAC: Mapping[str, Queryable] = {
    "id": _of("id", TEXT, "Id"),
    "collection": _of("product", TEXT, "Product type"),
    "datetime": _of("t1_ns", TIME, "End of capture"),
    "start_datetime": _of("t0_ns", TIME, "Start of capture"),
    "end_datetime": _of("t1_ns", TIME, "End of capture"),
    "created": _of("inserted_ns", TIME, "Time of insertion"),
    "platform": _of("robot", TEXT, "Robot"),
    "gsd": _of("resolution_m", NUMBER, "Cell or voxel size, metres"),
    "processing:facility": _of("dfpc", TEXT, "DFPC"),
    "cdff:port": _of("port", TEXT, "Output port of the DFPC"),
    "cdff:type_name": _of("type_name", TEXT, "ASN.1 type"),
    "cdff:codec": _of("codec", TEXT, "Codec of the payload"),
    "cdff:frame": _of("frame", TEXT, "Frame of the values"),
    "cdff:child": _of("child", TEXT, "Child frame of a pose"),
    "cdff:status": _of("status", TEXT, "Quality: OK, DEGRADED or FAILED"),
    "cdff:covariance_kind": _of("covariance_kind", TEXT, "Kind of covariance"),
    "cdff:config_hash": _of("config_hash", TEXT, "Hash of the configuration"),
    "cdff:size": _of("size", NUMBER, "Size of the payload, bytes"),
}
#: Properties of features of OGC API Features.
FEATURES: Mapping[str, Queryable] = {
    "id": _of("id", TEXT, "Id"),
    "robot": _of("robot", TEXT, "Robot"),
    "dfpc": _of("dfpc", TEXT, "DFPC"),
    "port": _of("port", TEXT, "Output port of the DFPC"),
    "product": _of("product", TEXT, "Product type"),
    "type_name": _of("type_name", TEXT, "ASN.1 type"),
    "frame": _of("frame", TEXT, "Frame of the values"),
    "child": _of("child", TEXT, "Child frame of a pose"),
    "t0": _of("t0_ns", TIME, "Start of capture"),
    "t1": _of("t1_ns", TIME, "End of capture"),
    "status": _of("status", TEXT, "Quality: OK, DEGRADED or FAILED"),
    "resolution_m": _of("resolution_m", NUMBER, "Cell or voxel size, metres"),
    "zmin_m": _of("zmin_m", NUMBER, "Lowest z in the frame, metres"),
    "zmax_m": _of("zmax_m", NUMBER, "Highest z in the frame, metres"),
    "size_bytes": _of("size", NUMBER, "Size of the payload, bytes"),
}


def queryable(names: Mapping[str, Queryable], name: str) -> Queryable:
    """Return a property by name, with or without ``properties.``; raises InputError."""
    plain = name.removeprefix("properties.")
    known = names.get(plain)
    if known is not None:
        return known
    metric = _METRIC.match(plain)
    if metric is None:
        raise InputError(
            f"filter: unknown property {name[:80]!r}, expected one of {', '.join(names)}, "
            f"{METRICS}NAME or, in s_intersects, {GEOMETRY}"
        )
    return Queryable(Field(metric[1], is_metric=True), NUMBER, metric[1])


def schema(names: Mapping[str, Queryable], url: str, title: str) -> dict[str, Any]:
    """Return the JSON Schema of the properties that filters may use."""
    properties: dict[str, Any] = {
        name: {"title": known.title, **_SCHEMAS[known.kind]} for name, known in names.items()
    }
    properties[GEOMETRY] = {"title": "Outline", "format": "geometry-any"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": url,
        "type": "object",
        "title": title,
        "properties": properties,
        "patternProperties": {f"^{METRICS}": {"title": "Metric of the quality", "type": "number"}},
        "additionalProperties": False,
    }
