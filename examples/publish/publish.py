"""Make a data set that can be published: one course in several waters, packed, with its card, Croissant and checksums.

    python examples/publish/publish.py sample -o sample            # what `make sample` does: minutes on two cores
    python examples/publish/publish.py reference -o reference      # 200 stereo frames in five waters, for a GPU
    python examples/publish/publish.py reference -o reference --dry-run

Upload the files of OUT/upload. An interrupted run goes on with the same command.
"""

import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml
from card import write_card
from croissant import valid, write_croissant
from facts import LICENCES, Facts
from pack import pack, write_index, write_sums

from varos_warp.dataset import files
from varos_warp.dataset.validate.outcome import KEPT
from varos_warp.dataset.write.checksums import NAME as CHECKSUMS
from varos_warp.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
WATERS = ROOT / "examples" / "sweeps" / "waters.yaml"
TEMPLATE = "stereo_survey"
PAIR = "[A,B,C,D,S,F]"


def sizes(width: int, height: int) -> list[str]:
    """Settings that give both cameras a resolution."""
    return [f"vehicle.cameras.{i}.resolution=[{width},{height}]" for i in range(2)]


KINDS = {
    "reference": {
        "waters": ["clear", "IB", "II", "coast", "harbour"],
        "most_bytes": 20e9,
        "set": [
            *sizes(960, 640),
            f"render.outputs={PAIR}",
            "render.frame_rate_hz=5",
            "trajectory.duration_s=40",
            "render.integrator=auto",
            "render.spp=null",
            "render.max_triangles=4000000",
        ],
    },
    "sample": {
        "waters": ["IB", "II", "coast"],
        "most_bytes": 50e6,
        "set": [
            *sizes(192, 128),
            f"render.outputs={PAIR}",
            "render.frame_rate_hz=5",
            "trajectory.duration_s=1.6",
            "render.max_triangles=200000",
        ],
    },
}
"""What is made: the waters, versions of examples/sweeps/waters.yaml; what changes in the template; the most bytes."""
MADE_BY = "made_by.json"
"""What a folder is made of; the first file in it."""
OURS = {MADE_BY, "scene.yaml", "varos-warp.schema.json", "waters.yaml", "datasets", "upload", ".upload"}
"""All that lies in the folder of a publication."""
UPLOADED = re.compile(
    r"README\.md|SHA256SUMS|contact_sheet\.png|croissant\.json|frames\.csv|varos_warp-\w+-[\w.+]+\.tar"
)
"""Names of what lies in its folder `upload`."""


def main(argv: list[str] | None = None) -> int:
    """The command; returns the exit status."""
    asked = arguments(argv)
    try:
        make(asked)
    except InputError as error:
        print(f"publish: {error.message}", file=sys.stderr)
        return 2
    except subprocess.CalledProcessError as error:  # the command has said why
        return error.returncode
    except KeyboardInterrupt:
        return 130
    return 0


def arguments(argv: list[str] | None) -> argparse.Namespace:
    """What is asked for."""
    parser = argparse.ArgumentParser(prog="publish.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("-o", "--out", type=Path, required=True, help="new folder, or one that this command made")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the scene, as for `run`")
    parser.add_argument("--frames", metavar="A:B", help="only these frames, as for `run`")
    parser.add_argument("--waters", type=lambda text: text.split(","), metavar="A,B", help="only these waters")
    parser.add_argument("--licence", default="cc-by-4.0", choices=LICENCES)
    parser.add_argument("--url", help="where the data set will be found, for Croissant")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--dry-run", action="store_true", help="only tell how large it gets, and roughly how long")
    return parser.parse_args(argv)


def make(asked: argparse.Namespace) -> None:
    """Make the data set and what goes with it.

    Raises:
        InputError: If the folder holds something else, or if it would get too large; nothing is made then.
        subprocess.CalledProcessError: If a command of varos-warp failed.
    """
    settings = describe(asked)
    check_folder(asked.out, settings)
    if asked.dry_run or not (asked.out / MADE_BY).exists():  # what was begun has been told, and takes its place already
        with tempfile.TemporaryDirectory() as scratch:
            place = Path(scratch)
            prepare(place, settings)
            estimate(place, asked, settings)
    if asked.dry_run:
        return
    files.write_json(asked.out / MADE_BY, settings)
    if not (asked.out / "waters.yaml").exists():
        prepare(asked.out, settings)
    call(
        "sweep",
        asked.out / "scene.yaml",
        "-o",
        asked.out / "datasets",
        "--over",
        asked.out / "waters.yaml",
        *options(settings),
        "--device",
        asked.device,
    )
    for root in (asked.out / "datasets" / water for water in settings["waters"]):
        if not is_validated(root):
            call("validate", root, "--quiet", output=False)
    upload(asked, settings)


