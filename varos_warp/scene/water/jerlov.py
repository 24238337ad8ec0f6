"""Jerlov's water types: absorption and scattering."""

JERLOV = {
    "I": ((0.228, 0.062, 0.018), (0.00122, 0.0017, 0.00381)),
    "IA": ((0.228, 0.0622, 0.0221), (0.00283, 0.00354, 0.00631)),
    "IB": ((0.227, 0.0655, 0.0407), (0.118, 0.122, 0.135)),
    "II": ((0.231, 0.0724, 0.0623), (0.17, 0.177, 0.195)),
    "III": ((0.241, 0.0878, 0.112), (0.278, 0.287, 0.309)),
    "1C": ((0.248, 0.0988, 0.148), (0.416, 0.427, 0.455)),
    "3C": ((0.268, 0.128, 0.2), (0.627, 0.644, 0.686)),
    "5C": ((0.285, 0.159, 0.313), (1.16, 1.19, 1.27)),
    "7C": ((0.301, 0.195, 0.542), (2.03, 2.35, 3.3)),
    "9C": ((0.39, 0.348, 0.943), (2.69, 3.12, 4.39)),
}
"""Absorption and scattering [1/m] of Jerlov's types at 600, 550 and 450 nm, which stand for R, G and B.

Two sources are spliced. IB to 5C are as measured by Williamson and Hollins (2022), Appl. Opt. 61, 9951 (Open
Government Licence v3.0). I, IA, 7C and 9C, which they did not measure, are from Solonenko and Mobley (2015), Appl. Opt.
54, 5392, who inverted Jerlov's attenuation. So scattering jumps where the two meet: from IA to IB it grows 42-fold in
red, 34-fold in green and 21-fold in blue, far more than from one type to the next within a source.
"""
