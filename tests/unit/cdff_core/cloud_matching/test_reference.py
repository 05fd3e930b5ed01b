# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ReferenceCloud: a reference, a waiting sample, and a reference that cannot be prepared."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import Pointcloud
from cdff_core.cloud_matching.reference import ReferenceCloud


class Prepared(NamedTuple):
    points_m: np.ndarray


def prepare(sample: Sample) -> Prepared:
    if not len(sample.value.points_m):
        raise InputError("no points")
    return Prepared(sample.value.points_m[:1])


def cloud(points: Any) -> Sample:
    value = Pointcloud.from_points(points, frame="site", stamp_ns=1000)
    return Sample("model", 1000, 0, value, id="c")


def test_without_a_reference_frame_id_and_cloud_are_empty() -> None:
    reference = ReferenceCloud(prepare)
    assert (reference.frame, reference.id, reference.cloud()) == ("", "", None)


def test_a_reference_returns_the_sample_that_waited_for_it() -> None:
    reference = ReferenceCloud(prepare)
    reference.waiting = waiting = cloud(np.ones((1, 3)))
    assert reference.replace(cloud(np.ones((3, 3)))) is waiting
    assert reference.waiting is None
    assert (reference.frame, reference.id) == ("site", "c")
    prepared = reference.cloud()
    assert prepared is not None
    np.testing.assert_array_equal(prepared.points_m, np.ones((1, 3)))
    reference.clear()
    assert reference.frame == ""


def test_a_reference_that_cannot_be_prepared_is_refused_with_the_reason() -> None:
    reference = ReferenceCloud(prepare)
    reference.replace(cloud(np.zeros((0, 3))))
    assert reference.cloud() is None
    with pytest.raises(RefusedError) as refused:
        reference.prepared()
    assert list(refused.value.reasons) == ["bad_model:no points"]
