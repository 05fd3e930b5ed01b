# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Single views: orientation of surfaces, range images, and localisation of a solid in a rendered view."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_core.dfns.registration_3d.interface import Registration3DInputs, Registration3DOutputs
from cdff_core.partial_views.configuration import ViewSearchConfig
from cdff_core.partial_views.localisation import ViewLocaliser
from cdff_core.partial_views.model_surface import model_surface, sphere_directions
from cdff_core.partial_views.range_image import range_image
from cdff_core.partial_views.search import ViewSearch, prepare_model
from cdff_core.partial_views.view_comparison import ViewComparison

Points = NDArray[np.float64]

T_TRUE = se3.transform(se3.exp_so3([0.4, -0.5, 0.3]), [0.02, 0.03, 0.6])


def solid(count: int = 40_000) -> tuple[Points, Points]:
    """Return points (n, 3), metres, and outward normals (n, 3) of three joined boxes without symmetry."""
    rng = np.random.default_rng(0)
    boxes = [
        ((0.0, 0.0, 0.0), (0.1, 0.03, 0.03)),
        ((0.0, 0.03, 0.0), (0.03, 0.06, 0.03)),
        ((0.07, 0.0, -0.07), (0.03, 0.03, 0.07)),
    ]
    points, normals = [], []
    for low, size in boxes:
        axis, side = rng.integers(0, 3, count // len(boxes)), rng.integers(0, 2, count // len(boxes))
        p = rng.random((count // len(boxes), 3))
        p[np.arange(len(p)), axis] = side
        n = np.zeros_like(p)
        n[np.arange(len(p)), axis] = 2.0 * side - 1.0
        points.append(np.array(low) + p * np.array(size))
        normals.append(n)
    p, n = np.vstack(points), np.vstack(normals)
    inside = np.any([np.all((p > low) & (p < np.add(low, size)), axis=1) for low, size in boxes], axis=0)
    return p[~inside], n[~inside]


def view(T: Points | None) -> Points:
    """Return a view (n, 3) of a table at 0.7 m with the solid at a pose: rays 1/600 apart."""
    row, column = np.mgrid[-160:160, -160:160] / 600.0
    table = np.stack([column, row, np.ones_like(row)], axis=-1).reshape(-1, 3)
    table *= (0.7 / (1.0 + 0.3 * table[:, 1]))[:, None]
    if T is None:
        return table
    p = se3.transform_points(T, solid(400_000)[0])
    cells = np.round(p[:, :2] / p[:, 2:] * 600.0).astype(int) + 160
    depth = table[:, 2].reshape(320, 320).copy()
    np.minimum.at(depth, (cells[:, 1], cells[:, 0]), p[:, 2])
    return np.stack([column * depth, row * depth, depth], axis=-1).reshape(-1, 3)


def test_normals_of_a_closed_surface_point_outwards() -> None:
    points, normals = solid(6000)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], len(points))
    centre = points.mean(axis=0)
    surface = model_surface(points - centre, normals * signs[:, None], 0.003)
    assert surface.is_closed
    assert np.mean(np.sum(surface.normals * normals, axis=1) > 0.0) > 0.9


def test_an_open_surface_has_one_sign_and_a_reverse() -> None:
    x, y = np.mgrid[-1:1:40j, -1:1:40j].reshape(2, -1)
    points = np.stack([x, y, 0.2 * x * x], axis=1)
    normals = np.stack([-0.4 * x, np.zeros_like(x), np.ones_like(x)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], len(points))
    surface = model_surface(points, normals * signs[:, None], 0.05)
    assert not surface.is_closed
    assert abs(np.sum(np.sign(np.sum(surface.normals * normals, axis=1)))) == len(points)
    np.testing.assert_array_equal(surface.reversed().normals, -surface.normals)


def test_directions_are_even_unit_vectors() -> None:
    directions = sphere_directions(162)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    np.testing.assert_allclose(directions.mean(axis=0), 0.0, atol=0.01)


def test_a_cloud_of_both_sides_of_a_solid_is_not_one_view() -> None:
    assert range_image(se3.transform_points(T_TRUE, solid()[0])) is None
    assert range_image(view(T_TRUE)) is not None


def test_holes_of_a_random_half_of_a_view_are_filled() -> None:
    points = view(None)
    half = points[np.random.default_rng(0).permutation(len(points))[::2]]
    image = range_image(half)
    assert image is not None
    assert np.mean(np.isfinite(image.depth_m)) > 0.9


def test_the_true_pose_agrees_with_the_view_and_a_pose_in_front_does_not() -> None:
    points, normals = solid(6000)
    centre = points.mean(axis=0)
    surface = model_surface(points - centre, normals, 0.003)
    image = range_image(view(T_TRUE))
    assert image is not None
    T = se3.transform(image.R_view_scene, np.zeros(3)) @ T_TRUE @ se3.transform(np.eye(3), centre)
    closer = T.copy()
    closer[2, 3] -= 0.05
    scores = ViewComparison(image, surface, 0.004).scores(np.stack([T, closer]))
    assert scores[0] > 0.9
    assert scores[1] < 0.0


def test_a_solid_is_localised_and_an_empty_table_refused() -> None:
    from cdff_common.interfaces.registry import Registry

    dfns = [Registry.default().make_dfn(name) for name in ("registration_3d", "registration_assessment")]
    for dfn in dfns:
        dfn.configure({})
    cfg = ViewSearchConfig()
    localiser, model = ViewLocaliser(dfns[0], dfns[1], cfg, 0.7), prepare_model(solid()[0], cfg)
    registration, quality = localiser.localise(model, view(T_TRUE))
    assert registration is not None, quality
    error = se3.log_se3(se3.inverse(T_TRUE) @ registration.T_target_source)
    assert np.linalg.norm(error[:3]) < 0.005
    assert np.degrees(np.linalg.norm(error[3:])) < 3.0
    nothing, quality = localiser.localise(model, view(None))
    assert nothing is None
    assert quality.reasons[0] == "not_found"


def test_a_scene_that_is_too_far_is_refused() -> None:
    cfg = ViewSearchConfig()
    scene = 10.0 * view(None)
    image = range_image(scene)
    assert image is not None
    with pytest.raises(RefusedError):
        ViewSearch(prepare_model(solid(8000)[0], cfg), scene, image, cfg)


def test_a_cup_with_a_handle_is_not_symmetric() -> None:
    rng = np.random.default_rng(0)
    angle, z = rng.uniform(0.0, 2.0 * np.pi, 20_000), rng.uniform(0.0, 0.1, 20_000)
    cup = np.stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), z], axis=1)
    handle = np.array([0.04, -0.004, 0.04]) + rng.random((600, 3)) * [0.025, 0.008, 0.015]
    turned = se3.transform(se3.exp_so3([0.0, 0.0, 1.5]), np.zeros(3))
    for points, expected in ((cup, True), (np.vstack([cup, handle]), False)):
        model = prepare_model(points, ViewSearchConfig())
        T_axis = se3.transform(np.eye(3), -model.centre_m)
        T = T_axis @ turned @ se3.inverse(T_axis)
        assert model.is_symmetry(T, 0.04 * model.diameter_m) is expected


