# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import validated
from cdff_dev.simulate.rovers_in_view_model import RoversInView, body_mesh
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.scenario_files import read_scenario
from cdff_dev.simulate.traverse import _Renderer
from cdff_dev.simulate.world import make_world


def small() -> dict[str, Any]:
    """Return the scenario distant_rovers on small terrain with small images, two rovers 12 m apart."""
    data = read_scenario("distant_rovers")
    data["duration_s"] = 4.0
    data["terrain"] |= {"fine_half_width_m": 12.0, "boulders": None, "resolution_m": 0.25}
    data["terrain"]["craters"] |= {"count": 0}
    data["terrain"]["rocks"] |= {"count": 20, "half_width_m": 12.0}
    data["terrain"]["spectrum"] |= {"rms_slope_deg": 0.3, "rms_slope_fine_deg": 0.3}
    data["navcam"] |= {"rows": 96, "columns": 128, "focal_px": 160.0}
    for name, xy in (("mana", [-6.0, 0.0]), ("minnie", [6.0, 0.0])):
        data["robots"][name] |= {
            "start_xy_m": xy,
            "heading_deg": 0.0,
            "rest_before_s": 3.9,
            "rest_after_s": 0.0,
        }
    del data["robots"]["percy"]
    return data


def renderer(data: dict[str, Any]) -> Any:
    return _Renderer(make_world(validated(Scenario, data, "test")))


@pytest.fixture(scope="module")
def small_renderer() -> Any:
    return renderer(small())


def test_a_rover_covers_the_pixels_of_its_size_and_casts_a_shadow(small_renderer: Any) -> None:
    scenario, view = small_renderer._world.scenario, small_renderer._rover_view
    T = small_renderer._world.motions["mana"].poses(np.array([0.0]))[0] @ scenario.navcam.T_base_left
    image, silhouettes = view.radiance(T, "mana", 0.0)
    assert list(silhouettes) == ["minnie"]
    silhouette = silhouettes["minnie"]
    rows, columns = np.nonzero(silhouette.coverage > 0.5)
    T_camera = np.linalg.inv(T) @ small_renderer._world.motions["minnie"].poses(np.array([0.0]))[0]
    pixels_per_m = scenario.navcam.focal_px / T_camera[2, 3]
    assert np.ptp(rows) + 1 == pytest.approx(scenario.rovers_in_view.height_m * pixels_per_m, abs=2.5)
    assert silhouette.coverage.sum() == pytest.approx(silhouette.whole, rel=0.2)
    alone = small_renderer._camera.radiance(T)
    changed = image - alone
    below = changed[: rows.max() + 6, columns.min() - 20 : columns.max() + 20]
    assert below.min() < -0.1
    # The rover has parts brighter and darker than the ground.
    assert (np.abs(changed[silhouette.coverage > 0.9]) > 0.05).mean() > 0.5


def test_a_sample_of_the_log_shows_the_rover_in_both_images(small_renderer: Any) -> None:
    scenario, view = small_renderer._world.scenario, small_renderer._rover_view
    T = small_renderer._world.motions["mana"].poses(np.array([0.0]))[0]
    pair = small_renderer.render(("navcam", "mana", 0))
    for image, mount in zip(pair, (scenario.navcam.T_base_left, scenario.navcam.T_base_right), strict=True):
        light, silhouettes = view.radiance(T @ mount, "mana", 0.0)
        expected = small_renderer._camera.expose(light, 1.0, np.random.default_rng(0)).astype(float)
        near = silhouettes["minnie"].coverage > 0.0
        assert np.abs(image[near] - expected[near]).mean() < 10.0


def test_dust_brightens_the_image_behind_a_rover_that_drives_and_not_behind_one_at_rest() -> None:
    data = small()
    data["robots"]["minnie"] |= {"rest_before_s": 1.0, "ramp_s": 0.2}
    data["rovers_in_view"]["dust"] |= {"optical_depth": 1.0}
    dusty = renderer(data)
    data["rovers_in_view"]["dust"] = None
    clear = renderer(data)
    T = dusty._world.motions["mana"].poses(np.array([0.0]))[0] @ dusty._world.scenario.navcam.T_base_left
    images = [r._rover_view.radiance(T, "mana", 3.5)[0] for r in (dusty, clear)]
    assert float(np.max(images[0] - images[1])) > 0.05
    at_rest = [r._rover_view.radiance(T, "mana", 0.5)[0] for r in (dusty, clear)]
    assert np.allclose(at_rest[0], at_rest[1])


def test_the_mesh_of_a_body_is_closed() -> None:
    model = RoversInView.model_validate(read_scenario("distant_rovers")["rovers_in_view"])
    vertices, triangles, albedo = body_mesh(model)
    assert len(triangles) == len(albedo)
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    assert np.ptp(vertices[:, 2]) == pytest.approx(model.height_m)


def test_rovers_in_view_need_a_camera_without_faults() -> None:
    data = small()
    data["navcam"] = None
    with pytest.raises(ConfigurationError, match="rovers_in_view: expected with navcam and without faults"):
        validated(Scenario, data, "test")
