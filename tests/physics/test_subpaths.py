"""Subpaths (flights, directions, roulette: kernels/transport/subpath.py) in slabs, a half space and water without end.

The renderer has no lamp that is a parallel beam and no meter of fluence, so kernels here start and end the subpaths;
what happens in between are the project's own functions. Three channels, three waters, in each run: a wrong weight of
one colour drawn for another shows, and so does one of a direction drawn around the lamp.
"""

import zlib

import numpy as np
import pytest
import warp as wp
from chance import run
from exact_transport import (
    collisions_between,
    diffusion_length,
    fluence,
    half_space_albedo,
    half_space_diffuse_albedo,
    half_space_exitance,
    slab_fluxes,
)

from varos_warp.kernels.conventions import ALL, FAR
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampling import sample_cosine, uniforms
from varos_warp.kernels.transport.subpath import (
    Subpath,
    advance,
    expected_light,
    first_scattering_pdf,
    light_distance,
    light_reach,
    light_share,
    roulette,
    sample_direction,
    sample_first_scattering,
    sample_flight,
    water_vertex,
)
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.phase import hg_eval

pytestmark = pytest.mark.subject("multiple scattering")

VAN_DE_HULST = "van de Hulst (1980), Multiple Light Scattering; "
DOUBLING = "doubling (Wiscombe 1976), 32 streams a hemisphere, in tests/physics/exact_transport.py"
CHANDRASEKHAR = "Chandrasekhar (1960), Radiative Transfer, chapter V; H by iteration of its integral equation"
CASE_ZWEIFEL = "Case and Zweifel (1967), Linear Transport Theory, section 5.2; quadrature of the branch cut"
BATCHES = 64


@wp.func
def set_out(scene: SceneData, p: wp.vec3, d: wp.vec3):
    """Walk of weight 1."""
    walk = Subpath()
    walk.alive = 1
    walk.vertex = water_vertex(p, d)
    walk.throughput = wp.vec3(1.0)
    walk.reach = FAR
    walk.expected_at_start = expected_light(scene, walk)
    return walk


@wp.func
def turned(scene: SceneData, walk: Subpath, lamp_share: float, key: wp.uint32, i: int, dimension: int):
    """With its next direction."""
    return sample_direction(scene, walk, lamp_share, uniforms(key, i, 1, dimension), uniforms(key, i, 2, dimension))


@wp.kernel(enable_backward=False)
def cross(
    scene: SceneData,
    thickness: float,
    cos_in: float,
    lamp_share: float,
    reach: float,
    key: wp.uint32,
    left: wp.array(dtype=wp.vec3),
    cos_out: wp.array(dtype=float),
    head_on: wp.array(dtype=wp.vec3),
):
    """A walk through a slab 0 < z < thickness: its weight where it leaves (0: never), and its radiance along -z.

    ``cos_in`` of its direction to z at the start; 0 for diffuse light.
    """
    i = wp.tid()
    u = uniforms(key, i, 0, 0)
    d = wp.vec3(wp.sqrt(1.0 - cos_in * cos_in), 0.0, cos_in)
    if cos_in == 0.0:
        d = sample_cosine(wp.vec3(0.0, 0.0, 1.0), u[0], u[1])
    walk = set_out(scene, wp.vec3(0.0), d)
    walk.reach = reach
    L = wp.vec3(0.0)
    dimension = int(1)
    while walk.alive == 1:
        hit = Hit()
        hit.face = -1
        z = walk.vertex.p[2]
        dz = walk.vertex.d[2]
        hit.t = wp.where(dz > 0.0, thickness - z, z) / wp.max(wp.abs(dz), 1.0e-9)
        moved = advance(scene, walk, hit, walk.vertex, ALL, 0, uniforms(key, i, 0, dimension))
        if moved.scatterings == walk.scatterings:
            left[i] = moved.throughput
            cos_out[i] = dz
        walk = moved
        if walk.alive == 1:
            up = hg_eval(1.0 + walk.vertex.d[2], scene.medium.phase.g)
            L += up * wp.cw_mul(walk.throughput, transmittance(scene.medium, walk.vertex.p[2]))
            walk = turned(scene, walk, lamp_share, key, i, dimension)
        dimension += 1
    head_on[i] = L


