# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Surface of a sphere from depth images and clouds of known pose."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from cdff_common.arrays import FloatArray
from cdff_common.errors import ConfigurationError, InputError, ProductNotFoundError
from cdff_common.formats.meshes import read_mesh
from cdff_common.formats.payload import to_file
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import DistanceImage, Frame, FramePair, Pointcloud, Time, TransformWithCovariance
from cdff_core.dfpcs.reconstruction_3d.compound import Reconstruction3D
from tests.support.depth_sphere import COLUMNS, RADIUS_M, ROWS, K, camera_poses, depth_image
from tests.support.kernels import compiled_signatures

POSES = camera_poses(16)


def _dfpc(**parameters: object) -> Reconstruction3D:
    dfpc = Reconstruction3D()
    dfpc.configure({"voxel_m": 0.04, **parameters})
    return dfpc


def _stamp_ns(number: int) -> int:
    return (number + 1) * 100_000_000


def _depth(number: int, depth: FloatArray | None = None) -> Sample:
    f = K[0, 0]
    image = DistanceImage(
        ref_time=Time.from_ns(_stamp_ns(number)),
        width=COLUMNS,
        height=ROWS,
        scale_x=1.0 / f,
        scale_y=1.0 / f,
        center_x=-K[0, 2] / f,
        center_y=-K[1, 2] / f,
        data=(depth_image() if depth is None else depth).ravel(),
    )
    return Sample("depth", _stamp_ns(number), number, image, id=f"depth-{number}", frame="servicer/depth")


def _pose(
    number: int,
    T: FloatArray,
    parent: str = "world",
    child: str = "servicer/depth",
    covariance: FloatArray | None = None,
) -> Sample:
    transform = UncertainTransform.exact(T) if covariance is None else UncertainTransform(T, covariance)
    value = TransformWithCovariance.from_transform(
        transform, parent=parent, child=child, stamp_ns=_stamp_ns(number)
    )
    return Sample("poses", _stamp_ns(number), number, value, id=f"pose-{number}")


def _run(dfpc: Reconstruction3D, samples: Iterable[Sample]) -> dict[str, list[Output]]:
    outputs = [output for sample in samples for output in dfpc.step(sample)]
    outputs += dfpc.finish()
    return {port: [o for o in outputs if o.port == port] for port in ("mesh", "cloud", "pose")}


def _captures(poses: FloatArray) -> list[Sample]:
    return [s for n, T in enumerate(poses) for s in (_depth(n), _pose(n, T))]


def _assert_sphere(vertices: FloatArray, normals: FloatArray, limit_m: float) -> None:
    radii = np.linalg.norm(vertices, axis=1)
    assert np.sqrt(np.mean((radii - RADIUS_M) ** 2)) < limit_m
    assert np.median((normals * vertices).sum(axis=1) / radii) > 0.97


def test_the_first_image_compiles_nothing() -> None:
    """All kernels of the fusion are compiled when the compound is configured."""
    dfpc = _dfpc()
    compiled = compiled_signatures("cdff_core.dfns.surface_fusion.")
    assert _run(dfpc, _captures(camera_poses(8)))["mesh"][0].value is not None
    assert len(compiled) > 3
    assert compiled_signatures("cdff_core.dfns.surface_fusion.") == compiled


