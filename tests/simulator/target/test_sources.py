"""Tables of sources: positions as pictures, spectra against synphot, rates against the spectra.

The table of a scene's sources, and that of many scenes.

Sky and detector: absolute pictures, because a round trip cannot see a mirror.
"""

import pickle

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from astropy.io import fits
from astropy.wcs import WCS
from hypothesis import given, settings, strategies as st

from catalogs import HC_ERG_ANGSTROM, load_albedo
from cpic_core import InputError
from simulator import load_instrument, load_scene, planet_contrast, scenes_from_table, spectrum_generator
from simulator.passbands import Passbands, band_integral
from simulator.target import detector_to_sky, extended_rates, scene_sources, sky_to_detector, wcs_keywords

STAR = {"v_mag": 1.35, "spectral_type": "K1V", "distance_pc": 1.35}
PLANET = {"name": "b", "radius_rjup": 1, "phase_deg": 90, "separation_arcsec": 0.65, "pa_deg": 315}
INSTRUMENT = load_instrument()
BANDS = tuple(INSTRUMENT.bands)


def scene(*planets, star=STAR, **more):
    return load_scene({"name": "s", "cstar": star, "planets": planets} | more)


def parametric(**more):
    return PLANET | {"log10_mh": 1, "log10_fsed": 0.5} | more


def reflected(row, band):
    """Detected e-/s/cm2 of a row's own samples, linear between them."""
    return band_integral(band, row.wavelength_nm, row.photlam)


# --- the paper's example


def test_contrast_over_albedo_of_the_paper():
    table = spectrum_generator(scene(PLANET | {"albedo": 1.0}))
    np.testing.assert_allclose(table["b"].contrast, 9.441e-8, rtol=5e-5)
    assert table["b"].distance_au == pytest.approx(0.8775, rel=1e-15)
    np.testing.assert_allclose(table["b"].contrast, planet_contrast(1.0, 0.8775, 0.0, 90.0, 1.0), rtol=1e-14)


def test_the_preset_is_the_papers_example():
    table = spectrum_generator("paper_example")
    assert table.kind == ("cstar", "planet")
    body = table["planet"]
    assert (body.distance_au, body.insolation_au) == (pytest.approx(0.8775), 2.0)
    assert (body.x_arcsec, body.y_arcsec) == (pytest.approx(0.65 / 2**0.5), pytest.approx(0.65 / 2**0.5))
    contrasts = [scene_sources(load_scene("paper_example"), INSTRUMENT, band)[1].contrast for band in BANDS[:4]]
    assert all(1e-8 < contrast < 9.441e-8 for contrast in contrasts)


def test_background_preset_puts_each_star_where_it_is_said():
    table = spectrum_generator("paper_background")
    assert table.name == ("alpha Cen B", "planet", "calibration star", "field star")
    # PA 225, south-west: right and below the star.
    assert table["calibration star"].x_arcsec == pytest.approx(0.95 / 2**0.5)
    assert table["calibration star"].y_arcsec == pytest.approx(-0.95 / 2**0.5)
    # By coordinates, north-east: left and above.
    assert table["field star"].x_arcsec == pytest.approx(
        -(35.25 - 35.0631) * 15 * np.cos(np.radians(60.8375)), rel=1e-3
    )
    assert table["field star"].y_arcsec == pytest.approx(15.099 - 13.6, rel=1e-3)


# --- positions


@given(st.floats(0.0, 360.0), st.floats(-180.0, 180.0), st.sampled_from([-1, 1]))
@settings(max_examples=30)
def test_picture_of_every_source_with_roll_and_parity(pa, roll, parity):
    body = scene(PLANET | {"pa_deg": pa, "albedo": 0.5})
    row = spectrum_generator(body, roll_deg=roll, instrument=_instrument(parity))["b"]
    east, north = 0.65 * np.sin(np.radians(pa - roll)), 0.65 * np.cos(np.radians(pa - roll))
    assert row.x_arcsec == pytest.approx(parity * east, abs=1e-12)
    assert row.y_arcsec == pytest.approx(north, abs=1e-12)


_PARITIES = {parity: load_instrument({"detector": {"parity": parity}}) for parity in (-1, 1)}


def _instrument(parity):
    return _PARITIES[parity]


