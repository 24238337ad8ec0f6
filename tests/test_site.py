"""The site of the documents: no link is broken, its search answers what newcomers ask, and all can read it."""

import os
import shutil
import string
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
QUESTIONS = {
    "how do I add my own terrain": "howto/questions.html",
    "set the water": "scene/water.html",
    "stereo": "tutorials/stereo.html",
    "add noise": "noise.html",
    "resume": "long_runs.html",
    "run on a cluster": "howto/cluster.html",
    "read depth": "dataset.html",
    "convert to ROS": "exports.html",
    "change lights": "howto/questions.html",
    "what is stderr": "howto/questions.html",
    "rolling shutter": "shutters.html",
    "several vehicles": "vehicles.html",
    "camera intrinsics": "dataset.html",
    "optical flow": "flow.html",
    "heightmap": "tutorials/terrain.html",
    "GeoTIFF DEM": "tutorials/terrain.html",
    "what does A B C D mean": "howto/questions.html",
    "vehicle does not move far enough": "howto/questions.html",
    "open EXR python": "howto/questions.html",
    "jerlov": "tutorials/turbid_water.html",
    "quaternion order": "howto/questions.html",
}
"""What may be typed into the search, and the page that must be among the first three it finds."""
PAGES = ("start.html", "gallery.html", "howto/questions.html", "scene/vehicle.cameras.html", "cli.html")
"""One of each kind of page."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Where the site is, built as by `make docs`: every link is checked."""
    if not os.environ.get("CI"):
        pytest.importorskip("mkdocs")
        pytest.importorskip("mkdocstrings")
    place = tmp_path_factory.mktemp("site")
    built = subprocess.run(  # not --quiet, which counts no warning
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", place],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        text=True,
        capture_output=True,
    )
    assert built.returncode == 0, built.stderr
    return place


@pytest.fixture(scope="module")
def page(site):
    if not os.environ.get("CI"):
        pytest.importorskip("playwright")
        if BROWSER is None:
            pytest.skip("there is no Chromium")
    from playwright.sync_api import sync_playwright

    assert BROWSER, "Chromium is not installed; .ci/run installs it"
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--allow-file-access-from-files"])
        yield browser.new_page(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
        browser.close()


def first_hits(page, words: str) -> list[str]:
    """Addresses of the first three pages that the search finds."""
    field, hits = page.locator("input.md-search__input"), ".md-search-result__list > .md-search-result__item"
    field.fill("")
    field.press("End")  # it looks when a key goes up
    page.wait_for_function("hits => document.querySelectorAll(hits).length == 0", arg=hits)
    field.fill(words)
    field.press("End")
    page.wait_for_selector(hits, state="attached")
    links = page.locator(f"{hits} > a.md-search-result__link:first-child")
    return [link.get_attribute("href").partition("?")[0] for link in links.all()[:3]]


def test_every_page_and_link_of_the_site_is_there(site):
    assert [name for name in {*PAGES, *QUESTIONS.values()} if not (site / name).is_file()] == []


def test_the_search_answers_what_newcomers_ask(site, page):
    page.goto((site / "start.html").as_uri())
    page.locator("input.md-search__input").click(force=True)
    said = []
    page.on("console", lambda message: said.append(message.text))
    for words, answer in QUESTIONS.items():
        found = first_hits(page, words)
        assert any(hit.endswith(answer) for hit in found), (words, found)
    for letter in string.ascii_lowercase:  # a word that is lost from the dictionary fails all that begins like it
        assert first_hits(page, letter)
    assert said == []


def test_on_a_narrow_screen_neither_a_page_nor_its_code_scrolls_sideways(site, page):
    wide = "e => [...document.querySelectorAll(e)].filter(e => e.scrollWidth > e.clientWidth + 1).length"
    size = page.viewport_size
    page.set_viewport_size({"width": 390, "height": 844})
    found = {}
    for name in PAGES:
        page.goto((site / name).as_uri())
        found[name] = page.evaluate(wide, "html, article pre > code")
    page.set_viewport_size(size)
    assert found == dict.fromkeys(PAGES, 0)


def test_no_rule_of_accessibility_is_broken(site, page):
    if not os.environ.get("CI"):
        pytest.importorskip("axe_playwright_python")
    from axe_playwright_python.sync_playwright import Axe

    for name in PAGES:
        page.goto((site / name).as_uri())
        found = Axe().run(page).response["violations"]
        assert [(name, rule["id"], rule["nodes"][0]["html"]) for rule in found] == []
