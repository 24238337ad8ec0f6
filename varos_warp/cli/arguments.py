"""Arguments and options of the command line, and what their words mean."""

from pathlib import Path
from typing import Annotated

import typer

from varos_warp.errors import InputError

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (YAML).")]
Folder = Annotated[Path, typer.Argument(metavar="DATASET", help="Folder that `varos-warp run` wrote to.")]
Out = Annotated[Path, typer.Option("-o", "--out", help="Folder of the dataset; completes what is there.")]
Device = Annotated[str, typer.Option(help="auto, cpu or cuda:N.")]
Frames = Annotated[str | None, typer.Option(metavar="A:B", help="Only frames A to B - 1; also A: or A.")]
Outputs = Annotated[str | None, typer.Option(metavar="A,B,C,D", help="Image types to make.")]
Tolerance = Annotated[float | None, typer.Option(help="Relative error asked of A; the planner chooses the samples.")]
Spp = Annotated[int | None, typer.Option(help="Samples per pixel of A, instead of a tolerance.")]
MaxScatterings = Annotated[int | None, typer.Option(help="Most scatterings in the water on a path of light.")]
MaxBounces = Annotated[int | None, typer.Option(help="Most reflections on surfaces on a path of light.")]
Layers = Annotated[str | None, typer.Option(metavar="direct,single,multiple", help="Parts of A to render.")]
Integrator = Annotated[str | None, typer.Option(metavar="auto|field|path|reference", help="How A is computed.")]
Seed = Annotated[int | None, typer.Option(help="Of every random choice.")]
Denoise = Annotated[str | None, typer.Option(metavar="oidn|nlm|none", help="Denoiser of A.")]
LinearExr = Annotated[bool, typer.Option("--linear-exr", help="Also write A as rendered, with its standard error.")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="Change the scene; repeatable.")]
Shard = Annotated[str | None, typer.Option(metavar="I/N", help="Render every N-th frame from the I-th, I from 0.")]
Workers = Annotated[int | None, typer.Option(metavar="N", help="Render in N processes of this host, one for each GPU.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no notes.")]


def overrides(set_=None, outputs=None, tolerance=None, spp=None, max_scatterings=None, max_bounces=None, layers=None,
              integrator=None, seed=None, denoise=None, linear_exr=False) -> list[str]:
    """The options that change a scene, as ``key.path=value``; they come after ``--set`` and so have the last word."""
    if tolerance is not None and spp is not None:
        raise InputError("cannot be given together", key="--tolerance and --spp", remedy="Give one of them.")
    changes = {"render.outputs": outputs and ",".join(outputs.replace(",", "")), "render.tolerance": tolerance,
               "render.spp": "null" if tolerance is not None else spp, "render.max_scatterings": max_scatterings,
               "render.max_bounces": max_bounces, "render.layers": layers, "render.integrator": integrator,
               "seed": seed, "render.denoise": denoise, "render.linear_exr": "true" if linear_exr else None}
    lists = ("render.outputs", "render.layers")
    return list(set_ or ()) + [f"{key}=[{value}]" if key in lists else f"{key}={value}"
                               for key, value in changes.items() if value is not None]


def split_names(text: str | None) -> list[str]:
    """Names between commas."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def parse_frames(text: str | None) -> slice:
    """``A:B``, ``A:``, ``:B`` or ``A`` as a slice of the frames."""
    try:
        ends = [int(end) if end.strip() else None for end in (text or ":").split(":")]
        if len(ends) == 1:
            ends.append(ends[0] + 1)
        first, last = ends
        if any(end is not None and end < 0 for end in ends):
            raise ValueError
    except (ValueError, TypeError):
        raise InputError("is not A:B", key="--frames", value=text, remedy="For example 0:10, 50: or 7.") from None
    return slice(first, last)


def parse_shard(text: str | None) -> tuple[int, int]:
    """``I/N`` with 0 <= I < N."""
    try:
        index, count = (int(part) for part in (text or "0/1").split("/"))
        if not 0 <= index < count:
            raise ValueError
    except ValueError:
        raise InputError("is not I/N with I from 0 to N - 1", key="--shard", value=text,
                         remedy="For example 0/4, 1/4, 2/4 and 3/4 on four machines.") from None
    return index, count


def parse_region(text: str | None) -> tuple[float, float, float, float] | None:
    """Four numbers with commas."""
    try:
        values = tuple(float(part) for part in text.split(",")) if text else None
        if values is not None and len(values) != 4:
            raise ValueError
    except ValueError:
        raise InputError("is not XMIN,YMIN,XMAX,YMAX", key="--region", value=text) from None
    return values


def parse_shrinkwrap(text: str) -> int | str | None:
    """A number of vertices, ``auto`` or ``none``."""
    if text in ("auto", "none"):
        return None if text == "none" else text
    if not (text.isdecimal() and int(text) >= 2):
        raise InputError("is not a number of vertices, at least 2", key="--shrinkwrap", value=text,
                         remedy="For example 1024, auto or none.")
    return int(text)


def check_choice(key: str, value, known: tuple) -> None:
    """Refuse what is none of the known words.

    Raises:
        InputError: If it is none.
    """
    if value not in known:
        raise InputError("is unknown", key=key, value=value, remedy=f"Use one of {', '.join(filter(None, known))}.")
