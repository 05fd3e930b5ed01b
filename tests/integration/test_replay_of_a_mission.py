# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay LOG --requests FILE``: requests activate DFPCs on recorded data; their products are
stored.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from cdff_common.cli import main
from cdff_common.geometry import UncertainTransform
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_dev.logs import LogWriter, open_log
from dpm_store import Query, open_store

pytestmark = pytest.mark.integration

S = 1_000_000_000
IDENTITY = UncertainTransform(np.eye(4), np.eye(6) * 1e-6)
PROFILE = """
name: clouds
robots:
  - id: mana
    sensors:
      lidar:
        kind: lidar
        frame: mana/base
        streams: {cloud: Pointcloud}
        modes: {"off": {on: false}, nominal: {rate_hz: 2.0}}
        initial_mode: "off"
        switch_s: 0.5
      localiser: {kind: other, frame: mana/base, streams: {pose: TransformWithCovariance}}
    dfpcs:
      - name: digital_elevation_mapping
        inputs: {cloud: sensor/lidar/cloud, poses: sensor/localiser/pose}
        modes: {lidar: nominal}
        linger_s: 2.0
      - name: navigation_mapping
        inputs: {dem: product/digital_elevation_mapping/map}
        linger_s: 2.0
"""
SCRIPT = """
requests:
  - {at_s: 2.0, type: dem, robot: mana, region: "bbox:-1,-1,1,1", max_age_s: 5, resolution_m: 0.1, format: tif}
  - {at_s: 6.0, type: dem, robot: mana, region: "bbox:-1,-1,1,1", max_age_s: 60, resolution_m: 0.1}
  - {at_s: 14.0, type: navigation_map, robot: any, region: "bbox:-1,-1,1,1", max_age_s: 5}
  - {at_s: 15.0, type: image, robot: mana, deadline_ms: 2000}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of 20 s of clouds of gently sloping ground at 2 Hz, a profile and a request script."""
    result = tmp_path_factory.mktemp("mission")
    rng = np.random.default_rng(4)
    with LogWriter(result / "log.msg") as writer:
        for i in range(40):
            points = rng.uniform([-2, -2, 0], [2, 2, 0], (12000, 3))
            points[:, 2] = 0.1 * points[:, 0] + rng.normal(0, 0.01, len(points))
            stamp_ns = 100 * S + i * S // 2
            cloud = Pointcloud.from_points(points, frame="mana/base", stamp_ns=stamp_ns)
            pose = TransformWithCovariance.from_transform(
                IDENTITY, parent="site", child="mana/base", stamp_ns=stamp_ns
            )
            writer.write("/mana/lidar.cloud", cloud, stamp_ns)
            writer.write("/mana/localiser.pose", pose, stamp_ns)
    (result / "profile.yaml").write_text(PROFILE)
    (result / "requests.yaml").write_text(SCRIPT)
    return result


def replay(folder: Path, out: str, *more: str) -> Path:
    log = str(next(folder.glob("log*.msg")))
    command = [
        "replay",
        log,
        "--requests",
        str(folder / "requests.yaml"),
        "--profile",
        str(folder / "profile.yaml"),
    ]
    assert main([*command, "--out", str(folder / out), *more]) == 0
    return folder / out


@pytest.fixture(scope="module")
def output(folder: Path) -> Path:
    return replay(folder, "out", "--store", str(folder / "store"))


def journal(output: Path, kind: str) -> list[dict[str, Any]]:
    records = [json.loads(line) for line in (output / "journal.jsonl").read_text().splitlines()]
    return [r for r in records if r["kind"] == kind]


def at_s(record: dict[str, Any]) -> float:
    return float(record["stamp_ns"] - 100 * S) / S


@pytest.mark.req("CDFF-DEV-024")
def test_a_request_activates_sensor_and_dfpcs_and_they_are_deactivated_when_unused(output: Path) -> None:
    activations = [(r["dfpc"], r["action"]) for r in journal(output, "activation") if r["ok"]]
    mapping, navigation = "mana/digital_elevation_mapping", "mana/navigation_mapping"
    assert activations[:2] == [(mapping, "activate"), (mapping, "deactivate")]
    assert set(activations[2:]) == {(m, a) for m in (mapping, navigation) for a in ("activate", "deactivate")}
    activated_s, deactivated_s = (at_s(r) for r in journal(output, "activation")[:2])
    assert 2.5 <= activated_s <= 3.0
    assert deactivated_s < 10.0
    assert [r["mode"] for r in journal(output, "mode")] == ["nominal", "off", "nominal", "off"]
    summary = json.loads((output / "summary.json").read_text())
    assert summary["samples"] + summary["gated"] == 80
    assert 15 <= summary["gated"] <= 32


def test_answers_satisfy_the_requests_and_the_second_comes_from_the_dpm(output: Path) -> None:
    answers = json.loads((output / "answers.json").read_text())
    assert [a["answer"] for a in answers] == ["product", "product", "product", "error"]
    assert [a["code"] for a in answers if a["answer"] == "error"] == ["UNAVAILABLE"]
    assert answers[0]["after_s"] > 0.5
    assert answers[1]["after_s"] == 0.0
    assert answers[1]["progress"] == ["received"]
    with rasterio.open(output / answers[0]["file"]) as file:
        mean = file.read(1)
    columns = np.nanmean(mean, axis=0)
    assert np.polyfit(0.1 * np.arange(len(columns)), columns, 1)[0] == pytest.approx(0.1, abs=0.02)


def test_products_are_in_the_log_and_in_the_store(output: Path, folder: Path) -> None:
    log = open_log(str(next(output.glob("outputs*.msg"))))
    maps = log.streams["/mana/digital_elevation_mapping.map"].count
    log.close()
    with open_store(f"sqlite:///{folder}/store") as store:
        assert len(store.search(Query(types=("dem",), dfpc="digital_elevation_mapping")).items) == maps
        kinds = {e.kind for e in store.events.since()}
    assert {"inserted", "job", "activation", "mode"} <= kinds


def test_two_replays_are_equal_byte_for_byte(output: Path, folder: Path) -> None:
    repeated = replay(folder, "again")
    assert (repeated / "answers.json").read_bytes() == (output / "answers.json").read_bytes()
    for path in output.glob("outputs*.msg"):
        assert (repeated / path.name).read_bytes() == path.read_bytes()


def test_conflicting_options_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(next(folder.glob("log*.msg")))
    for more, reason in (
        (["--out", "x"], "--profile is missing"),
        (["--profile", "p", "--out", "x", "--robot", "mana"], "--robot is for --dfpc"),
    ):
        assert main(["replay", log, "--requests", "r.yaml", *more]) == 1
        assert reason in capsys.readouterr().err
    assert main(["replay", log, "--dfpc", "position_manager", "--store", "dpm"]) == 1
    assert "--store needs --requests" in capsys.readouterr().err
