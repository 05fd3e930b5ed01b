# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Directions, magnitudes and images of the catalogue's stars."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.camera.model import CameraModel
from cdff_common.clock import parse_stamp
from cdff_common.errors import InputError
from cdff_common.stars import (
    aberrated,
    add_sources,
    earth_velocity_m_s,
    electron_rates,
    geometric,
    load_catalogue,
    sun_position_m,
    visible_stars,
)

ARCSEC = np.pi / 180.0 / 3600.0
CAMERA = CameraModel(rows=120, cols=160, fx=400.0, fy=400.0, cx=79.5, cy=59.5)


def looking_at(direction: np.ndarray) -> np.ndarray:
    """Return ``R_inertial_camera`` (3, 3) with the optical axis along a direction."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def test_the_catalogue_is_complete_and_sorted_by_brightness() -> None:
    catalogue = load_catalogue()
    assert len(catalogue) == 23_268
    assert (np.diff(catalogue.magnitudes) >= 0.0).all()
    assert catalogue.magnitudes[-1] <= 7.5
    np.testing.assert_allclose(np.linalg.norm(catalogue.directions, axis=1), 1.0, atol=1e-12)
    assert [len(catalogue.brighter_than(m)) for m in (5.0, 6.0, 7.0)] == [1471, 4559, 13_943]
    assert not catalogue.directions.flags.writeable


def test_sirius_is_where_the_almanac_gives_it_in_2000() -> None:
    sirius = load_catalogue().at(parse_stamp("2000-01-01T12:00:00Z", "t")).selected([0])
    assert sirius.hip[0] == 32_349
    # SIMBAD, ICRS, epoch J2000: 06 45 08.917 -16 42 58.02
    ra, dec = np.radians(15.0 * (6 + 45 / 60 + 8.917 / 3600)), -np.radians(16 + 42 / 60 + 58.02 / 3600)
    expected = [np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)]
    assert np.linalg.norm(sirius.directions[0] - expected) < 0.1 * ARCSEC


def test_proper_motion_moves_groombridge_1830_by_seven_arcseconds_a_year() -> None:
    catalogue = load_catalogue()
    fast = catalogue.selected(np.flatnonzero(catalogue.hip == 57_939))
    later = fast.at(parse_stamp("2026-08-01T00:00:00Z", "t"))
    years = (later.epoch_ns - fast.epoch_ns) / 31_557_600e9
    displacements = np.linalg.norm(later.directions - fast.directions)
    np.testing.assert_allclose(displacements / years, 7.059 * ARCSEC, rtol=1e-3)


def test_stars_within_an_angle_are_those_with_a_larger_cosine() -> None:
    catalogue, axis = load_catalogue(), np.array([0.2, -2.0, 0.5])
    cosines = catalogue.directions @ (axis / np.linalg.norm(axis))
    np.testing.assert_array_equal(catalogue.near(axis, 0.1), np.flatnonzero(cosines >= np.cos(0.1)))
    with pytest.raises(InputError, match="direction"):
        catalogue.near([0.0, 0.0, 0.0], 0.1)


def test_the_sun_is_at_the_first_point_of_aries_at_the_equinox_and_the_earth_moves_at_30_km_s() -> None:
    stamp_ns = parse_stamp("2000-03-20T07:35:00Z", "t")
    sun = sun_position_m(stamp_ns)
    np.testing.assert_allclose(sun / np.linalg.norm(sun), [1.0, 0.0, 0.0], atol=3e-4)
    velocity = earth_velocity_m_s(stamp_ns)
    assert 29_700.0 < np.linalg.norm(velocity) < 30_000.0
    assert velocity[1] < -25_000.0  # the Sun moves to positive y, the Earth against it


def test_aberration_shifts_a_star_across_the_velocity_by_twenty_arcseconds_towards_it() -> None:
    apparent = aberrated([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [0.0, 29_790.0, 0.0])
    np.testing.assert_allclose(np.arctan2(apparent[0, 1], apparent[0, 0]) / ARCSEC, 20.496, atol=1e-3)
    np.testing.assert_allclose(apparent[1], [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(geometric(apparent, [0.0, 29_790.0, 0.0]), np.eye(3)[:2], atol=1e-14)


def test_apparent_directions_contain_proper_motion_and_aberration() -> None:
    stamp_ns, velocity = parse_stamp("2026-08-01T00:00:00Z", "t"), [1e4, -2e4, 5e3]
    bright = load_catalogue().brighter_than(2.0)
    apparent = bright.apparent(stamp_ns, velocity)
    np.testing.assert_allclose(
        apparent.directions, aberrated(bright.at(stamp_ns).directions, velocity), atol=1e-15
    )
    assert apparent.epoch_ns == stamp_ns


def test_the_stars_of_an_image_are_those_inside_its_border() -> None:
    catalogue = load_catalogue()
    R = looking_at(catalogue.directions[0])
    indices, pixels = visible_stars(catalogue, CAMERA, R)
    assert 0 in indices
    np.testing.assert_allclose(pixels[indices == 0][0], [79.5, 59.5], atol=1e-9)
    everything = CAMERA.project(catalogue.directions @ R)
    inside = (everything > -0.5).all(axis=1) & (everything < [159.5, 119.5]).all(axis=1)
    np.testing.assert_array_equal(indices, np.flatnonzero(inside))
    assert len(visible_stars(catalogue, CAMERA, R, margin_px=40.0)[0]) > len(indices)


def test_a_camera_without_size_or_a_matrix_that_is_no_rotation_is_refused() -> None:
    with pytest.raises(InputError, match="size"):
        visible_stars(load_catalogue(), CameraModel(0, 0, 400.0, 400.0, 79.5, 59.5), np.eye(3))
    with pytest.raises(InputError, match="rotation"):
        visible_stars(load_catalogue(), CAMERA, 2.0 * np.eye(3))


def test_a_source_keeps_its_signal_centre_and_width() -> None:
    image = np.zeros((41, 51), np.float32)
    add_sources(image, [[24.3, 19.6]], [1000.0], 1.2)
    v, u = np.mgrid[0:41, 0:51]
    assert image.sum() == pytest.approx(1000.0, rel=1e-5)
    centre = np.array([(image * u).sum(), (image * v).sum()]) / image.sum()
    np.testing.assert_allclose(centre, [24.3, 19.6], atol=1e-4)
    # Integration over a pixel adds 1/12 to the variance.
    variance = (image * (u - centre[0]) ** 2).sum() / image.sum()
    assert variance == pytest.approx(1.2**2 + 1.0 / 12.0, rel=1e-3)


def test_a_trail_is_as_long_as_the_displacement_and_keeps_the_signal() -> None:
    image = np.zeros((41, 101), np.float32)
    add_sources(image, [[50.0, 20.0]], [500.0], 0.8, trails_px=[30.0, 6.0])
    v, u = np.mgrid[0:41, 0:101]
    assert image.sum() == pytest.approx(500.0, rel=1e-5)
    for pixel, length in ((u, 30.0), (v, 6.0)):
        mean = (image * pixel).sum() / image.sum()
        variance = (image * (pixel - mean) ** 2).sum() / image.sum()
        assert variance == pytest.approx(0.8**2 + 1.0 / 12.0 + length**2 / 12.0, rel=2e-3)


def test_a_source_at_the_border_loses_the_part_outside() -> None:
    image = np.zeros((20, 20), np.float32)
    add_sources(image, [[-0.5, 10.0], [500.0, 3.0]], [100.0, 100.0], 1.0)
    assert image.sum() == pytest.approx(50.0, rel=1e-4)


@pytest.mark.parametrize(
    ("pixels", "signals", "sigma_px"),
    [([[1.0, np.nan]], [1.0], 1.0), ([[1.0, 1.0]], [1.0, 2.0], 1.0), ([[1.0, 1.0]], [1.0], 0.0)],
)
def test_sources_that_are_not_finite_or_have_no_width_are_refused(
    pixels: list[list[float]], signals: list[float], sigma_px: float
) -> None:
    with pytest.raises(InputError, match=r"expected"):
        add_sources(np.zeros((5, 5), np.float32), pixels, signals, sigma_px)


def test_five_magnitudes_are_a_factor_of_one_hundred() -> None:
    np.testing.assert_allclose(electron_rates([0.0, 5.0], 1e6), [1e6, 1e4])


@pytest.mark.parametrize("name", ["Alt40_Azi-135.png", "Alt60_Azi135.png"])
def test_catalogue_stars_coincide_with_those_of_real_images(
    name: str, real_data: Callable[[str], Path]
) -> None:
    truth = json.loads(real_data("star_images/truth.json").read_text())[name]
    matched = np.array(truth["matched_stars"])
    ra, dec = np.radians(matched[:, 0]), np.radians(matched[:, 1])
    directions = np.column_stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    catalogue = load_catalogue().at(parse_stamp("2019-07-29T12:00:00Z", "t"))
    distances = np.linalg.norm(catalogue.directions[None] - directions[:, None], axis=2)
    nearest = distances.argmin(axis=1)
    # Stars fainter than the catalogue have no counterpart; the others agree in direction and magnitude.
    in_both = matched[:, 2] < 6.8
    assert in_both.sum() >= 10
    assert np.median(distances.min(axis=1)[in_both]) < 5.0 * ARCSEC
    assert np.abs(catalogue.magnitudes[nearest] - matched[:, 2])[in_both].max() < 0.6
