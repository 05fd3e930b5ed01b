# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names, limits and query models that bus, HTTP, command line and clients share."""
