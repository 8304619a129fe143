"""The Frenet frame: projection both ways, curvature, domain and what lies beyond the ends."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_ocp import SPACING, frame_of
from reference_ocp import straight as no_curvature

from mpcplan.road.frame import Frame


def circle(radius: float, angle: float = math.pi) -> Frame:
    """An arc to the left (radius > 0) or to the right, starting at the origin along x."""
    return frame_of(lambda s: np.full_like(s, 1 / radius), round(abs(radius) * angle))


def winding(amplitude: float, wavelength: float) -> Frame:
    """A path whose curvature is a sine."""
    return frame_of(lambda s: amplitude * np.sin(2 * np.pi * s / wavelength), 100.0)


def straight(length: float = 50.0) -> Frame:
    """A straight path along x."""
    return frame_of(no_curvature, length)


@settings(max_examples=80, deadline=None)
@given(
    amplitude=st.floats(-0.12, 0.12),
    wavelength=st.floats(25.0, 90.0),
    s=st.floats(0.5, 99.5),
    share=st.floats(-0.95, 0.95),
)
def test_round_trip_inside_the_domain(amplitude, wavelength, s, share):
    frame = winding(amplitude, wavelength)
    low, high = frame.domain(np.array(s))
    d = share * min(abs(low), abs(high), 6.0, 0.6 / max(abs(frame.curvature(s)), 1e-6))
    point = frame.to_cartesian(np.array(s), np.array(d))
    back_s, back_d = frame.to_frenet(point, near=np.array(s + 0.4))
    assert (float(back_s), float(back_d)) == pytest.approx((s, d), abs=1e-4)


@settings(max_examples=80, deadline=None)
@given(
    amplitude=st.floats(-0.05, 0.05), s=st.floats(0.5, 99.5), d=st.floats(-4.0, 4.0),
)  # fmt: skip
def test_round_trip_without_a_start(amplitude, s, d):
    frame = winding(amplitude, 60.0)
    back = frame.to_frenet(frame.to_cartesian(np.array(s), np.array(d)))
    assert np.array(back) == pytest.approx([s, d], abs=1e-4)


def test_the_projection_is_the_nearest_point_of_the_path():
    frame = winding(0.08, 50.0)
    rng = np.random.default_rng(3)
    points = frame.to_cartesian(rng.uniform(2, 98, 200), rng.uniform(-6, 6, 200))
    d = frame.to_frenet(points)[1]
    fine = frame.to_cartesian(np.linspace(0, frame.length, 20001), np.zeros(20001))
    nearest = np.hypot(*(points[:, None] - fine[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.abs(d) == pytest.approx(nearest, abs=1e-3)


@pytest.mark.parametrize("radius", [15.0, -15.0, 40.0, -200.0])
def test_circle(radius):
    frame = circle(radius)
    inner = slice(6, -6)  # the natural spline has no curvature at its ends
    assert frame.kappa[inner] == pytest.approx(np.full(len(frame.s), 1 / radius)[inner], abs=2e-4)
    phi = np.linspace(0.3, 2.8, 30)
    reach = abs(radius) - 3.0  # a point 3 m inside of the circle, to the left of a left turn
    points = reach * np.column_stack([np.sin(phi), -np.sign(radius) * np.cos(phi)])
    points[:, 1] += radius
    s, d = frame.to_frenet(points)
    assert s == pytest.approx(abs(radius) * phi, abs=1e-2)
    assert d == pytest.approx(np.full(30, math.copysign(3.0, radius)), abs=1e-3)
    assert frame.heading(s) == pytest.approx(np.sign(radius) * phi, abs=1e-3)


def test_curvature_slope_of_a_clothoid():
    frame = frame_of(lambda s: 0.002 * s, 60.0)
    s = np.linspace(5, 55, 11)
    assert frame.curvature(s) == pytest.approx(0.002 * s, abs=2e-4)
    assert frame.curvature_slope(s) == pytest.approx(np.full(11, 0.002), rel=0.02)


@pytest.mark.parametrize(("radius", "side"), [(10.0, 1), (-10.0, -1)])
def test_domain_ends_before_the_centre_of_curvature(radius, side):
    low, high = circle(radius).domain(np.array([10.0, 15.0]))
    inner, outer = (high, low) if side > 0 else (low, high)
    assert inner == pytest.approx(np.full(2, 0.9 * radius), rel=1e-3)
    assert np.isinf(outer).all()


def test_domain_of_a_straight_path_covers_the_plane():
    low, high = straight().domain(np.array([10.0]))
    assert low[0] < -1e6 and high[0] > 1e6


@pytest.mark.parametrize(
    ("point", "expected"),
    [((-7.0, 2.0), (-7.0, 2.0)), ((58.0, -3.0), (58.0, -3.0)), ((0.0, 1.0), (0.0, 1.0))],
)
def test_the_path_goes_on_straight_beyond_its_ends(point, expected):
    frame = straight()
    assert np.array(frame.to_frenet(np.array(point))) == pytest.approx(expected)
    assert frame.to_cartesian(*map(np.array, expected)) == pytest.approx(point)


def test_round_trip_beyond_the_end_of_a_curve():
    frame = circle(20.0)
    s, d = np.array([-5.0, frame.length + 8.0]), np.array([2.0, -3.0])
    back = frame.to_frenet(frame.to_cartesian(s, d))
    assert np.array(back) == pytest.approx(np.array([s, d]), abs=1e-6)


def hairpin() -> Frame:
    """Out along x for 40 m, a half circle of radius 4 m, and back 8 m beside the way out."""
    arc = 4 * math.pi

    def curvature(s: np.ndarray) -> np.ndarray:
        ramp = np.clip(np.minimum(s - 40.0, 40.0 + arc - s) / 1.0 + 0.5, 0.0, 1.0)
        return ramp / 4.0

    return frame_of(curvature, 90.0)


def test_near_follows_one_stretch_of_a_winding_path():
    frame = hairpin()
    point = np.array([[20.0, 4.5]])  # 4.5 m left of the way out, 3.5 m left of the way back
    s, d = frame.to_frenet(point, near=np.array([19.0]))
    assert (s[0], d[0]) == pytest.approx((20.0, 4.5), abs=1e-3)
    s_free, d_free = frame.to_frenet(point)
    assert s_free[0] > 60.0 and d_free[0] == pytest.approx(3.5, abs=0.1)
    s_back, d_back = frame.to_frenet(point, near=s_free + 3.0)
    assert (s_back[0], d_back[0]) == pytest.approx((s_free[0], d_free[0]), abs=1e-4)


def test_shapes_are_kept():
    frame = winding(0.05, 50.0)
    s, d = frame.to_frenet(np.zeros((3, 4, 2)) + [30.0, 1.0])
    assert s.shape == d.shape == (3, 4)
    assert frame.to_cartesian(s, d).shape == (3, 4, 2)
    assert frame.to_cartesian(s[:, :, None], np.zeros(5)).shape == (3, 4, 5, 2)


def test_samples_heading_and_lengths_agree():
    frame = winding(0.1, 40.0)
    assert frame.spacing == pytest.approx(SPACING)
    assert frame.length == pytest.approx(100.0)
    chord = np.diff(frame.points, axis=0)
    middle = np.unwrap(np.arctan2(chord[:, 1], chord[:, 0]))
    assert frame.heading(frame.s[:-1] + SPACING / 2) == pytest.approx(middle, abs=2e-3)
    assert np.abs(np.diff(frame.theta)).max() < 0.1
