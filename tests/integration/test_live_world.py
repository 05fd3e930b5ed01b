# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The world of a running DPM: its frames, and the newest products at a mission time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_DONE, main
from cdff_common.client import Client
from cdff_common.errors import FrameNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import ELEVATION_LAYERS, GridGeometry
from cdff_common.types import ElevationMap, Pointcloud, TransformWithCovariance
from cdff_common.world import read_world, write_world

from .test_dpm import System, system

__all__ = ["system"]
pytestmark = pytest.mark.integration

S = 1_000_000_000
POINTS_M = np.arange(30.0).reshape(-1, 3)


def fill(system: System) -> None:
    """A rover that drives 1 m per second along x, a cloud of its lidar at 1 s and 3 s, and a map at 2 s."""
    for second in (1, 2, 3):
        T = UncertainTransform(se3.transform(np.eye(3), [second, 0.0, 0.0]), np.eye(6) * 0.01)
        pose = TransformWithCovariance.from_transform(
            T, parent="site", child="mana/base", stamp_ns=second * S
        )
        system.put(pose, "pose", second, child="mana/base", box_m=pose.extent_m())
    for seq, second in enumerate((1, 3), 1):
        cloud = Pointcloud.from_points(POINTS_M + second, frame="mana/lidar", stamp_ns=second * S)
        system.put(cloud, "pointcloud", seq, t1_ns=second * S, frame="mana/lidar", box_m=cloud.extent_m())
    geometry = GridGeometry("site", 0.1, 0.0, 1.0, 10, 10)
    layers = {name: np.ones(geometry.shape, np.float32) for name in ELEVATION_LAYERS}
    dem = ElevationMap.from_layers(geometry, layers, t0_ns=2 * S, t1_ns=2 * S)
    system.put(dem, "dem", 1, t1_ns=2 * S, box_m=dem.extent_m(), resolution_m=0.1)


def test_a_client_and_the_command_line_show_the_world_of_a_running_dpm(
    system: System, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(system)
    with Client(endpoint, name="test") as client:
        world = client.world(2_500_000_000)
        newest = client.world(values=False)
        early, late = client.world(S // 2), client.world(60 * S)
    # the DPM interpolates the pose, and has the mount of the profile
    T = world.transform("site", "mana/lidar")
    np.testing.assert_allclose(T.matrix[:3, 3], [2.5, 0.0, 2.0], atol=1e-9)
    assert T.covariance is not None
    assert T.covariance[0, 0] > 0.0
    np.testing.assert_allclose(
        world.transform("mana/lidar", "site").matrix[:3, 3], [-2.5, 0.0, -2.0], atol=1e-9
    )
    (cloud,) = world.items_of("Pointcloud", "mana/lidar")
    assert cloud.stamp_ns == S  # the cloud of 3 s is later
    np.testing.assert_allclose(cloud.value.data.points, POINTS_M + 1.0)
    assert world.item("/mana/test.dem").value.geometry.resolution_m == 0.1
    with pytest.raises(FrameNotFoundError):
        world.transform("site", "minnie/base")
    # by default the time is that of the newest pose
    assert newest.stamp_ns == 3 * S
    assert newest.item("/mana/test.pointcloud").stamp_ns == 3 * S
    assert newest.item("/mana/test.dem").value is None
    # before the first pose there are no items; after the last one its frame is not extrapolated
    assert not early.items
    assert list(late.omitted) == ["site to mana/base by /mana/test.pose"]
    assert late.item("/mana/test.dem").stamp_ns == 2 * S
    difference = world.difference_to(newest)
    assert "/mana/test.pointcloud" in str(difference)
    # one file holds the world
    again = read_world(write_world(world))
    np.testing.assert_array_equal(again.transform("site", "mana/lidar").matrix, T.matrix)
    np.testing.assert_array_equal(
        again.item("/mana/test.pointcloud").value.data.points, cloud.value.data.points
    )

    live = ["--live", "--connect", endpoint]
    assert main(["world", "show", *live, "--at", "1970-01-01T00:00:02.5Z"]) == EXIT_DONE
    out = capsys.readouterr().out
    assert "mana/base: x 2.500, y 0.000, z 0.000 m" in out
    assert "/mana/test.pointcloud  Pointcloud in mana/lidar, 1.500 s old: 10 points" in out
    assert main(["world", "diff", *live, "--at", "1970-01-01T00:00:01Z", "1970-01-01T00:00:03Z"]) == EXIT_DONE
    assert "mana/base" in capsys.readouterr().out
    target = tmp_path / "live.world"
    assert main(["world", "export", *live, "--out", str(target)]) == EXIT_DONE
    assert read_world(target.read_bytes()).stamp_ns == 3 * S


def test_the_world_of_an_empty_dpm_has_the_frames_of_the_profile(system: System, endpoint: str) -> None:
    with Client(endpoint, name="test") as client:
        world = client.world()
    np.testing.assert_allclose(world.transform("mana/base", "mana/lidar").matrix[:3, 3], [0.0, 0.0, 2.0])
    assert not world.items
