# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of the viewer in the documentation: comparison, and their place in the site."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scripts import documentation_pictures as pictures


def _png(image: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(image.astype(np.uint8)).save(out, format="png")
    return out.getvalue()


def test_a_missing_space_differs_and_noise_does_not() -> None:
    rng = np.random.default_rng(1)
    image = np.full((560, 1000, 3), 20.0)
    image[80:500, 20:480] = 120.0
    noisy = image + rng.normal(0.0, 10.0, image.shape)
    assert pictures.difference(_png(image), _png(noisy.clip(0, 255))) < 1.0
    assert pictures.difference(_png(image), _png(np.full_like(image, 20.0))) > 20.0


def test_every_picture_is_committed_and_on_the_page() -> None:
    page = (pictures.ROOT / "docs" / "how-to" / "view-a-log.md").read_text(encoding="utf-8")
    for name in pictures.PICTURES:
        assert (pictures.IMAGES / name).is_file()
        assert f"../images/{name}" in page


def test_drawn_pictures_replace_those_of_the_site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, images = tmp_path / "drawn", tmp_path / "site" / "images"
    drawn.mkdir()
    images.mkdir(parents=True)
    (drawn / "viewer_rover.png").write_bytes(b"new")
    (images / "viewer_rover.png").write_bytes(b"old")
    monkeypatch.setattr(pictures, "DRAWN", drawn)
    pictures.on_post_build({"site_dir": str(tmp_path / "site")})
    assert (images / "viewer_rover.png").read_bytes() == b"new"
