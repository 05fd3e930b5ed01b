# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where on the whole map a sweep was taken: by the shape of the ground, by descriptors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import Pointcloud
from cdff_core.cloud_matching.acceptance import judged, refused
from cdff_core.cloud_matching.matcher import CloudMatcher, Found, displacement_m
from cdff_core.cloud_matching.search import Search
from cdff_core.dfns.place_search._interface import PlaceSearchInputs
from cdff_core.dfpcs.lidar_localisation._matching import Match, Sweep, SweepMatcher

if TYPE_CHECKING:
    from cdff_common.interfaces.dfpc import Dfpc
    from cdff_core.dfpcs.lidar_localisation._configuration import LidarLocalisationConfig
    from cdff_core.dfpcs.lidar_localisation._scan_map import ScanMap

_LEAST_POINTS = 500


class Relocaliser:
    """Candidates for a sweep on the whole map, matched and judged.

    Parameters
    ----------
    dfpc : Dfpc
        Whose slots search, filter, thin, outliers, keypoints, describe, match and solve are used.
    matcher : SweepMatcher
    config : LidarLocalisationConfig
    """

    def __init__(self, dfpc: Dfpc, matcher: SweepMatcher, config: LidarLocalisationConfig) -> None:
        self._search, self._matcher, self._config = dfpc.dfn("search"), matcher, config
        self._thin_matched = dfpc.dfn("thin_matched")
        self._clouds = CloudMatcher(dfpc, config.keypoint_voxels, config.noise_voxels)

    def found(self, sweep: Sweep, scan_map: ScanMap, places_m: se3.FloatArray) -> Match:
        """The best place that can be stood for; FAILED where there is none, or two that are as good.

        Parameters
        ----------
        sweep : Sweep
        scan_map : ScanMap
        places_m : ndarray, shape (n, 3)
            Around which descriptors are compared; the middle of the map where there are none.
        """
        refusals: list[tuple[str, ...]] = []
        good: list[Match] = []
        ways = {
            "shape": self._by_shape(sweep, scan_map),
            "descriptors": self._by_descriptors(sweep, scan_map, places_m),
        }
        for candidates in (ways[way] for way in self._config.relocalise_by):
            try:
                for T in candidates:
                    match = self._registered(sweep, scan_map, T, good)
                    if match is not None and match.is_good:
                        good.append(match)
                    elif match is not None:
                        refusals.append(match.quality.reasons)
            except RefusedError as error:
                refusals.append(tuple(error.reasons))
            if good:
                return self._best(good)
        return Match(None, refused("not_on_the_map", refusals[0] if refusals else ()))

    def _by_shape(self, sweep: Sweep, scan_map: ScanMap) -> Iterator[se3.FloatArray]:
        """Places of the same shape; raises RefusedError where the sweep shows no ground."""
        yield from self._search.process(PlaceSearchInputs(scan_map.points_m, sweep.whole_m)).transforms

    def _by_descriptors(self, sweep: Sweep, scan_map: ScanMap, places_m: se3.FloatArray) -> Iterator[se3.FloatArray]:
        """Poses that descriptors around some places agree on."""
        cfg = self._config
        source = _sample("scan", sweep.whole_m)
        centres = places_m if len(places_m) else scan_map.points_m.mean(axis=0)[None]
        chosen = centres[np.linspace(0, len(centres) - 1, min(cfg.descriptor_places, len(centres))).astype(int)]
        for centre in chosen:
            target = _sample("map", scan_map.around(centre, cfg.local_radius_m))
            try:
                clouds = [self._clouds.prepared(s, self._thin_matched) for s in (source, target)]
                search = Search(self._clouds, *clouds, cfg, self._judged_roughly)
                for rough, _ in search.acceptable():
                    yield rough.T_target_source
            except InputError:  # too little is left there to be described
                continue

    def _registered(self, sweep: Sweep, scan_map: ScanMap, T: se3.FloatArray, known: list[Match]) -> Match | None:
        """The match from a candidate; None where it leads to a place that is known to be good."""
        local = scan_map.local(T[:3, 3], _LEAST_POINTS)
        if local is None:
            return Match(None, Quality(Status.FAILED, ("map_too_thin",)))
        try:
            near = self._matcher.approached(sweep, local, T)
        except (RefusedError, DegenerateGeometryError) as error:
            return Match(None, Quality(Status.FAILED, tuple(error.reasons)))
        if any(self._is_same(match, near) for match in known):
            return None
        return self._matcher.near(sweep, local, near, may_be_free=False)

    def _is_same(self, match: Match, T: se3.FloatArray) -> bool:
        if match.found is None:
            return False
        a = match.found.assessment
        return displacement_m(match.found.T_target_source, T, a.centre_m, float(a.radius_m)) <= float(a.gate_m)

    def _judged_roughly(self, found: Found) -> Quality:
        return judged(found, float(found.assessment.overlap_source), self._config)

    def _best(self, good: list[Match]) -> Match:
        """The match of the least residuals, unless one elsewhere is nearly as good."""
        order = sorted(good, key=_residual_m)
        best = order[0]
        for other in order[1:]:
            if other.found is None or self._is_same(best, other.found.T_target_source):
                continue
            if _residual_m(other) <= self._config.ambiguity * _residual_m(best):
                return Match(None, refused("ambiguous", best.quality.reasons))
        return best


def _residual_m(match: Match) -> float:
    return np.inf if match.found is None else float(match.found.assessment.rms_m)


def _sample(port: str, points_m: se3.FloatArray) -> Sample:
    return Sample(port, 0, 0, Pointcloud.from_points(points_m, frame=port, stamp_ns=0))
