# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ICP localisation of real clouds with the default configuration: errors within stated bounds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.formats.ply import read_ply
from cdff_common.formats.pose import read_pose
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud, TransformWithCovariance
from evaluation.data_sets.clouds import T_CAMERA_LIDAR

RealData = Callable[[str], Path]
Points = NDArray[np.float64]

QUICK_SEEDS, ALL_SEEDS = 10, 100


def localise(
    scene: Points, model: Points, guess: Points | None = None, implementation: str | None = None
) -> Output:
    dfpc: Dfpc = Registry.default().make_dfpc("icp_localisation")
    dfpc.configure(None, implementation=implementation)
    values: dict[str, object] = {
        "model": Pointcloud.from_points(model, frame="model", stamp_ns=0),
        "scene": Pointcloud.from_points(scene, frame="scene", stamp_ns=0),
    }
    if guess is not None:
        values["guess"] = TransformWithCovariance.from_transform(
            UncertainTransform(guess), parent="scene", child="model", stamp_ns=0
        )
    (output,) = [o for port in sorted(values) for o in dfpc.step(Sample(port, 0, 0, values[port]))]
    return output


def errors(output: Output, T_true: Points) -> tuple[float, float]:
    """Return the translation error, m, and the rotation error, degrees."""
    T = output.value.transform.matrix
    return (
        float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])),
        float(np.degrees(se3.rotation_angle(T[:3, :3] @ T_true[:3, :3].T))),
    )


@pytest.mark.parametrize("implementation", ["PointToPlane", "Gicp"])
def test_a_kitti_pair_is_registered_without_an_initial_guess(
    real_data: RealData, implementation: str
) -> None:
    folder = real_data("kitti_velodyne")
    poses = np.loadtxt(folder / "00_poses_cam0.txt").reshape(-1, 3, 4)
    T_world_94, T_world_95 = (np.vstack([poses[i], [0, 0, 0, 1]]) for i in (94, 95))
    T_camera_lidar = T_CAMERA_LIDAR
    T_true = np.linalg.inv(T_camera_lidar) @ np.linalg.inv(T_world_94) @ T_world_95 @ T_camera_lidar
    scene, model = (read_kitti_bin(folder / f"{i:06d}.bin").points_m for i in (94, 95))
    output = localise(scene, model, implementation=implementation)
    error_m, error_deg = errors(output, T_true)
    assert output.quality.status is Status.OK
    assert error_m <= 0.02
    assert error_deg <= 0.06


@pytest.mark.parametrize("implementation", ["PointToPlane", "Gicp"])
def test_the_small_gicp_pair_agrees_with_its_approximate_reference(
    real_data: RealData, implementation: str
) -> None:
    folder = real_data("small_gicp_pair")
    scene, model = (read_ply(folder / f"{name}.ply").points_m for name in ("target", "source"))
    output = localise(scene, model, implementation=implementation)
    error_m, error_deg = errors(output, read_pose(folder / "T_target_source.txt").T.matrix)
    assert output.quality.status is Status.OK
    assert error_m <= 0.02
    assert error_deg <= 0.4


def test_clouds_of_two_separate_drives_are_refused(real_data: RealData) -> None:
    folder = real_data("kitti_velodyne")
    scene, model = (read_kitti_bin(folder / f"{i:06d}.bin").points_m for i in (94, 0))
    assert localise(scene, model).quality.status is Status.FAILED


def devon_island(real_data: RealData, seeds: range) -> list[tuple[str, float, float]]:
    """Register disjoint halves of the road and of its moved copy, with guesses off by 0.5 m and 10 degrees.

    Return status, error in metres and error in degrees of each trial.
    """
    folder = real_data("cdff_upstream/PointClouds")
    road, copy = (
        read_ply(folder / f"DevonIslandRoad1{name}.ply").points_m for name in ("", "TransformedNoise")
    )
    truth = [float(v) for v in (folder / "CloudsTransform.txt").read_text().split()]
    R = se3.matrix_from_quaternion_xyzw(truth[3:])
    T_copy_road = se3.transform(R, R @ np.array(truth[:3]))
    results = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        permutation = rng.permutation(len(road))
        half = len(road) // 2
        axis, shift = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        guess_error = se3.transform(se3.exp_so3(np.radians(10.0) * axis), 0.5 * shift)
        is_copy_scene = seed % 2 == 0
        scene, model = (copy, road) if is_copy_scene else (road, copy)
        T_true = T_copy_road if is_copy_scene else se3.inverse(T_copy_road)
        # Rotate about the scene's origin or, in every second pair of trials, about the model's.
        guess = T_true @ guess_error if (seed // 2) % 2 else guess_error @ T_true
        output = localise(scene[permutation[:half]], model[permutation[half:]], guess)
        error_m, error_deg = (np.nan, np.nan) if output.value is None else errors(output, T_true)
        results.append((str(output.quality.status), error_m, error_deg))
    return results


def assert_nearly_all_correct(results: list[tuple[str, float, float]]) -> None:
    with_pose = [r for r in results if r[0] != "FAILED"]
    correct = [r for r in with_pose if r[1] <= 0.02 and r[2] <= 0.1]
    assert len(correct) == len(with_pose), "a wrong pose was returned instead of FAILED"
    assert len(correct) >= 0.95 * len(results)


@pytest.mark.slow
def test_a_nearly_planar_road_is_registered_in_ten_trials(real_data: RealData) -> None:
    assert_nearly_all_correct(devon_island(real_data, range(QUICK_SEEDS)))


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_a_nearly_planar_road_is_registered_in_a_hundred_trials(real_data: RealData) -> None:
    assert_nearly_all_correct(devon_island(real_data, range(ALL_SEEDS)))
