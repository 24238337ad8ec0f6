"""Bodies on the device, of frames that are under way side by side."""

import threading

from varos_warp.device.launcher import Launcher
from varos_warp.render.particles.snow import Drawn


def test_frames_side_by_side_fetch_their_bodies_at_once(monkeypatch):
    """Whoever waits for a copy gives the device away: it may hold nothing that another frame needs for its own."""
    launcher, both, known = Launcher("cpu"), threading.Barrier(2), []

    def fetch(*arrays):
        with launcher.aside():
            both.wait(5.0)
        return list(arrays)

    def ask(drawn):
        with launcher.turn:
            known.append(drawn.on_host.added)

    monkeypatch.setattr(launcher, "fetch", fetch)
    frames = [Drawn(launcher, {"added": k, "passed": 1.0}) for k in range(2)]
    threads = [threading.Thread(target=ask, args=(frame,), daemon=True) for frame in frames]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10.0)
    assert sorted(known) == [0, 1]
