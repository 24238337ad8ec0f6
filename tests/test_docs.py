"""Documents name what is there: links lead somewhere, and CONTRIBUTING names files that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "benchmarks").rglob("*.md")]


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


def test_contributing_names_files_and_functions_that_exist():
    """Of a row of its table each name in code is a path of the repository or the package, or stands in one it names."""
    rows = [row for row in (ROOT / "CONTRIBUTING.md").read_text().splitlines() if row.startswith("| ")][1:]
    assert len(rows) > 8
    for row in rows:
        names = [name for name in re.findall(r"`([^`]+)`", row) if not name.startswith("varos-warp ")]
        found = {name: place for name in names if "/" in name or name.endswith((".py", ".md"))
                 for place in (ROOT / name, ROOT / "varos_warp" / name, *(ROOT / "varos_warp").rglob(name))
                 if place.exists()}
        texts = "".join(path.read_text() for place in found.values()
                        for path in (place.rglob("*.py") if place.is_dir() else [place]))
        for name in names:
            assert name in found or re.search(rf"\b{re.escape(name.split('(')[0].lstrip('@'))}\b", texts), (name, row)
