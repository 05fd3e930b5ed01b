# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, FramePair, VisualMap
from cdff_core.imaging.grey import grey_image
from tests.support import textured_walls as walls

STEP_NS = 100_000_000


def at(x_m: float, angle_rad: float = 0.0) -> np.ndarray:
    return se3.transform(se3.exp_so3([0.0, angle_rad, 0.02]), [x_m, 0.02, 0.1 * x_m])


PATH = [at(0.12 * i, -0.03 * i) for i in range(6)]


@cache
def pair(i: int, seed: int = 0) -> FramePair:
    return walls.pair(PATH[i], seed)


def node(**config: object) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_slam")
    dfpc.configure(config)
    return dfpc


def run(dfpc: Dfpc, pairs: Sequence[FramePair], first_ns: int = STEP_NS) -> list[Output]:
    """Return the poses of pairs."""
    outputs = []
    for i, value in enumerate(pairs):
        stamp_ns = first_ns + i * STEP_NS
        outputs += [o for o in dfpc.step(Sample("pair", stamp_ns, i, value, f"p{i}")) if o.port == "pose"]
    return outputs


def error_m(output: Output, i: int, start: int = 0) -> float:
    T_true = se3.inverse(PATH[start]) @ PATH[i]
    return float(np.linalg.norm(pose_error(T_true, output.value.transform.matrix)[:3]))


@cache
def finished() -> tuple[list[Output], dict[str, Output]]:
    """Return the poses along the path, and the outputs at the end."""
    dfpc = node()
    poses = run(dfpc, [pair(i) for i in range(len(PATH))])
    return poses, {output.port: output for output in dfpc.finish()}


def test_a_stereo_camera_is_located_along_its_path() -> None:
    poses, _ = finished()
    assert [output.quality.status for output in poses] == [Status.OK] * len(PATH)
    assert max(error_m(output, i) for i, output in enumerate(poses)) < 0.015
    assert poses[-1].inputs == (f"p{len(PATH) - 1}",)
    e = pose_error(se3.inverse(PATH[0]) @ PATH[-1], poses[-1].value.transform.matrix)
    assert e @ np.linalg.solve(poses[-1].value.transform.covariance, e) < 30.0


def test_the_adjusted_trajectory_graph_cloud_and_map_are_published_at_the_end() -> None:
    _, outputs = finished()
    assert set(outputs) == {"trajectory", "graph", "cloud", "map"}
    T = outputs["trajectory"].value.matrices
    true_m = np.array([(se3.inverse(PATH[0]) @ pose)[:3, 3] for pose in PATH])
    np.testing.assert_allclose(T[:, :3, 3], true_m, atol=0.01)
    depths_m = outputs["cloud"].value.points_m[:, 2]
    assert 2.0 < np.median(depths_m) < 4.2
    assert len(outputs["graph"].value.vertices.ids) == len(outputs["map"].value.keyframes) > 1


def test_images_between_keyframes_are_tracked_without_descriptors() -> None:
    dfpc = node()
    poses = run(dfpc, [walls.pair(at(0.03 * i)) for i in range(5)])
    assert [output.quality.metrics.get("tracked", 0.0) > 100.0 for output in poses] == [False] + 4 * [True]
    assert len(dfpc.keyframes) == 1
    e = pose_error(se3.inverse(at(0.0)) @ at(0.12), poses[-1].value.transform.matrix)
    assert np.linalg.norm(e[:3]) < 0.01


def test_an_rgbd_camera_is_located_whatever_image_arrives_first() -> None:
    dfpc = node()
    outputs: list[Output] = []
    for i, T in enumerate(PATH[:4]):
        frame = Frame.from_image(walls.view(T), stamp_ns=0, camera_matrix=walls.K, sensor="rover/camera")
        samples = [
            Sample("image", (i + 1) * STEP_NS, i, frame, f"i{i}"),
            Sample("depth", (i + 1) * STEP_NS + 1_000_000, i, walls.depth(T), f"d{i}"),
        ]
        for sample in samples if i % 2 else samples[::-1]:
            outputs += [o for o in dfpc.step(sample) if o.port == "pose"]
    assert [output.quality.status for output in outputs] == [Status.OK] * 4
    assert max(error_m(output, i) for i, output in enumerate(outputs)) < 0.02
    assert outputs[1].inputs == ("i1", "d1")
    assert outputs[1].child == "rover/camera"


