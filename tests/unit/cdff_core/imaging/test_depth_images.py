# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth images: points of a ball, and the pairs with colour images."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import DistanceImage, Time
from cdff_core.imaging.depth_images import RgbdPairing, depth_of, points_near

MS = 1_000_000


def plane(depth_m: float, rows: int = 48, columns: int = 64, focal: float = 60.0) -> DistanceImage:
    return DistanceImage(
        ref_time=Time.from_ns(0),
        width=columns,
        height=rows,
        scale_x=1.0 / focal,
        scale_y=1.0 / focal,
        center_x=-31.5 / focal,
        center_y=-23.5 / focal,
        data=np.full(rows * columns, depth_m),
    )


def added(pairing: RgbdPairing, port: str, ms: int) -> list[tuple[int | None, int | None]]:
    """Return the times of image and depth image of each result, in milliseconds."""
    pairs = pairing.add(Sample(port, ms * MS, ms, None))
    return [(_ms(image), _ms(depth)) for image, depth in pairs]


def _ms(sample: Sample | None) -> int | None:
    return None if sample is None else sample.stamp_ns // MS


def test_the_points_are_those_of_the_ball() -> None:
    centre = np.array([0.1, -0.2, 2.0])
    points, step = points_near(plane(2.0), centre, 0.3, 10_000)
    assert step == 1
    z, K = depth_of(plane(2.0), 0.0, np.inf)
    v, u = np.mgrid[:48, :64]
    every = np.stack([(u - K[0, 2]) / 60.0 * z, (v - K[1, 2]) / 60.0 * z, z], axis=-1).reshape(-1, 3)
    expected = every[np.linalg.norm(every - centre, axis=1) < 0.3]
    np.testing.assert_allclose(points, expected)
    assert len(points_near(plane(2.0), centre, 0.3, 50)[0]) <= 70


@pytest.mark.parametrize("centre", [[0.0, 0.0, 0.1], [0.0, 0.0, -3.0], [50.0, 0.0, 2.0]])
def test_a_ball_without_points_has_none(centre: list[float]) -> None:
    assert points_near(plane(2.0), np.array(centre), 0.5, 100)[0].shape == (0, 3)


def test_a_cut_depth_image_is_refused() -> None:
    image = plane(2.0)
    cut = DistanceImage(width=64, height=48, scale_x=1.0, scale_y=1.0, data=image.data[:-1])
    with pytest.raises(InputError, match="3071 distances"):
        depth_of(cut, 0.0, np.inf)


def test_images_alone_do_not_wait() -> None:
    pairing = RgbdPairing()
    assert added(pairing, "image", 0) == [(0, None)]
    assert added(pairing, "image", 100) == [(100, None)]


def test_depth_images_alone_wait_only_at_first() -> None:
    pairing = RgbdPairing()
    assert added(pairing, "depth", 0) == []
    assert added(pairing, "depth", 100) == [(None, 0), (None, 100)]
    assert added(pairing, "depth", 200) == [(None, 200)]


def test_samples_of_one_time_are_a_pair_in_either_order() -> None:
    pairing = RgbdPairing()
    assert added(pairing, "depth", 0) == []
    assert added(pairing, "image", 5) == [(5, 0)]
    assert added(pairing, "image", 100) == []
    assert added(pairing, "depth", 105) == [(100, 105)]


def test_a_lost_depth_image_delays_one_image_only() -> None:
    pairing = RgbdPairing()
    added(pairing, "depth", 0)
    added(pairing, "image", 0)
    assert added(pairing, "image", 100) == []
    assert added(pairing, "image", 200) == [(100, None), (200, None)]
    assert added(pairing, "depth", 300) == []
    assert added(pairing, "image", 300) == [(300, 300)]
    assert added(pairing, "depth", 400) == []
    assert [(_ms(i), _ms(d)) for i, d in pairing.take_waiting()] == [(None, 400)]
