"""What a GPU has computed comes to the host while others may use the GPU."""

import threading
from collections import defaultdict
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from varos_warp.device.launcher import Launcher


def test_arrays_are_awaited_and_copied_without_the_turn_and_pinned_memory_is_used_again(monkeypatch):
    """On a stand-in for a GPU, whose copies are done when they are waited for."""
    launcher, pending, waited = object.__new__(Launcher), [], []
    launcher.device, launcher.turn, launcher._unused = "cuda:0", threading.Lock(), defaultdict(list)

    def synchronize(event):
        assert not launcher.turn.locked()
        waited.append(event)
        for target, values in pending:
            target.numpy()[...] = values
        pending.clear()

    stream = SimpleNamespace(record_event=lambda: len(waited))
    monkeypatch.setattr(wp, "get_stream", lambda device: stream)
    monkeypatch.setattr(wp, "copy", lambda target, source: pending.append((target, source.numpy().copy())))
    monkeypatch.setattr(wp, "synchronize_event", synchronize)
    monkeypatch.setattr(wp, "empty", lambda shape, dtype, device, pinned: wp.zeros(shape, dtype, device="cpu"))

    for number in (1.0, 2.0):
        one = wp.full((2, 3), number, dtype=float, device="cpu")
        with launcher.turn:
            (found,) = launcher.fetch(one)
            again, whole = launcher.fetch(one, wp.full((2, 3), 7, dtype=wp.int32, device="cpu"))
            assert launcher.turn.locked()
        np.testing.assert_array_equal(found, np.full((2, 3), number))
        np.testing.assert_array_equal(again, found)
        np.testing.assert_array_equal(whole, np.full((2, 3), 7))
    assert waited == [0, 1, 2, 3]
    assert sorted(len(unused) for unused in launcher._unused.values()) == [1, 1]


def test_a_thread_uses_the_device_while_the_other_is_aside():
    """Never both, and what fails in it is told to who waits; at the end the turn is that of the one who had it."""
    launcher, held, asked = Launcher("cpu"), [], threading.Event()

    def make():
        held.append("thread")
        with launcher.aside():
            asked.set()
        return 7

    with launcher.turn, launcher.meanwhile(make) as made:
        held.append("before")
        with launcher.aside():
            assert asked.wait(10.0)
        held.append("after")
        assert made() == made() == 7
        assert launcher.turn.locked()
    assert held == ["before", "thread", "after"]
    assert not launcher.turn.locked()

    with launcher.turn:
        with pytest.raises(ZeroDivisionError), launcher.meanwhile(lambda: 1 / 0) as made:
            made()
        with pytest.raises(KeyError), launcher.meanwhile(lambda: held.append("left out")):
            raise KeyError
        assert launcher.turn.locked()
