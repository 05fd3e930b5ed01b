# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What has been measured since the last patch, and how to say how good it is."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_core.dfpcs.digital_elevation_mapping.pose_history import covariance_kind_of, degraded


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """Points of one capture in the frame of the map.

    Attributes
    ----------
    points_m : NDArray[np.float64], shape (n, 3)
    stamps_ns : NDArray[np.int64], shape (n,)
    pose_variance_m2 : NDArray[np.float64], shape (n,)
        What the pose's covariance puts on z, square metres; NaN where unknown.
    noise_variance_m2 : NDArray[np.float64], shape (n,)
        What the sensor's noise puts on z, square metres.
    brightness : NDArray[np.float64], shape (n,)
        Intensity; NaN where unknown.
    near : NDArray[np.bool_], shape (n,)
        Which go into the patch; the others only into the far map.
    sample : Sample
        What they were measured in.
    poses : list of Sample
        What brought them into the frame.
    taken : int
        Points of the capture, those outside the gates among them.
    frame : str
        Of the points.
    pose : UncertainTransform or None
        T_map_body at the end of capture; None where the points came in the frame of the map.
    origin_m : NDArray[np.float64] or None, shape (3,)
        Where the sensor was then.
    correction_m : float
        How far the capture was moved to fit the map.
    """

    points_m: NDArray[np.float64]
    stamps_ns: NDArray[np.int64]
    pose_variance_m2: NDArray[np.float64]
    noise_variance_m2: NDArray[np.float64]
    brightness: NDArray[np.float64]
    near: NDArray[np.bool_]
    sample: Sample
    poses: list[Sample]
    taken: int
    frame: str
    pose: UncertainTransform | None = None
    origin_m: NDArray[np.float64] | None = None
    correction_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """All measurements of a patch, in one frame.

    Attributes
    ----------
    points_m, stamps_ns, pose_variance_m2, noise_variance_m2, brightness, near : NDArray
        As in ``Measurements``; an unknown variance of the pose counts as 0, ``Patch.quality`` says so.
    """

    points_m: NDArray[np.float64]
    stamps_ns: NDArray[np.int64]
    pose_variance_m2: NDArray[np.float64]
    noise_variance_m2: NDArray[np.float64]
    brightness: NDArray[np.float64]
    near: NDArray[np.bool_]

    def only(self, keep: NDArray[np.bool_]) -> Joined:
        """Those of ``keep`` ``(n,)``."""
        return Joined(*(getattr(self, f.name)[keep] for f in fields(self)))


@dataclass(slots=True)
class Patch:
    """Measurements not yet published.

    Attributes
    ----------
    drops : Counter
        Captures that were not used, by reason.
    points_in : int
        Points that came in; those outside the gates among them.
    """

    captures: list[Measurements] = field(default_factory=list)
    drops: Counter[str] = field(default_factory=Counter)
    notes: set[str] = field(default_factory=set)
    points_in: int = 0

    def add(self, measured: Measurements) -> None:
        """Take a capture; one without points within the gates is only counted."""
        self.points_in += measured.taken
        if len(measured.points_m):
            self.captures.append(measured)

    @property
    def points(self) -> int:
        """Number of points held."""
        return sum(len(c.points_m) for c in self.captures)

    @property
    def t0_ns(self) -> int:
        """Stamp of the first point held."""
        return min(int(c.stamps_ns.min()) for c in self.captures)

    @property
    def t1_ns(self) -> int:
        """Stamp of the last point held."""
        return max(int(c.stamps_ns.max()) for c in self.captures)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Ids of captures and poses, each once, in the order of their use."""
        samples = [s for c in self.captures for s in (c.sample, *c.poses)]
        return tuple(dict.fromkeys(s.id for s in samples if s.id))

    def joined(self) -> Joined:
        """The measurements of all captures."""
        arrays = {f.name: np.concatenate([getattr(c, f.name) for c in self.captures]) for f in fields(Joined)}
        return Joined(**{**arrays, "pose_variance_m2": np.nan_to_num(arrays["pose_variance_m2"])})

    def rays(self, most: int) -> NDArray[np.float64]:
        """At most so many rays ``(m, 6)`` from where the sensor was to what was hit, spread over the captures."""
        seen = [(c.origin_m, c.points_m) for c in self.captures if c.origin_m is not None]
        step = -(-sum(len(points) for _, points in seen) // most) if seen else 1
        rays = [np.column_stack([np.broadcast_to(origin, p[::step].shape), p[::step]]) for origin, p in seen]
        return np.concatenate(rays) if rays else np.empty((0, 6))

    def quality(self, cells: int, cleared: int = 0, tiles_forgotten: int = 0) -> Quality:
        """DEGRADED where captures were dropped, poses were, or the map lost tiles to the patch; the rest in metrics."""
        poses = [p for c in self.captures for p in c.poses]
        variance = np.concatenate([c.pose_variance_m2 for c in self.captures])
        known = variance[np.isfinite(variance)]
        reasons = [f"dropped_{why}:{count}" for why, count in sorted(self.drops.items())]
        if degraded(poses):
            reasons.append("poses_degraded")
        if tiles_forgotten:
            reasons.append(f"tiles_forgotten:{tiles_forgotten}")
        status = Status.DEGRADED if reasons or self.notes else Status.OK
        if len(known) < len(variance):
            reasons.append("pose_covariance_unknown")
        return Quality(
            status=status,
            reasons=(*reasons, *sorted(self.notes)),
            covariance_kind=covariance_kind_of(poses) if len(known) == len(variance) else CovarianceKind.NONE,
            metrics={
                "captures": len(self.captures),
                "captures_dropped": sum(self.drops.values()),
                "points": len(variance),
                "points_gated": self.points_in - len(variance),
                "cells": cells,
                "cells_cleared": cleared,
                "tiles_forgotten": tiles_forgotten,
                "noise_height_sigma_m": float(
                    np.sqrt(np.concatenate([c.noise_variance_m2 for c in self.captures]).mean())
                ),
                "pose_height_sigma_m": float(np.sqrt(known.mean())) if len(known) else 0.0,
                "captures_aligned": sum(c.correction_m > 0.0 for c in self.captures),
                "correction_m": max((c.correction_m for c in self.captures), default=0.0),
            },
        )
