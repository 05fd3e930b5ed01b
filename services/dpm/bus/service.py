# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM on the bus: ``dpm/@rpc/…`` and ``dpm/product/{id}`` under every scope it serves."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from cdff_common.bus import Bus, Qos, Reply, Request, keys
from cdff_common.codecs import encoding_string
from cdff_common.contract.names import GROUND
from cdff_common.contract.parameters import Parameters
from cdff_common.contract.queries import (
    CloudParameters,
    DeliveryParameters,
    EventParameters,
    FrameParameters,
    IdParameters,
    NavigationWindowParameters,
    NewestParameters,
    PayloadParameters,
    PoseParameters,
    ProductProvenanceParameters,
    ProfileParameters,
    PutParameters,
    RevisionParameters,
    SearchParameters,
    UpdateParameters,
    WindowParameters,
)
from cdff_common.errors import CdffError, ClockSkewError, InputError, UnavailableError, rpc_code
from cdff_common.interfaces.profile import Profile
from dpm_store import Event, Rule, Store
from dpm_store.history.events import CHANGES, Actor, acting
from services.dpm.bus.alarms import acknowledge, alarms
from services.dpm.bus.bodies_and_robots import bodies, place, purge, robots_known, transact, withdraw
from services.dpm.bus.calls import body_map, parse_call, robot_under
from services.dpm.bus.history import history
from services.dpm.bus.retention import retention
from services.dpm.operations.dpm import OWN_EVENTS, Dpm
from services.dpm.operations.refusals import RefusalLog
from services.dpm.operations.retrieval import DeliveredProduct
from services.dpm.queries.bodies import FrameRevisionBody, parse_batch, parse_revision
from services.dpm.queries.store_queries import history_view

logger = logging.getLogger(__name__)

Handler = Callable[[Dpm, Request], Reply | Iterator[Reply]]

#: Verbs that change the store: with a body, or always.
_WRITES = frozenset({"put", "put_all", "update", "frames", "bodies", "place", "transact"})
_WRITES_BARE = frozenset({"delete", "purge", "withdraw", "retention", "acknowledge"})
_WORKERS = {"put": 4, "get": 4, "search": 4}
#: Time after which a call counts as hung, seconds; no caller waits so long. Retention reads and deletes much.
_BUSY_LIMIT_S, _RETENTION_LIMIT_S = 900.0, 7200.0
#: Largest part of a payload in one reply; larger payloads are fetched in parts.
MAX_PART_BYTES = 16 << 20


def serve(
    bus: Bus, dpm: Dpm, robots: Sequence[str], rules: Sequence[Rule] = (), *, worker: str = ""
) -> Callable[[str], None]:
    """Declare every key on the bus, the liveliness tokens last, and publish events from then on.

    A ``worker`` with this name answers the same calls as the DPM. It has one token and publishes no event.

    Returns
    -------
    callable
        Declares the keys of one more scope and its liveliness token, as for a robot that joins.
    """
    handlers: dict[str, Handler] = {
        "search": search,
        "get": get,
        "put": put,
        "put_all": put_all,
        "update": update,
        "delete": delete,
        "pose": pose,
        "frames": frames,
        "stat": stat,
        "changes": changes,
        "history": history,
        "provenance": provenance,
        "profile": profile,
        "terrain": terrain,
        "bodies": bodies,
        "place": place,
        "robots": robots_known,
        "transact": transact,
        "purge": purge,
        "withdraw": withdraw,
        "alarms": alarms,
        "acknowledge": acknowledge,
        "retention": lambda dpm, request: retention(dpm, rules, request),
    }
    refusals = RefusalLog(dpm)

    def declare(scope: str) -> None:
        for verb, handler in handlers.items():
            answer = functools.partial(_answer_as_scope, dpm, refusals, verb, handler)
            limit_s = _RETENTION_LIMIT_S if verb == "retention" else _BUSY_LIMIT_S
            workers = _WORKERS.get(verb, 2)
            bus.serve(keys.dpm_rpc(scope, verb), answer, workers=workers, busy_limit_s=limit_s)
        answer = functools.partial(_answer_as_scope, dpm, refusals, "payload", payload)
        bus.serve(keys.dpm_product(scope, "*"), answer, busy_limit_s=_BUSY_LIMIT_S)

    served = {*robots, GROUND}

    def serve_scope(scope: str) -> None:
        if scope not in served:
            served.add(scope)
            declare(scope)
        if not worker:
            bus.declare_alive(scope, "dpm")

    for scope in (*robots, GROUND):
        declare(scope)
    if worker:
        bus.declare_alive(GROUND, worker)
        return serve_scope
    dpm.events.listen(functools.partial(_publish, bus))
    for scope in (*robots, GROUND):
        bus.declare_alive(scope, "dpm")
    return serve_scope


