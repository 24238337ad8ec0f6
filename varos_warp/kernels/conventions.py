"""Conventions of all kernels.

Lengths [m] in float32 relative to the scene's local origin; ``p`` points, ``d`` unit directions of travel of the ray
(from the camera outwards), ``n`` unit normals, ``t`` distance along a ray, ``u`` uniform random numbers in [0, 1).
Light travels against the rays. The scattering cosine is between the directions of propagation before and after, so +1
is straight ahead: light from ``d_light`` (unit, towards the light) scattered into the ray ``d`` has
cos_theta = dot(d, d_light).
Radiance is linear, in W/sr/m^2 per channel.
"""

import warp as wp

FAR = wp.constant(1.0e9)
"""Length of a ray that hits nothing [m]."""

NEAR = wp.constant(1.0e-6)
"""Distances between a ray and a light below this count as this [m]."""

ALL = 1 << 30
"""A bound on scatterings or bounces that is none."""

BLOCK_DIM = 128
"""Threads per block of a launch on a GPU, for kernels that have no launch bounds of their own."""

CPU_FLAGS = " ".join(
    [wp.config.cpu_compiler_flags or "", "-fno-slp-vectorize", "-menable-no-nans", "-Wno-nan-infinity-disabled"]
)
"""Compiler flags of long kernels on a CPU. Vectorising their scalars costs 5 to 10 % of the time on an EPYC. Rays are
tested against boxes by minima and maxima, which are one instruction each where they need not provide for NaN: an eighth
of the time. ``wp.isfinite`` still finds it, as code of a library that is compiled apart."""

LONG_KERNEL = {
    "module": "unique",
    "module_options": {"cpu_compiler_flags": CPU_FLAGS, "fast_math": True},
    "enable_backward": False,
    "launch_bounds": (BLOCK_DIM, 8),
}
"""Options of long kernels (measured on an H200). Their code, 100 to 400 kB, is larger than the instruction caches, and
they wait for it. CUDA's ``fast_math`` (approximate division, roots and functions: 2 units in the last place; for
logarithms near 1 and for sines an absolute error of 4e-7; infinities and NaN are kept) halves the code and the time.
The launch bounds, threads per block and blocks resident at once on a multiprocessor, trade registers for threads that
hide the latency of rays. On a CPU neither has an effect."""

RESIDENT_THREADS = 768
"""Threads of an `in_step_kernel` that are on a multiprocessor of a GPU at once."""


def in_step_kernel(instances: bool) -> dict:
    """Options of long kernels whose blocks stay `in_step`, and so gain from large ones.

    On an H100, blocks of 512 threads take three quarters of the time of 128, 1024 as much again, and 384 a little less
    than 512. A ray among instances keeps its way through their BVH in 128 bytes of shared memory, of which a block has
    48 kB: with them blocks are smaller.
    """
    threads = 256 if instances else 384
    return LONG_KERNEL | {"launch_bounds": (threads, RESIDENT_THREADS // threads)}


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("barrier.sync 0;");
#endif
""")
def in_step():
    """Wait for the other threads of a block, so that its warps run the same code and fetch it once for all.

    Path kernels spent four fifths of their time on an H100 waiting for code, and in step they take half the time; the
    short rounds of B (ambient.py) lose a fifth. Nothing is exchanged, and threads that have ended are not waited for,
    so results do not depend on it. Threads that call it equally often in a round of their loop stay together. On a CPU
    it does nothing.
    """
    ...
