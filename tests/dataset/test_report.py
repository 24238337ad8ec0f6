"""The report is one page that needs nothing else; the contact sheet has a row for each image type."""

import re
import shutil

import numpy as np
import pytest

from varos_warp.dataset import files
from varos_warp.dataset.layout import Dataset
from varos_warp.dataset.report import contact_sheet, spread, write_report
from varos_warp.errors import InputError


def test_the_page_refers_to_nothing_outside_itself(written, tmp_path):
    page = write_report(Dataset(written), tmp_path / "report.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]{0,40})', page)
    assert len(sources) >= 4 * 2 * 4 + 4
    assert all(source.startswith("data:image/") for source in sources)
    for section in ("Overview", "Frames", "Trajectory", "Sensors", "Exposure", "Plan", "Timings"):
        assert f"<h2>{section}</h2>" in page
    assert "a test" in page  # the planner's reason


def test_names_from_the_scene_cannot_break_the_page(written, tmp_path):
    data = Dataset(written)
    data.meta["name"] = "<script>alert(1)</script>"
    page = write_report(data, tmp_path / "report.html").read_text()
    assert "<script>" not in page


def test_a_report_of_a_partial_dataset_shows_what_is_there(written, tmp_path):
    copy = shutil.copytree(written, tmp_path / "copy")
    shutil.rmtree(copy / "vehicle0/cam0/A")
    shutil.rmtree(copy / "log")
    for path in copy.rglob("*_exposure_*.csv"):
        path.unlink()
    page = write_report(Dataset(copy), tmp_path / "report.html").read_text()
    assert "None yet." in page


def test_a_report_needs_a_vehicle(written, tmp_path):
    copy = shutil.copytree(written, tmp_path / "copy")
    Dataset(copy).layout.states.unlink()
    with pytest.raises(InputError, match="varos-warp simulate"):
        write_report(Dataset(copy), tmp_path / "report.html")


def test_the_contact_sheet_has_a_row_for_each_camera_and_type(written, tmp_path):
    contact_sheet(Dataset(written), tmp_path / "sheet.png", columns=3, width=96)
    sheet = files.read_png(tmp_path / "sheet.png")
    assert sheet.shape == (2 * 4 * (54 + 2), 3 * 98, 3)
    rows = sheet.reshape(8, 56, -1)
    assert (np.ptp(rows, axis=(1, 2)) > 50).all()


@pytest.mark.parametrize(("count", "expected"), [(1, [5]), (2, [5, 14]), (4, [5, 8, 11, 14]), (50, list(range(5, 15)))])
def test_frames_are_spread_from_first_to_last(count, expected):
    assert spread(list(range(5, 15)), count) == expected