def test_east_is_at_negative_x_and_larger_right_ascension():
    star = STAR | {"ra": "14:39:35.06", "dec": "-60:50:15.1"}
    east = {"name": "e", "radius": 1, "phase": 90, "ra": "14:39:35.16", "dec": "-60:50:15.1", "albedo": 0.5}
    row = spectrum_generator(scene(east, star=star))["e"]
    assert row.x_arcsec == pytest.approx(-1.5 * np.cos(np.radians(60.8375)), rel=1e-4)
    assert abs(row.y_arcsec) < 1e-4
    assert row.pa_deg == pytest.approx(90.0, abs=0.01)


# --- spectra


@pytest.mark.parametrize("teff", [3600.0, 5178.0, 7800.0])
@pytest.mark.parametrize("albedo", ["jupiter", "neptune", "parametric", 0.3])
def test_reflected_light_is_exact_in_every_band(teff, albedo):
    """Against both factors kept apart, each linear between its own samples, on a much finer grid."""
    body = parametric() if albedo == "parametric" else PLANET | {"albedo": albedo}
    star, row = spectrum_generator(scene(body, star={"v_mag": 1.0, "teff_k": teff, "distance_pc": 1.35}))
    table = row.light.albedo
    scale = 9.441e-8
    for band in Passbands.from_instrument(INSTRUMENT).bands:
        low, high = band.support_nm
        edges = np.unique(np.concatenate([[low, high], star.wavelength_nm, table.wavelength_nm]))
        edges = edges[(edges >= low) & (edges <= high)]
        x, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
        total = sum(
            np.sum(
                half
                * weight
                * np.interp(x + at * half, star.wavelength_nm, star.photlam)
                * np.interp(x + at * half, table.wavelength_nm, table.albedo)
            )
            for at, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True)
        )
        exact = total * 10.0 * band.t_opt * band.qe * scale
        assert reflected(row, band) == pytest.approx(exact, rel=5e-5)  # the scale has four digits
        ratio = reflected(row, band) / (
            row.contrast[0] / np.interp(row.wavelength_nm[0], table.wavelength_nm, table.albedo)
        )
        assert ratio == pytest.approx(exact / scale, rel=1e-6)


@pytest.mark.parametrize(
    "tree",
    [
        {"cstar": STAR, "planets": [PLANET, parametric(name="c", pa_deg=45)]},
        {
            "cstar": {"v_mag": 4, "teff_k": 9000, "spectrum": "blackbody", "distance_pc": 5, "luminosity_lsun": 30},
            "planets": [parametric()],
        },
        {
            "cstar": {
                "v_mag": 4,
                "spectrum": {"wavelength_nm": [300, 500, 700, 1800], "flam": [1, 3, 2, 1]},
                "distance_pc": 5,
                "luminosity_lsun": 1,
            },
            "planets": [PLANET | {"albedo": "uranus"}, parametric(name="c", pa_deg=45)],
        },
        {
            "cstar": STAR,
            "planets": [
                {"name": "hot", "model": "blackbody", "teff_k": 1200, "radius": 1.2, "separation": 0.4, "pa": 10},
                {"name": "bright", "model": "blackbody", "teff_k": 3000, "v_mag": 12, "separation": 0.4, "pa": 100},
                {
                    "name": "mine",
                    "separation": 0.4,
                    "pa": 200,
                    "spectrum": {"wavelength_nm": [300, 1800], "photlam": [1e-6, 3e-6]},
                },
            ],
            "stars": [{"v_mag": 9, "teff_k": 4000, "separation": 2, "pa": 3}],
        },
    ],
)
def test_band_rates_are_those_of_the_spectra(tree):
    """What the images use, against the same sources as synphot spectra."""
    checked = load_scene({"name": "s"} | tree)
    table = spectrum_generator(checked)
    area = INSTRUMENT.telescope.area_cm2
    for number, band in enumerate(Passbands.from_instrument(INSTRUMENT).bands):
        sources = scene_sources(checked, INSTRUMENT, BANDS[number])
        assert [source.name for source in sources] == list(table.name)
        for source, row in zip(sources, table, strict=True):
            angstrom = row.spectrum.waveset.value
            found = area * band_integral(band, angstrom / 10.0, row.spectrum(angstrom).value)
            assert source.rate_e_s == pytest.approx(found, rel=1e-6)
            if source.contrast is not None:
                assert source.contrast == pytest.approx(source.rate_e_s / sources[0].rate_e_s, rel=1e-14)