def served_robots(profile: Profile | None, store: Store) -> tuple[str, ...]:
    """Return the robots for which the DPM answers calls: those of the profile, else those with products."""
    if profile is not None:
        return profile.robot_ids
    return tuple(sorted({robot for robot, _ in store.statistics().products} - {"ground"}))


def _answer_as_scope(
    dpm: Dpm, refusals: RefusalLog, verb: str, handler: Handler, request: Request
) -> Iterator[Reply]:
    """Answer as the actor of the scope: the robot, or an operator under ``ground``; record refused writes.

    Zenoh does not identify the caller: the router's access control decides who may use which keys. The memory
    of an answer stays charged until it is sent.
    """
    robot = request.scope != GROUND
    actor = Actor(request.scope, "robot" if robot else "operator", "zenoh")
    try:
        with acting(actor), dpm.budget.request():
            answer = handler(dpm, request)
            yield from [answer] if isinstance(answer, Reply) else answer
    except CdffError as error:
        if isinstance(error, ClockSkewError):  # it waits; an alarm reports it
            raise
        if verb in _WRITES_BARE or (verb in _WRITES and request.payload):
            refusals.enter(actor, f"dpm/@rpc/{verb}", rpc_code(error)[0], str(error))
        raise


def search(dpm: Dpm, request: Request) -> Reply:
    """Return metadata of products: ``{items, cursor, unplaced_frames, frames_revision}``, and ``distances_m``
    with ``order=nearest``.
    """
    page = dpm.retrieval.search(parse_call(SearchParameters, request))
    return Reply.of({"items": [record.to_dict() for record in page.items], **page.to_dict()})


def get(dpm: Dpm, request: Request) -> Reply:
    """Return one product.

    With ``id`` it is that product; with ``type=dem``, or ``type=navigation_map`` and ``choice``, a window;
    with ``type=pointcloud`` and ``points`` all points of a region; else the newest product of a search, or
    only its metadata if it is ``known``.
    """
    names = ("format", "as", "deliver")
    form = DeliveryParameters.parse({k: v for k, v in request.parameters.items() if k in names})
    p = {k: v for k, v in request.parameters.items() if k not in names}
    if "id" in p:
        return _reply(dpm.retrieval.product(parse_call(IdParameters, request, p).id, form))
    if "type" not in p:
        raise InputError("parameter 'type' is missing")
    parameters = {k: v for k, v in p.items() if k != "type"}
    match p["type"]:
        case "dem":
            return _reply(dpm.retrieval.window(parse_call(WindowParameters, request, parameters), form))
        case "navigation_map" if "choice" in p:
            window = parse_call(NavigationWindowParameters, request, parameters)
            return _reply(dpm.retrieval.navigation_window(window, form))
        case "pointcloud" if "points" in p:
            return _reply(dpm.retrieval.cloud(parse_call(CloudParameters, request, parameters), form))
        case _:
            return _reply(dpm.retrieval.newest(parse_call(NewestParameters, request, p), form))


def profile(dpm: Dpm, request: Request) -> Reply:
    """Return the elevation along a path: ``{distance_m, x_m, y_m, mean_m, sigma_m, count, …}``, nil where
    unobserved.
    """
    return Reply.of(dpm.retrieval.profile(parse_call(ProfileParameters, request)))


def terrain(dpm: Dpm, request: Request) -> Reply:
    """Return an ``analysis`` of the heights of a region, with the parameters of ``TERRAIN_ANALYSES``."""
    parameters = dict(request.parameters)
    robot_under(request.scope, parameters)
    parameters.pop("request", None)
    analysis = parameters.pop("analysis", None)
    if analysis is None:
        raise InputError("parameter 'analysis' is missing")
    return _reply(dpm.terrain.run(analysis, parameters))


def put(dpm: Dpm, request: Request) -> Reply:
    """Insert a product; the reply ``{id, result}`` is sent after the commit."""
    parameters = parse_call(PutParameters, request)
    robot = _robot_of(request)
    if robot is None:
        raise InputError("robot is missing: under scope ground it is required")
    names = {"robot": robot, "dfpc": parameters.dfpc, "port": parameters.port, "product": parameters.product}
    insertion, header = dpm.writer.put(names, request.payload, request.encoding, request.attachment)
    return Reply.of({"id": header.id, "result": str(insertion)})


def put_all(dpm: Dpm, request: Request) -> Reply:
    """Insert several products in one transaction; the reply ``{items: [{id, result}]}`` is sent after the
    commit.
    """
    parse_call(Parameters, request)
    stored = dpm.writer.put_all(parse_batch(request.body(), _robot_of(request)))
    return Reply.of({"items": [{"id": header.id, "result": str(insertion)} for insertion, header in stored]})


