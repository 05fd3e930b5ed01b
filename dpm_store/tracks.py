# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The way that a moving frame took, thinned to what a map shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select

from dpm_store import schema
from dpm_store.database import Database
from dpm_store.poses import Track


def path(database: Database, track: Track, most: int) -> NDArray[np.float64]:
    """Positions of a track in its parent frame, ``(n, 3)``, metres, in time order: every k-th and the last.

    Parameters
    ----------
    database : Database
    track : Track
    most : int
        Rows at most, about.
    """
    p = schema.poses.c
    numbered = (
        select(p.matrix, p.stamp_ns, func.row_number().over(order_by=(p.stamp_ns, p.ordinal)).label("number"))
        .where(
            p.child == track.child, p.parent == track.parent, p.source == track.source, p.robot == track.robot,
            p.deleted_ns.is_(None),
        )
        .subquery()
    )  # fmt: skip
    step = max(-(-track.count // most), 1)
    wanted = ((numbered.c.number - 1) % step == 0) | (numbered.c.number == track.count)
    statement = select(numbered.c.matrix).where(wanted).order_by(numbered.c.number)
    with database.read() as connection:
        rows = connection.execute(statement).scalars().all()
    matrices = np.frombuffer(b"".join(rows), dtype="<f8").reshape(-1, 4, 4)
    return np.array(matrices[:, :3, 3])
