# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The rover of the picture in docs/explanation/frames.md; as a program, it writes the picture."""

from __future__ import annotations

from pathlib import Path

from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.new.frames_picture import frames_svg
from cdff_dev.new.profile import CAMERA_AXES

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "images" / "frames_rover.svg"


def picture() -> str:
    """Return the picture of the page as SVG."""
    graph = FrameGraph()

    def mount(child: str, xyz_m: list[float], rpy_deg: list[float], axes: FloatArray | None = None) -> None:
        T = UncertainTransform.from_xyz_rpy_deg(xyz_m, rpy_deg).matrix
        graph.set_static(
            "mana/base", f"mana/{child}", UncertainTransform.exact(T if axes is None else T @ axes)
        )

    mount("imu", [-0.2, 0.05, 0.1], [0.0, 0.0, 0.0])
    mount("lidar", [0.05, 0.0, 0.75], [0.0, 12.0, 0.0])
    mount("navcam_left", [0.4, 0.1, 0.55], [0.0, 20.0, 0.0], CAMERA_AXES)
    mount("navcam_right", [0.4, -0.1, 0.55], [0.0, 20.0, 0.0], CAMERA_AXES)
    return frames_svg(graph, "mana")


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
