# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map of keyframes from the images and the poses of a log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_common.progress import Progress
from cdff_common.types import PoseGraph, VisualMap
from cdff_common.types.visual_map_ext import KeyframePoints
from cdff_core.visual_map.features import FeatureExtractor
from cdff_core.visual_map.keyframe_points import MatchingDfn, points_of_depth, points_of_pair
from cdff_dev.logs.source import LogSource

#: Kind of a prior edge of a pose graph.
_PRIOR = 2
#: Largest difference between the times of an image and a pose.
_MAX_GAP_NS = 20_000_000
#: The features of the map are those of visual_localisation, which matches them.
_LOCALISATION = "visual_localisation"


@dataclass(frozen=True, slots=True)
class MapOptions:
    """Options of ``build_map``: accuracy of the poses, position of the depth camera, part of the log."""

    sigma_m: float = 0.003
    sigma_deg: float = 0.1
    depth_offset_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    first_s: float | None = None
    last_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Keyframe:
    stamp_ns: int
    T_map_camera: FloatArray
    points: KeyframePoints
    sensor: str


def build_map(log: LogSource, options: MapOptions) -> VisualMap:
    """Return the map of all images of a log that have a pose.

    Raises
    ------
    InputError
        If the log has no poses, no stereo pairs or colour and depth images, or no image with a pose; or if an
        accuracy is not above 0.
    """
    if not (options.sigma_m > 0 and options.sigma_deg > 0):
        raise InputError(f"accuracy {options.sigma_m} m, {options.sigma_deg} deg: expected above 0")
    by_type: dict[str, list[str]] = {}
    for name, info in log.streams.items():
        by_type.setdefault(info.type_name, []).append(name)
    pose_streams = by_type.get("TransformWithCovariance", []) + by_type.get("RigidBodyState", [])
    if not pose_streams:
        raise InputError("the log has no poses, expected a stream of poses next to the images")
    samples = [s.value for s in log.samples([pose_streams[0]])]
    if not samples:
        raise InputError(f"{pose_streams[0]}: no poses, expected one for each image")
    stamps = np.array([p.stamp_ns for p in samples], np.int64)
    poses = np.array([p.transform.matrix for p in samples])
    truth = _PoseTable(stamps, poses)
    extractor, match = localisation_features()
    if pairs := by_type.get("FramePair"):
        keyframes = _stereo(log, pairs[0], truth, (extractor, match), options)
    elif by_type.get("Frame") and by_type.get("DistanceImage"):
        keyframes = _depth(log, by_type["Frame"][0], by_type["DistanceImage"][0], truth, extractor, options)
    else:
        raise InputError(
            f"the log has {', '.join(sorted(by_type))}: expected stereo pairs, or colour and depth images"
        )
    map_keyframes = list(keyframes)
    if not map_keyframes:
        raise InputError("no image of the log has a pose of the same time, expected at least one")
    return _map(map_keyframes, samples[0].parent_frame, options)


@dataclass(frozen=True, slots=True, eq=False)
class _PoseTable:
    stamps_ns: IntArray
    matrices: FloatArray

    def at(self, stamp_ns: int) -> FloatArray | None:
        """Return the pose nearest in time; None if there is none within the gap."""
        row = int(np.argmin(np.abs(self.stamps_ns - stamp_ns)))
        return None if abs(int(self.stamps_ns[row]) - stamp_ns) > _MAX_GAP_NS else self.matrices[row]


def localisation_features() -> tuple[FeatureExtractor, MatchingDfn]:
    """Return the features of visual_localisation, and the matching of stereo pairs."""
    registry = Registry.default()
    slots = {slot.dfn_id: slot for slot in registry.dfpc(_LOCALISATION).implementations[0].dfns}
    nodes = []
    for slot in (slots["detect"], slots["describe"]):
        nodes.append(registry.make_dfn(slot.name, slot.implementation))
        nodes[-1].configure(slot.parameters)
    match = registry.make_dfn("stereo_matching_2d", "EpipolarZncc")
    match.configure({})
    return FeatureExtractor(*nodes), match


def _is_selected(stamp_ns: int, start_ns: int, options: MapOptions) -> bool:
    time_s = 1e-9 * (stamp_ns - start_ns)
    is_after = options.first_s is None or time_s >= options.first_s - 1e-6
    return is_after and (options.last_s is None or time_s <= options.last_s + 1e-6)


def _stereo(
    log: LogSource,
    stream: str,
    truth: _PoseTable,
    features: tuple[FeatureExtractor, MatchingDfn],
    options: MapOptions,
) -> Iterator[_Keyframe]:
    """Yield keyframes of image pairs with known poses."""
    progress, start_ns = Progress(log.streams[stream].count, "pairs"), None
    for sample in log.samples([stream]):
        pair = sample.value
        start_ns = sample.stamp_ns if start_ns is None else start_ns
        T, mount = truth.at(sample.stamp_ns), pair.left.T_robot_sensor
        if T is not None and _is_selected(sample.stamp_ns, start_ns, options):
            T_map_camera = T if mount is None else T @ mount.matrix
            points = points_of_pair(pair, *features)
            yield _Keyframe(sample.stamp_ns, T_map_camera, points, pair.left.frame)
        progress.advance()
    progress.close()


def _depth(
    log: LogSource,
    colour: str,
    depth: str,
    truth: _PoseTable,
    extractor: FeatureExtractor,
    options: MapOptions,
) -> Iterator[_Keyframe]:
    """Yield the keyframes of colour images; the poses are those of the depth camera."""
    T_camera_depth = se3.transform(np.eye(3), options.depth_offset_m)
    progress, start_ns = Progress(log.streams[colour].count, "images"), None
    frames: dict[int, dict[str, Any]] = {}
    for sample in log.samples([colour, depth]):
        start_ns = sample.stamp_ns if start_ns is None else start_ns
        parts = frames.setdefault(sample.stamp_ns, {})
        parts[type(sample.value).__name__] = sample.value
        if len(parts) < 2:
            continue
        del frames[sample.stamp_ns]
        frame, distances = parts["Frame"], parts["DistanceImage"]
        T = truth.at(sample.stamp_ns)
        if T is not None and _is_selected(sample.stamp_ns, start_ns, options):
            points = points_of_depth(frame, distances, extractor, T_camera_depth)
            yield _Keyframe(sample.stamp_ns, T @ se3.inverse(T_camera_depth), points, frame.frame)
        progress.advance()
    progress.close()


def _map(keyframes: list[_Keyframe], frame: str, options: MapOptions) -> VisualMap:
    """Return the map; each keyframe has a prior with the accuracy of the poses."""
    n, ids = len(keyframes), np.arange(len(keyframes))
    poses = np.array([k.T_map_camera for k in keyframes])
    sigmas = np.repeat([options.sigma_m, np.radians(options.sigma_deg)], 3)
    graph = PoseGraph.from_arrays(
        ids,
        [k.stamp_ns for k in keyframes],
        poses,
        np.column_stack([ids, ids]),
        poses,
        np.broadcast_to(np.diag(sigmas**-2.0), (n, 6, 6)),
        np.full(n, _PRIOR),
        frame=frame,
        producer="map_build",
    )
    return VisualMap.from_parts(
        graph,
        [k.points for k in keyframes],
        sensor=keyframes[-1].sensor,
        stamp_ns=keyframes[-1].stamp_ns,
        descriptor_type="ROOT_SIFT",
        producer="map_build",
    )
