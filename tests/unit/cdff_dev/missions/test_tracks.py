# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tracks: poses are read in pages; the ground truth is transformed to the site; errors are computed."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

from cdff_common.errors import CdffError, UnavailableError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_common.types import TransformWithCovariance
from cdff_dev.logs import LogWriter
from cdff_dev.missions import tracks
from cdff_dev.missions.tracks import (
    Track,
    Truth,
    read_truth,
    relative_position_errors,
    transform_to_site,
)

S = 1_000_000_000
STAMPS = [1000 * i for i in range(1, 26)]


class Handler(BaseHTTPRequestHandler):
    """Answers like ``/api/v1/poses``: poses from ``t0`` on, oldest first, at most ``limit``."""

    def do_GET(self) -> None:
        parameters = {key: values[0] for key, values in parse_qs(urlsplit(self.path).query).items()}
        result = [s for s in STAMPS if s >= int(parameters.get("t0", 0))][: int(parameters["limit"])]
        body = {"items": [{"stamp_ns": str(s)} for s in result]} if parameters["robot"] == "mana" else {}
        self.send_response(200)
        self.end_headers()
        self.wfile.write(json.dumps(body).encode())

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing."""


@pytest.fixture
def http() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("page", [5, 10, 25, 100])
def test_every_pose_is_returned_once(http: str, monkeypatch: pytest.MonkeyPatch, page: int) -> None:
    monkeypatch.setattr(tracks, "_PAGE", page)
    assert [int(item["stamp_ns"]) for item in tracks.pose_series(http, "mana", "mana/base")] == STAMPS


def test_an_answer_without_items_is_an_error_that_names_the_robot(http: str) -> None:
    with pytest.raises(CdffError, match="poses of minnie over HTTP"):
        tracks.pose_series(http, "minnie", "minnie/base")


def track(y_m: float, T_moved: FloatArray | None = None, off_m: float = 0.0) -> Track:
    """Return eight poses along x, one per second, transformed and then shifted left by ``off_m``."""
    stamps_ns = np.arange(8) * S
    true = se3.transform(np.tile(np.eye(3), (8, 1, 1)), [[float(i), y_m, 0.0] for i in range(8)])
    poses = (np.eye(4) if T_moved is None else T_moved) @ true
    poses[:, 1, 3] += off_m
    return Track("mana", stamps_ns, poses, np.zeros((8, 3, 3)), Truth(stamps_ns, true))


def test_a_common_displacement_of_both_robots_is_not_an_error() -> None:
    T_displaced = se3.exp_se3([3.0, 1.0, 0.5, 0.1, 0.2, 1.0])
    errors = relative_position_errors([track(0, T_displaced), track(2, T_displaced)], 5.0)
    assert errors.largest_m == pytest.approx(0.0, abs=1e-9)


def test_a_displacement_of_one_robot_is_the_error_of_all_pairs_that_are_close() -> None:
    shift = se3.transform(np.eye(3), [0.3, 0.0, 0.4])
    errors = relative_position_errors([track(0), track(2, shift)], 5.0)
    assert errors.rms_m == pytest.approx(0.5)
    assert errors.pairs == sum(abs(i - j) <= np.sqrt(21) for i in range(8) for j in range(8))


def test_a_track_states_its_errors_relative_to_the_truth() -> None:
    assert "8 poses, 7.0 m; position error: RMS 0.300 m, last 0.300 m" in str(track(0.0, off_m=0.3))


def test_a_track_without_ground_truth_is_reported_as_such() -> None:
    no_truth = Truth(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)))
    assert "no ground truth" in str(replace(track(0.0), truth=no_truth))


def test_the_ground_truth_is_transformed_to_the_site_of_the_profile(tmp_path: Path) -> None:
    profile = load_profile(deploy_folder() / "profiles" / "explorer.yaml")
    with LogWriter(tmp_path / "truth") as log:
        for i in range(3):
            T = np.eye(4)
            T[:3, 3] = 5.0 + 2.0 * i, 7.0, 1.0
            value = TransformWithCovariance.from_transform(
                UncertainTransform(T), parent="site", child="mana/base", stamp_ns=i * S
            )
            log.write("/mana/truth.pose", value, i * S)
    result = transform_to_site(read_truth(tmp_path / "truth", ["mana"]), profile)["mana"]
    assert result.path_length_m == pytest.approx(4.0)
    assert result.position_at_m(S + 1) == pytest.approx(result.poses[1, :3, 3])
    assert result.interpolated_positions_m(np.array([S // 2])) == pytest.approx(
        result.poses[:2, :3, 3].mean(0)[None]
    )
    start = result.T_site_world @ np.array([5.0, 7.0, 1.0, 1.0])
    assert result.poses[0, :3, 3] == pytest.approx(start[:3])


@pytest.mark.parametrize("first", [UnavailableError("the DPM holds no poses of mana"), 9])
def test_an_assessment_is_repeated_until_it_is_possible_and_settled(
    monkeypatch: pytest.MonkeyPatch, first: Exception | int
) -> None:
    monkeypatch.setattr(tracks.time, "sleep", lambda _seconds: None)
    results = iter([first, first, 1])

    def assess() -> int:
        result = next(results)
        if isinstance(result, Exception):
            raise result
        return result

    assert tracks.assess_until_settled(assess, lambda n: n == 1, wait_s=60.0) == 1


def test_the_last_assessment_is_the_result() -> None:
    assert tracks.assess_until_settled(lambda: 9, lambda n: n == 1, wait_s=-1.0) == 9

    def impossible() -> int:
        raise UnavailableError("the DPM holds no poses of mana")

    with pytest.raises(UnavailableError, match="no poses of mana"):
        tracks.assess_until_settled(impossible, lambda n: n == 1, wait_s=-1.0)
