# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM on the bus: contract §5's ``dpm/@rpc/…`` and ``dpm/product/{id}`` under every scope it serves."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from cdff_common.bus import Bus, Qos, Reply, Request, keys
from cdff_common.codecs.encoding import encoding_string
from cdff_common.errors import CdffError, InputError, rpc_code
from dpm_store import Event, Rule
from dpm_store.actor import Actor, acting
from dpm_store.events import CHANGES
from dpm_store.provenance import MAX_GENERATIONS
from services.dpm.delivering import Answer
from services.dpm.history import history
from services.dpm.model import bodies, place, purge, robots_known, transact
from services.dpm.operations import OWN_EVENTS, Dpm
from services.dpm.parameters import (
    GROUND,
    SEARCH,
    batch_of,
    check_names,
    cloud_request,
    integer,
    known_of,
    number,
    profile_request,
    revision_of,
    robot_under,
    search_query,
    stamp,
    window_request,
)
from services.dpm.refusals import Refusals
from services.dpm.retention import retention

logger = logging.getLogger(__name__)

#: Verbs that change something: with a body, or by themselves.
_WRITES = frozenset({"put", "put_all", "update", "frames", "bodies", "place", "transact"})
_WRITES_BARE = frozenset({"delete", "purge", "retention"})
_WORKERS = {"put": 4, "get": 4, "search": 4}
_GET = SEARCH | {
    "id", "format", "as", "deliver", "resolution_m", "max_age_s", "newest_after", "min_coverage", "choice",
    "disagreement", "points", "frames_revision",
}  # fmt: skip
#: Parameters of a window of dem, or of navigation_map with ``choice``.
_WINDOW = frozenset(
    {"type", "robot", "region", "frame", "region_frame", "resolution_m", "max_age_s", "newest_after", "min_coverage",
     "t1", "as_of", "frames_revision", "choice", "disagreement", "format", "as", "deliver", "request"}
)  # fmt: skip
#: Parameters that make a get of pointcloud an assembled cloud: ``points`` is its budget.
_CLOUD = frozenset(
    {"type", "robot", "region", "frame", "t0", "t1", "as_of", "frames_revision", "points", "format", "as", "deliver",
     "request"}
)  # fmt: skip
_PROFILE = frozenset(
    {"robot", "path", "step_m", "frame", "resolution_m", "t1", "as_of", "frames_revision", "choice", "disagreement",
     "request"}
)  # fmt: skip
_PUT = frozenset({"robot", "dfpc", "port", "product", "request"})
#: Longest part of a payload in one reply; a longer one is pulled in parts.
MAX_PART_BYTES = 16 << 20


def serve(bus: Bus, dpm: Dpm, robots: Sequence[str], rules: Sequence[Rule] = ()) -> None:
    """Declare everything on the bus, the liveliness tokens last; events go out from then on."""
    handlers: dict[str, Callable[[Dpm, Request], Reply]] = {
        "search": search, "get": get, "put": put, "put_all": put_all, "update": update, "delete": delete, "pose": pose,
        "frames": frames, "stat": stat, "changes": changes, "history": history, "provenance": provenance,
        "profile": profile, "bodies": bodies, "place": place, "robots": robots_known, "transact": transact,
        "purge": purge,
        "retention": lambda dpm, request: retention(dpm, rules, request),
    }  # fmt: skip
    scopes = [*robots, GROUND]
    refusals = Refusals(dpm)
    dpm.listen(functools.partial(_publish, bus))
    for scope in scopes:
        for verb, handler in handlers.items():
            answer = functools.partial(_as_scope, dpm, refusals, verb, handler)
            bus.serve(keys.dpm_rpc(scope, verb), answer, workers=_WORKERS.get(verb, 2))
        bus.serve(keys.dpm_product(scope, "*"), functools.partial(payload, dpm))
    for scope in scopes:
        bus.declare_alive(scope, "dpm")


def _as_scope(
    dpm: Dpm, refusals: Refusals, verb: str, handler: Callable[[Dpm, Request], Reply], request: Request
) -> Reply:
    """Answer as who asks: under its own keys a robot, under ``ground`` an operator. Refused writes are entered.

    Who may use which keys is for the router's access control to say: Zenoh does not tell who asks.
    """
    robot = request.scope != GROUND
    who = Actor(request.scope, "robot" if robot else "operator", "zenoh")
    try:
        with acting(who):
            answer = handler(dpm, request)
            return answer if isinstance(answer, Reply) else _acting_parts(who, answer)
    except CdffError as error:
        if verb in _WRITES_BARE or (verb in _WRITES and request.payload):
            refusals.enter(who, f"dpm/@rpc/{verb}", rpc_code(error)[0], str(error))
        raise


