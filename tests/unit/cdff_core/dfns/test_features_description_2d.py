# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.features_description_2d.interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d.interface import FeaturesMatching2DInputs
from tests.support.corridor import texture

IMAGE = np.clip(texture(3, 256), 0, 255).astype(np.uint8)
#: The image rotated by 90°: pixel (x, y) moves to (y, 255 - x).
ROTATED = np.ascontiguousarray(np.rot90(IMAGE))


def node(name: str, implementation: str, **config: object) -> object:
    dfn = Registry.default().make_dfn(name, implementation)
    dfn.configure(config)
    return dfn


@pytest.mark.parametrize(
    ("detector", "descriptor", "min_fraction"),
    [("Sift", "Sift", 0.8), ("Sift", "RootSift", 0.8), ("Orb", "Orb", 0.6)],
)
def test_points_of_a_rotated_image_match_themselves(
    detector: str, descriptor: str, min_fraction: float
) -> None:
    features_of_image = []
    for image in (IMAGE, ROTATED):
        outputs = node("features_extraction_2d", detector, features=400).process(
            FeaturesExtraction2DInputs(image=image)
        )
        inputs = FeaturesDescription2DInputs(
            image=image, features=outputs.features, sizes=outputs.sizes, angles=outputs.angles
        )
        out = node("features_description_2d", descriptor).process(inputs)
        assert out.descriptors.dtype == np.uint8
        features_of_image.append((outputs.features[out.valid], out.descriptors[out.valid]))
    inputs = FeaturesMatching2DInputs(source=features_of_image[0][1], sink=features_of_image[1][1])
    matches = node("features_matching_2d", "MutualRatio", max_ratio=0.8).process(inputs).matches
    source, sink = features_of_image[0][0][matches[:, 0]], features_of_image[1][0][matches[:, 1]]
    expected = np.column_stack([source[:, 1], 255.0 - source[:, 0]])
    assert len(matches) > 60
    assert np.mean(np.hypot(*(sink - expected).T) < 2.0) > min_fraction


def test_corners_without_size_or_angle_are_described_and_border_points_marked_invalid() -> None:
    points = np.array([[128.0, 128.0], [1.0, 1.0]])
    for descriptor in ("Sift", "RootSift", "Orb"):
        out = node("features_description_2d", descriptor).process(
            FeaturesDescription2DInputs(image=IMAGE, features=points)
        )
        assert out.descriptors.shape[0] == len(out.valid) == 2
        assert out.valid[0]
        assert out.descriptors[0].any()
    assert not out.valid[1]  # for ORB, because the patch must lie inside the image


def test_no_points_give_no_descriptors_and_inconsistent_sizes_are_refused() -> None:
    sift = node("features_description_2d", "Sift")
    assert sift.process(
        FeaturesDescription2DInputs(image=IMAGE, features=np.zeros((0, 2)))
    ).descriptors.shape == (0, 128)
    with pytest.raises(InputError, match="sizes"):
        sift.process(FeaturesDescription2DInputs(image=IMAGE, features=np.zeros((3, 2)), sizes=np.ones(2)))
    with pytest.raises(InputError, match="uint8"):
        sift.process(FeaturesDescription2DInputs(image=IMAGE.astype(np.float32), features=np.zeros((3, 2))))


def test_root_sift_is_the_square_root_of_the_normalised_histogram() -> None:
    points = np.array([[100.0, 90.0]])
    sift_descriptor = (
        node("features_description_2d", "Sift")
        .process(FeaturesDescription2DInputs(image=IMAGE, features=points))
        .descriptors
    )
    root_sift_descriptor = (
        node("features_description_2d", "RootSift")
        .process(FeaturesDescription2DInputs(image=IMAGE, features=points))
        .descriptors
    )
    expected = np.minimum(np.rint(512.0 * np.sqrt(sift_descriptor / sift_descriptor.sum())), 255)
    assert np.array_equal(root_sift_descriptor, expected.astype(np.uint8))
