# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimated trajectories of robots in the DPM, and their ground truth."""

from __future__ import annotations

import json
import time
import urllib.request
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlencode

import numpy as np
from numpy.typing import NDArray

from cdff_common.bus import Bus, keys
from cdff_common.bus.identity import Identity
from cdff_common.errors import CdffError, FrameNotFoundError, UnavailableError
from cdff_common.formats.geotiff import read_map
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.profile import Profile
from cdff_common.types import ElevationMap
from cdff_dev.logs import open_log
from cdff_dev.simulate.traverse import levelled

ResultT = TypeVar("ResultT")
#: Longest wait for an answer of the DPM, seconds.
CALL_S = 60.0
#: Largest number of poses in one answer of the DPM.
_PAGE = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True poses of a frame of a robot.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    poses : ndarray, shape (n, 4, 4)
        ``T_site_frame``.
    T_site_world : ndarray, shape (4, 4)
        Pose of the frame of the simulation in the site of the profile.
    """

    stamps_ns: NDArray[np.int64]
    poses: FloatArray
    T_site_world: FloatArray = field(default_factory=lambda: np.eye(4))

    @property
    def positions_m(self) -> FloatArray:
        """Positions (n, 3)."""
        return self.poses[:, :3, 3]

    @property
    def path_length_m(self) -> float:
        """Path length, metres."""
        return path_length_m(self.positions_m)

    def position_at_m(self, t_ns: int) -> FloatArray:
        """Return the position (3,) at the stamp nearest to a time."""
        nearest: FloatArray = self.positions_m[np.argmin(np.abs(self.stamps_ns - t_ns))]
        return nearest

    def interpolated_positions_m(self, t_ns: NDArray[np.int64]) -> FloatArray:
        """Return positions (n, 3) at times (n,), interpolated linearly."""
        return np.stack([np.interp(t_ns, self.stamps_ns, axis) for axis in self.positions_m.T], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Estimated poses of the base or the lidar of a robot in site, and the true poses of the same frame.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    poses : ndarray, shape (n, 4, 4)
    covariances : ndarray, shape (n, 3, 3)
        Covariances of the positions; zero if unknown.
    truth : Truth
        Without poses if the truth is unknown.
    """

    robot: str
    stamps_ns: NDArray[np.int64]
    poses: FloatArray
    covariances: FloatArray
    truth: Truth

    @property
    def positions_m(self) -> FloatArray:
        """Positions (n, 3)."""
        return self.poses[:, :3, 3]

    def matched_poses(self) -> tuple[FloatArray, FloatArray]:
        """Return estimated and true poses (k, 4, 4) at their common stamps."""
        _, rows, true = np.intersect1d(self.stamps_ns, self.truth.stamps_ns, return_indices=True)
        return self.poses[rows], self.truth.poses[true]

    def errors_m(self) -> tuple[NDArray[np.bool_], FloatArray]:
        """Return a mask (n,) of the poses within the time of the truth, and their errors (k, 3), metres."""
        if not len(self.truth.stamps_ns):
            return np.zeros(len(self.stamps_ns), dtype=bool), np.zeros((0, 3))
        start_ns, end_ns = self.truth.stamps_ns[[0, -1]]
        inside = (self.stamps_ns >= start_ns) & (self.stamps_ns <= end_ns)
        return inside, self.positions_m[inside] - self.truth.interpolated_positions_m(self.stamps_ns[inside])

    def __str__(self) -> str:
        text = f"{self.robot}: {len(self.stamps_ns)} poses, {path_length_m(self.positions_m):.1f} m"
        estimated, true = self.matched_poses()
        if not len(true):
            return f"{text}; the log has no ground truth"
        error_m = np.linalg.norm(estimated[:, :3, 3] - true[:, :3, 3], axis=1)
        rms_m = float(np.sqrt(np.mean(error_m**2)))
        return (
            f"{text}; position error: RMS {rms_m:.3f} m, last {error_m[-1]:.3f} m, "
            f"largest {error_m.max():.3f} m"
        )


@dataclass(frozen=True, slots=True)
class RelativePositionErrors:
    """Errors of the position of one robot relative to the other, metres.

    ``pairs`` is the number of pose pairs.
    """

    pairs: int
    rms_m: float
    largest_m: float

    def __str__(self) -> str:
        return f"RMS {self.rms_m:.3f} m, largest {self.largest_m:.3f} m over {self.pairs} pairs of positions"


def path_lengths_m(positions_m: FloatArray) -> FloatArray:
    """Return the path length (n,) from the first of the positions (n, d) to each of them."""
    steps_m = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps_m)])


def path_length_m(positions_m: FloatArray) -> float:
    """Return the length of a path through positions (n, d)."""
    return float(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).sum())


def read_truth(log: Path, robots: Sequence[str]) -> dict[str, Truth]:
    """Return the true poses of the base of each robot from a log; without poses if the log has none."""
    truths = {}
    with closing(open_log(log)) as reader:
        for robot in robots:
            stream = f"/{robot}/truth.pose"
            samples = list(reader.samples([stream])) if stream in reader.streams else []
            poses = np.array([s.value.transform.matrix for s in samples]).reshape(-1, 4, 4)
            truths[robot] = Truth(np.array([s.stamp_ns for s in samples], dtype=np.int64), poses)
    return truths