def is_validated(root: Path) -> bool:
    """Whether the last check found nothing, and came after the last run; what changes later, `pack` sees."""
    outcome = root / KEPT
    if not outcome.exists() or outcome.stat().st_mtime_ns <= (root / CHECKSUMS).stat().st_mtime_ns:
        return False
    return json.loads(outcome.read_text(encoding="utf-8"))["valid"]


def describe(asked: argparse.Namespace) -> dict:
    """What a folder is made of, so that it is not mixed with something else.

    Raises:
        InputError: If there is no such water.
    """
    kind = KINDS[asked.kind]
    waters = asked.waters or kind["waters"]
    known = yaml.safe_load(WATERS.read_text(encoding="utf-8"))["versions"]
    for water in waters:
        if water not in known:
            raise InputError(
                "there is no such water",
                file=WATERS,
                key="--waters",
                value=water,
                remedy=f"There are: {', '.join(known)}.",
            )
    return {
        "format": "varos_warp publication",
        "kind": asked.kind,
        "waters": waters,
        "set": [*kind["set"], *asked.set],
        "frames": asked.frames,
    }


def check_folder(out: Path, settings: dict) -> None:
    """Refuse a folder that holds something else.

    Raises:
        InputError: Naming the first thing that is not of this publication.
    """
    remedy = "Give a new folder with -o."
    if out.exists() and not out.is_dir():
        raise InputError("is a file", key="--out", value=str(out), remedy=remedy)
    there = sorted(path.name for path in out.iterdir()) if out.exists() else []
    if not there:
        return
    if MADE_BY not in there:
        raise InputError("the folder is not empty and holds no publication", file=out, remedy=remedy)
    try:
        before = json.loads((out / MADE_BY).read_text(encoding="utf-8"))
    except ValueError:
        before = None
    if not isinstance(before, dict):
        raise InputError("cannot be read", file=out / MADE_BY, remedy=remedy)
    for key, value in settings.items():
        if before.get(key) != value:
            raise InputError(
                f"is {value!r} here, and was {before.get(key)!r} when the folder was begun",
                file=out,
                key=key,
                remedy=f"Ask for the same again. {remedy}",
            )
    uploaded = (out / "upload").iterdir() if (out / "upload").is_dir() else ()
    foreign = [
        *(out / name for name in there if name not in OURS),
        *(path for path in uploaded if not UPLOADED.fullmatch(path.name)),
    ]
    if foreign:
        raise InputError("is nothing of a publication", file=foreign[0], remedy=f"Move it away. {remedy}")


def prepare(place: Path, settings: dict) -> None:
    """Write the scene and its waters into a folder."""
    for name in ("scene.yaml", "varos-warp.schema.json"):
        (place / name).unlink(missing_ok=True)  # of a run that was interrupted here
    call("init", place / "scene.yaml", "--template", TEMPLATE, output=False)
    known = yaml.safe_load(WATERS.read_text(encoding="utf-8"))["versions"]
    chosen = {"versions": {water: known[water] for water in settings["waters"]}}
    (place / "waters.yaml").write_text(yaml.safe_dump(chosen, sort_keys=False), encoding="utf-8")


def options(settings: dict) -> list[str]:
    """Of `varos-warp sweep`."""
    chosen = [part for change in settings["set"] for part in ("--set", change)]
    return [*chosen, *(["--frames", settings["frames"]] if settings["frames"] else [])]


