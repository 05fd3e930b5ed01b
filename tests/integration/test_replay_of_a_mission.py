# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay LOG --requests FILE``: requests switch what recorded data go through; what is made is stored."""

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
HERE = UncertainTransform(np.eye(4), np.eye(6) * 1e-6)
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
    """Twenty seconds of clouds of gently sloping ground, two a second, a profile and a script."""
    made = tmp_path_factory.mktemp("mission")
    rng = np.random.default_rng(4)
    with LogWriter(made / "log.msg") as writer:
        for i in range(40):
            points = rng.uniform([-2, -2, 0], [2, 2, 0], (12000, 3))
            points[:, 2] = 0.1 * points[:, 0] + rng.normal(0, 0.01, len(points))
            stamp_ns = 100 * S + i * S // 2
            cloud = Pointcloud.from_points(points, frame="mana/base", stamp_ns=stamp_ns)
            pose = TransformWithCovariance.from_transform(HERE, parent="site", child="mana/base", stamp_ns=stamp_ns)
            writer.write("/mana/lidar.cloud", cloud, stamp_ns)
            writer.write("/mana/localiser.pose", pose, stamp_ns)
    (made / "profile.yaml").write_text(PROFILE)
    (made / "requests.yaml").write_text(SCRIPT)
    return made


def replay(folder: Path, out: str, *more: str) -> Path:
    log = str(next(folder.glob("log*.msg")))
    command = ["replay", log, "--requests", str(folder / "requests.yaml"), "--profile", str(folder / "profile.yaml")]
    assert main([*command, "--out", str(folder / out), *more]) == 0
    return folder / out


@pytest.fixture(scope="module")
def done(folder: Path) -> Path:
    return replay(folder, "out", "--store", str(folder / "store"))


def journal(done: Path, kind: str) -> list[dict[str, Any]]:
    records = [json.loads(line) for line in (done / "journal.jsonl").read_text().splitlines()]
    return [r for r in records if r["kind"] == kind]


def at_s(record: dict[str, Any]) -> float:
    return float(record["stamp_ns"] - 100 * S) / S


@pytest.mark.req("CDFF-DEV-024")
def test_a_request_switches_sensor_and_dfpcs_on_and_they_go_off_when_nobody_needs_them(done: Path) -> None:
    switched = [(r["dfpc"], r["action"]) for r in journal(done, "activation") if r["ok"]]
    dem, navigation = "mana/digital_elevation_mapping", "mana/navigation_mapping"
    assert switched[:2] == [(dem, "activate"), (dem, "deactivate")]
    assert set(switched[2:]) == {(m, a) for m in (dem, navigation) for a in ("activate", "deactivate")}
    first_on, first_off = (at_s(r) for r in journal(done, "activation")[:2])
    assert 2.5 <= first_on <= 3.0
    assert first_off < 10.0
    assert [r["mode"] for r in journal(done, "mode")] == ["nominal", "off", "nominal", "off"]
    summary = json.loads((done / "summary.json").read_text())
    assert summary["samples"] + summary["gated"] == 80
    assert 15 <= summary["gated"] <= 32


def test_answers_are_what_was_asked_and_the_second_is_served_from_the_dpm(done: Path) -> None:
    answers = json.loads((done / "answers.json").read_text())
    assert [a["answer"] for a in answers] == ["product", "product", "product", "error"]
    assert [a["code"] for a in answers if a["answer"] == "error"] == ["UNAVAILABLE"]
    assert answers[0]["after_s"] > 0.5
    assert answers[1]["after_s"] == 0.0
    assert answers[1]["told"] == ["received"]
    with rasterio.open(done / answers[0]["file"]) as file:
        mean = file.read(1)
    columns = np.nanmean(mean, axis=0)
    assert np.polyfit(0.1 * np.arange(len(columns)), columns, 1)[0] == pytest.approx(0.1, abs=0.02)


def test_what_was_made_is_in_the_log_and_in_the_store(done: Path, folder: Path) -> None:
    log = open_log(str(next(done.glob("outputs*.msg"))))
    maps = log.streams["/mana/digital_elevation_mapping.map"].count
    log.close()
    with open_store(f"sqlite:///{folder}/store") as store:
        assert len(store.search(Query(types=("dem",), dfpc="digital_elevation_mapping")).items) == maps
        kinds = {e.kind for e in store.events.since()}
    assert {"inserted", "job", "activation", "mode"} <= kinds


def test_two_replays_are_alike_byte_for_byte(done: Path, folder: Path) -> None:
    again = replay(folder, "again")
    assert (again / "answers.json").read_bytes() == (done / "answers.json").read_bytes()
    for path in done.glob("outputs*.msg"):
        assert (again / path.name).read_bytes() == path.read_bytes()


def test_options_that_do_not_go_together_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(next(folder.glob("log*.msg")))
    for more, said in (
        (["--out", "x"], "--profile is missing"),
        (["--profile", "p", "--out", "x", "--robot", "mana"], "--robot is for --dfpc"),
    ):
        assert main(["replay", log, "--requests", "r.yaml", *more]) == 1
        assert said in capsys.readouterr().err
    assert main(["replay", log, "--dfpc", "position_manager", "--store", "dpm"]) == 1
    assert "--store is for --requests" in capsys.readouterr().err
