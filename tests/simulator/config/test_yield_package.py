"""Yield input packages: the table of their images, against closed forms and exact apertures of photutils."""

import math

import numpy as np
import pytest
from photutils.aperture import CircularAperture, aperture_photometry

from cpic_core import InputError
from simulator.config import load_instrument
from simulator.config.coronagraph import FILES, coronagraph_table
from simulator.imaging import psf_metrics
from tests.yield_packages import DIAMETERS, PIXEL, RADIUS, SIGMA, STEPS, passed, sky, source, star, write

UNIT = 0.05


def read(path, **own):
    return coronagraph_table(path, UNIT, aperture_arcsec=RADIUS * UNIT, **own)


def exact(image, x, y):
    """The sum in an aperture, by photutils."""
    aperture = CircularAperture((30.0 + x / PIXEL, 30.0 + y / PIXEL), RADIUS / PIXEL)
    return float(aperture_photometry(image, aperture, method="exact")["aperture_sum"][0])


def around(image, separation, angles=36):
    """The mean of such sums over position angles."""
    turns = np.linspace(0.0, 2 * math.pi, angles, endpoint=False)
    return np.mean([exact(image, separation * math.cos(turn), separation * math.sin(turn)) for turn in turns])


DIM = 1e-3 * np.stack([source(x, 0.0, 30.0) for x in STEPS])
PLACES = (1.0, 1.13, 2.5, 5.37)
"""At offsets, and between them."""


def test_core_throughput_is_the_light_in_the_aperture_and_linear_between_offsets(tmp_path):
    table = read(write(tmp_path / "yip"))
    at_offsets = np.array([exact(source(x, 0.0, 30.0), x, 0.0) for x in STEPS])
    expected = np.interp(PLACES, STEPS, at_offsets)
    np.testing.assert_allclose(table.at("core_throughput", np.array(PLACES) * UNIT), expected, rtol=3e-3)
    closed = passed(STEPS[2:]) * (1.0 - math.exp(-(RADIUS**2) / (2 * SIGMA**2)))
    # The pixels of a small core are coarse: their light is taken to be even.
    np.testing.assert_allclose(table.at("core_throughput", STEPS[2:] * UNIT), closed, rtol=0.02)


@pytest.mark.parametrize("diameter", [None, 0.05, 0.1, 0.17])
def test_starlight_and_sky_are_means_over_position_angles(tmp_path, diameter):
    table = read(write(tmp_path / "yip"), star_diameter_mas=None if diameter is None else 1e3 * diameter * UNIT)
    size = diameter or 0.0
    lower = DIAMETERS[size >= DIAMETERS][-1]
    upper = DIAMETERS[size <= DIAMETERS][0]
    share = 0.0 if upper == lower else (size - lower) / (upper - lower)
    image = (1 - share) * star(30.0, lower) + share * star(30.0, upper)
    for place in PLACES:
        core = float(table.at("core_throughput", place * UNIT))
        light = float(table.at("raw_contrast", place * UNIT)) * core
        area = math.pi * (RADIUS / PIXEL) ** 2
        assert light == pytest.approx(around(image, place), rel=5e-3)
        through = float(table.at("occulter_transmission", place * UNIT))
        assert through == pytest.approx(around(sky(30.0), place) / area, rel=5e-3)


@pytest.mark.parametrize(
    ("kind", "own"),
    [
        ("two columns", {}),
        ("two rows", {"listed": np.column_stack([STEPS, 0 * STEPS]).T}),
        ("one column", {"listed": STEPS}),
        ("one column of a column", {"listed": STEPS[:, None]}),
        ("along y", {"offsets": np.column_stack([0 * STEPS, STEPS])}),
        ("along y, one column", {"offsets": np.column_stack([0 * STEPS, STEPS]), "listed": STEPS}),
        ("in any order", {"offsets": np.column_stack([STEPS, 0 * STEPS])[::-1]}),
        ("between pixels", {"centre": 29.5}),
        ("centre n / 2 unless it is said", {"stated": "nothing"}),
        ("diameters as a column", {"stellar_intens_diam_list": DIAMETERS[:, None]}),
        ("single precision", {"sky_trans": sky(30.0).astype("f4")}),
        ("pixel of the star's file alone", {"cards": ()}),
    ],
)
def test_forms_of_a_package_are_one_table(tmp_path, kind, own):
    first, second = read(write(tmp_path / "a")), read(write(tmp_path / "b", **own))
    at = np.array(PLACES) * UNIT
    for name in ("core_throughput", "raw_contrast", "occulter_transmission"):
        np.testing.assert_allclose(second.at(name, at), first.at(name, at), rtol=1e-2, err_msg=kind)


