# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters common to both elevation maps."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig


class WindowConfig(DfnConfig):
    """Parameters of RollingWindow, and of the window that TiledMap returns."""

    size_m: float = Field(40.0, gt=0, le=10_000, description="Edge of the square window")
    resolution_m: float | None = Field(
        None,
        gt=0,
        description="Edge of a cell, a multiple of that of the patches; default: that of the patches",
    )
    clear_margin_m: float = Field(
        0.1, ge=0, description="Distance below the height of a cell at which rays must pass to clear it"
    )
