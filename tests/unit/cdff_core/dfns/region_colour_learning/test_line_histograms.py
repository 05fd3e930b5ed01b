# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""RegionColourLearning: colours of a box and of its background, later images, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.region_colour_learning.interface import (
    RegionColourLearningInputs,
    RegionColourLearningOutputs,
)
from cdff_core.dfns.region_colour_learning.line_histograms import LineHistograms
from tests.support.coloured_boxes import BOX, T_BOX, colour_image
from tests.support.satellite_images import CAMERA_MATRIX


def learn(image: np.ndarray, T: np.ndarray = T_BOX, **changes: Any) -> RegionColourLearningOutputs:
    node = LineHistograms()
    node.configure({"bins": 8})
    ports = {"vertices": BOX[0], "triangles": BOX[1], "camera_matrix": CAMERA_MATRIX, "pose": T}
    return node.process(RegionColourLearningInputs(image=image, **ports | changes))


def test_the_colours_of_body_and_background_are_separate(rng: np.random.Generator) -> None:
    outputs = learn(colour_image(T_BOX, rng, noise=0.0))
    # Bins of 32: (170, 120, 60) and (90, 110, 150).
    assert outputs.body_colours[(5 * 8 + 3) * 8 + 1] == pytest.approx(1.0)
    assert outputs.background_colours[(2 * 8 + 3) * 8 + 4] == pytest.approx(1.0)
    assert outputs.pixels > 500


def test_a_later_image_adds_a_part(rng: np.random.Generator) -> None:
    first = learn(colour_image(T_BOX, rng, noise=0.0))
    colours = {"body_colours": first.body_colours, "background_colours": first.background_colours}
    second = learn(np.zeros((240, 320, 3), np.uint8), **colours)
    assert second.body_colours[0] == pytest.approx(0.2)
    assert second.body_colours.max() == pytest.approx(0.8)


def test_a_body_out_of_view_leaves_the_colours(rng: np.random.Generator) -> None:
    first = learn(colour_image(T_BOX, rng))
    colours = {"body_colours": first.body_colours, "background_colours": first.background_colours}
    behind = learn(colour_image(T_BOX, rng), se3.transform(np.eye(3), [0.0, 0.0, -4.0]), **colours)
    assert behind.pixels == 0
    np.testing.assert_array_equal(behind.body_colours, first.body_colours)


def test_colours_that_start_without_pixels_are_those_of_the_first_pixels(rng: np.random.Generator) -> None:
    image = colour_image(T_BOX, rng)
    empty = learn(image, se3.transform(np.eye(3), [0.0, 0.0, -4.0]))
    assert not empty.body_colours.any()
    assert not empty.background_colours.any()
    colours = {"body_colours": empty.body_colours, "background_colours": empty.background_colours}
    first, later = learn(image), learn(image, **colours)
    np.testing.assert_array_equal(later.body_colours, first.body_colours)
    assert later.background_colours.sum() == pytest.approx(1.0)


def test_other_numbers_of_colours_and_channels_are_refused(rng: np.random.Generator) -> None:
    image = colour_image(T_BOX, rng)
    with pytest.raises(InputError, match="body_colours: 7, expected 512"):
        learn(image, body_colours=np.ones(7), background_colours=np.ones(7))
    with pytest.raises(InputError, match="expected one or three channels"):
        learn(image[:, :, :2])
    with pytest.raises(InputError, match="no triangle"):
        learn(image, triangles=np.zeros((0, 3), np.int64))
