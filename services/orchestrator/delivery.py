# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From what was found to the final reply: frame, type, bytes, header, inline or by reference."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from cdff_common.bus import Reply
from cdff_common.bus.message import pack
from cdff_common.clock import Clock
from cdff_common.codecs import encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.codecs.siblings import wire_type
from cdff_common.errors import InputError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, product_id
from cdff_core.orchestration import translate
from cdff_core.orchestration.judge import delivered, judge
from cdff_core.orchestration.request import CODECS, PRODUCTS, ProductRequest
from services.orchestrator.dpm import Dpm
from services.orchestrator.finder import Found

#: Larger payloads go by reference unless ``deliver=inline`` (contract §5).
INLINE_BYTES = 1_000_000
_PRODUCER = "orchestrator/translate/1"
#: Two lookups of one edge that differ by more than this are of a moving edge.
_STILL_M = 1e-6
#: Stands for the type of a DEM that has more cells than a ``Map`` may have: it goes by reference as tif (contract §7).
_TOO_LARGE = "Map too large"
#: Gives ``T_parent_child`` at a time.
Lookup = Callable[[str, str, int], UncertainTransform]


@dataclass(frozen=True, slots=True, eq=False)
class Translated:
    """A value as it was asked for.

    Attributes
    ----------
    value : Any
        A ``cdff_common.types`` object of ``type_name``.
    frame, child : str
    reasons : tuple of str
        Codes of what the type cannot say.
    moved_by : UncertainTransform or None
        What its points were moved by: their error on top of their own.
    box_m : tuple or None
        Its extent in ``frame``, where the type itself does not say all of it.
    """

    value: Any
    type_name: str
    frame: str
    child: str | None = None
    reasons: tuple[str, ...] = ()
    moved_by: UncertainTransform | None = None
    box_m: tuple[float, float, float, float, float, float] | None = None


class TooOldError(UnavailableError):
    """What was found no longer meets what is mandatory: it has become too old since."""


class Delivery:
    """Makes the final reply of a job."""

    def __init__(self, dpm: Dpm, clock: Clock) -> None:
        self._dpm = dpm
        self._clock = clock

    def reply(
        self, job: str, request: ProductRequest, found: Found, until_s: float, held: float | None = None
    ) -> Reply:
        """Translate, encode and, where it is large or asked for, store and refer.

        ``held`` is the part of the region that the DPM held before the rest was made.

        Raises
        ------
        TooOldError
            If it no longer meets what is mandatory at the time of the reply.
        CdffError
            As the DPM answers, or where the product cannot be had in the asked frame or type.
        """
        robot = found.candidate.robot

        def lookup(parent: str, child: str, t_ns: int) -> UncertainTransform:
            return self._dpm.pose(robot, parent, child, t_ns, until_s)

        t = translated(request, found, lookup)
        native = PRODUCTS[request.product][0]
        as_is = t.type_name == native and t.frame == found.frame and not t.reasons
        whole = found.whole and as_is
        header = (
            found.sources[0] if whole or (as_is and request.product == "dem") else derived_header(request, found, t)
        )
        payload, encoding = _inline(request, t, found)
        digest = {} if payload is None else {"sha256": hashlib.sha256(payload).hexdigest()}
        if payload is None and not whole:
            header = self._store(request, found, t, header, until_s)
        # A reference is to the product's own type: that is what is delivered, whatever was asked.
        given = t.type_name if payload is not None else native
        now_ns = self._clock.now_ns()
        judgement = judge(found.candidate, request, now_ns)
        if judgement.missing:
            raise TooOldError("; ".join(judgement.missing))
        what = delivered(found.candidate, judgement, request, now_ns, t.frame)
        what["as"], what["differences"] = given, [*judgement.differences, *t.reasons]
        if given != request.type_name:
            what["differences"] = [*judgement.differences, *t.reasons, _kept_as(request, t, given)]
        what["source"] = found.sources[0].producer if found.sources else ""
        coverage = found.candidate.coverage
        if held is not None and coverage is not None:
            what["assembled"] = {
                "stored": round(min(held, coverage), 4),
                "made": round(max(coverage - held, 0.0), 4),
            }
        moved_by = t.moved_by or found.moved_by
        if moved_by is not None and moved_by.covariance is not None:
            what["frame_covariance"] = moved_by.covariance.tolist()
        extra = {"robot": robot, "job": job, "request": request.id, "final": True}
        extra |= {"asked": request.describe(), "delivered": what}
        if payload is not None:
            return Reply(payload, encoding, {**header.to_dict(), **digest, "kind": "product", **extra})
        form = request.format if t.type_name != _TOO_LARGE else "tif"
        body = {
            "id": header.id,
            "type": native,
            "encoding": encoding_string(wire_type(t.value) if t.type_name == native else native, "uper"),
            "format": form,
            "path": f"/api/v1/products/{header.id}/payload?format={form}",
        }
        return Reply(pack(body), "application/msgpack", {**header.to_dict(), "kind": "reference", **extra})

    def _store(self, request: ProductRequest, found: Found, t: Translated, header: Header, until_s: float) -> Header:
        """Have what was derived kept by the DPM, in the product's own type; the header it is kept with."""
        robot = found.candidate.robot
        if request.product == "dem":
            if t.frame != found.frame:
                raise UnavailableError(f"a DEM by reference stays in {found.frame}: ask for frame={found.frame}")
            region = None if found.region is None else found.region.text
            kept = self._dpm.stored_window(
                until_s,
                robot=robot if robot in found.robots else "any",
                region=region,
                frame=found.frame,
                resolution_m=request.resolution_m,
                t1=found.candidate.t1_ns,
            )
            return Header.from_dict(kept)
        if request.product == "pose":
            raise UnavailableError("a pose composed over the frame tree is not stored: ask for deliver=inline")
        self._dpm.put(header, t.value, t.type_name, robot, request.product, until_s)
        return header


