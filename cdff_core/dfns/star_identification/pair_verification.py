# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Star identification by pairs of bright stars that all other stars verify."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree
from scipy.stats import binom

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.stars import StarCatalogue, load_catalogue
from cdff_core.bearing_tracking import wahba
from cdff_core.bearing_tracking.lens import undistort_directions
from cdff_core.dfns.star_identification.interface import Inputs, Interface, Outputs

#: Interval after which the proper motions are applied again, nanoseconds (30 days).
_EPOCH_NS = 2_592_000_000_000_000
#: Least number of matched stars with which the focal length, and with which the radial distortion, is
#: estimated.
_MIN_SCALE_STARS, _MIN_RADIAL_STARS = 6, 12
#: Smallest field of view, radians, in which pairs are searched: below, the catalogue has too few stars.
_MIN_FIELD_RAD = 0.02
#: Number of other sources that are compared first: one of them must be a star.
_FIRST_SOURCES = 5
#: Change of the velocity, m/s, after which the aberration is applied again: it moves the stars by 0.07
#: arcseconds.
_VELOCITY_M_S = 100.0


class PairVerificationConfig(DfnConfig):
    """Parameters of PairVerification."""

    max_stars: int = Field(
        40, ge=4, le=200, description="Number of the brightest sources that are used to search"
    )
    pair_stars: int = Field(
        9, ge=2, le=30, description="Number of the brightest sources whose pairs are tried"
    )
    catalogue_stars: int = Field(
        9000,
        ge=100,
        le=30_000,
        description="Number of the brightest catalogue stars that pairs are formed of",
    )
    scale_error: float = Field(
        0.006, ge=0.0, le=0.2, description="Largest error of the given focal length, relative"
    )
    tolerance_rad: float = Field(
        4e-4, ge=1e-6, le=0.02, description="Error of a direction in the search, by lens and catalogue, rad"
    )
    match_rad: float = Field(
        2.5e-4, ge=1e-6, le=0.02, description="Error of a matched direction after the adjustment, rad"
    )
    max_chance: float = Field(1e-6, gt=0.0, le=0.01, description="Largest probability of a match by chance")
    min_matches: int = Field(
        4, ge=3, le=100, description="Number of stars below which an attitude is refused"
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Match:
    """Matched sources, their stars, and the rotation R_inertial_camera."""

    sources: IntArray
    stars: IntArray
    rotation: FloatArray
    scale: float = 1.0
    radial: float = 0.0


class _PairTable(NamedTuple):
    """Pairs of catalogue stars, sorted by angle."""

    angles: FloatArray  # (n,), radians
    stars: IntArray  # (n, 2)
    reach_rad: float  # largest angle


class PairVerification(Interface[PairVerificationConfig]):
    """The angle of two bright sources selects pairs of catalogue stars; each pair is an attitude, and the
    attitude
    with most sources at stars is accepted if chance is excluded, as the pyramid of Mortari et al. [1]_.

    The probability of a chance match follows from the density of the catalogue around the sources and
    the number of
    attitudes tried.

    References
    ----------
    .. [1] Mortari, D., Samaan, M. A., Bruccoleri, C., Junkins, J. L. (2004). The pyramid star identification
      technique. Navigation 51(3). doi:10.1002/j.2161-4296.2004.tb00349.x
    """

    def setup(self) -> None:
        """Clear the table of pairs, which the first search makes."""
        self._catalogue: StarCatalogue | None = None
        self._tree: cKDTree | None = None
        self._velocity_m_s = np.zeros(3)
        self._pairs: _PairTable | None = None

    def process(self, inputs: Inputs) -> Outputs:
        """Return the stars of the sources and the attitude.

        Raises
        ------
        RefusedError
            If there are too few sources, or no attitude excludes chance.
        """
        self._load(inputs.stamp, inputs.velocity)
        if len(inputs.directions) < self.config.min_matches:
            raise RefusedError(
                f"{len(inputs.directions)} sources, expected at least {self.config.min_matches} stars",
                reasons=[f"few_stars:{len(inputs.directions)}<{self.config.min_matches}"],
            )
        directions = inputs.directions[: self.config.max_stars]
        match: _Match | None = None
        is_ambiguous = False
        if inputs.attitude is not None:
            match = self._from_guess(directions, inputs.attitude, inputs.attitude_sigma)
            is_ambiguous = match is not None and self._chance(directions, match, 1) > self.config.max_chance
        if match is None or is_ambiguous:
            match_from_pairs = self._from_pairs(directions)
            match, is_ambiguous = (
                (match_from_pairs, False) if match_from_pairs is not None else (match, is_ambiguous)
            )
        if match is None:
            raise RefusedError(
                f"{len(inputs.directions)} sources: no attitude explains them by stars; the camera's focal"
                " length may be wrong by more than the limit, or the sources are no stars",
                reasons=["not_identified"],
            )
        return self._outputs(inputs, self._adjust_camera(inputs.directions, match), is_ambiguous)

    def _load(self, stamp_ns: int, velocity_m_s: FloatArray | None) -> None:
        """Move the catalogue to the time of the image, and shift it by the velocity of the camera.

        The pairs stay: aberration changes an angle by a ten-thousandth of it at most.
        """
        velocity = np.zeros(3) if velocity_m_s is None else velocity_m_s
        is_old = self._catalogue is None or abs(self._catalogue.epoch_ns - stamp_ns) > _EPOCH_NS
        if is_old or np.linalg.norm(velocity - self._velocity_m_s) > _VELOCITY_M_S:
            self._catalogue = load_catalogue().apparent(stamp_ns, velocity)
            self._tree = cKDTree(self._catalogue.directions)
            self._velocity_m_s = velocity
        if is_old:
            self._pairs = None

    def _from_guess(
        self, directions: FloatArray, R_sky_camera: FloatArray, sigma_rad: float
    ) -> _Match | None:
        """Return the match near an approximate attitude: the rotation that most pairs of source and star
        agree on.

        Each pair of source and near star is an offset on the sky; the offset with most sources is refined.
        """
        reach = 4.0 * max(sigma_rad, 1e-9) + self.config.tolerance_rad
        expected = directions @ R_sky_camera.T
        neighbours = self._near(expected, reach)
        sources = np.repeat(np.arange(len(directions)), [len(n) for n in neighbours])
        if len(sources) == 0:
            return None
        stars = np.concatenate([np.asarray(n, dtype=np.intp) for n in neighbours if len(n)])
        # Rotation vectors across the line of sight that bring each source to each of its stars.
        turns = np.cross(expected[sources], self._catalogue.directions[stars])  # type: ignore[union-attr]
        votes = cKDTree(turns).query_ball_point(turns, 2.0 * self.config.tolerance_rad, return_length=True)
        best_turn = turns[int(np.argmax(votes))]
        first = np.eye(3) + np.array(
            [
                [0, -best_turn[2], best_turn[1]],
                [best_turn[2], 0, -best_turn[0]],
                [-best_turn[1], best_turn[0], 0],
            ],
            dtype=float,
        )
        return self._refine_rotation(directions, first @ R_sky_camera)

    def _from_pairs(self, directions: FloatArray) -> _Match | None:
        """Return the best match of the attitudes that pairs of bright sources suggest, or None."""
        bright = directions[: self.config.pair_stars]
        field = float(np.arccos(np.clip(np.min(directions @ directions.T), -1.0, 1.0)))
        if field < _MIN_FIELD_RAD:
            return None
        angles, pairs, _ = self._pair_table(field)
        most_matches = -1
        trials = 0
        for i, j in sorted(combinations(range(len(bright)), 2), key=sum):
            angle = float(np.arccos(np.clip(bright[i] @ bright[j], -1.0, 1.0)))
            error = 2.0 * self.config.tolerance_rad + self.config.scale_error * angle
            low, high = np.searchsorted(angles, [angle - error, angle + error])
            candidates = np.concatenate([pairs[low:high], pairs[low:high, ::-1]])
            if angle < 10.0 * self.config.tolerance_rad or len(candidates) == 0:
                continue
            trials += len(candidates)
            R = self._pair_rotations(bright[[i, j]], candidates)
            # Most candidates fail at the next brightest sources already.
            others = [k for k in range(len(directions)) if k not in (i, j)][:_FIRST_SOURCES]
            R = R[self._counts(directions[others], R) > 0]
            if len(R) == 0:
                continue
            counts = self._counts(directions, R)
            order = np.argsort(-counts, kind="stable")[:5]
            for k in order:
                if counts[k] <= most_matches:
                    continue
                match = self._refine_rotation(directions, R[k])
                if match is None:
                    continue
                if self._chance(directions, match, trials) < self.config.max_chance:
                    return match
                most_matches = int(counts[k])
        return None

    def _pair_table(self, field_rad: float) -> _PairTable:
        """Return the pairs of catalogue stars up to the size of the field."""
        if self._pairs is None or self._pairs.reach_rad < field_rad * 1.02:
            reach = min(field_rad * 1.05, 0.6)
            # As many stars as give on average a hundred pairs per star within the field.
            density = 200.0 / (1.0 - np.cos(reach))
            count = int(min(self.config.catalogue_stars, max(density, 400.0)))
            v = self._catalogue.directions[:count]  # type: ignore[union-attr]
            pairs = cKDTree(v).query_pairs(2.0 * np.sin(0.5 * reach), output_type="ndarray")
            chords = np.linalg.norm(v[pairs[:, 0]] - v[pairs[:, 1]], axis=1)
            order = np.argsort(chords, kind="stable")
            self._pairs = _PairTable(2.0 * np.arcsin(0.5 * chords[order]), pairs[order], reach)
        return self._pairs

    def _pair_rotations(self, sources: FloatArray, pairs: IntArray) -> FloatArray:
        """Return the rotations (m, 3, 3) that bring two sources to each pair of stars, by triads."""
        v = self._catalogue.directions  # type: ignore[union-attr]
        camera = _triads(sources[None, 0], sources[None, 1])
        sky = _triads(v[pairs[:, 0]], v[pairs[:, 1]])
        return np.asarray(sky @ np.swapaxes(camera, 1, 2))

    def _counts(self, directions: FloatArray, R_sky_camera: FloatArray) -> IntArray:
        """Return how many sources lie at a star for each rotation (m, 3, 3)."""
        v = np.einsum("mij,nj->mni", R_sky_camera, directions).reshape(-1, 3)
        reach = 2.0 * self.config.tolerance_rad + self.config.scale_error * 0.1
        distances, _ = self._tree.query(v, distance_upper_bound=reach)  # type: ignore[union-attr]
        return np.asarray(np.isfinite(distances).reshape(len(R_sky_camera), -1).sum(axis=1))

    def _refine_rotation(self, directions: FloatArray, R_sky_camera: FloatArray) -> _Match | None:
        """Return the match of a rotation, with the focal length adjusted, or None if it has too few stars."""
        reach = 3.0 * self.config.tolerance_rad + 0.1 * self.config.scale_error
        match = self._match_sources(
            directions, _Match(np.zeros(0, np.intp), np.zeros(0, np.intp), R_sky_camera), reach
        )
        for reach in (2.0 * self.config.tolerance_rad, self.config.tolerance_rad, self.config.match_rad):
            if len(match.sources) < self.config.min_matches:
                return None
            match = self._match_sources(directions, _adjust(directions, match, self._catalogue), reach)
        return match if len(match.sources) >= self.config.min_matches else None

    def _match_sources(self, directions: FloatArray, match: _Match, reach: float) -> _Match:
        """Return the match with the nearest star of each source within a distance, each star used once."""
        expected = undistort_directions(directions, match.scale, match.radial) @ match.rotation.T
        distances, stars = self._tree.query(expected, distance_upper_bound=reach)  # type: ignore[union-attr]
        sources = np.flatnonzero(np.isfinite(distances))
        order = sources[np.argsort(distances[sources], kind="stable")]
        _, first = np.unique(stars[order], return_index=True)
        source_rows = np.sort(order[first])
        return _Match(
            source_rows, stars[source_rows].astype(np.intp), match.rotation, match.scale, match.radial
        )

    def _adjust_camera(self, directions: FloatArray, match: _Match) -> _Match:
        """Return the match of all sources, after rotation, focal length and distortion are adjusted again."""
        for _ in range(3):
            match = self._match_sources(directions, match, self.config.match_rad)
            match = _adjust(directions, match, self._catalogue)
        return self._match_sources(directions, match, self.config.match_rad)

    def _chance(self, directions: FloatArray, match: _Match, trials: int) -> float:
        """Return an upper bound of the probability that sources match as many stars by chance.

        Only stars down to the faintest matched one count: a star that the camera sees must be in the
        catalogue,
        but the catalogue has stars that the camera does not see.
        """
        stars = int(match.stars.max(initial=0)) + 1
        solid = 4.0 * np.pi / stars
        density = np.pi * self.config.match_rad**2 / solid
        others = len(directions) - 2
        additional_matches = len(match.sources) - 2
        return float(trials * binom.sf(additional_matches - 1, max(others, 1), min(density * 3.0, 1.0)))

    def _near(self, directions: FloatArray, reach: float) -> list[list[int]]:
        return list(self._tree.query_ball_point(directions, reach))  # type: ignore[union-attr]

    def _outputs(self, inputs: Inputs, match: _Match, is_ambiguous: bool) -> Outputs:
        """Return the outputs for a match of sources and stars."""
        stars = np.full(len(inputs.directions), -1, np.int64)
        stars[match.sources] = match.stars
        references = np.full(inputs.directions.shape, np.nan)
        references[match.sources] = self._catalogue.directions[match.stars]  # type: ignore[union-attr]
        directions = undistort_directions(inputs.directions, match.scale, match.radial)
        angles = np.linalg.norm(
            directions[match.sources] @ match.rotation.T - references[match.sources], axis=1
        )
        self.metrics = {"matches": float(len(match.sources))}
        return Outputs(
            stars=stars,
            star_directions=references,
            corrected=directions,
            rotation=match.rotation,
            scale=match.scale,
            radial=match.radial,
            residual=float(np.sqrt((angles**2).mean())),
            is_ambiguous=is_ambiguous,
        )


def _adjust(directions: FloatArray, match: _Match, catalogue: StarCatalogue | None) -> _Match:
    """Return the match with rotation, focal length and distortion adjusted by least squares."""
    assert catalogue is not None
    b, r = directions[match.sources], catalogue.directions[match.stars]
    weights = np.ones(len(b))
    R = wahba.rotation(undistort_directions(b, match.scale, match.radial), r, weights)
    if len(b) < _MIN_SCALE_STARS:
        return _Match(match.sources, match.stars, R, match.scale, match.radial)
    # In the camera frame, tangents of the stars are those of the sources times (1 / scale + radial r^2),
    # moved by a small rotation.
    sky = r @ R
    target = sky[:, :2] / sky[:, 2:]
    xy = b[:, :2] / b[:, 2:]
    r2 = (xy**2).sum(axis=1)
    x, y = target[:, 0], target[:, 1]
    columns = [
        np.concatenate([xy[:, 0], xy[:, 1]]),
        np.concatenate([x * y, 1.0 + y * y]),
        np.concatenate([-(1.0 + x * x), -x * y]),
        np.concatenate([y, -x]),
    ]
    if len(b) >= _MIN_RADIAL_STARS:
        columns.append(np.concatenate([xy[:, 0] * r2, xy[:, 1] * r2]))
    A = np.column_stack(columns)
    solution = np.linalg.lstsq(A, np.concatenate([x, y]), rcond=None)[0]
    scale, radial = 1.0 / solution[0], float(solution[4]) if len(solution) > 4 else 0.0
    R = wahba.rotation(undistort_directions(b, scale, radial), r, weights)
    return _Match(match.sources, match.stars, R, float(scale), radial)


def _triads(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return orthonormal bases (m, 3, 3) in columns: the mean of two unit vectors, and across it."""
    middle = first + second
    middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    normal = np.cross(first, second)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([middle, normal, np.cross(middle, normal)], axis=2)
