# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Score of a mission: errors of positions, goals and maps, and crossed terrain, from the ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cdff_common.errors import UnavailableError
from cdff_common.json_form import jsonable
from cdff_dev.missions.autonomy import Arrival
from cdff_dev.missions.script import Meet, MissionLimits
from cdff_dev.missions.terrain import MapErrors, TerrainCrossed
from cdff_dev.missions.tracks import Track, Truth

#: Bound of the squared Mahalanobis distance in three dimensions with the probability of three standard
#: deviations in one dimension (99.73 %).
_THREE_SIGMA_3D = 14.156


@dataclass(frozen=True, slots=True)
class PositionErrors:
    """Errors of the positions of a robot, metres, and the fraction of poses within three stated sigmas.

    ``last_m`` is the error of the last pose.
    """

    robot: str
    path_length_m: float
    rms_m: float
    largest_m: float
    last_m: float
    within_three_sigma: float

    @property
    def error_ratio(self) -> float:
        """Largest error as a fraction of the path length."""
        return self.largest_m / max(self.path_length_m, 1e-9)

    def __str__(self) -> str:
        return (
            f"{self.robot}: {self.path_length_m:.0f} m driven; position error RMS {self.rms_m:.3f} m, "
            f"largest {self.largest_m:.3f} m ({self.error_ratio:.3%} of the path), {self.last_m:.3f} m at "
            f"the end; {self.within_three_sigma:.1%} of the poses within three sigmas"
        )


@dataclass(frozen=True, slots=True)
class GoalResult:
    """A goal that a robot reported as reached; ``off_m`` is its true distance from the goal, metres."""

    robot: str
    goal: str
    off_m: float

    def __str__(self) -> str:
        return f"{self.robot}: {self.goal}, truly {self.off_m:.2f} m off"


def position_errors(track: Track) -> PositionErrors:
    """Return the errors of the poses within the time of the truth.

    Raises UnavailableError if there is none.
    """
    inside, error = track.errors_m()
    truth = track.truth
    if not inside.any():
        raise UnavailableError(
            f"the DPM holds {len(inside)} poses of {track.robot} from {track.stamps_ns.min()} to "
            f"{track.stamps_ns.max()} ns, expected some between {truth.stamps_ns[0]} and "
            f"{truth.stamps_ns[-1]} ns, the time of the truth"
        )
    error_m = np.linalg.norm(error, axis=1)
    covariances = track.covariances[inside] + 1e-12 * np.eye(3)  # zero if unknown
    mahalanobis2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariances), error)
    return PositionErrors(
        track.robot,
        truth.path_length_m,
        rms_m=float(np.sqrt(np.mean(error_m**2))),
        largest_m=float(error_m.max()),
        last_m=float(error_m[-1]),
        within_three_sigma=float(np.mean(mahalanobis2 <= _THREE_SIGMA_3D)),
    )


def goal_results(arrivals: Sequence[Arrival], truths: Mapping[str, Truth]) -> Iterator[GoalResult]:
    """Yield the result of every completed task that has a goal."""
    for arrival in arrivals:
        if arrival.goal_m is None:
            continue
        position_m = truths[arrival.robot].position_at_m(arrival.t_ns)[:2]
        if isinstance(arrival.task, Meet):
            other_m = truths[arrival.task.robot].position_at_m(arrival.t_ns)[:2]
            off_m = abs(float(np.linalg.norm(position_m - other_m)) - arrival.task.distance_m)
            yield GoalResult(arrival.robot, f"{arrival.task.distance_m:g} m from {arrival.task.robot}", off_m)
        else:
            name = (
                "where it began"
                if arrival.task.do == "return"
                else f"({arrival.goal_m[0]:g}, {arrival.goal_m[1]:g})"
            )
            yield GoalResult(
                arrival.robot, name, float(np.linalg.norm(position_m - np.array(arrival.goal_m)))
            )


@dataclass(frozen=True, slots=True)
class Score:
    """Results of a mission: errors of positions, goals, crossed terrain, errors of maps, unfinished tasks."""

    located: tuple[PositionErrors, ...]
    reached: tuple[GoalResult, ...]
    driven: tuple[TerrainCrossed, ...]
    mapped: MapErrors
    unfinished: tuple[str, ...]

    def faults(self, limits: MissionLimits) -> list[str]:
        """Return the unmet limits of the mission."""
        faults = list(self.unfinished)
        for errors in self.located:
            if limits.position_error_ratio is not None and errors.error_ratio > limits.position_error_ratio:
                faults.append(
                    f"{errors.robot}: position error {errors.error_ratio:.3%} of the path length, expected "
                    f"at most {limits.position_error_ratio:.3%}"
                )
            if errors.within_three_sigma < limits.three_sigma_fraction:
                within = f"{errors.within_three_sigma:.1%} of the poses within three sigmas"
                faults.append(
                    f"{errors.robot}: {within}, expected at least {limits.three_sigma_fraction:.1%}"
                )
            if errors.path_length_m < limits.min_path_length_m:
                faults.append(
                    f"{errors.robot}: {errors.path_length_m:.0f} m driven, expected at least "
                    f"{limits.min_path_length_m:g} m"
                )
        faults += [
            f"{r}, expected at most {limits.goal_m:g} m" for r in self.reached if r.off_m > limits.goal_m
        ]
        faults += self.mapped.faults(limits.elevation_rms_m)
        if limits.guided:
            faults += [
                fault
                for terrain in self.driven
                for fault in terrain.faults(limits.slope_excess_deg, limits.step_excess_m)
            ]
        return faults

    def lines(self) -> Iterator[str]:
        """Yield the results as text."""
        for part in (self.located, self.reached, self.driven):
            yield from (str(item) for item in part)
        yield str(self.mapped)

    def to_dict(self) -> dict[str, Any]:
        """Return the results for JSON; unknown values are None."""
        plain: dict[str, Any] = jsonable(asdict(self))
        return plain
