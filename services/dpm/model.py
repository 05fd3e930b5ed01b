# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/{bodies|place|robots|transact|purge}``: bodies and anchors, robots, several changes at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Reply, Request
from cdff_common.errors import InputError
from services.dpm.changes import changes_of
from services.dpm.operations import Dpm
from services.dpm.parameters import check_names, known_of


def bodies(dpm: Dpm, request: Request) -> Reply:
    """Bodies that were entered or anchored on, ``name=`` any that is known; with a body a definition of one."""
    p = request.parameters
    check_names(p, frozenset({"name", "robot", "request"}))
    if request.payload:
        return Reply.of(dpm.define_body(_map(request, "body"), f"{request.scope}/rpc"))
    if "name" in p:
        return Reply.of(dpm.store.places.body(p["name"]).to_dict())
    return Reply.of({"bodies": [body.to_dict() for body in dpm.store.places.bodies().values()]})


def place(dpm: Dpm, request: Request) -> Reply:
    """Where ``frame=`` is, ``as_of`` and ``frames_revision`` as asked; with a body it is anchored there."""
    p = request.parameters
    check_names(p, frozenset({"frame", "as_of", "frames_revision", "robot", "request"}), frozenset({"frame"}))
    if request.payload:
        return Reply.of(dpm.anchor(p["frame"], _map(request, "anchor"), f"{request.scope}/rpc"))
    return Reply.of(dpm.store.places.of(p["frame"], known_of(p)).to_dict())


def robots_known(dpm: Dpm, request: Request) -> Reply:
    """Robots that were described: ``{robots}``."""
    check_names(request.parameters, frozenset({"robot", "request"}))
    return Reply.of({"robots": [robot.to_dict() for robot in dpm.store.robots.all()]})


def transact(dpm: Dpm, request: Request) -> Reply:
    """Several changes in one transaction, all or none; the reply ``{items}`` comes after the commit."""
    check_names(request.parameters, frozenset({"robot", "request"}))
    author = f"{request.scope}/rpc"
    return Reply.of({"items": dpm.transact(changes_of(request.body(), dpm.parcel, author))})


def purge(dpm: Dpm, request: Request) -> Reply:
    """Remove the payload of a deleted product: ``{id, bytes}``."""
    check_names(request.parameters, frozenset({"id", "robot", "request"}), frozenset({"id"}))
    product_id = request.parameters["id"]
    return Reply.of({"id": product_id, "bytes": dpm.purge(product_id)})


def _map(request: Request, what: str) -> Mapping[str, Any]:
    body = request.body()
    if not isinstance(body, Mapping):
        raise InputError(f"{what}: a {type(body).__name__}, expected a map")
    return body
