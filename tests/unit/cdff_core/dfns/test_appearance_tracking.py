# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.appearance_tracking.interface import AppearanceTrackingInputs, AppearanceTrackingOutputs
from cdff_core.dfns.appearance_tracking.masked_correlation import MaskedCorrelation
from tests.support.distant_scene import Body, DistantScene


def matched(
    image: np.ndarray, template: np.ndarray, place: list[float], reach: float = 8.0, **inputs: object
) -> AppearanceTrackingOutputs:
    node = MaskedCorrelation()
    node.configure()
    values = {
        "weights": np.ones(template.shape, np.float32),
        "scales": np.ones(1),
        "noise": 1.5,
    }
    values.update(inputs)
    return node.process(
        AppearanceTrackingInputs(
            image=image,
            template=template.astype(np.float32),
            place=np.array(place),
            reach=np.array([reach, reach]),
            **values,  # type: ignore[arg-type]
        )
    )


def test_a_body_is_found_at_parts_of_a_pixel_with_its_covariance() -> None:
    squares = []
    first = DistantScene([Body((100.0, 80.0), (0.0, 0.0))]).image(0)
    template = first[72:89, 89:112]
    for k in range(12):
        place = np.array([103.0 + 0.31 * k, 78.0 + 0.17 * k])
        image = DistantScene([Body((place[0], place[1]), (0.0, 0.0))]).image(k + 1)
        match = matched(image, template, [104.0, 79.0])
        assert match.score > 0.85
        squares.append((match.place - place) @ np.linalg.inv(match.covariance) @ (match.place - place))
        assert match.place == pytest.approx(place, abs=0.3)
        assert match.second < match.score - 0.1
    assert np.mean(squares) < 6.0


def test_the_scale_with_the_best_correlation_is_returned() -> None:
    template = DistantScene([Body((100.0, 80.0), (0.0, 0.0))]).image(0)[70:91, 87:114]
    match = matched(
        DistantScene([Body((100.0, 80.0), (0.0, 0.0))]).image(1),
        template,
        [100.0, 80.0],
        scales=np.array([0.8, 1.0, 1.25]),
    )
    assert match.scale == pytest.approx(1.0)


def test_outside_the_image_there_is_no_place_and_wrong_weights_are_refused() -> None:
    image = DistantScene([]).image(0)
    match = matched(image, image[70:90, 80:100], [-60.0, 80.0])
    assert match.score == -1.0
    assert np.isnan(match.place).all()
    with pytest.raises(InputError, match="weights"):
        matched(image, image[70:90, 80:100], [90.0, 80.0], weights=np.zeros((20, 20), np.float32))
