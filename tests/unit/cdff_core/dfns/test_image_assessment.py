# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.image_assessment.band_energy import BandEnergy
from cdff_core.dfns.image_assessment.interface import ImageAssessmentInputs
from tests.support.corridor import texture

IMAGE = np.clip(texture(10, 256), 0, 255).astype(np.uint8)


def assess(image: np.ndarray, previous: np.ndarray | None = None) -> tuple[float, ...]:
    dfn = BandEnergy()
    dfn.configure()
    out = dfn.process(ImageAssessmentInputs(image=image, previous=previous))
    return out.contrast, out.sharpness, out.saturation, out.change


def test_sharpness_falls_with_blur_and_does_not_follow_exposure() -> None:
    sharp = assess(IMAGE)[1]
    assert assess((IMAGE // 3).astype(np.uint8))[1] == pytest.approx(sharp, rel=0.1)
    assert assess(cv2.GaussianBlur(IMAGE, (0, 0), 2.0))[1] < 0.6 * sharp
    assert assess(cv2.GaussianBlur(IMAGE, (0, 0), 5.0))[1] < 0.25


def test_black_white_and_repeated_images_are_detected() -> None:
    assert assess(np.zeros_like(IMAGE))[:2] == (0.0, 0.0)
    assert assess(np.full_like(IMAGE, 255))[2] == 1.0
    assert assess(IMAGE, IMAGE)[3] == 0.0
    assert assess(IMAGE, np.roll(IMAGE, 1))[3] > 1.0
    assert np.isnan(assess(IMAGE)[3])


def test_a_previous_image_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"previous \(100, 256\).*r=256 of image"):
        assess(IMAGE, IMAGE[:100])
