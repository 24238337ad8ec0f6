"""What MkDocs does besides: adds the pages that are made from the package, and mends links that lead out of docs/."""

import os
import re
import sys
from pathlib import Path, PurePosixPath

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))  # reference.py
import reference

ROOT = reference.ROOT
OUTSIDE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "benchmarks/peers/README.md": "peers.md",
    "examples": "examples.md",
}
"""Pages of the site that are not in docs/, by their path in the repository."""
BOOST = {
    "start.md": 1.5,
    "dataset.md": 1.5,
    **dict.fromkeys(
        ("api.md", "examples.md", "changelog.md", "architecture.md", "stability.md", "known_values.md", "results.md"),
        0.4,
    ),
    **dict.fromkeys(("howto/sweeps.md", "spectra.md", "dataset_readme.md"), 0.6),
}
"""How much a page counts in the search, where that is not 1: what is looked up less often than it matches."""
LINK = re.compile(r"(!?\[[^\]]*\]\()(?!https?:|#)([^)#\s]+)(#[^)\s]+)?(\))")


def on_config(config):
    """In ``nav``, ``"*"`` stands for the pages of docs/ that it does not name."""
    named = re.findall(r"[\w./]+\.md", str(config.nav))
    rest = sorted(path.name for path in (ROOT / "docs").glob("*.md") if path.name not in named)
    for section in config.nav:
        for title, entries in section.items():
            if isinstance(entries, list) and "*" in entries:
                at = entries.index("*")
                section[title] = [*entries[:at], *rest, *entries[at + 1 :]]
    return config


def on_files(files, config):
    """Add the pages made from the package, those of the repository's root, and files that pages link to."""
    made = {site: (ROOT / path).read_text(encoding="utf-8") for path, site in OUTSIDE.items() if path.endswith(".md")}
    for name, text in (made | reference.pages()).items():
        files.append(File.generated(config, name, content=text))
    for page in [file for file in files if file.src_uri.endswith(".md")]:
        for link in LINK.finditer(page.content_string):
            path = target(page.src_uri, link[2])
            if (
                (ROOT / path).is_file()
                and place(path).startswith("files/")
                and files.get_file_from_path(place(path)) is None
            ):
                files.append(File.generated(config, place(path), abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Links of a repository become those of the site; pages get their weight in the search."""
    page.meta["search"] = {"boost": BOOST.get(page.file.src_uri, 1)}

    def moved(link):
        site = place(target(page.file.src_uri, link[2]))
        return f"{link[1]}{os.path.relpath(site, os.path.dirname(page.file.src_uri) or '.')}{link[3] or ''}{link[4]}"

    return LINK.sub(moved, markdown)


UNIT = re.compile(r'<autoref (?![^>]*optional)[^>]*identifier="([^".]*)"[^>]*>([^<]*)</autoref>')
"""What mkdocs-autorefs makes of a shape before a unit, `[H, W] [m]`: a reference of Markdown."""
NO_HEADER = re.compile(r"<thead>\s*<tr>(\s*<th[^>]*></th>)+\s*</tr>\s*</thead>")


def on_page_content(html, page, config, files):
    """Shapes and units of docstrings are no references; screen readers meet no empty headers of tables."""
    return re.sub("<th([^>]*)></th>", r"<td\1></td>", NO_HEADER.sub("", UNIT.sub(r"[\2] [\1]", html)))


def on_post_page(output, page, config):
    """The theme's search has no name for screen readers."""
    return output.replace('role="dialog"', 'role="dialog" aria-label="Search"')


def on_post_template(output_content, template_name, config):
    """The same on the page that says that there is no such page."""
    return on_post_page(output_content, None, config) if template_name == "404.html" else output_content


def on_post_build(config):
    """Mend the search's dictionary (lunr 2.3.9, ``TokenSet.toString``): it takes unlike branches for one.

    It names a branch by its letters and the numbers of its children, run together: letter 1 to child 523 is named like
    letter 1 to child 5 and letter 2 to child 3. Words with digits then lead to words that no page has, and the search
    fails.
    """
    (worker,) = Path(config.site_dir).glob("assets/javascripts/workers/search.*.min.js")
    code = worker.read_text(encoding="utf-8")
    mended = code.replace("e=e+s+o.id}return e", 'e=e+s+o.id+" "}return e')
    if mended == code:
        raise PluginError(
            "docs/hooks/pages.py: on_post_build does not know this version of the theme's search; see there"
        )
    worker.write_text(mended, encoding="utf-8")


def target(page: str, link: str) -> str:
    """Path in the repository of what a page of the site links to; links of pages made here begin at its root."""
    origin = next((path for path, site in OUTSIDE.items() if site == page), f"docs/{page}")
    folder = PurePosixPath(origin).parent if (ROOT / origin).exists() else ""
    return os.path.normpath(os.path.join(folder, link))


def place(path: str) -> str:
    """Where the site has a path of the repository."""
    if path in OUTSIDE:
        return OUTSIDE[path]
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    if path.startswith("examples/") and PurePosixPath(path).suffix in ("", ".yaml"):
        return OUTSIDE["examples"]
    return f"files/{path}"
