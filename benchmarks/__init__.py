"""Speed and accuracy: scenes, methods, errors, charts. Run in a checkout, for example `python -m benchmarks.bench`."""
