# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Places described by the heights around them in polar cells."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.loop_detection._interface import (
    LoopDetectionInputs,
    LoopDetectionInterface,
    LoopDetectionOutputs,
)

Float = NDArray[np.float64]

_PLANE = 3
_LEAST_CELLS = 30


class HeightContextConfig(DfnConfig):
    """Cells, and what counts as alike."""

    radius_m: float = Field(24.0, gt=0.0, le=500.0, description="How far around the place is described, metres")
    rings: int = Field(16, ge=2, le=200, description="Rings of cells")
    sectors: int = Field(60, ge=8, le=720, description="Cells of a ring")
    min_relief_m: float = Field(0.08, ge=0.0, le=100.0, description="Least standard deviation of heights, metres")
    min_shared: float = Field(0.4, gt=0.0, le=1.0, description="Share of cells that both places must have seen")
    min_similarity: float = Field(0.75, ge=-1.0, le=1.0, description="Least correlation of a candidate")
    max_candidates: int = Field(3, ge=1, le=1000, description="Candidates at most")


class HeightContext(LoopDetectionInterface):
    """Mean heights over the ground plane in rings and sectors, correlated over all turns at once.

    Notes
    -----
    Kim, Kim (2018), "Scan Context", doi:10.1109/IROS.2018.8593953, with two changes for open ground, where the highest
    point of a cell says little: the mean height is kept, and it is measured from the plane through all of them, so that
    the tilt of the sensor does not matter. The correlation at all turns is a product of Fourier transforms along the
    sectors, over the cells that both places have seen. A row of the database is heights (NaN where none), then the
    plane: slopes along x and y, height at the origin.
    """

    Config: ClassVar[type[DfnConfig]] = HeightContextConfig

    def process(self, inputs: LoopDetectionInputs) -> LoopDetectionOutputs:
        """Return descriptor and candidates; raises InputError."""
        cfg: Any = self.config
        heights, plane = self._described(checked_points(inputs.points, least=0))
        descriptor = np.concatenate([heights.ravel(), plane]).astype(np.float32)
        seen = np.isfinite(heights)
        relief_m = float(np.std(heights[seen])) if seen.sum() >= _LEAST_CELLS else 0.0
        database = np.zeros((0, len(descriptor))) if inputs.database is None else np.asarray(inputs.database)
        if database.ndim != 2 or database.shape[1] != len(descriptor):
            raise InputError(f"database {database.shape}: expected rows of {len(descriptor)}")
        if relief_m < cfg.min_relief_m or not len(database):
            return _nothing(descriptor, relief_m)
        similarity, turn = self._correlated(heights, database[:, :-_PLANE].reshape(-1, cfg.rings, cfg.sectors))
        order = np.argsort(-similarity, kind="stable")[: cfg.max_candidates]
        order = order[similarity[order] >= cfg.min_similarity]
        guesses = [_guess(plane, np.asarray(database[i, -_PLANE:], dtype=np.float64), turn[i]) for i in order]
        return LoopDetectionOutputs(
            descriptor=descriptor,
            relief_m=np.array(relief_m),
            candidates=order.astype(np.int64),
            similarity=similarity[order],
            transforms=np.array(guesses).reshape(-1, 4, 4),
        )

    def _described(self, points: Float) -> tuple[Float, Float]:
        """Heights above the plane (rings, sectors), NaN where none, and the plane."""
        cfg: Any = self.config
        range_m = np.hypot(points[:, 0], points[:, 1])
        points = points[range_m < cfg.radius_m]
        plane = np.zeros(_PLANE)
        if len(points) >= _LEAST_CELLS:
            A = np.column_stack([points[:, :2], np.ones(len(points))])
            plane = np.linalg.lstsq(A, points[:, 2], rcond=None)[0]
        level = se3.transform_points(_levelling(plane), points)
        ring = np.minimum(np.hypot(level[:, 0], level[:, 1]) / cfg.radius_m * cfg.rings, cfg.rings - 1).astype(np.int64)
        turn = (np.arctan2(level[:, 1], level[:, 0]) / (2.0 * np.pi)) % 1.0
        cell = ring * cfg.sectors + np.minimum((turn * cfg.sectors).astype(np.int64), cfg.sectors - 1)
        size = cfg.rings * cfg.sectors
        count = np.bincount(cell, minlength=size)
        with np.errstate(invalid="ignore"):
            mean = np.bincount(cell, weights=level[:, 2], minlength=size) / count
        return mean.reshape(cfg.rings, cfg.sectors), plane

    def _correlated(self, query: Float, places: Float) -> tuple[Float, Float]:
        """Best correlation with each place, and the turn of the query about z that leads to it, radians."""
        cfg: Any = self.config
        area = (np.arange(cfg.rings) + 0.5)[:, None] / cfg.rings  # cells far out are larger
        seen, seen_there = np.isfinite(query), np.isfinite(places)
        q, p = np.where(seen, query, 0.0), np.where(seen_there, places, 0.0)
        fq, fq2, fm = (np.fft.rfft(x * area) for x in (q, q * q, seen.astype(np.float64)))
        fp, fp2, fn = (np.fft.rfft(x) for x in (p, p * p, seen_there.astype(np.float64)))

        def over_turns(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> Float:
            return np.fft.irfft((np.conj(a) * b).sum(axis=-2), n=cfg.sectors)

        both = over_turns(np.fft.rfft(seen.astype(np.float64)), fn)
        weight = np.maximum(over_turns(fm, fn), 1e-9)
        mean_q, mean_p = over_turns(fq, fn) / weight, over_turns(fm, fp) / weight
        covariance = over_turns(fq, fp) / weight - mean_q * mean_p
        variances = (over_turns(fq2, fn) / weight - mean_q**2) * (over_turns(fm, fp2) / weight - mean_p**2)
        correlation = covariance / np.sqrt(np.maximum(variances, 1e-12))
        enough = both >= cfg.min_shared * cfg.rings * cfg.sectors
        correlation = np.where(enough & (variances > cfg.min_relief_m**4 / 16.0), correlation, -1.0)
        best = np.argmax(correlation, axis=1)
        return correlation[np.arange(len(best)), best], best * (2.0 * np.pi / cfg.sectors)


def _levelling(plane: Float) -> Float:
    """T that turns the plane level by the shortest way and puts it at height 0 below the place."""
    normal = np.array([-plane[0], -plane[1], 1.0])
    normal /= np.linalg.norm(normal)
    axis = np.cross(normal, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    R = se3.exp_so3(axis / sine * np.arctan2(sine, normal[2])) if sine > 1e-12 else np.eye(3)
    return se3.transform(R, np.array([0.0, 0.0, -plane[2] * normal[2]]))


def _guess(plane: Float, plane_there: Float, turn: float) -> Float:
    """T_candidate_place of two places over one another, the second turned about the normal of the ground."""
    R = se3.transform(se3.exp_so3([0.0, 0.0, turn]), np.zeros(3))
    return np.asarray(se3.inverse(_levelling(plane_there)) @ R @ _levelling(plane))


def _nothing(descriptor: NDArray[np.float32], relief_m: float) -> LoopDetectionOutputs:
    return LoopDetectionOutputs(
        descriptor=descriptor, relief_m=np.array(relief_m), candidates=np.zeros(0, np.int64),
        similarity=np.zeros(0), transforms=np.zeros((0, 4, 4)),
    )  # fmt: skip