def test_an_image_without_its_depth_image_is_refused() -> None:
    dfpc = node()
    frame = Frame.from_image(walls.view(PATH[0]), stamp_ns=0, camera_matrix=walls.K, sensor="rover/camera")
    assert not list(dfpc.step(Sample("image", STEP_NS, 0, frame, "a")))
    outputs = list(dfpc.step(Sample("image", 2 * STEP_NS, 1, frame, "b")))
    assert [(o.port, o.quality.reasons, o.inputs) for o in outputs] == [
        ("odometry", ("no_depth_image",), ("a",)),
        ("pose", ("no_depth_image",), ("a",)),
    ]
    assert [o.inputs for o in dfpc.finish()] == [("b",), ("b",)]


def test_an_unknown_scene_starts_a_part_and_the_return_is_located_in_the_first_one() -> None:
    dfpc = node()
    pairs = [pair(0), pair(1), pair(0, 5), pair(1, 5), pair(2)]
    poses = run(dfpc, pairs)
    assert [o.quality.status for o in poses] == [Status.OK] * 2 + [Status.FAILED] * 2 + [Status.OK]
    assert poses[2].quality.reasons[0] == "lost"
    assert poses[3].quality.reasons == ("not_localised_in_map",)
    assert error_m(poses[4], 2) < 0.02
    outputs = {output.port: output for output in dfpc.finish()}
    assert outputs["map"].quality.reasons[0] == "lost_images:1"
    assert outputs["map"].quality.reasons[1].startswith("keyframes_not_linked:")


def test_two_parts_are_merged_when_a_loop_connects_them() -> None:
    dfpc = node()
    start = node()
    run(start, [pair(2), pair(3)])
    run(dfpc, [pair(0, 5), pair(0), pair(1)])
    poses = run(dfpc, [pair(0, 5)], 9 * STEP_NS)
    assert poses[0].quality.status is Status.OK
    other = start.call("export_map", {})
    list(dfpc.step(Sample("map", 0, 0, other)))
    assert len(dfpc.keyframes.component(1)) >= 1 + len(other.keyframes)


def test_a_map_of_an_earlier_run_is_continued_in_its_frame() -> None:
    _, outputs = finished()
    stored = decode("VisualMap", encode(outputs["map"].value, "uper"), "uper")
    dfpc = node()
    assert not list(dfpc.step(Sample("map", 0, 0, stored)))
    value = walls.pair(at(0.18, -0.05))
    odometry, output = list(dfpc.step(Sample("pair", STEP_NS, 0, value)))[:2]
    assert [odometry.quality.status, output.quality.status] == [Status.OK] * 2
    np.testing.assert_allclose(odometry.value.transform.matrix, np.eye(4))
    e = pose_error(se3.inverse(PATH[0]) @ at(0.18, -0.05), output.value.transform.matrix)
    assert np.linalg.norm(e[:3]) < 0.02


def test_the_state_is_resumed_after_a_restart() -> None:
    dfpc, restarted = node(), node()
    run(dfpc, [pair(i) for i in range(4)])
    restarted.resume(dfpc.state())
    (output,) = run(restarted, [pair(2)], 20 * STEP_NS)
    assert error_m(output, 2) < 0.02
    with pytest.raises(InputError, match="expected VisualMap"):
        restarted.resume(3)


def test_the_map_of_known_poses_is_continued() -> None:
    dfpc = node()
    list(dfpc.step(Sample("map", 0, 0, walls.wall_map(PATH[:3]))))
    (output,) = run(dfpc, [pair(1)])
    assert np.linalg.norm(pose_error(PATH[1], output.value.transform.matrix)[:3]) < 0.02


def test_a_repeated_path_does_not_make_the_map_grow() -> None:
    dfpc = node()
    there = [pair(i) for i in range(4)]
    run(dfpc, [*there, *there[::-1]])
    count = len(dfpc.keyframes)
    run(dfpc, [*there, *there[::-1]], 20 * STEP_NS)
    assert len(dfpc.keyframes) == count
    limited = node(keyframes={"max_count": 10, "translation_ratio": 0.001, "merge_ratio": 0.0})
    run(limited, [*there, *there[::-1], *there])
    assert len(limited.keyframes) <= 10


@pytest.mark.parametrize("grey", [0, 255], ids=["black", "saturated"])
def test_images_without_texture_are_refused(grey: int) -> None:
    flat = np.full((240, 320), grey, np.uint8)
    value = FramePair.from_images(flat, flat, baseline_m=0.1, camera_matrix=walls.K, stamp_ns=0)
    (output,) = run(node(), [value])
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0].startswith("few_points:")


