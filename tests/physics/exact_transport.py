"""Exact solutions of light transport in plane and infinite media, by deterministic methods: oracles for random walks.

Lengths in units of 1/sigma_t; ``c`` is the albedo sigma_s/sigma_t.
"""

from functools import cache
from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import eval_legendre

# ------------------------------------------------------------------------------------------------- slabs, by doubling

HEAD_ON = 1e-9
"""Weight of the node at normal incidence: it shares in no sum, and its own reflection is a radiance per weight."""


def half_range(n):
    """Gauss-Legendre nodes and weights on (0, 1), and a last node at 1 (normal incidence)."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return np.append(0.5 * (nodes + 1), 1.0), np.append(0.5 * weights, HEAD_ON)


def thin_layer(c, g, mu, weights, thickness):
    """Reflection and transmission of radiance by a layer that scatters next to nothing (diamond initialisation).

    Wiscombe (1976), "On initialization, error and flux conservation in the doubling method", section 3.
    """
    orders = np.arange(2 * len(mu) - 2)
    P = np.array([eval_legendre(l, mu) for l in orders])
    strength = (2 * orders + 1) * g**orders
    forward = P.T @ (strength[:, None] * P)
    backward = P.T @ ((strength * (-1.0) ** orders)[:, None] * P)
    identity = np.eye(len(mu))
    along = (identity - 0.5 * c * forward * weights) / mu[:, None] * 0.5 * thickness
    against = 0.5 * c * backward * weights / mu[:, None] * 0.5 * thickness
    G = np.linalg.inv(identity + along - against @ np.linalg.solve(identity + along, against))
    return 2.0 * G @ against @ np.linalg.inv(identity + along), 2.0 * G - identity


@cache
def slab(c, g, tau, n=32, doublings=22):
    """A layer of optical thickness ``tau`` that scatters as Henyey and Greenstein, without boundaries (m = 0).

    Returns:
        mu [n + 1], weights [n + 1], R, T [n + 1, n + 1]: radiance out of direction i is the sum over j of R_ij (back)
        and T_ij (through) times the radiance that comes in from j.
    """
    mu, weights = half_range(n)
    R, T = thin_layer(c, g, mu, weights, tau / 2.0**doublings)
    for _ in range(doublings):
        between = np.linalg.inv(np.eye(len(mu)) - R @ R)
        R, T = R + T @ between @ R @ T, T @ between @ T
    return mu, weights, R, T


def slab_fluxes(c, g, tau):
    """Plane albedo and transmission, for light straight on and for diffuse light, and the reflectance 0 -> 0 [1/sr].

    What comes out along mu of uniform light is the share that leaves of a beam that comes in along mu (reciprocity).
    """
    mu, weights, R, T = slab(c, g, tau)
    back, through = R.sum(axis=1), T.sum(axis=1)
    diffuse = [2.0 * (weights * mu * out)[:-1].sum() for out in (back, through)]
    return {
        "R": back[-1],
        "T": through[-1],
        "R_diffuse": diffuse[0],
        "T_diffuse": diffuse[1],
        "brdf": R[-1, -1] / (2.0 * np.pi * HEAD_ON),
    }


# --------------------------------------------------------------------------------------- half space, by H functions


@cache
def h_function(c, n=64):
    """Chandrasekhar's H on Gauss-Legendre nodes of (0, 1) for isotropic scattering: nodes, weights, H.

    Fixed-point iteration of 1/H = sqrt(1 - c) + c/2 int mu' H(mu')/(mu + mu') dmu' (Radiative Transfer, V, eq. 12).
    """
    mu, weights = half_range(n)
    mu, weights = mu[:-1], weights[:-1]
    H = np.ones(n)
    for _ in range(10_000):
        after = 1.0 / (np.sqrt(1 - c) + 0.5 * c * (weights * mu * H / (mu[:, None] + mu)).sum(axis=1))
        if np.abs(after - H).max() < 1e-15:
            break
        H = after
    return mu, weights, H


def h_at(c, mu):
    """H(mu) at any cosine."""
    nodes, weights, H = h_function(c)
    mu = np.asarray(mu, float)[..., None]
    return 1.0 / (np.sqrt(1 - c) + 0.5 * c * (weights * nodes * H / (mu + nodes)).sum(axis=-1))


def half_space_albedo(c, mu0):
    """Share of a beam along ``mu0`` that comes back out of an isotropically scattering half space."""
    return 1.0 - np.sqrt(1 - c) * h_at(c, mu0)


def half_space_diffuse_albedo(c):
    """The same for uniform light from everywhere."""
    mu, weights, H = h_function(c)
    return 1.0 - 2.0 * np.sqrt(1 - c) * (weights * mu * H).sum()


def half_space_exitance(c, mu0, edges):
    """Share of a beam along ``mu0`` that comes out with cosines between ``edges`` [n]: [n - 1].

    Of unit flux across the surface, I(mu) = c H(mu) H(mu0) / (4 pi (mu + mu0)).
    """

    def flux(mu):
        return 0.5 * c * mu * h_at(c, mu) * h_at(c, mu0) / (mu + mu0)

    return np.array([quad(flux, a, b, epsabs=1e-13)[0] for a, b in pairwise(edges)])


# --------------------------------------------------------------- infinite medium around an isotropic point source of 1


@cache
def diffusion_length(c):
    """nu_0 > 1 with 1 = c nu_0 artanh(1/nu_0) [1/sigma_t]."""
    return 1.0 / brentq(lambda k: c * np.arctanh(k) - k, 1e-9, 1 - 1e-15, xtol=1e-16)


def fluence(c, r):
    """Fluence at ``r`` with isotropic scattering (Case and Zweifel 1967, Linear Transport Theory, section 5.2)."""
    k = 1.0 / diffusion_length(c)
    artanh = np.arctanh(k)
    # -d(k^2)/dc, from c = k/artanh(k)
    strength = 2.0 * k * artanh**2 / (k / (1 - k * k) - artanh)

    def continuum(nu):
        return np.exp(-r / nu) / nu**2 / ((1 - c * nu * np.arctanh(nu)) ** 2 + (0.5 * np.pi * c * nu) ** 2)

    along_cut = sum(
        quad(continuum, a, b, epsabs=0, epsrel=1e-11, limit=200)[0] for a, b in ((0, 0.5), (0.5, 0.99), (0.99, 1))
    )
    return (strength * np.exp(-k * r) + along_cut) / (4 * np.pi * r)


def collisions_between(c, edges):
    """Expected number of collisions of one photon with distances from its source between ``edges`` [n]: [n - 1]."""
    return np.array(
        [quad(lambda r: 4 * np.pi * r * r * fluence(c, r), a, b, epsrel=1e-8)[0] for a, b in pairwise(edges)]
    )
