"""Users' type checkers know the public API: what uses it well passes, what uses it wrongly fails."""

import subprocess
import sys
from pathlib import Path

import pytest

import varos_warp

ROOT = Path(__file__).parents[1]
USE = ROOT / "tests" / "typed_use.py"
WRONG = {
    "spp: float | None = scene.render.spp": "spp: str = scene.render.spp",
    "vw.simulate(scene)": "vw.simulate(path)",
    "simulator.state]": "simulator.states]",
    "simulator.step(force=(0.0, 5.0, 0.0))": "simulator.step(thrust=(0.0, 5.0, 0.0))",
    "simulation.trajectory.T_w_v(0)": "simulation.course.T_w_v(0)",
    'device="cpu")': 'divice="cpu")',
    "altimeter.range": "altimeter.distance",
    "number: int = first.number": "number: str = first.number",
    "first.A, *": "several.A, *",
    "data.cameras\n": "data.camera\n",
    "error.message": "error.massage",
}
"""What is written in typed_use.py, and a mistake in its place."""


PRODUCT = ROOT / "varos_warp" / "products" / "images" / "transmittance.py"
WRONG_PRODUCT = {
    "def of_hits(self, hits: FirstHits)": "def of_hits(self, hits: FirstHits, more: int)",
    '("distance",), 3, np.float32': '("distance",), "3", np.float32',
    "TRANSMITTANCE_IMAGE = Transmittance()": 'TRANSMITTANCE_IMAGE = Transmittance("T")',
}
"""What is written in an image type, and a mistake in its place."""


def mypy(*arguments) -> tuple[int, str]:
    """Status and output, with the cache that `make lint` leaves."""
    pytest.importorskip("mypy")
    result = subprocess.run([sys.executable, "-m", "mypy", *arguments], cwd=ROOT, text=True, capture_output=True)
    return result.returncode, result.stdout + result.stderr


def test_what_defines_and_what_uses_the_public_api_passes():
    status, said = mypy()
    assert status == 0, said


def test_every_wrong_use_fails(tmp_path):
    """Each mistake is one error, at its line."""
    text = USE.read_text()
    for right, wrong in WRONG.items():
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    (tmp_path / "wrong.py").write_text(text)
    status, said = mypy(tmp_path / "wrong.py")
    assert status == 1
    for wrong in WRONG.values():
        line = text[: text.index(wrong)].count("\n") + 1
        assert f"wrong.py:{line}: error" in said, f"{wrong}: {said}"


def test_an_image_type_that_breaks_its_protocol_fails(tmp_path):
    """With another signature or type, and without a member that has no default."""
    text = PRODUCT.read_text()
    for right, wrong in WRONG_PRODUCT.items():
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    without = PRODUCT.read_text().replace("    letter, content = ", "    letter, contents = ")
    (tmp_path / "wrong.py").write_text(text)
    (tmp_path / "without.py").write_text(without)
    status, said = mypy(tmp_path / "wrong.py", tmp_path / "without.py")
    assert status == 1
    for wrong in WRONG_PRODUCT.values():
        assert f"wrong.py:{text[: text.index(wrong)].count(chr(10)) + 1}: error" in said, f"{wrong}: {said}"
    assert 'abstract attribute "content"' in said


def test_every_public_name_is_used_there():
    text = USE.read_text()
    assert [name for name in varos_warp.__all__ if f"vw.{name}" not in text] == []
