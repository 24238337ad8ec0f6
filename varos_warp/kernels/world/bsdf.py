"""How a surface scatters light: a diffuse part, Lambertian or rough, and a metal's rough mirror lobe (GGX).

Directions ``v`` (towards the viewer) and ``l`` (towards the light) are unit vectors that point away from the surface.
The lobe is that of Walter et al. (2007) with height-correlated Smith shadowing (Heitz 2014). The factor of Turquin
(2019) accounts for multiple reflections between microfacets, so that a white metal loses no light.
"""

import warp as wp

from varos_warp.kernels.numerics import bilinear, brightest
from varos_warp.kernels.sampling import basis, sample_cosine, sample_hemisphere
from varos_warp.kernels.world.rough_diffuse import rough_diffuse, rough_diffuse_albedo
from varos_warp.kernels.world.texture import Bsdf

wp.set_module_options({"enable_backward": False})

GRAZING = wp.constant(1.0e-3)
"""Smallest cosine of the viewer."""
LEAST_LOBE = wp.constant(0.04)
"""Reflectance of a metal by which its lobe is drawn, at least."""
LEAST_GRAZING = wp.constant(0.02)
"""What Fresnel's term adds to the albedo of a metal's lobe, at least: beyond the fit, black metals are not black."""


@wp.func
def facing(n: wp.vec3, viewer: wp.vec3):
    """The viewer's direction, raised where a smoothed normal faces away from it, so that density and value agree."""
    below = GRAZING - wp.dot(n, viewer)
    if below <= 0.0:
        return viewer
    return wp.normalize(viewer + below * n)


@wp.func
def lobe_alpha(roughness: float):
    """RMS slope of the microfacets (Burley 2012), at least 0.01: below it float32 cannot resolve highlights."""
    return wp.max(roughness * roughness, 0.01)


@wp.func
def smith_lambda(cosine: float, alpha: float):
    """Heitz 2014, equation (72)."""
    c2 = cosine * cosine
    return 0.5 * (wp.sqrt(1.0 + alpha * alpha * wp.max(1.0 - c2, 0.0) / c2) - 1.0)


@wp.func
def ggx(n_h: float, alpha: float):
    """Density of microfacet normals at cosine ``n_h`` [1/sr]."""
    x = 1.0 + (alpha * alpha - 1.0) * n_h * n_h
    return alpha * alpha / (wp.pi * x * x)


@wp.func
def lobe_pdf(n: wp.vec3, viewer: wp.vec3, l: wp.vec3, alpha: float):
    """Density of sample_lobe [1/sr]: visible normals, reflected (Heitz 2018, equation (17))."""
    v = facing(n, viewer)
    n_v = wp.dot(n, v)
    n_h = wp.dot(n, wp.normalize(v + l))
    if n_h <= 0.0:
        return 0.0
    return ggx(n_h, alpha) / (4.0 * n_v * (1.0 + smith_lambda(n_v, alpha)))


@wp.func
def sample_lobe(n: wp.vec3, viewer: wp.vec3, alpha: float, u: float, w: float):
    """Mirror direction about a visible microfacet normal; it may point into the surface.

    Heitz 2018, "Sampling the GGX distribution of visible normals", JCGT 7(4).
    """
    v = facing(n, viewer)
    x, y = basis(n)
    stretched = wp.normalize(wp.vec3(alpha * wp.dot(x, v), alpha * wp.dot(y, v), wp.dot(n, v)))
    t1 = wp.vec3(1.0, 0.0, 0.0)
    if stretched[2] < 0.9999:
        t1 = wp.normalize(wp.vec3(-stretched[1], stretched[0], 0.0))
    t2 = wp.cross(stretched, t1)
    r = wp.sqrt(u)
    p1 = r * wp.cos(wp.tau * w)
    half = 0.5 * (1.0 + stretched[2])
    p2 = (1.0 - half) * wp.sqrt(wp.max(1.0 - p1 * p1, 0.0)) + half * r * wp.sin(wp.tau * w)
    m = p1 * t1 + p2 * t2 + wp.sqrt(wp.max(1.0 - p1 * p1 - p2 * p2, 0.0)) * stretched
    h = wp.normalize(alpha * m[0] * x + alpha * m[1] * y + wp.max(m[2], 1.0e-6) * n)
    return wp.normalize(2.0 * wp.dot(v, h) * h - v)


