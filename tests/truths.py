"""Truths: numbers that are known otherwise, which tests assert and `pytest --validation=FOLDER` writes down.

A test asks for the fixture ``truth`` and calls it once for each number or array. What it compares, with what and within
which error is recorded before it is asserted, so the page tells of failures too. Its subject is that of the marker
``subject`` of the test or its module. ``--validation`` needs a run of all tests, in one process or in several: a page
of some of the truths would look like a page of all. It writes ``validation.md``, every truth, and ``summary.md``.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pytest

SUBJECTS = (
    "phase functions",
    "single scattering",
    "multiple scattering",
    "surfaces and lights",
    "camera",
    "dynamics",
    "IMU and depth gauge",
)
"""The page's chapters, in this order."""

SIGMAS = 4.0
"""Standard errors that a right estimate stays within: one false alarm in 16 000."""

RECORDED = pytest.StashKey[dict]()
"""Truths by test."""
EXPECTED = pytest.StashKey[list]()
"""Tests that know a truth, in their order."""


@dataclass(frozen=True)
class Truth:
    """One comparison; of an array, its element that is off by the largest share of what is allowed."""

    subject: str
    name: str
    source: str
    quantity: str
    count: int
    expected: float
    got: float
    allowed: float
    within: str
    share: float
    """|got - expected| over what is allowed; more than 1 fails."""

    @property
    def passed(self) -> bool:
        """Whether all elements are within what is allowed."""
        return self.share <= 1.0

    def row(self) -> str:
        """Line of the page's table."""
        quantity = self.quantity + (f" (worst of {self.count})" if self.count > 1 else "")
        cells = (
            quantity,
            number(self.expected),
            number(settled(self.got, self.allowed)),
            self.within,
            f"{100 * self.share:.0f} %",
            "yes" if self.passed else "**NO**",
        )
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def number(value: float, digits: int = 7) -> str:
    """A value as the page shows it."""
    return f"{value:.{digits}g}"


def settled(value: float, allowed: float) -> float:
    """A value to a hundredth of what it may be off: digits beyond differ from one compiler to the next."""
    if allowed == 0.0 or not np.isfinite(value):
        return value
    return round(value, 2 - int(np.floor(np.log10(allowed)))) + 0.0  # no -0


def compare(*, expected, got, stderr=None, sigmas: float = SIGMAS, tolerance=None, reason: str = "") -> dict:
    """Compare element by element; ``expected`` and errors broadcast to the shape of ``got``.

    Args:
        expected: The truth.
        got: What was computed.
        stderr: Standard error of ``got`` (and of ``expected``, where it has one).
        sigmas: How many standard errors are allowed.
        tolerance: Absolute, allowed besides; ``reason`` says where it comes from.

    Returns:
        Fields of a `Truth`: count, expected, got, allowed, within, share.

    Raises:
        ValueError: Nothing is allowed, or so much that no value could fail, or a tolerance has no reason.
    """
    if (stderr is None and tolerance is None) or (tolerance is not None and not reason):
        raise ValueError("a truth needs a standard error or a tolerance, and the tolerance a reason")
    got = np.asarray(got, float)
    errors = [0.0 if x is None else x for x in (stderr, tolerance)]
    expected, sigma, margin = (np.broadcast_to(np.asarray(x, float), got.shape).ravel() for x in (expected, *errors))
    got = got.ravel()
    allowed = sigmas * sigma + margin
    scale = np.abs(expected).max()
    if not np.all(np.isfinite(allowed)) or (scale > 0.0 and np.median(allowed) >= scale):
        raise ValueError(f"too noisy to tell: {allowed.max():.3g} allowed of {scale:.3g}")
    off = np.abs(got - expected)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(off == 0.0, 0.0, off / allowed)
    share = np.where(np.isfinite(share), share, np.inf)  # also of NaN
    i = int(np.lexsort((np.abs(expected), share))[-1])
    within = [] if stderr is None else [f"{number(sigmas, 3)} × {number(sigma[i], 2)} (standard error)"]
    within += [f"{number(margin[i], 2)} ({reason})"] if tolerance is not None else []
    return {
        "count": got.size,
        "expected": float(expected[i]),
        "got": float(got[i]),
        "allowed": float(allowed[i]),
        "within": " + ".join(within),
        "share": float(share[i]),
    }


PROPER = {
    "imu": "IMU",
    "hz": "Hz",
    "papers": "paper's",
    "chandrasekhars": "Chandrasekhar's",
    "vehicles": "vehicle's",
    "regulators": "regulator's",
    "blenders": "Blender's",
} | {name.lower(): name for name in ("Allan", "Beer", "Case", "Coriolis", "Lambert", "Riccati", "Zweifel")}
"""Words that the name of a test cannot spell."""


def claim(test: str) -> str:
    """The sentence that a test's name is."""
    words = [PROPER.get(word, word) for word in test.removeprefix("test_").split("_")]
    return words[0][0].upper() + " ".join(words)[1:]


class Recorder:
    """What a test calls: asserts a truth and keeps it for the page."""

    def __init__(self, subject: str, name: str, kept: list[Truth]):
        self._subject, self._name, self._kept = subject, name, kept

    def __call__(self, quantity: str, *, source: str, name: str | None = None, subject: str | None = None, **compared):
        """Record and assert.

        Args:
            quantity: What is compared, with its parameters.
            source: Where the truth comes from: a formula, a publication.
            name: The claim; as the test is called, unless given.
            subject: One of SUBJECTS; that of the test's marker, unless given.
            **compared: See `compare`.
        """
        subject = subject or self._subject
        assert subject in SUBJECTS, f"unknown subject {subject!r}"
        made = Truth(subject, name or self._name, source, quantity, **compare(**compared))
        self._kept.append(made)
        assert made.passed, (
            f"{made.quantity}: {made.got!r} instead of {made.expected!r}, "
            f"{made.share:.3g} times what is allowed: {made.within}"
        )