def test_stars_and_albedos_are_those_of_the_exposure_time_calculator():
    passbands = Passbands.from_instrument(INSTRUMENT)
    star = {"v_mag": 3.2, "teff_k": 5123.0, "log_g": 4.3, "metallicity": -0.4, "distance_pc": 1.35}
    rates = passbands.star_rate_e_s(3.2, 5123.0, 4.3, -0.4, INSTRUMENT.telescope.area_cm2)
    albedo = passbands.band_albedo("jupiter", 5123.0, 4.3, -0.4)
    for number, band in enumerate(BANDS):
        host, body = scene_sources(scene(PLANET, star=star), INSTRUMENT, band)
        assert host.rate_e_s == pytest.approx(rates[number], rel=1e-12)
        assert body.contrast == pytest.approx(planet_contrast(1.0, 0.8775, 0.0, 90.0, albedo[number]), rel=1e-12)


def test_user_spectra_are_scaled_or_taken_as_they_are():
    from simulator.passbands import v_photon_rate, vega_v_photon_rate

    flat = {"wavelength_nm": [300, 1800], "photlam": [1e-4, 1e-4]}
    own = {"name": "own", "separation": 1, "pa": 0}
    table = spectrum_generator(
        scene(
            own | {"spectrum": flat},
            own | {"name": "scaled", "pa": 90, "spectrum": flat, "v_mag": 15.0},
            star=STAR | {"spectrum": flat},
        )
    )
    for row, magnitude in ((table[0], 1.35), (table["scaled"], 15.0)):
        rate = v_photon_rate(row.wavelength_nm, row.photlam) / vega_v_photon_rate()
        assert -2.5 * np.log10(rate) == pytest.approx(magnitude, abs=1e-9)
    np.testing.assert_array_equal(table["own"].photlam, [1e-4, 1e-4])
    np.testing.assert_allclose(table["scaled"].contrast, 10.0 ** (-0.4 * (15.0 - 1.35)), rtol=1e-9)
    erg = {"wavelength_nm": [300, 1800], "flam": [1e-15, 1e-15]}
    mine = spectrum_generator(scene(own | {"spectrum": erg}))["own"]
    np.testing.assert_allclose(mine.photlam, 1e-15 * np.array([3000.0, 18000.0]) / HC_ERG_ANGSTROM, rtol=1e-14)


def test_contrast_outside_the_stars_table_is_no_number():
    own = {
        "name": "own",
        "separation": 1,
        "pa": 0,
        "spectrum": {"wavelength_nm": [200, 500, 2500], "photlam": [1, 1, 1]},
    }
    contrast = spectrum_generator(scene(own))["own"].contrast
    assert np.isnan(contrast[[0, 2]]).all()
    assert contrast[1] > 0.0


def test_spectra_are_zero_outside_and_carry_their_flags():
    star, body = spectrum_generator(scene(PLANET))
    assert star.spectrum(2900.0).value == body.spectrum(2900.0).value == 0.0
    assert body.spectrum(18000.0).value == 0.0
    assert str(body.spectrum(5500.0).unit) == "PHOTLAM"
    assert body.spectrum.meta["flags"] == body.flags
    assert "extrapolated" in body.flags


# --- distances, insolation, flags


def test_insolation_follows_from_luminosity_and_true_distance():
    row = spectrum_generator(scene(parametric(), star=STAR | {"luminosity_lsun": 0.5}))["b"]
    assert row.insolation_au == pytest.approx(0.8775 / np.sqrt(0.5), rel=1e-14)
    assert "luminosity_derived" not in row.flags
    at_60 = spectrum_generator(scene(parametric(phase_deg=60), star=STAR | {"luminosity_lsun": 0.5}))["b"]
    assert at_60.insolation_au == pytest.approx(0.8775 / np.sin(np.radians(60)) / np.sqrt(0.5), rel=1e-14)
    fixed = spectrum_generator(scene(parametric(insolation_au=2)))["b"]
    assert fixed.insolation_au == 2.0
    assert np.isnan(spectrum_generator(scene(PLANET)).insolation_au).all()


def test_a_luminosity_that_is_not_given_is_derived_and_flagged():
    # alpha Cen B: 0.50 L_sun at 742 mas; K1V of V 1.35 at 1.35 pc is a little brighter.
    row = spectrum_generator(scene(parametric()))["b"]
    assert (0.8775 / row.insolation_au) ** 2 == pytest.approx(0.5, rel=0.1)
    assert "luminosity_derived" in row.flags
    assert "luminosity_derived" in scene_sources(scene(parametric()), INSTRUMENT, "F520")[1].flags


