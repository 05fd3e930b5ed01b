# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm export``: what a search finds as files that others read, one for each product or all in one.

The suffix of the target says what is written: a folder holds each product in its type's first format and the outlines
of all as ``index_{frame}.geojson``, a file for each frame; one file is an assembled window (``tif``) or cloud (``ply
las laz pcd``), all poses as one trajectory (``tum``), all outlines (``geojson``), or the newest pose graph (``g2o``).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Reply, keys
from cdff_common.errors import InputError, ProductNotFoundError

#: What one file of each format is made from.
_WHOLE = {"tif": "dem", **dict.fromkeys(("ply", "las", "laz", "pcd"), "pointcloud"), "g2o": "pose_graph"}
SEARCH = ("type", "robot", "dfpc", "region", "frame", "t0", "t1", "tag", "as_of")
_TIMEOUT_S = 60.0
_PAGE = 500


def export(bus: Bus, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Write what a search finds; returns ``{file, bytes, products}`` of each file.

    Raises
    ------
    ProductNotFoundError
        If nothing was found.
    InputError
        If the target is of no format that can hold what was asked.
    """
    suffix = args.out.suffix.lower().lstrip(".")
    asked = {name: str(v) for name in SEARCH if (v := getattr(args, name)) is not None}
    if not suffix:
        return _folder(bus, args.out, asked, args.format)
    if suffix in _WHOLE:
        return [_whole(bus, args, suffix, asked)]
    if suffix == "tum":
        return [_poses(bus, args.out, asked)]
    if suffix == "geojson":
        items = list(_items(bus, asked))
        frames = sorted({item["frame"] for item in items})
        if len(frames) > 1:
            raise InputError(f"outlines in {', '.join(frames[:5])}: one file holds one frame; export into a folder")
        return [_written(args.out, _outlines(bus, items), len(items))]
    raise InputError(f"{args.out}: expected a folder, or a file of {', '.join((*_WHOLE, 'tum', 'geojson'))}")


def _folder(bus: Bus, folder: Path, asked: dict[str, str], wanted: str | None) -> list[dict[str, Any]]:
    from cdff_common.codecs.siblings import base_type
    from cdff_common.formats.payload import FORMATS

    folder.mkdir(parents=True, exist_ok=True)
    files, items = [], []
    for item in _items(bus, asked):
        known = FORMATS.get(base_type(item["type_name"]), ())
        if item["quality"]["status"] == "FAILED" or not known:
            continue
        form = wanted if wanted in known else known[0]
        name = f"{item['product']}_{item['robot']}_{item['t1_ns']}_{item['id'][:8]}.{form}"
        files.append(_written(folder / name, _get(bus, {"id": item["id"], "format": form}).payload, 1))
        items.append(item | {"file": name})
    for frame in sorted({item["frame"] for item in items}):
        here = [item for item in items if item["frame"] == frame]
        name = f"index_{frame.replace('/', '_')}.geojson"
        files.append(_written(folder / name, _outlines(bus, here), len(here)))
    return files


def _whole(bus: Bus, args: argparse.Namespace, suffix: str, asked: dict[str, str]) -> dict[str, Any]:
    product = _WHOLE[suffix]
    if asked.setdefault("type", product) != product:
        raise InputError(f"--type {asked['type']}: a {suffix} file holds a {product}")
    if product == "dem" and args.resolution_m is not None:
        asked["resolution_m"] = str(args.resolution_m)
    if product == "pointcloud":
        asked["points"] = str(args.points or 500_000)
    reply = _get(bus, {**asked, "format": suffix, "deliver": "inline"})
    return _written(args.out, reply.payload, len(reply.attachment.get("inputs", ())) or 1)


def _poses(bus: Bus, out: Path, asked: dict[str, str]) -> dict[str, Any]:
    """All poses and trajectories found as one, by time; of one child in one frame."""
    import numpy as np

    from cdff_common.formats.tum import read_tum, write_tum

    items = list(_items(bus, {"type": "pose,trajectory", **asked}))
    edges = sorted({(item["frame"], item["child"]) for item in items})
    if len(edges) > 1:
        names = ", ".join(f"{child} in {parent}" for parent, child in edges[:5])
        raise InputError(f"poses of {names}: a tum file holds one; name --robot, --dfpc or --type")
    read = [read_tum(_get(bus, {"id": item["id"], "format": "tum"}).payload) for item in items]
    stamps = np.concatenate([stamps for stamps, _ in read])
    matrices = np.concatenate([matrices for _, matrices in read])
    stamps, first = np.unique(stamps, return_index=True)
    return _written(out, write_tum(stamps, matrices[first]), len(items))


def _items(bus: Bus, asked: dict[str, str]) -> Iterator[dict[str, Any]]:
    """Metadata of all products found, oldest first, without derived ones; raises ProductNotFoundError without any."""
    parameters, found = {"order": "oldest", "limit": str(_PAGE), **asked}, False
    while True:
        page = bus.call(keys.dpm_rpc(keys.GROUND, "search"), parameters, timeout_s=_TIMEOUT_S).body()
        for item in page["items"]:
            if item["dfpc"] != "dpm":
                found = True
                yield item
        if page["cursor"] is None:
            break
        parameters["cursor"] = page["cursor"]
    if not found:
        raise ProductNotFoundError(f"nothing to export: no product of {asked or 'any kind'}")


def _get(bus: Bus, parameters: dict[str, str]) -> Reply:
    return bus.call(keys.dpm_rpc(keys.GROUND, "get"), parameters, timeout_s=_TIMEOUT_S)


def _outlines(bus: Bus, items: list[dict[str, Any]]) -> bytes:
    """Outlines of products of one frame, in its CRS."""
    from cdff_common.formats.geojson import outline, write_geojson

    placed = [item for item in items if item.get("box_m") is not None]
    frame = placed[0]["frame"] if placed else "site"
    features = []
    for item in placed:
        x0, y0, _, x1, y1, _ = item["box_m"]
        told = {name: item.get(name) for name in ("id", "product", "robot", "dfpc", "port", "frame", "child", "file")}
        told |= {"t0_ns": str(item["t0_ns"]), "t1_ns": str(item["t1_ns"]), "status": item["quality"]["status"]}
        ring = item.get("footprint_m") or [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
        features.append(outline(ring, {name: value for name, value in told.items() if value is not None}))
    place = bus.call(keys.dpm_rpc(keys.GROUND, "place"), {"frame": frame}, timeout_s=_TIMEOUT_S).body()
    return write_geojson(features, frame, place["wkt"])


def _written(path: Path, data: bytes, products: int) -> dict[str, Any]:
    from cdff_common.output import write_file

    write_file(path, data)
    return {"file": str(path), "bytes": len(data), "products": products}