@pytest.fixture
def truth(request) -> Recorder:
    """Assert that a number is the known one, and record it for the validation page."""
    node = request.node
    marker = node.get_closest_marker("subject")
    kept = node.config.stash[RECORDED].setdefault(node.nodeid, [])
    return Recorder(marker.args[0] if marker else "", claim(node.originalname), kept)


# ------------------------------------------------------------------------------------------------------------ the page


HEADER = """# Known values: what the tests hold the package against

Each number that the tests compare with a closed form, a published value or an independent calculation: what was
expected, what this package computed, and the error allowed, which is {sigmas:.0f} standard errors (one false alarm in
16 000), or a tolerance with its reason. "Used" is how much of it the result took; more than 100 % fails the test. Of
arrays, the element that used most is shown. Seeds are fixed, so that a difference in these pages is a difference in the
program (or in a compiler's rounding).

`make test` writes every number to `build/validation/validation.md`, and this summary beside it.

Whole scenes are compared with [other programs](../benchmarks/peers/README.md).

| subject | numbers | pass | most used |
|---|---|---|---|
{summary}
"""
NEAREST = 10
"""Truths in the summary: those that used most of what is allowed."""
COLUMNS = ["| quantity | expected | got | allowed | used | pass |", "|---|---|---|---|---|---|"]


def summary(truths: list[Truth]) -> str:
    """The numbers of truths by subject, and those nearest to their limits, in Markdown."""
    chapters = [(subject, [t for t in truths if t.subject == subject]) for subject in SUBJECTS]
    rows = [
        f"| {name} | {len(made)} | {sum(t.passed for t in made)} | {100 * max(t.share for t in made):.0f} % |"
        for name, made in [*chapters, ("**all**", truths)]
        if made
    ]
    nearest = sorted(truths, key=lambda t: -t.share)[:NEAREST]
    lines = [HEADER.format(sigmas=SIGMAS, summary="\n".join(rows)), "Nearest to their limits:\n", *COLUMNS]
    return "\n".join([*lines, *(t.row() for t in nearest)]) + "\n"


def page(truths: list[Truth]) -> str:
    """Every truth, in Markdown."""
    lines = [summary(truths)]
    for subject in SUBJECTS:
        chapter = [t for t in truths if t.subject == subject]
        if chapter:
            lines.append(f"## {subject[0].upper()}{subject[1:]}\n")
        for name, source in dict.fromkeys((t.name, t.source) for t in chapter):
            rows = [t.row() for t in chapter if (t.name, t.source) == (name, source)]
            lines += [f"**{name}.** {source}\n", *COLUMNS, *rows, ""]
    return "\n".join(lines).rstrip() + "\n"


# --------------------------------------------------------------------------------------------------------- the plugin


def pytest_addoption(parser):
    parser.addoption("--validation", metavar="FOLDER", help="write all truths that the tests know to this folder")


def pytest_configure(config):
    config.addinivalue_line("markers", "subject(name): chapter of the validation page that a test's truths belong to")
    config.stash[RECORDED] = {}
    config.stash[EXPECTED] = []
    is_worker = hasattr(config, "workerinput")
    whole = config.args_source is config.ArgsSource.TESTPATHS and not (config.option.keyword or config.option.markexpr)
    if config.getoption("validation") and not whole and not is_worker:
        raise pytest.UsageError("--validation is a page of all truths: no paths, no -k and no -m beside it")


def knows_a_truth(item) -> bool:
    """Whether a test asks for the fixture, and not for a parameter of that name."""
    parameters = item.callspec.params if hasattr(item, "callspec") else {}
    return "truth" in getattr(item, "fixturenames", ()) and "truth" not in parameters


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """A test that asks for the fixture and records nothing fails by itself, whether a page is asked for or not."""
    result = yield
    if knows_a_truth(pyfuncitem) and not pyfuncitem.config.stash[RECORDED].get(pyfuncitem.nodeid):
        pytest.fail("asks for the fixture truth, and recorded none", pytrace=False)
    return result


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error):
    """Take over what a worker process of pytest-xdist recorded."""
    output = getattr(node, "workeroutput", {})
    node.config.stash[EXPECTED] = output.get("expected", [])  # every worker collects all tests
    for test, truths in output.get("truths", {}).items():
        node.config.stash[RECORDED][test] = [Truth(**fields) for fields in truths]


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    """Write the pages, unless a truth is missing on them; in a worker process, pass on what was recorded."""
    config, folder = session.config, session.config.getoption("validation")
    recorded = config.stash[RECORDED]
    expected = config.stash[EXPECTED] or [item.nodeid for item in session.items if knows_a_truth(item)]
    if hasattr(config, "workeroutput"):
        config.workeroutput["expected"] = expected
        config.workeroutput["truths"] = {test: [asdict(made) for made in truths] for test, truths in recorded.items()}
        return
    if not folder or config.option.collectonly:
        return
    missing = [test for test in expected if not recorded.get(test)]
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if exitstatus not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        reporter.write_line(f"\n{folder} not written: not all tests ran")
        return
    if missing:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
        reporter.write_line(f"\n{folder} not written: no truth from {', '.join(missing)}")
        return
    truths = [made for test in expected for made in recorded[test]]
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, text in (("validation.md", page(truths)), ("summary.md", summary(truths))):
        (Path(folder) / name).write_text(text, encoding="utf-8")
    reporter.write_line(f"\n{folder}: {len(truths)} truths")
