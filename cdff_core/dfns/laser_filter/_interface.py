# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN LaserFilter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import LaserScan, RigidBodyState


@dataclass(frozen=True, slots=True, eq=False)
class LaserFilterInputs:
    """Inputs of one call.

    Attributes
    ----------
    scan_samples : LaserScan
        Samples of a laser scan.
    laser_2_body_tf : RigidBodyState
        Laser frame to body frame.
    """

    scan_samples: LaserScan
    laser_2_body_tf: RigidBodyState


@dataclass(frozen=True, slots=True, eq=False)
class LaserFilterOutputs:
    """Outputs of one call.

    Attributes
    ----------
    filtered_scans : LaserScan
        Filtered laser scans.
    """

    filtered_scans: LaserScan


class LaserFilterInterface(Dfn[Any, LaserFilterInputs, LaserFilterOutputs]):
    """Takes ranges that do not belong to the scene out of the samples of a laser scan. A range taken out carries an
    error code instead of a distance, so that the beam geometry stays as it was.
    """
