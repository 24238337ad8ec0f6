"""Sweeps of light transport."""

from benchmarks.stability.entry import Sweeps

SWEEPS: Sweeps = ()
