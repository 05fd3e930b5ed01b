# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Contact plan: when a robot and the ground can exchange data, and at which rate."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from cdff_common.contract.names import ROBOT_ID
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.yaml_file import read_mapping

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
Rate = Annotated[float, Field(ge=100.0, le=1e10)]


class ContactWindow(StrictModel):
    """A time in which the link exists.

    Attributes
    ----------
    robot : str
    start, end : datetime
        Mission time, with an offset from UTC.
    rate_bit_s : float
        Rate from the robot to the ground, bit/s.
    up_bit_s : float or None
        Rate from the ground to the robot, bit/s; None for the same rate.
    delay_s : float
        One-way delay, seconds.
    """

    robot: Annotated[str, Field(pattern=f"^{ROBOT_ID}$")]
    start: datetime
    end: datetime
    rate_bit_s: Rate
    up_bit_s: Rate | None = None
    delay_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.start.tzinfo is None or self.end.tzinfo is None:
            raise ValueError("start and end need an offset from UTC, as in 2026-11-29T12:00:00Z")
        if self.start >= self.end:
            raise ValueError(f"start {self.start} is not before end {self.end}")
        return self

    @property
    def start_ns(self) -> int:
        """Start, mission time in nanoseconds."""
        return _ns(self.start)

    @property
    def end_ns(self) -> int:
        """End, mission time in nanoseconds."""
        return _ns(self.end)

    @property
    def up_rate_bit_s(self) -> float:
        """Rate from the ground to the robot, bit/s."""
        return self.rate_bit_s if self.up_bit_s is None else self.up_bit_s


class ContactPlan(StrictModel):
    """The windows of all robots; those of one robot do not overlap."""

    windows: Annotated[tuple[ContactWindow, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        for robot in {window.robot for window in self.windows}:
            windows = self.of(robot)
            for first, second in itertools.pairwise(windows):
                if second.start < first.end:
                    raise ValueError(f"windows of {robot} overlap: {first.end} is after {second.start}")
        return self

    def of(self, robot: str) -> list[ContactWindow]:
        """Return the windows of a robot in order."""
        return sorted((w for w in self.windows if w.robot == robot), key=lambda w: w.start)

    def current(self, robot: str, now_ns: int) -> ContactWindow | None:
        """Return the window of a robot at a time; None out of contact."""
        return next((w for w in self.of(robot) if w.start_ns <= now_ns < w.end_ns), None)

    def nearest(self, robot: str, now_ns: int) -> ContactWindow | None:
        """Return the window of a robot at a time, or the one that is least distant from it."""
        return min(self.of(robot), key=lambda w: max(w.start_ns - now_ns, now_ns - w.end_ns, 0), default=None)

    def after(self, robot: str, now_ns: int) -> list[ContactWindow]:
        """Return the windows of a robot that have not ended, in order."""
        return [w for w in self.of(robot) if w.end_ns > now_ns]


def load_contact_plan(path: Path) -> ContactPlan:
    """Read a contact plan; raises ConfigurationError with the reason if it is not one."""
    try:
        return ContactPlan.model_validate(read_mapping(path))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigurationError(
            f"{path}: {where}: {first['msg']}, got {str(first['input'])[:80]}"
        ) from error


def _ns(time: datetime) -> int:
    return (time - _EPOCH) // timedelta(microseconds=1) * 1000
