# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a body as JSON, with the word ``unobservable`` for values that the poses do not determine."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from cdff_common.types import BodyMotion

UNOBSERVABLE = "unobservable"


def write_body_motion(value: BodyMotion) -> bytes:
    """Return the motion as JSON; units are in the names, standard deviations begin with ``sigma_``."""
    return (json.dumps(body_motion_value(value), indent=1) + "\n").encode()


def body_motion_value(value: BodyMotion) -> dict[str, Any]:
    """Return the motion as values of JSON."""
    kind = value.kind.name.removeprefix("MOTION_").lower()
    rotation: dict[str, Any] = dict.fromkeys(("axis", "rate_radps", "period_s"), UNOBSERVABLE)
    if kind != "resting":
        period_s = 2.0 * np.pi / value.rate
        rotation = {
            "axis": value.axis.tolist(),
            "sigma_axis_rad": value.axis_sigma,
            "rate_radps": value.rate,
            "sigma_rate_radps": value.rate_sigma,
            "period_s": period_s,
            "sigma_period_s": period_s * value.rate_sigma / value.rate,
        }
    inertia: dict[str, Any] = dict.fromkeys(("inertia_ratios", "principal_axes"), UNOBSERVABLE)
    if value.moment_ratios.any():
        inertia = {
            "inertia_ratios": value.moment_ratios.tolist(),
            "sigma_inertia_ratios": np.sqrt(np.diagonal(value.cov_moment_ratios)).tolist(),
            "principal_axes": value.principal_axes.T.tolist(),
        }
    return {
        "stamp_ns": str(value.stamp_ns),
        "frame": value.frame_id,
        "body_frame": value.body_frame_id,
        "kind": kind,
        **rotation,
        **inertia,
        "centre_m": value.centre.tolist(),
        "sigma_centre_m": np.sqrt(np.diagonal(value.cov_centre)).tolist(),
        "unobservable_directions_of_centre": value.unobservable.tolist(),
    }
