# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of the stereo camera change images by the amounts that their physics predicts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_dev.simulate.camera import StereoCamera
from cdff_dev.simulate.faults.camera import Glare, LensDust, blurred, dust_map, veil
from cdff_dev.simulate.faults.stereo_camera import FaultyStereoCamera
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.world import World, cast_scene

MakeCamera = Callable[..., FaultyStereoCamera]
#: A time at which the rover of the tiny scenario moves, seconds.
MOVING_S = 0.6


@pytest.fixture(scope="module")
def plain(world: World) -> StereoCamera:
    vertices, triangles = world.relief.mesh()
    scene = cast_scene(world.relief, world.rocks)
    return StereoCamera(
        world.scenario.navcam, scene, world.appearance, len(vertices), (triangles, world.rocks.triangles)
    )


@pytest.fixture(scope="module")
def camera(world: World, plain: StereoCamera) -> MakeCamera:
    def make(**faults: Any) -> FaultyStereoCamera:
        data = world.scenario.model_dump() | {"faults": faults}
        faulty = World(
            Scenario.model_validate(data), world.relief, world.rocks, world.motions, world.appearance
        )
        return FaultyStereoCamera(faulty, "mana", plain)

    return make


def left(camera: FaultyStereoCamera, t_s: float = MOVING_S) -> np.ndarray:
    return camera.radiance(camera._eyes[0], t_s)


def test_without_faults_the_images_are_those_of_the_plain_camera(
    camera: MakeCamera, plain: StereoCamera, world: World
) -> None:
    T = world.motions["mana"].poses(np.array([MOVING_S]))[0]
    expected = plain.pair(T, np.random.default_rng(4))
    result = camera().pair(MOVING_S, np.random.default_rng(4), np.random.default_rng(5))
    for image, reference in zip(result, expected, strict=True):
        assert np.mean(image != reference) < 1e-3


def test_the_width_of_a_blurred_edge_is_velocity_times_exposure() -> None:
    edge = np.zeros((8, 64), dtype=np.float32)
    edge[:, 32:] = 1.0
    velocity_px_s, exposure_s = 400.0, 0.025
    displacement = np.zeros((8, 64, 2))
    displacement[..., 0] = velocity_px_s * exposure_s
    profile = np.diff(blurred(edge, displacement)[4].astype(float))
    mean = np.sum(profile * np.arange(63))
    sigma_px = np.sqrt(np.sum(profile * (np.arange(63) - mean) ** 2))
    # A uniform distribution has a standard deviation of its width over the root of twelve.
    assert sigma_px * np.sqrt(12.0) == pytest.approx(velocity_px_s * exposure_s, rel=0.08)


def test_image_motion_is_that_of_the_moving_camera(camera: MakeCamera, world: World) -> None:
    exposure_s = 0.05
    faulty = camera(camera={"exposure": {"time_s": exposure_s}})
    eye, model = faulty._eyes[0], world.scenario.navcam
    t_s = np.full(model.rows, MOVING_S)
    T = world.motions["mana"].poses(t_s) @ eye.T_base_camera
    view = faulty._camera.view(T, eye.rays)
    hits = faulty._solid_hits(view, [])
    depth = view.depth_m.reshape(model.rows, model.columns)
    displacement = faulty._displacement_px(eye, view, hits, depth, t_s)
    row, column = 80, 64
    ends = world.motions["mana"].poses(MOVING_S + exposure_s * np.array([-0.5, 0.5])) @ eye.T_base_camera
    point = T[0, :3, :3] @ (depth[row, column] * eye.rays[row * model.columns + column]) + T[0, :3, 3]
    pixels = [eye.K @ (se3.inverse(E) @ [*point, 1.0])[:3] for E in ends]
    expected = pixels[1][:2] / pixels[1][2] - pixels[0][:2] / pixels[0][2]
    assert np.linalg.norm(expected) > 0.5
    np.testing.assert_allclose(displacement[row, column], expected, atol=0.01)


def test_a_rolling_shutter_shows_each_row_at_its_own_time(camera: MakeCamera) -> None:
    readout_s = 0.2
    image = left(camera(camera={"rolling_shutter": {"readout_s": readout_s}}))
    at_once = camera()
    last = len(image) - 1
    np.testing.assert_allclose(image[0], left(at_once)[0], atol=1e-4)
    np.testing.assert_allclose(image[last], left(at_once, MOVING_S + readout_s)[last], atol=1e-4)
    assert np.abs(image[last] - left(at_once)[last]).mean() > 0.005


