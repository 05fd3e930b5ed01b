# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which track belongs to which object in the evaluation of far_range_tracking."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from cdff_common.types import ObjectTrackStatusT
from evaluation.far_range_tracking import _Pass
from evaluation.scenes.distant_rovers import TrueImage, TrueObject


def assigned(places: dict[str, float], tracks: dict[int, float], numbers: dict[str, int]) -> dict[str, int]:
    """Return the number of the track of each object, from the columns of objects and tracks."""
    objects = {
        name: TrueObject(np.array([u, 50.0]), 1.0, np.array([20.0, 20.0]), 40.0, True)
        for name, u in places.items()
    }
    image = TrueImage(0.0, np.zeros((1, 1)), np.zeros((1, 1)), np.eye(4), objects)
    rows: list[Any] = [
        SimpleNamespace(
            metadata=SimpleNamespace(track_id=number, status=ObjectTrackStatusT.TRACK_CONFIRMED),
            data=SimpleNamespace(pixels=np.array([[u, 50.0]])),
        )
        for number, u in tracks.items()
    ]
    images: Any = SimpleNamespace(images=[image], rows=[rows])
    result = _Pass.tracks_of_objects(images, 0, numbers)
    return {name: int(track.metadata.track_id) for name, track in result.items()}


def test_a_track_belongs_to_the_object_whose_number_it_has() -> None:
    # The track of b is nearer to a, whose own track is lost.
    assert assigned({"a": 100.0, "b": 106.0}, {2: 101.0}, {"a": 1, "b": 2}) == {"b": 2}


def test_without_numbers_the_nearest_tracks_belong_to_the_objects_and_each_to_one() -> None:
    assert assigned({"a": 100.0, "b": 107.0}, {5: 106.0, 6: 99.0}, {}) == {"a": 6, "b": 5}
    assert assigned({"a": 100.0, "b": 104.0}, {5: 103.0}, {}) == {"b": 5}


def test_a_track_that_is_too_far_belongs_to_no_object() -> None:
    assert assigned({"a": 100.0}, {1: 108.5}, {"a": 1}) == {}
    assert assigned({"a": 100.0}, {1: 107.5}, {"a": 1}) == {"a": 1}


def test_another_track_at_the_place_of_an_object_is_a_change_of_its_number() -> None:
    assert assigned({"a": 100.0}, {3: 101.0, 1: 150.0}, {"a": 1}) == {"a": 3}