@pytest.mark.parametrize("band", BANDS)
def test_extrapolation_is_flagged_in_the_bands_it_concerns(band):
    flags = scene_sources(scene(PLANET), INSTRUMENT, band)[1].flags
    beyond = Passbands.from_instrument(INSTRUMENT).bands[BANDS.index(band)].support_nm[1] > 1050.0
    assert ("extrapolated" in flags) == beyond


def test_flags_of_the_star_and_of_an_unknown_distance():
    star = {"v_mag": 1.35, "teff_k": 5000, "luminosity_lsun": 0.5}
    body = parametric(distance_au=30.0, log10_fsed=1)
    host, body = scene_sources(scene(body, star=star), INSTRUMENT, "F520")
    assert host.flags == ("log_g_assumed",)
    assert set(body.flags) == {"geometry_unchecked", "fsed_clamped", "insolation_clamped"}
    assert spectrum_generator("paper_example")["planet"].flags[0] == "fsed_clamped"


def test_the_phase_function_asked_for_is_used():
    from simulator.config import ParametricAlbedo
    from simulator.target import phase_value

    bodies = [
        parametric(name=name, pa_deg=pa, insolation_au=2, phase_deg=120, phase_function=name)
        for name, pa in (("lambert", 45), ("grid", 135))
    ]
    lambert, grid = scene_sources(scene(*bodies), INSTRUMENT, "F662")[1:]
    spec = ParametricAlbedo(log10_mh=1, log10_fsed=0.5, insolation_au=2, phase_function="grid")
    ratio = phase_value(spec, 120.0) / _lambert(120.0)
    assert grid.contrast / lambert.contrast == pytest.approx(ratio, rel=1e-12)
    assert abs(ratio - 1.0) > 0.05


def _lambert(phase_deg):
    angle = np.radians(phase_deg)
    return (np.sin(angle) + (np.pi - angle) * np.cos(angle)) / np.pi


# --- the table and the batch


def test_companions_off_leaves_them_out():
    near = {"v_mag": 4.0, "teff_k": 5800, "separation_arcsec": 3.0, "pa_deg": 20}
    assert len(spectrum_generator(scene(stars=[near], companions="off"))) == 1
    assert len(scene_sources(scene(stars=[near]), INSTRUMENT, "F520")) == 2


def test_companions_off_leaves_stars_of_the_field_in():
    near = {"v_mag": 4.0, "teff_k": 5800, "separation_arcsec": 3.0, "pa_deg": 20}
    field = near | {"name": "field", "pa_deg": 200, "companion": False}
    names = [source.name for source in scene_sources(scene(stars=[near, field], companions="off"), INSTRUMENT, "F520")]
    assert names == ["s", "field"]
    assert [source.name for source in scene_sources(load_scene("paper_science"), INSTRUMENT, "F520")] == [
        "alpha Cen B",
        "planet",
        "calibration star",
    ]


def test_the_whole_catalogue_at_once():
    from cpic_planner import load_targets

    stars = load_targets()
    batch = spectrum_generator(scenes_from_table(stars, planet=PLANET | {"albedo": "jupiter"}))
    scenes = scenes_from_table(stars.iloc[:200], planet=PLANET)
    rates = [scene_sources(one, INSTRUMENT, "F520") for one in scenes]
    assert len(batch) == len(stars)
    host = np.array([sources[0].rate_e_s for sources in rates])
    passbands = Passbands.from_instrument(INSTRUMENT)
    columns = (stars[name].to_numpy()[:200] for name in ("v_mag", "teff_k", "log_g", "metallicity"))
    expected = passbands.star_rate_e_s(*columns, INSTRUMENT.telescope.area_cm2)[:, 0]
    np.testing.assert_allclose(host, expected, rtol=1e-12)


def test_measured_albedo_is_the_shipped_table():
    row = spectrum_generator(scene(PLANET))["b"]
    at = np.searchsorted(row.wavelength_nm, 890.0)
    table = load_albedo("jupiter")
    expected = 9.441e-8 * np.interp(row.wavelength_nm[at], table.wavelength_nm, table.albedo)
    assert row.contrast[at] == pytest.approx(expected, rel=1e-4)


