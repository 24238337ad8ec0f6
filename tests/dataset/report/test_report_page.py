"""The page works in a real browser: nothing is asked of the network, no error is logged, and time moves everything."""

import json
import os
import re
import shutil

import numpy as np
import pytest
from standins import make_scene

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import write_report
from varos_warp.dataset.run.produce import produce

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)

if not os.environ.get("CI"):
    pytest.importorskip("playwright")
    if BROWSER is None:
        pytest.skip("there is no Chromium", allow_module_level=True)


@pytest.fixture(scope="module")
def address(written, tmp_path_factory):
    return write_report(Dataset(written), tmp_path_factory.mktemp("page") / "report.html").as_uri()


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    assert BROWSER, "Chromium is not installed; .ci/run installs it"
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def page(browser, address):
    """The page on a screen of 1280 pixels; whatever it logs or asks for is wrong."""
    yield from opened(browser, address, viewport={"width": 1280, "height": 800})


def opened(browser, address, **options):
    context = browser.new_context(**options)
    page, wrong = context.new_page(), []
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: request.url.startswith(("data:", address)) or wrong.append(request.url))
    page.goto(address)
    yield page
    context.close()
    assert not wrong


def sources(page) -> dict[str, str]:
    return {
        figure.get_attribute("data-output"): figure.query_selector("img").get_attribute("src")
        for figure in page.query_selector_all("#viewer figure")
    }


def embedded(page, camera: str, index: int) -> dict[str, str]:
    """Images of a frame as the page carries them."""
    images = json.loads(page.text_content("#data"))["images"][camera]
    return {output: f"data:image/webp;base64,{strip[index]}" for output, strip in images.items()}


def pixels(page, selector: str) -> str:
    """What is drawn on a canvas, once all that was asked for is drawn."""
    return page.evaluate(
        """selector => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(
        () => done(document.querySelector(selector).toDataURL()))))""",
        selector,
    )


def clock(page) -> str:
    return page.inner_text("#clock")


def test_every_image_is_decoded_by_the_browser(page, written):
    page.evaluate("Promise.all([...document.images].map(image => image.decode()))")
    course = page.evaluate("[...document.querySelectorAll('.course img')].map(image => image.naturalWidth)")
    assert len(course) == 2
    assert min(course) > 400
    widths = page.evaluate("[...document.querySelectorAll('img:not(.course img)')].map(image => image.naturalWidth)")
    assert len(widths) >= 4 + 4 * 8
    assert set(widths) == {48}
    assert set(sources(page)) == set(Dataset(written).outputs)


def speed(written, index: int) -> float:
    data = Dataset(written)
    return float(np.linalg.norm(data.states(data[index].time_ns, data[index].time_ns + 1)["velocity"]))


def test_the_scrubber_changes_the_images_the_clock_and_the_curves(page, written):
    before = clock(page), pixels(page, ".plot canvas")
    assert sources(page) == embedded(page, "L0", 0)
    page.locator("#scrubber").fill("7")
    assert clock(page) == f"frame 7 · 0.70 s · {speed(written, 7):.2f} m/s"
    assert sources(page) == embedded(page, "L0", 7)
    assert len({embedded(page, "L0", index)["A"] for index in range(10)}) == 10
    after = clock(page), pixels(page, ".plot canvas")
    assert all(a != b for a, b in zip(before, after, strict=True))


def test_keys_step_to_the_ends_and_not_beyond(page):
    for key, expected in (
        ("ArrowRight", 1),
        ("ArrowRight", 2),
        ("ArrowLeft", 1),
        ("ArrowLeft", 0),
        ("ArrowLeft", 0),
        ("End", 9),
        ("ArrowRight", 9),
        ("Home", 0),
        ("Shift+ArrowRight", 9),
    ):
        page.keyboard.press(key)
        assert clock(page).startswith(f"frame {expected} ·"), key


def test_playing_runs_in_real_time_and_stops_at_the_end(page):
    page.select_option("#speed", "1")
    page.keyboard.press("Space")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    page.locator("#play[aria-label=Play]").wait_for(timeout=10_000)
    assert clock(page).startswith("frame 9 ·")
    page.click("#play")
    page.wait_for_timeout(300)
    page.click("#play")
    assert not clock(page).startswith("frame 0 ·")
    stopped = clock(page)
    page.wait_for_timeout(400)
    assert clock(page) == stopped


def test_the_other_camera_shows_other_images_at_the_same_time(page):
    page.keyboard.press("ArrowRight")
    page.select_option("#camera", "R0")
    assert clock(page).startswith("frame 1 ·")
    assert sources(page) == embedded(page, "R0", 1)
    assert embedded(page, "R0", 1)["A"] != embedded(page, "L0", 1)["A"]