def _kept_as(request: ProductRequest, t: Translated, given: str) -> str:
    """Say that a reference is to another type than was asked for, and how that one is had."""
    if t.type_name == _TOO_LARGE:
        return f"as: {given} by reference, asked {request.type_name}, which has no room for so many cells"
    return f"as: {given} by reference, asked {request.type_name}: get it with as={request.type_name} from the DPM"


def _inline(request: ProductRequest, t: Translated, found: Found) -> tuple[bytes | None, str]:
    """The payload and its encoding, None where it goes by reference."""
    if request.deliver == "reference" or t.type_name == _TOO_LARGE:
        return None, ""
    try:
        if request.format in CODECS and t.value is found.value and _as_it_came(request, t, found):
            payload, encoding = found.payload, found.encoding
        else:
            payload, encoding = encoded(t.value, t.type_name, request.format)
    except UnavailableError:
        if request.deliver == "inline":
            raise
        return None, ""  # the DPM writes the file
    return (None if len(payload) > INLINE_BYTES and request.deliver == "auto" else payload), encoding


def _as_it_came(request: ProductRequest, t: Translated, found: Found) -> bool:
    """Whether the bytes the value came as are those asked for."""
    return bool(found.payload) and found.encoding == encoding_string(wire_type(t.value), request.format)