@wp.func
def fly_on(scene: SceneData, walk: Subpath, u: wp.vec4):
    """To the next scattering by a free flight, with a roulette that follows the weight alone."""
    moved = walk
    flight = sample_flight(scene.medium, walk.throughput, FAR, u[0], u[1])
    moved.throughput = wp.cw_mul(walk.throughput, flight.weight)
    moved.vertex = water_vertex(walk.vertex.p + flight.t * walk.vertex.d, walk.vertex.d)
    survival = wp.min(brightest(moved.throughput), 1.0)
    moved.alive = wp.where(u[2] < survival, 1, 0)
    moved.throughput /= survival
    return moved


@wp.kernel(enable_backward=False)
def wander(
    scene: SceneData,
    isotropic: int,
    lamp_share: float,
    key: wp.uint32,
    edges: wp.array(dtype=float),
    scattered: wp.array3d(dtype=wp.float64),
    sums: wp.array2d(dtype=wp.vec3),
):
    """A walk in water without end, from the origin: weights scattered, by shell of distance and batch; per walk their
    sum, and their sums times z and r^2.
    """
    i = wp.tid()
    u = uniforms(key, i, 0, 0)
    d = wp.vec3(0.0, 0.0, 1.0)
    if isotropic == 1:
        z = 1.0 - 2.0 * u[0]
        s = wp.sqrt(1.0 - z * z)
        d = wp.vec3(s * wp.cos(wp.tau * u[1]), s * wp.sin(wp.tau * u[1]), z)
    walk = set_out(scene, wp.vec3(0.0), d)
    dimension = int(1)
    while walk.alive == 1:
        u = uniforms(key, i, 0, dimension)
        walk = fly_on(scene, walk, u)
        if walk.alive == 1:
            p = walk.vertex.p
            sums[i, 0] = sums[i, 0] + walk.throughput
            sums[i, 1] = sums[i, 1] + p[2] * walk.throughput
            sums[i, 2] = sums[i, 2] + wp.dot(p, p) * walk.throughput
            r = wp.length(p)
            if r < edges[edges.shape[0] - 1]:
                shell = wp.lower_bound(edges, r) - 1
                for c in range(3):
                    wp.atomic_add(scattered, i % scattered.shape[0], shell, c, wp.float64(walk.throughput[c]))
            walk = turned(scene, walk, lamp_share, key, i, dimension)
        dimension += 1


@wp.kernel(enable_backward=False)
def hop(
    scene: SceneData,
    flights: int,
    lamp_share: float,
    key: wp.uint32,
    p: wp.array(dtype=wp.vec3),
    d: wp.array(dtype=wp.vec3),
    weight: wp.array(dtype=wp.vec3),
):
    """A walk of so many free flights along +z first, with a turn after each: end, direction then, and weight."""
    i = wp.tid()
    walk = set_out(scene, wp.vec3(0.0), wp.vec3(0.0, 0.0, 1.0))
    for k in range(flights):
        u = uniforms(key, i, 0, k)
        flight = sample_flight(scene.medium, walk.throughput, FAR, u[0], u[1])
        walk.throughput = wp.cw_mul(walk.throughput, flight.weight)
        walk.vertex = water_vertex(walk.vertex.p + flight.t * walk.vertex.d, walk.vertex.d)
        p[i] = walk.vertex.p
        walk = turned(scene, walk, lamp_share, key, i, k)
    d[i] = walk.vertex.d
    weight[i] = walk.throughput


