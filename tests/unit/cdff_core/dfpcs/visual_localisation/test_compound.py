# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from cdff_common.errors import ProductNotFoundError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, FramePair, VisualMap
from cdff_core.visual_map.keyframe_points import points_of_pair
from cdff_dev.map_building.build import localisation_features
from tests.support import textured_walls as walls

T_QUERY = se3.transform(se3.exp_so3([0.03, 0.08, -0.05]), [0.15, -0.1, 0.2])


@cache
def wall_map() -> VisualMap:
    return walls.wall_map([se3.transform(np.eye(3), [x, 0.0, 0.0]) for x in (-0.3, 0.0, 0.3)])


def node(**config: object) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_localisation")
    dfpc.configure(config)
    return dfpc


def image(T: np.ndarray = T_QUERY, seed: int = 0) -> Frame:
    return Frame.from_image(walls.view(T, seed), stamp_ns=0, camera_matrix=walls.K, sensor="rover/camera")


def located(dfpc: Dfpc, frame: Frame) -> Output:
    list(dfpc.step(Sample("map", 0, 0, wall_map(), "m")))
    (output,) = dfpc.step(Sample("image", 0, 1, frame, "i"))
    return output


def test_an_image_is_located_without_a_guess_within_its_covariance() -> None:
    dfpc = node()
    output = located(dfpc, image())
    assert output.quality.status is Status.OK, output.quality.reasons
    assert (output.frame, output.child, output.inputs) == ("site", "rover/camera", ("m", "i"))
    T = output.value.transform
    e = pose_error(T_QUERY, T.matrix)
    assert np.linalg.norm(e[:3]) < 0.02
    assert np.linalg.norm(e[3:]) < np.radians(0.4)
    assert e @ np.linalg.solve(T.covariance, e) < 30.0
    assert dfpc.store.get("last_pose") == output.value
    assert len(dfpc.store.get("map_points").points_m) == len(wall_map().points_m)


def test_the_left_image_of_a_pair_is_located() -> None:
    dfpc = node()
    list(dfpc.step(Sample("map", 0, 0, wall_map())))
    (output,) = dfpc.step(Sample("pair", 0, 1, walls.pair(T_QUERY)))
    assert np.linalg.norm(pose_error(T_QUERY, output.value.transform.matrix)[:3]) < 0.02


def located_pair(left: np.ndarray, right: np.ndarray) -> Output:
    """Return the output for a stereo pair; each image has the shape (240, 320)."""
    dfpc = node()
    list(dfpc.step(Sample("map", 0, 0, wall_map())))
    value = FramePair.from_images(left, right, baseline_m=walls.BASELINE_M, camera_matrix=walls.K, stamp_ns=0)
    (output,) = dfpc.step(Sample("pair", 0, 1, value))
    return output


def test_swapped_cameras_are_refused_and_a_lost_right_camera_is_not_needed() -> None:
    left, right = (np.array(image.image) for image in (walls.pair(T_QUERY).left, walls.pair(T_QUERY).right))
    swapped = located_pair(right, left)
    assert swapped.quality.status is Status.FAILED
    assert swapped.quality.reasons[0].startswith("cameras_swapped:")
    alone = located_pair(left, np.zeros_like(right))
    assert alone.quality.status is Status.OK
    assert np.linalg.norm(pose_error(T_QUERY, alone.value.transform.matrix)[:3]) < 0.02


def test_a_map_of_a_single_keyframe_and_a_rotated_view_are_sufficient() -> None:
    dfpc = node()
    list(dfpc.step(Sample("map", 0, 0, walls.wall_map([np.eye(4)]))))
    rotated = se3.transform(se3.exp_so3([0.0, 0.15, 0.0]), np.zeros(3))
    (output,) = dfpc.step(Sample("image", 0, 1, image(rotated)))
    assert output.quality.status is Status.OK
    e = pose_error(rotated, output.value.transform.matrix)
    assert np.linalg.norm(e[:3]) < 0.02
    assert e @ np.linalg.solve(output.value.transform.covariance, e) < 30.0


def test_a_single_plane_is_located_within_its_covariance() -> None:
    extractor, match = localisation_features()
    T_map = [se3.transform(np.eye(3), [x, 0.0, 0.0]) for x in (-0.2, 0.2)]
    pairs = [walls.pair(T, planes=walls.PLANE) for T in T_map]
    value = replace(
        walls.wall_map(T_map),
        points=VisualMap.from_parts(
            walls.wall_map(T_map).graph,
            [points_of_pair(pair, extractor, match) for pair in pairs],
            sensor="rover/navcam",
            stamp_ns=0,
            descriptor_type="ROOT_SIFT",
        ).points,
    )
    dfpc = node()
    list(dfpc.step(Sample("map", 0, 0, value)))
    frame = Frame.from_image(
        walls.view(T_QUERY, planes=walls.PLANE), stamp_ns=0, camera_matrix=walls.K, sensor="rover/camera"
    )
    (output,) = dfpc.step(Sample("image", 0, 1, frame))
    assert output.quality.status is not Status.FAILED
    e = pose_error(T_QUERY, output.value.transform.matrix)
    assert e @ np.linalg.solve(output.value.transform.covariance, e) < 30.0


