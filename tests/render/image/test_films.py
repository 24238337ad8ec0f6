"""Taking samples in parts: every sample once, whatever the size of the image, of its parts and of their lists."""

import weakref

import numpy as np
import pytest
import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.film import film as kernel
from varos_warp.render.image import films
from varos_warp.render.image.films import Films


@wp.kernel(enable_backward=False)
def count_samples(first_row: int, film: kernel.Film):
    """A sample is one watt, and another sum is of its number; a pixel's are told apart by that."""
    i = first_row + wp.tid()
    sums = kernel.Sums()
    part = film.batches[i]
    for sample in range(part.begin, part.end):
        sums.multiple += wp.vec3d(wp.float64(1.0))
        sums.odd += wp.vec3d(wp.float64(sample))
    kernel.store(film, i, sums)


@wp.kernel(enable_backward=False)
def count_parts_in_turn(first_row: int, film: kernel.Film):
    """The same, part after part; ``single`` is of the parts that a thread took before, ``lost`` of all by any."""
    i = first_row + wp.tid()
    before = float(0.0)
    while i < film.batches.shape[0]:
        sums = kernel.Sums()
        part = film.batches[i]
        for sample in range(part.begin, part.end):
            sums.multiple += wp.vec3d(wp.float64(1.0))
            sums.odd += wp.vec3d(wp.float64(sample))
        sums.single = wp.vec3d(wp.float64(before))
        sums.lost = 1
        kernel.store(film, i, sums)
        before += 1.0
        i = kernel.next_batch(film)


@pytest.mark.parametrize("shape", [(1, 1), (3, 4), (8, 8), (9, 17), (16, 24)])
@pytest.mark.parametrize(("most", "lot"), [(4, 1 << 22), (1, 7), (256, 1 << 18)])
@pytest.mark.parametrize("sides", [1, 2])
def test_every_sample_is_taken_once(monkeypatch, shape, most, lot, sides):
    monkeypatch.setitem(films.MOST_SAMPLES, "cpu", most)
    monkeypatch.setitem(films.MOST_BATCHES, "cpu", lot)
    monkeypatch.setattr(films, "PIXEL_TILE", 100)
    made = Films(Launcher("cpu", threads=2))
    film = made.black(shape[::-1], adapts=sides == 2)
    rng = np.random.default_rng(1)
    takes = [12, 4 * rng.integers(0, 12, film.count.shape), np.zeros(film.count.shape, int), 4]
    before = 0
    for samples in takes:
        made.take(film, count_samples, {}, samples, before=before)
        before = before + np.broadcast_to(samples, film.count.shape)
    assert film.batches is None or not film.batches.shape[0]
    row, col = np.indices(shape)
    taken = sum(np.broadcast_to(samples, film.count.shape) for samples in takes)
    assert np.array_equal(film.count.numpy(), taken)
    expected = taken[(row // 2 + col // 2) % sides, row // 8, col // 8] // 4
    sums = film.sums.numpy()[..., 0]
    assert np.array_equal(sums[0], expected)
    assert np.array_equal(sums[1], expected * (expected - 1) / 2)


@pytest.mark.parametrize("shape", [(8, 8), (9, 17), (16, 24)])
@pytest.mark.parametrize("most", [1, 4])
def test_of_fewer_samples_than_pixels_each_block_has_its_number_and_what_the_edge_cuts_one_each(
    monkeypatch, shape, most
):
    """Numbers of one side of a tile are its own; pixels of a block that is taken again have none twice."""
    monkeypatch.setitem(films.MOST_SAMPLES, "cpu", most)
    made = Films(Launcher("cpu", threads=2))
    film = made.black(shape[::-1], adapts=True, key=7)
    more = np.random.default_rng(2).choice([0, 1, 2, 3, 7], film.count.shape)
    made.take(film, count_samples, {}, 1)
    made.take(film, count_samples, {}, more, before=1)
    row, col = np.indices(shape)
    of_block = 1 + more[(row // 2 + col // 2) % 2, row // 8, col // 8]
    height, width = (size // 2 * 2 for size in shape)
    sums = film.sums.numpy()[..., 0]
    in_blocks = sums[0, :height, :width].reshape(height // 2, 2, width // 2, 2)
    assert np.array_equal(in_blocks.sum((1, 3)), of_block[:height:2, :width:2])
    assert in_blocks.max((1, 3)).max() == 2
    assert np.all(in_blocks.max((1, 3)) - in_blocks.min((1, 3)) <= 1)
    cut = (row >= height) | (col >= width)
    assert np.array_equal(sums[0][cut], -(-of_block[cut] // 4))
    assert np.array_equal(sums[1], sums[0] * (sums[0] - 1) / 2)


@pytest.mark.parametrize("lot", [7, 1 << 22])
@pytest.mark.parametrize("resident", [1, 5, 1 << 22])
def test_threads_go_on_to_parts_that_none_has_begun(monkeypatch, resident, lot):
    monkeypatch.setitem(films.MOST_SAMPLES, "cpu", 2)
    monkeypatch.setitem(films.MOST_BATCHES, "cpu", lot)
    made = Films(Launcher("cpu", threads=1))  # on a CPU the queue is not for several threads
    made._resident = resident
    film = made.black((9, 17))
    for samples, before in ((3, 0), (5, 3)):
        made.take(film, count_parts_in_turn, {}, 4 * samples, queued=True, before=4 * before)
    sums = film.sums.numpy()[..., 0]
    assert np.array_equal(sums[0], np.full((17, 9), 8))
    assert np.array_equal(sums[1], np.full((17, 9), 28))
    assert film.lost.numpy()[0] == 9 * 17 * (2 + 3)  # pixels, parts of 3 and of 5 samples
    assert sums[3].any() == (resident < min(lot, 2 * 9 * 17))


def test_films_are_black_when_they_are_used_again():
    """As on a GPU."""
    made = Films(Launcher("cpu"))
    made.keeps = True
    film = made.black((5, 3))
    made.take(film, count_samples, {}, 8)
    sums = film.sums
    made.keep(film)
    again = made.black((5, 3))
    assert again.sums is sums
    assert not again.sums.numpy().any()
    assert not again.count.numpy().any()
    assert made.black((5, 3)).sums is not sums


def test_a_cpu_lets_go_of_sums():
    made = Films(Launcher("cpu"))
    film = made.black((5, 3))
    gone = weakref.ref(film.sums)
    made.keep(film)
    assert gone() is None


def test_parts_are_fewer_where_their_numbers_would_not_fit():
    gpu = Films(Launcher("cpu"))
    gpu.device = "cuda:0"
    assert gpu._batch_size(1000) == 1
    assert gpu._batch_size(8 * films.GPU_THREADS) == 4
    assert -(-12_000_000_000 // gpu._batch_size(12_000_000_000)) < 2**30


def test_sums_serve_images_of_either_kind_of_tiles():
    made = Films(Launcher("cpu"))
    made.keeps = True
    film = made.black((20, 12), adapts=True)
    sums = film.sums
    made.keep(film)
    again = made.black((20, 12))
    assert again.sums is sums
    assert (len(film.count), len(again.count)) == (2, 1)
