# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of a camera in orbit: geometry, photometry, shadows, lens and detector."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_dev.simulate.orbit.camera_view import CameraRays
from cdff_dev.simulate.orbit.detector import Detector
from cdff_dev.simulate.orbit.images import CameraImage, CameraSimulator
from cdff_dev.simulate.orbit.sensors import Camera
from cdff_dev.simulate.orbit.world import OrbitWorld
from tests.unit.cdff_dev.simulate.orbit.conftest import small_scenario

CLEAN = {"read_noise_e": 0.0, "dark_e_s": 0.0, "halo": 0.0, "stars": False, "prnu": 0.0}


def image_of(t_s: float = 0.0, camera: dict[str, Any] | None = None, **changes: Any) -> CameraImage:
    """Return an image of the small scenario with changed values of its camera and of the scenario."""
    settings = {f"servicer__cameras__camera__{k}": v for k, v in (camera or {}).items()}
    world = OrbitWorld(small_scenario(**settings, **changes))
    return CameraSimulator(world, "camera").image(t_s, 0)


def test_the_client_is_where_its_true_pose_projects_it(orbit_world: OrbitWorld) -> None:
    result = CameraSimulator(orbit_world, "camera").image(0.0, 0)
    model = orbit_world.scenario.servicer.cameras["camera"].model
    T = result.T_camera_body["client"]
    vertices = orbit_world.meshes["client"].vertices_m
    pixels = model.project(vertices @ T[:3, :3].T + T[:3, 3])
    column, row, width, height = result.box_px
    np.testing.assert_allclose([column, row], pixels.min(axis=0), atol=1.5)
    np.testing.assert_allclose([column + width - 1, row + height - 1], pixels.max(axis=0), atol=1.5)
    assert result.image.shape == (96, 128)
    assert result.image.dtype == np.uint16
    assert 0.2 < result.lit <= 1.0
    on_body = (result.points_m - T[:3, 3]) @ T[:3, :3]
    distance = np.linalg.norm(on_body[:, None] - vertices[None], axis=2).min(axis=1)
    assert distance.max() < 0.15  # the mesh has edges of 0.1 m


def test_an_image_is_repeatable_and_its_noise_depends_on_the_index(orbit_world: OrbitWorld) -> None:
    camera = CameraSimulator(orbit_world, "camera")
    first = camera.image(0.0, 0).image
    np.testing.assert_array_equal(CameraSimulator(orbit_world, "camera").image(0.0, 0).image, first)
    assert (camera.image(0.0, 1).image != first).any()


def test_the_light_of_a_distant_client_does_not_depend_on_how_it_is_sampled() -> None:
    """The sum of the electrons falls with the square of the distance, across the limit of small bodies."""
    sums = []
    for distance_m in (20_000.0, 40_000.0, 80_000.0, 400_000.0):
        camera = {**CLEAN, "exposure": {"time_s": 1e-5}, "full_well_e": 1e9, "bits": 16, "gain_e_dn": 1e-2}
        camera |= {"zero_point_e_s": 3e-6 * distance_m**2, "focal_px": 800.0, "rows": 96, "columns": 128}
        scenario = small_scenario(
            **{f"servicer__cameras__camera__{k}": v for k, v in camera.items()},
            servicer__start_m=[-distance_m, 0.0, 0.0],
            client__attitude__rate_deg_s=[0.0, 0.0, 0.0],
            client__mesh="small_body",
            lighting__earthshine=False,
        )
        simulator = CameraSimulator(OrbitWorld(scenario), "camera")
        world = simulator.world
        view = simulator.rays.render(world.placed(np.zeros(1)))
        electrons = simulator._electrons(view, 0.0, world.motion.light(0.0), 1e-5)
        sums.append(float(electrons.sum()))
    np.testing.assert_allclose(sums[1:], sums[0], rtol=0.04)
    assert sums[0] > 0.0


