# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of joint states: conversion from and to positions by name."""

from __future__ import annotations

from collections.abc import Mapping

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.message import Message


class JointsExt(Message):
    """States of several joints at one time."""

    __slots__ = ()
    names: tuple[str, ...]
    elements: tuple[types.JointState, ...]

    @classmethod
    def from_positions(cls, positions: Mapping[str, float], *, stamp_ns: int) -> types.Joints:
        """Return the states of joints by the names of the URDF, rad or m, read at ``stamp_ns``."""
        states = tuple(types.JointState(position=float(value)) for value in positions.values())
        return types.Joints(types.Time.from_ns(stamp_ns), tuple(positions), states)

    @property
    def positions(self) -> dict[str, float]:
        """Positions by name, rad or m.

        Raises
        ------
        InputError
            If the numbers of names and states differ, or a name is repeated.
        """
        if len(self.names) != len(self.elements) or len(set(self.names)) != len(self.names):
            raise InputError(
                f"Joints: names {', '.join(self.names)} of {len(self.elements)} states, expected one unique "
                "name per state"
            )
        return {name: state.position for name, state in zip(self.names, self.elements, strict=True)}
