# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies of calls over HTTP and Zenoh: batches of products, frame revisions, anchors, journals, revisions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import ConfigDict, FailFast, Field, TypeAdapter, ValidationError

from cdff_common.contract.limits import LATEST_NS, MAX_PAGE
from cdff_common.contract.names import NAME
from cdff_common.contract.parameters import Parameters, Revision, Stamp, validation_message
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from dpm_store.frames.frames import FARTHEST_FRAME_M
from dpm_store.products.records import NAMES

BodyName = Annotated[str, Field(pattern=rf"^{NAME}$")]
_Row4 = Annotated[list[float], Field(min_length=4, max_length=4)]
_Row6 = Annotated[list[float], Field(min_length=6, max_length=6)]
_Azimuth = Annotated[float, Field(ge=-360, le=360)]
_Sigma = Annotated[float, Field(ge=0, le=1e9)]
T = TypeVar("T")


class ProductBody(Parameters):
    """A product of a batch."""

    model_config = ConfigDict(strict=True)

    robot: str
    dfpc: str
    port: str
    product: str
    encoding: str
    attachment: bytes
    payload: bytes

    @property
    def parts(self) -> tuple[dict[str, str], bytes, str, bytes]:
        """Arguments of ``StoreWriter.put``."""
        names = {name: getattr(self, name) for name in NAMES}
        return names, self.payload, self.encoding, self.attachment


class FrameEdge(Parameters):
    """A new revision of a frame's fixed edge."""

    parent: str
    T: Annotated[list[_Row4], Field(min_length=4, max_length=4)]
    covariance: Annotated[list[_Row6], Field(min_length=6, max_length=6)] | None = None
    valid_from_ns: Stamp | None = None
    valid_until_ns: Stamp | None = None
    expected_revision: Revision | None = None

    def transform(self) -> UncertainTransform:
        """Return ``T_parent_frame``; raises InputError for a matrix that is not rigid or too long."""
        matrix = np.array(self.T)
        farthest_m = np.abs(matrix).max()
        if farthest_m > FARTHEST_FRAME_M:  # before anything is calculated with it
            raise InputError(f"T: a number of {farthest_m:g}, expected at most {FARTHEST_FRAME_M:g} m")
        try:
            return UncertainTransform(matrix, None if self.covariance is None else np.array(self.covariance))
        except ValueError as error:
            raise InputError(f"transform: {error}") from error

    def options(self) -> dict[str, Any]:
        """Return the optional arguments of ``FrameTable.set``."""
        return self.model_dump(include={"valid_from_ns", "valid_until_ns", "expected_revision"})


class FrameRevisionBody(FrameEdge):
    """A frame and the new revision of its edge; the producer is that of the call."""

    frame: str
    producer: str = ""
    # Stored times are nanoseconds; only those of products are multiples of 1000.
    valid_from_ns: Annotated[int, Field(ge=-LATEST_NS, le=LATEST_NS)] | None = None
    valid_until_ns: Annotated[int, Field(ge=-LATEST_NS, le=LATEST_NS)] | None = None


class NewAnchor(Parameters):
    """New anchor of a frame: z up, y towards ``azimuth_deg`` clockwise from north."""

    body: BodyName
    lon_deg: _Azimuth
    lat_deg: Annotated[float, Field(ge=-90, le=90)]
    height_m: float = 0.0
    azimuth_deg: _Azimuth = 0.0
    sigma_m: _Sigma = 0.0
    sigma_deg: _Sigma = 0.0
    expected_revision: Annotated[int | None, Field(ge=0, lt=1 << 31)] = None


class JournalEntry(Parameters):
    """An entry of the journal of another service."""

    number: int
    stamp_ns: int
    scope: str
    kind: str
    body: dict[str, Any]


class JournalBody(Parameters):
    """A part of the journal of another service, in its order."""

    origin: str
    entries: Annotated[list[JournalEntry], Field(max_length=MAX_PAGE)]


JOURNAL = TypeAdapter(JournalBody)
_BATCH = TypeAdapter(Annotated[list[ProductBody], FailFast(), Field(min_length=1)])


def validated(adapter: TypeAdapter[T], body: Any, what: str) -> T:
    """Return a body as the type of the adapter; raises InputError naming ``what`` and the place in it."""
    try:
        return adapter.validate_python(body)
    except ValidationError as error:
        raise InputError(f"{what}: {validation_message(error.errors(include_url=False)[0])}") from error
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def parse_batch(body: Any, robot: str | None = None) -> list[tuple[dict[str, str], bytes, str, bytes]]:
    """Return the products of a batch, a list of ``ProductBody``, as arguments of ``StoreWriter.put``.

    ``robot`` is the robot of products that state none. Raises InputError for anything else.
    """
    if robot is not None and isinstance(body, list):
        body = [{"robot": robot, **item} if isinstance(item, Mapping) else item for item in body]
    products = validated(_BATCH, body, "batch")
    for index, product in enumerate(products):
        if robot is not None and product.robot != robot:
            raise InputError(
                f"batch, product {index}: of {product.robot[:64]}, put under the keys of {robot}"
            )
    return [product.parts for product in products]


def parse_revision(text: str | None) -> int | None:
    """Return the revision of ``if_match`` or of an ETag ``"rN"``; None for ``*``, any revision.

    Raises
    ------
    InputError
        If it is missing or malformed.
    """
    if text is None:
        raise InputError("if_match is missing: name the revision that the change was made from, or * for any")
    if text == "*":
        return None
    match = re.fullmatch(r'(?:"r(\d{1,9})"|(\d{1,9}))', text.strip())
    if match is None:
        raise InputError(f'if_match={text[:80]!r}: expected a revision as 3, an ETag as "r3", or *')
    return int(match[1] or match[2])
