# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prune pairs to a clique of consistent ones, then solve by graduated non-convexity."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.global_registration_3d._interface import (
    GlobalRegistration3DInputs,
    GlobalRegistration3DInterface,
    GlobalRegistration3DOutputs,
)

Float = NDArray[np.float64]

_GNC_STEP = 1.4
_GNC_ITERATIONS = 100
_REFITS = 10
_APART_NOISES = 2.0


class CliqueGncConfig(DfnConfig):
    """Noise of right pairs, and what is too little."""

    noise_m: float = Field(0.1, gt=0.0, description="Largest distance of the points of a right pair, metres")
    least_inliers: int = Field(5, ge=3, le=100_000, description="Pairs that must agree")
    least_spread: float = Field(2.0, ge=0.0, le=1e6, description="Second largest sigma of agreeing points, in noises")
    max_work: int = Field(1_000_000, ge=0, le=10_000_000_000, description="Vertices the clique search may colour")


class CliqueGnc(GlobalRegistration3DInterface):
    """Distances between points do not change under a rigid motion: right pairs form a clique of agreeing distances.

    Notes
    -----
    Enqvist, Josephson, Kahl (2009), doi:10.1109/ICCV.2009.5459319, prune by cliques; Yang, Shi, Carlone (2021),
    doi:10.1109/TRO.2020.3033695 (TEASER++), by the maximum clique. The members are then solved as truncated least
    squares by graduated non-convexity: Yang et al. (2020), doi:10.1109/LRA.2020.2965893, and the answer is refitted to
    all pairs within the noise. Nothing is drawn at random.
    """

    Config: ClassVar[type[DfnConfig]] = CliqueGncConfig

    def setup(self) -> None:
        """Compile the search, so that the first call costs what the others do."""
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        self._clique(corners, corners, 0.1)

    def process(self, inputs: GlobalRegistration3DInputs) -> GlobalRegistration3DOutputs:
        """Return T_target_source and the pairs behind it; raises InputError, RefusedError, DegenerateGeometryError."""
        cfg: Any = self.config
        source = checked_points(inputs.source, "source", 0)
        target = checked_points(inputs.target, "target", 0)
        if len(source) != len(target):
            raise InputError(f"source and target: {len(source)} and {len(target)} rows, expected pairs")
        noise_m = cfg.noise_m if inputs.noise_m is None else float(inputs.noise_m)
        if not (math.isfinite(noise_m) and noise_m > 0.0):
            raise InputError(f"noise_m={noise_m}: expected metres above 0")
        clique, share = self._clique(source, target, noise_m)
        if len(clique) < cfg.least_inliers:
            raise RefusedError(
                f"{len(clique)} of {len(source)} pairs agree within {noise_m:.3g} m, expected {cfg.least_inliers}",
                [f"too_few_consistent:{len(clique)}<{cfg.least_inliers}"],
            )
        T = graduated(source[clique], target[clique], noise_m)
        T, inliers = _refitted(T, source, target, noise_m)
        if np.count_nonzero(inliers) < cfg.least_inliers:
            raise RefusedError(
                f"{np.count_nonzero(inliers)} of {len(source)} pairs fit one motion within {noise_m:.3g} m",
                [f"too_few_consistent:{np.count_nonzero(inliers)}<{cfg.least_inliers}"],
            )
        spread_m = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(source[inliers].T)), 0.0))
        if spread_m[1] < cfg.least_spread * noise_m:
            raise DegenerateGeometryError(
                f"the pairs that agree lie within {spread_m[1]:.3g} m of a line: the turn about it is free",
                ["collinear"],
            )
        return GlobalRegistration3DOutputs(
            transform=T,
            inliers=inliers,
            clique_size=np.array(len(clique)),
            expected_by_chance=np.array(_expected_cliques(len(source), len(clique), share)),
        )

    def _clique(self, source: Float, target: Float, noise_m: float) -> tuple[NDArray[np.int64], float]:
        """Rows of the clique, and the share of all edges that the graph has."""
        from cdff_core.dfns.global_registration_3d._clique import consistency, maximum_clique

        n = len(source)
        if n < 2:
            return np.zeros(0, np.int64), 0.0
        # Either end of a distance may be off by the noise.
        bits, degree = consistency(source, target, 2.0 * noise_m, _APART_NOISES * noise_m)
        clique, _ = maximum_clique(bits, degree, self.config.max_work)
        return clique, float(degree.sum()) / (n * (n - 1.0))


def graduated(source: Float, target: Float, noise_m: float) -> Float:
    """T_target_source that minimises ``sum min(r^2, noise^2)``, from the convex problem to this one."""
    weight = np.ones(len(source))
    T = aligned(source, target, weight)
    r2 = np.sum((se3.transform_points(T, source) - target) ** 2, axis=1)
    c2 = noise_m**2
    if r2.max() <= c2:
        return T
    mu = c2 / (2.0 * r2.max() - c2)
    for _ in range(_GNC_ITERATIONS):
        low, high = mu / (mu + 1.0) * c2, (mu + 1.0) / mu * c2
        with np.errstate(divide="ignore"):
            between = np.sqrt(c2 * mu * (mu + 1.0) / r2) - mu
        weight = np.where(r2 <= low, 1.0, np.where(r2 >= high, 0.0, between))
        if np.count_nonzero(weight > 1e-6) < 3:
            break
        T = aligned(source, target, weight)
        r2 = np.sum((se3.transform_points(T, source) - target) ** 2, axis=1)
        if np.all((weight < 1e-6) | (weight > 1.0 - 1e-6)):
            break
        mu *= _GNC_STEP
    return T


def aligned(source: Float, target: Float, weight: Float) -> Float:
    """Weighted least squares T_target_source, Umeyama (1991), doi:10.1109/34.88573."""
    share = weight / weight.sum()
    s, t = share @ source, share @ target
    U, _, Vt = np.linalg.svd(((target - t) * share[:, None]).T @ (source - s))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return se3.transform(R, t - R @ s)


def _refitted(T: Float, source: Float, target: Float, noise_m: float) -> tuple[Float, NDArray[np.bool_]]:
    """Fit to all pairs within the noise, until those stay the same."""
    inliers = np.zeros(len(source), np.bool_)
    for _ in range(_REFITS):
        now = np.sum((se3.transform_points(T, source) - target) ** 2, axis=1) <= noise_m**2
        if np.array_equal(now, inliers) or np.count_nonzero(now) < 3:
            break
        inliers = now
        T = aligned(source[now], target[now], np.ones(np.count_nonzero(now)))
    return T, inliers


def _expected_cliques(n: int, size: int, share: float) -> float:
    """``C(n, size) share^(size (size - 1) / 2)``: cliques of this size in a random graph of as many edges."""
    if share <= 0.0 or size < 2:
        return float(n)
    log = math.lgamma(n + 1) - math.lgamma(size + 1) - math.lgamma(n - size + 1)
    log += 0.5 * size * (size - 1) * math.log(min(share, 1.0))
    return math.exp(min(log, 700.0))
