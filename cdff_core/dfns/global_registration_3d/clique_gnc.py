# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of consistent pairs by the maximum clique, then robust estimation by graduated non-convexity."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.geometry.robust import graduated_fit, rigid_fit
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.global_registration_3d._clique import Bits, consistency_graph, maximum_clique
from cdff_core.dfns.global_registration_3d.interface import Inputs, Interface, Outputs

#: Largest number of fits to the pairs within the noise.
_MAX_REFITS = 10
#: Minimum distance between two pairs that are compared, in units of the noise.
_MIN_DISTANCE_NOISES = 2.0
#: Minimum of the second largest standard deviation of the inliers, in units of the noise; below it they are
#: collinear.
_MIN_SPREAD_NOISES = 2.0
#: A wrong pair that is a neighbour of a correct one, in units of the noise, is consistent with most correct
#: pairs.
_NEIGHBOUR_NOISES = 3.0
#: Minimum number of pairs from whose distances the density of consistent pairs is computed (435 distances).
_MIN_PAIRS = 30
#: Maximum number of vertices coloured by the clique search; beyond it the best clique found is used.
_MAX_WORK = 1_000_000


class CliqueGncConfig(DfnConfig):
    """Parameters of CliqueGnc."""

    noise_m: float = Field(0.1, gt=0, description="Largest distance between the two points of an inlier pair")
    least_inliers: int = Field(5, ge=3, le=100_000, description="Minimum number of pairs that agree")


class CliqueGnc(Interface[CliqueGncConfig]):
    """Maximum clique of pairs with equal distances in both clouds, then truncated least squares.

    Notes
    -----
    Enqvist, Josephson, Kahl (2009), doi:10.1109/ICCV.2009.5459319, prune by cliques; Yang, Shi, Carlone
    (2021), doi:10.1109/TRO.2020.3033695 (TEASER++), by the maximum clique. Truncated least squares over the
    clique is solved by graduated non-convexity: Yang et al. (2020), doi:10.1109/LRA.2020.2965893. The result
    is refitted to all pairs within the noise. The method is deterministic.
    """

    def setup(self) -> None:
        """Compile the clique search."""
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        self._maximum_clique(corners, corners, 0.1)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the transform and its inliers.

        Raises RefusedError if too few pairs are consistent, DegenerateGeometryError if these are collinear.
        """
        cfg = self.config
        source = checked_points(inputs.source, "source", 0)
        target = checked_points(inputs.target, "target", 0)
        noise_m = cfg.noise_m if inputs.noise_m is None else inputs.noise_m
        clique = self._maximum_clique(source, target, noise_m)
        self._refuse_few(len(clique), len(source), noise_m)
        T, _ = graduated_fit(source[clique], target[clique], noise_m)
        T, inliers = _refit(T, source, target, noise_m)
        self._refuse_few(int(inliers.sum()), len(source), noise_m)
        sigmas_m = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(source[inliers].T)), 0.0))
        if sigmas_m[1] < _MIN_SPREAD_NOISES * noise_m:
            raise DegenerateGeometryError(
                f"the consistent pairs lie within {sigmas_m[1]:.3g} m of a line: the rotation "
                "about it is unobservable",
                ["collinear"],
            )
        ratio = _edge_ratio_by_chance(T, source, target, noise_m)
        return Outputs(
            transform=T,
            inliers=inliers,
            clique_size=len(clique),
            expected_by_chance=float(_expected_cliques(len(source), len(clique), ratio)),
        )

    def _refuse_few(self, count: int, total: int, noise_m: float) -> None:
        min_inliers = self.config.least_inliers
        if count < min_inliers:
            text = f"{count} of {total} pairs agree within {noise_m:.3g} m, expected at least {min_inliers}"
            raise RefusedError(text, [f"too_few_consistent:{count}<{min_inliers}"])

    def _maximum_clique(self, source: FloatArray, target: FloatArray, noise_m: float) -> IntArray:
        """Return the rows of the maximum clique."""
        bits, degree = _consistency(source, target, noise_m)
        clique, _ = maximum_clique(bits, degree, _MAX_WORK)
        return clique


def _consistency(source: FloatArray, target: FloatArray, noise_m: float) -> tuple[Bits, IntArray]:
    """Return adjacency and degrees of the graph; both ends of a distance have an error of up to the noise."""
    return consistency_graph(source, target, 2.0 * noise_m, _MIN_DISTANCE_NOISES * noise_m)


def _edge_ratio(source: FloatArray, target: FloatArray, noise_m: float) -> float:
    """Return the ratio of consistent pairs of pairs to all pairs of pairs."""
    _, degree = _consistency(source, target, noise_m)
    return float(degree.sum()) / (len(source) * (len(source) - 1.0))


def _edge_ratio_by_chance(
    T_target_source: FloatArray, source: FloatArray, target: FloatArray, noise_m: float
) -> float:
    """Return the ratio of edges that the graph would have without a common transform.

    Correct pairs are consistent with each other, so that the ratio of the whole graph approaches 1 if most
    pairs are correct. The ratio is therefore that of the pairs that the transform does not explain, and at
    least that of the same points, paired at random.
    """
    shuffled = target[np.random.default_rng(0).permutation(len(target))]
    ratio = _edge_ratio(source, shuffled, noise_m)
    error_m = np.linalg.norm(se3.transform_points(T_target_source, source) - target, axis=1)
    others = error_m > _NEIGHBOUR_NOISES * noise_m
    if np.count_nonzero(others) < _MIN_PAIRS:
        return ratio
    return max(ratio, _edge_ratio(source[others], target[others], noise_m))


def _refit(
    T_target_source: FloatArray, source: FloatArray, target: FloatArray, noise_m: float
) -> tuple[FloatArray, BoolArray]:
    """Refit the transform to all pairs within the noise until they are constant; return both."""
    inliers = np.zeros(len(source), np.bool_)
    for _ in range(_MAX_REFITS):
        is_inlier = (
            np.sum((se3.transform_points(T_target_source, source) - target) ** 2, axis=1) <= noise_m**2
        )
        if np.array_equal(is_inlier, inliers) or np.count_nonzero(is_inlier) < 3:
            break
        inliers = is_inlier
        T_target_source = rigid_fit(
            source[is_inlier], target[is_inlier], np.ones(np.count_nonzero(is_inlier))
        )
    return T_target_source, inliers


def _expected_cliques(n: int, size: int, edge_ratio: float) -> float:
    """Return the expected number of cliques in a random graph, ``C(n, size) ratio^(size (size - 1) / 2)``."""
    if edge_ratio <= 0.0 or size < 2:
        return float(n)
    log = math.lgamma(n + 1) - math.lgamma(size + 1) - math.lgamma(n - size + 1)
    log += 0.5 * size * (size - 1) * math.log(min(edge_ratio, 1.0))
    return math.exp(min(log, 700.0))
