# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A replay stops at the first product that fulfils a condition, and prints the values of chosen ports."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_ERROR, main
from cdff_common.errors import InputError
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header, Product, Quality, Status
from cdff_common.types import TransformWithCovariance
from cdff_dev.replay.conditions import parse_condition


def product(status: Status = Status.OK, sigma_m: float = 0.1) -> Product:
    covariance = np.diag([sigma_m**2, 0.0, 0.0, 0.0, 0.0, np.radians(2.0) ** 2])
    value = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4), covariance), parent="site", child="base", stamp_ns=0
    )
    quality = Quality(status, ("few_inliers:12<30",), metrics={"inliers": 12.0})
    header = Header(id="x", seq=3, t0_ns=0, t1_ns=0, frame="site", producer="test", quality=quality)
    return Product("mana", "vo", "pose", "pose", "TransformWithCovariance", header=header, value=value)


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("pose.status==OK", True),
        ("pose.status!=OK", False),
        ("pose.reasons~few_inliers", True),
        ("pose.reasons~degenerate", False),
        ("pose.metrics.inliers<30", True),
        ("pose.metrics.unknown<30", False),
        ("pose.sigma_m > 0.09", True),
        ("pose.sigma_m>0.11", False),
        ("pose.sigma_deg>=1.99", True),
        ("pose.sigma_deg>2.01", False),
        ("pose.seq==3", True),
        ("map.status==OK", False),
    ],
)
def test_a_condition_compares_a_field_of_a_product(condition: str, expected: bool) -> None:
    assert parse_condition(condition, ("pose", "map")).holds(product()) is expected


@pytest.mark.parametrize(
    "condition",
    [
        "pose",
        "pose.status",
        "pose.status==BAD",
        "pose.status<OK",
        "pose.sigma_m~1",
        "pose.metrics<3",
        "pose.sigma_m>wide",
        "pose.sigma_m>nan",
        "other.status==OK",
        "pose.value==3",
    ],
)
def test_another_form_is_refused_with_the_forms_or_ports(condition: str) -> None:
    with pytest.raises(InputError, match="expected"):
        parse_condition(condition, ("pose",))


def test_a_replay_of_a_part_stops_and_prints_the_poses(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["replay", str(real_data("kitti_stereo")), "--dfpc", "visual_odometry_sparse"]
    part = ["--start", "1", "--duration", "2", "--tap", "pose", "--until", "pose.seq>=3"]
    assert main([*command, *part, "--out", str(tmp_path / "out"), "--json"]) == 0
    output = capsys.readouterr()
    assert output.err.count(" pose OK: ") == 4
    stopped = json.loads(output.out)["stopped"]
    assert (stopped["condition"], stopped["t1_ns"]) == ("pose.seq>=3", 1_300_000_000)
    stamps_ns, _ = read_tum(tmp_path / "out" / "pose.tum")
    assert list(stamps_ns) == [1_000_000_000 + n * 100_000_000 for n in range(4)]
    assert main([*command, "--tap", "map"]) == EXIT_ERROR
    assert "--tap map: no such port" in capsys.readouterr().err


@pytest.mark.slow
def test_a_replay_writes_the_last_map_and_graph(real_data: Callable[[str], Path], tmp_path: Path) -> None:
    log = str(real_data("kitti_velodyne"))
    assert (
        main(["replay", log, "--dfpc", "lidar_slam", "--until", "pose.seq>=1", "--out", str(tmp_path)]) == 0
    )
    assert (tmp_path / "cloud.ply").read_bytes().startswith(b"ply")
    assert "VERTEX_SE" in (tmp_path / "graph.g2o").read_text(encoding="utf-8")
