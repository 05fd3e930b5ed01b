# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Choice between candidates that agree equally well with the view."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cdff_common.geometry import se3
from cdff_core.partial_views.configuration import ViewSearchConfig
from cdff_core.partial_views.localisation import _choose
from cdff_core.partial_views.search import ViewCandidate

CONFIG = ViewSearchConfig()
HERE, THERE = (se3.transform(np.eye(3), [x, 0.0, 1.0]) for x in (0.0, 0.5))


class Search:
    """Search of which the scores (here, there) are given for each factor on the tolerance."""

    tolerance_m = 0.01

    def __init__(self, scores: dict[float, tuple[float, float]], finest: float = 0.0) -> None:
        self.scores, self.finest = scores, finest

    def candidates(self) -> list[ViewCandidate]:
        here, there = self.scores[1.0]
        start = [ViewCandidate(HERE, here, None), ViewCandidate(THERE, there, None)]  # type: ignore[arg-type]
        return sorted(start, key=lambda c: -c.score)

    def resolves(self, factor: float) -> bool:
        return factor >= self.finest

    def refined(self, candidates: list[ViewCandidate], factor: float) -> list[ViewCandidate]:
        scored = [replace(c, score=self.scores[factor][int(c.T is THERE)]) for c in candidates]
        return sorted(scored, key=lambda c: -c.score)

    def is_same(self, first: Any, second: Any, factor: float = 1.0) -> bool:
        return first is second


class Model:
    """Model without symmetry."""

    def is_symmetry(self, T: Any, tolerance_m: float) -> bool:
        return False


def choose(search: Search) -> tuple[bool, float, float]:
    choice = _choose(search, Model(), search.candidates(), CONFIG)  # type: ignore[arg-type]
    return choice.best.T is HERE, choice.factor, choice.margin


def test_a_sufficient_margin_needs_no_smaller_tolerance() -> None:
    assert choose(Search({1.0: (0.95, 0.8)})) == (True, 1.0, pytest.approx(0.15))


def test_a_smaller_tolerance_distinguishes_poses_of_equal_score() -> None:
    search = Search({1.0: (0.97, 0.99), 0.5: (0.96, 0.95), 0.25: (0.95, 0.7)})
    assert choose(search) == (True, 0.25, pytest.approx(0.25))


def test_the_tolerance_does_not_become_smaller_than_the_noise() -> None:
    search = Search({1.0: (0.97, 0.99), 0.5: (0.96, 0.95), 0.25: (0.95, 0.7)}, finest=0.5)
    here, factor, margin = choose(search)
    assert (here, factor) == (False, 1.0)
    assert margin < CONFIG.min_margin


def test_a_low_score_with_the_smaller_tolerance_leaves_the_first_choice_with_its_low_margin() -> None:
    search = Search({1.0: (0.97, 0.99), 0.5: (0.7, 0.4)})
    here, factor, margin = choose(search)
    assert (here, factor) == (False, 1.0)
    assert margin < CONFIG.min_margin


@pytest.mark.parametrize(("score", "factor"), [(CONFIG.min_score, 0.5), (CONFIG.min_score - 1e-6, 1.0)])
def test_a_refined_candidate_may_have_the_least_score(score: float, factor: float) -> None:
    """Below it, the choice is that with the whole tolerance."""
    search = Search({1.0: (0.97, 0.99), 0.5: (score, score - CONFIG.min_margin - 0.01)})
    assert choose(search)[1] == factor


@pytest.mark.parametrize("name", ["min_score", "min_margin", "min_outline"])
def test_a_limit_of_a_fraction_is_at_most_one(name: str) -> None:
    assert getattr(ViewSearchConfig(**{name: 1.0}), name) == 1.0
    with pytest.raises(ValidationError, match=name):
        ViewSearchConfig(**{name: 1.5})
