"""Arguments and options of the command line, and what their words mean."""

import json
import math
import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from varos_warp.errors import InputError
from varos_warp.files import require_file

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (YAML).")]
Folder = Annotated[Path, typer.Argument(metavar="DATASET", help="Folder that `varos-warp run` wrote to.")]
Out = Annotated[Path, typer.Option("-o", "--out", help="Folder of the dataset; completes what is there.")]
NewFolder = Annotated[Path, typer.Option("-o", "--out", help="Folder to make; it must not be there yet.")]
Device = Annotated[str, typer.Option(help="auto (a GPU if there is one), cpu or cuda:N.")]
Frames = Annotated[
    str | None, typer.Option(metavar="A:B:STEP", help="Only frames A to B - 1, every STEP-th; also A:B, A: or A.")
]
Seed = Annotated[int | None, typer.Option(help="Seed of every random choice, instead of the scene's.")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY.PATH=VALUE", help="Change a key of the scene for this call; repeatable."),
]
Shard = Annotated[str | None, typer.Option(metavar="I/N", help="Render every N-th frame, from frame I on; I from 0.")]
Workers = Annotated[int | None, typer.Option(metavar="N", help="Render in N processes of this host, one for each GPU.")]
Over = Annotated[
    list[str],
    typer.Option(
        "--over",
        metavar="FILE|KEY=VALUE,...",
        help="What versions differ in: a file, or a key with a value for each; repeatable, for all combinations.",
    ),
]
SweepOut = Annotated[
    Path, typer.Option("-o", "--out", help="Folder of the sweep, with one for each version; completes what is there.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Only tell what would be made, and about what that takes.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no notes.")]


