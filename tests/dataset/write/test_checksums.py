"""The list of checksums: read by sha256sum, kept up with the dataset, not fooled by decay."""

import os
import shutil
import subprocess

import pytest
import standins

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import Validation, completeness, validate
from varos_warp.dataset.write import checksums
from varos_warp.errors import InputError


@pytest.fixture
def copy(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")


def png(root, letter, frame):
    return Dataset(root).layout.image("L0", letter, frame)


def test_sha256sum_reads_the_checksums(copy):
    if shutil.which("sha256sum") is None:
        pytest.skip("no sha256sum here")
    run = subprocess.run(["sha256sum", "-c", "--quiet", "checksums"], cwd=copy, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
    png(copy, "A", 4).write_bytes(b"")
    run = subprocess.run(["sha256sum", "-c", "--quiet", "checksums"], cwd=copy, capture_output=True, text=True)
    assert "A-00000004.png: FAILED" in run.stdout


def test_checksums_follow_a_dataset_that_grows(tmp_path):
    for frames, options in (
        (slice(0, 2), {"sensors": False}),
        (slice(0, 4), {"sensors": False}),
        (slice(0, 4), {"images": False}),
    ):
        produce(standins.make_scene(), tmp_path, quiet=True, frames=frames, **options)
        result = validate(tmp_path, quiet=True)
        assert result.problems == []
        assert result.files_hashed == len(checksums.listed_files(tmp_path))


def test_an_unfinished_dataset_has_no_checksums(tmp_path):
    produce(standins.make_scene(), tmp_path, quiet=True, shard=(0, 2))
    assert not (tmp_path / "checksums").exists()


def test_a_damaged_list_of_checksums_is_named(copy):
    (copy / "checksums").write_text("nonsense\n")
    assert "checksums: is not a list of SHA-256 sums" in "\n".join(validate(copy, quiet=True).problems)
    with pytest.raises(InputError):
        checksums.read_checksums(copy)


def test_nobody_vouches_for_a_file_that_decayed(copy):
    """The same time of writing, other bytes."""
    path = png(copy, "B", 4)
    status = path.stat()
    path.write_bytes(path.read_bytes() + b"x")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    with pytest.raises(InputError, match="is not as a run wrote it"):
        checksums.Record(copy).write_checksums()
    found = Validation(copy)
    completeness.check_checksums(Dataset(copy), found, completeness.Pending())
    assert found.problems == [f"{path.relative_to(copy).as_posix()}: is not as it was written: its checksum differs"]
