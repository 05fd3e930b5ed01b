# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframe map of a camera: image features, measured points, place index and pose estimation."""
