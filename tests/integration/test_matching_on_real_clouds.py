# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point cloud matching and SHOT localisation of measured clouds without a guess, default configuration."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.formats.pcd import read_pcd
from cdff_common.formats.ply import read_ply
from cdff_common.formats.pose import read_pose
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from evaluation.data_sets.object_views import tracked_objects

pytestmark = pytest.mark.slow

RealData = Callable[[str], Path]
Points = NDArray[np.float64]

#: T_scene_model of the milk carton as printed by PCL's correspondence grouping tutorial, without refinement.
#: The tutorial's scene has y up and z backwards; the file has y down and z forwards: hence the rotation by
#: 180° about x.
PCL_MILK = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.array(
    [
        [0.968, -0.148, 0.201, -0.171],
        [-0.146, -0.989, -0.023, -0.204],
        [0.202, -0.007, -0.979, 0.043],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def run_dfpc(dfpc: str, implementation: str | None = None, **clouds: Points) -> Output:
    compound = Registry.default().make_dfpc(dfpc)
    compound.configure(None, implementation=implementation)
    samples = [
        Sample(port, 0, 0, Pointcloud.from_points(points, frame=port, stamp_ns=0))
        for port, points in clouds.items()
    ]
    (output,) = [o for sample in samples for o in compound.step(sample)]
    return output


def errors(output: Output, T_true: Points) -> tuple[float, float]:
    """Return the translation error, m, and the rotation error, degrees."""
    T = output.value.transform.matrix
    angle = se3.rotation_angle(T[:3, :3] @ T_true[:3, :3].T)
    return float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])), float(np.degrees(angle))


def devon_halves(folder: Path) -> tuple[Points, Points, Points]:
    """Return a half of the road, the other half of its moved copy, and T_copy_road."""
    road, copy = (
        read_ply(folder / f"DevonIslandRoad1{name}.ply").points_m for name in ("", "TransformedNoise")
    )
    truth = [float(v) for v in (folder / "CloudsTransform.txt").read_text().split()]
    R = se3.matrix_from_quaternion_xyzw(truth[3:])
    permutation, half = np.random.default_rng(0).permutation(len(road)), len(road) // 2
    return road[permutation[:half]], copy[permutation[half:]], se3.transform(R, R @ np.array(truth[:3]))


def milk(folder: Path) -> tuple[Points, Points]:
    """Return model and scene of PCL's tutorial."""
    model, scene = (read_pcd(folder / n).points_m for n in ("milk.pcd", "milk_cartoon_all_small_clorox.pcd"))
    return model[np.isfinite(model).all(axis=1)], scene[np.isfinite(scene).all(axis=1)]


def test_the_small_gicp_pair_is_matched_without_a_guess(real_data: RealData) -> None:
    folder = real_data("small_gicp_pair")
    source, target = (read_ply(folder / f"{name}.ply").points_m for name in ("source", "target"))
    output = run_dfpc("point_cloud_matching", target=target, source=source)
    error_m, error_deg = errors(output, read_pose(folder / "T_target_source.txt").T.matrix)
    assert error_m <= 0.03
    assert error_deg <= 0.4


def test_disjoint_halves_of_devon_island_are_matched_without_a_guess(real_data: RealData) -> None:
    road, copy, T = devon_halves(real_data("cdff_upstream/PointClouds"))
    error_m, error_deg = errors(run_dfpc("point_cloud_matching", target=copy, source=road), T)
    assert error_m <= 0.02
    assert error_deg <= 0.1


@pytest.mark.parametrize("noise_m", [0.0, 0.001])
def test_a_scan_is_matched_with_its_own_copy(real_data: RealData, noise_m: float) -> None:
    scan = np.asarray(read_kitti_bin(real_data("kitti_velodyne") / "000000.bin").points_m, dtype=np.float64)
    copy = scan + np.random.default_rng(0).normal(0.0, noise_m, scan.shape)
    error_m, error_deg = errors(run_dfpc("point_cloud_matching", target=scan, source=copy), np.eye(4))
    assert error_m <= 0.01
    assert error_deg <= 0.01


@pytest.mark.req("CDFF-CORE-082")
def test_clouds_of_two_separate_drives_have_no_overlap(real_data: RealData) -> None:
    folder = real_data("kitti_velodyne")
    source, target = (read_kitti_bin(folder / f"{i:06d}.bin").points_m for i in (0, 94))
    output = run_dfpc("point_cloud_matching", target=target, source=source)
    assert output.value is None
    assert output.quality.reasons[0] == "no_overlap"


@pytest.mark.req("CDFF-CORE-083")
def test_the_milk_carton_is_detected_once_at_the_pose_of_pcl(real_data: RealData) -> None:
    model, scene = milk(real_data("pcl_recognition/correspondence_grouping"))
    output = run_dfpc("shot_localisation", model=model, scene=scene)
    assert output.quality.status is not Status.FAILED, output.quality.reasons
    centre = model.mean(axis=0, keepdims=True)
    result, expected = (se3.transform_points(T, centre) for T in (output.value.transform.matrix, PCL_MILK))
    assert np.linalg.norm(result - expected) <= 0.01
    assert errors(output, PCL_MILK)[1] <= 3.0
    assert float(output.quality.metrics["rms_m"]) <= 0.001


def test_disjoint_halves_of_devon_island_are_localised_without_a_guess(real_data: RealData) -> None:
    road, copy, T = devon_halves(real_data("cdff_upstream/PointClouds"))
    error_m, error_deg = errors(run_dfpc("shot_localisation", model=road, scene=copy), T)
    assert error_m <= 0.02
    assert error_deg <= 0.1


def test_a_cat_model_is_not_detected_in_the_scene_of_the_carton(real_data: RealData) -> None:
    _, scene = milk(real_data("pcl_recognition/correspondence_grouping"))
    cat = read_pcd(real_data("pcl_recognition/ism_test_cat.pcd")).points_m / 1000.0
    output = run_dfpc("shot_localisation", model=cat, scene=scene)
    assert output.value is None
    assert output.quality.reasons[0] == "not_found"


def test_dragon_and_cube_are_localised_in_single_views(real_data: RealData) -> None:
    views = tracked_objects(real_data("visp_rbt_rgbd").parent, 10)
    for view in islice(views, 2, 4):  # frame 78
        output = run_dfpc("shot_localisation", model=view.model_m, scene=view.scene_m)
        assert output.value is not None, (view.name, output.quality.reasons)
        error_m, error_deg = min((errors(output, T) for T in view.poses), key=lambda error: error[1])
        assert error_m <= 0.03
        assert error_deg <= 12.0
        assert ("symmetric_model" in output.quality.reasons) == view.name.startswith("cube")