def test_depth_images_around_a_sphere_give_its_surface() -> None:
    outputs = _run(_dfpc(), _captures(camera_poses(40)))
    assert len(outputs["pose"]) == 40
    (mesh,), (cloud,) = outputs["mesh"], outputs["cloud"]
    assert mesh.quality.status is Status.OK
    assert mesh.frame == mesh.value.frame == "world"
    data = mesh.value.data
    _assert_sphere(data.vertices, data.normals, 0.006)
    corners = data.vertices[data.triangles]
    volume = np.einsum("ni,ni->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS_M**3, rel=0.05)
    assert len(cloud.value.points_m) == len(data.vertices)
    assert (cloud.value.intensity > 0).all()
    assert mesh.quality.metrics["views"] >= 2


def test_the_mesh_file_is_read_as_a_model() -> None:
    mesh = _run(_dfpc(), _captures(POSES))["mesh"][0].value
    model = read_mesh(to_file(mesh, "ply"))
    np.testing.assert_allclose(model.vertices, mesh.data.vertices, atol=1e-6)
    np.testing.assert_array_equal(model.triangles, mesh.data.triangles)


def test_poses_of_a_body_are_inverted_by_their_frames() -> None:
    samples = [
        sample
        for n, T in enumerate(POSES)
        for sample in (_depth(n), _pose(n, se3.inverse(T), "servicer/depth", "client/body"))
    ]
    mesh = _run(_dfpc(), samples)["mesh"][0]
    assert mesh.frame == "client/body"
    _assert_sphere(mesh.value.data.vertices, mesh.value.data.normals, 0.006)


@pytest.mark.parametrize(
    ("parameter", "first"), [("max_pose_sigma_m", 0), ("max_pose_sigma_rad", 3)], ids=["position", "rotation"]
)
def test_poses_worse_than_the_limit_are_excluded_with_the_reason(parameter: str, first: int) -> None:
    """The standard deviation of every second pose is above the limit, in a direction between the axes."""
    limit, direction = 0.01, np.array([0.6, 0.8, 0.0])
    samples = []
    for n, T in enumerate(POSES):
        sigma = limit * (1.05 if n % 2 else 0.95)
        covariance = np.eye(6) * 1e-8
        covariance[first : first + 3, first : first + 3] += sigma**2 * np.outer(direction, direction)
        samples += [_depth(n), _pose(n, T, covariance=covariance)]
    # If the pose of a capture is refused, the nearest accurate poses are 0.1 s before and after it.
    outputs = _run(_dfpc(**{parameter: limit, "max_pose_gap_s": 0.05}), samples)
    assert [pose.t1_ns for pose in outputs["pose"]] == [_stamp_ns(n) for n in range(0, 16, 2)]
    quality = outputs["mesh"][0].quality
    assert quality.status is Status.DEGRADED
    assert quality.reasons == ("no_pose:8", "uncertain_pose:8")
    without_limit = _run(_dfpc(max_pose_gap_s=0.05), samples)
    assert len(without_limit["pose"]) == 16
    assert without_limit["mesh"][0].quality.status is Status.OK


def test_poses_without_covariance_are_used_despite_a_limit() -> None:
    outputs = _run(_dfpc(max_pose_sigma_m=1e-6, max_pose_sigma_rad=1e-6), _captures(POSES))
    assert len(outputs["pose"]) == 16


def test_noisy_lidar_clouds_give_a_surface_better_than_their_noise() -> None:
    rng, z = np.random.default_rng(1), depth_image()
    rows, columns = np.nonzero(z)
    rays = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones(len(rows))], axis=1)
    samples = []
    for n, T in enumerate(camera_poses(40)):
        points = rays * z[rows, columns, None]
        points *= 1.0 + rng.normal(0.0, 0.02, (len(points), 1)) / np.linalg.norm(
            points, axis=1, keepdims=True
        )
        cloud = Pointcloud.from_points(points, frame="servicer/lidar", stamp_ns=_stamp_ns(n))
        samples += [
            Sample("cloud", _stamp_ns(n), n, cloud, frame="servicer/lidar"),
            _pose(n, T, child="servicer/lidar"),
        ]
    mesh = _run(_dfpc(), samples)["mesh"][0]
    _assert_sphere(mesh.value.data.vertices, mesh.value.data.normals, 0.01)


@pytest.mark.parametrize(
    ("frame", "images_registered", "is_colored"),
    [("servicer/depth", False, True), ("servicer/colour", True, True), ("servicer/colour", False, False)],
)
def test_an_image_of_the_same_time_gives_the_colour(
    frame: str, images_registered: bool, is_colored: bool
) -> None:
    pixels = np.zeros((ROWS, COLUMNS, 3), np.uint8)
    pixels[:, :, 2] = 200
    samples = []
    for n, T in enumerate(POSES):
        image = Frame.from_image(pixels, stamp_ns=_stamp_ns(n), mode="BGR", camera_matrix=K, sensor=frame)
        samples += [Sample("image", _stamp_ns(n), n, image), _depth(n), _pose(n, T)]
    mesh = _run(_dfpc(images_registered=images_registered), samples)["mesh"][0]
    expected = [200, 0, 0] if is_colored else [0, 0, 0]
    np.testing.assert_allclose(np.median(mesh.value.data.colors, axis=0), expected, atol=1)
    reasons = [] if is_colored else [f"image_frame_unknown:{len(POSES)}"]
    assert [r for r in mesh.quality.reasons if r.startswith("image")] == reasons


def test_only_the_newest_images_wait_for_their_captures() -> None:
    pixels = np.full((ROWS, COLUMNS, 3), 200, np.uint8)
    images = []
    for n in range(len(POSES)):
        image = Frame.from_image(
            pixels, stamp_ns=_stamp_ns(n), mode="BGR", camera_matrix=K, sensor="servicer/depth"
        )
        images.append(Sample("image", _stamp_ns(n), n, image))
    mesh = _run(_dfpc(max_waiting=1), [*images, *_captures(POSES)])["mesh"][0]
    assert (np.median(mesh.value.data.colors, axis=0) == 0.0).all()


