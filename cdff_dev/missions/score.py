# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Judges a mission against the truth, which its rovers never saw: where they were, what they reached and crossed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import FrameNotFoundError, UnavailableError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.profile import Profile
from cdff_dev.demo.report import Way
from cdff_dev.demo.sharing import pose_series
from cdff_dev.logs import open_log
from cdff_dev.missions.autonomy import Arrival
from cdff_dev.missions.script import Judged, Meet
from cdff_dev.missions.terrain import Driven, Mapped
from cdff_dev.simulate.traverse import levelled

#: Three standard deviations of one number, for a squared distance in three dimensions (99.73 %).
_THREE_SIGMA_3D = 14.156


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True poses of one robot in the site of the profile: stamps (n,), ``T_site_base`` (n, 4, 4); ``T_site_world``."""

    stamps_ns: NDArray[np.int64]
    poses: FloatArray
    T_site_world: FloatArray

    @property
    def way_m(self) -> float:
        """How far it drove, metres."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1).sum())

    def at_m(self, t_ns: int) -> FloatArray:
        """Place (3,) at a time; the nearest that is known."""
        row = int(np.argmin(np.abs(self.stamps_ns - t_ns)))
        place: FloatArray = self.poses[row, :3, 3]
        return place

    def of(self, T_base_child: FloatArray) -> Truth:
        """The same for a frame that hangs on the base."""
        return Truth(self.stamps_ns, self.poses @ T_base_child, self.T_site_world)

    def between(self, t_ns: NDArray[np.int64]) -> FloatArray:
        """Places (n, 3) at times, linearly between those that are known."""
        columns = [np.interp(t_ns, self.stamps_ns, self.poses[:, axis, 3]) for axis in range(3)]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True)
class Located:
    """How well a robot knew where it was: errors in metres; share of poses within three stated sigmas."""

    robot: str
    way_m: float
    rms_m: float
    largest_m: float
    last_m: float
    within_three_sigma: float

    @property
    def share(self) -> float:
        """Largest error as a share of the way."""
        return self.largest_m / max(self.way_m, 1e-9)

    def __str__(self) -> str:
        return (
            f"{self.robot}: {self.way_m:.0f} m driven; position off by RMS {self.rms_m:.3f} m, largest "
            f"{self.largest_m:.3f} m ({self.share:.3%} of the way), {self.last_m:.3f} m at the end; "
            f"{self.within_three_sigma:.1%} of the poses within three sigmas"
        )


@dataclass(frozen=True, slots=True)
class Reached:
    """A goal that a robot said it reached: how far it truly was from where it had to be, metres."""

    robot: str
    goal: str
    off_m: float

    def __str__(self) -> str:
        return f"{self.robot}: {self.goal}, truly {self.off_m:.2f} m off"


def true_poses(log: Path, profile: Profile, robots: Sequence[str]) -> dict[str, Truth]:
    """Read the truth and set it on the profile's site: where the profile knows the begin of a robot's odometry, there.

    Without such a frame the site is the simulation's own.
    """
    reader = open_log(log)
    raw = {r: [(s.stamp_ns, s.value.transform.matrix) for s in reader.samples([f"/{r}/truth.pose"])] for r in robots}
    reader.close()
    T_site_world = np.eye(4)
    for robot in robots:
        try:
            T_site_odom = profile.robot(robot).frame_graph().lookup("site", f"{robot}/odom", 0).matrix
        except FrameNotFoundError:
            continue
        T_site_world = T_site_odom @ se3.inverse(levelled(raw[robot][0][1]))
        break
    return {
        robot: Truth(np.array([t for t, _ in poses]), T_site_world @ np.array([T for _, T in poses]), T_site_world)
        for robot, poses in raw.items()
    }


@dataclass(frozen=True, slots=True, eq=False)
class Believed:
    """Where a robot was as the DPM holds it: its way, the poses (n, 4, 4) along it, and the truth of that frame."""

    way: Way
    poses: FloatArray
    truth: Truth


