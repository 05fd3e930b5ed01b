# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps across products: elevation and navigation windows, pyramids, clouds and profiles."""
