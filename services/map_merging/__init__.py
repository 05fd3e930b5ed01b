# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Merging of the maps of several robots: reads products from the DPM and revises the frames of the maps."""