def test_the_client_casts_shadows_on_itself_and_the_night_side_is_lit_by_the_earth_only() -> None:
    world = OrbitWorld(small_scenario(lighting__sun={"phase_deg": 80.0, "clock_deg": 45.0}))
    rays = CameraRays(world.scenario.servicer.cameras["camera"])
    body = world.placed(np.zeros(1))[0]
    T = se3.inverse(world.scenario.servicer.cameras["camera"].T_base_camera) @ body.T_base_body[0]
    hits = body.scene.cast(rays.directions, se3.inverse(T)[None])
    faces_sun = hits.normals @ body.light.to_sun > 0.05
    hidden = body.scene.is_hidden(hits.points_m + 2e-3 * hits.normals, body.light.to_sun)
    assert (faces_sun & hidden).sum() > 20  # parts that face the Sun are in the shadow of others
    radiance = body.scene.radiance(hits, body.light)
    sunlit, shaded = radiance[faces_sun & ~hidden], radiance[faces_sun & hidden]
    assert 0.0 < np.median(shaded) < 0.2 * np.median(sunlit)


def test_in_eclipse_the_image_is_dark() -> None:
    orbit = {"semi_major_axis_m": 6_928_137.0, "inclination_deg": 18.0, "true_anomaly_deg": 300.0}
    night = image_of(
        orbit=orbit, lighting={"earthshine": True}, camera=CLEAN | {"exposure": {"time_s": 1e-3}}
    )
    day = image_of(
        orbit=orbit | {"true_anomaly_deg": 120.0}, lighting={}, camera=CLEAN | {"exposure": {"time_s": 1e-3}}
    )
    assert (night.sun[3], day.sun[3]) == (0.0, 1.0)
    assert night.image.max() < 0.02 * day.image.max()


def test_exposure_is_controlled_by_the_bright_part_of_the_client() -> None:
    controlled = image_of(camera={"exposure": {"target": 0.5, "min_s": 1e-7, "max_s": 1.0}, "bits": 12})
    of_client = controlled.image[controlled.mask == 1]
    assert 0.4 * 4095 < np.percentile(of_client, 99) < 0.65 * 4095
    fixed_exposure = image_of(camera={"exposure": {"time_s": 0.01}})
    assert fixed_exposure.exposure_s == 0.01
    assert np.percentile(fixed_exposure.image[fixed_exposure.mask == 1], 90) == 4095


def test_a_rolling_shutter_shears_a_fast_rotating_client() -> None:
    changes = {
        "client__attitude__rate_deg_s": [0.0, 0.0, 150.0],
    }
    still, rolled = (
        image_of(camera=CLEAN | {"readout_s": s, "exposure": {"time_s": 1e-6}}, **changes) for s in (0.0, 0.4)
    )
    rows = [np.flatnonzero((i.mask == 1).any(axis=1)) for i in (still, rolled)]
    assert (still.mask[rows[0][0]] != rolled.mask[rows[0][0]]).any() or len(rows[0]) != len(rows[1])
    assert (still.mask != rolled.mask).mean() > 0.008


def test_motion_during_the_exposure_smears_the_image() -> None:
    changes = {
        "client__attitude__rate_deg_s": [0.0, 0.0, 90.0],
    }
    sharp, smeared = (
        image_of(camera=CLEAN | {"exposure": {"time_s": t}, "zero_point_e_s": 0.02 / t}, **changes)
        for t in (1e-4, 0.2)
    )
    gradient = [np.abs(np.diff(i.image.astype(float), axis=1)).sum() for i in (sharp, smeared)]
    assert gradient[1] < 0.85 * gradient[0]
    total = [float(i.image.sum()) for i in (sharp, smeared)]
    assert total[1] == pytest.approx(total[0], rel=0.1)


def test_stars_are_behind_the_client_and_appear_with_their_brightness() -> None:
    camera = {
        **CLEAN,
        "stars": True,
        "zero_point_e_s": 1e7,
        "exposure": {"time_s": 1.0},
        "focal_px": 300.0,
        "full_well_e": 1e7,
        "bits": 16,
    }
    dark = {"lighting": {"sun": {"phase_deg": 180.0}, "earthshine": False, "eclipse": False}}
    far = image_of(camera=camera, servicer__start_m=[-40_000.0, 0.0, 0.0], **dark)
    near = image_of(camera=camera, servicer__start_m=[-15.0, 0.0, 0.0], **dark)
    assert (far.image > 20).sum() > 20
    assert (near.image[near.mask == 1] > 20).sum() < 0.2 * (far.image[near.mask == 1] > 20).sum() + 3
    assert far.image.max() < 2**16 - 1


