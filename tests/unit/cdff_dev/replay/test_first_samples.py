# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Models and a guess from files come before the samples of a log; poses of tracked bodies are absolute."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Mesh, TransformWithCovariance
from cdff_core.runtime import Runner
from cdff_dev.replay.engine import replay
from cdff_dev.replay.first_samples import file_ports, with_files, with_poses
from cdff_dev.replay.wiring import wire

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
POSE = se3.transform(se3.exp_so3([0.1, 0.2, 0.3]), [1.0, 2.0, 8.0])


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    """A mesh and a pose."""
    mesh, pose = tmp_path / "Client 1.obj", tmp_path / "guess.txt"
    mesh.write_text(TETRAHEDRON)
    np.savetxt(pose, POSE)
    return str(mesh), str(pose)


def test_files_come_first_with_the_time_of_the_first_sample(files: tuple[str, str]) -> None:
    mesh, pose = files
    description = Registry.default().dfpc("lidar_target_tracking")
    samples = [Sample("cloud", 5000, 0, None), Sample("cloud", 6000, 1, None)]
    first, second, *others = with_files(samples, description, [mesh], pose)
    assert others == samples
    assert (first.port, first.stamp_ns, first.value.frame) == ("model", 5000, "client_1/body")
    assert len(first.value.data.triangles) == 4
    assert (second.port, second.stamp_ns) == ("guess", 5000)
    np.testing.assert_allclose(second.value.transform.matrix, POSE, atol=1e-9)
    assert first.id != second.id
    assert list(with_files([], description, [mesh], pose)) == []


def test_ports_and_types_are_checked(files: tuple[str, str]) -> None:
    mesh, pose = files
    registry = Registry.default()
    samples = [Sample("scan", 0, 0, None)]
    with pytest.raises(InputError, match="lidar_slam has the ports"):
        list(with_files(samples, registry.dfpc("lidar_slam"), [mesh], None))
    tracking = registry.dfpc("lidar_target_tracking")
    with pytest.raises(InputError, match="expected a Mesh"):
        list(with_files(samples, tracking, [pose], None))
    with pytest.raises(InputError, match="given 2 times"):
        list(with_files(samples, tracking, [mesh, mesh], None))


def test_ports_of_files_need_no_stream() -> None:
    description = Registry.default().dfpc("lidar_target_tracking")
    streams = {"/robot/lidar.scan": "LidarScan"}
    with pytest.raises(InputError, match="--model FILE"):
        wire(description, streams, "robot", {})
    wired = wire(description, streams, "robot", {}, None, file_ports(["m.ply"], None))
    assert wired == {"scan": "/robot/lidar.scan"}


def test_the_trajectory_of_a_tracked_body_is_absolute(tmp_path: Path) -> None:
    dfpc = Registry.default().make_dfpc("target_tracking")
    dfpc.configure()
    value = TransformWithCovariance.from_transform(
        UncertainTransform(POSE, 1e-4 * np.eye(6)), parent="lidar", child="client/body", stamp_ns=1000
    )
    replay(dfpc, [Sample("measurement", 1000, 0, value)], tmp_path)
    _, T = read_tum(tmp_path / "pose.tum")
    np.testing.assert_allclose(T[0], POSE, atol=1e-8)


def test_poses_of_a_file_are_merged_by_time_after_other_samples_of_their_time(tmp_path: Path) -> None:
    file = tmp_path / "poses.tum"
    file.write_text("1.0 0 0 1 0 0 0 1\n2.0 0 0 2 0 0 0 1\n")
    description = Registry.default().dfpc("reconstruction_3d")
    samples = [Sample("depth", stamp_ns, 0, None) for stamp_ns in (1_000_000_000, 1_500_000_000)]
    merged = list(with_poses(samples, description, str(file)))
    assert [sample.port for sample in merged] == ["depth", "poses", "depth", "poses"]
    assert merged[-1].value.transform.matrix[2, 3] == 2.0
    assert list(with_poses(samples, description, None)) == samples
    with pytest.raises(InputError, match="expected a port poses"):
        list(with_poses(samples, Registry.default().dfpc("tracking_3d"), str(file)))


@pytest.mark.parametrize("name", ["target_detection", "model_detection"])
def test_each_of_several_models_is_accepted(name: str) -> None:
    dfpc = Registry.default().make_dfpc(name)
    dfpc.configure({"prepare": {"points": 1000, "views": 60, "view_pixels": 64, "grid_cells": 16}})
    runner = Runner(dfpc)
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    for seq, body in enumerate(("first", "second")):
        mesh = Mesh.from_arrays(vertices, np.array([[0, 1, 2], [0, 1, 3]]), frame=f"{body}/body", stamp_ns=0)
        assert runner.push(Sample("model", 5, seq, mesh))
    assert list(runner.drain()) == []
    assert runner.counters.samples == 2
