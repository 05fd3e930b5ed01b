# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Client of CORBA: GIOP 1.2, object references, and values that state their type (``any``).

After the specification CORBA 3.3, part 2 (OMG formal/2012-11-14); it needs no ORB.
"""
