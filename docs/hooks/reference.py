"""Pages that are made from the package: the keys of scene files, the command line, the Python API, the dataset."""

import html
import inspect
import re
import tempfile
from pathlib import Path

import typer

import varos_warp
from varos_warp.cli import app
from varos_warp.dataset.layout import Layout
from varos_warp.dataset.write.texts import write_readme
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.file.schema import KIND_KEYS, blocks_in, entries, facts, find_key, json_schema, kind_of, names_in

ROOT = Path(__file__).parents[2]
PAGES_OF_KEYS = (
    "terrain",
    "objects",
    "scatter",
    "growth",
    "particles",
    "materials",
    "water",
    "current",
    "vehicle",
    "vehicle.lights",
    "vehicle.cameras",
    "trajectory",
    "vehicles",
    "render",
)
"""Keys of scene files with a page of their own."""
AS_ELSEWHERE = {"trajectory": "trajectory", "body": "objects"}
"""Pages of the blocks under ``vehicles``; those of all others are under ``vehicle``."""
FRAME_TYPES = (
    "render.image.frame.Frame",
    "products.images.radiance.RadianceImage",
    "products.images.normals.NormalImage",
    "products.images.depth.DepthImage",
    "products.images.segments.SegmentImage",
    "products.images.flow.FlowImage",
    "products.images.transmittance.TransmittanceImage",
    "products.images.snow.Snow",
)
EXAMPLES = ("varos_warp/data/starter.yaml", "varos_warp/data/templates/*.yaml", "examples/*/*.yaml")


def cell(text: str) -> str:
    """Text for a table: one line, with code as Markdown has it, and links to the pages that it names."""
    text = re.sub(r"\bdocs/(\w+)\.md", r"[\1](docs/\1.md)", text.replace("``", "`").replace("|", "\\|"))
    return " ".join(text.split())


def code(text: str) -> str:
    """Code for a table: of a pipe, Markdown within backticks would show the backslash."""
    if "|" in text:
        return f"<code>{html.escape(text).replace('|', '&#124;')}</code>"
    return f"`{text}`" if text else ""


