# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.types import Frame
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs
from cdff_core.dfns.disparity_image.sgbm import Sgbm

K = np.array([[500.0, 0, 100], [0, 500, 60], [0, 0, 1]])


def frame(image: np.ndarray, mode: str = "GRAY") -> Frame:
    return Frame.from_image(image, stamp_ns=5000, mode=mode, camera_matrix=K, sensor="mana/navcam_left")


def match(left: np.ndarray, right: np.ndarray, mode: str = "GRAY", **config: Any) -> np.ndarray:
    node = Sgbm()
    node.configure({"num_disparities": 32, **config})
    return node.process(
        DisparityImageInputs(left=frame(left, mode), right=frame(right, mode))
    ).disparity.image


def texture(rng: np.random.Generator, rows: int = 120, cols: int = 240) -> np.ndarray:
    noise = cv2.GaussianBlur(rng.uniform(0, 255, (rows, cols)).astype(np.float32), (0, 0), 1.2)
    return cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def shifted(image: np.ndarray, disparity_px: float) -> np.ndarray:
    """Return the right image of a fronto-parallel plane: column x of the left image is at column x - d."""
    x, y = np.meshgrid(
        np.arange(image.shape[1], dtype=np.float32), np.arange(image.shape[0], dtype=np.float32)
    )
    return cv2.remap(image, x + np.float32(disparity_px), y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


@pytest.mark.parametrize("disparity_px", [3.0, 9.5, 20.25])
def test_a_plane_parallel_to_the_images_has_one_disparity(
    rng: np.random.Generator, disparity_px: float
) -> None:
    left = texture(rng)
    disparity = match(left, shifted(left, disparity_px))
    inner = disparity[5:-5, 30:-30]
    assert np.isfinite(inner).mean() > 0.95
    assert np.nanmedian(inner) == pytest.approx(disparity_px, abs=0.15)


def test_columns_invisible_to_the_right_camera_have_no_disparity(rng: np.random.Generator) -> None:
    left = texture(rng)
    disparity = match(left, shifted(left, 16.0), left_right_px=1.0)
    assert np.isfinite(disparity[:, :14]).mean() < 0.2
    assert np.isfinite(disparity[10:-10, 20:40]).mean() > 0.9


def test_gaps_are_filled_with_the_background_unless_too_wide_or_at_the_edge(
    rng: np.random.Generator,
) -> None:
    left = texture(rng)
    right = shifted(left, 4.0)
    # A box in front of the wall hides ten columns of it.
    right[40:80, 100:140] = shifted(left, 14.0)[40:80, 100:140]
    unfilled, filled = (match(left, right, fill_px=n) for n in (0, 16))
    gaps = np.isnan(unfilled) & np.isfinite(filled)
    has_disparity = np.isfinite(unfilled)
    np.testing.assert_array_equal(filled[has_disparity], unfilled[has_disparity])
    gaps_at_box = gaps[45:75, 90:160]
    assert gaps_at_box.sum() > 5 * 30
    assert np.median(filled[45:75, 90:160][gaps_at_box]) == pytest.approx(4.0, abs=0.2)
    for row in np.isnan(filled):
        runs = np.diff(np.flatnonzero(np.diff(np.r_[0, row, 0])))[::2]
        inner_runs = runs[1:-1] if len(runs) > 2 else runs[:0]
        assert (inner_runs > 16).all()


def test_images_of_different_scenes_have_almost_no_disparity(rng: np.random.Generator) -> None:
    assert np.isfinite(match(texture(rng), texture(rng))).mean() < 0.1


def test_a_black_pair_gives_no_disparity() -> None:
    black = np.zeros((60, 120), np.uint8)
    disparity = match(black, black)
    assert not np.any(disparity > 0)


@pytest.mark.parametrize("mode", ["RGB", "BGR"])
def test_colour_is_matched_as_grey(rng: np.random.Generator, mode: str) -> None:
    left = texture(rng)
    right = shifted(left, 9.0)
    colour = match(np.dstack([left] * 3), np.dstack([right] * 3), mode)
    np.testing.assert_array_equal(colour, match(left, right))


def test_both_sixteen_bit_images_are_scaled_equally(rng: np.random.Generator) -> None:
    left = texture(rng)
    right = shifted(left, 9.0)
    deep = match(left.astype(np.uint16) * 16, right.astype(np.uint16) * 16)
    assert np.nanmedian(deep) == pytest.approx(9.0, abs=0.1)


def test_the_disparity_has_the_camera_and_stamp_of_the_left_image(rng: np.random.Generator) -> None:
    node = Sgbm()
    node.configure({"num_disparities": 16})
    image = texture(rng, 40, 60)
    outputs = node.process(DisparityImageInputs(left=frame(image), right=frame(image))).disparity
    assert (outputs.stamp_ns, outputs.frame, outputs.image.dtype) == (5000, "mana/navcam_left", np.float32)
    np.testing.assert_array_equal(outputs.camera_matrix, K)


def test_inconsistent_images_are_refused() -> None:
    with pytest.raises(InputError, match="same size"):
        match(np.zeros((40, 60), np.uint8), np.zeros((40, 61), np.uint8))
    with pytest.raises(InputError, match="uint8 or uint16"):
        match(np.zeros((40, 60), np.float32), np.zeros((40, 60), np.float32))


@pytest.mark.parametrize("config", [{"num_disparities": 20}, {"block_px": 4}, {"paths": 4}, {"speckles": 1}])
def test_parameters_out_of_bounds_are_refused(config: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        Sgbm().configure(config)


@pytest.mark.parametrize(
    ("name", "scale", "search", "config", "bad_1", "density", "plain_bad_1"),
    [
        ("teddy", 4.0, 64, {"paths": 5}, 0.055, 0.80, 0.10),
        ("teddy", 4.0, 64, {"paths": 3}, 0.055, 0.84, 0.10),
        ("teddy", 4.0, 64, {"paths": 3, "fill_px": 16}, 0.06, 0.875, 0.10),
        ("tsukuba", 16.0, 16, {"paths": 5}, 0.04, 0.92, 0.05),
        ("tsukuba", 16.0, 16, {"paths": 3}, 0.04, 0.94, 0.05),
        ("tsukuba", 16.0, 64, {"paths": 3, "fill_px": 16}, 0.046, 0.98, 0.05),
    ],
)
def test_middlebury_pairs_have_fewer_errors_than_with_plain_sgbm(
    real_data: Callable[[str], Path],
    name: str,
    scale: float,
    search: int,
    config: dict[str, int],
    bad_1: float,
    density: float,
    plain_bad_1: float,
) -> None:
    """``bad_1``: fraction of disparities with an error above 1 px, among those with ground truth."""
    folder = real_data(f"middlebury/{name}")
    left, right = (cv2.imread(str(folder / f), cv2.IMREAD_GRAYSCALE) for f in ("im2.png", "im6.png"))
    truth = cv2.imread(str(folder / "disp2.png"), cv2.IMREAD_GRAYSCALE).astype(np.float64) / scale

    def score(disparity: np.ndarray) -> tuple[float, float]:
        has_both = (truth > 0) & np.isfinite(disparity)
        return float(np.mean(np.abs(disparity - truth)[has_both] > 1.0)), float(
            has_both.sum() / (truth > 0).sum()
        )

    plain = cv2.StereoSGBM.create(0, search, 5, 200, 800, 1, 31, 10).compute(left, right) / 16.0
    plain_score = score(np.where(plain >= 0, plain, np.nan))
    sgbm_score = score(match(left, right, num_disparities=search, **config))
    assert plain_score[0] > plain_bad_1
    assert sgbm_score[0] < bad_1
    assert sgbm_score[0] < plain_score[0]
    assert sgbm_score[1] > density


@pytest.mark.parametrize("paths", [3, 5, 8])
def test_disparities_of_sloping_ground_are_not_biased_towards_the_rows_above(paths: int) -> None:
    # The disparity grows by 0.15 px per row. A single pass of 5 paths, all from above, is 0.1 px too low.
    rng = np.random.default_rng(4)
    textured = cv2.GaussianBlur(rng.uniform(0, 255, (240, 480)).astype(np.float32), (0, 0), 1.2)
    textured = np.clip(128 + 1.2 * (textured - textured.mean()), 0, 255)
    disparity = 10.0 + 0.15 * np.arange(240.0)[:, None] * np.ones((1, 320))
    col, row = np.meshgrid(np.arange(320.0) + 80.0, np.arange(240.0))
    left = cv2.remap(textured, col.astype(np.float32), row.astype(np.float32), cv2.INTER_CUBIC)
    right = cv2.remap(textured, (col + disparity).astype(np.float32), row.astype(np.float32), cv2.INTER_CUBIC)
    noise = rng.normal(0.0, 1.5, (2, 240, 320))
    left, right = (np.clip(i + n, 0, 255).astype(np.uint8) for i, n in zip((left, right), noise, strict=True))
    matched = match(left, right, num_disparities=64, paths=paths)
    error = (matched - disparity)[20:-20, 60:-20]
    assert np.isfinite(error).mean() > 0.9
    assert abs(np.nanmedian(error)) < 0.06
