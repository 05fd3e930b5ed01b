# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the DPM does, whoever asks: Zenoh handlers and HTTP routes are thin covers of these."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cdff_common.clock import Clock
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import parse_encoding
from cdff_common.codecs.siblings import base_type, wire_type
from cdff_common.errors import CodecError, InputError, ProductNotFoundError, UnavailableError
from cdff_common.geodesy import Anchor, Body
from cdff_common.geometry import checked_frame
from cdff_common.interfaces.product import Header, Status
from dpm_store import Annotation, Event, Insertion, Page, Parcel, Plan, ProductRecord, Query, Rule, Store
from dpm_store.actor import actor, check_robot
from dpm_store.clouds import DERIVED_PORT as CLOUD_PORT
from dpm_store.events import CHANGES, Entry
from dpm_store.frames import EVERYTHING, Known
from dpm_store.maps import DERIVED_PORT, ElevationWindow
from dpm_store.patches import DERIVED_DFPC
from dpm_store.poses import EXTRAPOLATION_LIMIT_NS
from dpm_store.profile import elevation_profile
from dpm_store.provenance import MAX_GENERATIONS
from dpm_store.transaction import Change, Delete, Insert, Reanchor
from services.dpm.changes import told
from services.dpm.checks import FrameNames, check_header, check_value, whole_number
from services.dpm.convert import Converted, convert
from services.dpm.parameters import (
    GROUND,
    PRODUCT_TYPES,
    CloudRequest,
    ProfileRequest,
    WindowRequest,
    check_names,
    transform_of,
)
from services.dpm.tiles import Tiles

logger = logging.getLogger(__name__)

#: Events that this process makes and publishes; others it only keeps.
OWN_EVENTS = frozenset(CHANGES)
#: Answers larger than this are handed over by reference where the asker leaves it open (contract §5).
INLINE_BYTES = 1_000_000
#: Payloads up to this size are decoded before they are stored, so that what cannot be read is refused.
DECODED_BYTES = 16 << 20


@dataclass(frozen=True, slots=True)
class Answer:
    """A product as it was asked for: bytes, encoding or media type, and metadata that go with them.

    ``reference`` is the id to pull it by where it was too large to send at once.
    """

    body: Converted
    metadata: dict[str, Any]
    reference: str | None = None


