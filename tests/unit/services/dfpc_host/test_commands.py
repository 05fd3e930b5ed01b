# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common import cli
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.registry import Registry
from cdff_common.types import PoseTrajectory, TransformWithCovariance


def test_list_names_every_dfn_with_its_implementations(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dfn", "list"]) == 0
    header, *lines = capsys.readouterr().out.splitlines()
    assert header.split() == ["name", "implementations", "summary"]
    line = next(line for line in lines if line.startswith("laser_filter "))
    assert line.split()[1:3] == ["NoiseFilter,", "BoxFilter"]
    assert line.endswith(".")


def test_json_list_contains_load_failures_with_their_reason(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = Registry(failures={"broken_filter": "broken_filter/dfn.yaml: name is missing"})
    monkeypatch.setattr(Registry, "default", classmethod(lambda cls: broken))
    assert cli.main(["dfn", "list", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["failures"] == broken.failures
    assert cli.main(["dfpc", "list"]) == 1
    assert "broken_filter did not load: broken_filter/dfn.yaml: name is missing" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["laser_filter", "LaserFilter"])
def test_show_gives_ports_and_parameters_by_folder_or_class_name(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["dfn", "show", name]) == 0
    out = capsys.readouterr().out
    assert "scan_samples: LaserScan" in out
    assert "half_window = 3  (integer ≥ 1, ≤ 50)" in out


def test_json_show_is_the_description_with_its_configuration(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["dfn", "show", "laser_filter", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["implementations"] == ["NoiseFilter", "BoxFilter"]
    assert data["configuration"]["BoxFilter"][2]["name"] == "remove"


@pytest.mark.req("CDFF-CORE-030")
def test_an_unknown_name_is_refused_with_the_available_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["dfn", "show", "nonsense"]) == 1
    err = capsys.readouterr().err
    assert "no DFN 'nonsense'; expected one of" in err
    assert "laser_filter" in err


def test_running_a_dfpc_without_a_profile_needs_its_wiring(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CDFF_PROFILE", raising=False)
    for name, port in (("position_manager", "odometry"), ("visual_odometry_sparse", "stereo")):
        assert cli.main(["dfpc", "run", name, "--robot", "mana"]) == 1
        assert f"add --input {port}=sensor/SENSOR/STREAM" in capsys.readouterr().err


def test_a_dfpc_is_started_as_a_process_with_wiring_and_router(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CDFF_PROFILE", raising=False)
    executed: list[list[str]] = []
    monkeypatch.setattr("os.execv", lambda _path, arguments: executed.append(arguments))
    wiring = ["--input", "stereo=sensor/navcam/pair", "--connect", "tcp/127.0.0.1:9"]
    cli.main(["dfpc", "run", "visual_odometry_sparse", "--robot", "mana", *wiring])
    (arguments,) = executed
    options = ["--robot", "mana", "--dfpc", "visual_odometry_sparse", "--connect", "tcp/127.0.0.1:9"]
    assert arguments[2:] == ["services.dfpc_host", *options, "--input", "stereo=sensor/navcam/pair"]


class ClientDouble:
    """Client double that records the arguments of each call and returns ``value``."""

    calls: list[tuple[object, ...]] = []
    value: Any = None

    def __init__(self, *_: object, **__: object) -> None: ...

    def __enter__(self) -> ClientDouble:
        return self

    def __exit__(self, *_: object) -> None: ...

    def call(self, *arguments: object, timeout_s: float) -> tuple[Any, dict[str, Any]]:
        self.calls.append((*arguments, timeout_s))
        return self.value, {"frame": "site", "t1_ns": 7_000, "quality": {"covariance_kind": "formal"}}


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> type[ClientDouble]:
    monkeypatch.setattr("cdff_common.client.Client", ClientDouble)
    monkeypatch.setattr(ClientDouble, "calls", [])
    return ClientDouble


@pytest.mark.req("CDFF-SUP-195")
def test_an_operation_is_called_with_its_parameters_and_its_pose_is_printed(
    client: type[ClientDouble], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pose = UncertainTransform(se3.transform(np.eye(3), [1.0, 2.0, 3.0]), np.eye(6))
    value = TransformWithCovariance.from_transform(pose, parent="site", child="mana/head", stamp_ns=7_000)
    monkeypatch.setattr(ClientDouble, "value", value)
    command = ["call", "mana", "Pom", "get_pose", "parent=site", "child=mana/head", "--timeout-s", "3"]
    assert cli.main([*command, "--json"]) == 0
    assert client.calls == [
        ("mana", "position_manager", "get_pose", {"parent": "site", "child": "mana/head"}, 3.0)
    ]
    document = json.loads(capsys.readouterr().out)
    assert (document["parent"], document["child"], document["stamp_ns"], document["T"][1][3]) == (
        "site",
        "mana/head",
        "7000",
        2.0,
    )
    assert document["covariance_kind"] == "formal"
    assert cli.main(command) == 0
    assert "position: x 1.000, y 2.000, z 3.000 m\n" in capsys.readouterr().out


def test_a_product_value_is_written_to_the_named_file(
    client: type[ClientDouble],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    stamps, poses = np.array([1_000, 2_000]), np.tile(np.eye(4), (2, 1, 1))
    route = PoseTrajectory.from_arrays(stamps, poses, None, parent="site", child="mana/base")
    monkeypatch.setattr(ClientDouble, "value", route)
    command = [
        "call",
        "mana",
        "navigation_mapping",
        "get_route",
        "from_x_m=0",
        "from_y_m=0",
        "to_x_m=1",
        "to_y_m=2",
    ]
    assert cli.main([*command, "--out", str(tmp_path / "route.tum"), "--json"]) == 0
    assert len((tmp_path / "route.tum").read_text().splitlines()) == 2
    assert json.loads(capsys.readouterr().out)["type"] == "PoseTrajectory"
    assert cli.main([*command, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document.pop("value")["metadata"]["parentFrameId"] == "site"
    assert document | {"extent_m": None} == {
        "type": "PoseTrajectory",
        "frame": "site",
        "t1_ns": "7000",
        "extent_m": None,
        "out": ["tum", "npz", "geojson", "uper"],
    }
    assert cli.main([*command, "--out", "-"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    assert cli.main([*command, "--plot", str(tmp_path / "route.png")]) == 0
    assert (tmp_path / "route.png").read_bytes().startswith(b"\x89PNG")
    for ending in ("uper", "npz", "geojson"):
        assert cli.main([*command, "--out", str(tmp_path / f"route.{ending}")]) == 0
        assert (tmp_path / f"route.{ending}").stat().st_size > 0


def test_plain_values_are_printed_unchanged(
    client: type[ClientDouble], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["call", "mana", "position_manager", "unpin", "t_ns=7000", "--json"]) == 0
    assert capsys.readouterr().out == "null\n"


def test_without_an_operation_the_available_ones_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["call", "mana", "navigation_mapping"]) == 0
    inputs_of_operations = {
        o["name"]: [p["name"] for p in o["inputs"]] for o in json.loads(capsys.readouterr().out)
    }
    assert inputs_of_operations["get_reachable"] == ["x_m", "y_m"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["get_rout"], "no operation 'get_rout'; it has get_map"),
        (["get_route", "x"], "'x': expected KEY=VALUE"),
        (["get_route", "to_x_m=1", "to_x_m=2"], "to_x_m is given twice"),
        (
            ["get_route", "--out", "route.ply"],
            "'.ply' is no format of a PoseTrajectory, expected one of .tum",
        ),
        (["get_route", "--out", "no/route.tum"], "there is no folder no"),
    ],
)
def test_an_invalid_call_is_refused_before_it_is_sent(
    arguments: list[str], reason: str, client: type[ClientDouble], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["call", "mana", "navigation_mapping", *arguments]) == 1
    assert reason in capsys.readouterr().err
    assert client.calls == []
