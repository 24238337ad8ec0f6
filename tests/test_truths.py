"""The recorder of truths: a wrong value fails and is written down as failed, and no truth is missing from the page."""

import numpy as np
import pytest
from truths import compare


@pytest.fixture
def run(pytester):
    """Run tests with the recorder: outcome and the page, or None where none was written."""
    pytester.makeini("[pytest]\ntestpaths = .")

    def run(tests, *arguments):
        pytester.makepyfile(test_it="import pytest\npytestmark = pytest.mark.subject('dynamics')\n" + tests)
        plugins = "-p", "no:hypothesispytest", "-p", "truths"  # Hypothesis would be loaded anew every time
        result = pytester.runpytest_inprocess(*plugins, "--validation=pages", *arguments)
        path = pytester.path / "pages" / "validation.md"
        return result, path.read_text(encoding="utf-8") if path.exists() else None

    return run


RIGHT = """
def test_one_is_one(truth):
    truth("x", source="arithmetic", expected=1.0, got=1.0 + 1e-9, tolerance=1e-8, reason="rounding")
"""
WRONG = """
def test_two_is_one(truth):
    truth("y", source="error", expected=[3.0, 1.0], got=[3.0, 2.0], stderr=0.1)
"""


def test_a_right_value_passes_and_is_on_the_page(run):
    result, page = run(RIGHT)
    result.assert_outcomes(passed=1)
    assert "**One is one.** arithmetic" in page
    assert "| x | 1 | 1 | 1e-08 (rounding) | 10 % | yes |" in page
    assert "| **all** | 1 | 1 | 10 % |" in page


def test_a_wrong_value_fails_and_is_on_the_page_as_failed(run):
    result, page = run(RIGHT + WRONG)
    result.assert_outcomes(passed=1, failed=1)
    assert "| y (worst of 2) | 1 | 2 | 4 × 0.1 (standard error) | 250 % | **NO** |" in page
    assert "| dynamics | 2 | 1 | 250 % |" in page


def test_the_page_is_the_same_bytes_every_time(run):
    assert run(RIGHT + WRONG)[1] == run(RIGHT + WRONG)[1]


def test_other_tests_run_beside_and_a_parameter_of_that_name_is_no_truth(run):
    others = "def test_other(): pass\n@pytest.mark.parametrize('truth', [1])\ndef test_parameter(truth): pass\n"
    result, page = run(RIGHT + others)
    result.assert_outcomes(passed=3)
    assert "| **all** | 1 | 1 | 10 % |" in page


def test_the_summary_has_the_truths_nearest_to_their_limits_only(run, pytester):
    many = "".join(
        f"def test_{i}(truth):\n    truth('x{i}', source='s', expected=1.0, got=1.0 + {i}e-9, "
        "tolerance=1e-7, reason='rounding')\n"
        for i in range(12)
    )
    run(many)
    text = (pytester.path / "pages" / "summary.md").read_text()
    assert [f"| x{i} |" in text for i in range(12)] == [False, False] + [True] * 10


def test_several_processes_write_the_same_page(run):
    pytest.importorskip("xdist")
    alone = run(RIGHT + RIGHT.replace("one_is_one", "one_is_still_one"))[1]
    assert run(RIGHT + RIGHT.replace("one_is_one", "one_is_still_one"), "-n", "2")[1] == alone


@pytest.mark.parametrize(
    "missing",
    [
        "def test_it_breaks_before(truth): raise RuntimeError\n",
        "def test_it_says_nothing(truth): pass\n",
        "@pytest.mark.skip\ndef test_it_is_skipped(truth): pass\n",
    ],
)
def test_a_page_that_misses_a_truth_is_not_written(run, missing):
    result, page = run(RIGHT + missing)
    assert page is None
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines("*not written*test_it_*")


def test_a_test_that_records_no_truth_fails_without_a_page_too(run):
    result, _ = run("def test_it_says_nothing(truth): pass\n", "--validation=", "-k", "it")
    result.assert_outcomes(failed=1)


@pytest.mark.parametrize("narrower", [["-k", "one"], ["-m", "subject"], ["test_it.py"]])
def test_a_page_of_some_truths_is_refused(run, narrower):
    result, page = run(RIGHT, *narrower)
    assert page is None
    assert result.ret == pytest.ExitCode.USAGE_ERROR


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1.3, 0.7, -1.0])
def test_only_what_is_within_the_errors_is_right(wrong):
    allowed = {"stderr": 0.05, "tolerance": 0.05, "reason": "a test"}
    assert compare(expected=1.0, got=wrong, **allowed)["share"] > 1.0
    assert compare(expected=1.0, got=1.2, **allowed)["share"] == pytest.approx(0.8)
    assert compare(expected=1.0, got=[1.0, wrong, 1.0], **allowed)["share"] > 1.0


@pytest.mark.parametrize(
    "allowed", [{}, {"tolerance": 0.1}, {"stderr": 0.3}, {"stderr": np.nan}, {"tolerance": 2.0, "reason": "laziness"}]
)
def test_a_truth_that_could_not_fail_is_refused(allowed):
    with pytest.raises(ValueError, match=r"needs a standard error|too noisy"):
        compare(expected=1.0, got=1.0, **allowed)
