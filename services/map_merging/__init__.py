# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Puts the maps of several robots where they belong, from products in the DPM, by revisions of their frames."""
