# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CQL2 (OGC 21-065r2): filters of STAC and of OGC API Features, as text and as JSON."""
