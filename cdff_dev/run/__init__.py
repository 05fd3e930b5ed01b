# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff run``: one DFN or DFPC, once, on files; the types of the ports decide how files are read and
written.
"""
