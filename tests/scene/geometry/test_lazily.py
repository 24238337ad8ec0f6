import threading
from concurrent.futures import ThreadPoolExecutor

from varos_warp.scene.geometry.lazily import once


class Slow:
    def __init__(self, gate):
        self.made, self._gate = 0, gate

    @once
    def value(self):
        """A list."""
        self._gate.wait(10.0)
        self.made += 1
        return [self.made]


def test_threads_that_ask_at_once_get_one_value():
    open_gate = threading.Event()
    open_gate.set()
    slow = Slow(open_gate)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: slow.value, range(8)))
    assert slow.made == 1
    assert all(value is found[0] for value in found)


def test_two_objects_are_made_at_the_same_time():
    """Each waits for the other: one lock for both would never let the second come."""
    both = threading.Barrier(2)
    one, other = Slow(both), Slow(both)
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(lambda slow: slow.value, (one, other))) == [[1], [1]]


def test_what_failed_is_tried_again():
    class Failing:
        tries = 0

        @once
        def value(self):
            self.tries += 1
            if self.tries == 1:
                raise ValueError
            return self.tries

    failing = Failing()
    for _ in range(2):
        try:
            found = failing.value
        except ValueError:
            found = None
    assert found == 2


def test_it_keeps_its_docstring():
    assert Slow.value.__doc__ == "A list."