def test_an_image_of_another_scene_is_refused() -> None:
    output = located(node(), image(seed=5))
    assert output.value is None
    assert output.quality.reasons[0] == "not_on_the_map"


@pytest.mark.parametrize("grey", [0, 255], ids=["black", "saturated"])
def test_an_image_without_texture_is_refused(grey: int) -> None:
    frame = Frame.from_image(np.full((240, 320), grey, np.uint8), stamp_ns=0, camera_matrix=walls.K)
    assert located(node(), frame).quality.reasons[0] == "not_on_the_map"


def test_the_opposite_view_is_refused_and_a_view_ahead_is_located() -> None:
    opposite = se3.transform(se3.exp_so3([0.0, np.pi, 0.0]), np.zeros(3))
    output = located(node(), image(opposite))
    assert output.value is None
    assert output.quality.reasons[0] == "not_on_the_map"
    ahead = se3.transform(np.eye(3), [0.0, 0.0, 1.0])
    found = located(node(), image(ahead)).value.transform
    assert np.linalg.norm(pose_error(ahead, found.matrix)[:3]) < 0.02


def test_an_image_of_half_the_size_is_located_with_its_own_camera_matrix_only() -> None:
    small = np.ascontiguousarray(
        cv2.resize(walls.view(T_QUERY), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    )
    K = np.array([[120.0, 0.0, 79.75], [0.0, 120.0, 59.75], [0.0, 0.0, 1.0]])
    found = located(node(), Frame.from_image(small, stamp_ns=0, camera_matrix=K, sensor="rover/camera"))
    assert np.linalg.norm(pose_error(T_QUERY, found.value.transform.matrix)[:3]) < 0.04
    wrong = located(node(), Frame.from_image(small, stamp_ns=0, camera_matrix=walls.K, sensor="rover/camera"))
    assert wrong.quality.status is Status.FAILED
    assert "principal point (160.0, 120.0) of an image of 160 x 120 pixels" in wrong.quality.reasons[0]


def test_an_image_without_a_camera_is_refused() -> None:
    output = located(node(), Frame.from_image(walls.view(T_QUERY), stamp_ns=0))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0].startswith("bad_input:image of a camera")


@pytest.mark.parametrize(
    ("config", "reason"),
    [
        ({"min_inliers": 9000}, "few_inliers"),
        ({"min_inlier_ratio": 1.0}, "low_inlier_ratio"),
        ({"max_sigma_m": 1e-6}, "large_covariance"),
    ],
)
def test_a_pose_beyond_a_gate_is_refused_with_its_reason(config: dict[str, float], reason: str) -> None:
    output = located(node(**config), image())
    assert output.value is None
    assert reason in " ".join(output.quality.reasons)


def test_an_image_before_the_map_waits_for_it() -> None:
    dfpc = node()
    assert not list(dfpc.step(Sample("image", 0, 0, image())))
    (output,) = dfpc.step(Sample("map", 0, 1, wall_map()))
    assert output.quality.status is Status.OK


def test_without_a_map_the_images_are_refused_at_the_end() -> None:
    dfpc = node()
    list(dfpc.step(Sample("image", 0, 0, image())))
    (output,) = dfpc.finish()
    assert output.quality.reasons == ("no_map",)
    assert not list(dfpc.finish())
    with pytest.raises(ProductNotFoundError):
        dfpc.store.get("map_points")


def test_the_accuracy_of_the_map_enters_the_covariance() -> None:
    from cdff_common.formats.visual_map import read_visual_map, write_visual_map
    from cdff_common.types import PoseGraph

    base = read_visual_map(write_visual_map(wall_map()))
    v = base.graph.vertices
    graph = PoseGraph.from_arrays(
        v.ids,
        v.stamps_ns,
        v.matrices,
        np.column_stack([v.ids, v.ids]),
        v.matrices,
        np.broadcast_to(np.diag(np.repeat([1 / 0.2**2, 1 / 0.001**2], 3)), (3, 6, 6)),
        np.full(3, 2),
        frame="site",
    )
    dfpc = node()
    list(dfpc.step(Sample("map", 0, 0, VisualMap(base.metadata, graph, base.points))))
    (output,) = dfpc.step(Sample("image", 0, 1, image()))
    assert np.sqrt(output.value.transform.covariance[0, 0]) == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("ratio", [0.94, 1.07])
def test_a_wrong_focal_length_is_reported_with_its_estimate(ratio: float) -> None:
    K = walls.K.copy()
    K[0, 0] *= ratio
    K[1, 1] *= ratio
    frame = Frame.from_image(walls.view(T_QUERY), stamp_ns=0, camera_matrix=K, sensor="rover/camera")
    output = located(node(), frame)
    assert output.quality.status is Status.DEGRADED
    (reason,) = output.quality.reasons
    assert reason.startswith("focal_length:")
    assert output.quality.metrics["focal_length_ratio"] == pytest.approx(1.0 / ratio, abs=0.01)


def test_the_right_focal_length_is_confirmed() -> None:
    metrics = located(node(), image()).quality.metrics
    assert abs(metrics["focal_length_ratio"] - 1.0) < 3.0 * metrics["focal_length_ratio_sigma"] < 0.03