def test_extended_light_is_a_share_of_the_stars(refused):
    disc = {"inner_arcsec": 0.3, "outer_arcsec": 0.6}
    scene = load_scene(
        {
            "name": "s",
            "cstar": {"v_mag": 3, "teff_k": 5230},
            "extended": [disc | {"contrast": 1e-5}, disc | {"v_mag": 18}],
        }
    )
    instrument = load_instrument()
    for band in ("F520", "F850"):
        star = scene_sources(scene, instrument, band)[0].rate_e_s
        found = extended_rates(scene, instrument, band)
        assert [item.source for item in found] == list(scene.extended)
        assert [item.rate_e_s for item in found] == pytest.approx([1e-5 * star, 1e-6 * star], rel=1e-13)
        assert [item.contrast for item in found] == pytest.approx([1e-5, 1e-6])
    assert extended_rates(load_scene("paper_example"), instrument, "F662") == ()
    refused("band", extended_rates, scene, instrument, "F999")


def scene_of_source_table(**parts):
    return load_scene({"name": "s", "cstar": STAR} | parts)


def test_table_is_read_by_row_by_name_and_by_column():
    table = spectrum_generator(
        scene_of_source_table(planets=[PLANET], stars=[{"v_mag": 9, "teff_k": 4000, "separation": 2, "pa": 180}])
    )
    assert len(table) == 3
    assert [row.name for row in table] == list(table.name) == ["s", "b", "star 1"]
    assert table.kind == table["kind"] == ("cstar", "planet", "star")
    assert table["b"] is table[1]
    assert table[1:] == (table[1], table[2])
    assert table[1]["x_arcsec"] == table.x_arcsec[1]
    assert {"name", "kind", "x_arcsec", "y_arcsec", "spectrum"} <= set(table.columns)
    assert all(np.shape(table[column])[0] == 3 for column in ("x_arcsec", "y_arcsec", "distance_au"))
    assert len(table.spectrum) == 3
    with pytest.raises(InputError, match="x_arcsec"):
        table["z"]
    with pytest.raises(InputError, match="x_arcsec"):
        table[0]["z"]
    with pytest.raises(IndexError):
        table[3]


def test_table_in_pandas_and_astropy():
    table = spectrum_generator(scene_of_source_table(planets=[PLANET]))
    frame = table.to_pandas()
    assert list(frame.name) == ["s", "b"]
    np.testing.assert_array_equal(frame.x_arcsec, table.x_arcsec)
    quantities = table.to_table()
    assert quantities["distance_au"][1].to_value(u.km) == pytest.approx(0.8775 * 149597870.7)
    batch = spectrum_generator([scene_of_source_table(planets=[PLANET]), scene_of_source_table()])
    assert list(batch.to_pandas().scene) == ["s", "s", "s"]
    assert len(batch.to_table()) == 3


def test_a_batch_is_its_scenes_one_by_one():
    trees = [
        {"name": f"s{n}", "cstar": STAR | {"v_mag": float(n)}, "planet": PLANET | {"pa_deg": 10.0 * n}}
        for n in range(5)
    ]
    batch = spectrum_generator([*trees[:4], load_scene(trees[4])])
    assert len(batch) == 5
    assert batch["s3"] is batch[3]
    assert [table.scene for table in batch[1:3]] == ["s1", "s2"]
    for tree, table in zip(trees, batch, strict=True):
        alone = spectrum_generator(tree)
        np.testing.assert_array_equal(alone.x_arcsec, table.x_arcsec)
        np.testing.assert_array_equal(alone["b"].photlam, table["b"].photlam)
    assert len(spectrum_generator([])) == 0
    with pytest.raises(InputError, match="allowed: the name of a scene of the batch"):
        batch["s9"]


def test_faults_found_late_name_the_scene_of_the_batch(refused):
    cold = {"name": "cold", "cstar": {"v_mag": 3, "teff_k": 2500}}
    batch = spectrum_generator([{"name": "a", "cstar": STAR}, cold])
    with pytest.raises(InputError, match=r"scenes.1.cstar.teff_k = 2500"):
        _ = batch["cold"][0].photlam
    refused(r"scene.cstar.teff_k = 2500", scene_sources, load_scene(cold), INSTRUMENT, "F520")


def test_tables_travel_to_other_processes():
    table = spectrum_generator(scene_of_source_table(planets=[PLANET]))
    again = pickle.loads(pickle.dumps(table))
    np.testing.assert_array_equal(again["b"].photlam, table["b"].photlam)


