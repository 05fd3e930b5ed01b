# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metadata of products: producer, time, frame, inputs and quality.

The same fields are used in Zenoh attachments, DPM rows, HTTP responses and logs.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import datetime
from enum import StrEnum
from typing import Any

import msgpack

from cdff_common.clock import MAX_STAMP_NS, to_datetime
from cdff_common.errors import CdffError, CodecError, InputError, RefusedError
from cdff_common.geometry import checked_frame
from cdff_common.geometry.region import MAX_CORNERS

WIRE_VERSION = 1
#: Namespace of product ids: UUIDv5 of ``robot/dfpc/port/t1_ns/seq/config_hash``.
PRODUCT_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "urn:cdff:product")
#: Limits of what a sender can make a receiver decode: bytes of an attachment, characters of a signature.
_MAX_ATTACHMENT_BYTES = 1 << 20
_MAX_SIGNATURE = 4096
_QUALITY_FIELDS = frozenset({"status", "reasons", "covariance_kind", "metrics"})


class Status(StrEnum):
    """Usability of a result."""

    OK = "OK"
    DEGRADED = "DEGRADED"
    FAILED = "FAILED"


class CovarianceKind(StrEnum):
    """Origin of a covariance."""

    CALIBRATED = "calibrated"
    FORMAL = "formal"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Quality:
    """Quality of a result.

    Attributes
    ----------
    status : Status
        OK, DEGRADED (usable with the restrictions in ``reasons``) or FAILED (no value).
    reasons : tuple of str
        Short codes, e.g. ``few_inliers:12<30``.
    covariance_kind : CovarianceKind
        Origin of the covariance.
    metrics : mapping of str to float
        Counts, residuals, conditioning; units in the names. Never a run time.
    """

    status: Status = Status.OK
    reasons: tuple[str, ...] = ()
    covariance_kind: CovarianceKind = CovarianceKind.NONE
    metrics: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def from_reasons(
        cls,
        degraded: Sequence[str],
        kind: CovarianceKind = CovarianceKind.NONE,
        metrics: Mapping[str, float] | None = None,
        *,
        failed: Sequence[str] = (),
    ) -> Quality:
        """Return FAILED or DEGRADED if there are reasons for it, else OK; FAILED has no covariance."""
        status = Status.FAILED if failed else Status.DEGRADED if degraded else Status.OK
        return cls(status, (*failed, *degraded), CovarianceKind.NONE if failed else kind, metrics or {})

    @classmethod
    def failed(cls, *reasons: str, metrics: Mapping[str, float] | None = None) -> Quality:
        """Return FAILED with its reasons, without repetitions."""
        return cls(Status.FAILED, tuple(dict.fromkeys(reasons)), metrics=metrics or {})

    @classmethod
    def from_error(cls, error: CdffError, metrics: Mapping[str, float] | None = None) -> Quality:
        """Return FAILED with the reasons of a refusal; without any, with the message as reason."""
        kind = "refused" if isinstance(error, RefusedError) else "bad_input"
        reasons = getattr(error, "reasons", ()) or (f"{kind}:{error}",)
        return cls.failed(*reasons, metrics=metrics)

    def to_dict(self) -> dict[str, Any]:
        """Return the dict form for MessagePack and JSON."""
        return {
            "status": str(self.status),
            "reasons": list(self.reasons),
            "covariance_kind": str(self.covariance_kind),
            "metrics": {k: float(self.metrics[k]) for k in sorted(self.metrics)},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Quality:
        """Return the quality of a dict form; raises InputError on a wrong field."""
        try:
            return cls(
                status=Status(data["status"]),
                reasons=tuple(str(r) for r in data.get("reasons", ())),
                covariance_kind=CovarianceKind(data.get("covariance_kind", "none")),
                metrics={str(k): float(v) for k, v in data.get("metrics", {}).items()},
            )
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(f"quality {str(data)[:200]}: {type(error).__name__} {error}") from error


def worst(*statuses: Status) -> Status:
    """Return the worst of several statuses."""
    order = [Status.OK, Status.DEGRADED, Status.FAILED]
    return max(statuses, key=order.index, default=Status.OK)


def product_id(robot: str, dfpc: str, port: str, t1_ns: int, seq: int, config_hash: str) -> str:
    """Return the product id, a UUIDv5: equal for repetitions and replays of the same result."""
    return str(uuid.uuid5(PRODUCT_NAMESPACE, f"{robot}/{dfpc}/{port}/{t1_ns}/{seq}/{config_hash}"))


@dataclass(frozen=True, slots=True)
class Header:
    """Metadata of one product or sensor sample.

    Attributes
    ----------
    id : str
        UUID; for products that of ``product_id``.
    seq : int
        Sequence number of the samples of one producer and port, from 0.
    t0_ns, t1_ns : int
        Start and end of capture of the source data, mission time, multiples of 1000.
    frame : str
        Frame of the values; for a pose the parent.
    child : str or None
        For a pose the child frame.
    producer : str
        ``dfpc/implementation/version``, or the name of the sensor.
    config_hash : str
        Hash of the resolved configuration.
    inputs : tuple of str
        Ids of the source samples and products.
    quality : Quality
    box_m : tuple of 6 floats or None
        ``xmin ymin zmin xmax ymax zmax`` in ``frame``, metres, for the spatial index.
    resolution_m : float or None
        Cell or voxel size, metres.
    footprint_m : tuple of float or None
        ``x1 y1 x2 y2 …`` in ``frame``, metres: corners of the outline of the covered area, not closed.
    sha256 : str or None
        Hash of the payload, if enabled.
    signature : str or None
        Signature by the producer, see ``services.signatures``. Headers that differ in it only are equal,
        because the same product can be signed again.
    """

    id: str
    seq: int
    t0_ns: int
    t1_ns: int
    frame: str
    producer: str
    child: str | None = None
    config_hash: str = ""
    inputs: tuple[str, ...] = field(default=(), repr=False)
    quality: Quality = field(default_factory=Quality)
    box_m: tuple[float, float, float, float, float, float] | None = None
    resolution_m: float | None = None
    sha256: str | None = None
    footprint_m: tuple[float, ...] | None = field(default=None, repr=False)
    signature: str | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.t0_ns % 1000 or self.t1_ns % 1000 or self.t0_ns > self.t1_ns:
            raise InputError(f"capture {self.t0_ns}..{self.t1_ns}: expected multiples of 1000 ns, t0 <= t1")
        if self.t0_ns < -MAX_STAMP_NS or self.t1_ns > MAX_STAMP_NS:
            raise InputError(f"capture {self.t0_ns}..{self.t1_ns}: expected stamps that fit 64 bits")
        checked_frame(self.frame)
        if self.child is not None:
            checked_frame(self.child, "child")
        ring = self.footprint_m
        if ring is not None and (len(ring) % 2 or not 6 <= len(ring) <= 2 * MAX_CORNERS):
            raise InputError(
                f"footprint_m of {len(ring)} numbers: expected x, y of 3 to {MAX_CORNERS} corners"
            )

    @property
    def captured(self) -> datetime:
        """End of capture, UTC."""
        return to_datetime(self.t1_ns)

    def to_dict(self) -> dict[str, Any]:
        """Return the dict form with the public field names, without absent fields."""
        data: dict[str, Any] = {
            "v": WIRE_VERSION,
            "id": self.id,
            "seq": self.seq,
            "t0_ns": self.t0_ns,
            "t1_ns": self.t1_ns,
            "frame": self.frame,
            "producer": self.producer,
            "config_hash": self.config_hash,
            "inputs": list(self.inputs),
            "quality": self.quality.to_dict(),
        }
        optional = {
            "child": self.child,
            "box_m": None if self.box_m is None else list(self.box_m),
            "resolution_m": self.resolution_m,
            "footprint_m": None if self.footprint_m is None else list(self.footprint_m),
            "sha256": self.sha256,
            "signature": self.signature,
        }
        data.update({k: v for k, v in optional.items() if v is not None})
        return data

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Header:
        """Return the header of a dict form; raises InputError on a wrong field or another wire version."""
        if data.get("v") != WIRE_VERSION:
            raise InputError(f"header version {data.get('v')!r}: expected {WIRE_VERSION}")
        try:
            box, ring, inputs = data.get("box_m"), data.get("footprint_m"), data.get("inputs", ())
            if not isinstance(inputs, list | tuple):
                raise InputError(f"inputs {str(inputs)[:40]!r}: expected a list of product ids")
            if box is not None and len(box) != 6:
                raise InputError(f"box_m {box!r}: expected 6 numbers")
            return cls(
                id=str(uuid.UUID(data["id"])),
                seq=int(data["seq"]),
                t0_ns=int(data["t0_ns"]),
                t1_ns=int(data["t1_ns"]),
                frame=str(data["frame"]),
                child=data.get("child"),
                producer=str(data["producer"]),
                config_hash=str(data.get("config_hash", "")),
                inputs=tuple(str(i) for i in inputs),
                quality=Quality.from_dict(data["quality"]),
                box_m=None if box is None else tuple(float(x) for x in box),  # type: ignore[arg-type]
                resolution_m=None if data.get("resolution_m") is None else float(data["resolution_m"]),
                sha256=data.get("sha256"),
                footprint_m=None if ring is None else tuple(float(x) for x in ring),
                signature=_checked_signature(data.get("signature")),
            )
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(f"header: {type(error).__name__} {error}") from error

    def to_attachment(self) -> bytes:
        """Return the MessagePack bytes for the Zenoh attachment."""
        return bytes(msgpack.packb(self.to_dict()))

    @classmethod
    def from_attachment(cls, data: bytes, *, strict: bool = False) -> Header:
        """Return the header of attachment bytes; raises CodecError on malformed bytes.

        With ``strict`` an unknown field is refused (InputError) instead of ignored.
        """
        if len(data) > _MAX_ATTACHMENT_BYTES:
            raise CodecError(f"attachment of {len(data)} bytes: expected at most {_MAX_ATTACHMENT_BYTES}")
        try:
            unpacked = msgpack.unpackb(data)
        except (ValueError, msgpack.UnpackException, msgpack.ExtraData) as error:
            raise CodecError(f"attachment is not MessagePack: {error}") from error
        if not isinstance(unpacked, dict):
            raise CodecError(f"attachment contains a {type(unpacked).__name__}, expected a map")
        if strict:
            _check_fields("header", unpacked, _HEADER_FIELDS)
            quality = unpacked.get("quality")
            if isinstance(quality, dict):
                _check_fields("quality", quality, _QUALITY_FIELDS)
        return cls.from_dict(unpacked)


def _checked_signature(signature: object) -> str | None:
    if signature is not None and not (isinstance(signature, str) and len(signature) <= _MAX_SIGNATURE):
        raise InputError(f"signature: expected a text of at most {_MAX_SIGNATURE} characters")
    return signature


_HEADER_FIELDS = frozenset({"v", *(f.name for f in fields(Header))})


def _check_fields(subject: str, data: Mapping[Any, Any], known: frozenset[str]) -> None:
    unknown = sorted(str(name) for name in data if name not in known)
    if unknown:
        raise InputError(
            f"{subject}: unknown field {unknown[0][:80]!r}, expected some of {', '.join(sorted(known))}"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Product:
    """Result of a DFPC with its header.

    Attributes
    ----------
    robot, dfpc, port : str
        Source, i.e. the parts of its key.
    product : str
        Name in requests: ``pose``, ``dem``, ….
    type_name : str
        ASN.1 type of the value.
    value : Any
        A ``cdff_common.types`` object; None if the status is FAILED.
    """

    robot: str
    dfpc: str
    port: str
    product: str
    type_name: str
    header: Header
    value: Any
