# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json

import pytest

from cdff_common import cli
from cdff_common.interfaces.registry import Registry


def test_list_names_every_dfn_with_its_implementations(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dfn", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split() == ["laser_filter", "NoiseFilter,", "BoxFilter"] for line in lines)


def test_list_for_machines_holds_failures_with_their_reason(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = Registry(failures={"broken_filter": "broken_filter/dfn.yaml: name is missing"})
    monkeypatch.setattr(Registry, "default", classmethod(lambda cls: broken))
    assert cli.main(["dfn", "list", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["failures"] == broken.failures
    assert cli.main(["dfpc", "list"]) == 1
    assert "broken_filter did not load: broken_filter/dfn.yaml: name is missing" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["laser_filter", "LaserFilter"])
def test_show_gives_ports_and_parameters_by_folder_or_class_name(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dfn", "show", name]) == 0
    out = capsys.readouterr().out
    assert "scan_samples: LaserScan" in out
    assert "half_window = 3  (integer ≥ 1, ≤ 50)" in out


def test_show_for_machines_is_the_description_with_its_configuration(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dfn", "show", "laser_filter", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["implementations"] == ["NoiseFilter", "BoxFilter"]
    assert data["configuration"]["BoxFilter"][2]["name"] == "remove"


@pytest.mark.req("CDFF-CORE-030")
def test_name_that_nobody_has_is_an_error_that_lists_the_known(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dfn", "show", "nonsense"]) == 1
    err = capsys.readouterr().err
    assert "no DFN 'nonsense'; known are" in err
    assert "laser_filter" in err


def test_running_a_dfpc_without_a_profile_needs_its_wiring(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CDFF_PROFILE", raising=False)
    for name, port in (("position_manager", "odometry"), ("visual_odometry_sparse", "stereo")):
        assert cli.main(["dfpc", "run", name, "--robot", "mana"]) == 1
        assert f"add --input {port}=sensor/SENSOR/STREAM" in capsys.readouterr().err


def test_a_dfpc_becomes_a_process_with_its_wiring_and_its_router(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CDFF_PROFILE", raising=False)
    become: list[list[str]] = []
    monkeypatch.setattr("os.execv", lambda _path, arguments: become.append(arguments))
    wiring = ["--input", "stereo=sensor/navcam/pair", "--connect", "tcp/127.0.0.1:9"]
    cli.main(["dfpc", "run", "visual_odometry_sparse", "--robot", "mana", *wiring])
    (arguments,) = become
    chosen = ["--robot", "mana", "--dfpc", "visual_odometry_sparse", "--connect", "tcp/127.0.0.1:9"]
    assert arguments[2:] == ["services.dfpc_host", *chosen, "--input", "stereo=sensor/navcam/pair"]
