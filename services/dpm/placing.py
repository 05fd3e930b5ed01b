# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where things are: poses at a time, fixed frames and their revisions, bodies and anchors on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, Body
from cdff_common.geometry import checked_frame
from dpm_store.actor import check_robot
from dpm_store.frames import EVERYTHING, Known
from dpm_store.poses import EXTRAPOLATION_LIMIT_NS
from services.dpm.announcing import Announcing
from services.dpm.checks import whole_number
from services.dpm.parameters import GROUND, check_names, transform_of


class Placing(Announcing):
    """Operations on poses, frames and bodies."""

    def pose(
        self, parent: str, child: str, t_ns: int | None, *, robot: str | None = None, limit_s: float | None = None,
        known: Known = EVERYTHING,
    ) -> dict[str, Any]:  # fmt: skip
        """``T_parent_child`` at a time (newest that is known without one), as plain data."""
        checked_frame(parent, "parent")
        checked_frame(child, "child")
        if t_ns is None:
            newest_ns = self.store.poses.newest_ns(parent, child, known=known)
            t_ns = self.clock.now_ns() if newest_ns is None else newest_ns
        limit_ns = None if limit_s is None else int(limit_s * 1e9)
        T = self.store.poses.at(t_ns, parent, child, limit_ns=limit_ns, known=known)
        covariance = None if T.covariance is None else T.covariance.tolist()
        return {
            "parent": parent, "child": child, "stamp_ns": t_ns, "T": T.matrix.tolist(), "covariance": covariance,
            "robot": robot or "", "frames_revision": self.store.frames.state() if known.state is None else known.state,
            "limit_s": (EXTRAPOLATION_LIMIT_NS if limit_ns is None else limit_ns) / 1e9,
        }  # fmt: skip

    def frames(self, known: Known = EVERYTHING) -> list[dict[str, Any]]:
        """The last revision of every fixed frame, as far as known."""
        return [revision.to_dict() for revision in self.store.frames.current(known.as_of_ns, known.state)]

    def set_frame(self, body: Mapping[str, Any], producer: str = "") -> dict[str, Any]:
        """Add a revision of a fixed frame; subscribers get a ``reanchored`` event."""
        try:
            frame, parent = str(body["frame"]), str(body["parent"])
        except KeyError as error:
            raise InputError(f"frame revision: {error} is missing") from error
        check_robot(frame.split("/")[0])
        revision = self.store.frames.set(
            frame, parent, transform_of(body), producer=producer or str(body.get("producer", "")),
            valid_from_ns=whole_number(body, "valid_from_ns"), valid_until_ns=whole_number(body, "valid_until_ns"),
            expected_revision=whole_number(body, "expected_revision"),
        )  # fmt: skip
        self._tell()
        return revision.to_dict()

    def anchor(self, frame: str, body: Mapping[str, Any], producer: str = "") -> dict[str, Any]:
        """Place a frame on a body: ``{body, lon_deg, lat_deg, height_m?, azimuth_deg?, sigma_m?, sigma_deg?,
        expected_revision?}``; subscribers get a ``reanchored`` event.
        """
        checked_frame(frame)
        check_robot(frame.split("/")[0])
        numbers = ("lon_deg", "lat_deg", "height_m", "azimuth_deg", "sigma_m", "sigma_deg")
        check_names(body, frozenset({"body", "expected_revision", *numbers}), frozenset({"body", *numbers[:2]}))
        try:
            given = {name: float(body[name]) for name in numbers if name in body}
        except (TypeError, ValueError) as error:
            raise InputError(f"anchor of {frame}: expected numbers in {', '.join(numbers)}: {error}") from error
        sigmas = {name: given.pop(name) for name in numbers[4:] if name in given}
        place = Anchor(self.store.places.body(str(body["body"])), **given)
        revision = self.store.places.anchor(
            frame, place, **sigmas, producer=producer, expected_revision=body.get("expected_revision")
        )  # fmt: skip
        self._tell()
        return revision.to_dict()

    def define_body(self, body: Mapping[str, Any], producer: str = "") -> dict[str, Any]:
        """Enter a body that no authority lists, or a new revision of one; see ``Body.from_dict``."""
        check_robot(GROUND)
        new = Body.from_dict(body)
        revision = self.store.places.define(new, producer)
        self._tell()
        return new.to_dict() | {"revision": revision}