def test_offsets_in_a_plane_give_means_over_circles(tmp_path):
    """Sources that the mask dims by their azimuth: the mean over the circle, not that of an axis."""
    steps = np.arange(0.0, 6.01, 0.4)
    places = np.array([(x, y) for x in steps for y in steps])
    angle = np.arctan2(places[:, 1], places[:, 0])
    sources = np.stack([source(x, y, 30.0) for x, y in places]) * (1 - 0.5 * np.cos(4 * angle))[:, None, None]
    table = read(write(tmp_path / "yip", offsets=places, offax_psf=sources))
    line = read(write(tmp_path / "line"))
    at = np.array([1.5, 2.5, 4.0, 5.0]) * UNIT
    np.testing.assert_allclose(table.at("core_throughput", at), line.at("core_throughput", at), rtol=0.02)


def test_the_table_ends_where_offsets_or_images_do(tmp_path):
    assert read(write(tmp_path / "a")).separation_arcsec[-1] == pytest.approx(6.0 * UNIT)
    far = np.arange(0.0, 9.01, 0.5)
    table = read(write(tmp_path / "b", offsets=np.column_stack([far, 0 * far])))
    # The last pixel is 29 from the star, an aperture 2.8 wide: 26.7 pixels.
    assert table.separation_arcsec[-1] == pytest.approx(6.5 * UNIT)
    instrument = load_instrument({"coronagraph": {"table": {"F662": str(tmp_path / "a")}}})
    metrics, unit = psf_metrics(instrument, "F662"), instrument.lambda_d_arcsec("F662")
    inner, outer = metrics.zone.usable_range_arcsec(metrics.aperture_radius_arcsec)
    assert outer == pytest.approx(6.0 * unit)
    assert inner == pytest.approx(0.7 * unit, abs=0.06 * unit)


def test_beyond_a_stop_that_blocks_sources_nobody_looks_for_planets(tmp_path):
    blocked = np.stack([source(x, 0.0, 30.0) * (x < 4.25) for x in STEPS])
    table = read(write(tmp_path / "yip", offax_psf=blocked))
    first = read(write(tmp_path / "open"))
    assert 4.4 * UNIT < table.separation_arcsec[-1] < 4.5 * UNIT
    at = np.array([1.0, 2.5, 4.0]) * UNIT
    np.testing.assert_allclose(table.at("core_throughput", at), first.at("core_throughput", at))


@pytest.mark.parametrize("turned", [False, True])
def test_two_offsets_are_two_rows(tmp_path, turned):
    places = np.array([[2.0, 0.0], [5.0, 0.0]])
    along = {"offsets": places[:, ::-1], "listed": places[:, ::-1]} if turned else {"offsets": places}
    table = read(write(tmp_path / "yip", **along))
    assert table.separation_arcsec[[0, -1]] == pytest.approx([2.0 * UNIT, 5.0 * UNIT])
    expected = [exact(source(x, 0.0, 30.0), x, 0.0) for x in (2.0, 5.0)]
    np.testing.assert_allclose(table.columns["core_throughput"][[0, -1]], expected, rtol=3e-3)


def test_lambda_d_is_that_of_the_band_and_of_the_stated_diameter(tmp_path):
    path = write(tmp_path / "yip")
    for own, factor in (({}, 1.0), ({"diameter_m": 1.6}, 1.25)):
        made = load_instrument({"coronagraph": {"table": path, "aperture_radius_lambda_d": 0.7 * factor} | own})
        for band in made.bands:
            table, unit = made.table(band), made.lambda_d_arcsec(band) * factor
            assert table.separation_arcsec[-1] == pytest.approx(6.0 * unit)
            expected = read(path).at("core_throughput", 3.0 * UNIT)
            assert table.at("core_throughput", 3.0 * unit) == pytest.approx(expected)


def test_what_is_read_from_where_is_said(tmp_path):
    table = read(write(tmp_path / "yip"), star_diameter_mas=5.0)
    words = ("yip, a yield", "offax_psf.fits (13 offsets)", "0.7 lambda/D", "star of 0.1 lambda/D", "sky_trans.fits")
    assert [word for word in words if word not in table.origin] == []
    assert table.notes == ()


@pytest.mark.parametrize("cards", [{}, {"LAMBDA": 550.0, "MINLAM": 500.0, "MAXLAM": 600.0}])
def test_a_band_or_a_diameter_that_it_was_not_made_for_is_said(tmp_path, cards):
    """From 500 to 600 nm, D = 6.5 m: 550 nm of that telescope, 650 nm of it, 550 nm of one of 2 m."""
    path = write(tmp_path / "yip", cards=cards)

    def notes(wavelength_nm, diameter_m):
        unit = math.degrees(1e-9 * wavelength_nm / diameter_m) * 3600.0
        return coronagraph_table(path, unit, diameter_m=diameter_m).notes

    assert notes(550.0, 6.5) == ()
    for asked, said in (((650.0, 6.5), "650 nm and 6.5 m"), ((550.0, 2.0), "550 nm and 2 m")):
        assert (
            f"made for 500 to 600 nm and a diameter of 6.5 m; its lambda/D is taken for that of {said}"
            in notes(*asked)[0]
        )


