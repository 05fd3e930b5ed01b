# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Place descriptors from the heights of the surrounding terrain in polar cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.levelling import rotations_to_z
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.loop_detection.interface import Inputs, Interface, Outputs

#: Number of parameters of a plane at the end of a descriptor.
_PLANE = 3
#: Minimum number of cells with a height, and of points of the plane.
_MIN_CELLS = 30
#: Number of cells of a ring, as in Scan Context.
_SECTORS = 60
#: Minimum fraction of cells observed from both places, and minimum correlation of their heights.
_MIN_SHARED, _MIN_SIMILARITY = 0.4, 0.75


class HeightContextConfig(DfnConfig):
    """Parameters of HeightContext."""

    radius_m: float = Field(24.0, gt=0, le=500, description="Radius of the described area")
    rings: int = Field(16, ge=2, le=200, description="Number of rings of cells")
    min_relief_m: float = Field(
        0.08,
        ge=0,
        le=100,
        description="Minimum standard deviation of the heights at which a place is compared",
    )
    max_candidates: int = Field(3, ge=1, le=1000, description="Maximum number of candidates")


class HeightContext(Interface[HeightContextConfig]):
    """Describe a place by mean heights above the ground plane in rings and sectors, correlated at all
    rotations at once.

    Notes
    -----
    Kim, Kim (2018), "Scan Context", doi:10.1109/IROS.2018.8593953, with two changes for open terrain, where
    the highest point of a cell has little information: a cell has the mean height of its points, and heights
    are relative to the plane through all points, so that the tilt of the sensor has no effect. The
    correlation at all rotations is computed by Fourier transforms along the sectors, over the cells observed
    from both places. A row of the database contains the heights (NaN if a cell has no points), then the
    plane: slopes along x and y, height at the origin.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return descriptor and candidates; raises InputError."""
        cfg = self.config
        heights, plane = self._describe(checked_points(inputs.points, least=0))
        descriptor = np.concatenate([heights.ravel(), plane]).astype(np.float32)
        observed = np.isfinite(heights)
        relief_m = float(np.std(heights[observed])) if observed.sum() >= _MIN_CELLS else 0.0
        database = np.zeros((0, len(descriptor)), np.float32) if inputs.database is None else inputs.database
        if database.ndim != 2 or database.shape[1] != len(descriptor):
            raise InputError(f"database {database.shape}: expected rows of {len(descriptor)}")
        if relief_m < cfg.min_relief_m or not len(database):
            return Outputs(
                descriptor=descriptor,
                relief_m=relief_m,
                candidates=np.zeros(0, np.int64),
                similarity=np.zeros(0),
                transforms=np.zeros((0, 4, 4)),
            )
        similarity, rotation_rad = self._correlate(
            heights, database[:, :-_PLANE].reshape(-1, cfg.rings, _SECTORS)
        )
        order = np.argsort(-similarity, kind="stable")[: cfg.max_candidates]
        order = order[similarity[order] >= _MIN_SIMILARITY]
        guesses = [
            _initial_guess(plane, np.asarray(database[i, -_PLANE:], dtype=np.float64), rotation_rad[i])
            for i in order
        ]
        return Outputs(
            descriptor=descriptor,
            relief_m=relief_m,
            candidates=order.astype(np.int64),
            similarity=similarity[order],
            transforms=np.array(guesses).reshape(-1, 4, 4),
        )

    def _describe(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the heights above the plane (rings, sectors), NaN in cells without points, and the plane
        (3,).
        """
        cfg = self.config
        range_m = np.hypot(points[:, 0], points[:, 1])
        points = points[range_m < cfg.radius_m]
        plane = np.zeros(_PLANE)
        if len(points) >= _MIN_CELLS:
            A = np.column_stack([points[:, :2], np.ones(len(points))])
            plane = np.asarray(np.linalg.lstsq(A, points[:, 2], rcond=None)[0], np.float64)
        level = se3.transform_points(_levelling(plane), points)
        ring = np.minimum(
            np.hypot(level[:, 0], level[:, 1]) / cfg.radius_m * cfg.rings, cfg.rings - 1
        ).astype(np.int64)
        azimuth_turns = (np.arctan2(level[:, 1], level[:, 0]) / (2.0 * np.pi)) % 1.0
        cell = ring * _SECTORS + np.minimum((azimuth_turns * _SECTORS).astype(np.int64), _SECTORS - 1)
        size = cfg.rings * _SECTORS
        count = np.bincount(cell, minlength=size)
        with np.errstate(invalid="ignore"):
            mean = np.bincount(cell, weights=level[:, 2], minlength=size) / count
        return mean.reshape(cfg.rings, _SECTORS), plane

    def _correlate(
        self, query: FloatArray, places: NDArray[np.floating[Any]]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the largest correlation with each place, and the rotation of the query about z, radians."""
        cfg = self.config
        area = (np.arange(cfg.rings) + 0.5)[:, None] / cfg.rings  # area of a cell, which grows with its range
        query_mask, place_mask = np.isfinite(query), np.isfinite(places)
        q, p = np.where(query_mask, query, 0.0), np.where(place_mask, places, 0.0)
        fq, fq2, fm = (np.fft.rfft(x * area) for x in (q, q * q, query_mask.astype(np.float64)))
        fp, fp2, fn = (np.fft.rfft(x) for x in (p, p * p, place_mask.astype(np.float64)))

        def sums_over_rotations(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> FloatArray:
            return np.fft.irfft((np.conj(a) * b).sum(axis=-2), n=_SECTORS)

        common_cells = sums_over_rotations(np.fft.rfft(query_mask.astype(np.float64)), fn)
        weight = np.maximum(sums_over_rotations(fm, fn), 1e-9)
        mean_q, mean_p = sums_over_rotations(fq, fn) / weight, sums_over_rotations(fm, fp) / weight
        covariance = sums_over_rotations(fq, fp) / weight - mean_q * mean_p
        variances = (sums_over_rotations(fq2, fn) / weight - mean_q**2) * (
            sums_over_rotations(fm, fp2) / weight - mean_p**2
        )
        correlation = covariance / np.sqrt(np.maximum(variances, 1e-12))
        enough = common_cells >= _MIN_SHARED * cfg.rings * _SECTORS
        correlation = np.where(enough & (variances > cfg.min_relief_m**4 / 16.0), correlation, -1.0)
        best = np.argmax(correlation, axis=1)
        return correlation[np.arange(len(best)), best], best * (2.0 * np.pi / _SECTORS)


def _levelling(plane: FloatArray) -> FloatArray:
    """Return the transform with the smallest rotation that makes the plane horizontal and its height 0 at the
    place.
    """
    normal = np.array([-plane[0], -plane[1], 1.0])
    normal /= np.linalg.norm(normal)
    return se3.transform(rotations_to_z(normal[None])[0], np.array([0.0, 0.0, -plane[2] * normal[2]]))


def _initial_guess(plane: FloatArray, candidate_plane: FloatArray, rotation_rad: float) -> FloatArray:
    """Return T_candidate_place of places at the same position, rotated about the normal of the ground."""
    R = se3.transform(se3.exp_so3([0.0, 0.0, rotation_rad]), np.zeros(3))
    return np.asarray(se3.inverse(_levelling(candidate_plane)) @ R @ _levelling(plane))
