# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/{bodies|place|robots|transact|withdraw|purge}``: bodies, anchors, robots, several changes."""

from __future__ import annotations

from cdff_common.bus import Reply, Request
from cdff_common.contract.parameters import Parameters
from cdff_common.contract.queries import (
    AnchoredFrameParameters,
    BodyParameters,
    IdParameters,
    WithdrawalParameters,
)
from services.dpm.bus.calls import body_map, parse_call
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.transactions import parse_changes
from services.dpm.queries.bodies import NewAnchor
from services.dpm.queries.store_queries import history_view


def bodies(dpm: Dpm, request: Request) -> Reply:
    """Return the bodies that were defined or have anchors, or any known body by ``name=``; with a payload
    define one.
    """
    parameters = parse_call(BodyParameters, request)
    if request.payload:
        return Reply.of(dpm.frames.define_body(body_map(request, "body"), f"{request.scope}/rpc"))
    if parameters.name is not None:
        return Reply.of(dpm.store.anchors.body(parameters.name).to_dict())
    return Reply.of({"bodies": [body.to_dict() for body in dpm.store.anchors.bodies().values()]})


def place(dpm: Dpm, request: Request) -> Reply:
    """Return the anchor of ``frame=``; with a payload set it."""
    parameters = parse_call(AnchoredFrameParameters, request)
    if request.payload:
        new = NewAnchor.parse(body_map(request, "anchor"))
        return Reply.of(dpm.frames.anchor(parameters.frame, new, f"{request.scope}/rpc"))
    return Reply.of(dpm.store.anchors.of(parameters.frame, history_view(parameters)).to_dict())


def robots_known(dpm: Dpm, request: Request) -> Reply:
    """Return the described robots: ``{robots}``."""
    parse_call(Parameters, request)
    return Reply.of({"robots": [robot.to_dict() for robot in dpm.store.robots.all()]})


def transact(dpm: Dpm, request: Request) -> Reply:
    """Apply several changes in one transaction; the reply ``{items}`` is sent after the commit."""
    parse_call(Parameters, request)
    changes = parse_changes(request.body(), dpm.writer.checked_product, f"{request.scope}/rpc")
    return Reply.of({"items": dpm.writer.transact(changes)})


def withdraw(dpm: Dpm, request: Request) -> Reply:
    """Remove products from all maps: ``{withdrawn, derived, robots, applied}``."""
    return Reply.of(dpm.withdrawal.run(parse_call(WithdrawalParameters, request)))


def purge(dpm: Dpm, request: Request) -> Reply:
    """Remove the payload of a deleted product: ``{id, bytes}``."""
    product_id = parse_call(IdParameters, request).id
    return Reply.of({"id": product_id, "bytes": dpm.writer.purge(product_id)})