def table(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


# ------------------------------------------------------------------------------------------------------- scene files


def scene_pages() -> dict[str, str]:
    """Pages ``scene/....md`` with every key of scene files, and ``scene/index.md``."""
    root = json_schema()
    tops = [
        [f"[`{key}`](docs/scene/{key}.md)" if key in PAGES_OF_KEYS else f"`{key}`", *columns(entry)[1:]]
        for key in root["properties"]
        for entry in find_key(key)
    ]
    index = (
        "# Scene file: every key\n\nMade from the JSON Schema (`varos-warp schema`); `varos-warp schema KEY` says "
        "the same of one key. Unknown keys are errors. Units: SI, angles in degrees in keys that end in `_deg`. "
        "`absent` means: nothing, or what the key says.\n\n" + table(HEADER, tops)
    )
    pages = {key: f"# `{key}`\n\n{own_words(key)}\n\n" + "\n".join(sections(key, key)) for key in PAGES_OF_KEYS}
    return {"scene/index.md": index, **{f"scene/{key}.md": text for key, text in pages.items()}}


HEADER = ["key", "meaning", "value", "unit", "default", "example"]


def own_words(key: str) -> str:
    return "\n\n".join(dict.fromkeys(cell(entry.schema["description"]) for entry in find_key(key)))


def columns(entry) -> list[str]:
    """A row of a table of keys."""
    told = facts(entry)
    value, form, pattern = told["value"].partition(" of the form ")
    return [
        f"`{entry.key}`",
        cell(entry.schema["description"]),
        cell(value) + form + code(pattern),
        cell(told["unit"]),
        code(told["default"]),
        code(told["example"]),
    ]


def sections(key: str, page: str) -> list[str]:
    """What may stand under a key: a section for each kind of block, and for the keys that all kinds have."""
    blocks = [block for entry in find_key(key) for block in blocks_in(entry.schema, json_schema())]
    blocks = list({block["title"]: block for block in blocks}.values())
    shared = [
        name
        for name in blocks[0]["properties"]
        if name not in KIND_KEYS
        and len(blocks) > 2
        and all(name in block["properties"] for block in blocks)
        and len(entries(name, blocks)) == 1
    ]
    parts = [section(f"`{key}`, all kinds", "", [blocks[0]], shared)] if shared else []
    for block in blocks:
        kind = kind_of(block)
        names = [name for name in names_in(block) if name not in shared and not (kind and name in KIND_KEYS)]
        title = f"`{key}`: `{kind}`" if kind else f"Keys of `{key}`"
        parts.append(section(title, block["description"], [block], names))
    inner = dict.fromkeys(
        name
        for block in blocks
        for name, schema in block["properties"].items()
        if any(blocks_in(schema, json_schema()))
    )
    elsewhere = {}
    for name in inner:
        path = f"{key}.{name}"
        if path in PAGES_OF_KEYS or key == "vehicles":
            alike = path if path in PAGES_OF_KEYS else f"vehicle.{name}"
            elsewhere[path] = alike if alike in PAGES_OF_KEYS else AS_ELSEWHERE.get(name, "vehicle")
        else:
            parts += sections(path, page)
    if elsewhere:
        links = ", ".join(f"[`{path}`](docs/scene/{there}.md)" for path, there in elsewhere.items())
        parts.append(f"## On other pages\n\n{links}.\n")
    return parts


def section(title: str, text: str, blocks: list[dict], names: list[str]) -> str:
    rows = [columns(entry) for name in names for entry in entries(name, blocks)]
    words = cell(text)
    return f"## {title}\n\n{words}\n\n" + (table(HEADER, rows) if rows else "It has no keys.\n")


# ------------------------------------------------------------------------------------------- command line and Python


def cli_page() -> str:
    """Every verb of ``varos-warp`` with its arguments and options."""
    group = typer.main.get_command(app)
    return (
        "# Command line\n\nMade from the program; `varos-warp VERB --help` says the same. Exit status: 0 done; 2 "
        "bad input or an invalid dataset, with one message; 1 a failure of our own; 130 interrupted. "
        "`varos-warp --install-completion` sets up completion in your shell.\n\n"
        + "\n".join(verb_section(name, command) for name, command in sorted(group.commands.items()))
    )


def verb_section(name: str, command) -> str:
    context = typer.Context(command)
    records = [param.get_help_record(context) for param in command.params]
    rows = [[code(words), cell(meaning)] for words, meaning in filter(None, records)]
    words = inspect.cleandoc(command.help or "")
    return f"## `varos-warp {name}`\n\n{words}\n\n" + table(["argument", "meaning"], rows)


def api_page() -> str:
    """Directives for mkdocstrings: the public names, and what a frame holds."""
    names = (
        "load_scene",
        "simulate",
        "Simulator",
        "Step",
        "plan_render",
        "FrameRenderer",
        "NextFrame",
        "Dataset",
        "phase_function",
        "InputError",
    )
    homes = [f"{varos_warp._HOMES[name]}.{name}" for name in names]
    frames = ["varos_warp.render.options.RenderOptions", *(f"varos_warp.{name}" for name in FRAME_TYPES)]
    found = [
        "varos_warp.sim.trajectory.Simulation",
        "varos_warp.sim.motion.Trajectory",
        "varos_warp.render.decisions.Plan",
    ]
    more = ["varos_warp.dataset.export.export", "varos_warp.scene.geometry.terrain.preprocess_meshes"]
    return (
        "# Python API\n\n`import varos_warp as vw` has the first of these names as `vw.load_scene` and so on; "
        "importing it compiles nothing. `vw.Scene` is the [scene file](docs/scene/index.md) as a pydantic model."
        "\n\n"
        "## Names of `varos_warp`\n\n"
        + "\n\n".join(f"::: {name}" for name in homes)
        + "\n\n## What render takes and returns\n\n"
        + "\n\n".join(f"::: {name}" for name in frames)
        + "\n\n## What a frame of a Dataset holds\n\n"
        "::: varos_warp.dataset.reader.frame.Frame\n\n## Samples of vehicle and sensors in a Dataset\n\n"
        "::: varos_warp.dataset.reader.readings.Readings\n\n## What simulate and plan_render return\n\n"
        + "\n\n".join(f"::: {name}" for name in found)
        + "\n\n## Functions of one task\n\n"
        + "\n\n".join(f"::: {name}" for name in more)
        + "\n"
    )


# ------------------------------------------------------------------------------------------------ datasets, examples


def dataset_page() -> str:
    """The README.txt of a dataset whose vehicle has every sensor, a section for each of its headings."""
    scene = load_scene(ROOT / "examples/every_block/scene.yaml")
    with tempfile.TemporaryDirectory() as folder:
        write_readme(Layout.of(scene, folder), scene, scene.render.outputs)
        text = (Path(folder) / "README.txt").read_text()
    page = [
        "# README.txt of a dataset",
        "",
        "Every dataset has this file, with the numbers of its own scene; here those of `examples/every_block`.",
        "",
    ]
    for line in text.splitlines():
        heading = line[:3].isupper() and not line.startswith(" ")
        page += ["", f"## {line}", ""] if heading else [f"    {line}"]
    return "\n".join(page) + "\n"


def examples_page() -> str:
    """The scene files that ship, in full."""
    page = ["# Scene files that ship", "", "Templates of `varos-warp init` and the scenes of `examples/`, in full.", ""]
    for path in (path for pattern in EXAMPLES for path in sorted(ROOT.glob(pattern))):
        page += [
            f"## {example_name(path)}",
            "",
            f"`{path.relative_to(ROOT).as_posix()}`",
            "",
            "```yaml",
            path.read_text(encoding="utf-8").rstrip(),
            "```",
            "",
        ]
    return "\n".join(page)


def example_name(path: Path) -> str:
    return path.parent.name if path.stem == "scene" else path.stem


def pages() -> dict[str, str]:
    """All of them, by their place in the site."""
    return {
        **scene_pages(),
        "cli.md": cli_page(),
        "api.md": api_page(),
        "dataset_readme.md": dataset_page(),
        "examples.md": examples_page(),
    }
