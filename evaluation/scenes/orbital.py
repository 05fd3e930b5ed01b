# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulate terrain, its orbital elevation model, and the patches of a rover with drifting poses."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_dev.simulate.relief import crater_profile, fractal_tile, power_law_sizes

#: Edge of the terrain, and cell sizes of the terrain and of the orbital model.
EDGE_M, FINE_M, ORBITAL_M = 192.0, 0.2, 1.0
#: Standard deviation and correlation length of the errors of orbital heights, metres.
ORBITAL_NOISE_M, ORBITAL_CORRELATED_M = 0.15, 1.5
#: Noise of the rover's heights, its range of view, and the path length between patches.
ROVER_NOISE_M, VIEW_M, PATCH_M = 0.02, 8.0, 5.0
#: Standard deviation of the drift: position per path length, and rotation per metre.
DRIFT, DRIFT_RAD_PER_M = 0.02, np.radians(0.05)
#: Error of the initial pose: limit of the uniform error in x and y, standard deviation in yaw (sun sensor).
PRIOR_M, PRIOR_DEG = 20.0, 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """True heights ``(n, n)`` in metres on a grid of ``FINE_M`` around the origin, row 0 at ymax."""

    heights_m: FloatArray

    @classmethod
    def make(cls, seed: int, slope_deg: float = 6.0, craters: int = 60) -> Ground:
        """Return fractal relief with craters; ``slope_deg`` 0 is a plain with 1 cm of texture."""
        rng = np.random.default_rng([seed, 7])
        n = round(EDGE_M / FINE_M)
        if slope_deg == 0.0:
            return cls(gaussian_filter(rng.normal(0.0, 0.05, (n, n)), 2.0))
        z = fractal_tile(rng, n, FINE_M, (6.0, 96.0), 0.8, np.tan(np.radians(slope_deg)))
        z += fractal_tile(rng, n, FINE_M, (0.6, 6.0), 0.8, np.tan(np.radians(0.5 * slope_deg)))
        axis = (np.arange(n) + 0.5) * FINE_M - 0.5 * EDGE_M
        for diameter in power_law_sizes(rng, craters, 1.5, 25.0, 1.8):
            cx, cy = rng.uniform(-0.5 * EDGE_M, 0.5 * EDGE_M, 2)
            i = slice(*np.searchsorted(axis, [cy - 1.5 * diameter, cy + 1.5 * diameter]))
            j = slice(*np.searchsorted(axis, [cx - 1.5 * diameter, cx + 1.5 * diameter]))
            r = np.hypot(axis[None, j] - cx, axis[i, None] - cy)
            z[i, j] += crater_profile(r, diameter, diameter * rng.uniform(0.05, 0.2), 0.04 * diameter)
        return cls(z[::-1].copy())

    def at(self, xy_m: FloatArray) -> FloatArray:
        """Return the heights ``(n,)`` at points ``(n, 2)`` by bilinear interpolation."""
        row = (0.5 * EDGE_M - xy_m[:, 1]) / FINE_M - 0.5
        col = (xy_m[:, 0] + 0.5 * EDGE_M) / FINE_M - 0.5
        return np.asarray(map_coordinates(self.heights_m, np.stack([row, col]), order=1, mode="nearest"))

    def orbital(self, seed: int, datum_m: float) -> ElevationMap:
        """Return the orbital model: cell means, blurred, with noise, relative to another datum."""
        rng = np.random.default_rng([seed, 8])
        k = round(ORBITAL_M / FINE_M)
        n = len(self.heights_m) // k
        cells = self.heights_m.reshape(n, k, n, k).mean(axis=(1, 3))
        noise = gaussian_filter(rng.normal(size=(n, n)), ORBITAL_CORRELATED_M / ORBITAL_M / 2.0)
        heights = gaussian_filter(cells, 0.5, mode="nearest") + noise * (ORBITAL_NOISE_M / noise.std())
        geometry = GridGeometry.aligned(
            "site", ORBITAL_M, (-0.5 * EDGE_M, -0.5 * EDGE_M, 0.5 * EDGE_M, 0.5 * EDGE_M)
        )
        return ElevationMap.from_layers(
            geometry, {"mean": (heights + datum_m).astype(np.float32)}, t0_ns=0, t1_ns=0
        )


