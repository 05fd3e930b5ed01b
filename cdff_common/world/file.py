# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A world in one file: a MessagePack map whose values are encoded by the codec ``msgpack``."""

from __future__ import annotations

from typing import Any

import msgpack

from cdff_common.codecs import decode, encode
from cdff_common.codecs.wire_types import wire_type
from cdff_common.errors import CdffError, CodecError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from cdff_common.world.world import World, WorldEdge, WorldItem

FORMAT, VERSION = "cdff world", 1


def write_world(world: World) -> bytes:
    """Return the file of a world."""
    data: bytes = msgpack.packb(
        {
            "format": FORMAT,
            "version": VERSION,
            "stamp_ns": world.stamp_ns,
            "edges": [_edge_to_dict(edge) for edge in world.edges],
            "items": [_item_to_dict(item) for item in world.items],
            "omitted": dict(world.omitted),
        }
    )
    return data


def read_world(data: bytes) -> World:
    """Return the world of a file.

    Raises
    ------
    CodecError
        If the bytes are not such a file, or of another version.
    """
    try:
        content = msgpack.unpackb(data)
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise CodecError(f"world: not MessagePack: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CodecError(
            f"world: expected a MessagePack map with format={FORMAT!r}, from cdff world show --out"
        )
    if content.get("version") != VERSION:
        raise CodecError(f"world: version {content.get('version')!r}, expected {VERSION}")
    try:
        return World(
            int(content["stamp_ns"]),
            tuple(_edge_from_dict(edge) for edge in content["edges"]),
            tuple(_item_from_dict(item) for item in content["items"]),
            {str(name): str(reason) for name, reason in content["omitted"].items()},
        )
    except CodecError:
        raise
    except (CdffError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise CodecError(f"world: {type(error).__name__} {error}") from error


def _edge_to_dict(edge: WorldEdge) -> dict[str, Any]:
    """Return an edge of the frame tree as plain data."""
    T = edge.transform
    return {
        "parent": edge.parent,
        "child": edge.child,
        "T": T.matrix.tolist(),
        "covariance": None if T.covariance is None else T.covariance.tolist(),
        "source": edge.source,
    }


def _edge_from_dict(data: dict[str, Any]) -> WorldEdge:
    transform = UncertainTransform(data["T"], data["covariance"])
    return WorldEdge(str(data["parent"]), str(data["child"]), transform, str(data["source"]))


def _item_to_dict(item: WorldItem) -> dict[str, Any]:
    """Return an item as plain data, its value encoded."""
    has_value = item.value is not None
    return {
        "name": item.name,
        "type": item.type_name,
        "wire_type": wire_type(item.value) if has_value else None,
        "frame": item.frame,
        "stamp_ns": item.stamp_ns,
        "value": encode(item.value, "msgpack") if has_value else None,
        "header": None if item.header is None else item.header.to_dict(),
    }


def _item_from_dict(data: dict[str, Any]) -> WorldItem:
    """Return the item of ``_item_to_dict``."""
    packed, header = data["value"], data["header"]
    return WorldItem(
        str(data["name"]),
        str(data["type"]),
        str(data["frame"]),
        int(data["stamp_ns"]),
        None if packed is None else decode(str(data["wire_type"]), packed, "msgpack"),
        None if header is None else Header.from_dict(header),
    )
