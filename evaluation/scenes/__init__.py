# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated scenes with known truth: terrain, orbital maps, bundles of cameras and points."""
