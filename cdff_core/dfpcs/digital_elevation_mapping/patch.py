# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements since the last patch, and their quality."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_core.dfpcs.digital_elevation_mapping.pose_history import any_degraded, covariance_kind_of


@dataclass(frozen=True, slots=True, eq=False)
class MapPoints:
    """Points in the frame of the map."""

    points_m: NDArray[np.float64]  # (n, 3)
    stamps_ns: NDArray[np.int64]  # (n,)
    #: (n,), variance of z due to the covariance of the pose, square metres; NaN if unknown.
    pose_variance_m2: NDArray[np.float64]
    noise_variance_m2: NDArray[
        np.float64
    ]  # (n,), variance of z due to the noise of the sensor, square metres
    intensity: NDArray[np.float64]  # (n,), NaN if unknown
    near: NDArray[np.bool_]  # (n,), true for points of the patch; the others are only in the far map

    def select(self, keep: NDArray[np.bool_]) -> MapPoints:
        """Return the points that a mask ``(n,)`` selects."""
        return MapPoints(*(getattr(self, f.name)[keep] for f in fields(MapPoints)))


@dataclass(frozen=True, slots=True, eq=False)
class CapturePoints(MapPoints):
    """Points of one capture."""

    sample: Sample
    poses: list[Sample]  # poses that enclose the capture
    raw_points: int  # number of points before the gates
    frame: str  # frame of the points
    #: ``T_map_body`` at the end of capture; None if the capture was in the frame of the map.
    pose: UncertainTransform | None = None
    origin_m: NDArray[np.float64] | None = None  # (3,), position of the sensor at that time
    correction_m: float = 0.0  # translation of the capture by its alignment with the map
    notes: tuple[str, ...] = ()  # reasons for DEGRADED


@dataclass(slots=True)
class PendingCaptures:
    """Captures that the next patch will contain."""

    captures: list[CapturePoints] = field(default_factory=list)
    drops: Counter[str] = field(default_factory=Counter)  # number of unused captures and poses by reason
    notes: set[str] = field(default_factory=set)  # further reasons for DEGRADED
    raw_points: int = 0  # number of points before the gates

    def add(self, points: CapturePoints) -> None:
        """Add a capture; without points within the gates only its raw points are counted, without any point
        it is dropped. The first note of each kind is stored.
        """
        self.raw_points += points.raw_points
        if not points.raw_points:
            self.drops["no_points"] += 1
        if len(points.points_m):
            self.captures.append(points)
            names_of_notes = {note.split(":")[0] for note in self.notes}
            self.notes |= {note for note in points.notes if note.split(":")[0] not in names_of_notes}

    @property
    def points(self) -> int:
        """Number of points."""
        return sum(len(c.points_m) for c in self.captures)

    @property
    def t0_ns(self) -> int:
        """Stamp of the first point."""
        return min(int(c.stamps_ns.min()) for c in self.captures)

    @property
    def t1_ns(self) -> int:
        """Stamp of the last point."""
        return max(int(c.stamps_ns.max()) for c in self.captures)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Ids of captures and poses in the order of their use."""
        samples = [s for c in self.captures for s in (c.sample, *c.poses)]
        return tuple(dict.fromkeys(s.id for s in samples if s.id))

    def joined(self) -> MapPoints:
        """Return all points; an unknown pose variance becomes 0, which ``quality`` reports."""
        arrays = {
            f.name: np.concatenate([getattr(c, f.name) for c in self.captures]) for f in fields(MapPoints)
        }
        return MapPoints(**{**arrays, "pose_variance_m2": np.nan_to_num(arrays["pose_variance_m2"])})

    def rays(self, limit: int) -> NDArray[np.float64]:
        """Return at most ``limit`` rays ``(m, 6)`` from the sensor to points of all captures."""
        hits = [(c.origin_m, c.points_m) for c in self.captures if c.origin_m is not None]
        step = -(-sum(len(points) for _, points in hits) // limit) if hits else 1
        rays = [np.column_stack([np.broadcast_to(origin, p[::step].shape), p[::step]]) for origin, p in hits]
        return np.concatenate(rays) if rays else np.empty((0, 6))

    def quality(self, cells: int, cleared: int = 0, tiles_removed: int = 0) -> Quality:
        """Return the quality: DEGRADED with dropped captures, degraded poses or removed tiles."""
        poses = [p for c in self.captures for p in c.poses]
        variance = np.concatenate([c.pose_variance_m2 for c in self.captures])
        known_variances = variance[np.isfinite(variance)]
        reasons = [f"dropped_{why}:{count}" for why, count in sorted(self.drops.items())]
        if any_degraded(poses):
            reasons.append("poses_degraded")
        if tiles_removed:
            reasons.append(f"tiles_forgotten:{tiles_removed}")
        status = Status.DEGRADED if reasons or self.notes else Status.OK
        if len(known_variances) < len(variance):
            reasons.append("pose_covariance_unknown")
        return Quality(
            status=status,
            reasons=(*reasons, *sorted(self.notes)),
            covariance_kind=covariance_kind_of(poses)
            if len(known_variances) == len(variance)
            else CovarianceKind.NONE,
            metrics={
                "captures": len(self.captures),
                "captures_dropped": sum(self.drops.values()),
                "points": len(variance),
                "points_gated": self.raw_points - len(variance),
                "cells": cells,
                "cells_cleared": cleared,
                "tiles_forgotten": tiles_removed,
                "noise_height_sigma_m": float(
                    np.sqrt(np.concatenate([c.noise_variance_m2 for c in self.captures]).mean())
                ),
                "pose_height_sigma_m": float(np.sqrt(known_variances.mean()))
                if len(known_variances)
                else 0.0,
                "captures_aligned": sum(c.correction_m > 0.0 for c in self.captures),
                "correction_m": max((c.correction_m for c in self.captures), default=0.0),
            },
        )
