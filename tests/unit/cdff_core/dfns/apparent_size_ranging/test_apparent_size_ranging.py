# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ApparentSizeRanging: an ellipsoid at known range under several directions of the Sun; wrong input."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.apparent_size_ranging.interface import ApparentSizeRangingInputs
from cdff_core.dfpcs.far_range_object_tracking.target_ranging import apparent_sizes_m

FOCAL, SIDE = 2000.0, 96
#: Half axes of the ellipsoid, metres.
AXES = np.array([3.0, 2.0, 1.5])


def ellipsoid(rings: int = 40) -> tuple[np.ndarray, np.ndarray]:
    polar, azimuth = np.meshgrid(
        np.linspace(0.0, np.pi, rings + 1), np.linspace(0.0, 2 * np.pi, 2 * rings, False), indexing="ij"
    )
    unit = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    index = np.arange(polar.size).reshape(polar.shape)
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    triangles = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    return unit.reshape(-1, 3) * AXES, triangles.astype(np.int64)


def photograph(
    range_m: float, sun: np.ndarray, origin: tuple[float, float], noise: float = 2.0
) -> np.ndarray:
    """Return the image of the ellipsoid by the intersection of rays, four by four in a pixel."""
    k = 4
    u = ((np.arange(SIDE * k) + 0.5) / k - 0.5 - 0.5 * (SIDE - 1)) / FOCAL
    x, y = np.meshgrid(u, u)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    ray = np.array([(origin[0] - 0.5 * (SIDE - 1)) / FOCAL, (origin[1] - 0.5 * (SIDE - 1)) / FOCAL, 1.0])
    centre = range_m * ray / np.linalg.norm(ray)
    d, o = rays / AXES, -centre / AXES
    a, b, c = (d * d).sum(-1), (d * o).sum(-1), o @ o - 1.0
    root = b * b - a * c
    hit = root > 0.0
    depth = (-b - np.sqrt(np.where(hit, root, 0.0))) / a
    normals = (rays * depth[..., None] - centre) / AXES**2
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    view = -rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    mu0, mu = normals @ sun, np.maximum((normals * view).sum(-1), 1e-3)
    light = np.where(hit & (mu0 > 0.0), 2.0 * mu0 / (np.maximum(mu0, 1e-6) + mu), 0.0)
    light = cv2.resize(light.astype(np.float32), (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    light = cv2.GaussianBlur(light, (0, 0), 0.8) * 150.0
    return (light + np.random.default_rng(3).normal(0.0, noise, light.shape)).astype(np.float32)


def ranging(image: np.ndarray, sun: np.ndarray | None, *, attitude: np.ndarray | None, **config: float):
    dfn = Registry.default().make_dfn("ApparentSizeRanging", "RenderedComparison")
    dfn.configure(config)
    vertices, triangles = ellipsoid()
    return dfn.process(
        ApparentSizeRangingInputs(
            image=image,
            noise=2.0,
            focal=FOCAL,
            point_spread=0.8,
            sizes=apparent_sizes_m(vertices),
            vertices=vertices,
            triangles=triangles,
            attitude=attitude,
            sun=sun,
        )
    )


def direction(phase_deg: float) -> np.ndarray:
    """Return the direction of the Sun at a phase angle, from the right."""
    return np.array([np.sin(np.radians(phase_deg)), 0.0, -np.cos(np.radians(phase_deg))])


@pytest.mark.parametrize(
    ("range_m", "phase_deg"), [(200.0, 20.0), (200.0, 90.0), (450.0, 60.0), (150.0, 45.0)]
)
def test_the_range_with_attitude_and_sun_is_right_to_two_per_cent_also_half_in_shadow(
    range_m: float, phase_deg: float
) -> None:
    sun = direction(phase_deg)
    result = ranging(photograph(range_m, sun, (50.0, 44.0)), sun, attitude=np.eye(3))
    assert result.range == pytest.approx(range_m, rel=0.02)
    assert abs(result.range - range_m) < 3.0 * result.range_sigma
    assert result.origin == pytest.approx([50.0, 44.0], abs=0.5)
    assert result.agreement > 0.97


@pytest.mark.parametrize("phase_deg", [10.0, 60.0, 100.0])
def test_without_attitude_the_range_is_an_interval_that_contains_the_true_one(phase_deg: float) -> None:
    sun = direction(phase_deg)
    result = ranging(photograph(150.0, sun, (47.0, 48.0)), sun, attitude=None)
    assert result.interval[0] < 150.0 < result.interval[1]
    assert result.range == pytest.approx(result.interval.mean())
    assert result.range_sigma == pytest.approx(np.ptp(result.interval) / np.sqrt(12.0))
    assert np.isnan(result.origin).all()
    assert np.isnan(result.agreement)


def test_the_range_of_a_small_body_is_uncertain_because_parts_may_have_another_reflectance() -> None:
    sun = direction(20.0)
    near, far = (
        ranging(photograph(range_m, sun, (48.0, 48.0)), sun, attitude=np.eye(3)) for range_m in (150.0, 900.0)
    )
    assert near.extent > 60.0
    assert far.extent < 16.0
    assert near.range_sigma < 0.02 * near.range
    assert far.range_sigma > (4.5 / far.extent) ** 2 * far.range > 0.07 * far.range


def test_a_body_of_few_pixels_and_an_empty_image_have_no_range() -> None:
    sun = direction(20.0)
    for image in (photograph(4000.0, sun, (48.0, 48.0)), np.zeros((SIDE, SIDE), np.float32)):
        with pytest.raises(RefusedError) as refusal:
            ranging(image, sun, attitude=np.eye(3))
        assert refusal.value.reasons[0].startswith("unresolved:")


def test_another_body_is_refused_with_the_correlation() -> None:
    image = np.zeros((SIDE, SIDE), np.float32)
    image[20:76, 44:50] = image[30:36, 20:76] = 150.0
    with pytest.raises(RefusedError) as refusal:
        ranging(image, direction(20.0), attitude=np.eye(3))
    assert refusal.value.reasons[0].startswith("model_disagrees:")


def test_sizes_out_of_order_are_refused() -> None:
    dfn = Registry.default().make_dfn("ApparentSizeRanging", "RenderedComparison")
    dfn.configure()
    with pytest.raises(InputError, match="expected the smallest and the largest"):
        dfn.process(
            ApparentSizeRangingInputs(
                image=photograph(150.0, direction(20.0), (48.0, 48.0)),
                noise=2.0,
                focal=FOCAL,
                point_spread=0.8,
                sizes=np.array([6.0, 3.0]),
            )
        )


def test_the_apparent_sizes_of_an_ellipsoid_are_its_second_and_its_first_axis() -> None:
    assert apparent_sizes_m(ellipsoid()[0]) == pytest.approx([4.0, 6.0], rel=0.02)
