# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Range of an object by its apparent height, by stereo and by the terrain below it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import ElevationMap, FramePair, Mesh
from cdff_core.dfns.appearance_tracking.interface import AppearanceTrackingInputs
from cdff_core.dfns.terrain_ray_intersection.interface import TerrainRayIntersectionInputs
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig
from cdff_core.dfpcs.far_range_tracking.observer import Observer
from cdff_core.dfpcs.far_range_tracking.tracked_object import TrackedObject

_UNITS = {"m": 1.0, "mm": 1e-3, "km": 1e3}
#: Standard deviation of an edge of an object in the image, and of the error of the disparity that all images
#: share.
_EDGE_PX, _DISPARITY_BIAS_PX = 0.3, 0.05
#: Least correlation of the object in the right image.
_STEREO_SCORE = 0.7
#: Relative standard deviation above which a measurement is not used.
_USEFUL = 0.5
#: Standard deviations from their mean beyond which ranges contradict each other.
_DISAGREE = 4.0


@dataclass(frozen=True, slots=True)
class Ranging:
    """One measurement of a range.

    Attributes
    ----------
    source : str
        ``height``, ``stereo`` or ``terrain``.
    systematic : float
        Relative error that is the same in many images.
    """

    source: str
    range_m: float
    sigma_m: float
    systematic: float


class TargetRange:
    """Ranges of the objects of one camera.

    Parameters
    ----------
    match, terrain : Dfn
        AppearanceTracking and TerrainRayIntersection.
    """

    def __init__(
        self, match: Dfn[Any, Any, Any], terrain: Dfn[Any, Any, Any], config: FarRangeTrackingConfig
    ) -> None:
        self._match, self._terrain, self._config = match, terrain, config
        self._height_m = config.target_height_m
        self._dem: tuple[str, TerrainGrid] | None = None
        self._ids: dict[str, str] = {}

    def give_model(self, sample: Sample) -> None:
        """Store the height of a mesh.

        Raises
        ------
        InputError
            If a coordinate is not finite, or the mesh has no height.
        """
        mesh: Mesh = sample.value
        z = _UNITS[self._config.model_unit] * np.asarray(mesh.data.vertices, float)[:, 2]
        height = float(np.ptp(z)) if len(z) else 0.0
        if not np.isfinite(height) or height <= 0.0:
            raise InputError(f"model {mesh.frame}: height {height} m, expected a finite one above 0")
        self._height_m = height
        self._ids["height"] = sample.id

    def give_dem(self, sample: Sample) -> None:
        """Store an elevation map."""
        dem: ElevationMap = sample.value
        geometry = dem.geometry
        grid = TerrainGrid(
            np.asarray(dem.layer("mean"), float),
            np.asarray(dem.layer("variance"), float) if "variance" in dem.layer_names else None,
            np.array([geometry.xmin_m, geometry.ymax_m]),
            geometry.resolution_m,
        )
        self._dem = (geometry.frame, grid)
        self._ids["terrain"] = sample.id

    def measure(
        self,
        o: TrackedObject,
        camera: CameraModel,
        observer: Observer,
        pair: FramePair | None,
        images: tuple[np.ndarray, np.ndarray] | None,
        noise: float,
    ) -> list[Ranging]:
        """Return the ranges of an object that is seen as a whole."""
        ranges = [
            self._by_height(o, camera),
            self._by_stereo(o, camera, pair, images, noise),
            self._by_terrain(o, camera, observer),
        ]
        return [
            r for r in ranges if r is not None and np.isfinite(r.sigma_m) and r.sigma_m < _USEFUL * r.range_m
        ]

    def inputs(self, ranges: list[Ranging]) -> tuple[str, ...]:
        """Return the ids of the samples that ranges depend on."""
        return tuple(self._ids[r.source] for r in ranges if self._ids.get(r.source))

    def _by_height(self, o: TrackedObject, camera: CameraModel) -> Ranging | None:
        """Return the range from the apparent height of the object; None if the height is not known or not
        visible.
        """
        if self._height_m is None or not o.is_full_height or not np.isfinite(o.box).all():
            return None
        height_px = float(o.box[3] - o.box[2])
        if height_px < self._config.min_range_px:
            return None
        middle = 0.5 * (o.box[0] + o.box[1])
        top, bottom = camera.rays(np.array([[middle, o.box[2]], [middle, o.box[3]]]))
        angle = float(np.arccos(np.clip(top @ bottom, -1.0, 1.0)))
        range_m = 0.5 * self._height_m / np.tan(0.5 * angle)
        edge = float(np.sqrt(2.0)) * _edge_px(o) / height_px
        return Ranging(
            "height", range_m, range_m * edge, float(np.hypot(self._config.target_height_sigma, edge))
        )

    def _by_stereo(
        self,
        o: TrackedObject,
        camera: CameraModel,
        pair: FramePair | None,
        images: tuple[np.ndarray, np.ndarray] | None,
        noise: float,
    ) -> Ranging | None:
        """Return the range from the disparity of the object; None without a significant disparity."""
        a = o.appearance
        if pair is None or images is None or a is None or not o.is_whole or not np.isfinite(o.box).all():
            return None
        left, right = images
        h, w = a.template.shape
        first = np.rint(o.pixel - a.offset - 0.5 * (np.array([w, h]) - 1.0)).astype(int)
        if (first < 0).any() or first[0] + w > left.shape[1] or first[1] + h > left.shape[0]:
            return None
        template = left[first[1] : first[1] + h, first[0] : first[0] + w].astype(np.float32)
        middle = first + 0.5 * (np.array([w, h]) - 1.0)
        reach = 0.5 * self._config.max_disparity_px
        match = self._match.process(
            AppearanceTrackingInputs(
                image=right,
                template=template,
                weights=a.weights,
                place=middle - np.array([reach, 0.0]),
                reach=np.array([reach + 1.0, 1.0]),
                scales=np.ones(1),
                noise=noise,
            )
        )
        if match.score < _STEREO_SCORE:
            return None
        disparity = float(middle[0] - match.place[0])
        sigma = float(np.sqrt(match.covariance[0, 0]))
        if disparity < 2.0 * sigma:
            return None
        depth = camera.fx * pair.baseline / disparity
        ray = camera.rays(o.pixel[None])[0]
        range_m = depth / float(ray[2])
        return Ranging("stereo", range_m, range_m * sigma / disparity, _DISPARITY_BIAS_PX / disparity)

    def _by_terrain(self, o: TrackedObject, camera: CameraModel, observer: Observer) -> Ranging | None:
        """Return the range of the terrain at the lowest point of the object; None without terrain there."""
        if (
            self._dem is None
            or observer.position_m is None
            or not np.isfinite(o.box).all()
            or not o.is_full_height
        ):
            return None
        frame, grid = self._dem
        if frame != observer.frame:
            return None
        contact = np.array([[0.5 * (o.box[0] + o.box[1]), o.box[3]]])
        direction = observer.attitude.directions(camera, contact)
        sigma = float(np.hypot(_edge_px(o) / camera.fy, observer.attitude.bias_rad))
        sigma = float(np.hypot(sigma, self._config.attitude_noise_rad))
        terrain_ranges = self._terrain.process(
            TerrainRayIntersectionInputs(
                heights=grid.heights,
                variances=grid.variances,
                corner=grid.corner_m,
                resolution=grid.resolution_m,
                origin=observer.position_m,
                directions=direction,
                elevation_sigmas=np.array([max(sigma, 1e-5)]),
            )
        )
        range_m, sigma_m = float(terrain_ranges.ranges[0]), float(terrain_ranges.sigmas[0])
        if not np.isfinite(range_m):
            return None
        half = 0.5 * self._config.target_length_m
        sigma_m = float(np.hypot(sigma_m, 0.3 * half))
        return Ranging("terrain", range_m + 0.5 * half, sigma_m, sigma_m / range_m)


