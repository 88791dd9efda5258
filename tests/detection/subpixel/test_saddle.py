"""Sub-pixel corners: exact where the picture is the model, honest where it is noisy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from calibrant.detection.subpixel.motion import refine


def corner(x, y, a, b, *, blur=1.0, contrast=80.0, noise=0.0, seed=0, shape=(41, 41)):
    """Two steps crossing at (x, y) along directions a and b (radians), blurred as one picture.

    The mean of sgn(t_a + X) sgn(t_b + Y) over normal X, Y of correlation r grows with r by 4 times the normal density
    (R. Plackett, A reduction formula for normal multivariate integrals, 1954).
    """
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    da = np.cos(a) * (v - y) - np.sin(a) * (u - x)
    db = np.cos(b) * (v - y) - np.sin(b) * (u - x)
    ta, tb = da / blur, db / blur
    both = erf(ta / 2**0.5) * erf(tb / 2**0.5)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    for node, weight in zip(nodes, weights):
        r = 0.5 * (1 + node) * np.cos(a - b)
        density = np.exp(-(ta**2 - 2 * r * ta * tb + tb**2) / (2 - 2 * r**2)) / (2 * np.pi * np.sqrt(1 - r**2))
        both = both + 2 * weight * np.cos(a - b) * density
    grey = 120 + 0.3 * (u - x) + contrast * both
    grey = grey + noise * np.random.default_rng(seed).standard_normal(shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def steps(a, b, length=20.0):
    return np.array([[length * np.cos(a), length * np.sin(a), length * np.cos(b), length * np.sin(b)]])


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.31, -0.44), (0.5, 0.5)])
@pytest.mark.parametrize(("a", "b"), [(0.0, np.pi / 2), (0.4, 1.3), (-2.0, 0.3)])
def test_model_is_found_to_the_rounding_of_eight_bits(shift, a, b):
    x, y = 20 + shift[0], 20 + shift[1]
    image = corner(x, y, a, b)
    fit = refine(image, np.array([[20.4, 19.7]]), steps(a, b), np.array([True]))
    # Rounding is noise of 0.29 grey levels: 0.002 px at this contrast; 4 sigma.
    assert np.abs(fit.uv[0] - [x, y]).max() < 0.008
    assert fit.converged[0]
    assert fit.blur_px[0] == pytest.approx(1.0, rel=0.02)
    assert fit.contrast[0] == pytest.approx(80, rel=0.02)


@pytest.mark.statistics
def test_stated_sigma_is_the_spread_of_repeated_noise():
    a, b, at = 0.2, 1.6, np.array([[20.2, 19.9]])
    fits = [refine(corner(20.2, 19.9, a, b, noise=4.0, seed=k), at, steps(a, b), np.array([True])) for k in range(300)]
    error = np.concatenate([f.uv for f in fits]) - at
    sigma = np.concatenate([f.sigma_px for f in fits])
    # Chi-square of 600 values over 600 has a deviation of 0.058.
    assert np.mean((error / sigma[:, None]) ** 2) == pytest.approx(1.0, abs=0.2)
    assert abs(error.mean()) < 5 * sigma.mean() / np.sqrt(600)
    assert np.mean([f.noise[0] for f in fits]) == pytest.approx(4.0, rel=0.05)


def test_window_stays_inside_the_neighbouring_squares():
    image = corner(20, 20, 0.0, np.pi / 2)
    image[:, 27:] = 7  # something else, from 0.7 of the distance of 10 px on
    fit = refine(image, np.array([[20.0, 20.0]]), steps(0.0, np.pi / 2, 10.0), np.array([True]), radius_px=12)
    assert np.abs(fit.uv[0] - 20).max() < 0.01


def test_wrong_colours_a_flat_patch_and_the_border_do_not_converge():
    image = corner(20, 20, 0.0, np.pi / 2)
    at, step = np.array([[20.0, 20.0]]), steps(0.0, np.pi / 2)
    assert not refine(image, at, step, np.array([False])).converged[0]
    flat = np.full((41, 41), 90, np.uint8)
    assert not refine(flat, at, step, np.array([True])).converged[0]
    assert not refine(image, np.array([[-30.0, 5.0]]), step, np.array([True])).converged[0]
    assert not refine(image, at, np.zeros((1, 4)), np.array([True])).converged[0]


def pixels_on_corner(x, y, *, noise, seed, shape=(41, 41)):
    """A corner of upright, perfectly sharp squares: each pixel the exact mean over its square."""
    rows, columns = (np.clip(np.arange(n) - at, -0.5, 0.5) * 2.0 for n, at in zip(shape, (y, x), strict=True))
    grey = 120 + 80.0 * np.outer(rows, columns) + noise * np.random.default_rng(seed).standard_normal(shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_upright_edges_as_sharp_as_pixels_are_as_uncertain_as_stated(noise):
    scaled = []
    for k, (x, y) in enumerate(np.random.default_rng(1).uniform(19.5, 20.5, (60, 2))):
        image = pixels_on_corner(x, y, noise=noise, seed=k)
        fit = refine(image, np.array([[20.0, 20.0]]), steps(0.0, np.pi / 2, 14.0), np.array([False]))
        scaled.append((fit.uv[0] - [x, y]) / fit.sigma_px[0])
    # The pixels' squares move them by up to 0.1 px, of which noise knows nothing: chi-square was 45 and 6.5 by that.
    assert 0.4 < np.mean(np.square(scaled)) < 1.6
