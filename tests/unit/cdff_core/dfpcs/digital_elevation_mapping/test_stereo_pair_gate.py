# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig
from cdff_core.dfpcs.digital_elevation_mapping.stereo_pair_gate import StereoPairGate

MS = 1_000_000


def gate() -> StereoPairGate:
    return StereoPairGate(DigitalElevationMappingConfig(stereo_distance_m=0.3, stereo_period_s=1.0))


def test_pairs_are_skipped_while_the_robot_is_at_rest() -> None:
    pairs = gate()
    used_ms = [t for t in range(0, 3001, 100) if pairs.is_due(t * MS, np.zeros(3))]
    assert used_ms == [0, 1000, 2000, 3000]


def test_a_moving_robot_uses_pairs_by_distance_and_at_most_at_the_maximum_rate() -> None:
    pairs = gate()
    used_ms = [t for t in range(0, 1501, 100) if pairs.is_due(t * MS, np.array([0.004 * t, 0.0, 0.0]))]
    assert used_ms == [0, 500, 1000, 1500]
    pairs.reset()
    assert pairs.is_due(1501 * MS, np.zeros(3))
