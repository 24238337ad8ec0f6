"""Calibration files of other programs: the intrinsics, distortion and resolution of their cameras."""
