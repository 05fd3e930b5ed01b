# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.features_description_2d._interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d._interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d._interface import FeaturesMatching2DInputs
from tests.corridor import texture

IMAGE = np.clip(texture(3, 256), 0, 255).astype(np.uint8)
#: Turned by a quarter, exactly: (x, y) comes to (y, 255 - x).
TURNED = np.ascontiguousarray(np.rot90(IMAGE))


def node(name: str, implementation: str, **config: object) -> object:
    made = Registry.default().make_dfn(name, implementation)
    made.configure(config)
    return made


@pytest.mark.parametrize(
    ("detector", "descriptor", "least"), [("Sift", "Sift", 0.8), ("Sift", "RootSift", 0.8), ("Orb", "Orb", 0.6)]
)
def test_points_of_a_turned_image_are_matched_to_themselves(detector: str, descriptor: str, least: float) -> None:
    described = []
    for image in (IMAGE, TURNED):
        found = node("features_extraction_2d", detector, features=400).process(FeaturesExtraction2DInputs(image))
        inputs = FeaturesDescription2DInputs(image, found.features, found.sizes, found.angles)
        out = node("features_description_2d", descriptor).process(inputs)
        assert out.descriptors.dtype == np.uint8
        described.append((found.features[out.valid], out.descriptors[out.valid]))
    inputs = FeaturesMatching2DInputs(described[0][1], described[1][1])
    matches = node("features_matching_2d", "MutualRatio", max_ratio=0.8).process(inputs).matches
    source, sink = described[0][0][matches[:, 0]], described[1][0][matches[:, 1]]
    expected = np.column_stack([source[:, 1], 255.0 - source[:, 0]])
    assert len(matches) > 60
    assert np.mean(np.hypot(*(sink - expected).T) < 2.0) > least


def test_corners_without_size_or_angle_are_described_and_what_lies_on_the_rim_says_so() -> None:
    points = np.array([[128.0, 128.0], [1.0, 1.0]])
    for descriptor in ("Sift", "RootSift", "Orb"):
        out = node("features_description_2d", descriptor).process(FeaturesDescription2DInputs(IMAGE, points))
        assert out.descriptors.shape[0] == len(out.valid) == 2
        assert out.valid[0]
        assert out.descriptors[0].any()
    assert not out.valid[1]  # of ORB, whose patch must lie inside


def test_no_points_are_no_descriptors_and_sizes_that_do_not_fit_are_refused() -> None:
    sift = node("features_description_2d", "Sift")
    assert sift.process(FeaturesDescription2DInputs(IMAGE, np.zeros((0, 2)))).descriptors.shape == (0, 128)
    with pytest.raises(InputError, match="sizes"):
        sift.process(FeaturesDescription2DInputs(IMAGE, np.zeros((3, 2)), np.ones(2)))
    with pytest.raises(InputError, match="uint8"):
        sift.process(FeaturesDescription2DInputs(IMAGE.astype(np.float32), np.zeros((3, 2))))


def test_root_sift_is_the_square_root_of_the_shares() -> None:
    points = np.array([[100.0, 90.0]])
    plain = node("features_description_2d", "Sift").process(FeaturesDescription2DInputs(IMAGE, points)).descriptors
    root = node("features_description_2d", "RootSift").process(FeaturesDescription2DInputs(IMAGE, points)).descriptors
    expected = np.minimum(np.rint(512.0 * np.sqrt(plain / plain.sum())), 255)
    assert np.array_equal(root, expected.astype(np.uint8))
