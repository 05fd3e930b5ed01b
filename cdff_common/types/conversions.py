# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Methods of every message that convert it to other libraries; see ``cdff_common.adapters``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from datetime import datetime

    from numpy.typing import NDArray


class Conversions:
    """Mix-in of ``Message``; the libraries are imported when a method is called."""

    __slots__ = ()

    def to_datetime(self) -> datetime:
        """Return the stamp in UTC, ``stamp_ns`` in another form; raises InputError if there is none."""
        from cdff_common import adapters

        return adapters.to_datetime(self)

    def to_numpy(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the message by name: layers, points, image, poses."""
        from cdff_common import adapters

        return adapters.to_numpy(self)

    def to_xarray(self) -> Any:
        """Return a map, an image or a trajectory as ``xarray.Dataset``."""
        from cdff_common import adapters

        return adapters.to_xarray(self)

    def to_pandas(self) -> Any:
        """Return a cloud, a trajectory or matches as ``pandas.DataFrame``."""
        from cdff_common import adapters

        return adapters.to_pandas(self)

    def to_geopandas(self) -> Any:
        """Return poses, paths and areas as ``geopandas.GeoDataFrame``."""
        from cdff_common import adapters

        return adapters.to_geopandas(self)

    def to_open3d(self) -> Any:
        """Return a cloud as ``open3d.geometry.PointCloud``."""
        from cdff_common import adapters

        return adapters.to_open3d(self)

    def save(self, path: str | Path) -> None:
        """Write the message in the format of the suffix, such as ``.tif``, ``.ply`` or ``.uper``."""
        from cdff_common import adapters

        adapters.save(self, path)

    def plot(self, path: str | Path | None = None) -> Any:
        """Return a ``matplotlib.figure.Figure``; write it to a ``.png`` or ``.svg`` file if given."""
        from cdff_common import adapters

        return adapters.plot(self, path)