def test_an_image_that_is_lost_does_not_end_the_run() -> None:
    flat = np.full((240, 320), 9, np.uint8)
    black = FramePair.from_images(flat, flat, baseline_m=0.1, camera_matrix=walls.K, stamp_ns=0)
    dfpc = node()
    poses = run(dfpc, [pair(0), black])
    odometry, pose = list(dfpc.step(Sample("pair", 9 * STEP_NS, 2, pair(1))))[:2]
    assert error_m(odometry, 1) < 0.015, "the motion across the lost image is measured"
    poses.append(pose)
    assert [o.quality.status for o in poses] == [Status.OK, Status.FAILED, Status.OK]
    assert poses[1].quality.reasons[0] == "lost"
    assert error_m(poses[2], 1) < 0.015


def test_images_with_distortion_or_of_different_sizes_or_out_of_order_are_refused() -> None:
    dfpc = node()
    left = pair(0).left
    distorted = Frame.from_image(
        left.image, stamp_ns=0, camera_matrix=walls.K, dist_coeffs=[0.1, 0, 0, 0], sensor="camera"
    )
    (output,) = run(dfpc, [FramePair(left=distorted, right=pair(0).right, baseline=0.1)])
    assert "has lens distortion" in output.quality.reasons[0]
    small = Frame.from_image(np.array(left.image)[:100], stamp_ns=0, camera_matrix=walls.K, sensor="camera")
    (output,) = run(dfpc, [FramePair(left=left, right=small, baseline=0.1)])
    assert "expected equal sizes" in output.quality.reasons[0]
    run(dfpc, [pair(0)], 5 * STEP_NS)
    (output,) = run(dfpc, [pair(1)], 5 * STEP_NS)
    assert output.quality.reasons == (f"stamp_not_after:{5 * STEP_NS}",)


def test_images_of_a_pair_that_are_80_ms_apart_are_refused() -> None:
    left, right = pair(0).left, np.array(pair(0).right.image)
    images = [
        Frame.from_image(np.array(image), stamp_ns=stamp_ns, camera_matrix=walls.K, sensor="camera")
        for image, stamp_ns in ((left.image, STEP_NS), (right, STEP_NS + 80_000_000))
    ]
    (output,) = run(node(), [FramePair(left=images[0], right=images[1], baseline=walls.BASELINE_M)])
    assert output.quality.status is Status.FAILED
    assert "right image +0.080 s after the left one" in output.quality.reasons[0]


@pytest.mark.parametrize("motion", ["rotation", "forward"])
def test_a_pure_rotation_and_a_motion_along_the_axis_are_measured(motion: str) -> None:
    path = [
        se3.transform(se3.exp_so3([0.0, 0.04 * i, 0.0]), np.zeros(3))
        if motion == "rotation"
        else se3.transform(np.eye(3), [0.0, 0.0, 0.12 * i])
        for i in range(4)
    ]
    outputs = run(node(), [walls.pair(T) for T in path])
    assert [output.quality.status for output in outputs] == [Status.OK] * 4
    for T, output in zip(path, outputs, strict=True):
        assert np.linalg.norm(pose_error(T, output.value.transform.matrix)[:3]) < 0.006


def test_a_drive_over_planar_ground_is_measured() -> None:
    down = se3.exp_so3([-0.4, 0.0, 0.0])
    path = [se3.transform(down, [0.1 * i, 0.3, 0.0]) for i in range(4)]
    outputs = run(node(), [walls.pair(T, planes=walls.PLANE) for T in path])
    assert [output.quality.status for output in outputs] == [Status.OK] * 4
    for T, output in zip(path, outputs, strict=True):
        e = pose_error(se3.inverse(path[0]) @ T, output.value.transform.matrix)
        assert np.linalg.norm(e[:3]) < 0.01


def test_the_opposite_view_starts_a_part_of_the_map_without_a_false_loop() -> None:
    dfpc = node()
    opposite = se3.transform(se3.exp_so3([0.0, 0.0, np.pi]), np.zeros(3))
    poses = run(dfpc, [pair(0), pair(1), walls.pair(opposite, 5), pair(2)])
    assert poses[2].quality.status is Status.FAILED
    assert poses[2].quality.reasons[0] == "lost"
    assert error_m(poses[3], 2) < 0.02, "the first part of the map is not changed"


def test_swapped_cameras_are_refused() -> None:
    left, right = (np.array(image.image) for image in (pair(0).left, pair(0).right))
    swapped = FramePair.from_images(
        right, left, baseline_m=walls.BASELINE_M, camera_matrix=walls.K, stamp_ns=0
    )
    (output,) = run(node(), [swapped])
    assert output.quality.status is Status.FAILED