def test_calibration_errors_have_the_stated_size(camera: MakeCamera, world: World) -> None:
    model = world.scenario.navcam
    rng = np.random.default_rng(2)
    from cdff_dev.simulate.faults.camera import CalibrationError, CameraFaults
    from cdff_dev.simulate.faults.stereo_camera import draw_eyes

    small = model.model_copy(update={"rows": 16, "columns": 16})
    faults = CameraFaults(
        calibration=CalibrationError(focal_sigma=0.01, baseline_sigma=0.02, rotation_sigma_deg=0.1)
    )
    drawn_eyes = [draw_eyes(small, faults, rng) for _ in range(300)]
    focal = [a.K[0, 0] / model.focal_px - 1.0 for a, _ in drawn_eyes]
    right = [se3.inverse(a.T_base_camera) @ b.T_base_camera for a, b in drawn_eyes]
    assert np.std(focal) == pytest.approx(0.01, rel=0.15)
    assert np.std([T[0, 3] / model.baseline_m for T in right]) == pytest.approx(0.02, rel=0.15)
    rotations = np.degrees([se3.log_so3(T[:3, :3]) for T in right])
    assert np.sqrt(np.mean(rotations**2)) == pytest.approx(0.1, rel=0.15)


def test_glare_decreases_with_the_square_of_the_angle_and_ends_at_the_hood() -> None:
    glare = Glare(veil=0.5, hood_deg=60.0)
    sun = np.array([0.0, 0.0, 1.0])
    angles = np.radians([10.0, 20.0, 40.0])
    directions = np.column_stack([np.sin(angles), np.zeros(3), np.cos(angles)])
    np.testing.assert_allclose(veil(glare, directions, sun, sun), [0.5, 0.125, 0.03125], rtol=1e-6)
    away = np.array([np.sin(np.radians(61.0)), 0.0, np.cos(np.radians(61.0))])
    assert not veil(glare, directions, away, sun).any()


def test_dust_removes_the_stated_light_and_is_the_same_in_every_image(camera: MakeCamera) -> None:
    rng = np.random.default_rng(1)
    one = dust_map(LensDust(specks=1, diameter_px=(30.0, 30.0), attenuation=0.4), 200, 200, rng)
    assert one.max() == pytest.approx(0.4, abs=0.01)
    assert (one > 0.2).sum() == pytest.approx(np.pi * 15.0**2, rel=0.6)
    faults = {"dust": {"specks": 40, "diameter_px": [6, 20], "attenuation": 0.5, "scatter": 0.0}}
    ratios = [left(camera(camera=faults), t_s) / np.maximum(left(camera(), t_s), 1e-3) for t_s in (0.3, 0.7)]
    np.testing.assert_allclose(ratios[0], ratios[1], atol=1e-3)
    assert ratios[0].min() < 0.6


def test_an_exposure_error_of_one_stop_doubles_the_signal(camera: MakeCamera) -> None:
    rngs = [np.random.default_rng(k) for k in (1, 2, 1, 2)]
    normal, _ = camera().pair(MOVING_S, *rngs[:2])
    darker, _ = camera(camera={"exposure": {"stops": -1.0}}).pair(MOVING_S, *rngs[2:])
    ground = slice(60, None)
    assert darker[ground].mean() / normal[ground].mean() == pytest.approx(0.5, abs=0.02)


def test_an_arm_in_view_stays_in_place_and_shades_the_ground(camera: MakeCamera, world: World) -> None:
    part = {
        "mount": {"xyz_m": [1.6, 0.0, 0.5], "rpy_deg": [0.0, 0.0, 0.0]},
        "size_m": [0.6, 0.3, 0.2],
        "contrast": 0.0,
    }
    with_arm, without = camera(body=[part]), camera()
    differences = [np.abs(left(with_arm, t) - left(without, t)) > 0.02 for t in (0.3, 0.7)]
    covered = np.array([_covered(with_arm, t) for t in (0.3, 0.7)])
    assert covered[0].sum() > 200
    assert np.mean(covered[0] == covered[1]) > 0.999
    shaded = differences[0] & ~covered[0]
    assert shaded.sum() > 50
    darker = (left(with_arm, 0.3) / left(without, 0.3))[shaded]
    assert np.median(darker) < 0.6


def _covered(camera: FaultyStereoCamera, t_s: float) -> np.ndarray:
    """Return the pixels that show a part of the rover."""
    model = camera._model
    t = np.full(model.rows, t_s)
    poses = camera._motion.poses(t)
    view = camera._camera.view(poses @ camera._eyes[0].T_base_camera, camera._eyes[0].rays)
    return np.isfinite(camera._solid_hits(view, camera._solids(poses, t)).t)
