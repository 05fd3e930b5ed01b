# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A covariance is called calibrated only with a record of its errors on real data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.registry import Registry
from cdff_dev.check.calibration import calibration_faults

GOOD = {"squared_error": 6.4, "degrees_of_freedom": 6, "trials": 12}


def description(**calibrated: str) -> DfpcDescription:
    return Registry.default().dfpc("icp_localisation").model_copy(update={"calibrated": calibrated})


def write_record(root: Path, real: dict[str, Any]) -> None:
    folder = root / "docs" / "evaluation"
    folder.mkdir(parents=True)
    (folder / "icp.json").write_text(json.dumps({"figures": {"real": real}}), encoding="utf-8")


def test_a_record_on_real_data_within_the_band_has_no_fault(tmp_path: Path) -> None:
    write_record(tmp_path, {"Accurate": {"kitti 94": GOOD}})
    assert calibration_faults(tmp_path, description(Accurate="icp")) == []


def test_one_data_set_with_small_errors_is_no_fault_if_others_are_larger(tmp_path: Path) -> None:
    write_record(tmp_path, {"Accurate": {"next": GOOD, "halves": GOOD | {"squared_error": 0.1}}})
    assert calibration_faults(tmp_path, description(Accurate="icp")) == []


def test_nothing_is_required_of_a_formal_covariance(tmp_path: Path) -> None:
    assert calibration_faults(tmp_path, description()) == []


@pytest.mark.parametrize(
    ("real", "fault"),
    [
        ({}, "no figures.real.Accurate"),
        ({"Fast": {"kitti 94": GOOD}}, "no figures.real.Accurate"),
        ({"Accurate": {"kitti 94": GOOD | {"squared_error": 15.1}}}, "15.1: expected at most 15"),
        ({"Accurate": {"kitti 94": GOOD | {"squared_error": float("nan")}}}, "nan: expected at most 15"),
        ({"Accurate": {"kitti 94": GOOD | {"trials": 5}}}, "5 pairs of data: expected at least 6"),
        ({"Accurate": {"kitti 94": GOOD | {"pairs": 1}}}, "1 pairs of data: expected at least 6"),
        ({"Accurate": {"kitti 94": GOOD | {"squared_error": 0.5}}}, "0.0833: expected at least 0.1"),
        ({"Accurate": {"kitti 94": {"trials": 6}}}, "degrees_of_freedom, squared_error is missing"),
        (
            {"Accurate": {"kitti 94": GOOD, "devon": GOOD | {"squared_error": 74.0}}},
            "on devon the NEES",
        ),
    ],
)
def test_a_record_that_does_not_show_agreement_is_refused(
    tmp_path: Path, real: dict[str, Any], fault: str
) -> None:
    write_record(tmp_path, real)
    (message,) = calibration_faults(tmp_path, description(Accurate="icp"))
    assert message.startswith("Accurate is called calibrated")
    assert fault in message


def test_a_missing_record_is_refused(tmp_path: Path) -> None:
    (message,) = calibration_faults(tmp_path, description(Accurate="icp"))
    assert "record 'icp'" in message
