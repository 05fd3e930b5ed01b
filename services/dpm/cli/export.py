# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm export``: the products of a search as files, one for each product or all in one.

The suffix of the target selects the content: a folder holds each product in its type's first format and the
outlines of all as ``index_{frame}.geojson``, a file for each frame; one file is an assembled window (``tif``)
or cloud (``ply las laz pcd``), all poses as one trajectory (``tum``), all outlines (``geojson``), or the
newest pose graph (``g2o``).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Reply, keys
from cdff_common.errors import InputError, ProductNotFoundError
from services.dpm.cli.commands import search_arguments

#: Product type of one file of each format.
_SINGLE_FILE = {
    "tif": "dem",
    **dict.fromkeys(("ply", "las", "laz", "pcd"), "pointcloud"),
    "g2o": "pose_graph",
}
_TIMEOUT_S = 60.0
#: Number of products in one answer of a search.
_PAGE = 500


def export(bus: Bus, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Write the products of a search; return ``{file, bytes, products}`` of each file.

    Raises
    ------
    ProductNotFoundError
        If no product matches.
    InputError
        If the format of the target cannot hold the products.
    """
    suffix = args.out.suffix.lower().lstrip(".")
    parameters = {name: str(value) for name, value in search_arguments(args).items()}
    if not suffix:
        return _folder(bus, args.out, parameters, args.format)
    if suffix in _SINGLE_FILE:
        return [_single_file(bus, args, suffix, parameters)]
    if suffix == "tum":
        return [_poses(bus, args.out, parameters)]
    if suffix == "geojson":
        items = list(_items(bus, parameters))
        frames = sorted({item["frame"] for item in items})
        if len(frames) > 1:
            raise InputError(
                f"outlines in {', '.join(frames[:5])}: one file holds one frame; export into a folder"
            )
        return [_write(args.out, _outlines(bus, items), len(items))]
    raise InputError(
        f"{args.out}: expected a folder, or a file of {', '.join((*_SINGLE_FILE, 'tum', 'geojson'))}"
    )


def _folder(
    bus: Bus, folder: Path, parameters: dict[str, str], format_name: str | None
) -> list[dict[str, Any]]:
    from cdff_common.codecs.wire_types import base_type
    from cdff_common.formats.payload import FORMATS

    folder.mkdir(parents=True, exist_ok=True)
    files, items = [], []
    for item in _items(bus, parameters):
        formats = FORMATS.get(base_type(item["type_name"]), ())
        if item["quality"]["status"] == "FAILED" or not formats:
            continue
        form = format_name if format_name in formats else formats[0]
        name = f"{item['product']}_{item['robot']}_{item['t1_ns']}_{item['id'][:8]}.{form}"
        files.append(_write(folder / name, _get(bus, {"id": item["id"], "format": form}).payload, 1))
        items.append(item | {"file": name})
    for frame in sorted({item["frame"] for item in items}):
        items_in_frame = [item for item in items if item["frame"] == frame]
        name = f"index_{frame.replace('/', '_')}.geojson"
        files.append(_write(folder / name, _outlines(bus, items_in_frame), len(items_in_frame)))
    return files


def _single_file(
    bus: Bus, args: argparse.Namespace, suffix: str, parameters: dict[str, str]
) -> dict[str, Any]:
    product = _SINGLE_FILE[suffix]
    if parameters.setdefault("type", product) != product:
        raise InputError(f"--type {parameters['type']}: a {suffix} file holds a {product}")
    if product == "dem" and args.resolution_m is not None:
        parameters["resolution_m"] = str(args.resolution_m)
    if product == "pointcloud":
        parameters["points"] = str(args.points or 500_000)
    reply = _get(bus, {**parameters, "format": suffix, "deliver": "inline"})
    return _write(args.out, reply.payload, len(reply.attachment.get("inputs", ())) or 1)


def _poses(bus: Bus, out: Path, parameters: dict[str, str]) -> dict[str, Any]:
    """Write the poses and trajectories of one child in one frame as one trajectory, by time."""
    import numpy as np

    from cdff_common.formats.tum import read_tum, write_tum

    items = list(_items(bus, {"type": "pose,trajectory", **parameters}))
    edges = sorted({(item["frame"], item["child"]) for item in items})
    if len(edges) > 1:
        names = ", ".join(f"{child} in {parent}" for parent, child in edges[:5])
        raise InputError(f"poses of {names}: a tum file holds one; name --robot, --dfpc or --type")
    trajectories = [read_tum(_get(bus, {"id": item["id"], "format": "tum"}).payload) for item in items]
    stamps = np.concatenate([stamps for stamps, _ in trajectories])
    matrices = np.concatenate([matrices for _, matrices in trajectories])
    stamps, first = np.unique(stamps, return_index=True)
    return _write(out, write_tum(stamps, matrices[first]), len(items))


def _items(bus: Bus, parameters: dict[str, str]) -> Iterator[dict[str, Any]]:
    """Yield the metadata of all products of a search, oldest first, except derived ones; raises
    ProductNotFoundError if there are none.
    """
    parameters, has_products = {"order": "oldest", "limit": str(_PAGE), **parameters}, False
    while True:
        page = bus.call(keys.dpm_rpc(keys.GROUND, "search"), parameters, timeout_s=_TIMEOUT_S).body()
        for item in page["items"]:
            if item["dfpc"] != "dpm":
                has_products = True
                yield item
        if page["cursor"] is None:
            break
        parameters["cursor"] = page["cursor"]
    if not has_products:
        raise ProductNotFoundError(f"nothing to export: no product of {parameters or 'any kind'}")


def _get(bus: Bus, parameters: dict[str, str]) -> Reply:
    return bus.call(keys.dpm_rpc(keys.GROUND, "get"), parameters, timeout_s=_TIMEOUT_S)


def _outlines(bus: Bus, items: list[dict[str, Any]]) -> bytes:
    """Return the outlines of products of one frame as GeoJSON in its CRS."""
    from cdff_common.formats.geojson import outline, write_geojson
    from cdff_common.geodesy import Georeference

    items_with_box = [item for item in items if item.get("box_m") is not None]
    frame = items_with_box[0]["frame"] if items_with_box else "site"
    features = []
    for item in items_with_box:
        x0, y0, _, x1, y1, _ = item["box_m"]
        properties = {
            name: item.get(name)
            for name in ("id", "product", "robot", "dfpc", "port", "frame", "child", "file")
        }
        properties |= {
            "t0_ns": str(item["t0_ns"]),
            "t1_ns": str(item["t1_ns"]),
            "status": item["quality"]["status"],
        }
        ring = item.get("footprint_m") or [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
        features.append(
            outline(ring, {name: value for name, value in properties.items() if value is not None})
        )
    location = bus.call(keys.dpm_rpc(keys.GROUND, "place"), {"frame": frame}, timeout_s=_TIMEOUT_S).body()
    return write_geojson(features, frame, Georeference.from_dict(location["georeference"]))


def _write(path: Path, data: bytes, products: int) -> dict[str, Any]:
    from cdff_common.output import write_file

    write_file(path, data)
    return {"file": str(path), "bytes": len(data), "products": products}
