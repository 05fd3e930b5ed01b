# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The score of a mission, computed with known true poses."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cdff_common.errors import UnavailableError
from cdff_dev.missions.autonomy import Arrival
from cdff_dev.missions.score import Score, goal_results, position_errors
from cdff_dev.missions.script import Follow, GoTo, Meet, MissionLimits, Return
from cdff_dev.missions.terrain import MapErrors, TerrainCrossed
from cdff_dev.missions.tracks import Track, Truth

S = 1_000_000_000
GO = GoTo(do="go_to", xy_m=(10.0, 0.0))


def truth(y_m: float = 0.0) -> Truth:
    """Return true poses of 10 m along x at 1 m/s, one per second."""
    poses = np.tile(np.eye(4), (11, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.arange(11.0), y_m
    return Truth(np.arange(11) * S, poses, np.eye(4))


def track_with_errors(offsets_m: list[float], sigma_m: float = 0.1, start_ns: int = S // 2) -> Track:
    """Return estimated poses with these offsets to the left, one per second.

    By default between the true poses.
    """
    n = len(offsets_m)
    poses = np.tile(np.eye(4), (n, 1, 1))
    stamps_ns = start_ns + np.arange(n) * S
    poses[:, 0, 3], poses[:, 1, 3] = stamps_ns / S, offsets_m
    covariances = np.tile(sigma_m**2 * np.eye(3), (n, 1, 1))
    return Track("mana", stamps_ns, poses, covariances, truth())


@pytest.mark.req("CDFF-DEV-074")
def test_position_errors_are_computed_from_ground_truth() -> None:
    errors = position_errors(track_with_errors([0.0, 0.3, 0.0, 0.1]))
    assert (errors.robot, errors.path_length_m) == ("mana", pytest.approx(10.0))
    assert errors.rms_m == pytest.approx(np.sqrt(0.10 / 4))
    assert (errors.largest_m, errors.last_m) == (pytest.approx(0.3), pytest.approx(0.1))
    assert errors.error_ratio == pytest.approx(0.03)
    assert "3.000% of the path" in str(errors)


@pytest.mark.parametrize(("offset_m", "fraction"), [(0.37, 1.0), (0.38, 0.75)])
def test_the_three_sigma_bound_is_that_of_three_dimensions(offset_m: float, fraction: float) -> None:
    assert position_errors(track_with_errors([0.0, 0.0, offset_m, 0.0])).within_three_sigma == fraction


def test_poses_outside_the_ground_truth_interval_are_not_scored() -> None:
    assert position_errors(
        track_with_errors([50.0, *[0.1] * 10, 50.0], start_ns=-S // 2)
    ).largest_m == pytest.approx(0.1)


def test_poses_without_ground_truth_at_their_time_are_an_error_with_both_intervals() -> None:
    with pytest.raises(
        UnavailableError, match="2 poses of mana from 20000000000 to 21000000000 ns, expected some"
    ):
        position_errors(track_with_errors([0.1, 0.1], start_ns=20 * S))


@pytest.mark.req("CDFF-DEV-074")
def test_a_goal_is_scored_by_the_true_position() -> None:
    arrivals = [
        Arrival("mana", Follow(do="follow"), 2 * S, None),
        Arrival("mana", GO, 8 * S, (10.0, 0.0)),
        Arrival("mana", Return(do="return"), 10 * S, (0.0, 0.0)),
        Arrival("mana", Meet(do="meet", robot="minnie", distance_m=3.0), 4 * S, (4.0, 5.0)),
    ]
    results = list(goal_results(arrivals, {"mana": truth(), "minnie": truth(5.0)}))
    assert [r.off_m for r in results] == pytest.approx([2.0, 10.0, 2.0])
    assert [r.goal for r in results] == ["(10, 0)", "where it began", "3 m from minnie"]


MAP_ERRORS = MapErrors(100, 0.01, 0.02, 0.02)


def score(
    steepest_deg: float = 10.0,
    highest_m: float = 0.1,
    unfinished: tuple[str, ...] = (),
    elevation: MapErrors = MAP_ERRORS,
) -> Score:
    arrivals = [Arrival("mana", GO, 9 * S, (10.0, 0.0))]
    terrain = TerrainCrossed("mana", 50, steepest_deg, highest_m, 0, 0, 20.0, 0.2)
    return Score(
        (position_errors(track_with_errors([0.0, 0.2])),),
        tuple(goal_results(arrivals, {"mana": truth()})),
        (terrain,),
        elevation,
        unfinished,
    )


@pytest.mark.req("CDFF-DEV-074")
@pytest.mark.parametrize(
    ("result", "limits", "reason"),
    [
        (
            score(),
            MissionLimits(position_error_ratio=0.019),
            "mana: position error 2.000% of the path length, expected at most 1.900%",
        ),
        (
            score(),
            MissionLimits(position_error_ratio=None, min_path_length_m=11.0),
            "mana: 10 m driven, expected at least 11 m",
        ),
        (
            score(),
            MissionLimits(position_error_ratio=None, goal_m=0.9),
            "truly 1.00 m off, expected at most 0.9 m",
        ),
        (score(steepest_deg=25.1), MissionLimits(position_error_ratio=None), "mana: drove over 25.1 deg"),
        (
            score(highest_m=0.31),
            MissionLimits(position_error_ratio=None),
            "mana: drove over an obstacle of 0.31 m",
        ),
        (score(unfinished=("mana: lost",)), MissionLimits(position_error_ratio=None), "mana: lost"),
        (
            score(elevation=MapErrors(100, 0.0, 0.16, 0.1)),
            MissionLimits(position_error_ratio=None),
            "expected RMS at most 0.15 m",
        ),
        (
            score(elevation=MapErrors(100, 0.0, 0.1, 0.1, 2)),
            MissionLimits(position_error_ratio=None),
            "no elevation at 2 poses",
        ),
        (
            score(elevation=MapErrors(0, *[float("nan")] * 3)),
            MissionLimits(position_error_ratio=None),
            "over 0 cells",
        ),
    ],
)
def test_each_fault_is_reported(result: Score, limits: MissionLimits, reason: str) -> None:
    (fault,) = result.faults(limits)
    assert reason in fault


def test_satisfied_limits_are_no_fault_and_terrain_of_an_unguided_path_has_no_limits() -> None:
    assert (
        score(steepest_deg=24.9, highest_m=0.29).faults(
            MissionLimits(position_error_ratio=0.021, goal_m=1.01)
        )
        == []
    )
    assert (
        score(steepest_deg=60.0, highest_m=2.0).faults(MissionLimits(position_error_ratio=None, guided=False))
        == []
    )


def test_optimistic_position_covariances_are_a_fault() -> None:
    optimistic = position_errors(track_with_errors([0.0, 0.3, 0.3, 0.0], sigma_m=0.05))
    score = Score((optimistic,), (), (), MAP_ERRORS, ())
    (fault,) = score.faults(MissionLimits(position_error_ratio=None))
    assert fault == "mana: 50.0% of the poses within three sigmas, expected at least 95.0%"
    assert score.faults(MissionLimits(position_error_ratio=None, three_sigma_fraction=0.5)) == []


def test_unknown_values_are_none_in_plain_data() -> None:
    score = Score((), (), (), MapErrors(0, *[float("nan")] * 3), ())
    assert score.to_dict()["mapped"] == {
        "cells": 0,
        "bias_m": None,
        "rms_m": None,
        "nmad_m": None,
        "blank": 0,
    }


def test_a_score_is_plain_data_and_lines() -> None:
    result = score()
    assert json.loads(json.dumps(result.to_dict()))["located"][0]["largest_m"] == pytest.approx(0.2)
    assert len(list(result.lines())) == 4
