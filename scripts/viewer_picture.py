# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Picture of the viewer without a display: ``python scripts/viewer_picture.py PATH… --out FILE.png``.

The viewer Rerun draws with a software implementation of Vulkan: lavapipe (Debian package
``mesa-vulkan-drivers``), or SwiftShader, which comes with Chromium.
"""

from __future__ import annotations

import argparse
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from PIL import Image

from cdff_common.errors import UnavailableError
from cdff_dev.ports import free_port
from cdff_dev.view.outputs import rerun_program

#: Drivers in order of preference, each with its loader; None is the loader of the system.
_DRIVERS = (
    (Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json"), None),
    (Path("/usr/share/vulkan/icd.d/lvp_icd.json"), None),
    (Path("/usr/lib/chromium/vk_swiftshader_icd.json"), Path("/usr/lib/chromium/libvulkan.so.1")),
)
#: Longest time until the picture, and time after which the notices at the start have disappeared, seconds.
_TIMEOUT_S, _NOTICES_S = 120.0, 6.0


def software_vulkan(folder: Path) -> dict[str, str] | None:
    """Return the environment for drawing without a graphics card; None if no driver is installed.

    ``folder`` is for a link to a loader that is not where the system looks for it.
    """
    for driver, loader in _DRIVERS:
        if driver.is_file():
            environment = {"VK_ICD_FILENAMES": str(driver), "WGPU_BACKEND": "vulkan"}
            if loader is None:
                return environment
            (folder / loader.name).symlink_to(loader)
            return environment | {"LD_LIBRARY_PATH": str(folder)}
    return None


def take_picture(recording: Path, size: str, driver: Mapping[str, str]) -> bytes:
    """Return a PNG of the viewer with a recording, at its last time.

    Raises
    ------
    UnavailableError
        If the viewer does not start, or has not drawn within two minutes.
    """
    from rerun.experimental import ViewerClient

    port = free_port()
    command = [rerun_program(), str(recording), "--headless", "--window-size", size]
    viewer = subprocess.Popen(
        [*command, "--bind", "127.0.0.1", "--port", str(port)],
        env={**os.environ, **driver},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    end_s, shown_s, failure = time.monotonic() + _TIMEOUT_S, 0.0, "it does not answer"
    try:
        while time.monotonic() < end_s and viewer.poll() is None:
            try:
                client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
                if client.get_state().views:
                    shown_s = shown_s or time.monotonic()
                    if time.monotonic() - shown_s > _NOTICES_S:
                        return client.take_screenshot()
            except (RuntimeError, ConnectionError, TimeoutError, ValueError) as error:
                failure = str(error)
            time.sleep(0.5)
    finally:
        viewer.kill()
        viewer.wait()
    raise UnavailableError(f"no picture of the viewer within {_TIMEOUT_S:.0f} s: {failure}")


def with_palette(png: bytes) -> bytes:
    """Return a picture with 256 colours, a third of its size."""
    out = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(256).save(out, format="png", optimize=True)
    return out.getvalue()


def main() -> int:
    """Draw the logs of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", metavar="PATH", help="logs and options of cdff view")
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help="PNG")
    parser.add_argument("--size", default="640x400", help="width and height, pixels")
    args, options = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        driver = software_vulkan(Path(folder))
        if driver is None:
            print("SKIPPED: no software Vulkan: apt-get install mesa-vulkan-drivers")
            return 0
        recording = Path(folder) / "scene.rrd"
        view = [
            sys.executable,
            "-m",
            "cdff_common.cli",
            "view",
            *args.logs,
            *options,
            "--save",
            str(recording),
        ]
        subprocess.run(view, check=True)
        args.out.write_bytes(with_palette(take_picture(recording, args.size, driver)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
