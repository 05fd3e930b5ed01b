# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of the viewer in the documentation: ``python scripts/documentation_pictures.py [--update]``.

``make site``, and with it CI, draws them again without a display into ``build/pictures``, compares them with
those in ``docs/images``, and puts them into the site; this file is a hook of MkDocs for that. A picture whose
data, viewer or driver is missing here is named, and the committed one stays. ``--update`` commits them.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
IMAGES, DRAWN = ROOT / "docs" / "images", ROOT / "build" / "pictures"
_SIZE = "1000x560"
#: Number of cells of a picture that are compared, and largest mean difference of their colours (of 255): a
#: space of the viewer without its content differs by about 20.
_CELLS, _LARGEST_DIFFERENCE = (50, 28), 6.0
#: Pairs of KITTI whose elevation map is drawn.
_PAIRS = 14


def rover(folder: Path) -> list[str]:
    """Simulate a rover, estimate its path by its lidar, and return the arguments of the viewer."""
    from cdff_dev.simulate.scenario import Scenario, load_scenario
    from cdff_dev.simulate.store import make_log

    full = load_scenario("rover_traverse").model_dump()
    full |= {"duration_s": 12.0, "robots": {"mana": full["robots"]["mana"]}}
    full["navcam"] |= {"rows": 240, "columns": 320, "focal_px": 240.0, "rate_hz": 2.0}
    make_log(Scenario.model_validate(full), folder / "rover", workers=1)
    _cdff("slam", str(folder / "rover"), "--out", str(folder / "run"))
    return [str(folder / "rover"), str(folder / "run")]


def slam(folder: Path) -> list[str]:
    """Estimate the path of a lidar of KITTI."""
    scans = _data("kitti_velodyne")
    _cdff("slam", str(scans), "--out", str(folder / "run"))
    return [str(scans), str(folder / "run")]


def stereo(folder: Path) -> list[str]:
    """Make an elevation map of the first stereo pairs of KITTI, and return the arguments of the viewer."""
    source, pairs = _data("kitti_stereo/KITTI_sequence_1"), folder / "kitti"
    for side in ("image_l_kitti", "image_r_kitti"):
        (pairs / side).mkdir(parents=True)
        for image in sorted((source / side).iterdir())[:_PAIRS]:
            shutil.copy(image, pairs / side)
    for name in ("calib_kitti.txt", "poses.txt"):
        shutil.copy(source / name, pairs)
    _cdff("dem", str(pairs), "--resolution-m", "0.2", "--out", str(folder / "run"))
    return [str(pairs), str(folder / "run"), "--derive", "disparity", "--derive", "features"]


PICTURES: dict[str, Callable[[Path], list[str]]] = {
    "viewer_rover.png": rover,
    "viewer_slam.png": slam,
    "viewer_stereo.png": stereo,
}


def difference(first: bytes, second: bytes) -> float:
    """Return the mean difference of the colours of two pictures in coarse cells, of 255."""
    cells = [
        np.asarray(Image.open(io.BytesIO(png)).convert("RGB").resize(_CELLS, Image.Resampling.BOX), float)
        for png in (first, second)
    ]
    return float(np.abs(cells[0] - cells[1]).mean())


def draw(name: str, driver: dict[str, str]) -> bytes:
    """Return a picture; raises FileNotFoundError without its data."""
    from scripts.viewer_picture import take_picture, with_palette

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        recording = folder / "scene.rrd"
        _cdff("view", *PICTURES[name](folder), "--save", str(recording))
        return with_palette(take_picture(recording, _SIZE, driver))


def on_post_build(config: Any, **_: Any) -> None:
    """Put the pictures that were drawn into the site; called by MkDocs."""
    for picture in DRAWN.glob("*.png"):
        shutil.copy(picture, Path(config["site_dir"]) / "images")


def _cdff(*words: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "cdff_common.cli", "-q", *words], check=True, stdout=subprocess.DEVNULL
    )


def _data(name: str) -> Path:
    path = Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared" / "data") / name
    if not path.exists():
        raise FileNotFoundError(f"{name} is not in CDFF_DATA")
    return path


def main() -> int:
    """Draw all pictures; exit code 1 if one differs from that of the documentation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"default: {', '.join(PICTURES)}")
    parser.add_argument("--update", action="store_true", help="replace those in docs/images")
    args = parser.parse_args()
    from cdff_common.errors import UnavailableError
    from scripts.viewer_picture import software_vulkan

    shutil.rmtree(DRAWN, ignore_errors=True)
    DRAWN.mkdir(parents=True)
    different = 0
    with tempfile.TemporaryDirectory() as folder:
        try:
            import rerun  # noqa: F401

            driver = software_vulkan(Path(folder))
        except ImportError:
            driver = None
        if driver is None:
            print("pictures: not drawn: no viewer or no software Vulkan (make peers)")
            return 0
        for name in args.names or PICTURES:
            try:
                png = draw(name, driver)
            except (FileNotFoundError, UnavailableError) as error:
                # Without the data, or with a viewer that is too slow here.
                print(f"pictures: {name} not drawn: {error}")
                continue
            (DRAWN / name).write_bytes(png)
            committed = IMAGES / name
            if args.update:
                committed.write_bytes(png)
            change = difference(png, committed.read_bytes()) if committed.is_file() else 255.0
            print(f"pictures: {name} drawn, differs by {change:.1f} of 255 from that of the documentation")
            if change > _LARGEST_DIFFERENCE:
                print(f"pictures: {name}: look at build/pictures/{name}, then --update", file=sys.stderr)
                different += 1
    return min(different, 1)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
