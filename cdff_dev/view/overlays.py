# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images, and the features, detections and disparities of the same camera that are laid over them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cdff_dev.view.drawings import Layer, Marks, Picture, Rectangles


@dataclass(frozen=True, slots=True, eq=False)
class _Camera:
    """First image in the frame of a camera."""

    path: str
    picture: Picture

    def has_pixels_of(self, other: Picture) -> bool:
        """Return whether a pixel of the other image is in the same direction."""
        K, other_K = self.picture.camera_matrix, other.camera_matrix
        is_same_size = self.picture.pixels.shape[:2] == other.pixels.shape[:2]
        return is_same_size and (K is None or other_K is None or np.allclose(K, other_K, rtol=1e-3))


class Overlays:
    """Finds the image on which marks, rectangles and further images of the same camera are drawn.

    This is the first image in their frame. Marks that come before it wait for it.
    """

    def __init__(self) -> None:
        self._cameras: dict[str, _Camera] = {}
        self._waiting: dict[str, tuple[int, Layer]] = {}

    def place(self, stamp_ns: int, layer: Layer) -> Iterator[tuple[int, Layer]]:
        """Yield the layers that can be drawn with a new one, with their stamps."""
        drawing = layer.drawing
        if isinstance(drawing, Picture):
            yield stamp_ns, self._placed_picture(layer, drawing)
            yield from self._release(layer.frame)
        elif isinstance(drawing, (Marks, Rectangles)) and layer.frame:
            if (camera := self._cameras.get(layer.frame)) is None:
                self._waiting[layer.path] = (stamp_ns, layer)
            else:
                yield stamp_ns, replace(layer, drawing=replace(drawing, picture=camera.path))
        else:
            yield stamp_ns, layer

    def end(self) -> Iterator[tuple[int, Layer]]:
        """Yield the layers for which no image arrived; each is shown in a view of its own."""
        yield from self._waiting.values()
        self._waiting.clear()

    def _placed_picture(self, layer: Layer, picture: Picture) -> Layer:
        if not layer.frame:
            return layer
        camera = self._cameras.setdefault(layer.frame, _Camera(layer.path, picture))
        if camera.path == layer.path or not camera.has_pixels_of(picture):
            return layer
        return replace(layer, drawing=replace(picture, picture=camera.path))

    def _release(self, frame: str) -> Iterator[tuple[int, Layer]]:
        """Yield the layers that waited for the position of a frame."""
        for path, (stamp_ns, layer) in list(self._waiting.items()):
            if layer.frame == frame:
                del self._waiting[path]
                yield from self.place(stamp_ns, layer)
