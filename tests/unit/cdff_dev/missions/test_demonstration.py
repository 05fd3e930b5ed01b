# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The demonstration checks its arguments before it simulates."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.cli import main


@pytest.mark.parametrize("options", [[], ["--attach"]])
def test_an_unknown_scenario_is_refused_before_the_simulation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    assert main(["demo", "--scenario", "nope", "--data-dir", str(tmp_path / "data"), *options]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    shipped = "close_approach, distant_rovers, kitti, orbit_approach, rover_traverse"
    assert f"demonstration 'nope': no such file; shipped are {shipped}" in err
    assert not (tmp_path / "data").exists()