def test_the_earth_fills_the_image_of_a_camera_that_looks_down() -> None:
    down = image_of(
        camera=CLEAN | {"exposure": {"time_s": 1.4e-5}},
        servicer__start_m=[0.0, 0.0, -20.0],
        lighting={"eclipse": False},
        orbit={"semi_major_axis_m": 6_928_137.0, "inclination_deg": 18.0, "true_anomaly_deg": 120.0},
    )
    background = down.image[down.mask == 0]
    assert np.median(background) > 50
    assert background.std() > 10  # clouds


def test_a_detector_has_the_noise_of_its_model() -> None:
    model = Camera(
        rows=200,
        columns=200,
        focal_px=100.0,
        rate_hz=1.0,
        zero_point_e_s=1.0,
        read_noise_e=6.0,
        dark_e_s=0.0,
        prnu=0.0,
        full_well_e=4095.0 * 4,
        gain_e_dn=4.0,
        offset_dn=50.0,
        bits=12,
    )
    detector, rng = Detector(model, np.random.default_rng(1)), np.random.default_rng(2)
    for level_e in (0.0, 10.0, 4000.0):
        image = detector.read(np.full((200, 200), level_e, np.float32), 1.0, rng).astype(float)
        assert image.mean() == pytest.approx(50.0 + level_e / 4.0, abs=0.15)
        # Photon noise, read noise and quantisation.
        assert image.var() == pytest.approx((level_e + 36.0) / 16.0 + 1.0 / 12.0, rel=0.05)


def test_hot_pixels_are_fixed_and_particles_are_not() -> None:
    model = Camera(
        rows=64,
        columns=64,
        focal_px=100.0,
        rate_hz=1.0,
        zero_point_e_s=1.0,
        hot_pixels=12,
        hot_e_s=1e5,
        dark_e_s=0.0,
    )
    detector, dark = Detector(model, np.random.default_rng(1)), np.zeros((64, 64), np.float32)
    images = [detector.read(dark, 0.1, np.random.default_rng(k)) for k in (3, 4)]
    hot = [set(np.flatnonzero(i > 200)) for i in images]
    assert hot[0] == hot[1]
    assert 8 <= len(hot[0]) <= 12
    hit = model.model_copy(update={"cosmic_rays_hz": 200.0, "hot_pixels": 0})
    first, second = (
        Detector(hit, np.random.default_rng(1)).read(dark, 0.1, np.random.default_rng(k)) for k in (3, 4)
    )
    assert (first > 30).sum() > 5
    assert (np.flatnonzero(first > 30)[:3] != np.flatnonzero(second > 30)[:3]).any()


def test_blooming_keeps_the_charge_and_moves_it_along_columns() -> None:
    from cdff_dev.simulate.orbit._detector_kernels import bloom

    charge = np.zeros((41, 3), np.float32)
    charge[20, 1] = 1000.0
    bloom(charge, 100.0)
    assert charge.sum() == pytest.approx(1000.0, rel=1e-5)
    assert charge.max() == 100.0
    assert (charge[:, [0, 2]] == 0.0).all()
    filled = np.flatnonzero(charge[:, 1] > 0.0)
    assert (filled[0], filled[-1]) == (15, 25)


def test_companions_and_parts_of_the_servicer_have_their_own_numbers() -> None:
    companion = {
        "name": "debris",
        "mesh": "debris",
        "inertia_kg_m2": [1.0, 1.2, 1.4],
        "position_m": [-3.0, 2.5, 0.0],
    }
    arm = {"name": "arm", "mesh": "arm", "mount": {"xyz_m": [0.3, -0.9, -0.6], "rpy_deg": [0.0, 0.0, 10.0]}}
    result = image_of(companions=[companion], servicer__body=[arm])
    assert set(np.unique(result.mask)) == {0, 1, 2, 3}
    assert set(result.T_camera_body) == {"client", "debris"}


def test_the_sun_in_the_image_saturates_it_and_its_stray_light_brightens_the_rest() -> None:
    into_sun = {
        "lighting": {"sun": {"phase_deg": 165.0, "clock_deg": 90.0}, "eclipse": False, "earthshine": False}
    }
    camera = CLEAN | {"exposure": {"time_s": 1e-4}}
    clean = image_of(camera=camera, **into_sun)
    hazy = image_of(camera=camera | {"stray": 1e-3}, **into_sun)
    assert (clean.image == 4095).sum() > 1
    assert np.median(hazy.image) > np.median(clean.image) + 20
