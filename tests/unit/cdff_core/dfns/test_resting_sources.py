# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map of the sources at rest: the line through the sightings of a slowly moving source."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.multi_target_association.resting_sources import RestingSources

SIGMA_RAD, RATE_RAD_S, COUNT = 2e-5, 1e-5, 20


def test_the_state_of_a_moving_source_is_that_of_the_line_of_least_squares(rng: np.random.Generator) -> None:
    sources, times_s = RestingSources(), 10.0 + np.arange(COUNT)
    across_rad = rng.normal(0.0, SIGMA_RAD, (COUNT, 2)) + np.outer(times_s - 10.0, [RATE_RAD_S, 0.0])
    directions = np.column_stack([across_rad, np.ones(COUNT)])
    for k, time_s in enumerate(times_s):
        index = np.full(1, -1 if k == 0 else 0)
        sources.update(index, directions[k : k + 1], np.full(1, SIGMA_RAD**2), np.full(1, -1.0), time_s)
    moving, evidence = sources.take_moving(times_s[-1], 0.0)
    assert evidence.tolist() == [-COUNT]
    assert len(sources) == 0
    # The first sighting has no error: it is the origin of the line.
    slopes, variances = [], []
    for values in across_rad.T:
        (slope, value), covariance = np.polyfit(times_s - times_s[-1], values, 1, cov="unscaled")
        slopes.append((slope, value))
        variances.append(covariance)
    (rate_x, x), (rate_y, y) = slopes
    np.testing.assert_allclose(moving.directions[0, :2], [x, y], atol=1e-9)
    np.testing.assert_allclose(moving.rates[0, :2], [-rate_y, rate_x], atol=1e-10)
    # State: rotation of the direction and its rate; both components have the same variance.
    residuals = across_rad - np.outer(times_s - times_s[-1], [rate_x, rate_y]) - [x, y]
    sigma2 = max((residuals**2).sum() / (2 * COUNT - 4), SIGMA_RAD**2)
    expected = sigma2 * variances[0][::-1, ::-1]
    for axis in range(2):
        rows = np.array([axis, axis + 3])
        np.testing.assert_allclose(moving.covariances[0][np.ix_(rows, rows)], expected, rtol=1e-3)


@pytest.mark.parametrize("time_s", [0.0, 30.0])
def test_a_source_at_rest_is_found_again_and_starts_no_object(
    time_s: float, rng: np.random.Generator
) -> None:
    sources = RestingSources()
    for k in range(COUNT):
        direction = np.array([[*rng.normal(0.0, SIGMA_RAD, 2), 1.0]])
        index = sources.matched(direction, np.full(1, SIGMA_RAD**2), float(k))
        assert index.tolist() == [-1 if k == 0 else 0]
        sources.update(index, direction, np.full(1, SIGMA_RAD**2), np.full(1, -1.0), float(k))
    moving, _ = sources.take_moving(COUNT + time_s, 0.0)
    assert len(moving.directions) == 0
    found = sources.matched(np.array([[0.0, 0.0, 1.0]]), np.full(1, SIGMA_RAD**2), COUNT + time_s)
    assert sources.sightings(np.append(found, -1)).tolist() == [COUNT, 0]


def test_of_too_many_sources_those_seen_last_are_kept() -> None:
    sources, count = RestingSources(), 15_000
    for k in range(2):
        x = 1e-3 * (np.arange(count) + k * count)
        directions = np.column_stack([x, np.zeros(count), np.ones(count)])
        new, variances = np.full(count, -1), np.full(count, SIGMA_RAD**2)
        sources.update(new, directions / np.linalg.norm(directions, axis=1)[:, None], variances, variances, k)
    assert len(sources) == 20_000
    newest = sources.matched(directions[-1:] / np.linalg.norm(directions[-1]), variances[:1], 1.0)
    assert newest[0] >= 0