@wp.kernel(enable_backward=False)
def fly(
    scene: SceneData,
    t_max: float,
    near_share: float,
    key: wp.uint32,
    scattered: wp.array(dtype=wp.vec3),
    passed: wp.array(dtype=wp.vec3),
    first: wp.array(dtype=wp.vec3),
):
    """A flight up to t_max: its weight if it ends in the water, or at t_max; and the weight of a first scattering."""
    i = wp.tid()
    u = uniforms(key, i, 0, 0)
    flight = sample_flight(scene.medium, wp.vec3(1.0, 0.5, 0.7), t_max, u[0], u[1])
    if flight.t < t_max:
        scattered[i] = flight.weight
    else:
        passed[i] = flight.weight
    near = light_distance(scene, wp.vec3(0.0))
    t = sample_first_scattering(scene.medium, near, near_share, t_max, u[2], u[3])
    pdf = first_scattering_pdf(scene.medium, near, near_share, t_max, t)
    first[i] = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t)) / pdf


@wp.kernel(enable_backward=False)
def growth(most: float, weights: wp.array(dtype=float)):
    """What a subpath weighs more after so many directions that none of its lights was near, without roulette."""
    path = Subpath()
    weight = float(1.0)
    for n in range(weights.shape[0]):
        path.scatterings = (n + 2) / 2
        path.bounces = (n + 1) / 2
        weight /= 1.0 - light_share(path, most)
        weights[n] = weight


@wp.kernel(enable_backward=False)
def survive(
    scene: SceneData,
    vertices: int,
    brightness: float,
    reach: float,
    u: wp.array(dtype=float),
    after: wp.array(dtype=float),
):
    """Throughput after roulette of a subpath of 1 whose expected light is ``brightness`` of that at the start.

    It is 1 m from the lamp.
    """
    i = wp.tid()
    path = set_out(scene, wp.vec3(0.0, 0.0, 1.0), wp.vec3(0.0, 0.0, 1.0))
    path.scatterings = vertices
    path.reach = reach
    path.expected_at_start /= brightness
    path = roulette(scene, path, u[i])
    after[i] = wp.where(path.alive == 1, path.throughput[0], 0.0)


@wp.kernel(enable_backward=False)
def reaches(scene: SceneData, face: int, p: wp.array(dtype=wp.vec3), reach: wp.array(dtype=float)):
    """`light_reach` of camera's rays that end at places."""
    i = wp.tid()
    hit = Hit()
    hit.face = face
    hit.p = p[i]
    reach[i] = light_reach(scene, hit)


@wp.kernel(enable_backward=False)
def wander_off(scene: SceneData, reach: float, key: wp.uint32, vertices: wp.array(dtype=int)):
    """How many vertices a subpath has in water without end, from 1 m beside the lamp on."""
    i = wp.tid()
    path = set_out(scene, wp.vec3(0.0, 0.0, 1.0), wp.vec3(0.0, 0.0, 1.0))
    path.reach = reach
    hit = Hit()
    hit.face = -1
    hit.t = FAR
    dimension = int(0)
    while path.alive == 1:
        path = advance(scene, path, hit, path.vertex, ALL, 0, uniforms(key, i, 0, dimension))
        if path.alive == 1:
            path = turned(scene, path, 0.0, key, i, dimension)
        dimension += 1
    vertices[i] = dimension


# ------------------------------------------------------------------------------------------------------------- helpers


def scene_of(sigma_s, sigma_t, g, lamp=(0.0, 0.0, 0.0)) -> SceneData:
    """Water and a lamp that walks may look for; per channel."""
    light = Light()
    light.position, light.axis, light.cos_half = wp.vec3(*lamp), wp.vec3(0.0, 0.0, 1.0), -1.0
    light.intensity = wp.vec3(1.0)
    scene = SceneData()
    scene.medium.sigma_s, scene.medium.sigma_t, scene.medium.phase.g = wp.vec3(*sigma_s), wp.vec3(*sigma_t), g
    scene.lights = wp.array([light], dtype=Light, device="cpu")
    return scene


def launched(kernel, n, inputs, *outputs):
    """Run n walks; outputs are given as (dtype, shape)."""
    made = [wp.zeros(shape, dtype=dtype, device="cpu") for dtype, shape in outputs]
    wp.launch(kernel, n, inputs=[*inputs, *made], device="cpu")
    return [array.numpy().astype(float) for array in made]


def key_of(*parameters):
    """Random numbers of its own for each setting: runs that share them would all be off to the same side."""
    return wp.uint32(zlib.crc32(repr(parameters).encode()))


