# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image arithmetic that several vision DFNs share: patch alignment, pyramids, the rectified stereo camera."""