def test_a_single_pair_is_the_origin_of_a_map_of_one_keyframe() -> None:
    dfpc = node()
    (output,) = run(dfpc, [pair(0)])
    assert output.quality.status is Status.OK
    np.testing.assert_allclose(output.value.transform.matrix, np.eye(4))
    outputs = {o.port: o for o in dfpc.finish()}
    assert len(outputs["map"].value.keyframes) == 1
    assert len(outputs["trajectory"].value.stamps_ns) == 1


def test_a_camera_matrix_of_another_image_size_is_refused() -> None:
    left, right = (np.array(image.image) for image in (pair(0).left, pair(0).right))
    wrong = FramePair.from_images(
        left, right, baseline_m=walls.BASELINE_M, camera_matrix=np.diag([2.0, 2.0, 1.0]) @ walls.K, stamp_ns=0
    )
    (output,) = run(node(), [wrong])
    assert output.quality.status is Status.FAILED
    assert "principal point" in output.quality.reasons[0]


def test_forget_starts_again() -> None:
    dfpc = node()
    run(dfpc, [pair(0), pair(1)])
    dfpc.call("forget", {})
    assert dfpc.state() is None
    assert not list(dfpc.finish())
    (output,) = run(dfpc, [pair(3)])
    np.testing.assert_allclose(output.value.transform.matrix, np.eye(4))


def test_the_map_locates_images_with_visual_localisation() -> None:
    value: VisualMap = finished()[1]["map"].value
    dfpc = Registry.default().make_dfpc("visual_localisation")
    dfpc.configure({})
    list(dfpc.step(Sample("map", 0, 0, value)))
    frame = Frame.from_image(walls.view(PATH[2]), stamp_ns=0, camera_matrix=walls.K, sensor="rover/camera")
    (output,) = dfpc.step(Sample("image", 0, 1, frame))
    assert error_m(output, 2) < 0.02


#: Rows and columns of an arm at rest before the left camera, and its disparity.
ARM_ROWS, ARM_COLUMNS, ARM_DISPARITY_PX = slice(112, 240), slice(40, 104), 24


def pair_with_arm(i: int) -> FramePair:
    """Return a pair with a textured arm over a fifth of the width."""
    blocks = np.random.default_rng(3).integers(0, 256, (32, 16)).astype(np.uint8)
    texture = np.kron(blocks, np.ones((4, 4), np.uint8))
    images = []
    for value, disparity_px in ((pair(i).left, 0), (pair(i).right, ARM_DISPARITY_PX)):
        image = grey_image(value).copy()
        image[ARM_ROWS, ARM_COLUMNS.start - disparity_px : ARM_COLUMNS.stop - disparity_px] = texture
        images.append(image)
    return FramePair.from_images(
        images[0],
        images[1],
        baseline_m=walls.BASELINE_M,
        camera_matrix=walls.K,
        stamp_ns=0,
        sensor="rover/camera",
    )


def test_a_masked_arm_has_no_features() -> None:
    mask = np.full(walls.SIZE[::-1], 255, np.uint8)
    mask[ARM_ROWS, ARM_COLUMNS] = 0
    text = base64.b64encode(cv2.imencode(".png", mask)[1].tobytes()).decode()
    sensors = {"camera": {"kind": "stereo_camera", "frame": "rover/camera", "mask": text}}
    dfpc = Registry.default().make_dfpc("visual_slam")
    dfpc.configure(None, DfpcContext("rover", sensors=sensors))
    poses = run(dfpc, [pair_with_arm(i) for i in range(4)])
    assert [output.quality.status for output in poses] == [Status.OK] * 4
    assert max(error_m(output, i) for i, output in enumerate(poses)) < 0.015
    (visual_map,) = (output.value for output in dfpc.finish() if output.port == "map")
    for keyframe in visual_map.keyframes:
        pixels = keyframe.positions_m @ walls.K.T
        columns, rows = (pixels[:, :2] / pixels[:, 2:]).T
        is_in_arm = (rows > ARM_ROWS.start) & (columns > ARM_COLUMNS.start) & (columns < ARM_COLUMNS.stop)
        assert not is_in_arm.any()


def test_a_pose_that_an_unmasked_arm_has_drawn_is_not_called_ok() -> None:
    poses = run(node(), [pair_with_arm(i) for i in range(len(PATH))])
    for i, output in enumerate(poses):
        assert output.quality.status is not Status.OK or error_m(output, i) < 0.02
    reasons = {reason.split(":")[0] for output in poses for reason in output.quality.reasons}
    assert reasons <= {"small_extent", "competing_motion"}
