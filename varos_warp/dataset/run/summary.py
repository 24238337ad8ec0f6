"""What a run did, as it tells when it ends."""

from dataclasses import dataclass, field


@dataclass
class Summary:
    """Outcome of a run."""

    out: str
    frames: int
    """Frames asked for."""
    rendered: int = 0
    """Images rendered, of any type and camera."""
    kept: int = 0
    """Images that were there already."""
    complete: bool = True
    """True if every image of the frames asked for is there; False while other shards are missing."""
    seconds: float = 0.0
    device: str | None = None
    messages: list[str] = field(default_factory=list)
    stages: dict[str, float] = field(default_factory=dict)
    """Seconds of each stage (timing.py)."""
    rate: float | None = None
    """Frames of a camera per second, without the first one, which waits for compilers and caches."""
