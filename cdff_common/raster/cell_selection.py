# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rules for the content of a cell that several patches cover."""

from __future__ import annotations

from enum import StrEnum


class Choice(StrEnum):
    """Content of a cell that several patches have measured."""

    POOLED = "pooled"  # all measurements together
    WEIGHTED = "weighted"  # mean of the robots, weighted by the error variance of their pooled cells
    NEWEST = "newest"  # those of the patch that measured it last
    OLDEST = "oldest"  # those of the patch with the oldest measurement of it
    BEST = (
        "best"  # those of the patch with the smallest variance; a single height without one counts as worst
    )


class Disagreement(StrEnum):
    """Treatment of pooled cells whose patches disagree; they are counted in any case."""

    KEEP = "keep"  # they stay pooled: the variance includes the deviation between the patches
    NEWEST = "newest"  # they hold the measurements of the newest patch
    DROP = "drop"  # they are unobserved


class NavigationChoice(StrEnum):
    """Content of a navigation cell that several maps cover."""

    NEWEST = "newest"  # that of the map whose capture ended last
    OLDEST = "oldest"  # that of the map whose capture ended first
    WORST = "worst"  # the worst class of any map, and the largest value of every other layer
