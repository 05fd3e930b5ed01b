# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of several robots put where they belong: closures between robots, one pose graph, an anchor for each map."""
