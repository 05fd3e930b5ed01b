# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to robots with ROCK: ports of running tasks over CORBA, which needs no ROCK."""
