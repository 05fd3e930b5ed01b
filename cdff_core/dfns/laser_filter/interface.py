# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN LaserFilter."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import LaserScan, RigidBodyState


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LaserFilterOutputs:
    """Outputs of one call.

    Attributes
    ----------
    filtered_scans : LaserScan
        Filtered laser scans.
    """

    filtered_scans: LaserScan


class LaserFilterInterface(Dfn[ConfigT, LaserFilterInputs, LaserFilterOutputs]):
    """Remove ranges that do not belong to the scene from a laser scan. A removed range is replaced by
    an error code, so that the beam geometry is unchanged.
    """


#: Short names for the implementations.
Inputs = LaserFilterInputs
Outputs = LaserFilterOutputs
Interface = LaserFilterInterface
