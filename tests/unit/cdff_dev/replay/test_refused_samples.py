# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay`` of a log that a DFPC does not accept ends with an error."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.cli import main


def test_images_without_a_calibration_are_named_with_the_remedy(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(2):
        cv2.imwrite(str(folder / f"{number:06d}.png"), rng.integers(0, 255, (48, 64), dtype=np.uint8))
    command = ["replay", str(folder), "--dfpc", "far_range_object_tracking", "--out", str(tmp_path / "out")]
    assert main(command) == 3
    error = capsys.readouterr().err
    assert "every sample was refused" in error
    assert "--calibration" in error