def test_a_click_on_a_curve_goes_to_its_time(page):
    plot = page.locator(".plot canvas").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    plot.click(position={"x": 46 + 0.5 * (box["width"] - 54), "y": 60})
    assert clock(page).startswith("frame 5 · 0.50 s")


def test_a_click_on_an_image_makes_it_the_large_one(page):
    page.click("#viewer figure[data-output=D]")
    figures = "[...document.querySelectorAll('#viewer figure')]"
    sizes = page.evaluate(f"{figures}.map(figure => [figure.dataset.output, figure.clientWidth])")
    assert sizes[0][0] == "D"
    assert sizes[0][1] > 2.5 * max(width for _, width in sizes[1:])
    page.click("[data-layout=grid]")
    assert len({f.bounding_box()["width"] for f in page.query_selector_all("#viewer figure")}) == 1


def test_the_contact_sheet_leads_to_its_frames(page):
    page.locator("#sheet button").nth(7).click()
    assert clock(page).startswith("frame 9 ·")


def test_dark_and_light_differ_and_follow_what_the_user_prefers(browser, address):
    found = []
    for scheme in ("dark", "light"):
        for page in opened(browser, address, color_scheme=scheme):
            ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
            page.click("#theme")
            other = page.evaluate("getComputedStyle(document.body).backgroundColor")
            found.append((ground, other, pixels(page, ".plot canvas")))
    assert found[0][:2] == found[1][1::-1]
    dark, light = (sum(map(int, re.findall(r"\d+", ground)[:3])) for ground, _, _ in found)
    assert dark < 150 < 600 < light
    assert found[0][2] != found[1][2]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_rule_of_accessibility_is_broken(browser, address, scheme):
    if not os.environ.get("CI"):
        pytest.importorskip("axe_playwright_python")
    from axe_playwright_python.sync_playwright import Axe

    for page in opened(browser, address, color_scheme=scheme):
        found = Axe().run(page).response["violations"]
        assert [(rule["id"], rule["nodes"][0]["html"]) for rule in found] == []


@pytest.mark.parametrize("options", [{"images": False}, {"frames": slice(4, 5)}, {"sensors": False}])
def test_what_is_not_there_is_no_error(browser, tmp_path, options):
    produce(make_scene(), tmp_path / "data", quiet=True, **options)
    path = write_report(Dataset(tmp_path / "data"), tmp_path / "report.html")
    for page in opened(browser, path.as_uri()):
        page.keyboard.press("ArrowRight")
        shown = {(): 10, ("images",): 0, ("frames",): 1}.get(tuple(options), 10)
        assert page.locator("#viewer figure").count() == (4 if shown else 0)
        assert page.locator("#transport").is_visible() == bool(shown)


def test_nothing_is_wider_than_the_screen(page):
    """Also of a window that is made narrower and wider again."""
    for width, height in ((1280, 800), (768, 1024), (390, 844), (320, 568), (1280, 800)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("#transport").bounding_box()["width"] <= width
        assert page.locator("#scrubber").bounding_box()["width"] >= 60


OVERLAPS = """() => {
  const boxes = selector => [...document.querySelectorAll(selector)].map(e => [e, e.getBoundingClientRect()]);
  const [[, player]] = boxes('#transport'), found = [];
  for (const [element, box] of boxes('.legend, h2, h3, figcaption, #sheet button, .note, table, canvas, footer'))
    if (box.width && box.left < player.right && player.left < box.right
        && box.top < player.bottom && player.top < box.bottom)
      found.push(element.outerHTML.slice(0, 60));
  return found;
}"""
CUT_OFF = """() => [...document.querySelectorAll('.scroll, td, th, pre, .plot header, .tiles div')]
  .filter(e => e.clientWidth && e.scrollWidth > e.clientWidth + 1).map(e => e.outerHTML.slice(0, 80))"""
LETTERS = """() => [...document.querySelectorAll('th, td')]
  .filter(e => e.offsetParent && e.clientWidth < 24 && e.innerText.trim().length > 3)
  .map(e => e.innerText)"""


@pytest.fixture(scope="module")
def address_with_a_source(written, tmp_path_factory):
    """Of a page with a wide table."""
    data = Dataset(written)
    data.meta["sources"] = {"../somewhere/far/away/meshes/of_the_sea_bed.dae": 64 * "0"}
    return write_report(data, tmp_path_factory.mktemp("sources") / "report.html").as_uri()


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844)])
def test_the_player_covers_nothing_and_no_table_is_cut_off(browser, address_with_a_source, width, height):
    for page in opened(browser, address_with_a_source, viewport={"width": width, "height": height}):
        for y in (0, 200, 400, 600, 100_000):
            page.evaluate(f"scrollTo({{top: {y}, behavior: 'instant'}})")
            assert page.evaluate(OVERLAPS) == []
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert page.evaluate(CUT_OFF) == []
        assert page.evaluate(LETTERS) == []