def believed(profile: Profile, robot: str, http: str, truth: Truth) -> Believed:
    """The way of a robot as the DPM holds it now, of its base or else its lidar."""
    items = pose_series(http, robot, f"{robot}/base")
    if not items:
        truth = truth.of(profile.robot(robot).frame_graph().lookup(f"{robot}/base", f"{robot}/lidar", 0).matrix)
        items = pose_series(http, robot, f"{robot}/lidar")
    if not items:
        raise UnavailableError(f"the DPM holds no poses of {robot}")
    poses = np.array([item["T"] for item in items])
    unknown = np.zeros((6, 6)).tolist()
    covariances = np.array([item["covariance"] or unknown for item in items])
    true_m = {int(t): T[:3, 3] for t, T in zip(truth.stamps_ns, truth.poses, strict=True)}
    stamps_ns = np.array([int(item["stamp_ns"]) for item in items])
    return Believed(Way(robot, stamps_ns, poses[:, :3, 3], covariances[:, :3, :3], true_m), poses, truth)


def located(found: Believed) -> Located:
    """Judge the positions of a robot; raises UnavailableError where none is of the time of the truth."""
    way, truth = found.way, found.truth
    inside = (way.stamps_ns >= truth.stamps_ns[0]) & (way.stamps_ns <= truth.stamps_ns[-1])
    if not inside.any():
        raise UnavailableError(
            f"the DPM holds {len(inside)} poses of {way.robot} from {way.stamps_ns.min()} to {way.stamps_ns.max()} ns, "
            f"expected some between {truth.stamps_ns[0]} and {truth.stamps_ns[-1]} ns, the time of the truth"
        )
    error = way.positions_m[inside] - truth.between(way.stamps_ns[inside])
    size = np.linalg.norm(error, axis=1)
    floor = 1e-12 * np.eye(3)
    d2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(way.covariances[inside] + floor), error)
    return Located(
        way.robot, truth.way_m, float(np.sqrt(np.mean(size**2))), float(size.max()), float(size[-1]),
        float(np.mean(d2 <= _THREE_SIGMA_3D)),
    )  # fmt: skip


def reached(arrivals: Sequence[Arrival], truths: Mapping[str, Truth]) -> Iterator[Reached]:
    """Judge every task that had a goal."""
    for arrival in arrivals:
        if arrival.goal_m is None:
            continue
        at = truths[arrival.robot].at_m(arrival.t_ns)[:2]
        if isinstance(arrival.task, Meet):
            other = truths[arrival.task.robot].at_m(arrival.t_ns)[:2]
            off_m = abs(float(np.linalg.norm(at - other)) - arrival.task.keep_m)
            yield Reached(arrival.robot, f"{arrival.task.keep_m:g} m from {arrival.task.robot}", off_m)
        else:
            name = (
                "where it began" if arrival.task.do == "return" else f"({arrival.goal_m[0]:g}, {arrival.goal_m[1]:g})"
            )
            yield Reached(arrival.robot, name, float(np.linalg.norm(at - np.array(arrival.goal_m))))


@dataclass(frozen=True, slots=True)
class Score:
    """What came of a mission."""

    located: tuple[Located, ...]
    reached: tuple[Reached, ...]
    driven: tuple[Driven, ...]
    mapped: Mapped
    unfinished: tuple[str, ...]

    def faults(self, judged: Judged) -> list[str]:
        """What is not as the mission demands."""
        found = list(self.unfinished)
        for at in self.located:
            if judged.position_share is not None and at.share > judged.position_share:
                found.append(
                    f"{at.robot}: position {at.share:.3%} of the way off, expected at most {judged.position_share:.3%}"
                )
            if at.within_three_sigma < judged.three_sigma_share:
                within = f"{at.within_three_sigma:.1%} of the poses within three sigmas"
                found.append(f"{at.robot}: {within}, expected at least {judged.three_sigma_share:.1%}")
            if at.way_m < judged.least_way_m:
                found.append(f"{at.robot}: {at.way_m:.0f} m driven, expected at least {judged.least_way_m:g} m")
        found += [f"{r}, expected at most {judged.goal_m:g} m" for r in self.reached if r.off_m > judged.goal_m]
        found += self.mapped.faults(judged.elevation_rms_m)
        if judged.guided:
            found += [fault for over in self.driven for fault in over.faults(judged.steeper_deg, judged.higher_m)]
        return found

    def lines(self) -> Iterator[str]:
        """For a person."""
        for part in (self.located, self.reached, self.driven):
            yield from (str(item) for item in part)
        yield str(self.mapped)

    def to_dict(self) -> dict[str, Any]:
        """As plain data; what is not known is None."""
        plain: dict[str, Any] = _without_nan(asdict(self))
        return plain


def _without_nan(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_nan(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_without_nan(value) for value in data]
    return None if isinstance(data, float) and np.isnan(data) else data
