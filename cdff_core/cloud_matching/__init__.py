# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Finding one cloud in another without a guess: what point_cloud_matching and shot_localisation share."""
