# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wrong inputs are refused or flagged, or their errors are covered by the stated covariance."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import Pointcloud
from evaluation import wrong_input
from evaluation.runs import wrong_bundles, wrong_clouds, wrong_maps
from evaluation.runs.wrong_input import LIMIT_SIGMAS, Case, answer

CLOUD_FAULTS = ("none", "empty", "plane", "1 % NaN", "offset of 10⁹ m")
#: Faults that the estimators cannot observe; the page of the evaluation lists them.
UNOBSERVABLE = "focal length 3 % too long"


@pytest.mark.slow
@pytest.mark.parametrize("source", [wrong_bundles, wrong_maps], ids=["observations", "maps"])
def test_wrong_maps_and_observations_are_refused_flagged_or_within_three_sigmas(source: ModuleType) -> None:
    rows = {(case.dfpc, case.fault): answer(case) for case in source.cases(Path())}
    assert [key for key, row in rows.items() if not row["acceptable"] and UNOBSERVABLE not in key[1]] == []


def test_wrong_clouds_are_refused_flagged_or_within_three_sigmas(real_data: Callable[[str], Path]) -> None:
    cases = wrong_clouds.cases(real_data("kitti_velodyne").parent)
    answers = {c.fault: answer(c) for c in cases if c.dfpc == "icp_localisation" and c.fault in CLOUD_FAULTS}
    assert [fault for fault, row in answers.items() if not row["acceptable"]] == []
    assert answers["none"]["status"] == "OK"
    assert answers["plane"]["reason"].startswith("degenerate")


def make_case(samples: Callable[[], list[Sample]], error_sigmas: float = 0.0) -> Case:
    return Case("digital_elevation_mapping", "", "", "map", samples, lambda _: error_sigmas)


def cloud() -> list[Sample]:
    points = [[0.1 * i, 0.1 * j, 0.0] for i in range(5) for j in range(5)]
    return [Sample("cloud", 0, 0, Pointcloud.from_points(points, frame="map", stamp_ns=0))]


@pytest.mark.parametrize(("error_sigmas", "acceptable"), [(0.0, True), (LIMIT_SIGMAS + 0.1, False)])
def test_an_answer_without_a_flag_is_judged_by_its_error(error_sigmas: float, acceptable: bool) -> None:
    row = answer(make_case(cloud, error_sigmas))
    assert (row["status"], row["acceptable"]) == ("OK", acceptable)


def test_typed_errors_are_refusals_and_silence_and_other_exceptions_are_not_acceptable() -> None:
    def raise_error(error: Exception) -> list[Sample]:
        raise error

    refused, crashed, silent = (
        answer(make_case(samples))
        for samples in (lambda: raise_error(InputError("x")), lambda: raise_error(ValueError("x")), list)
    )
    assert (refused["status"], refused["acceptable"]) == ("refused", True)
    assert (crashed["status"], crashed["acceptable"]) == ("crashed", False)
    assert (silent["status"], silent["acceptable"]) == ("silent", False)


def test_the_table_lists_what_is_not_flagged() -> None:
    def row(status: str, acceptable: bool) -> dict[str, Any]:
        return {"status": status, "reason": "", "error_sigmas": 5.0, "acceptable": acceptable}

    answers = {"none": row("OK", True), "black": row("FAILED", True), "focal length": row("OK", False)}
    table = wrong_input.table({"limit_sigmas": 3.0, "dfpcs": {"triangulation": {"Teddy": answers}}})
    assert "1 of 2 wrong inputs" in table
    assert "| `triangulation` | 2 | 1 | 0 | 0 | 1 |" in table
    assert table.count("focal length") == 2
