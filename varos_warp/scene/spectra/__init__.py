"""Light by wavelength: spectra of water, lamps, surfaces and cameras, and the bands that stand for them."""
