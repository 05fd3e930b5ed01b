# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Text of a new driver: a template with the names of a robot and a sensor."""

from __future__ import annotations

import re
from importlib.resources import files

from cdff_common.contract.names import NAME, ROBOT_ID
from cdff_common.errors import InputError

_LICENCE = re.compile(r"\A(# SPDX[^\n]*\n)+")


def driver_text(kind: str, robot: str, sensor: str | None = None) -> str:
    """Return the source of a driver.

    Parameters
    ----------
    kind : str
        Module of ``cdff_dev.new.drivers``.
    robot, sensor : str
        Names in the profile; None for the sensor keeps that of the template.

    Raises
    ------
    InputError
        If a name is not valid in a profile.
    """
    for what, name, pattern in (("robot", robot, ROBOT_ID), ("sensor", sensor, NAME)):
        if name is not None and not re.fullmatch(pattern, name):
            raise InputError(f"{what} {name!r}: expected a name of a profile, a-z, 0-9 and _")
    text = files("cdff_dev.new.drivers").joinpath(f"{kind}.py").read_text(encoding="utf-8")
    text = re.sub(
        r'^ROBOT = "\w+"', f'ROBOT = "{robot}"', _LICENCE.sub("", text), count=1, flags=re.MULTILINE
    )
    if sensor is not None:
        text = re.sub(r'^SENSOR = "\w+"', f'SENSOR = "{sensor}"', text, count=1, flags=re.MULTILINE)
    return text
