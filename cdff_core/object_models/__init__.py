# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Models of known objects: rendering, visible surface, symmetry, search for their pose in a scan."""
