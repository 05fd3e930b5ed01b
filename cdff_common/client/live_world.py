# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""World of a running system: frames, poses and newest products of the DPM at a mission time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from cdff_common.codecs.wire_types import base_type
from cdff_common.contract.limits import MAX_PAGE
from cdff_common.errors import ExtrapolationError, FrameNotFoundError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from cdff_common.interfaces.registry import Registry
from cdff_common.world import World, WorldEdge, WorldItem

if TYPE_CHECKING:
    from cdff_common.client.client import Client

#: Call of the DPM with a verb and its parameters; returns the body of the reply.
DpmCall = Callable[[str, Mapping[str, object]], Any]


#: Refusals of a pose: NOT_FOUND is read from the bus as ProductNotFoundError, whatever was not found.
_NO_POSE = (ExtrapolationError, FrameNotFoundError, ProductNotFoundError)


def retrieve_world(client: Client, dpm: DpmCall, t_ns: int | None, *, values: bool) -> World:
    """Return the world at ``t_ns``, by default at the newest pose; see ``Client.world``."""
    if t_ns is None:
        newest = client.search("pose", limit=1)
        t_ns = int(newest[0]["t1_ns"] if newest else dpm("stat", {})["now_ns"])
    newest_by_port, pose_frames = _products(client, dpm, t_ns)
    items = [_item(client, product, values=values) for product in newest_by_port.values()]
    omitted: dict[str, str] = {}
    edges = [*_fixed_frame_revisions(dpm, t_ns), *_moving(dpm, t_ns, pose_frames, omitted)]
    return World.of(t_ns, edges, items, omitted)


def _products(
    client: Client, dpm: DpmCall, t_ns: int
) -> tuple[dict[str, Mapping[str, Any]], dict[tuple[str, str], str]]:
    """Return the newest products by name, and the parent and child of every pose with its name."""
    newest: dict[str, Mapping[str, Any]] = {}
    pose_frames: dict[tuple[str, str], str] = {}
    for robot, counts in dpm("stat", {})["by_robot"].items():
        for product_type in counts:
            for product_header in _newest(client, product_type, robot, t_ns):
                name = f"/{robot}/{product_header['dfpc']}.{product_header['port']}"
                if (
                    product_header.get("child")
                    and base_type(product_header["type_name"]) == "TransformWithCovariance"
                ):
                    pose_frames.setdefault((product_header["frame"], product_header["child"]), name)
                if int(product_header["t1_ns"]) <= t_ns and product_header["quality"]["status"] != "FAILED":
                    newest.setdefault(name, product_header)
    return newest, pose_frames


def _newest(client: Client, product: str, robot: str, t_ns: int) -> Iterator[Mapping[str, Any]]:
    """Yield the newest ``MAX_PAGE`` products of a type and robot; if there are more, those of each DFPC."""
    page = client.search(product, robot=robot, t1=t_ns, limit=MAX_PAGE)
    yield from page
    if len(page) == MAX_PAGE:
        for dfpc in sorted(Registry.default().dfpcs):
            yield from client.search(product, robot=robot, dfpc=dfpc, t1=t_ns, limit=MAX_PAGE)


def _item(client: Client, product_header: Mapping[str, Any], *, values: bool) -> WorldItem:
    """Return the newest product of a port as an item, with its value on request."""
    header = Header.from_dict(product_header)
    return WorldItem(
        f"/{product_header['robot']}/{product_header['dfpc']}.{product_header['port']}",
        base_type(str(product_header["type_name"])),
        header.frame,
        header.t1_ns,
        client.get(header.id).value if values else None,
        header,
    )


def _fixed_frame_revisions(dpm: DpmCall, t_ns: int) -> Iterator[WorldEdge]:
    """Yield the revision of each fixed frame that is valid at a time."""
    for newest in dpm("frames", {})["frames"]:
        revisions = [newest]
        if not _is_valid(newest, t_ns):
            revisions = dpm("frames", {"frame": newest["frame"]})["revisions"]
        valid = [revision for revision in revisions if _is_valid(revision, t_ns)]
        if valid:
            yield WorldEdge(valid[-1]["parent"], valid[-1]["frame"], _transform(valid[-1]))


def _is_valid(revision: Mapping[str, Any], t_ns: int) -> bool:
    start, end = revision["valid_from_ns"], revision["valid_until_ns"]
    return (start is None or start <= t_ns) and (end is None or t_ns < end)


def _moving(
    dpm: DpmCall, t_ns: int, pose_frames: Mapping[tuple[str, str], str], omitted: dict[str, str]
) -> Iterator[WorldEdge]:
    """Yield the poses of the moving frames, as the DPM interpolates them."""
    for (parent, child), name in sorted(pose_frames.items()):
        try:
            body = dpm("pose", {"parent": parent, "child": child, "t": t_ns})
        except _NO_POSE as error:
            omitted[f"{parent} to {child} by {name}"] = str(error)
            continue
        yield WorldEdge(parent, child, _transform(body), name)


def _transform(body: Mapping[str, Any]) -> UncertainTransform:
    return UncertainTransform(body["T"], body.get("covariance"))
