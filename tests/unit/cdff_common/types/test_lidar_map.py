# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import LidarMap, PoseGraph


def graph(count: int = 3) -> PoseGraph:
    poses = np.array([se3.exp_se3([2.0 * i, 0, 0, 0, 0, 0.3 * i]) for i in range(count)]).reshape(-1, 4, 4)
    ends = [(i, i + 1) for i in range(count - 1)]
    steps = np.array([se3.inverse(poses[a]) @ poses[b] for a, b in ends]).reshape(-1, 4, 4)
    information = np.tile(np.eye(6), (len(ends), 1, 1))
    stamps = np.arange(count) * 1_000_000
    return PoseGraph.from_arrays(
        range(count), stamps, poses, ends, steps, information, [0] * len(ends), frame="site"
    )


def random_map(rng: np.random.Generator) -> tuple[LidarMap, list[np.ndarray]]:
    clouds = [rng.normal(0, 3, (n, 3)).astype(np.float32) for n in (4, 0, 7)]
    position = (1, se3.exp_se3([0.1, 0.2, 0, 0, 0, 0.5]))
    return LidarMap.from_parts(
        graph(), clouds, sensor="mana/lidar", stamp_ns=5_000, position=position
    ), clouds


@pytest.mark.parametrize("codec", ["uper", "ber", "xer", "msgpack"])
def test_clouds_and_position_survive_every_codec(rng: np.random.Generator, codec: str) -> None:
    value, clouds = random_map(rng)
    decoded = decode("LidarMap", encode(value, codec), codec)
    for cloud, expected in zip(decoded.clouds_m, clouds, strict=True):
        np.testing.assert_array_equal(cloud, expected)
    vertex, T = decoded.last_position
    assert vertex == 1
    np.testing.assert_allclose(T, value.last_position[1], atol=1e-12)
    assert (decoded.frame, decoded.stamp_ns, decoded.metadata.sensor_id) == ("site", 5_000, "mana/lidar")


def test_points_are_placed_by_the_vertices_of_the_graph(rng: np.random.Generator) -> None:
    value, clouds = random_map(rng)
    poses = value.graph.vertices.matrices
    expected = np.concatenate([se3.transform_points(T, c) for T, c in zip(poses, clouds, strict=True)])
    np.testing.assert_allclose(value.points_m, expected, atol=1e-6)
    box = value.extent_m()
    assert box is not None
    np.testing.assert_allclose(box[:3], expected.min(axis=0), atol=1e-6)


def test_an_empty_map_is_valid() -> None:
    value = LidarMap()
    assert value.clouds_m == []
    assert value.last_position is None
    assert value.extent_m() is None


def test_inconsistent_sizes_are_refused(rng: np.random.Generator) -> None:
    cloud = rng.normal(0, 1, (3, 3))
    with pytest.raises(InputError, match="clouds"):
        LidarMap.from_parts(graph(3), [cloud], sensor="s", stamp_ns=0)
    with pytest.raises(InputError, match="position"):
        LidarMap.from_parts(graph(1), [cloud], sensor="s", stamp_ns=0, position=(9, np.eye(4)))
