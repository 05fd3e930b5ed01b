# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search of the whole map for the pose of a sweep, by terrain shape and by descriptors."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.product import Quality
from cdff_core.cloud_matching.acceptance import registration_quality
from cdff_core.cloud_matching.matcher import CloudMatcher, Registration, displacement_m
from cdff_core.cloud_matching.search import AlignmentSearch, AssessedRegistration
from cdff_core.dfns.place_search.interface import PlaceSearchInputs
from cdff_core.dfpcs.lidar_localisation.sweep_matcher import Match, Sweep, SweepMatcher

if TYPE_CHECKING:
    from cdff_common.interfaces.dfpc import Dfpc
    from cdff_core.dfpcs.lidar_localisation.configuration import LidarLocalisationConfig
    from cdff_core.dfpcs.lidar_localisation.tiled_map import TiledMap

#: Least number of points of the map around a candidate.
_MIN_POINTS = 500
#: Ratio of residuals up to which two poses count as equally good.
_AMBIGUITY = 1.5


class Relocaliser:
    """Registers a sweep at candidate poses in the whole map and assesses the results."""

    def __init__(self, dfpc: Dfpc, matcher: SweepMatcher, config: LidarLocalisationConfig) -> None:
        self._search, self._matcher, self._config = dfpc.dfn("search"), matcher, config
        self._voxel_choice = dfpc.dfn("voxel_choice")
        self._clouds = CloudMatcher(dfpc, config)

    def search(self, sweep: Sweep, scan_map: TiledMap, keyframes_m: se3.FloatArray) -> Match:
        """Return the best acceptable match; FAILED without one, or with two equally good ones.

        Descriptors are compared around the first of the keyframe positions ``keyframes_m`` (n, 3) or, without
        keyframes, around the mean of the map's points.
        """
        refusals: list[tuple[str, ...]] = []
        accepted: list[AssessedRegistration] = []
        methods = {
            "shape": self._by_shape(sweep, scan_map),
            "descriptors": self._by_descriptors(sweep, scan_map, keyframes_m),
        }
        for candidates in (methods[method] for method in self._config.relocalise_by):
            try:
                for T in candidates:
                    match = self._register(sweep, scan_map, T, accepted)
                    if match is not None and (registration := match.accepted) is not None:
                        accepted.append((registration, match.quality))
                    elif match is not None:
                        refusals.append(match.quality.reasons)
            except RefusedError as error:
                refusals.append(tuple(error.reasons))
            if accepted:
                return self._best(accepted)
        return Match(None, Quality.failed("not_on_the_map", *(refusals[0] if refusals else ())))

    def _by_shape(self, sweep: Sweep, scan_map: TiledMap) -> Iterator[se3.FloatArray]:
        """Yield poses of similar terrain shape; raises RefusedError if the sweep shows no ground."""
        yield from self._search.process(
            PlaceSearchInputs(map_points=scan_map.points_m, sweep_points=sweep.all_points_m)
        ).transforms

    def _by_descriptors(
        self, sweep: Sweep, scan_map: TiledMap, keyframes_m: se3.FloatArray
    ) -> Iterator[se3.FloatArray]:
        """Yield poses by matching descriptors around the first keyframe or the mean of the map's points."""
        cfg = self._config
        centres = keyframes_m if len(keyframes_m) else scan_map.points_m.mean(axis=0)[None]
        around_m = scan_map.around(centres[0], cfg.local_radius_m)
        with suppress(InputError):  # too few points to describe
            source = self._clouds.prepare(sweep.all_points_m, "scan", self._voxel_choice)
            target = self._clouds.prepare(around_m, "map", self._voxel_choice)
            search = AlignmentSearch(self._clouds, source, target, cfg, self._rough_quality)
            for rough, _ in search.acceptable():
                yield rough.T_target_source

    def _register(
        self,
        sweep: Sweep,
        scan_map: TiledMap,
        T_map_base: se3.FloatArray,
        accepted: list[AssessedRegistration],
    ) -> Match | None:
        """Return the match from a candidate pose; None if it leads to a pose that was already accepted."""
        local = scan_map.local(T_map_base[:3, 3], _MIN_POINTS)
        if local is None:
            return Match(None, Quality.failed("map_too_thin"))
        try:
            T_coarse = self._matcher.register_coarse(sweep, local, T_map_base)
        except RefusedError as error:
            return Match(None, Quality.from_error(error))
        if any(_is_same(registration, T_coarse) for registration, _ in accepted):
            return None
        return self._matcher.register(sweep, local, T_coarse, allow_degenerate=False)

    def _rough_quality(self, registration: Registration) -> Quality:
        return registration_quality(registration, registration.assessment.overlap_source, self._config)

    def _best(self, accepted: list[AssessedRegistration]) -> Match:
        """Return the match with the smallest residuals; FAILED if another pose is nearly as good."""
        (best, quality), *others = sorted(accepted, key=lambda match: match[0].assessment.rms_m)
        limit_m = _AMBIGUITY * best.assessment.rms_m
        for other, _ in others:
            if other.assessment.rms_m <= limit_m and not _is_same(best, other.T_target_source):
                return Match(None, Quality.failed("ambiguous", *quality.reasons))
        return Match(best, quality)


def _is_same(registration: Registration, T_map_base: se3.FloatArray) -> bool:
    """Return whether a pose differs from a registration by no more than its overlap gate."""
    a = registration.assessment
    difference_m = displacement_m(registration.T_target_source, T_map_base, a.centre_m, a.radius_m)
    return difference_m <= a.gate_m
