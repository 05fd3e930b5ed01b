# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files that a profile names: their content replaces the paths of URDF documents and mask images."""

from __future__ import annotations

from pathlib import Path

from cdff_common.errors import ConfigurationError
from cdff_common.geometry.urdf import read_urdf
from cdff_common.interfaces.profile import Profile, Robot, read_mask
from cdff_common.interfaces.profile_checks.faults import Finding
from cdff_common.interfaces.sensor_profile import URDF_MASK, Sensor
from cdff_common.interfaces.yaml_file import Location


def with_files(profile: Profile, folder: Path, findings: list[Finding]) -> Profile:
    """Return the profile with the content of its files, paths relative to ``folder``.

    A file that cannot be used is added to ``findings``; the profile is then without it.
    """
    robots = []
    for i, robot in enumerate(profile.robots):
        urdf = _urdf_document(robot, folder, ("robots", i), findings)
        sensors = {
            name: _with_masks(sensor, robot, folder, ("robots", i, "sensors", name), findings)
            for name, sensor in robot.sensors.items()
        }
        robots.append(robot.model_copy(update={"urdf": urdf, "sensors": sensors}))
    return profile.model_copy(update={"robots": tuple(robots)})


def _urdf_document(robot: Robot, folder: Path, place: Location, findings: list[Finding]) -> str:
    """Return the URDF of a robot; empty, with a finding, if it cannot be read."""
    if not robot.urdf:
        return ""
    try:
        text = (folder / robot.urdf).read_text(encoding="utf-8")
        read_urdf(text)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is no text"
        problem = f"cannot be read ({reason}); expected a URDF, its path relative to the profile"
        findings.append(Finding((*place, "urdf"), problem, robot.urdf))
        return ""
    except ConfigurationError as error:
        findings.append(Finding((*place, "urdf"), str(error), robot.urdf))
        return ""
    return text


def _with_masks(
    sensor: Sensor, robot: Robot, folder: Path, place: Location, findings: list[Finding]
) -> Sensor:
    """Return the sensor with its masks loaded; a mask that cannot be read is a finding."""
    loaded = {}
    for field, value in (("mask", sensor.mask), ("mask_right", sensor.mask_right)):
        if value == URDF_MASK and not robot.urdf:
            findings.append(Finding((*place, field), "expected an image, since the robot has no URDF", value))
        if not value or value == URDF_MASK:
            continue
        try:
            loaded[field] = read_mask(folder / value)
        except ConfigurationError as error:
            findings.append(Finding((*place, field), str(error), value))
    return sensor.model_copy(update=loaded)
