# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""HTTP middleware: access control, conditional requests, byte ranges and problem documents."""