def _acting_parts(who: Actor, parts: Iterable[Reply]) -> Iterator[Reply]:
    """Parts of an answer, each made while ``who`` acts."""
    following = iter(parts)
    while True:
        with acting(who):
            part = next(following, None)
        if part is None:
            return
        yield part


def search(dpm: Dpm, request: Request) -> Reply:
    """Metadata of products: ``{items, cursor, unplaced_frames, frames_revision}``, ``distances_m`` of the nearest."""
    page = dpm.search(search_query(request.scope, request.parameters))
    return Reply.of({"items": [record.to_dict() for record in page.items], **page.told()})


def get(dpm: Dpm, request: Request) -> Reply:
    """One product: by ``id``; a window for ``type=dem``, or ``type=navigation_map`` with ``choice``; all points of a
    region for ``type=pointcloud`` with ``points``; else the newest that the search finds.
    """
    p = dict(request.parameters)
    check_names(p, _GET)
    format_name, as_type, deliver = p.get("format"), p.get("as"), p.get("deliver", "inline")
    if deliver not in ("auto", "inline", "reference"):
        raise InputError(f"deliver={deliver!r}: expected auto, inline or reference")
    if "id" in p:
        check_names(p, frozenset({"id", "format", "as", "deliver", "robot", "request"}))
        return _reply(dpm.product(p["id"], format_name, as_type))
    if p.get("type") == "dem":
        check_names(p, _WINDOW)
        asked = window_request(request.scope, p, dpm.clock.now_ns())
        return _reply(dpm.window(asked, format_name, as_type, deliver))
    if p.get("type") == "navigation_map" and "choice" in p:
        check_names(p, _WINDOW)
        asked = window_request(request.scope, p, dpm.clock.now_ns(), navigation=True)
        return _reply(dpm.navigation_window(asked, format_name, as_type, deliver))
    if p.get("type") == "pointcloud" and "points" in p:
        check_names(p, _CLOUD)
        return _reply(dpm.cloud(cloud_request(request.scope, p), format_name, as_type, deliver))
    check_names(p, SEARCH | {"format", "as", "deliver"}, frozenset({"type"}))
    query = search_query(request.scope, {k: v for k, v in p.items() if k in SEARCH})
    return _reply(dpm.newest(query, format_name, as_type))


def profile(dpm: Dpm, request: Request) -> Reply:
    """Elevation along a line: ``{distance_m, x_m, y_m, mean_m, sigma_m, count, …}``, nil where unobserved."""
    check_names(request.parameters, _PROFILE, frozenset({"path"}))
    return Reply.of(dpm.profile(profile_request(request.scope, request.parameters)))


def put(dpm: Dpm, request: Request) -> Reply:
    """Insert; the reply ``{id, result}`` comes after the commit."""
    check_names(request.parameters, _PUT, frozenset({"dfpc", "port", "product"}))
    robot = robot_under(request.scope, request.parameters) or (None if request.scope == GROUND else request.scope)
    if robot is None:
        raise InputError("robot is missing: under scope ground it is required")
    names = {"robot": robot, **{k: request.parameters[k] for k in ("dfpc", "port", "product")}}
    insertion, header = dpm.put(names, request.payload, request.encoding, request.attachment)
    return Reply.of({"id": header.id, "result": str(insertion)})


def put_all(dpm: Dpm, request: Request) -> Reply:
    """Insert several products in one transaction; the reply ``{items: [{id, result}]}`` comes after the commit."""
    check_names(request.parameters, frozenset({"robot", "request"}))
    robot = robot_under(request.scope, request.parameters) or (None if request.scope == GROUND else request.scope)
    stored = dpm.put_all(batch_of(request.body(), robot))
    return Reply.of({"items": [{"id": header.id, "result": str(insertion)} for insertion, header in stored]})


def update(dpm: Dpm, request: Request) -> Reply:
    """Change what is said of a product, made from revision ``if_match``; without a body what is said, with history."""
    p = request.parameters
    check_names(p, frozenset({"id", "if_match", "author", "robot", "request"}), frozenset({"id"}))
    if not request.payload:
        dpm.store.get(p["id"])
        history = dpm.store.annotations.history(p["id"])
        return Reply.of({"id": p["id"], "revisions": [a.to_dict() for a in history]})
    body = request.body()
    if not isinstance(body, Mapping):
        raise InputError(f"update: a {type(body).__name__}, expected a map")
    author = p.get("author") or f"{request.scope}/rpc"
    return Reply.of({"id": p["id"], **dpm.update(p["id"], body, revision_of(p.get("if_match")), author).to_dict()})