@wp.func
def lobe_albedo(table: wp.array2d(dtype=float), cosine: float, alpha: float):
    """Albedo of a white lobe without multiple reflections; bilinear in the roots of cosine and alpha."""
    x = wp.sqrt(wp.clamp(cosine, 0.0, 1.0)) * float(table.shape[1] - 1)
    y = wp.clamp(wp.sqrt(alpha), 0.0, 1.0) * float(table.shape[0] - 1)
    return bilinear(table, y, x)


@wp.func
def multiply_reflected(bsdf: Bsdf, E: float):
    """Factor of the lobe for reflections between microfacets, per channel (Turquin 2019); ``E``: its `lobe_albedo`."""
    return wp.vec3(1.0) + ((1.0 - E) / (E * bsdf.metal)) * bsdf.specular


@wp.func
def lobe_eval(table: wp.array2d(dtype=float), bsdf: Bsdf, n: wp.vec3, viewer: wp.vec3, l: wp.vec3):
    """Lobe times the cosine of the light, per channel [1/sr]; Fresnel's term is Schlick's (1994)."""
    n_l = wp.dot(n, l)
    if n_l <= 0.0:
        return wp.vec3(0.0)
    alpha = lobe_alpha(bsdf.roughness)
    v = facing(n, viewer)
    n_v = wp.dot(n, v)
    h = wp.normalize(v + l)
    grazing = wp.pow(1.0 - wp.clamp(wp.dot(v, h), 0.0, 1.0), 5.0)
    F = bsdf.specular + grazing * (wp.vec3(bsdf.metal) - bsdf.specular)
    shadowing = 1.0 / (1.0 + smith_lambda(n_v, alpha) + smith_lambda(n_l, alpha))
    once = ggx(wp.dot(n, h), alpha) * shadowing / (4.0 * n_v)
    return once * wp.cw_mul(F, multiply_reflected(bsdf, lobe_albedo(table, n_v, alpha)))


# -------------------------------------------------------------------------------------------------------- both parts


@wp.func
def diffuse_albedo(bsdf: Bsdf, n: wp.vec3, viewer: wp.vec3):
    """Albedo of the diffuse part, per channel."""
    if bsdf.diffuse_roughness <= 0.0:
        return bsdf.reflectance
    return rough_diffuse_albedo(bsdf.reflectance, bsdf.diffuse_roughness, wp.dot(n, facing(n, viewer)))


@wp.func
def bsdf_albedo(bsdf: Bsdf, n: wp.vec3, viewer: wp.vec3):
    """Albedo of a surface, per channel; of a metal's lobe about."""
    return diffuse_albedo(bsdf, n, viewer) + bsdf.specular


@wp.func
def directional_albedo(table: wp.array2d(dtype=float), bsdf: Bsdf, n: wp.vec3, viewer: wp.vec3):
    """Albedo of a surface seen from a direction, per channel; of a metal's lobe within 0.06.

    What Fresnel's term adds at grazing angles is a fit of Karis (2014), "Physically based shading on mobile".
    """
    albedo = diffuse_albedo(bsdf, n, viewer)
    if bsdf.metal > 0.0:
        n_v = wp.dot(n, facing(n, viewer))
        E = lobe_albedo(table, n_v, lobe_alpha(bsdf.roughness))
        smooth = 1.0 - bsdf.roughness
        peak = wp.min(smooth * smooth, wp.pow(2.0, -9.28 * n_v)) * smooth + 0.0425 - 0.0275 * bsdf.roughness
        grazing = wp.clamp(1.04 * peak - 0.04 + 0.022 * bsdf.roughness, LEAST_GRAZING, E)
        once = (E - grazing) * bsdf.specular + wp.vec3(grazing * bsdf.metal)
        albedo += wp.cw_mul(once, multiply_reflected(bsdf, E))
    return albedo


