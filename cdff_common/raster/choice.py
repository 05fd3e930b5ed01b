# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a cell of a window holds where several patches have measured or judged it."""

from __future__ import annotations

from enum import StrEnum


class Choice(StrEnum):
    """What a cell holds where several patches have measured it."""

    POOLED = "pooled"  # all measurements together
    NEWEST = "newest"  # those of the patch that measured it last
    OLDEST = "oldest"  # those of the patch whose measurement of it is oldest
    BEST = "best"  # those of the patch with the least variance; a single height without one counts as worst


class Disagreement(StrEnum):
    """What becomes of pooled cells whose patches disagree; they are counted in any case."""

    KEEP = "keep"  # they stay pooled: the variance holds the spread between the patches
    NEWEST = "newest"  # they hold what the newest patch measured
    DROP = "drop"  # they are unobserved


class NavigationChoice(StrEnum):
    """Whose judgement a cell holds where several maps know it."""

    NEWEST = "newest"  # of the map whose capture ended last
    OLDEST = "oldest"  # of the map whose capture ended first
    WORST = "worst"  # the worst class of any map, and the largest of every other layer
