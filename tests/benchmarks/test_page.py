"""The page's tables follow from the results, and nothing else on it is touched."""

import pytest

from benchmarks import page


def row(seconds, error, method="field"):
    return {
        "scene": "s",
        "method": method,
        "label": method,
        "truth": "full",
        "cpu_seconds": 2 * seconds,
        "seconds": seconds,
        "rmse_limit": error,
    }


def test_a_table_replaces_what_is_between_its_markers():
    text = "before\n<!-- cpu: D -->\nold\n<!-- end -->\nafter\n<!-- gpu: D -->\nkeep\n<!-- end -->\n"
    filled = page.fill(text, "cpu: D", "new\n")
    assert filled == text.replace("old", "new")
    assert page.fill(filled, "cpu: D", "new\n") == filled


def test_the_time_to_an_error_is_read_between_points_and_not_beyond():
    rows = [row(1.0, 0.1), row(4.0, 0.05), row(16.0, 0.025)]
    assert page.seconds_to(rows, 0.05, "cuda:0") == "4"
    assert page.seconds_to(rows, 0.05, "cpu") == "8"
    assert page.seconds_to(rows, 0.1 / 2**0.5, "cuda:0") == "2"
    assert page.seconds_to(rows, 0.2, "cuda:0") == "< 1"
    assert page.seconds_to(rows, 0.01, "cuda:0") == "> 16"


def test_a_run_has_a_known_name(tmp_path):
    with pytest.raises(ValueError, match="cpu"):
        page.take_over("tpu", tmp_path)