def crossed(albedo, tau, g, *, cos_in=1.0, lamp_share=0.0, reach=FAR, lamp=(0.0, 0.0, -10.0), n=1 << 19):
    """Of walks through a slab 1 m thick: weights reflected, transmitted [n, 3], cosine out [n], radiance along -z.

    The lamp is far, so that all parts of a layer are alike to it.
    """
    albedo, tau = np.broadcast_to(albedo, 3), np.broadcast_to(tau, 3)
    scene = scene_of(albedo * tau, tau, g, lamp)
    inputs = [scene, 1.0, cos_in, lamp_share, reach, key_of(albedo.tolist(), tau.tolist(), g, cos_in, lamp_share)]
    left, cos_out, head_on = launched(cross, n, inputs, (wp.vec3, n), (float, n), (wp.vec3, n))
    return left * (cos_out < 0)[:, None], left * (cos_out > 0)[:, None], cos_out, head_on


def estimate(samples, precision=0.02) -> dict:
    """Mean and standard error over the walks, as a truth takes them, and what float32 may add to a weight."""
    mean, stderr = samples.mean(axis=0), samples.std(axis=0) / np.sqrt(len(samples))
    assert stderr < precision * abs(mean), f"too noisy to tell: {stderr / mean}"
    return {"got": mean, "stderr": stderr, "tolerance": 1e-5 * abs(mean), "reason": "float32 rounding"}


# --------------------------------------------------------------------------------------------------------------- slabs


def test_a_slab_reflects_and_transmits_what_is_published(truth):
    """The one slab that every Monte Carlo program of the field is tested with."""
    back, through, _, head_on = crossed(0.9, 2.0, 0.75, n=1 << 20)
    published = {"source": VAN_DE_HULST + "also Wang, Jacques and Zheng (1995), MCML, table 1"}
    for name, weights, expected in (("reflects", back, 0.09739), ("transmits", through, 0.66096)):
        made = estimate(weights[:, 0]) | {"tolerance": 5e-6, "reason": "its five printed digits"}
        truth(f"{name}, albedo 0.9, g = 0.75, tau = 2, straight on", expected=expected, **made, **published)
    truth(
        "radiance straight back per irradiance [1/sr], the same slab",
        source=DOUBLING,
        expected=slab_fluxes(0.9, 0.75, 2.0)["brdf"],
        **estimate(head_on[:, 0]),
    )


SLABS = {
    "three albedos, g = 0.75": ((0.5, 0.9, 0.99), (2.0, 2.0, 2.0), 0.75),
    "three waters, g = 0.8": ((0.9, 0.99, 1.0), (1.0, 1.5, 2.5), 0.8),
    "three waters, g = -0.5": ((0.3, 0.8, 0.95), (0.5, 1.0, 2.0), -0.5),
    "three waters, g = 0": ((0.7, 0.9, 1.0), (2.0, 1.0, 0.3), 0.0),
}


@pytest.mark.parametrize("lamp_share", [0.0, 0.1])
@pytest.mark.parametrize("name", SLABS)
def test_slabs_of_any_water_reflect_and_transmit_what_doubling_says(truth, name, lamp_share):
    """Also when some directions are drawn around a lamp: only their weights know."""
    albedo, tau, g = SLABS[name]
    drawn = ", directions drawn around a lamp too" if lamp_share > 0 else ""
    for beam, cos_in in (("", 1.0), ("_diffuse", 0.0)):
        back, through, *_ = crossed(albedo, tau, g, cos_in=cos_in, lamp_share=lamp_share)
        for c in range(3):
            exact = slab_fluxes(albedo[c], g, tau[c])
            what = f"albedo {albedo[c]}, g = {g}, tau = {tau[c]}, {'diffuse' if beam else 'straight on'}{drawn}"
            truth(f"reflects, {what}", source=DOUBLING, expected=exact["R" + beam], **estimate(back[:, c]))
            truth(f"transmits, {what}", source=DOUBLING, expected=exact["T" + beam], **estimate(through[:, c]))


