# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image processing shared by several vision DFNs: patch alignment, pyramids, rectified stereo camera."""
