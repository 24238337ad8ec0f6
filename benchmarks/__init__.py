"""Speed against accuracy: scenes, methods, errors, charts; run from a checkout, `python -m benchmarks.bench`."""
