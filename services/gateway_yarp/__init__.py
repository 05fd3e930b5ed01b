# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to robots with YARP: its ports become samples, products become messages; it needs no YARP."""
