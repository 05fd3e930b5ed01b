# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The user or service that makes changes; recorded with every change in the history."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from cdff_common.errors import DeniedError

#: From weak to strong, except that a robot writes only its own products.
ROLES = ("reader", "robot", "operator", "admin")


@dataclass(frozen=True, slots=True)
class Actor:
    """A user or service with a role.

    Attributes
    ----------
    name : str
        Name of the key; the id of a robot.
    role : str
        One of ``ROLES``.
    via : str
        ``http`` or ``zenoh``.
    """

    name: str
    role: str
    via: str

    @property
    def text(self) -> str:
        """Form in the history: ``via/role/name``."""
        return f"{self.via}/{self.role}/{self.name}"

    def check_robot(self, robot: str) -> None:
        """Raise DeniedError if the actor is another robot."""
        if self.role == "robot" and robot != self.name:
            raise DeniedError(
                f"robot {self.name[:64]} may write only its own products, these are of {robot[:64]!r}"
            )


_ACTOR: ContextVar[Actor | None] = ContextVar("actor", default=None)


@contextmanager
def acting(actor: Actor | None) -> Iterator[None]:
    """Attribute all changes inside the block to an actor."""
    token = _ACTOR.set(actor)
    try:
        yield
    finally:
        _ACTOR.reset(token)


def actor() -> Actor | None:
    """Return the present actor; None for the process itself."""
    return _ACTOR.get()


def check_robot(robot: str) -> None:
    """Raise DeniedError if the present actor is another robot."""
    if (present := actor()) is not None:
        present.check_robot(robot)