class Dpm:
    """Operations on a store.

    Parameters
    ----------
    store : Store
    max_payload_bytes : int
        Larger insertions are refused.
    """

    def __init__(self, store: Store, max_payload_bytes: int = 256 << 20) -> None:
        self.store = store
        self.max_payload_bytes = max_payload_bytes
        self._lock = threading.Lock()
        self._frames = FrameNames(store)
        self.tiles = Tiles(store)
        self._listeners: list[Callable[[Event], None]] = []
        #: What others of this process count, told with the status.
        self.counted: dict[str, Callable[[], Mapping[str, int]]] = {}
        self._told = store.events.last_ordinal()
        self.counters = {
            "inserted": 0,
            "already": 0,
            "refused": 0,
            "updated": 0,
            "deleted": 0,
            "searches": 0,
            "gets": 0,
            "windows": 0,
        }

    @property
    def clock(self) -> Clock:
        """Mission clock."""
        return self.store.clock

    def listen(self, listener: Callable[[Event], None]) -> None:
        """Call ``listener`` with every event from now on, in order, after it is durable."""
        with self._lock:
            self._listeners.append(listener)

    def unlisten(self, listener: Callable[[Event], None]) -> None:
        """Stop calling ``listener``."""
        with self._lock:
            self._listeners = [known for known in self._listeners if known is not listener]

    def put(
        self, names: Mapping[str, str], payload: bytes, encoding: str, attachment: bytes
    ) -> tuple[Insertion, Header]:
        """Check and insert a product; durable when this returns.

        Parameters
        ----------
        names : mapping
            robot, dfpc, port, product.
        encoding : str
            As ``application/vnd.cdff+uper;Pointcloud/1``.
        attachment : bytes
            The header.

        Raises
        ------
        CodecError
            If header, encoding or payload cannot be read.
        InputError, ConflictError, StorageError
            As ``Store.put``.
        """
        return self.put_all(((names, payload, encoding, attachment),))[0]

    def put_all(self, given: Sequence[tuple[Mapping[str, str], bytes, str, bytes]]) -> list[tuple[Insertion, Header]]:
        """As ``put`` for several at once: all of them are stored, or none."""
        for names, *_ in given:
            check_robot(names["robot"])
        try:
            parcels = [self.parcel(*one) for one in given]
            insertions = self.store.put_all(parcels)
        except (InputError, KeyError):
            self._count("refused")
            raise
        for insertion in insertions:
            self._count(str(insertion))
        self._tell()
        return [(insertion, parcel.header) for insertion, parcel in zip(insertions, parcels, strict=True)]

    def parcel(self, names: Mapping[str, str], payload: bytes, encoding: str, attachment: bytes) -> Parcel:
        """A product of a put, checked; raises as ``put``."""
        if len(payload) > self.max_payload_bytes:
            raise InputError(f"payload of {len(payload)} bytes: expected at most {self.max_payload_bytes}")
        header = Header.from_attachment(attachment)
        check_header(header, self.clock.now_ns())
        self._frames.check_of_robot(header.frame, names["robot"])
        type_name, codec = parse_encoding(encoding)
        value = self._checked_value(names, header, type_name, codec, payload)
        if header.box_m is None and value is not None and (extent := value.extent_m()) is not None:
            header = _with_box(header, extent)
        return Parcel(
            header, payload, names["robot"], names["dfpc"], names["port"], names["product"], type_name, codec, value
        )

    def delete(self, product_id: str, if_match: int | None = None) -> bool:
        """Leave a tombstone; False if it was deleted before. StaleRevisionError if it is not at ``if_match``."""
        check_robot(self.store.get(product_id, deleted=True).robot)
        if if_match is None:
            deleted = self.store.delete(product_id)
        else:
            (outcome,) = self.store.transact([Delete(product_id, if_match)])
            deleted = outcome is True
        self._count("deleted")
        self._tell()
        return deleted

    def purge(self, product_id: str) -> int:
        """Remove the payload of a deleted product; bytes freed."""
        check_robot(self.store.get(product_id, deleted=True).robot)
        freed = self.store.purge(product_id)
        self._tell()
        return freed

    def transact(self, changes: Sequence[Change]) -> list[dict[str, Any]]:
        """Make several changes in one transaction, all or none; what each came to, as plain data."""
        for change in changes:
            check_robot(self._owner(change))
        outcomes = self.store.transact(changes)
        self._tell()
        return [told(outcome) for outcome in outcomes]

    def _owner(self, change: Change) -> str:
        if isinstance(change, Insert):
            return change.parcel.robot
        if isinstance(change, Reanchor):
            return change.frame.split("/")[0]
        try:
            return self.store.get(change.product_id, deleted=True).robot
        except ProductNotFoundError:  # it may come in the same transaction; who inserts it was looked at
            return getattr(actor(), "name", "")

    def retire(self, rules: Sequence[Rule], *, apply: bool = False) -> Plan:
        """What the rules let go; with ``apply`` it is deleted and its payloads are collected."""
        if not apply:
            return self.store.retention.plan(rules)
        check_robot(GROUND)
        plan = self.store.retention.apply(rules)
        self._tell()
        self.store.collect()
        return plan

    def update(self, product_id: str, changes: Mapping[str, Any], if_match: int | None, author: str = "") -> Annotation:
        """Change what is said of a product; see ``AnnotationTable.update``."""
        check_robot(self.store.get(product_id).robot)
        annotation = self.store.annotations.update(product_id, changes, if_match=if_match, author=author)
        self._count("updated")
        self._tell()
        return annotation

    def described(self, product_id: str) -> dict[str, Any]:
        """Metadata of a product with what is said of it."""
        record = self.store.get(product_id)
        return record.to_dict() | {"annotation": self.store.annotations.get(product_id).to_dict()}

    def search(self, query: Query) -> Page:
        """One page of products; raises FrameNotFoundError where the region's frame is not known."""
        self._count("searches")
        if query.region is not None:
            self._frames.check_known(query.frame)
        return self.store.search(query)

    def product(self, product_id: str, format_name: str | None = None, as_type: str | None = None) -> Answer:
        """A product by id, in a codec, file format or InFuse type."""
        self._count("gets")
        record = self.store.get(product_id)
        payload = self.store.payload(product_id)
        wkt = self.crs_wkt(record.header.frame, format_name)
        body = convert(record.type_name, record.codec, payload, format_name, as_type, record.header, wkt=wkt)
        return Answer(body, record.to_dict())

    def crs_wkt(self, frame: str, format_name: str | None) -> str | None:
        """CRS of a frame as WKT, for the formats that say one."""
        return self.store.places.of(frame).wkt if format_name in ("tif", "geojson") else None

    def newest(self, query: Query, format_name: str | None = None, as_type: str | None = None) -> Answer:
        """The newest product that a search finds and that has a value."""
        for record in self.search(query).items:
            if record.header.quality.status is not Status.FAILED:
                return self.product(record.id, format_name, as_type)
        raise ProductNotFoundError("no product of that kind" + (f" in {query.region.text}" if query.region else ""))

    def window(
        self, asked: WindowRequest, format_name: str | None = None, as_type: str | None = None, deliver: str = "auto"
    ) -> Answer:
        """An elevation window; stored and handed over by id where it is large or asked by reference.

        Raises
        ------
        UnavailableError
            If less of the region is covered than asked.
        """
        self._count("windows")
        window = self.elevation(asked)
        return self._derived(window, window.map, DERIVED_PORT, "dem", format_name, as_type, deliver)

    def cloud(
        self, asked: CloudRequest, format_name: str | None = None, as_type: str | None = None, deliver: str = "auto"
    ) -> Answer:
        """All points of a region in one frame, within a budget; stored and handed over by id as windows are."""
        self._count("windows")
        made = self.store.clouds.assemble(asked.query, asked.points)
        return self._derived(made, made.cloud, CLOUD_PORT, "pointcloud", format_name, as_type, deliver)

    def profile(self, asked: ProfileRequest) -> dict[str, Any]:
        """Elevation along a line, as plain data."""
        self._count("windows")
        return elevation_profile(self.store.maps, asked.query, asked.path_m, asked.step_m).to_dict()

    def _derived(
        self, made: Any, value: Any, port: str, product: str, format_name: str | None, as_type: str | None, deliver: str
    ) -> Answer:
        """A derived product inline, or stored and by id where it is large or asked by reference."""
        payload, wire = encode(value, "uper"), wire_type(value)
        wkt = self.crs_wkt(made.header.frame, format_name)
        body = convert(wire, "uper", payload, format_name, as_type, made.header, value=value, wkt=wkt)
        metadata = made.header.to_dict() | made.manifest() | {"robot": made.robot}
        if deliver == "inline" or (deliver == "auto" and len(body.data) <= INLINE_BYTES):
            return Answer(body, metadata)
        self.store.put(
            made.header, payload, robot=made.robot, dfpc=DERIVED_DFPC, port=port, product=product, type_name=wire,
            codec="uper", value=value,
        )  # fmt: skip
        self._tell()
        return Answer(Converted(b"", "", ""), metadata, made.header.id)

    def elevation(self, asked: WindowRequest) -> ElevationWindow:
        """An elevation window as a value; raises UnavailableError below the coverage asked."""
        window = self.store.maps.elevation_window(asked.query)
        if window.coverage < asked.min_coverage:
            raise UnavailableError(f"coverage {window.coverage:.3f} of the region, asked {asked.min_coverage:.3f}")
        return window

    def pose(
        self, parent: str, child: str, t_ns: int | None, *, robot: str | None = None, limit_s: float | None = None,
        known: Known = EVERYTHING,
    ) -> dict[str, Any]:  # fmt: skip
        """``T_parent_child`` at a time (newest that is known without one), as plain data."""
        checked_frame(parent, "parent")
        checked_frame(child, "child")
        if t_ns is None:
            newest_ns = self.store.poses.newest_ns(parent, child, known=known)
            t_ns = self.clock.now_ns() if newest_ns is None else newest_ns
        limit_ns = None if limit_s is None else int(limit_s * 1e9)
        T = self.store.poses.at(t_ns, parent, child, limit_ns=limit_ns, known=known)
        covariance = None if T.covariance is None else T.covariance.tolist()
        return {
            "parent": parent, "child": child, "stamp_ns": t_ns, "T": T.matrix.tolist(), "covariance": covariance,
            "robot": robot or "", "frames_revision": self.store.frames.state() if known.state is None else known.state,
            "limit_s": (EXTRAPOLATION_LIMIT_NS if limit_ns is None else limit_ns) / 1e9,
        }  # fmt: skip

    def anchor(self, frame: str, body: Mapping[str, Any], producer: str = "") -> dict[str, Any]:
        """Place a frame on a body: ``{body, lon_deg, lat_deg, height_m?, azimuth_deg?, sigma_m?, sigma_deg?,
        expected_revision?}``; subscribers get a ``reanchored`` event.
        """
        checked_frame(frame)
        check_robot(frame.split("/")[0])
        numbers = ("lon_deg", "lat_deg", "height_m", "azimuth_deg", "sigma_m", "sigma_deg")
        check_names(body, frozenset({"body", "expected_revision", *numbers}), frozenset({"body", *numbers[:2]}))
        try:
            given = {name: float(body[name]) for name in numbers if name in body}
        except (TypeError, ValueError) as error:
            raise InputError(f"anchor of {frame}: expected numbers in {', '.join(numbers)}: {error}") from error
        sigmas = {name: given.pop(name) for name in numbers[4:] if name in given}
        place = Anchor(self.store.places.body(str(body["body"])), **given)
        revision = self.store.places.anchor(
            frame, place, **sigmas, producer=producer, expected_revision=body.get("expected_revision")
        )  # fmt: skip
        self._tell()
        return revision.to_dict()

    def define_body(self, body: Mapping[str, Any], producer: str = "") -> dict[str, Any]:
        """Enter a body that no authority lists, or a new revision of one; see ``Body.from_dict``."""
        check_robot(GROUND)
        new = Body.from_dict(body)
        revision = self.store.places.define(new, producer)
        self._tell()
        return new.to_dict() | {"revision": revision}

    def record(self, scope: str, kind: str, body: Mapping[str, Any]) -> None:
        """Enter an event of another service in the history; listeners hear of it as of ours."""
        self.store.events.append(scope, kind, body)
        self._tell()

    def record_from(self, origin: str, entries: Sequence[Entry]) -> int:
        """Enter another service's journal in the history, each entry once; see ``EventTable.append_from``."""
        last = self.store.events.append_from(origin, entries)
        self._tell()
        return last

    def history(self, since: int, limit: int, kinds: Sequence[str] = (), scope: str | None = None) -> dict[str, Any]:
        """Everything that happened after an event's ordinal: insertions, audit entries, other services' decisions."""
        return _listing(self.store.events.since(since, kind=kinds or None, scope=scope, limit=limit), since, limit)

    def set_frame(self, body: Mapping[str, Any], producer: str = "") -> dict[str, Any]:
        """Add a revision of a fixed frame; subscribers get a ``reanchored`` event."""
        try:
            frame, parent = str(body["frame"]), str(body["parent"])
        except KeyError as error:
            raise InputError(f"frame revision: {error} is missing") from error
        check_robot(frame.split("/")[0])
        revision = self.store.frames.set(
            frame, parent, transform_of(body), producer=producer or str(body.get("producer", "")),
            valid_from_ns=whole_number(body, "valid_from_ns"), valid_until_ns=whole_number(body, "valid_until_ns"),
            expected_revision=whole_number(body, "expected_revision"),
        )  # fmt: skip
        self._tell()
        return revision.to_dict()

    def frames(self, known: Known = EVERYTHING) -> list[dict[str, Any]]:
        """The last revision of every fixed frame, as far as known."""
        return [revision.to_dict() for revision in self.store.frames.current(known.as_of_ns, known.state)]

    def changes(self, since: int, limit: int = 1000, kinds: Sequence[str] = CHANGES) -> dict[str, Any]:
        """What has changed after an event's ordinal; ``next`` is where to go on, itself where nothing has."""
        if not set(kinds) <= set(CHANGES) or not kinds:
            raise InputError(f"kind={','.join(kinds)[:80]!r}: expected some of {', '.join(CHANGES)}")
        events = self.store.events.since(since, kind=kinds, limit=limit)
        return _listing(events, since, limit)

    def provenance(self, product_id: str, direction: str = "up", depth: int = MAX_GENERATIONS) -> dict[str, Any]:
        """What a product was made from, or what was made from it, as plain data."""
        found = self.store.lineage(product_id, direction, depth)
        items = []
        for generation, ids in enumerate(found.generations, 1):
            for i in ids:
                record = found.records.get(i)
                known = {"known": False} if record is None else {"known": True, **_summary(record)}
                items.append({"id": i, "generation": generation, **known})
        links = [{"product": made, "input": used} for made, used in found.links]
        return {
            "id": product_id, "direction": str(found.direction), "items": items, "links": links,
            "truncated": found.truncated,
        }  # fmt: skip

    def status(self) -> dict[str, Any]:
        """Counts and sizes, as plain data."""
        s = self.store.statistics()
        by_robot: dict[str, dict[str, int]] = {}
        for (robot, product), count in sorted(s.products.items()):
            by_robot.setdefault(robot, {})[product] = count
        bytes_by_robot: dict[str, dict[str, int]] = {}
        for (robot, product), size in sorted(s.product_bytes.items()):
            bytes_by_robot.setdefault(robot, {})[product] = size
        return {
            "products": s.count, "by_robot": by_robot, "payload_bytes": s.payload_bytes,
            "payloads": s.payloads, "stored_bytes": s.stored_bytes, "free_bytes": s.free_bytes,
            "bytes_by_robot": bytes_by_robot, "newest_t1_ns": s.newest_t1_ns,
            "events": s.events, "now_ns": self.clock.now_ns(), "counters": dict(self.counters),
            **{name: dict(counts()) for name, counts in self.counted.items()},
        }  # fmt: skip

    def payload(self, product_id: str, offset: int = 0, length: int | None = None) -> tuple[ProductRecord, bytes]:
        """Bytes as they are stored, from an offset on."""
        self._count("gets")
        return self.store.get(product_id), self.store.payload(product_id, offset, length)

    def _checked_value(
        self, names: Mapping[str, str], header: Header, type_name: str, codec: str, payload: bytes
    ) -> Any:
        product = names["product"]
        if product not in PRODUCT_TYPES:
            raise InputError(f"product={product[:80]!r}: expected one of {', '.join(PRODUCT_TYPES)}")
        wanted = PRODUCT_TYPES[product]
        if wanted is not None and base_type(type_name) != wanted:
            raise InputError(f"a {product} is stored as {wanted}, this is a {type_name}")
        if (header.quality.status is Status.FAILED) != (not payload):
            raise InputError(
                f"{header.quality.status} with {len(payload)} bytes: FAILED has no payload, others have one"
            )
        if not payload or len(payload) > DECODED_BYTES:
            return None
        value = decode(type_name, payload, codec)
        check_value(value, header)
        if product == "pose" and (header.frame, header.child) != (value.parent_frame, value.child_frame):
            raise CodecError(
                f"pose of {value.child_frame} in {value.parent_frame}, its header says {header.child} in {header.frame}"
            )
        return value

    def _count(self, what: str) -> None:
        with self._lock:
            self.counters[what] += 1

    def _tell(self) -> None:
        with self._lock:
            while events := self.store.events.since(self._told):
                self._told = events[-1].ordinal
                for event in events:
                    for listener in self._listeners:
                        listener(event)


def _listing(events: Sequence[Event], since: int, limit: int) -> dict[str, Any]:
    items = [{**e.body, "ordinal": e.ordinal, "stamp_ns": e.stamp_ns, "scope": e.scope, "kind": e.kind} for e in events]
    return {"items": items, "next": events[-1].ordinal if events else since, "more": len(events) == limit}


def _summary(record: ProductRecord) -> dict[str, Any]:
    header = record.header
    return {
        "robot": record.robot, "dfpc": record.dfpc, "port": record.port, "product": record.product,
        "t0_ns": header.t0_ns, "t1_ns": header.t1_ns, "producer": header.producer, "config_hash": header.config_hash,
        "status": str(header.quality.status), "deleted_ns": record.deleted_ns,
    }  # fmt: skip


def _with_box(header: Header, extent: Any) -> Header:
    from dataclasses import replace

    x0, y0, z0, x1, y1, z1 = (float(v) for v in extent)
    return replace(header, box_m=(x0, y0, z0, x1, y1, z1))
