# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples of simulated logs: their times, headers and poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, product_id
from cdff_common.types import TransformWithCovariance
from cdff_dev.logs.source import split_stream

PRODUCER = "simulator"


class HasDigest(Protocol):
    """A scenario, whose digest identifies the configuration of its samples."""

    @property
    def digest(self) -> str:
        """Digest of all values of the scenario."""


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """One sample of the log: its value, or the rendering task that produces it.

    Attributes
    ----------
    render : tuple of (str, str, int) or None
        Sensor, robot and index, if the value is produced by ray casting.
    """

    stream: str
    stamp_ns: int
    header: Header
    value: Any = None
    render: tuple[str, str, int] | None = None


def sample_times_us(rate_hz: float, duration_s: float) -> np.ndarray:
    """Return sample times ``(n,)`` from 0 to ``duration_s``, microseconds since the epoch."""
    return np.round(np.arange(int(duration_s * rate_hz + 1e-6) + 1) / rate_hz * 1e6).astype(np.int64)


def header(
    scenario: HasDigest, stream: str, seq: int, t0_ns: int, t1_ns: int, frame: str, child: str | None = None
) -> Header:
    """Return the header of a sample, labelled as simulated; poses have the frame ``child`` as well."""
    robot, sensor, port = split_stream(stream)
    kind = CovarianceKind.NONE if child is None else CovarianceKind.FORMAL
    return Header(
        id=product_id(robot, sensor, port, t1_ns, seq, scenario.digest),
        seq=seq,
        t0_ns=t0_ns,
        t1_ns=t1_ns,
        frame=frame,
        child=child,
        producer=PRODUCER,
        config_hash=scenario.digest,
        quality=Quality(reasons=("simulated",), covariance_kind=kind),
    )


def pose(
    T: FloatArray, covariance: FloatArray | None, parent: str, child: str, stamp_ns: int
) -> TransformWithCovariance:
    """Return the message of ``T_parent_child`` (4, 4) with its covariance (6, 6), unknown if None."""
    message: TransformWithCovariance = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent=parent, child=child, stamp_ns=stamp_ns, producer=PRODUCER
    )
    return message