def test_captures_whose_place_on_the_robot_is_unknown_are_not_fused() -> None:
    samples = [s for n, T in enumerate(POSES) for s in (_depth(n), _pose(n, T, child="servicer/base"))]
    (mesh,) = _run(_dfpc(), samples)["mesh"]
    assert mesh.value is None
    assert mesh.quality.status is Status.FAILED
    assert f"frame_unknown:{len(POSES)}" in mesh.quality.reasons


def test_a_stereo_pair_is_matched() -> None:
    rng = np.random.default_rng(3)
    pattern = rng.integers(0, 255, (120, 260), dtype=np.uint8)
    # A wall at 2 m: disparity of 10 px everywhere.
    pair = FramePair.from_images(
        pattern[:, 10:210],
        pattern[:, 20:220],
        baseline_m=0.1,
        camera_matrix=[[200.0, 0.0, 100.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]],
        stamp_ns=_stamp_ns(0),
    )
    samples = [
        s for n in range(3) for s in (Sample("stereo", _stamp_ns(n), n, pair), _pose(n, np.eye(4), child="x"))
    ]
    mesh = _run(_dfpc(disparity={"num_disparities": 32}), samples)["mesh"][0].value
    assert np.median(np.abs(mesh.data.vertices[:, 2] - 2.0)) < 0.02
    assert np.median(mesh.data.normals[:, 2]) < -0.9


def test_a_wrong_pose_is_refused_and_named() -> None:
    wrong = POSES.copy()
    wrong[9, :3, 3] *= 1.2
    mesh = _run(_dfpc(), _captures(wrong))["mesh"][0]
    assert mesh.quality.status is Status.DEGRADED
    assert mesh.quality.reasons == ("contradicts_surface:1",)
    _assert_sphere(mesh.value.data.vertices, mesh.value.data.normals, 0.006)


def test_poses_that_contradict_the_captures_are_refused() -> None:
    rng = np.random.default_rng(2)
    poses = POSES.copy()
    poses[1:, :3, 3] *= rng.uniform(0.7, 1.3, (15, 1))
    mesh = _run(_dfpc(), _captures(poses))["mesh"][0]
    assert mesh.value is None
    assert mesh.quality.status is Status.FAILED
    assert mesh.quality.reasons[0].startswith("poses_contradict:")


@pytest.mark.parametrize("has_pose", [True, False])
def test_one_capture_or_none_with_a_pose_is_refused(has_pose: bool) -> None:
    samples = [_depth(0), _pose(0, POSES[0])] if has_pose else [_depth(n) for n in range(3)]
    dfpc = _dfpc()
    mesh = _run(dfpc, samples)["mesh"][0]
    assert mesh.quality.status is Status.FAILED
    assert mesh.quality.reasons[0] == f"few_captures:{int(has_pose)}<2"
    assert ("no_pose:3" in mesh.quality.reasons) is not has_pose
    with pytest.raises(ProductNotFoundError, match="captures fused, expected 2"):
        dfpc.get_mesh()


def test_the_surface_is_published_while_it_grows_and_cleared_by_restart() -> None:
    dfpc = _dfpc(publish_every=5)
    outputs = [o for sample in _captures(POSES) for o in dfpc.step(sample)]
    assert [o.port for o in outputs].count("mesh") == 3
    assert len(dfpc.get_mesh().data.vertices) >= len(dfpc.store.get("mesh").data.vertices) > 0
    dfpc.restart()
    with pytest.raises(ProductNotFoundError):
        dfpc.get_mesh()


def test_the_edge_of_the_voxels_follows_from_the_first_capture() -> None:
    mesh = _run(_dfpc(voxel_m=None), _captures(POSES[:3]))["mesh"][0]
    assert mesh.quality.metrics["voxel_m"] == pytest.approx(1.5 / K[0, 0], rel=0.15)


def test_wrong_input_is_named() -> None:
    dfpc = _dfpc()
    list(dfpc.step(_pose(0, POSES[0])))
    with pytest.raises(InputError, match="expected"):
        dfpc.step(_pose(1, POSES[1], parent="other"))
    malformed = _run(_dfpc(), [_depth(0, np.ones(3)), _pose(0, POSES[0])])["mesh"][0]
    assert "malformed:1" in malformed.quality.reasons
    with pytest.raises(ConfigurationError, match="voxel_m is a parameter of the DFPC"):
        _dfpc(fusion={"voxel_m": 0.1})
