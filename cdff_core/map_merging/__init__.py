# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Merging of the maps of several robots: loop closures, a joint pose graph, an anchor per map."""
