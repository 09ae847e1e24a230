"""Make the pictures and the video of the pages from real runs: ``make docs-media``. Each is kept small."""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

MEDIA = Path(__file__).parent / "media"
NAVBENCH = str(Path(sys.executable).with_name("navbench"))
CONTROLLERS = (
    "sflc pid mixed oa_to oa_to_ga oa_to_printed multi_agent dual_layer dual_layer_symmetric go_to_goal".split()
)
COLORS, WIDTHS = 128, (900, 750, 600)  # of a picture: the first width in which it is small enough
LARGEST = 150_000  # bytes


def make() -> None:
    """Run what is shown, draw it, and keep the pictures."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "movers"
        words = ["controller=oa_to", "world=random_movers", "episodes=20", "simulator=planar", "record=ranges"]
        _navbench(*words, f"hydra.run.dir={run}")
        _draw("failure", str(run))
        _navbench("replay", str(run), "speed=1.25", "--video", str(MEDIA / "failure.mp4"))
    for name in CONTROLLERS:
        _draw(f"controllers/{name}", f"controller={name}")


def _draw(name: str, *words: str) -> None:
    file = MEDIA / f"{name}.png"
    file.parent.mkdir(parents=True, exist_ok=True)
    _navbench("show", *words, f"out={file}")
    with Image.open(file) as opened:
        picture = opened.convert("RGB")
    for width in WIDTHS:
        scaled = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
        scaled.quantize(COLORS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(file, optimize=True)
        if file.stat().st_size <= LARGEST:
            break


def _navbench(*words: str) -> None:
    subprocess.run([NAVBENCH, *words], check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    make()
