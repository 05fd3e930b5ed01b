# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Readers and writers of files that others understand: one module per format, bytes or a path in, bytes out.

Point clouds: ``ply``, ``pcd``, ``kitti_bin``, ``las`` (all to and from ``CloudArrays``). Pictures: ``image`` (png, pgm,
ppm). Maps: ``geotiff``, ``hillshade``. Poses: ``tum``, ``pose``; graphs of them: ``g2o``. Arrays: ``npz``. ``detect``
tells a format by content, never by name; ``payload`` says which formats a type of the wire has, and writes them.
"""
