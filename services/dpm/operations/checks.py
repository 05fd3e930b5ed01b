# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checks of a product's header and value before it is stored."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Sequence
from typing import Any

from cdff_common.clock import NS_PER_S
from cdff_common.contract.limits import LATEST_NS
from cdff_common.errors import ClockSkewError, FrameNotFoundError, InputError
from cdff_common.geodesy import body_names
from cdff_common.interfaces.product import Header
from cdff_common.types import ElevationMap, Map, NavigationMap, Pointcloud
from dpm_store import Store

#: Largest difference between the clocks of a robot and of the ground, seconds.
MAX_SKEW_S = 60.0
#: Limits of a header: ids of inputs, reasons and metrics of the quality, and characters of a text.
_MAX_INPUTS = 10_000
_MAX_REASONS, _MAX_METRICS = 64, 256
_MAX_TEXT = 256
_INPUT = re.compile(r"[A-Za-z0-9_\-:.]{1,64}\Z")
_SITE, _INERTIAL = "site", "inertial"
#: Tolerance for rounding of the content's extent beyond its box, metres and fraction of its size.
_BOX_MARGIN_M, _BOX_RELATIVE_MARGIN = 1e-3, 1e-6


def check_header(header: Header, now_ns: int) -> None:
    """Refuse a header with times before the mission's start or in the future, or with fields out of bounds.

    Parameters
    ----------
    header : Header
    now_ns : int
        Mission time.

    Raises
    ------
    InputError
    ClockSkewError
        If the capture ends in the future by more than ``MAX_SKEW_S``.
    """
    if header.t0_ns < 0:
        raise InputError(
            f"capture begins at t0_ns={header.t0_ns}: expected 0 (mission start, or 1970) or later"
        )
    if header.t1_ns > LATEST_NS:
        raise InputError(f"capture ends at t1_ns={header.t1_ns}, out of range: expected at most {LATEST_NS}")
    late_s = (header.t1_ns - now_ns) / NS_PER_S
    if late_s > MAX_SKEW_S:
        raise ClockSkewError(
            f"capture ends {late_s:.3f} s after the mission clock's now, expected at most {MAX_SKEW_S:g} s: "
            "set the clock of the robot or of the DPM; the product is accepted afterwards"
        )
    if len(header.inputs) > _MAX_INPUTS:
        raise InputError(f"inputs: {len(header.inputs)} ids, expected at most {_MAX_INPUTS}")
    for i in header.inputs:
        if not _INPUT.match(i):
            raise InputError(f"input {i[:80]!r}: expected an id, letters, digits and - _ : . , at most 64")
    for name, text in (("producer", header.producer), ("config_hash", header.config_hash)):
        if len(text) > _MAX_TEXT or not text.isprintable():
            raise InputError(f"{name}={text[:80]!r}: expected printable text, at most {_MAX_TEXT}")
    reasons, metrics = header.quality.reasons, header.quality.metrics
    if len(reasons) > _MAX_REASONS or any(len(reason) > _MAX_TEXT for reason in reasons):
        raise InputError(
            f"quality: {len(reasons)} reasons, expected at most {_MAX_REASONS} of {_MAX_TEXT} letters"
        )
    if len(metrics) > _MAX_METRICS or any(len(name) > _MAX_TEXT for name in metrics):
        raise InputError(f"quality: {len(metrics)} metrics, expected at most {_MAX_METRICS}, short names")
    resolution_m = header.resolution_m
    if resolution_m is not None and not (math.isfinite(resolution_m) and resolution_m > 0.0):
        raise InputError(f"resolution_m={resolution_m}: expected metres above 0")


def check_value(value: Any, header: Header) -> None:
    """Refuse a decoded value whose frame, time or extent contradicts its header.

    Raises
    ------
    InputError
    """
    getattr(value, "stamp_ns", None)  # a malformed time is refused by the type itself
    frame = getattr(value, "frame", None)
    if isinstance(frame, str) and frame not in ("", header.frame):
        raise InputError(f"a value in frame {frame[:128]!r}, its header names {header.frame}")
    _check_box(value, header)


def _check_box(value: Any, header: Header) -> None:
    extent = value.extent_m()
    if extent is None:
        if isinstance(value, Pointcloud) and len(value.points_m):
            raise InputError(
                f"none of {len(value.points_m)} points is finite: expected at least one, or no points"
            )
        return
    if header.box_m is None or isinstance(
        value, Map
    ):  # a Map's own extent is that of its plane, without heights
        return
    box = header.box_m
    size_m = max(extent[i + 3] - extent[i] for i in range(3))
    margin_m = _BOX_MARGIN_M + _BOX_RELATIVE_MARGIN * size_m
    is_flat = (
        isinstance(value, (ElevationMap, NavigationMap)) and extent[2] == extent[5] == 0.0
    )  # it may have no heights
    for i in range(2 if is_flat else 3):
        if not (box[i] - margin_m <= extent[i] and extent[i + 3] <= box[i + 3] + margin_m):
            raise InputError(
                f"box_m={_numbers(box)} m does not contain the content, which lies in {_numbers(extent)} m: "
                "give the box of the content, or none"
            )


def _numbers(box: Sequence[float]) -> str:
    return "[" + ", ".join(f"{v:g}" for v in box) + "]"


class FrameNames:
    """Known frames of a store: ``site``, ``inertial``, bodies, fixed and moving ones, those of products."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._known: frozenset[str] = frozenset({_SITE, _INERTIAL, *body_names()})

    def check_known(self, frame: str) -> None:
        """Raise FrameNotFoundError for an unknown frame."""
        if frame not in self._known and frame not in self._read():
            raise FrameNotFoundError(
                f"frame {frame[:128]!r} is not known: nothing lies in it and no edge leads to it"
            )

    def check_of_robot(self, frame: str, robot: str) -> None:
        """Raise InputError for a frame that is neither the robot's own nor known."""
        if frame.startswith(f"{robot}/"):
            return
        try:
            self.check_known(frame)
        except FrameNotFoundError as error:
            raise InputError(
                f"a product of {robot}: {error}; enter the frame first, or use {robot}/…"
            ) from error

    def _read(self) -> frozenset[str]:
        fixed_frames = [
            name for revision in self._store.frames.current() for name in (revision.frame, revision.parent)
        ]
        moving = [name for track in self._store.poses.tracks() for name in (track.parent, track.child)]
        names = frozenset(
            {_SITE, _INERTIAL, *body_names(), *fixed_frames, *moving, *self._store.frame_names()}
        )
        with self._lock:
            self._known = names
        return names