def test_sources_beside_their_stated_place_are_found_and_that_is_said(tmp_path):
    moved = {"offax_psf": np.stack([source(x, 0.0, 30.5) for x in STEPS])}
    table, first = read(write(tmp_path / "yip", **moved)), read(write(tmp_path / "a", centre=30.5))
    assert "+0.50, +0.50 pixels" in table.notes[0]
    at = np.array(PLACES) * UNIT
    np.testing.assert_allclose(table.at("core_throughput", at), first.at("core_throughput", at), rtol=1e-3)


def test_a_file_that_changes_is_read_again(tmp_path):
    path = write(tmp_path / "yip")
    first = read(path)
    write(tmp_path / "yip", sky_trans=0.9 * sky(30.0))
    second = read(path)
    assert first.sha256 != second.sha256
    ratio = second.columns["occulter_transmission"] / first.columns["occulter_transmission"]
    np.testing.assert_allclose(ratio, 0.9)


@pytest.mark.parametrize(
    ("own", "said"),
    [
        *(({"without": (name,)}, f"without {name}") for name in FILES),
        ({"sky_trans": np.zeros((3, 4))}, r"sky_trans\.fits.*one square image"),
        ({"stellar_intens": np.zeros((60, 60))}, r"stellar_intens\.fits.*a cube of square images"),
        ({"stellar_intens_diam_list": np.zeros(5)}, r"stellar_intens_diam_list\.fits.*a number for each of 3"),
        ({"listed": np.zeros((4, 2))}, r"offax_psf_offset_list\.fits.*a number for each of 13"),
        ({"listed": np.full(13, np.nan)}, r"offax_psf_offset_list\.fits.*finite"),
        ({"stellar_intens": np.full((3, 60, 60), 1.0)}, r"stellar_intens\.fits.*a sum of at most 1"),
        ({"sky_trans": np.full((60, 60), -1.0)}, r"sky_trans\.fits.*none negative"),
        ({"sky_trans": np.full((60, 60), 2.0)}, r"sky_trans\.fits = 2.*0 to 1"),
        ({"sky_trans": np.full((60, 60), 0.01)}, "occulter_transmission.*at least core_throughput"),
        ({"offax_psf": DIM, "stellar_intens": np.full((3, 60, 60), 2e-4)}, r"stellar_intens\.fits.*a star fainter"),
        ({"offax_psf": np.zeros((13, 60, 60))}, r"offax_psf\.fits.*light"),
        ({"cards": {"PIXSCALE": None}}, r"stellar_intens\.fits PIXSCALE = missing.*above 0 lambda/D"),
        ({"cards": {"PIXSCALE": -1.0}}, r"stellar_intens\.fits PIXSCALE = -1"),
        ({"cards": {"PIXSCALE": "0.25"}}, "PIXSCALE = 0.25.*a finite number"),
        ({"cards": {"XCENTER": 200.0}}, r"XCENTER"),
        ({"cards": {"YCENTER": 24.0}}, r"offax_psf\.fits XCENTER, YCENTER.*image 12 is brightest at"),
    ],
)
def test_what_is_no_package_is_refused_in_one_line(tmp_path, own, said):
    path = write(tmp_path / "yip", **own)
    with pytest.raises(InputError, match=said) as refused:
        read(path)
    assert "\n" not in str(refused.value)


def test_a_star_of_another_size_than_the_images_is_refused(tmp_path):
    path = write(tmp_path / "yip")
    with pytest.raises(InputError, match=r"star_diameter_mas = 0\.21 lambda/D.*0 to 0\.2 lambda/D"):
        read(path, star_diameter_mas=10.5)
    flat = tmp_path / "flat.csv"
    flat.write_text("separation_arcsec,core_throughput,raw_contrast\n0.1,0.05,1e-9\n0.3,0.05,1e-9\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"star_diameter_mas = 1\.0 mas.*only the images"):
        read(str(flat), star_diameter_mas=1.0)


def test_one_of_its_files_is_not_the_package(tmp_path):
    path = write(tmp_path / "yip")
    for name in FILES:
        with pytest.raises(InputError, match=f"{name}.*its folder"):
            read(f"{path}/{name}")


def test_a_folder_beside_the_instruments_file_is_found(tmp_path, monkeypatch):
    write(tmp_path / "yip")
    (tmp_path / "mine.yaml").write_text("coronagraph: {table: {F662: yip}}\n", encoding="utf-8")
    monkeypatch.chdir("/")
    assert load_instrument(tmp_path / "mine.yaml").table("F662").file == "yip"
