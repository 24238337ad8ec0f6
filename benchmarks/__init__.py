"""Speed against accuracy: scenes, methods, errors, charts; run from a checkout, as `varos-warp bench`."""