def translated(request: ProductRequest, found: Found, lookup: Lookup) -> Translated:
    """Return what was found in the frame and type asked for.

    Raises
    ------
    UnavailableError
        If it cannot be had there without resampling; the message names what can.
    """
    value, wanted, frame, home = found.value, request.type_name, request.frame, found.frame
    t_ns = found.candidate.t1_ns
    if request.product == "pose":
        T = value if isinstance(value, UncertainTransform) else value.transform
        assert found.child is not None
        made, reasons = translate.pose_as(T, home, found.child, t_ns, wanted, _PRODUCER)
        whole = found.whole and wanted == "TransformWithCovariance"
        return Translated(value if whole else made, wanted, home, found.child, reasons)
    if request.product == "trajectory":
        moved_by = None if home == frame else _still(lookup, frame, home, value)
        moved = value if moved_by is None else translate.trajectory_in(value, moved_by, frame)
        return Translated(moved, wanted, frame, found.child)
    if request.product == "pointcloud":
        moved_by = None if home == frame else lookup(frame, home, t_ns)
        moved = value if moved_by is None else translate.cloud_in(value, moved_by, frame)
        return Translated(moved, wanted, frame, moved_by=moved_by)
    if wanted == "Map":
        g = value.geometry
        if g.rows > translate.MAP_MAX_ROWS or g.cols > translate.MAP_MAX_COLS:
            return Translated(value, _TOO_LARGE, frame)
        T = lookup(frame, home, t_ns)
        box = value.extent_m() if frame == home else translate.box_in(value.extent_m(), T)
        return Translated(translate.elevation_as_map(value, T, frame, _PRODUCER), wanted, frame, box_m=box)
    if frame != home and request.is_spatial:
        raise UnavailableError(
            f"a {request.product} made in {home} cannot be had in {frame} without resampling: ask for frame={home}"
            + (" or as=Map" if request.product == "dem" else "")
        )
    return Translated(value, wanted, home, found.child)


def _still(lookup: Lookup, frame: str, home: str, value: Any) -> UncertainTransform:
    """``T_frame_home`` of an edge that does not move during a trajectory; raises UnavailableError for one that does."""
    first, last = lookup(frame, home, int(value.stamps_ns[0])), lookup(frame, home, int(value.stamps_ns[-1]))
    if abs(first.matrix - last.matrix).max() > _STILL_M:
        raise UnavailableError(
            f"a trajectory in {home} cannot be had in {frame}, which moves against it: ask for frame={home}"
        )
    return last


def encoded(value: Any, type_name: str, form: str) -> tuple[bytes, str]:
    """Return the bytes of a value in a codec or file format, and the encoding string."""
    if form in CODECS:
        return encode(value, form), encoding_string(wire_type(value), form)
    from cdff_common.formats.payload import MEDIA_TYPES, to_file

    try:
        return to_file(value, form), MEDIA_TYPES[form]
    except ImportError as error:  # not every image carries every library
        raise UnavailableError(
            f"format={form}: {error.name} is not installed in the orchestrator; ask deliver=reference"
        ) from error


def derived_header(request: ProductRequest, found: Found, t: Translated) -> Header:
    """Header of what was translated: same times, quality with the reasons added, inputs are what it was made from."""
    if not found.sources and request.t_ns is None:
        raise InputError("nothing to derive a header from")
    sources = found.sources
    t1_ns = found.candidate.t1_ns
    t0_ns = min((h.t0_ns for h in sources), default=t1_ns)
    if request.product == "pose":
        t0_ns = t1_ns
    # A window that the DPM pooled is not kept: what it was made from is.
    inputs = tuple(dict.fromkeys(i for h in sources for i in (h.inputs if h.producer.startswith("dpm/") else (h.id,))))
    asked = [
        request.product,
        t.frame,
        t.child,
        t.type_name,
        found.region.text if found.region else "",
        request.resolution_m,
        inputs,
    ]
    config_hash = hashlib.sha256(json.dumps(asked).encode()).hexdigest()[:16]
    base = sources[0].quality if sources else Quality()
    kind = base.covariance_kind
    if request.product == "pose" and isinstance(found.value, UncertainTransform):
        kind = CovarianceKind.NONE if found.value.covariance is None else CovarianceKind.FORMAL
    all_reasons = tuple(dict.fromkeys([*(r for h in sources for r in h.quality.reasons), *t.reasons]))
    quality = replace(base, reasons=all_reasons, covariance_kind=kind)
    box = t.box_m or t.value.extent_m()
    return Header(
        id=product_id(found.candidate.robot, "orchestrator", request.product, t1_ns, 0, config_hash),
        seq=0,
        t0_ns=min(t0_ns, t1_ns),
        t1_ns=t1_ns,
        frame=t.frame,
        child=t.child,
        producer=_PRODUCER,
        config_hash=config_hash,
        inputs=inputs,
        quality=quality,
        box_m=box,
        resolution_m=found.candidate.resolution_m,
    )