def delete(dpm: Dpm, request: Request) -> Reply:
    """Leave a tombstone, with ``if_match`` only of that revision; the reply is ``{id, deleted}``."""
    p = request.parameters
    check_names(p, frozenset({"id", "if_match", "robot", "request"}), frozenset({"id"}))
    if_match = revision_of(p["if_match"]) if "if_match" in p else None
    return Reply.of({"id": p["id"], "deleted": dpm.delete(p["id"], if_match)})


def pose(dpm: Dpm, request: Request) -> Reply:
    """``T_parent_child`` at ``t``: ``{parent, child, stamp_ns, T, covariance}``."""
    p = request.parameters
    check_names(p, frozenset({"robot", "t", "parent", "child", "limit_s", "as_of", "frames_revision", "request"}))
    robot = robot_under(request.scope, p) or (None if request.scope == GROUND else request.scope)
    child = p.get("child") or (f"{robot}/base" if robot else "")
    if not child:
        raise InputError("child is missing: name a frame, or a robot whose base is meant")
    t_ns = stamp(p, "t")
    limit_s = number(p, "limit_s", low=0.0, high=3600.0)
    return Reply.of(dpm.pose(p.get("parent", "site"), child, t_ns, robot=robot, limit_s=limit_s, known=known_of(p)))


def frames(dpm: Dpm, request: Request) -> Reply:
    """Without a body the frames there are, ``frame=`` its revisions; with a MessagePack body a new revision."""
    p = request.parameters
    check_names(p, frozenset({"frame", "as_of", "frames_revision", "robot", "request"}))
    if request.payload:
        body = request.body()
        if not isinstance(body, Mapping):
            raise InputError(f"frame revision: a {type(body).__name__}, expected a map")
        return Reply.of(dpm.set_frame(body, producer=f"{request.scope}/rpc"))
    if "frame" in p:
        return Reply.of({"revisions": [r.to_dict() for r in dpm.store.frames.revisions(p["frame"])]})
    return Reply.of({"frames": dpm.frames(known_of(p)), "frames_revision": dpm.store.frames.state()})


def changes(dpm: Dpm, request: Request) -> Reply:
    """What has changed after event ``since``: ``{items, next, more}``."""
    p = request.parameters
    check_names(p, frozenset({"since", "kind", "limit", "robot", "request"}))
    limit = integer(p, "limit", low=1, high=1000) or 1000
    kinds = tuple(p["kind"].split(",")) if "kind" in p else CHANGES
    return Reply.of(dpm.changes(integer(p, "since") or 0, limit, kinds))


def provenance(dpm: Dpm, request: Request) -> Reply:
    """What a product was made from (``direction=up``), or what was made from it (``down``)."""
    p = request.parameters
    check_names(p, frozenset({"id", "direction", "depth", "robot", "request"}), frozenset({"id"}))
    depth = integer(p, "depth", low=1, high=MAX_GENERATIONS) or MAX_GENERATIONS
    return Reply.of(dpm.provenance(p["id"], p.get("direction", "up"), depth))


def stat(dpm: Dpm, request: Request) -> Reply:
    """Counts and sizes."""
    check_names(request.parameters, frozenset({"robot", "request"}))
    return Reply.of(dpm.status())


def payload(dpm: Dpm, request: Request) -> Reply:
    """Bytes of a product as they are stored, ``offset=`` and ``len=`` for a part."""
    p = request.parameters
    check_names(p, frozenset({"offset", "len", "request"}))
    product_id = request.key.rsplit("/", 1)[-1]
    offset = integer(p, "offset") or 0
    length = integer(p, "len", low=1)
    record, data = dpm.payload(product_id, offset, min(length or MAX_PART_BYTES, MAX_PART_BYTES))
    attachment = record.to_dict() | {"kind": "product", "offset": offset, "len": len(data), "size": record.size}
    return Reply(data, encoding_string(record.type_name, record.codec), attachment)


def _reply(answer: Answer) -> Reply:
    if answer.reference is not None:
        return Reply.of({"id": answer.reference}, **answer.metadata | {"kind": "reference", "id": answer.reference})
    return Reply(answer.body.data, answer.body.encoding, answer.metadata | {"kind": "product"})


def _publish(bus: Bus, event: Event) -> None:
    if event.kind not in OWN_EVENTS:
        return
    body: dict[str, Any] = {"ordinal": event.ordinal, "stamp_ns": event.stamp_ns, **event.body}
    bus.publish_map(keys.event(event.scope, event.kind), body, qos=Qos.CONTROL)