def estimate(place: Path, asked: argparse.Namespace, settings: dict) -> None:
    """Tell how large the data set gets and how long that takes, of everything, before anything of it is made.

    Raises:
        InputError: If it is more than the limit, or than the disk holds.
    """
    plan = told(
        "sweep",
        place / "scene.yaml",
        "-o",
        place / "datasets",
        "--over",
        place / "waters.yaml",
        *options(settings),
        "--dry-run",
        "--json",
        "--quiet",
    )["datasets"]
    kinds = {tuple(entry["renders"]) for entry in plan if entry["renders"]}
    each = {letters: bytes_of_image(place, settings, letters) for letters in kinds}
    total = sum(entry["images"] * each.get(tuple(entry["renders"]), 0.0) for entry in plan)
    hours, limit = sum(entry["seconds"] for entry in plan) / 3600, KINDS[asked.kind]["most_bytes"]
    print(
        f"{asked.kind}: about {total / 1e6:.4g} MB in {len(plan)} waters (at most {limit / 1e6:g} MB), "
        f"roughly {hours:.2g} hours on this machine",
        flush=True,
    )
    if total > limit:
        raise InputError(
            f"would take about {total / 1e6:.4g} MB, more than {limit / 1e6:g} MB",
            key=asked.kind,
            remedy="Choose fewer --frames or --waters, or a smaller resolution.",
        )
    free = shutil.disk_usage(next(folder for folder in asked.out.absolute().parents if folder.exists())).free
    if 2 * total > free:
        raise InputError(
            f"takes about {2 * total / 1e6:.4g} MB beside each other, files and archive; {free / 1e6:.4g} MB are free",
            key="--out",
            value=str(asked.out),
            remedy="Choose another disk.",
        )


def bytes_of_image(place: Path, settings: dict, letters: tuple[str, ...]) -> float:
    """What an image takes in the mean, of these types."""
    changes = [*settings["set"], f"render.outputs=[{','.join(letters)}]"]
    set_ = [part for change in changes for part in ("--set", change)]
    about = told("info", place / "scene.yaml", *set_, "--json", "--quiet")["dataset"]
    return about["bytes"] / about["images"]


def upload(asked: argparse.Namespace, settings: dict) -> None:
    """Write what is published, of what stands in the datasets; it gets its name when it is whole.

    Raises:
        InputError: If the archive is larger than the limit, or the metadata are not valid.
    """
    place, part = asked.out / "upload", asked.out / ".upload"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    facts = Facts.of(
        asked.kind,
        [asked.out / "datasets" / water for water in settings["waters"]],
        ROOT,
        asked.licence,
        asked.url,
        command(settings),
    )
    archive = pack(facts, asked.out / "datasets" / "sweep.json", part)
    size, limit = archive.stat().st_size, KINDS[asked.kind]["most_bytes"]
    if size > limit:
        raise InputError(
            f"has {size / 1e6:.4g} MB, more than {limit / 1e6:g} MB",
            file=archive,
            remedy="Choose fewer --frames or --waters, or a smaller resolution, in a new folder.",
        )
    index = write_index(facts, part)
    shutil.copyfile(facts.datasets[0].root / "contact_sheet.png", part / "contact_sheet.png")
    metadata = write_croissant(facts, archive, index, part)
    judged = valid(metadata)
    write_card(facts, archive, index, part)
    write_sums(part)
    if place.exists():
        shutil.rmtree(place)  # nothing else is in it: check_folder has looked
    part.rename(place)
    print(
        f"{place}: {archive.name} of {size / 1e6:.4g} MB, README.md, {metadata.name} ({judged}), {index.name}, "
        "contact_sheet.png, SHA256SUMS"
    )


def command(settings: dict) -> str:
    """The command that makes the same."""
    kind = KINDS[settings["kind"]]
    words = [
        "python",
        "examples/publish/publish.py",
        settings["kind"],
        "-o",
        "OUT",
        *(word for change in settings["set"][len(kind["set"]) :] for word in ("--set", change)),
        *(["--frames", settings["frames"]] if settings["frames"] else []),
        *(["--waters", ",".join(settings["waters"])] if settings["waters"] != kind["waters"] else []),
    ]
    return shlex.join(words)


def call(*words, output: bool = True) -> None:
    """Run a verb of varos-warp; without ``output``, what it prints is shown only if it fails."""
    line = [sys.executable, "-m", "varos_warp", *map(str, words)]
    result = subprocess.run(line, stdout=None if output else subprocess.PIPE, text=True)
    if result.returncode and result.stdout:
        print(result.stdout, end="", file=sys.stderr)
    result.check_returncode()


def told(*words) -> dict:
    """What a verb of varos-warp prints with --json; its notes come when it is done in earnest."""
    line = [sys.executable, "-m", "varos_warp", *map(str, words)]
    result = subprocess.run(line, capture_output=True, text=True)
    if result.returncode:
        print(result.stderr, end="", file=sys.stderr)
        result.check_returncode()
    return json.loads(result.stdout)


if __name__ == "__main__":
    sys.exit(main())
