# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Projections by COLMAP and by the omnidirectional camera of OpenCV, in a process of CDFF_PEER_PYTHON."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from cdff_common.geometry.se3 import FloatArray

_SCRIPT = """
import json, sys, cv2, numpy as np, pycolmap
request = json.load(open(sys.argv[1]))
points = np.array(request["points"])
result = {}
for model, parameters in request["colmap"].items():
    camera = pycolmap.Camera(model=model, width=640, height=480, params=parameters)
    result[model] = camera.img_from_cam(points).tolist()
xi, *distortion = request["omnidir"]["distortion"]
K = np.array(request["omnidir"]["K"])
zero = np.zeros(3)
pixels, _ = cv2.omnidir.projectPoints(points[:, None], zero, zero, K, xi, np.array(distortion))
result["omnidir"] = pixels.reshape(-1, 2).tolist()
answer = {"pixels": result, "pycolmap": pycolmap.__version__, "opencv": cv2.__version__}
json.dump(answer, open(sys.argv[2], "w"))
"""


def peer_projections(
    python: str, points_m: FloatArray, colmap: dict[str, list[float]], omnidir: dict[str, Any]
) -> dict[str, Any]:
    """Return the pixels of points (n, 3) by model name, and the versions of the libraries.

    Parameters
    ----------
    python : str
        Interpreter with pycolmap, and OpenCV with its contributed modules.
    points_m : ndarray, shape (n, 3)
        Points in the camera frame.
    colmap : dict
        Parameters by the name of COLMAP's model.
    omnidir : dict
        ``K`` (3, 3) and ``distortion``, xi first.
    """
    with tempfile.TemporaryDirectory() as folder:
        request, answer = Path(folder) / "request.json", Path(folder) / "answer.json"
        document = {"points": points_m.tolist(), "colmap": colmap, "omnidir": omnidir}
        request.write_text(json.dumps(document), encoding="utf-8")
        subprocess.run([python, "-c", _SCRIPT, str(request), str(answer)], check=True)
        result: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
        return result
