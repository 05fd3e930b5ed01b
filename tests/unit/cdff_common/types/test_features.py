# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Features and correspondences as arrays with one row per item."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import decode, encode
from cdff_common.errors import InputError


def test_correspondences_are_read_and_written_as_columns(rng: np.random.Generator) -> None:
    a, b, p = rng.normal(size=(5, 2)), rng.normal(size=(5, 2)), rng.uniform(size=5)
    decoded = decode("CorrespondenceMap2D", encode(types.CorrespondenceMap2D.from_arrays(a, b, p)))
    np.testing.assert_array_equal(decoded.sources_px, a)
    np.testing.assert_array_equal(decoded.sinks_px, b)
    np.testing.assert_array_equal(decoded.probabilities, p)
    correspondences_3d = types.CorrespondenceMap3D.from_arrays([[1, 2, 3]], [[4, 5, 6]])
    assert correspondences_3d.sources_m.tolist() == [[1, 2, 3]]
    assert correspondences_3d.sinks_m.tolist() == [[4, 5, 6]]
    assert correspondences_3d.probabilities.tolist() == [1.0]
    with pytest.raises(InputError, match="sinks: 1 rows, expected 2"):
        types.CorrespondenceMap2D.from_arrays([[1, 2], [3, 4]], [[1, 2]])


def test_no_correspondences_are_empty_columns() -> None:
    assert types.CorrespondenceMap2D().sources_px.shape == (0, 2)
    assert types.CorrespondenceMap3D().sinks_m.shape == (0, 3)
    assert types.VisualPointFeatureVector2D().descriptors.shape == (0, 0)


def test_features_are_read_and_written_as_columns(rng: np.random.Generator) -> None:
    points, descriptors = rng.normal(size=(3, 2)), rng.normal(size=(3, 128)).astype(np.float32)
    features_2d = decode(
        "VisualPointFeatureVector2D",
        encode(types.VisualPointFeatureVector2D.from_arrays(points, descriptors)),
    )
    np.testing.assert_array_equal(features_2d.points_px, points)
    np.testing.assert_array_equal(features_2d.descriptors, descriptors)
    features_3d = types.VisualPointFeatureVector3D.from_arrays([[0, 0, 0], [1, 2, 3]], feature_type=1)
    assert features_3d.feature_type is types.VisualPointFeature3DType.SHOT
    assert features_3d.extent_m() == (0.0, 0.0, 0.0, 1.0, 2.0, 3.0)
    assert features_3d.descriptors.shape == (2, 0)


def test_a_feature_reference_has_no_position_and_descriptors_of_unequal_length_are_refused() -> None:
    reference = types.VisualPointFeature3D(
        types.VisualPointFeature3DPoint("reference", types.Point3DReference(1, 2)), [1.0]
    )
    features = types.VisualPointFeatureVector3D((reference, types.VisualPointFeature3D()))
    assert np.isnan(features.points_m[0]).all()
    assert features.points_m[1].tolist() == [0, 0, 0]
    with pytest.raises(InputError, match="descriptors of 0 to 1 numbers"):
        _ = features.descriptors
    with pytest.raises(InputError, match=r"shape \(2,\), expected \(n, d\)"):
        types.VisualPointFeatureVector2D.from_arrays([[1, 2]], [1.0, 2.0])