@pytest.mark.parametrize("reach", [FAR, 0.75])
def test_roulette_loses_no_light_in_a_slab_that_absorbs_nothing(truth, reach):
    """Each walk leaves with some weight or is ended; on average 1 is left. The second lamp is next to the slab."""
    where = {"lamp": (0.0, 0.0, -0.2)} if reach < FAR else {}
    back, through, *_ = crossed((1.0, 1.0, 1.0), (0.5, 2.0, 4.0), 0.5, reach=reach, **where)
    near = ", out of reach of the lamp beyond 0.75 m" if where else ""
    for c, tau in enumerate((0.5, 2.0, 4.0)):
        truth(
            f"R + T, albedo 1, g = 0.5, tau = {tau}{near}",
            source="energy is conserved",
            expected=1.0,
            **estimate((back + through)[:, c]),
        )


# ---------------------------------------------------------------------------------------------------------- half space


DEEP, ABOVE = 30.0, (0.0, 0.0, -1.0)
"""A slab from whose far side next to nothing returns: exp(-2 * 30/nu_0) = 1e-14 at c = 0.9; and a lamp over it."""


@pytest.mark.parametrize("cos_in", [1.0, 0.4, 0.0])
def test_a_half_space_of_isotropic_scattering_has_chandrasekhars_albedo(truth, cos_in):
    albedo = (0.5, 0.8, 0.9)
    back, *_ = crossed(albedo, DEEP, 0.0, cos_in=cos_in, lamp=ABOVE)
    for c in range(3):
        if cos_in == 0.0:
            truth(
                f"albedo for diffuse light, c = {albedo[c]}",
                source=CHANDRASEKHAR,
                expected=half_space_diffuse_albedo(albedo[c]),
                **estimate(back[:, c]),
            )
        else:
            truth(
                f"albedo for a beam with cosine {cos_in}, c = {albedo[c]}",
                source=CHANDRASEKHAR,
                expected=half_space_albedo(albedo[c], cos_in),
                **estimate(back[:, c]),
            )


def test_light_leaves_a_half_space_with_the_angles_of_the_h_function(truth):
    albedo, edges = (0.5, 0.8, 0.9), np.linspace(0.0, 1.0, 6)
    back, _, cos_out, _ = crossed(albedo, DEEP, 0.0, lamp=ABOVE)
    bins = np.digitize(-cos_out, edges) - 1
    for c in range(3):
        exact = half_space_exitance(albedo[c], 1.0, edges)
        for k in range(5):
            truth(
                f"share that leaves with cosines {edges[k]:.1f} to {edges[k + 1]:.1f}, beam straight on, "
                f"c = {albedo[c]}",
                source=CHANDRASEKHAR,
                expected=exact[k],
                **estimate(back[:, c] * (bins == k)),
            )


# ----------------------------------------------------------------------------------------------------- infinite medium


def wandered(sigma_s, sigma_t, g, *, isotropic, lamp_share=0.0, edges=(0.0, 1.0), n=1 << 17):
    """Scattered weights [BATCHES, shells, 3] per walk of each batch, and sums [n, 3, 3] of `wander`."""
    key = key_of(np.asarray(sigma_s).tolist(), sigma_t, g, isotropic, lamp_share)
    edges = wp.array(np.asarray(edges, np.float32), dtype=float, device="cpu")
    inputs = [scene_of(sigma_s, sigma_t, g), int(isotropic), lamp_share, key, edges]
    shells, sums = launched(wander, n, inputs, (wp.float64, (BATCHES, len(edges) - 1, 3)), (wp.vec3, (n, 3)))
    return shells * BATCHES / n, sums


