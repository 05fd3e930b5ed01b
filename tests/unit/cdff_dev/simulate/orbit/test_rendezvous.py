# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs of scenarios in orbit: streams, labels, truth and repeatability."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from cdff_common.cli import main
from cdff_common.geometry import se3
from cdff_dev.logs import open_log
from cdff_dev.simulate.orbit.rendezvous import simulate_orbit
from tests.unit.cdff_dev.simulate.orbit.conftest import small_scenario, small_values
from tests.unit.cdff_dev.simulate.orbit.test_motion import IMU

NAVIGATION = {
    "servicer__star_tracker": {"rate_hz": 0.5},
    "servicer__imu": IMU,
    "servicer__gnss": {"rate_hz": 0.5},
}


def test_the_command_writes_a_log_that_is_labelled_as_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file = tmp_path / "small.yaml"
    file.write_text(yaml.safe_dump(small_values(**NAVIGATION)), encoding="utf-8")
    out = tmp_path / "run.msg"
    assert main(["simulate", str(file), "--out", str(out), "--seed", "1", "--workers", "0", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["seed"], summary["robots"], summary["duration_s"]) == (1, ["servicer"], 20.0)
    log = open_log(out)
    counts = {name: stream.count for name, stream in log.streams.items()}
    assert counts["/servicer/camera.image"] == counts["/servicer/truth.camera_mask"] == 3
    assert counts["/servicer/lidar.scan"] == counts["/servicer/truth.lidar_target"] == 2
    assert counts["/servicer/imu.sample"] == 201
    assert counts["/client/truth.state"] == counts["/servicer/truth.pose"] == 21
    assert {"/servicer/gnss.state", "/servicer/star_tracker.attitude"} <= set(counts)
    for sample in log.samples():
        assert sample.header.producer == "simulator"
        assert sample.header.quality.reasons == ("simulated",)
    log.close()
    sidecar = json.loads((tmp_path / "run.scenario.json").read_text(encoding="utf-8"))
    assert sidecar["simulated"] is True
    assert {f["child"] for f in sidecar["robots"]["servicer"]["frames"]} >= {
        "servicer/camera",
        "servicer/lidar",
    }


@pytest.mark.slow
def test_samples_are_in_order_and_do_not_depend_on_the_number_of_processes() -> None:
    scenario = small_scenario(**NAVIGATION)
    here = list(simulate_orbit(scenario, workers=0))
    assert [e.stamp_ns for e, _ in here] == sorted(e.stamp_ns for e, _ in here)
    there = list(simulate_orbit(scenario, workers=1))
    assert [e.header.id for e, _ in here] == [e.header.id for e, _ in there]
    images = [[v.image for e, v in run if e.stream == "/servicer/camera.image"] for run in (here, there)]
    for first, second in zip(*images, strict=True):
        np.testing.assert_array_equal(first, second)


def test_the_truth_of_an_image_agrees_with_the_true_poses() -> None:
    scenario = small_scenario()
    values = {(e.stream, e.stamp_ns): v for e, v in simulate_orbit(scenario, workers=0)}
    at = scenario.epoch_ns
    base = values["/servicer/truth.pose", at].transform.matrix
    body = values["/client/truth.pose", at].transform.matrix
    T_base_camera = scenario.servicer.cameras["camera"].T_base_camera
    detections = values["/servicer/truth.camera_target", at].detections
    T_camera_body = detections[0].pose.transform.matrix
    # The positions relative to the Earth have rounding errors of 1e-9 m.
    np.testing.assert_allclose(se3.inverse(base @ T_base_camera) @ body, T_camera_body, atol=1e-7)
    assert detections[0].label == "client"
    centroid = values["/servicer/truth.camera_centroid", at].values
    left, top, width, height = detections[0].image_box
    assert left < centroid[0] < left + width
    assert top < centroid[1] < top + height
    sun = values["/servicer/truth.camera_sun", at].values
    assert np.linalg.norm(sun[:3]) == pytest.approx(1.0)
    assert sun[3] == 1.0
    state = values["/client/truth.state", at]
    np.testing.assert_allclose(
        np.degrees(body[:3, :3].T @ state.angular_velocity), [1.0, 2.0, 0.5], atol=1e-9
    )
    assert 7000.0 < np.linalg.norm(state.velocity) < 8000.0