Vehicle = Annotated[str | None, typer.Option(metavar="ID", help="Only this one of the scene's vehicles.")]


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What may be chosen for one call; what is absent is as the scene says."""

    device: Device = "auto"
    frames: Frames = None
    outputs: Annotated[str | None, typer.Option(metavar="A,B,C,D", help="Types of images to make.")] = None
    tolerance: Annotated[
        float | None, typer.Option(help="Relative error asked of A; the planner chooses the samples.")
    ] = None
    spp: Annotated[float | None, typer.Option(help="Samples per pixel of A, instead of a tolerance.")] = None
    max_scatterings: Annotated[int | None, typer.Option(help="Most scatterings in the water on a path of light.")] = (
        None
    )
    max_bounces: Annotated[int | None, typer.Option(help="Most reflections on surfaces on a path of light.")] = None
    layers: Annotated[
        str | None, typer.Option(metavar="LAYERS", help="Layers of A to render, of direct,single,multiple.")
    ] = None
    integrator: Annotated[
        str | None, typer.Option(metavar="NAME", help="How A is computed: auto, field, path or reference.")
    ] = None
    seed: Seed = None
    denoise: Annotated[str | None, typer.Option(metavar="NAME", help="Denoiser of A: oidn, nlm or none.")] = None
    vehicle: Vehicle = None
    linear_exr: Annotated[
        bool, typer.Option("--linear-exr", help="Also write A before denoising, with its standard error.")
    ] = False
    set_: Set = None

    def overrides(self) -> list[str | tuple[str, str]]:
        """The choices that change the scene, as `load_scene` takes them; ``--set`` first: others have the last word.

        Raises:
            InputError: If both a tolerance and a number of samples are given.
        """
        if self.tolerance is not None and self.spp is not None:
            raise InputError("cannot be given together", key="--tolerance and --spp", remedy="Give one of them.")
        changes = {
            "outputs": ("render.outputs", self.outputs and f"[{','.join(re.sub('[, ]', '', self.outputs))}]"),
            "tolerance": ("render.tolerance", self.tolerance),
            "spp": ("render.spp", self.spp),
            "max_scatterings": ("render.max_scatterings", self.max_scatterings),
            "max_bounces": ("render.max_bounces", self.max_bounces),
            "layers": ("render.layers", self.layers and f"[{self.layers}]"),
            "integrator": ("render.integrator", self.integrator),
            "seed": ("seed", self.seed),
            "denoise": ("render.denoise", self.denoise),
            "linear_exr": ("render.linear_exr", "true" if self.linear_exr else None),
        }
        planned = [] if self.tolerance is None else [("render.spp=null", f"--tolerance {_plain(self.tolerance)}")]
        return [
            *(self.set_ or ()),
            *observer(self.vehicle),
            *planned,
            *(
                (f"{key}={_plain(value)}", self._as_given(name))
                for name, (key, value) in changes.items()
                if value is not None
            ),
        ]

    def _as_given(self, name: str) -> str:
        """An option of the command line as the user may have written it."""
        value, option = getattr(self, name), f"--{name.replace('_', '-')}"
        return option if value is True else f"{option} {shlex.quote(_plain(value))}"


def _plain(value) -> str:
    """A number or a word without the decimals that it was not given with."""
    return str(value).removesuffix(".0")


def observer(vehicle: str | None) -> list[tuple[str, str]]:
    """What ``--vehicle`` changes in the scene, as `load_scene` takes it."""
    return [] if vehicle is None else [(f"observer={json.dumps(vehicle)}", f"--vehicle {shlex.quote(vehicle)}")]


@dataclass(frozen=True, kw_only=True)
class PreviewOptions:
    """What `preview` shows: the viewpoint, and how far it refines."""

    frame: Annotated[int | None, typer.Option(min=0, metavar="N", help="Which frame; the first by default.")] = None
    time: Annotated[float | None, typer.Option(metavar="S", help="Any time of the course in seconds instead.")] = None
    camera: Annotated[str | None, typer.Option(metavar="ID", help="Which camera; the first by default.")] = None
    width: Annotated[
        int, typer.Option(min=16, metavar="N", help="Width of the image in pixels; at most the camera's own.")
    ] = 320
    spp: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Refine up to this many samples per pixel; by default the scene's, or 64."
        ),
    ] = None

    def parsed(self) -> dict:
        """Fields of `Viewpoint`; refuses both a frame and a time."""
        if self.frame is not None and self.time is not None:
            raise InputError("cannot be given together", key="--frame and --time", remedy="Give one of them.")
        return {"frame": self.frame or 0, "time_s": self.time, "camera": self.camera, "width": self.width}


@dataclass(frozen=True, kw_only=True)
class Repair:
    """What `preprocess` does to meshes."""

    vertices: Annotated[int | None, typer.Option(min=4, metavar="N", help="Decimate to this many, skirt included.")] = (
        None
    )
    merge_tolerance: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            metavar="M",
            help="Merge vertices nearer than this, in metres; by default 1 mm, or a quarter of the "
            "median edge if that is less.",
        ),
    ] = None
    fill_holes: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="M", help="Fill holes up to this wide, in metres; by default ten median edges."),
    ] = None
    smooth: Annotated[
        int, typer.Option(min=0, max=1000, metavar="N", help="Rounds of smoothing, for rough surveys.")
    ] = 0
    shrinkwrap: Annotated[
        str,
        typer.Option(
            metavar="N|auto|none",
            help="Vertices along the longer side of the new surface that is wrapped around the "
            "model; auto: twice as fine as the model, within 16.6 million vertices.",
        ),
    ] = "auto"
    close: Annotated[
        str,
        typer.Option(
            metavar="skirt|solid|none", help="Close the outline of a wrapped sheet by a skirt, or by skirt and bottom."
        ),
    ] = "skirt"
    region: Annotated[
        str | None,
        typer.Option(metavar="XMIN,YMIN,XMAX,YMAX", help="Keep this part only, in the axes of the file [m]."),
    ] = None
    scale: Annotated[
        float, typer.Option(metavar="X", help="Multiply coordinates; 0.001 if they are in millimetres.")
    ] = 1.0
    up_axis: Annotated[str | None, typer.Option(metavar="x|y|z", help="Which axis of the files points up.")] = None
    survey: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="How survey files are read, such as positive=down: a key of a terrain of kind heights; repeatable.",
        ),
    ] = None

    def parsed(self) -> dict:
        """Arguments of `preprocess_meshes`; refuses one that is not what its help says."""
        if not (math.isfinite(self.scale) and self.scale > 0.0):
            raise InputError("is not above 0", key="--scale", value=self.scale, remedy="For example 0.001.")
        check_choice("--up-axis", self.up_axis, (None, "x", "y", "z"))
        check_choice("--close", self.close, ("skirt", "solid", "none"))
        return {
            "vertices": self.vertices,
            "merge_tolerance_m": self.merge_tolerance,
            "fill_holes_m": self.fill_holes,
            "smoothing_rounds": self.smooth,
            "shrinkwrap_resolution": parse_shrinkwrap(self.shrinkwrap),
            "close": self.close,
            "region": parse_region(self.region),
            "scale": self.scale,
            "up_axis": self.up_axis,
            "survey": parse_keys("--survey", self.survey or []),
        }


def parse_keys(option: str, given: list[str]) -> dict:
    """Return what options ``KEY=VALUE`` give as one block; the values are YAML."""
    import yaml

    from varos_warp.scene import plain_yaml

    found = {}
    for text in given:
        key, equals, value = text.partition("=")
        try:
            found[key.strip()] = plain_yaml.parse(value)
        except (yaml.YAMLError, ValueError, RecursionError):
            equals = ""
        if not equals or not key.strip():
            raise InputError(
                "is not of the form KEY=VALUE", key=option, value=text, remedy="For example positive=down."
            )
    return found


REPAIR_KEYS = {
    "region": "--region",
    "merge_tolerance_m": "--merge-tolerance",
    "fill_holes_m": "--fill-holes",
    "smoothing_rounds": "--smooth",
    "shrinkwrap_resolution": "--shrinkwrap",
    "close": "--close",
    "target_vertices": "--vertices",
    "up_axis": "--up-axis",
}
"""What `preprocess` calls the keys of ``terrain.preprocess``, as its messages have them."""


def check_meshes(meshes: list[Path], out: Path) -> None:
    """Refuse meshes that are not there, and a result that is no PLY file or would take the place of one of them.

    Raises:
        InputError: Before anything is read.
    """
    for mesh in meshes:
        require_file(mesh, "mesh file", "Give the path of a mesh file.", "MESH")
    if out.suffix.lower() != ".ply":
        raise InputError(
            "is no name of a PLY file, and only those are written",
            key="--out",
            value=str(out),
            remedy=f"Such as {out.stem or 'mesh'}.ply.",
        )
    if out.is_dir() or any(out.resolve() == mesh.resolve() for mesh in meshes):
        raise InputError(
            "is a folder" if out.is_dir() else "is one of the meshes",
            key="--out",
            value=str(out),
            remedy="Name another file.",
        )


def with_options(error: InputError) -> InputError:
    """An error of `preprocess_meshes` in the words of the command line."""
    block, _, key = (error.key or "").partition(".")
    if block != "preprocess":
        return error
    remedy = error.remedy
    for name, option in REPAIR_KEYS.items():
        remedy = remedy.replace(name, option) if remedy and "_" in name else remedy
    return error.but(key=REPAIR_KEYS.get(key.partition(".")[0], error.key), remedy=remedy)


def parse_frames(text: str | None) -> slice:
    """``A:B:STEP``, ``A:B``, ``A:``, ``:B`` or ``A`` as a slice of the frames."""
    try:
        numbers = [int(number) if number.strip() else None for number in (text or ":").split(":")]
        if len(numbers) == 1:
            numbers.append(numbers[0] + 1)
        chosen = slice(*numbers)
        if len(numbers) > 3 or any(number is not None and number < 0 for number in numbers) or chosen.step == 0:
            raise ValueError
    except (ValueError, TypeError):
        raise InputError(
            "is not A:B or A:B:STEP", key="--frames", value=text, remedy="For example 0:10, 50:, 7 or 0:1000:10."
        ) from None
    return chosen


def parse_shard(text: str | None) -> tuple[int, int]:
    """``I/N`` with 0 <= I < N."""
    try:
        index, count = (int(part) for part in (text or "0/1").split("/"))
        if not 0 <= index < count:
            raise ValueError
    except ValueError:
        raise InputError(
            "is not I/N with I from 0 to N - 1",
            key="--shard",
            value=text,
            remedy="For example 0/4, 1/4, 2/4 and 3/4 on four machines.",
        ) from None
    return index, count


def parse_region(text: str | None) -> tuple[float, float, float, float] | None:
    """Four numbers with commas."""
    if not text:
        return None
    try:
        xmin, ymin, xmax, ymax = (float(part) for part in text.split(","))
        if not -math.inf < xmin < xmax < math.inf or not -math.inf < ymin < ymax < math.inf:
            raise ValueError
    except ValueError:
        raise InputError(
            "is not XMIN,YMIN,XMAX,YMAX with the lower end first",
            key="--region",
            value=text,
            remedy="For example -5,-5,5,5.",
        ) from None
    return xmin, ymin, xmax, ymax


def parse_shrinkwrap(text: str) -> int | str | None:
    """A number of vertices, ``auto`` or ``none``."""
    if text in ("auto", "none"):
        return None if text == "none" else text
    if not (text.isdecimal() and int(text) >= 2):
        raise InputError(
            "is not a number of vertices, at least 2",
            key="--shrinkwrap",
            value=text,
            remedy="For example 1024, auto or none.",
        )
    return int(text)


def check_choice(key: str, value, known: tuple) -> None:
    """Refuse what is none of the known words."""
    if value not in known:
        raise InputError("is unknown", key=key, value=value, remedy=f"Use one of {', '.join(filter(None, known))}.")
