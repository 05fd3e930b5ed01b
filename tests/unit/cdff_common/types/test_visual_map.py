# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import CodecError, InputError
from cdff_common.formats.npz import write_npz
from cdff_common.formats.visual_map import read_visual_map, write_visual_map
from cdff_common.geometry import se3
from cdff_common.types import PoseGraph, VisualMap
from cdff_common.types.visual_map_ext import KeyframePoints


def graph(n: int) -> PoseGraph:
    poses = [se3.transform(se3.exp_so3([0.1 * i, 0, 0]), [i, 0, 0]) for i in range(n)]
    return PoseGraph.from_arrays(
        np.arange(n),
        np.arange(n) * 1000,
        np.array(poses).reshape(-1, 4, 4),
        np.zeros((0, 2), np.int64),
        np.zeros((0, 4, 4)),
        np.zeros((0, 6, 6)),
        np.zeros(0),
        frame="site",
    )


def keyframe(n: int, seed: int = 0) -> KeyframePoints:
    rng = np.random.default_rng(seed)
    return KeyframePoints(
        rng.normal(size=(n, 3)), rng.random(n), rng.integers(0, 255, (n, 4)).astype(np.uint8)
    )


def visual_map() -> VisualMap:
    return VisualMap.from_parts(
        graph(3),
        [keyframe(4), keyframe(0), keyframe(2, 1)],
        sensor="rover/navcam",
        stamp_ns=2000,
        descriptor_type="ROOT_SIFT",
    )


def test_keyframes_survive_the_codecs_and_the_file() -> None:
    value = visual_map()
    for copy in (
        decode("VisualMap", encode(value, "uper"), "uper"),
        read_visual_map(write_visual_map(value)),
    ):
        assert [len(k) for k in copy.keyframes] == [4, 0, 2]
        np.testing.assert_array_equal(copy.keyframes[2].descriptors, keyframe(2, 1).descriptors)
        np.testing.assert_allclose(copy.points_m, value.points_m, atol=1e-6)
        assert (copy.frame, copy.stamp_ns, copy.metadata.sensor_id) == ("site", 2000, "rover/navcam")


def test_points_are_in_the_frame_of_the_map() -> None:
    value = visual_map()
    T = value.graph.vertices.matrices[2]
    np.testing.assert_allclose(
        value.points_m[4:], se3.transform_points(T, keyframe(2, 1).positions_m), atol=1e-6
    )


def test_an_empty_map_has_no_points() -> None:
    assert VisualMap().points_m.shape == (0, 3)
    assert VisualMap().keyframes == []


def test_unequal_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="1 counts for 2 vertices"):
        VisualMap.from_parts(graph(2), [keyframe(3)], sensor="", stamp_ns=0, descriptor_type="")
    bad = KeyframePoints(np.zeros((2, 3)), np.zeros(1), np.zeros((2, 4), np.uint8))
    with pytest.raises(InputError, match="1 depth sigmas"):
        VisualMap.from_parts(graph(1), [bad], sensor="", stamp_ns=0, descriptor_type="")


def test_another_archive_is_refused() -> None:
    with pytest.raises(CodecError, match="expected a visual map"):
        read_visual_map(write_npz({"a": np.zeros(2)}))
