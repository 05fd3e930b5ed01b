# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelRegionMeasurement: offsets of a moved box, images without information, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.model_region_measurement.interface import (
    ModelRegionMeasurementInputs,
    ModelRegionMeasurementOutputs,
)
from cdff_core.dfns.model_region_measurement.outline_lines import OutlineLines
from cdff_core.dfns.region_colour_learning.interface import RegionColourLearningInputs
from cdff_core.dfns.region_colour_learning.line_histograms import LineHistograms
from tests.support.coloured_boxes import BOX, T_BOX, colour_image
from tests.support.satellite_images import CAMERA_MATRIX

PORTS = {"vertices": BOX[0], "triangles": BOX[1], "camera_matrix": CAMERA_MATRIX}


@pytest.fixture
def colours(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return the colours of the box and of its background."""
    node = LineHistograms()
    node.configure()
    learned = node.process(RegionColourLearningInputs(image=colour_image(T_BOX, rng), pose=T_BOX, **PORTS))
    return {"body_colours": learned.body_colours, "background_colours": learned.background_colours}


def measure(image: np.ndarray, T: np.ndarray = T_BOX, **changes: Any) -> ModelRegionMeasurementOutputs:
    node = OutlineLines()
    node.configure()
    ports = {"image": image, "pose": T, "range_px": 12.0} | PORTS | changes
    return node.process(ModelRegionMeasurementInputs(**ports))


def test_offsets_and_their_standard_deviations_are_those_of_a_box_that_is_seen_elsewhere(
    rng: np.random.Generator, colours: dict[str, np.ndarray]
) -> None:
    moved = T_BOX.copy()
    moved[0, 3] += 0.05
    outputs = measure(colour_image(moved, rng), **colours)
    assert len(outputs.points) > 80
    expected = 400.0 * 0.05 / 4.0 * outputs.normals[:, 0]
    error = outputs.offsets[:, 0] - expected
    assert np.median(np.abs(error)) < 1.0
    assert np.percentile(np.abs(error) / outputs.sigmas, 80) < 2.0


def test_normals_point_away_from_the_body(rng: np.random.Generator, colours: dict[str, np.ndarray]) -> None:
    outputs = measure(colour_image(T_BOX, rng), **colours)
    assert (np.einsum("ij,ij->i", outputs.normals, outputs.pixels - CAMERA_MATRIX[:2, 2]) > 0.0).all()


def test_an_image_of_one_colour_has_no_lines(colours: dict[str, np.ndarray]) -> None:
    outputs = measure(np.full((240, 320, 3), 40, np.uint8), **colours)
    assert len(outputs.points) == 0


@pytest.mark.parametrize("unknown", ["body_colours", "background_colours"])
def test_colours_of_no_pixel_have_no_lines(
    rng: np.random.Generator, colours: dict[str, np.ndarray], unknown: str
) -> None:
    image = colour_image(T_BOX, rng, noise=2.0)
    assert len(measure(image, **colours).points) > 80
    one_empty = colours | {unknown: np.zeros_like(colours[unknown])}
    assert len(measure(image, **one_empty).points) == 0


def test_a_body_behind_the_camera_has_no_lines(
    rng: np.random.Generator, colours: dict[str, np.ndarray]
) -> None:
    behind = se3.transform(np.eye(3), [0.0, 0.0, -4.0])
    assert measure(colour_image(T_BOX, rng), behind, **colours).offsets.shape == (0, 1)


def test_wrong_colours_are_refused(rng: np.random.Generator) -> None:
    colours = {"body_colours": np.ones(100), "background_colours": np.ones(100)}
    with pytest.raises(InputError, match="100 colours, expected the same number of bins"):
        measure(colour_image(T_BOX, rng), **colours)
