# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff simulate`` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from cdff_common.cli import main
from cdff_dev.logs import open_log
from cdff_dev.simulate.scenario import Scenario


@pytest.fixture
def scenario_file(scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a scenario of 0.4 s, with a separate cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "tiny.yaml"
    short = scenario.model_copy(update={"duration_s": 0.4})
    path.write_text(yaml.safe_dump(short.model_dump(mode="json")), encoding="utf-8")
    return path


def test_a_scenario_is_simulated_to_a_log_and_the_summary_names_it(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "log"
    assert (
        main(["simulate", str(scenario_file), "--out", str(out), "--seed", "9", "--workers", "0", "--json"])
        == 0
    )
    summary = json.loads(capsys.readouterr().out)
    assert (summary["log"], summary["seed"], summary["robots"]) == (str(out), 9, ["mana", "minnie"])
    log = open_log(out)
    assert log.streams["/mana/navcam.pair"].count == 2
    log.close()


def test_an_existing_log_is_replaced_only_on_request(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "log_000000000.msg").write_bytes(b"\x80")
    assert main(["simulate", str(scenario_file), "--out", str(tmp_path / "log")]) == 1
    assert "--force" in capsys.readouterr().err
    assert (tmp_path / "log" / "log_000000000.msg").read_bytes() == b"\x80"
    assert not (tmp_path / "cache").exists()


def test_an_unknown_scenario_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "moon_walk", "--out", str(tmp_path / "log")]) == 1
    err = capsys.readouterr().err
    assert "moon_walk" in err
    assert len(err.strip().splitlines()) == 1
