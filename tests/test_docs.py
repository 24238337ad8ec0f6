"""Documents name what is there: links lead somewhere, CONTRIBUTING names files, the reference has every key."""

import importlib.util
import re
from pathlib import Path

import pytest

from varos_warp.cli import app
from varos_warp.scene.file.schema import KIND_KEYS, json_schema, kind_of, names_in

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "benchmarks").rglob("*.md")]


def anchor(heading: str) -> str:
    """As GitHub makes it of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)\s]+)\)", page.read_text(encoding="utf-8")):
        name, _, part = target.partition("#")
        path = page.parent / name if name else page
        assert path.exists(), target
        if part:
            headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            assert part in map(anchor, headings), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_no_line_of_a_sentence_is_taken_for_an_item_of_a_list(page):
    """One that begins with a number and a full stop; items of a list are numbered from 1."""
    last, text = 0, page.read_text(encoding="utf-8")
    for line in re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL).splitlines():
        if number := re.match(r"\s*(\d+)[.)]\s", line):
            assert int(number[1]) in (1, last + 1), line
            last = int(number[1])


def test_contributing_names_files_and_functions_that_exist():
    """Of a row of its table each name in code is a path of the repository or the package, or stands in one it names."""
    rows = [row for row in (ROOT / "CONTRIBUTING.md").read_text().splitlines() if row.startswith("| ")][1:]
    assert len(rows) > 8
    for row in rows:
        names = [name for name in re.findall(r"`([^`]+)`", row) if not name.startswith("varos-warp ")]
        found = {
            name: place
            for name in names
            if "/" in name or name.endswith((".py", ".md"))
            for place in (ROOT / name, ROOT / "varos_warp" / name, *(ROOT / "varos_warp").rglob(name))
            if place.exists()
        }
        texts = "".join(
            path.read_text()
            for place in found.values()
            for path in (place.rglob("*.py") if place.is_dir() else [place])
        )
        for name in names:
            assert name in found or re.search(rf"\b{re.escape(name.split('(')[0].lstrip('@'))}\b", texts), (name, row)


@pytest.fixture(scope="module")
def reference():
    """The module that makes pages of the site from the package."""
    spec = importlib.util.spec_from_file_location("docs_reference", ROOT / "docs/hooks/reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_reference_has_every_key_of_every_block(reference):
    """In a row of a table, with its meaning; of `water.phase` and its mixtures too, which stand in each other."""
    text = "\n".join(reference.scene_pages().values())
    for name, block in {"Scene": json_schema(), **json_schema()["$defs"]}.items():
        for key in names_in(block):
            schema = block["properties"][key]
            meaning = reference.cell(schema["description"])
            assert (
                f"`{key}` | {meaning} |" in text
                or f"[`{key}`](docs/scene/{key}.md) | {meaning} |" in text
                or (key in KIND_KEYS and f"`: `{kind_of(block)}`" in text)
            ), (name, key)


def test_the_reference_has_every_verb_with_its_options(reference):
    page = reference.cli_page()
    for verb in app.registered_commands:
        assert f"## `varos-warp {verb.name or verb.callback.__name__}`" in page
    assert "`--spp <" in page
    assert "Samples per pixel of A, instead of a tolerance." in page


def test_the_nav_of_the_site_names_pages_that_exist(reference):
    """`*` stands for those that it does not name."""
    made = {*reference.pages(), "index.md", "contributing.md", "changelog.md", "peers.md"}
    for page in re.findall(r"- ([\w./]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE):
        assert page in made or (ROOT / "docs" / page).exists(), page


def test_architecture_names_every_room_and_files_that_exist():
    """Of a row of its table the room is a package, and what to read first lies in it."""
    rows = re.findall(r"^\| `(\w+)/` \| .* \| (.*) \|$", (ROOT / "docs/architecture.md").read_text(), re.MULTILINE)
    assert {room for room, _ in rows} == {path.parent.name for path in (ROOT / "varos_warp").glob("*/__init__.py")}
    for room, reading in rows:
        names = re.findall(r"`([^`]+)`", reading)
        assert names
        assert all((ROOT / "varos_warp" / room / name).is_file() for name in names), (room, names)
