# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Campaigns: many isolated runs of a command, on this machine or on workers of Dask, resumable."""
