# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Final reply with a product: conversion, encoding, header, inline or by reference."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from weakref import WeakKeyDictionary

from cdff_common.bus import Reply
from cdff_common.clock import Clock
from cdff_common.codecs import CODECS, encode_payload, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_common.contract.limits import INLINE_BYTES
from cdff_common.contract.products import product_type
from cdff_common.errors import InputError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, product_id
from cdff_core.orchestration import conversion
from cdff_core.orchestration.acceptance import assess, delivery_summary
from cdff_core.orchestration.request import ProductRequest
from services.orchestrator.dpm import DpmClient
from services.orchestrator.product_finder import ProductMatch

_PRODUCER = "orchestrator/translate/1"
#: Difference between two lookups above which a transform counts as moving, metres.
_STATIC_M = 1e-6
#: Placeholder type of a DEM with more cells than a ``Map`` can have; it is delivered by reference as tif.
_TOO_LARGE = "Map too large"
#: Function of parent, child and time that returns ``T_parent_child``.
TransformLookup = Callable[[str, str, int], UncertainTransform]


@dataclass(frozen=True, slots=True, eq=False)
class ConvertedProduct:
    """A value in the requested form.

    Attributes
    ----------
    value : Any
        A ``cdff_common.types`` object of ``type_name``.
    frame, child : str
    reasons : tuple of str
        Codes of information that the type drops.
    moved_by : UncertainTransform or None
        Transform applied to its points; its error adds to that of the points.
    box_m : tuple or None
        Extent in ``frame``; None if the value contains it.
    """

    value: Any
    type_name: str
    frame: str
    child: str | None = None
    reasons: tuple[str, ...] = ()
    moved_by: UncertainTransform | None = None
    box_m: tuple[float, float, float, float, float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DeliveredForm:
    """A product as it is delivered, for all equal requests.

    Attributes
    ----------
    product : ConvertedProduct
    header : Header
    inline : tuple of bytes and str, or None
        Payload and encoding; None for a reply by reference.
    sha256 : str
        Hash of the payload.
    header_fields : mapping
        The header as plain data.
    """

    product: ConvertedProduct
    header: Header
    inline: tuple[bytes, str] | None
    sha256: str
    header_fields: Mapping[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "header_fields", self.header.to_dict())


class TooOldError(UnavailableError):
    """The product has become too old for the request since the query."""


class SharedForms:
    """Delivered forms of the matches in use, each made once for all equal requests.

    They are removed with their match.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._forms: WeakKeyDictionary[ProductMatch, dict[Hashable, DeliveredForm]] = WeakKeyDictionary()

    def get(
        self, request: ProductRequest, match: ProductMatch, make: Callable[[], DeliveredForm]
    ) -> DeliveredForm:
        """Return the form of a match for a request, by ``make`` if no equal request has made it."""
        # Requests with the same match are equal except for what follows and what no form depends on.
        key = request.type_name, request.frame, request.format, request.deliver
        with self._lock:
            form = self._forms.get(match, {}).get(key)
        if form is None:
            form = make()
            with self._lock:
                self._forms.setdefault(match, {})[key] = form
        return form


@dataclass(frozen=True, slots=True)
class ReplyBuilder:
    """Builder of the final reply of a job; equal requests share the form of the last products."""

    dpm: DpmClient
    clock: Clock
    _forms: SharedForms = field(default_factory=SharedForms)

    def reply(
        self,
        job: str,
        request: ProductRequest,
        match: ProductMatch,
        until_s: float,
        held_fraction: float | None = None,
        advice: Sequence[str] = (),
    ) -> Reply:
        """Convert and encode a match; store it and reply by reference if it is large or so requested.

        ``held_fraction`` is the fraction of the region that the DPM held before the plan, ``advice`` are
        texts added to the differences.

        Raises
        ------
        TooOldError
            If it does not meet the mandatory requirements at the time of the reply.
        CdffError
            Errors of the DPM, or if the product cannot be converted to the requested frame or type.
        """
        robot = match.candidate.robot
        native = product_type(request.product).types[0]
        form = self._forms.get(request, match, lambda: self._form(request, match, until_s))
        product, header, inline = form.product, form.header, form.inline
        # A reference is always to the native type of the product.
        delivered_type = native if inline is None else product.type_name
        now_ns = self.clock.now_ns()
        assessment = assess(match.candidate, request, now_ns)
        if assessment.violations:
            raise TooOldError("; ".join(assessment.violations))
        differences = [*assessment.differences, *advice, *product.reasons]
        if delivered_type != request.type_name:
            differences.append(_type_difference(request, product, delivered_type))
        summary = delivery_summary(match.candidate, assessment, now_ns, product.frame) | {
            "as": delivered_type,
            "differences": differences,
            "source": match.sources[0].producer if match.sources else "",
        }
        coverage = match.candidate.coverage
        if held_fraction is not None and coverage is not None:
            summary["assembled"] = {
                "stored": round(min(held_fraction, coverage), 4),
                "made": round(max(coverage - held_fraction, 0.0), 4),
            }
        moved_by = product.moved_by or match.moved_by
        if moved_by is not None and moved_by.covariance is not None:
            summary["frame_covariance"] = moved_by.covariance.tolist()
        attachment = {
            **form.header_fields,
            "kind": _kind(request, inline),
            "robot": robot,
            "job": job,
            "request": request.id,
            "final": True,
            "asked": request.describe(),
            "delivered": summary,
        }
        if inline is not None:
            return Reply(*inline, {**attachment, "sha256": form.sha256})
        if request.deliver == "none":
            return Reply(b"", "", attachment)
        file_format = request.format if product.type_name != _TOO_LARGE else "tif"
        body = {
            "id": header.id,
            "type": native,
            "encoding": encoding_string(
                wire_type(product.value) if product.type_name == native else native, "uper"
            ),
            "format": file_format,
            "path": f"/api/v1/products/{header.id}/payload?format={file_format}",
        }
        return Reply.of(body, **attachment)

    def _form(self, request: ProductRequest, match: ProductMatch, until_s: float) -> DeliveredForm:
        """Convert and encode a match; store it if it is delivered by reference."""

        def lookup(parent: str, child: str, t_ns: int) -> UncertainTransform:
            return self.dpm.pose(match.candidate.robot, parent, child, t_ns, until_s)

        if request.deliver == "none":
            native = product_type(request.product).types[0]
            return DeliveredForm(
                ConvertedProduct(match.value, native, match.frame, match.child), match.sources[0], None, ""
            )
        product = converted(request, match, lookup)
        native = product_type(request.product).types[0]
        is_unconverted = product.type_name == native and product.frame == match.frame and not product.reasons
        is_unmodified = match.is_unmodified and is_unconverted
        if is_unmodified or (is_unconverted and request.product == "dem"):
            header = match.sources[0]
        else:
            header = derived_header(request, match, product)
        inline = _inline(request, product, match)
        if inline is None and not is_unmodified:
            header = self._store(request, match, product, header, until_s)
        sha256 = "" if inline is None else hashlib.sha256(inline[0]).hexdigest()
        return DeliveredForm(product, header, inline, sha256)

    def _store(
        self,
        request: ProductRequest,
        match: ProductMatch,
        t: ConvertedProduct,
        header: Header,
        until_s: float,
    ) -> Header:
        """Store a derived product in the DPM in its native type; return its header."""
        robot = match.candidate.robot
        if request.product == "dem":
            if t.frame != match.frame:
                raise UnavailableError(
                    f"a DEM by reference stays in {match.frame}: ask for frame={match.frame}"
                )
            region = None if match.region is None else match.region.text
            stored = self.dpm.stored_window(
                until_s,
                robot=robot if robot in match.robots else "any",
                region=region,
                frame=match.frame,
                resolution_m=request.resolution_m,
                t1=match.candidate.t1_ns,
            )
            return Header.from_dict(stored)
        if request.product == "pose":
            raise UnavailableError(
                "a pose composed over the frame tree is not stored: ask for deliver=inline"
            )
        self.dpm.put(header, t.value, robot, request.product, until_s)
        return header


def _kind(request: ProductRequest, inline: tuple[bytes, str] | None) -> str:
    """Return the kind of a final reply."""
    if inline is not None:
        return "product"
    return "stored" if request.deliver == "none" else "reference"


def _type_difference(request: ProductRequest, t: ConvertedProduct, delivered_type: str) -> str:
    """Return the message that a reference is to another type than requested, and how to get that type."""
    if t.type_name == _TOO_LARGE:
        return (
            f"as: {delivered_type} by reference, asked {request.type_name}, which cannot have as many cells"
        )
    requested_type = request.type_name
    return (
        f"as: {delivered_type} by reference, asked {requested_type}: "
        f"get it with as={requested_type} from the DPM"
    )


def _inline(request: ProductRequest, t: ConvertedProduct, match: ProductMatch) -> tuple[bytes, str] | None:
    """Return the payload and its encoding; None for a reply by reference."""
    if request.deliver == "reference" or t.type_name == _TOO_LARGE:
        return None
    stored = match.stored if t.value is match.value and request.format in CODECS else None
    if stored is not None and stored.encoding == encoding_string(wire_type(t.value), request.format):
        payload, encoding = stored.payload, stored.encoding
    else:
        try:
            payload, encoding = encoded(t.value, request.format)
        except UnavailableError:
            if request.deliver == "inline":
                raise
            return None  # the DPM writes the file
    return None if len(payload) > INLINE_BYTES and request.deliver == "auto" else (payload, encoding)


def converted(request: ProductRequest, match: ProductMatch, lookup: TransformLookup) -> ConvertedProduct:
    """Return a match in the requested frame and type.

    Raises
    ------
    UnavailableError
        If the conversion needs resampling; the message names a possible frame or type.
    """
    value, target_type, frame, source_frame = match.value, request.type_name, request.frame, match.frame
    t_ns = match.candidate.t1_ns
    if request.product == "pose":
        T = value if isinstance(value, UncertainTransform) else value.transform
        assert match.child is not None
        converted_pose, reasons = conversion.pose_as(
            T, source_frame, match.child, t_ns, target_type, _PRODUCER
        )
        is_unmodified = match.is_unmodified and target_type == "TransformWithCovariance"
        return ConvertedProduct(
            value if is_unmodified else converted_pose, target_type, source_frame, match.child, reasons
        )
    if request.product == "trajectory":
        moved_by = None if source_frame == frame else _static_transform(lookup, frame, source_frame, value)
        transformed = value if moved_by is None else conversion.trajectory_in(value, moved_by, frame)
        return ConvertedProduct(transformed, target_type, frame, match.child)
    if request.product == "pointcloud":
        moved_by = None if source_frame == frame else lookup(frame, source_frame, t_ns)
        transformed = value if moved_by is None else conversion.cloud_in(value, moved_by, frame)
        return ConvertedProduct(transformed, target_type, frame, moved_by=moved_by)
    if target_type == "Map":
        g = value.geometry
        if g.rows > conversion.MAP_MAX_ROWS or g.cols > conversion.MAP_MAX_COLS:
            return ConvertedProduct(value, _TOO_LARGE, frame)
        T = lookup(frame, source_frame, t_ns)
        box = value.extent_m() if frame == source_frame else conversion.box_in(value.extent_m(), T)
        return ConvertedProduct(
            conversion.elevation_as_map(value, T, frame, _PRODUCER), target_type, frame, box_m=box
        )
    if frame != source_frame and request.is_spatial:
        raise UnavailableError(
            f"no {request.product} in {frame} without resampling: ask for frame={source_frame}"
            + (" or as=Map" if request.product == "dem" else "")
        )
    return ConvertedProduct(value, target_type, source_frame, match.child)


def _static_transform(lookup: TransformLookup, frame: str, source: str, value: Any) -> UncertainTransform:
    """Return ``T_frame_source``, constant during a trajectory; raises UnavailableError if it is not."""
    first, last = (
        lookup(frame, source, int(value.stamps_ns[0])),
        lookup(frame, source, int(value.stamps_ns[-1])),
    )
    if abs(first.matrix - last.matrix).max() > _STATIC_M:
        raise UnavailableError(
            f"no trajectory in {frame}, which moves relative to {source}: ask for frame={source}"
        )
    return last


def encoded(value: Any, file_format: str) -> tuple[bytes, str]:
    """Return the bytes of a value in a codec or file format, and the encoding string."""
    if file_format in CODECS:
        return encode_payload(value, file_format)
    from cdff_common.formats.payload import MEDIA_TYPES, to_file

    try:
        return to_file(value, file_format), MEDIA_TYPES[file_format]
    except ImportError as error:  # an optional library
        raise UnavailableError(
            f"format={file_format}: {error.name} is not installed in the orchestrator; ask deliver=reference"
        ) from error


def derived_header(request: ProductRequest, match: ProductMatch, t: ConvertedProduct) -> Header:
    """Return the header of a converted product: times and quality of its sources, which are its inputs."""
    if not match.sources and request.t_ns is None:
        raise InputError("nothing to derive a header from")
    sources = match.sources
    t1_ns = match.candidate.t1_ns
    t0_ns = min((h.t0_ns for h in sources), default=t1_ns)
    if request.product == "pose":
        t0_ns = t1_ns
    # A window pooled by the DPM is not stored; its inputs are.
    inputs = tuple(
        dict.fromkeys(i for h in sources for i in (h.inputs if h.producer.startswith("dpm/") else (h.id,)))
    )
    configuration = [
        request.product,
        t.frame,
        t.child,
        t.type_name,
        match.region.text if match.region else "",
        request.resolution_m,
        inputs,
    ]
    config_hash = hashlib.sha256(json.dumps(configuration).encode()).hexdigest()[:16]
    base = sources[0].quality if sources else Quality()
    kind = base.covariance_kind
    if request.product == "pose" and isinstance(match.value, UncertainTransform):
        kind = CovarianceKind.NONE if match.value.covariance is None else CovarianceKind.FORMAL
    all_reasons = tuple(dict.fromkeys([*(r for h in sources for r in h.quality.reasons), *t.reasons]))
    quality = replace(base, reasons=all_reasons, covariance_kind=kind)
    box = t.box_m or t.value.extent_m()
    return Header(
        id=product_id(match.candidate.robot, "orchestrator", request.product, t1_ns, 0, config_hash),
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
        resolution_m=match.candidate.resolution_m,
    )
