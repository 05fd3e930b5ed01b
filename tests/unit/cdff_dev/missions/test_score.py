# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission's score against a truth that is known by construction."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.profile import load_profile
from cdff_common.types import TransformWithCovariance
from cdff_dev.demo.report import Way
from cdff_dev.logs import LogWriter
from cdff_dev.missions.autonomy import Arrival
from cdff_dev.missions.commands import DEPLOY
from cdff_dev.missions.score import Believed, Score, Truth, located, reached, true_poses
from cdff_dev.missions.script import Follow, GoTo, Judged, Meet, Return
from cdff_dev.missions.terrain import Driven, Mapped

S = 1_000_000_000
GO = GoTo(do="go_to", xy_m=(10.0, 0.0))


def truth(y_m: float = 0.0) -> Truth:
    """Ten metres along x at 1 m/s, a pose each second."""
    poses = np.tile(np.eye(4), (11, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.arange(11.0), y_m
    return Truth(np.arange(11) * S, poses, np.eye(4))


def found(offsets_m: list[float], sigma_m: float = 0.1, begin_ns: int = S // 2) -> Believed:
    """Poses off to the left by so much, halfway between those of the truth."""
    n = len(offsets_m)
    poses = np.tile(np.eye(4), (n, 1, 1))
    stamps_ns = begin_ns + np.arange(n) * S
    poses[:, 0, 3], poses[:, 1, 3] = stamps_ns / S, offsets_m
    covariances = np.tile(sigma_m**2 * np.eye(3), (n, 1, 1))
    return Believed(Way("mana", stamps_ns, poses[:, :3, 3], covariances, {}), poses, truth())


@pytest.mark.req("CDFF-DEV-074")
def test_errors_of_the_position_are_those_that_were_made() -> None:
    at = located(found([0.0, 0.3, 0.0, 0.1]))
    assert (at.robot, at.way_m) == ("mana", pytest.approx(10.0))
    assert at.rms_m == pytest.approx(np.sqrt(0.10 / 4))
    assert (at.largest_m, at.last_m) == (pytest.approx(0.3), pytest.approx(0.1))
    assert at.share == pytest.approx(0.03)
    assert "3.000% of the way" in str(at)


@pytest.mark.parametrize(("offset_m", "share"), [(0.37, 1.0), (0.38, 0.75)])
def test_three_sigmas_are_those_of_three_dimensions(offset_m: float, share: float) -> None:
    assert located(found([0.0, 0.0, offset_m, 0.0])).within_three_sigma == share


def test_poses_outside_the_time_of_the_truth_are_not_judged() -> None:
    assert located(found([50.0, *[0.1] * 10, 50.0], begin_ns=-S // 2)).largest_m == pytest.approx(0.1)


def test_a_robot_of_whose_time_there_is_no_truth_cannot_be_judged_and_the_fault_names_both_times() -> None:
    with pytest.raises(UnavailableError, match="2 poses of mana from 20000000000 to 21000000000 ns, expected some"):
        located(found([0.1, 0.1], begin_ns=20 * S))


@pytest.mark.req("CDFF-DEV-074")
def test_a_goal_is_judged_by_where_the_rover_truly_was() -> None:
    arrivals = [
        Arrival("mana", Follow(do="follow"), 2 * S, None, (2.0, 0.0)),
        Arrival("mana", GO, 8 * S, (10.0, 0.0), (10.0, 0.0)),
        Arrival("mana", Return(do="return"), 10 * S, (0.0, 0.0), (0.0, 0.0)),
        Arrival("mana", Meet(do="meet", robot="minnie", keep_m=3.0), 4 * S, (4.0, 5.0), (4.0, 2.0)),
    ]
    judged = list(reached(arrivals, {"mana": truth(), "minnie": truth(5.0)}))
    assert [r.off_m for r in judged] == pytest.approx([2.0, 10.0, 2.0])
    assert [r.goal for r in judged] == ["(10, 0)", "where it began", "3 m from minnie"]


FAIR = Mapped(100, 0.01, 0.02, 0.02)


def score(
    steepest_deg: float = 10.0, highest_m: float = 0.1, unfinished: tuple[str, ...] = (), elevation: Mapped = FAIR
) -> Score:
    arrivals = [Arrival("mana", GO, 9 * S, (10.0, 0.0), (10.0, 0.0))]
    over = Driven("mana", 50, steepest_deg, highest_m, 0, 0, 20.0, 0.2)
    return Score(
        (located(found([0.0, 0.2])),), tuple(reached(arrivals, {"mana": truth()})), (over,),
        elevation, unfinished,
    )  # fmt: skip


@pytest.mark.req("CDFF-DEV-074")
@pytest.mark.parametrize(
    ("made", "judged", "said"),
    [
        (score(), Judged(position_share=0.019), "mana: position 2.000% of the way off, expected at most 1.900%"),
        (score(), Judged(position_share=None, least_way_m=11.0), "mana: 10 m driven, expected at least 11 m"),
        (score(), Judged(position_share=None, goal_m=0.9), "truly 1.00 m off, expected at most 0.9 m"),
        (score(steepest_deg=25.1), Judged(position_share=None), "mana: drove over 25.1 deg"),
        (score(highest_m=0.31), Judged(position_share=None), "mana: drove over something of 0.31 m"),
        (score(unfinished=("mana: lost",)), Judged(position_share=None), "mana: lost"),
        (score(elevation=Mapped(100, 0.0, 0.16, 0.1)), Judged(position_share=None), "expected RMS at most 0.15 m"),
        (score(elevation=Mapped(100, 0.0, 0.1, 0.1, 2)), Judged(position_share=None), "no elevation at 2 places"),
        (score(elevation=Mapped(0, *[float("nan")] * 3)), Judged(position_share=None), "over 0 cells"),
    ],
)
def test_each_fault_is_named(made: Score, judged: Judged, said: str) -> None:
    (fault,) = made.faults(judged)
    assert said in fault


def test_what_holds_is_no_fault_and_a_way_nobody_guided_is_not_judged() -> None:
    assert score(steepest_deg=24.9, highest_m=0.29).faults(Judged(position_share=0.021, goal_m=1.01)) == []
    assert score(steepest_deg=60.0, highest_m=2.0).faults(Judged(position_share=None, guided=False)) == []


def test_positions_that_are_surer_than_they_are_right_are_a_fault() -> None:
    sure = located(found([0.0, 0.3, 0.3, 0.0], sigma_m=0.05))
    made = Score((sure,), (), (), FAIR, ())
    (fault,) = made.faults(Judged(position_share=None))
    assert fault == "mana: 50.0% of the poses within three sigmas, expected at least 95.0%"
    assert made.faults(Judged(position_share=None, three_sigma_share=0.5)) == []


def test_what_is_not_known_is_none_in_plain_data() -> None:
    made = Score((), (), (), Mapped(0, *[float("nan")] * 3), ())
    assert made.to_dict()["mapped"] == {"cells": 0, "bias_m": None, "rms_m": None, "nmad_m": None, "blank": 0}


def test_a_score_is_plain_data_and_lines() -> None:
    made = score()
    assert json.loads(json.dumps(made.to_dict()))["located"][0]["largest_m"] == pytest.approx(0.2)
    assert len(list(made.lines())) == 4


def test_the_truth_is_set_on_the_site_of_the_profile(tmp_path: Path) -> None:
    profile = load_profile(DEPLOY / "profiles" / "explorer.yaml")
    with LogWriter(tmp_path / "truth") as log:
        for i in range(3):
            T = np.eye(4)
            T[:3, 3] = 5.0 + 2.0 * i, 7.0, 1.0
            value = TransformWithCovariance.from_transform(
                UncertainTransform(T), parent="site", child="mana/base", stamp_ns=i * S
            )
            log.write("/mana/truth.pose", value, i * S)
    made = true_poses(tmp_path / "truth", profile, ["mana"])["mana"]
    assert made.way_m == pytest.approx(4.0)
    assert made.at_m(S + 1) == pytest.approx(made.poses[1, :3, 3])
    assert made.between(np.array([S // 2])) == pytest.approx(made.poses[:2, :3, 3].mean(0)[None])
    begin = made.T_site_world @ np.array([5.0, 7.0, 1.0, 1.0])
    assert made.poses[0, :3, 3] == pytest.approx(begin[:3])
