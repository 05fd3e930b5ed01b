# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ports of YARP: values (bottles), the carriers tcp and text, and the name server, after https://yarp.it."""