@dataclass(frozen=True, slots=True, eq=False)
class PatchRun:
    """True and estimated poses ``T_site_base``, ``(n, 4, 4)``, of a rover, one for each patch."""

    true_poses: FloatArray
    estimated_poses: FloatArray

    @classmethod
    def make(cls, ground: Ground, seed: int, path_length_m: float) -> PatchRun:
        """Return a curved path through the middle; the estimate has an initial error and drifts."""
        rng = np.random.default_rng([seed, 9])
        steps = max(1, round(path_length_m / PATCH_M))
        heading = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0.0, 0.15, steps + 1))
        xy = np.cumsum(PATCH_M * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
        xy += rng.uniform(-25.0, 25.0, 2) - xy.mean(axis=0)
        true_poses = np.stack(
            [_upright(h, *p, z) for h, p, z in zip(heading, xy, ground.at(xy), strict=True)]
        )
        T_error = _upright(np.radians(rng.normal(0.0, PRIOR_DEG)), 0.0, 0.0, rng.normal(0.0, 1.0))
        T_error[:2, 3] = rng.uniform(-PRIOR_M, PRIOR_M, 2) + xy[0] - T_error[:2, :2] @ xy[0]
        estimated = [T_error @ true_poses[0]]
        for T_previous, T in itertools.pairwise(true_poses):
            slip = _upright(
                rng.normal(0.0, DRIFT_RAD_PER_M * PATCH_M),
                *rng.normal(0.0, DRIFT * PATCH_M, 2),
                rng.normal(0.0, 0.01),
            )
            estimated.append(estimated[-1] @ se3.inverse(T_previous) @ T @ slip)
        return cls(true_poses, np.stack(estimated))

    def samples(self, ground: Ground, seed: int, robot: str = "mana") -> Iterator[Sample]:
        """Yield each estimated pose, then its patch: half of the terrain within ``VIEW_M``, with noise."""
        rng = np.random.default_rng([seed, 10])
        variances = [PRIOR_M**2 / 3.0, PRIOR_M**2 / 3.0, 1.0, 1e-5, 1e-5, np.radians(PRIOR_DEG) ** 2]
        for i, (T_true, T_estimated) in enumerate(zip(self.true_poses, self.estimated_poses, strict=True)):
            stamp_ns = (i + 1) * 10_000_000_000
            yield Sample(
                "poses",
                stamp_ns,
                i,
                TransformWithCovariance.from_transform(
                    UncertainTransform(T_estimated, np.diag(variances)),
                    parent="site",
                    child=f"{robot}/base",
                    stamp_ns=stamp_ns,
                ),
            )
            yield Sample("dem", stamp_ns, i, patch(ground, T_true, T_estimated, stamp_ns, rng))


def patch(
    ground: Ground, T_true: FloatArray, T_estimated: FloatArray, t_ns: int, rng: np.random.Generator
) -> ElevationMap:
    """Return the patch observed at the true ``T_site_base`` during 9 s, located at the estimated pose."""
    x, y = T_estimated[:2, 3]
    geometry = GridGeometry.aligned("site", FINE_M, (x - VIEW_M, y - VIEW_M, x + VIEW_M, y + VIEW_M))
    gx, gy = geometry.centres_m()
    offsets = np.column_stack([gx.ravel(), gy.ravel()]) - T_estimated[:2, 3]
    # Rocks and folds hide half of the ground.
    hidden = gaussian_filter(rng.normal(size=geometry.shape), 2.0) > 0.0
    observed = (np.hypot(*offsets.T) <= VIEW_M).reshape(geometry.shape) & ~hidden
    xy = offsets @ T_estimated[:2, :2] @ T_true[:2, :2].T + T_true[:2, 3]
    z = (
        ground.at(xy).reshape(geometry.shape)
        - T_true[2, 3]
        + T_estimated[2, 3]
        + rng.normal(0.0, ROVER_NOISE_M, observed.shape)
    )
    layers = {
        "mean": np.where(observed, z, np.nan),
        "variance": np.where(observed, ROVER_NOISE_M**2, np.nan),
        "min": np.where(observed, z, np.nan),
        "max": np.where(observed, z, np.nan),
        "count": np.where(observed, 4.0, 0.0),
        "age_s": np.where(observed, 0.0, np.nan),
    }
    return ElevationMap.from_layers(
        geometry,
        {name: a.astype(np.float32) for name, a in layers.items()},
        t0_ns=t_ns - 9_000_000_000,
        t1_ns=t_ns,
    )


def _upright(yaw: float, x: float, y: float, z: float) -> FloatArray:
    return se3.transform(se3.exp_so3(np.array([0.0, 0.0, yaw])), np.array([x, y, z]))