@pytest.mark.parametrize("lamp_share", [0.0, 0.5])
def test_fluence_around_a_point_source_is_that_of_case_and_zweifel(truth, lamp_share):
    """By shells: the weight scattered there is sigma_s times the fluence, integrated over the shell."""
    albedo, edges = (0.3, 0.5, 0.9), np.array([0.0, 0.05, 0.2, 0.5, 1.0, 2.0, 4.0, 7.0])
    shells, _ = wandered(albedo, (1.0,) * 3, 0.0, isotropic=True, lamp_share=lamp_share, edges=edges)
    drawn = ", directions drawn around a lamp too" if lamp_share > 0 else ""
    for c in range(3):
        expected = albedo[c] * collisions_between(albedo[c], edges)
        # the last shell of the darkest water is too noisy to tell
        for k in range(len(expected) - (c == 0)):
            where = f"{edges[k]} to {edges[k + 1]} mean free paths from the source"
            truth(
                f"light scattered {where}, c = {albedo[c]}{drawn}",
                source=CASE_ZWEIFEL,
                expected=expected[k],
                **estimate(shells[:, k, c]),
            )


def test_the_oracle_of_the_infinite_medium_has_its_published_numbers(truth):
    """Diffusion lengths of the textbooks' tables; and the light absorbed is the light sent out."""
    for c, length in ((0.5, 1.04438203376), (0.9, 1.90320485605), (0.99, 5.79672945130)):
        truth(
            f"diffusion length nu_0 [1/sigma_t], c = {c}",
            source="an independent evaluation; Fourier inversion",
            expected=length,
            got=diffusion_length(c),
            tolerance=1e-10,
            reason="its printed digits",
        )
    for (c, r), published in {
        (0.5, 0.1): 8.0321037501,
        (0.5, 5): 1.291324139e-4,
        (0.9, 1): 0.14328386153,
        (0.99, 10): 0.0041850923551,
    }.items():
        truth(
            f"fluence at {r} from the source, c = {c}",
            source="an independent evaluation; Fourier inversion",
            expected=published,
            got=fluence(c, r),
            tolerance=1e-9 * published,
            reason="its printed digits",
        )


@pytest.mark.parametrize(("g", "lamp_share"), [(0.0, 0.0), (0.8, 0.0), (0.8, 0.3), (-0.6, 0.3)])
def test_a_photon_collides_one_over_one_minus_albedo_times(truth, g, lamp_share):
    """That is: all light is absorbed in the end, however walks look for lamps and play roulette."""
    albedo = np.array([0.2, 0.5, 0.8])
    _, sums = wandered(albedo * (1.0, 0.5, 2.0), (1.0, 0.5, 2.0), g, isotropic=False, lamp_share=lamp_share)
    for c in range(3):
        truth(
            f"mean number of collisions, albedo {albedo[c]}, g = {g}, {lamp_share:.0%} of directions around a lamp",
            source="geometric series: 1/(1 - c)",
            expected=1 / (1 - albedo[c]),
            **estimate(sums[:, 0, c] / albedo[c]),
        )


def test_light_of_a_beam_is_absorbed_where_the_moments_say(truth):
    """Red and green of the paper's water and a third: <z> = 1/(st - g ss), <r^2> = 2/(sa (st - g ss)), exactly."""
    sigma_s, sigma_t, g = np.array([0.00175, 0.01825, 0.04]), np.array([0.125, 0.057989, 0.1]), 0.8
    _, sums = wandered(sigma_s, sigma_t, g, isotropic=False, lamp_share=0.0, n=1 << 18)
    source = "moments of the transport equation (exact)"
    for c, name in enumerate(("red", "green", "sigma_s = 0.04, sigma_t = 0.1")):
        absorbed = sums[:, :, c] * (sigma_t - sigma_s)[c] / sigma_s[c]
        transport = sigma_t[c] - g * sigma_s[c]
        truth(f"mean depth [m], {name}", source=source, expected=1 / transport, **estimate(absorbed[:, 1]))
        truth(
            f"mean square distance [m^2], {name}",
            source=source,
            expected=2 / ((sigma_t - sigma_s)[c] * transport),
            **estimate(absorbed[:, 2]),
        )


# --------------------------------------------------------------------------------------------- flights and turns alone