def transform_to_site(truths: dict[str, Truth], profile: Profile) -> dict[str, Truth]:
    """Return the truths in the site frame of the profile.

    The site is located by the start pose of the first robot whose odometry frame has a pose in the profile.
    Without such a robot the site is the frame of the simulation. Raises UnavailableError if a truth is empty.
    """
    without_truth = [robot for robot, truth in truths.items() if not len(truth.stamps_ns)]
    if without_truth:
        raise UnavailableError(f"the log has no true poses of {', '.join(without_truth)}")
    T_site_world = np.eye(4)
    for robot, truth in truths.items():
        try:
            T_site_odom = profile.robot(robot).frame_graph().lookup("site", f"{robot}/odom", 0).matrix
        except FrameNotFoundError:
            continue
        T_site_world = T_site_odom @ se3.inverse(levelled(truth.poses[0]))
        break
    return {r: Truth(t.stamps_ns, T_site_world @ t.poses, T_site_world) for r, t in truths.items()}


def estimated_track(profile: Profile, robot: str, http: str, truth: Truth, state: int | None = None) -> Track:
    """Return the poses of the base of a robot from the DPM, or of its lidar if there are none of the base.

    Parameters
    ----------
    state : int, optional
        Revision of the frame tree in which the poses are expressed; by default the newest.

    Raises
    ------
    UnavailableError, FrameNotFoundError
        If the DPM has poses of neither frame, or the robot has no lidar.
    """
    items = pose_series(http, robot, f"{robot}/base", state)
    if not items:
        T = profile.robot(robot).frame_graph().lookup(f"{robot}/base", f"{robot}/lidar", 0).matrix
        items = pose_series(http, robot, f"{robot}/lidar", state)
        if not items:
            raise UnavailableError(f"the DPM holds no poses of {robot}")
        truth = Truth(truth.stamps_ns, truth.poses @ T, truth.T_site_world)
    unknown = np.zeros((6, 6)).tolist()
    return Track(
        robot,
        stamps_ns=np.array([int(item["stamp_ns"]) for item in items]),
        poses=np.array([item["T"] for item in items]),
        covariances=np.array([item["covariance"] or unknown for item in items])[:, :3, :3],
        truth=truth,
    )


def pose_series(
    http: str, robot: str, child: str, state: int | None = None, frame: str = "site"
) -> list[dict[str, Any]]:
    """Return all poses of a child frame in a frame, from the DPM over HTTP, page by page."""
    query: dict[str, Any] = {"robot": robot, "frame": frame, "child": child, "limit": _PAGE}
    query |= {} if state is None else {"frames_revision": state}
    items: list[dict[str, Any]] = []
    while True:
        try:
            page = http_json(http, f"poses?{urlencode(query)}", CALL_S)["items"]
        except (OSError, ValueError, KeyError) as error:
            raise CdffError(f"poses of {robot} over HTTP at {http}: {error}") from error
        items += page
        if len(page) < _PAGE:
            return items
        query["t0"] = int(page[-1]["stamp_ns"]) + 1000


def http_json(http: str, path: str, timeout_s: float) -> dict[str, Any]:
    """Return the JSON answer of the HTTP server; raises OSError or ValueError if there is none."""
    identity = Identity.of_environment()
    scheme, context = ("http", None) if identity is None else ("https", identity.https_context())
    url = f"{scheme}://{http}/api/v1/{path}"
    with urllib.request.urlopen(url, timeout=timeout_s, context=context) as response:
        body: dict[str, Any] = json.load(response)
        return body


def relative_position_errors(tracks: Sequence[Track], within_m: float) -> RelativePositionErrors:
    """Return the errors of the relative positions of two robots.

    Every pose of the first robot is paired with every pose of the second, at any time, if their true distance
    is at most ``within_m``. Poses are used at the stamps at which the truth is known.
    """
    (estimated, true), (other_estimated, other_true) = (track.matched_poses() for track in tracks)
    errors = [np.zeros(0)]
    for T_estimated, T_true in zip(estimated, true, strict=True):
        estimated_m = se3.transform_points(se3.inverse(T_estimated), other_estimated[:, :3, 3])
        true_m = se3.transform_points(se3.inverse(T_true), other_true[:, :3, 3])
        near = np.linalg.norm(true_m, axis=1) <= within_m
        errors.append(np.linalg.norm(estimated_m - true_m, axis=1)[near])
    error_m = np.concatenate(errors)
    if not len(error_m):
        return RelativePositionErrors(0, float("nan"), float("nan"))
    return RelativePositionErrors(len(error_m), float(np.sqrt(np.mean(error_m**2))), float(error_m.max()))


def assess_until_settled(
    assess: Callable[[], ResultT], is_settled: Callable[[ResultT], bool], wait_s: float
) -> ResultT:
    """Repeat an assessment until ``is_settled`` or for ``wait_s``, and return the last: merging takes time.

    Raises
    ------
    UnavailableError
        If the last assessment was not possible.
    """
    deadline_s = time.monotonic() + wait_s
    while True:
        is_last = time.monotonic() > deadline_s
        try:
            result = assess()
            if is_last or is_settled(result):
                return result
        except UnavailableError:
            if is_last:
                raise
        time.sleep(0.5)


def elevation_window(bus: Bus, region: str, resolution_m: float, **options: object) -> ElevationMap:
    """Return the elevation map of a region of the site from the DPM.

    Raises ProductNotFoundError without data.
    """
    query = {"type": "dem", "frame": "site", "region": region, "resolution_m": resolution_m, "format": "tif"}
    reply = bus.call(keys.dpm_rpc(keys.GROUND, "get"), {**query, **options}, timeout_s=CALL_S)
    window = read_map(reply.payload)
    assert isinstance(window, ElevationMap)  # read from a GeoTIFF of elevation
    return window
