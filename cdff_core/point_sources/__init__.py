# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions of connected pixels and the image of a point of light, shared by the DFNs for star fields."""
