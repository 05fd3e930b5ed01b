# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff profile`` and ``cdff scenario``: the files that ship with the framework."""