class WrongRegistration:
    """Registration that ends 10 cm from its guess."""

    def process(self, inputs: Registration3DInputs) -> Registration3DOutputs:
        assert inputs.guess is not None
        T = se3.transform(np.eye(3), [0.1, 0.0, 0.0]) @ inputs.guess
        return Registration3DOutputs(transform=T, residual_scale_m=0.001, iterations=5, converged=True)


def test_a_view_that_contradicts_the_registration_yields_the_pose_and_covariance_of_the_search() -> None:
    from cdff_common.interfaces.registry import Registry

    assess = Registry.default().make_dfn("registration_assessment")
    assess.configure({})
    cfg = ViewSearchConfig()
    localiser = ViewLocaliser(WrongRegistration(), assess, cfg, 0.7, seed=3)  # type: ignore[arg-type]
    localisation, quality = localiser.localise(prepare_model(solid()[0], cfg), view(T_TRUE))
    assert localisation is not None, quality
    assert "not_refined" in quality.reasons
    error = pose_error(T_TRUE, localisation.T_target_source)
    squared = error @ np.linalg.solve(localisation.transform.covariance, error)
    assert squared < 16.8  # 99 % quantile of chi2 with 6 degrees of freedom
    assert np.sqrt(localisation.transform.covariance[:3, :3].trace()) < 0.02
