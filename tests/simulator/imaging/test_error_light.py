"""Variance of the light of wavefront errors: all waves one by one, and visits that are drawn."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from cpic_core import stream
from simulator.config import load_instrument
from simulator.imaging import aperture_sums, build_imager, measure, overlap_weights, visit_responses
from simulator.imaging.drift import screen_model
from simulator.imaging.measure import ErrorLight, light_variance
from simulator.knobs import Knobs

SLOPE = 2.5


class Hole:
    """A hole of a few apertures that no mirror digs, past the configuration's own check."""

    def __init__(self, **knobs):
        instrument = load_instrument({"dark_hole": {"control": "off"}})
        narrow = instrument.coronagraph.model_copy(update={"outer_half_side_arcsec": 0.36})
        instrument = instrument.model_copy(update={"coronagraph": narrow})
        self.imager = build_imager(instrument, "F520", Knobs(pupil_samples=64, wavelength_nodes=2, **knobs))
        zone, pixel = self.imager.zone, self.imager.pixel_scale_arcsec
        side = np.arange(np.floor(zone.inner_arcsec / pixel), np.ceil(zone.outer_arcsec / pixel) + 1) * pixel
        y, x = zone.axes(side)
        self.axes = self.imager.axis(y, masked=True), self.imager.axis(x, masked=True)
        self.inside = zone.covers(y, x)
        self.weights = overlap_weights(self.imager.aperture_radius_arcsec / pixel)
        self.mean = self.inside * (self.weights.sum() / self.inside.sum())
        first, last = len(side), 2 * len(side) - len(self.weights)  # in the quadrant of x and y above 0
        self.corners = [(first, first), (first, last), (last, last)]
        self.apertures = [(*corner, self.weights) for corner in self.corners]

    def sums(self, images):
        """Aperture sums less the mean of the hole, by the general code, shape (..., 3)."""
        half = len(self.weights) // 2
        sums = aperture_sums(images, self.weights)
        less = images[..., self.inside].mean(axis=-1) * self.weights.sum()
        return np.stack([sums[..., y + half, x + half] - less for y, x in self.corners], axis=-1)

    def variance(self):
        light = ErrorLight(self.imager, self.axes, SLOPE)
        return light_variance(light, light, self.mean, self.apertures)


@pytest.mark.long
def test_the_variance_is_that_of_the_form_of_all_waves(monkeypatch):
    """``M = Re(F^H W F)`` of the fields of all waves, and ``2 tr M^2``; waves up to 1.5 cycles."""
    hole = Hole(pixel_nodes=2)
    model = screen_model(len(hole.imager.transmission), SLOPE)
    low = np.hypot(*np.indices(model.amplitude.shape) - np.array([[[0]], [[63]]])) < 3.5
    few = dataclasses.replace(model, amplitude=np.where(low, model.amplitude, 0.0))
    monkeypatch.setattr(measure, "screen_model", lambda samples, slope: few)
    for name in ("FAINT", "APART"):
        monkeypatch.setattr(measure, name, 0.0)
    grid, screens = hole.imager.focal_grid(*hole.axes), []
    for place in np.argwhere(few.amplitude > 0):
        for part in range(2):
            unit = np.zeros((2, *few.amplitude.shape))
            unit[(part, *place)] = 1.0
            screens.append(few.draw(SimpleNamespace(standard_normal=lambda shape, unit=unit: unit), 1.0))
    waves = len(screens)
    assert 20 < waves <= measure.PROBES
    forms = np.zeros((waves, waves, 3))
    for index, (wavelength, weight) in enumerate(zip(hole.imager.wavelengths_m, hole.imager.weights, strict=True)):
        pupil = 2.0 * np.pi / (wavelength * 1e9) * hole.imager.pupil(index)
        fields = np.array([grid.transformed(index, pupil * screen) for screen in screens])
        for one, field in enumerate(fields):
            light = grid.pixels((field.conj() * fields).real) * hole.imager.pixel_solid_angle_sr
            forms[one] += weight * hole.sums(light)
    np.testing.assert_allclose(hole.variance(), 2.0 * (forms**2).sum(axis=(0, 1)), rtol=1e-9)


@pytest.mark.parametrize("visits", [300, pytest.param(1500, marks=pytest.mark.long)])
def test_the_variance_of_visits_that_are_drawn(visits):
    hole = Hole(pixel_nodes=1)
    _, _, light = visit_responses(hole.imager, *hole.axes, SLOPE, visits, 5)
    sums = hole.sums(light)
    squares = (sums - sums.mean(axis=0)) ** 2
    error = squares.std(axis=0) / visits**0.5
    assert np.all(np.abs(squares.mean(axis=0) - hole.variance()) < 3.5 * error)
    assert np.all(error < 0.15 * (1500 / visits) ** 0.5 * squares.mean(axis=0))


def test_apertures_are_sums_of_their_readings():
    """Light of one screen by readings of the pupil, by transform of the whole grid and by the waves' form."""
    hole = Hole(pixel_nodes=2)
    light = ErrorLight(hole.imager, hole.axes, SLOPE)
    waves = stream(3, "waves").standard_normal((1, 128, 128))
    screen = light.screens.screens(waves)
    for row, column, weights in hole.apertures:
        everywhere = np.zeros(hole.inside.shape)
        everywhere[row : row + len(weights), column : column + len(weights)] = weights
        whole = light.light(screen, everywhere)[0]
        by_mode = np.einsum("myx,yx->m", light.readings(row, column, weights), screen[0])
        assert (by_mode**2).sum() == pytest.approx(whole, rel=1e-3)
        assert (waves * light.product(waves, everywhere)).sum() == pytest.approx(whole, rel=1e-9)
