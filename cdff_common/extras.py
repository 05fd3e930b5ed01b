# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Optional libraries: the extra of the distribution that installs each, and their import."""

from __future__ import annotations

import importlib
from typing import Any

from cdff_common.errors import CdffError

#: Modules that each extra of the distribution installs.
EXTRAS = {
    "core": [
        "cv2",
        "numba",
        "laspy",
        "lazrs",
        "lzf",
        "PIL",
        "psutil",
        "rasterio",
        "rtree",
        "scipy",
        "shapely",
        "small_gicp",
    ],
    "dpm": [
        "alembic",
        "cryptography",
        "fastapi",
        "pyproj",
        "sqlalchemy",
        "starlette",
        "uvicorn",
        "zstandard",
    ],
    "logs": ["google", "lz4", "mcap", "pye57", "rosbags", "velodyne_decoder"],
    "parquet": ["pyarrow"],
    "campaign": ["dask", "distributed"],
    "gateways-ccsds": ["cfdppy", "spacepackets"],
    "gateways-dds": ["cyclonedds"],
    "plot": ["matplotlib"],
    "simulate": ["astronomy", "open3d"],
    "view": ["foxglove", "rerun", "rerun_cli"],
    "analysis": ["geopandas", "pandas", "xarray"],
    "dev": ["argcomplete", "evo", "jinja2"],
    "evaluate": ["gtsam", "kiss_icp", "kiss_matcher"],
}


def extra_of(module: str) -> str | None:
    """Return the extra of the distribution that installs a module, None if no extra does."""
    top = module.partition(".")[0]
    return next((extra for extra, modules in EXTRAS.items() if top in modules), None)


def missing_extra(error: BaseException | None) -> str | None:
    """Return how to install the library that an import did not find, None for other errors."""
    if not isinstance(error, ModuleNotFoundError) or not error.name or not (extra := extra_of(error.name)):
        return None
    return f"{error.name} is not installed: pip install 'cdff[{extra}]'"


def import_extra(module: str) -> Any:
    """Import and return a module of an optional library; raises CdffError that names the extra."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise CdffError(missing_extra(error) or str(error)) from error