@wp.func
def lobe_share(bsdf: Bsdf):
    """Fraction of directions drawn from the lobe; black metals have one too, at grazing angles."""
    if bsdf.metal <= 0.0:
        return 0.0
    lobe = wp.max(brightest(bsdf.specular), LEAST_LOBE * bsdf.metal)
    return lobe / wp.max(lobe + brightest(bsdf.reflectance), 1.0e-20)


@wp.func
def uniform_share(bsdf: Bsdf, n: wp.vec3, viewer: wp.vec3):
    """Fraction of a rough diffuse part's directions that are drawn uniformly.

    Seen at grazing angles it reflects low light about as well as high, so that weights of directions drawn by the
    cosine alone would have no bound.
    """
    if bsdf.diffuse_roughness <= 0.0:
        return 0.0
    slant = 1.0 - wp.clamp(wp.dot(n, viewer), 0.0, 1.0)
    return 0.5 * bsdf.diffuse_roughness * slant * slant


@wp.func
def bsdf_eval(table: wp.array2d(dtype=float), bsdf: Bsdf, n: wp.vec3, v: wp.vec3, l: wp.vec3):
    """Scattering function times the cosine of the light, per channel [1/sr]."""
    matte = bsdf.reflectance
    if bsdf.diffuse_roughness > 0.0 and wp.dot(n, l) > 0.0:
        matte = rough_diffuse(bsdf.reflectance, bsdf.diffuse_roughness, n, facing(n, v), l)
    f = (wp.max(wp.dot(n, l), 0.0) / wp.pi) * matte
    if bsdf.metal > 0.0:
        f += lobe_eval(table, bsdf, n, v, l)
    return f


@wp.func
def bsdf_pdf(bsdf: Bsdf, n: wp.vec3, v: wp.vec3, l: wp.vec3):
    """Density of bsdf_sample [1/sr]."""
    share = lobe_share(bsdf)
    cosine = wp.max(wp.dot(n, l), 0.0)
    if bsdf.diffuse_roughness > 0.0 and cosine > 0.0:
        cosine = wp.lerp(cosine, 0.5, uniform_share(bsdf, n, v))
    pdf = (1.0 - share) * cosine / wp.pi
    if share > 0.0:
        pdf += share * lobe_pdf(n, v, l, lobe_alpha(bsdf.roughness))
    return pdf


@wp.func
def bsdf_sample(bsdf: Bsdf, n: wp.vec3, v: wp.vec3, u: float, w: float, choice: float):
    """Direction of light, from the diffuse part or the lobe; it may point into the surface."""
    share = lobe_share(bsdf)
    if choice < share:
        return sample_lobe(n, v, lobe_alpha(bsdf.roughness), u, w)
    if choice < wp.lerp(share, 1.0, uniform_share(bsdf, n, v)):
        return sample_hemisphere(n, u, w)
    return sample_cosine(n, u, w)


@wp.func
def bsdf_weight(table: wp.array2d(dtype=float), bsdf: Bsdf, n: wp.vec3, v: wp.vec3, l: wp.vec3):
    """bsdf_eval over bsdf_pdf for a direction from bsdf_sample; of a Lambertian surface exactly the reflectance."""
    if bsdf.metal <= 0.0 and bsdf.diffuse_roughness <= 0.0:
        return bsdf.reflectance
    return bsdf_eval(table, bsdf, n, v, l) / wp.max(bsdf_pdf(bsdf, n, v, l), 1.0e-20)