def _edge_px(o: TrackedObject) -> float:
    """Return the standard deviation of the upper and lower edge: dust and shadows change the height."""
    return float(np.hypot(_EDGE_PX, float(o.box[3] - o.box[2]) - o.size_px[1]))


@dataclass(frozen=True, slots=True, eq=False)
class TerrainGrid:
    """Heights of an elevation map.

    Attributes
    ----------
    heights, variances : ndarray (r, c)
    corner_m : ndarray (2,)
        Outer corner of cell (0, 0).
    """

    heights: FloatArray
    variances: FloatArray | None
    corner_m: FloatArray
    resolution_m: float


def fuse_ranges(
    ranges: list[Ranging], expected: tuple[float, float]
) -> tuple[Ranging | None, tuple[str, ...]]:
    """Return the weighted mean of the ranges that agree with each other, and ``ranges_disagree`` if one of
    them does not.

    Of two groups of the same number, the one whose mean is ``expected`` is used: a range and its standard
    deviation, NaN if it is unknown. None if both or neither are expected. The weights include the systematic
    errors, which many images share.
    """
    for number in range(len(ranges), 0, -1):
        means = [_mean(group) for group in itertools.combinations(ranges, number) if _agree(group)]
        if len(means) > 1:
            means = [mean for mean in means if _is_expected(mean, expected)]
        if len(means) == 1:
            return means[0], () if number == len(ranges) else ("ranges_disagree",)
        if means:
            break
    return None, ("ranges_disagree",)


def _total_m(ranging: Ranging) -> float:
    """Return the standard deviation of a range with its systematic error."""
    return float(np.hypot(ranging.sigma_m, ranging.systematic * ranging.range_m))


def _mean(ranges: Sequence[Ranging]) -> Ranging:
    """Return the weighted mean of ranges."""
    r, total = np.array([x.range_m for x in ranges]), np.array([_total_m(x) for x in ranges])
    weights = 1.0 / total**2
    mean = float(np.average(r, weights=weights))
    sigma = float(np.sqrt(np.average([x.sigma_m**2 for x in ranges], weights=weights**2) / len(ranges)))
    systematic = float(1.0 / np.sqrt(weights.sum()) / mean)
    return Ranging("+".join(x.source for x in ranges), mean, max(sigma, 1e-3 * mean), systematic)


def _agree(ranges: Sequence[Ranging]) -> bool:
    """Return whether no range is far from the mean of all."""
    mean_m = _mean(ranges).range_m
    return all(abs(x.range_m - mean_m) <= _DISAGREE * _total_m(x) for x in ranges)


def _is_expected(ranging: Ranging, expected: tuple[float, float]) -> bool:
    """Return whether a range agrees with an expected one and its standard deviation; True if it is NaN."""
    range_m, sigma_m = expected
    return not abs(ranging.range_m - range_m) > _DISAGREE * np.hypot(sigma_m, _total_m(ranging))
