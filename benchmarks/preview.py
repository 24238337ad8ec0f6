"""How long a change takes to be seen: from the save of a scene file to the new image of `varos-warp preview`.

    python -m benchmarks.preview [SCENE] [--frame 15] [--width 320] [--rounds 3] [--device cpu]

Without SCENE that of `varos-warp init`. For each kind of change it prints the least of some rounds, in CPU-seconds of
all threads and in seconds that pass; ``start`` counts from the beginning of the process, where only the former are
known. The image has one sample per pixel.
"""

import argparse
import shutil
import tempfile
import time
from pathlib import Path

import yaml

from benchmarks.machine import machine
from varos_warp.dataset.preview import Viewpoint, preview
from varos_warp.device.devices import resolve_device
from varos_warp.scene.file.templates import template_text

JERLOV = ("IB", "II", "III", "1C", "3C")


def change(scene: dict, kind: str, number: int) -> None:
    """Change the data of a scene file a little; each number otherwise."""
    if kind == "light":
        scene["vehicle"]["lights"][0]["position"][0] += 0.01
    elif kind == "water":
        scene["water"] = {"jerlov": {"type": JERLOV[number % len(JERLOV)]}}
    elif kind == "course":
        scene["trajectory"]["waypoints"][0]["position"][2] += 0.01
    else:
        scene["objects"][0]["position"][2] += 0.01


class Editor:
    """A screen that saves a change as soon as it sees an image, and notes when the next one comes."""

    outputs = "A"

    def __init__(self, path: Path, kinds: list[str]):
        self.path, self.kinds, self.made = path, iter(kinds), "start"
        self.best: dict[str, tuple[float, ...]] = {}
        self.began, self.saves = (0.0,), 0

    def place(self, _view) -> None:
        """Nothing."""

    def tell(self, words: str) -> None:
        """A change that cannot be loaded is a mistake of this script."""
        raise RuntimeError(words)

    def show(self, _letter: str, _pixels) -> None:
        """Note the time, and make the next change."""
        taken = tuple(now - before for now, before in zip(_clocks(), self.began, strict=False))
        self.best[self.made] = tuple(map(min, taken, self.best.get(self.made, taken)))
        self.made = next(self.kinds, None)
        if self.made is None:
            raise KeyboardInterrupt
        scene = yaml.safe_load(self.path.read_text())
        change(scene, self.made, self.saves)
        self.saves += 1
        self.began = _clocks()
        self.path.write_text(yaml.safe_dump(scene))


def _clocks() -> tuple[float, float]:
    return time.process_time(), time.monotonic()


def main() -> None:
    """Print a line for each kind of change."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path)
    parser.add_argument("--frame", type=int, default=15)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--device", default="auto")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "scene", args.scene.name if args.scene else "scene.yaml")
        if args.scene:
            shutil.copytree(args.scene.parent, path.parent)
        else:
            path.parent.mkdir()
            path.write_text(template_text())
        editor = Editor(path, ["light", "water", "course", "object"] * args.rounds)
        try:
            preview(path, editor, Viewpoint(frame=args.frame, width=args.width), spp=1, device=args.device)
        except KeyboardInterrupt:
            pass
    print(machine(resolve_device(args.device)))
    for kind, (cpu, *seconds) in editor.best.items():
        print(f"{kind:8s} {cpu:6.2f} CPU-s", *(f"{passed:6.2f} s" for passed in seconds))


if __name__ == "__main__":
    main()
