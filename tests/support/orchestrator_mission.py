# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated mission: two rovers, their sensors, and DFPCs that compete for a lidar and for CPU."""

from __future__ import annotations

from typing import Any

from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.registry import Registry


def _dfpc(
    name: str, inputs: dict[str, bool], output: str, type_name: str, product: str | None, cpu_s: float
) -> Any:
    return DfpcDescription.model_validate(
        {
            "name": name,
            "doc": "simulated",
            "track": "planetary",
            "control": ["simulated"],
            "input_ports": [
                {"name": port, "type": "X", "optional": optional} for port, optional in inputs.items()
            ],
            "output_ports": [{"name": output, "type": type_name, "product": product}],
            "implementations": [{"name": "Simulated"}],
            "cost": {"Simulated": {"input": "a sample", "cpu_s": cpu_s, "memory_mb": 50}},
        }
    )


DFPCS = {
    d.name: d
    for d in (
        _dfpc("vo", {"stereo": False}, "pose", "TransformWithCovariance", None, 0.05),
        _dfpc("slam", {"scan": False}, "pose", "TransformWithCovariance", "pose", 0.2),
        _dfpc(
            "position",
            {"odometry": True, "visual_odometry": True},
            "pose",
            "TransformWithCovariance",
            "pose",
            0.01,
        ),
        _dfpc("dem", {"scan": False, "poses": False}, "map", "ElevationMap", "dem", 0.1),
        _dfpc("stereo_dem", {"stereo": False, "poses": False}, "map", "ElevationMap", "dem", 0.3),
        _dfpc("navigation", {"dem": False}, "navigation_map", "NavigationMap", "navigation_map", 0.1),
    )
}


class SimulatedRegistry:
    """A registry with the simulated DFPCs; product types are those of the installed DFPCs."""

    dfpcs = Registry.default().dfpcs

    def dfpc(self, name: str) -> DfpcDescription:
        return DFPCS[name]


_SENSORS: dict[str, Any] = {
    "navcam": {
        "kind": "stereo_camera",
        "frame": "FRAME",
        "streams": {"pair": "FramePair"},
        "initial_mode": "off",
        "modes": {
            "off": {"on": False},
            "nominal": {"rate_hz": 1.0, "stereo": True},
            "fast": {"rate_hz": 3.0, "stereo": True},
        },
        "range_m": 20.0,
    },
    "lidar": {
        "kind": "lidar",
        "frame": "FRAME",
        "streams": {"scan": "LidarScan"},
        "initial_mode": "off",
        "range_m": 30.0,
        "modes": {
            "off": {"on": False},
            "warm": {"on": False},
            "slow": {"rate_hz": 1.0},
            "fast": {"rate_hz": 5.0},
            "dense": {"rate_hz": 2.0},
        },
        "transitions": {
            "off": {"warm": 2.0},
            "warm": {"slow": 0.5, "fast": 0.5, "dense": 1.0, "off": 0.2},
        },
    },
    "wheels": {"kind": "wheels", "frame": "FRAME", "streams": {"odometry": "TransformWithCovariance"}},
}

_ENTRIES: list[dict[str, Any]] = [
    {
        "name": "vo",
        "inputs": {"stereo": "sensor/navcam/pair"},
        "modes": {"navcam": {"stereo": True}},
        "linger_s": 20.0,
    },
    {"name": "slam", "inputs": {"scan": "sensor/lidar/scan"}, "modes": {"lidar": "fast"}, "warm_up_s": 2.0},
    {
        "name": "position",
        "inputs": {"odometry": "sensor/wheels/odometry", "visual_odometry": "product/vo/pose"},
        "activation": "always",
    },
    {
        "name": "dem",
        "inputs": {"scan": "sensor/lidar/scan", "poses": "product/position/pose|product/slam/pose"},
        "modes": {"lidar": "slow|dense"},
        "linger_s": 10.0,
    },
    {
        "name": "stereo_dem",
        "inputs": {"stereo": "sensor/navcam/pair", "poses": "product/position/pose"},
        "modes": {"navcam": "fast"},
    },
    {"name": "navigation", "inputs": {"dem": "product/dem/map"}, "linger_s": 5.0},
]


def profile(**changes: dict[str, Any]) -> Profile:
    """Return a profile of two rovers; ``minnie`` has fewer DFPCs.

    ``changes`` are replaced fields of entries, by the name of the DFPC.
    """
    entries = [{**e, **changes.get(e["name"], {})} for e in _ENTRIES]

    def robot(name: str, dfpcs: list[dict[str, Any]]) -> dict[str, Any]:
        sensors = {s: x | {"frame": f"{name}/{s}"} for s, x in _SENSORS.items()}
        limits = {"cpu_cores": 2.0, "memory_mb": 500.0, "max_speed_m_s": 0.1}
        return {"id": name, "sensors": sensors, "limits": limits, "dfpcs": dfpcs}

    entries_of_minnie = [e for e in entries if e["name"] not in ("stereo_dem", "navigation")]
    return Profile.model_validate(
        {"name": "day", "robots": [robot("mana", entries), robot("minnie", entries_of_minnie)]}
    )
