"""What every kernel agrees on.

Lengths [m] in float32 relative to the scene's local origin; ``p`` points, ``d`` unit directions of travel of the ray
(from the camera outwards), ``n`` unit normals, ``t`` distance along a ray, ``u`` uniform random numbers in [0, 1).
Light travels against the rays. A scattering cosine is between the propagation directions before and after, so +1 is
straight on: light coming from ``d_light`` (unit, towards the light) into the ray ``d`` has cos_theta = dot(d, d_light).
Radiance is linear, in W/sr/m^2 per channel.
"""

import warp as wp

FAR = wp.constant(1.0e9)
"""Length of a ray that hits nothing [m]."""

NEAR = wp.constant(1.0e-6)
"""Smallest distance between a ray and a light that is told apart from zero [m]."""

ALL = 1 << 30
"""As a bound on scatterings or bounces: none."""

BLOCK_DIM = 128
"""Threads per block of every launch on a GPU."""

RESIDENT_BLOCKS = 8
"""Blocks of a long kernel that a GPU's processor is to hold at once."""

CPU_FLAGS = f"{wp.config.cpu_compiler_flags or ''} -fno-slp-vectorize".strip()
"""For the path kernel: joining its scalars to vectors costs more than it saves, 5 to 10 % on an EPYC."""

LONG_KERNEL = {
    "module": "unique",
    "module_options": {"cpu_compiler_flags": CPU_FLAGS, "fast_math": True},
    "enable_backward": False,
    "launch_bounds": (BLOCK_DIM, RESIDENT_BLOCKS),
}
"""Of kernels that follow light for long, measured on an H200. They wait for their own code: 100 to 400 kB, more than
fits close to the cores. Approximate division, roots and functions (``fast_math`` of CUDA: 2 units in the last place, of
logarithms near 1 and of sines 4e-7 in all; infinities and NaN stay what they are) halve it and the time. The launch
bounds trade registers for threads that hide the latency of rays. Neither means anything on a CPU."""
