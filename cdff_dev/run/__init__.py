# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff run``: one DFN or DFPC, run once on files, which are read and written by the types of the ports."""
