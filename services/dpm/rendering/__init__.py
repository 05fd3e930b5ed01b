# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Payloads in the requested form: codecs, file formats, images and tiles."""