def update(dpm: Dpm, request: Request) -> Reply:
    """Change the annotation of a product at revision ``if_match``; without a body return its revisions."""
    parameters = parse_call(UpdateParameters, request)
    if not request.payload:
        dpm.store.get(parameters.id)
        revisions = dpm.store.annotations.history(parameters.id)
        return Reply.of({"id": parameters.id, "revisions": [a.to_dict() for a in revisions]})
    annotation = dpm.writer.update(
        parameters.id,
        body_map(request, "update"),
        parse_revision(parameters.if_match),
        parameters.author or f"{request.scope}/rpc",
    )
    return Reply.of({"id": parameters.id, **annotation.to_dict()})


def delete(dpm: Dpm, request: Request) -> Reply:
    """Delete a product, with ``if_match`` only if it is at that revision; the reply is ``{id, deleted}``."""
    parameters = parse_call(RevisionParameters, request)
    revision = None if parameters.if_match is None else parse_revision(parameters.if_match)
    return Reply.of({"id": parameters.id, "deleted": dpm.writer.delete(parameters.id, revision)})


def pose(dpm: Dpm, request: Request) -> Reply:
    """Return ``T_parent_child`` at ``t``: ``{parent, child, stamp_ns, T, covariance}``."""
    parameters = parse_call(PoseParameters, request)
    robot = _robot_of(request)
    child = parameters.child or (f"{robot}/base" if robot else "")
    if not child:
        raise InputError("child is missing: name a frame, or a robot whose base is meant")
    return Reply.of(
        dpm.frames.pose(
            parameters.parent,
            child,
            parameters.t,
            robot=robot,
            limit_s=parameters.limit_s,
            view=history_view(parameters),
        )
    )


def frames(dpm: Dpm, request: Request) -> Reply:
    """Return the frames, or with ``frame=`` its revisions; with a MessagePack body add a revision."""
    parameters = parse_call(FrameParameters, request)
    if request.payload:
        new = FrameRevisionBody.parse(body_map(request, "frame revision"))
        return Reply.of(dpm.frames.set_frame(new.frame, new, f"{request.scope}/rpc"))
    if parameters.frame is not None:
        return Reply.of({"revisions": [r.to_dict() for r in dpm.store.frames.revisions(parameters.frame)]})
    return Reply.of(
        {"frames": dpm.frames.current(history_view(parameters)), "frames_revision": dpm.store.frames.state()}
    )


def changes(dpm: Dpm, request: Request) -> Reply:
    """Return the changes after event ``since``: ``{items, next, more}``."""
    p = parse_call(EventParameters, request)
    return Reply.of(dpm.reports.changes(p.since, p.limit, p.kind or CHANGES))


def provenance(dpm: Dpm, request: Request) -> Reply:
    """Return the inputs of a product (``direction=up``), or its results (``down``)."""
    p = parse_call(ProductProvenanceParameters, request)
    return Reply.of(dpm.reports.provenance(p.id, p.direction, p.depth))


def stat(dpm: Dpm, request: Request) -> Reply:
    """Return counts and sizes."""
    parse_call(Parameters, request)
    return Reply.of(dpm.reports.status())


def payload(dpm: Dpm, request: Request) -> Reply:
    """Return the stored bytes of a product, ``offset=`` and ``len=`` for a part."""
    parameters = parse_call(PayloadParameters, request)
    product_id = request.key.rsplit("/", 1)[-1]
    record, data = dpm.retrieval.payload(
        product_id, parameters.offset, min(parameters.len or MAX_PART_BYTES, MAX_PART_BYTES)
    )
    part = {"kind": "product", "offset": parameters.offset, "len": len(data), "size": record.size}
    return Reply(data, encoding_string(record.type_name, record.codec), record.to_dict() | part)


def _robot_of(request: Request) -> str | None:
    """Return the robot of a call: its parameter, else the robot in the key."""
    robot = robot_under(request.scope, request.parameters)
    return robot or (None if request.scope == GROUND else request.scope)


def _reply(product: DeliveredProduct) -> Reply:
    if product.reference is None:
        return Reply(product.body.data, product.body.encoding, product.metadata | {"kind": "product"})
    reference = {"id": product.reference}
    return Reply.of(reference, **product.metadata | {"kind": "reference"} | reference)


def _publish(bus: Bus, event: Event) -> None:
    if event.kind not in OWN_EVENTS:
        return
    body: dict[str, Any] = {"ordinal": event.ordinal, "stamp_ns": event.stamp_ns, **event.body}
    try:
        bus.publish_map(keys.event(event.scope, event.kind), body, qos=Qos.CONTROL)
    except UnavailableError as error:  # the last products of the recorder, stored when the bus is closed
        logger.info("event %d: %s", event.ordinal, error)