@pytest.mark.parametrize(
    ("pa_deg", "parity", "x", "y"),
    [
        (0.0, -1, 0.0, 1.0),  # north is up
        (90.0, -1, -1.0, 0.0),  # east is left
        (180.0, -1, 0.0, -1.0),
        (270.0, -1, 1.0, 0.0),
        (0.0, 1, 0.0, 1.0),
        (90.0, 1, 1.0, 0.0),  # the mirrored figures: east is right
        (270.0, 1, -1.0, 0.0),
    ],
)
def test_pictures_at_roll_zero(pa_deg: float, parity: int, x: float, y: float) -> None:
    np.testing.assert_allclose(sky_to_detector(1.0, pa_deg, parity=parity), (x, y), atol=1e-15)


def test_default_orientation_is_that_of_the_sky() -> None:
    # Oracle: tangent-plane offsets of astropy; east is +lon, drawn to the left (-x).

    star = SkyCoord(ra=10.0 * u.deg, dec=20.0 * u.deg)
    for pa in (10.0, 100.0, 200.0, 300.0):
        source = star.directional_offset_by(pa * u.deg, 1.0 * u.arcsec)
        east, north = (offset.to_value(u.arcsec) for offset in star.spherical_offsets_to(source))
        x, y = sky_to_detector(1.0, pa)
        assert x == pytest.approx(-east, abs=1e-5)
        assert y == pytest.approx(north, abs=1e-5)


@given(st.floats(1e-3, 60.0), st.floats(0.0, 359.999), st.floats(-360.0, 360.0), st.sampled_from([-1, 1]))
def test_round_trip(separation: float, pa: float, roll: float, parity: int) -> None:
    found, angle = detector_to_sky(
        *sky_to_detector(separation, pa, roll_deg=roll, parity=parity), roll_deg=roll, parity=parity
    )
    assert found == pytest.approx(separation, rel=1e-13)
    assert 0.0 <= angle < 360.0
    assert abs((angle - pa + 180.0) % 360.0 - 180.0) < 1e-10


def test_arrays_and_the_star_itself() -> None:
    x, y = sky_to_detector([0.4, 0.65], [[45.0], [135.0], [225.0]])
    assert x.shape == y.shape == (3, 2)
    separation, pa = detector_to_sky(0.0, 0.0)
    assert separation == 0.0
    assert pa == 0.0
    assert detector_to_sky(1e-300, 1.0)[1] < 360.0


@pytest.mark.parametrize(
    "call",
    [
        lambda: sky_to_detector(-1.0, 0.0),
        lambda: sky_to_detector(np.nan, 0.0),
        lambda: sky_to_detector(1.0, np.inf),
        lambda: sky_to_detector(1.0, 0.0, roll_deg=np.nan),
        lambda: sky_to_detector(1.0, 0.0, parity=0),
        lambda: detector_to_sky(np.nan, 0.0),
        lambda: detector_to_sky(1.0, 0.0, parity=2),
    ],
)
def test_bad_input_is_refused(refused, call) -> None:
    refused("", call)


@pytest.mark.parametrize("parity", [-1, 1])
@pytest.mark.parametrize("roll_deg", [0.0, 30.0, -125.0])
def test_written_world_coordinates_say_the_same(parity, roll_deg):
    star = SkyCoord(219.9, -60.8, unit="deg")
    keywords = wcs_keywords(0.016153, (536.0, 514.0), (219.9, -60.8), roll_deg=roll_deg, parity=parity)
    wcs = WCS(fits.Header(keywords))
    for separation, pa in ((0.7, 90.0), (0.5, 215.0), (3.0, 0.0)):
        x, y = sky_to_detector(separation, pa, roll_deg=roll_deg, parity=parity)
        place = wcs.pixel_to_world(536.0 + x / 0.016153, 514.0 + y / 0.016153)
        assert star.separation(place).arcsec == pytest.approx(separation, rel=1e-6)
        assert star.position_angle(place).deg % 360 == pytest.approx(pa, abs=1e-3)


def test_world_coordinates_of_a_star_without_a_place_are_offsets():
    keywords = wcs_keywords(0.016153, (68.0, 68.0), (None, None))
    assert (keywords["CTYPE1"], keywords["CRVAL1"]) == ("EAST", 0.0)
    east = keywords["CD1_1"] * (sky_to_detector(0.65, 90.0)[0] / 0.016153)
    assert east * 3600 == pytest.approx(0.65)
