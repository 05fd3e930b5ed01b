# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Star catalogue, and images of stars: shared by the simulator and the algorithms that use stars."""

from cdff_common.stars.aberration import aberrated, earth_velocity_m_s, geometric, sun_position_m
from cdff_common.stars.catalogue import StarCatalogue, load_catalogue
from cdff_common.stars.image import add_sources, electron_rates, visible_stars

__all__ = [
    "StarCatalogue",
    "aberrated",
    "add_sources",
    "earth_velocity_m_s",
    "electron_rates",
    "geometric",
    "load_catalogue",
    "sun_position_m",
    "visible_stars",
]