@pytest.mark.parametrize("flights", [1, 2, 5])
def test_a_walk_of_n_flights_gets_as_far_as_its_moments_say(truth, flights):
    """<z> = (1 - g^n)/(1 - g), <r^2> = 2 (n/(1 - g) - g (1 - g^n)/(1 - g)^2), in mean free paths of each channel."""
    g, sigma, n = 0.8, np.array([1.0, 1.3, 0.8]), 1 << 17
    p, _, weight = launched(hop, n, [scene_of(sigma, sigma, g), flights, 0.0, key_of(flights)], *[(wp.vec3, n)] * 3)
    z = (1 - g**flights) / (1 - g)
    r2 = 2 * (flights / (1 - g) - g * (1 - g**flights) / (1 - g) ** 2)
    for c in range(3):
        far = weight[:, c] * sigma[c] * p[:, 2], weight[:, c] * sigma[c] ** 2 * (p**2).sum(axis=1)
        for name, samples, expected in zip(("mean depth", "mean square distance"), far, (z, r2), strict=True):
            truth(
                f"{name} after {flights} flights, g = {g}, channel of sigma = {sigma[c]}",
                source="moments of the random walk (exact)",
                expected=expected,
                **estimate(samples),
            )


@pytest.mark.parametrize(("g", "lamp_share"), [(0.8, 0.0), (0.8, 0.5), (-0.5, 0.5), (0.0, 0.5)])
def test_the_mean_cosine_after_n_scatterings_is_g_to_the_n(truth, g, lamp_share):
    n = 1 << 17
    for turns in (1, 2, 3):
        scene = scene_of((1.0,) * 3, (1.0,) * 3, g, (0.5, 0.0, 1.0))
        _, d, weight = launched(hop, n, [scene, turns, lamp_share, key_of(g, turns, lamp_share)], *[(wp.vec3, n)] * 3)
        how = f"g = {g}, {turns} scatterings, {lamp_share:.0%} of directions around a lamp"
        if g != 0.0:
            truth(
                f"mean cosine, {how}",
                source="addition theorem: g^n",
                expected=g**turns,
                **estimate(weight[:, 0] * d[:, 2]),
            )
        truth(f"mean weight, {how}", source="the phase function is normalised", expected=1.0, **estimate(weight[:, 0]))
        assert weight.min() > 0.0


@pytest.mark.parametrize("most", [0.03, 0.5, 1.0])
def test_weights_grow_no_faster_than_the_vertices_however_many(most):
    """Directions around the lights: the product of 1/(1 - share) over n vertices is n + 1 at most.

    With half of all directions towards the lamps the rest would weigh 2^n after n: 10^6 after 20.
    """
    n = np.arange(1, 2001)
    (weights,) = launched(growth, 1, [most], (float, len(n)))
    rounding = 1 + 2e-7 * n  # a division and a product of float32 each
    assert np.all(weights <= (n + 1) * rounding)
    assert np.all(np.diff(weights) > 0)
    if most >= 0.5:
        np.testing.assert_allclose(weights / (n + 1), 1.0, atol=(rounding - 1).max())


@pytest.mark.parametrize("vertices", [1, 2, 10, 100, 1000])
@pytest.mark.parametrize("brightness", [1e-6, 0.3, 0.6, 1.0, 1e6])
def test_roulette_keeps_the_mean_and_its_bounds(vertices, brightness):
    """Survival is the light's share of that at the start, between 0.3 and the larger of 0.9 and 1 - 4/n."""
    n = 1 << 16
    u = (np.arange(n) + 0.5) / n
    after = run(survive, [scene_of((1.0,) * 3, (1.0,) * 3, 0.0), vertices, brightness, FAR, u], [float]).astype(float)
    most = max(0.9, 1 - 4 / vertices)
    survival = min(max(brightness, 0.3), most)
    assert (after > 0).mean() == pytest.approx(survival, abs=1 / n)
    np.testing.assert_allclose(after[after > 0], 1 / survival, rtol=1e-6)
    assert after.mean() == pytest.approx(1.0, abs=2 / n / survival)


