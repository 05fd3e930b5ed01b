# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes of a sensor in a pose graph: the part of a SLAM that does not depend on the sensor."""