@pytest.mark.parametrize(("reach", "expected"), [(2.0, 1.0), (1.0, 1.0), (0.9, 0.9**4), (0.5, 0.3)])
def test_roulette_ends_what_is_out_of_the_reach_of_the_lights(reach, expected):
    """With the fourth power of the distance, and the same bounds; the mean is kept."""
    n = 1 << 16
    u = (np.arange(n) + 0.5) / n
    after = run(survive, [scene_of((1.0,) * 3, (1.0,) * 3, 0.0), 1, 1.0, reach, u], [float]).astype(float)
    assert (after > 0).mean() == pytest.approx(min(expected, 0.9), abs=1 / n)
    assert after.mean() == pytest.approx(1.0, abs=2 / n / 0.3)


@pytest.mark.parametrize(
    ("sigma_t", "distance", "expected"),
    [
        ((1.0, 2.0, 3.0), 1.5, 3.0),  # three mean free paths of the clearest channel
        ((1.0, 2.0, 3.0), 5.0, 5.0),  # as far as what the camera sees
        ((1.0, 2.0, 3.0), 0.5, 1.5),  # but at most three times as far
        ((0.0, 2.0, 3.0), 0.5, 1.5),
        ((0.5, 2.0, 3.0), None, 6.0),  # water alone
    ],
)
def test_the_reach_of_the_lights(sigma_t, distance, expected):
    p, face = np.array([[0.0, 0.0, distance or 1.0]]), -1 if distance is None else 0
    assert run(reaches, [scene_of((0.0,) * 3, sigma_t, 0.0), face, p], [float])[0] == pytest.approx(expected, rel=1e-6)


def test_subpaths_end_soon_in_open_water_that_absorbs_nothing():
    """Blue of the paper's water: the threads of a GPU wait for the longest of them."""
    n = 1 << 16
    scene = scene_of((0.043125,) * 3, (0.043125,) * 3, 0.8)
    near, everywhere = (launched(wander_off, n, [scene, reach, key_of(reach)], (int, n))[0] for reach in (10.0, FAR))
    assert near.mean() < 4.0
    assert np.quantile(near, 0.999) < 30.0
    assert everywhere.mean() > 3.0 * near.mean()  # what it would be without


def test_weights_of_survivors_grow_as_a_power_of_the_vertices():
    """The product of 1/(1 - 4/n) is about (n/40)^4 times 0.9^-40, where light stays as bright as at the start."""
    n = np.arange(1, 1001)
    u = np.zeros(1)
    scene = scene_of((1.0,) * 3, (1.0,) * 3, 0.0)
    weights = np.cumprod([float(run(survive, [scene, int(k), 1e6, FAR, u], [float])[0]) for k in n])
    assert np.all(weights[40:] <= 0.9**-40 * (n[40:] / 36.0) ** 4 * (1 + 2e-7 * n[40:]))


@pytest.mark.parametrize(("t_max", "near_share"), [(0.1, 0.5), (1.0, 0.5), (5.0, 0.5), (1.0, 0.1), (1.0, 0.0)])
@pytest.mark.subject("single scattering")
def test_a_beam_is_attenuated_and_scattered_as_beer_and_lambert_say(truth, t_max, near_share):
    """Weights of flights of one channel drawn for all three; and of first scatterings."""
    n, sigma_s, sigma_t = 1 << 17, np.array([0.3, 0.1, 1.0]), np.array([0.5, 0.9, 1.0])
    scene = scene_of(sigma_s, sigma_t, 0.0, (0.2, 0.0, 0.5))
    inputs = [scene, t_max, near_share, key_of(t_max, near_share)]
    scattered, passed, first = launched(fly, n, inputs, *[(wp.vec3, n)] * 3)
    for c in range(3):
        T = np.exp(-sigma_t[c] * t_max)
        what = f"{t_max} m, sigma_s = {sigma_s[c]}, sigma_t = {sigma_t[c]}"
        share = sigma_s[c] / sigma_t[c] * (1 - T)
        truth(f"transmittance, {what}", source="exp(-sigma_t t)", expected=T, **estimate(passed[:, c]))
        truth(f"share scattered, {what}", source="c (1 - exp(-sigma_t t))", expected=share, **estimate(scattered[:, c]))
        truth(
            f"share scattered, {what}, {near_share:.0%} of first scatterings near a lamp",
            source="c (1 - exp(-sigma_t t))",
            expected=share,
            **estimate(first[:, c]),
        )
