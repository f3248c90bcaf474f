"""Discs, rings and images as people write them."""

import json

import astropy.units as u
import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError
from simulator.config import DiscSource, ImageSource, RingSource, Scene, load_scene
from simulator.config.scene import extended_source

STAR = {"v_mag": 3.0, "teff_k": 5230}
DISC = {"contrast": 1e-6, "inner_arcsec": 0.3, "outer_arcsec": 0.6, "slope": -2, "inclination_deg": 60, "pa_deg": 40}


def scene(**change):
    return {"name": "s", "cstar": STAR} | change


def picture(path):
    fits.writeto(path, np.ones((5, 5)), overwrite=True)
    return str(path)


@pytest.mark.parametrize("key", ["extended", "disc", "disk", "discs", "exozodi"])
def test_all_spellings_give_one_scene(key):
    spelled = {"contrast": 1e-6, "inner": 0.3, "outer": 0.6, "slope": -2, "inclination": 60, "PA": 40, "kind": "Disk"}
    one, other = load_scene(scene(extended=[DISC])), load_scene(scene(**{key: spelled}))
    assert one == other
    assert one.content_hash == other.content_hash
    assert one.extended[0].name == "extended 1"
    assert isinstance(one.extended[0], DiscSource)


def test_the_keys_decide_what_it_is(tmp_path):
    ring = extended_source({"v_mag": 15, "radius": 0.5, "fwhm": 0.05})
    image = extended_source({"contrast": 1e-4, "file": tmp_path / picture(tmp_path / "a.fits"), "pixscale": 0.02})
    assert (type(ring), type(image)) == (RingSource, ImageSource)
    assert extended_source(ring) is ring
    mixed = Scene(name="s", cstar=STAR, extended=[ring, DISC, image])
    assert [source.kind for source in mixed.extended] == ["ring", "disc", "image"]
    assert [source.name for source in mixed.extended] == ["extended 1", "extended 2", "extended 3"]


def test_scenes_go_round_through_json_and_hash_by_content(tmp_path):
    image = {"contrast": 1e-4, "image": picture(tmp_path / "a.fits"), "center_pixel": [1, 2], "center_separation": 0.1}
    first = load_scene(scene(extended=[DISC, {"v_mag": 15, "radius": 0.5, "fwhm": 0.05}, image]))
    again = load_scene(json.loads(json.dumps(first.model_dump(mode="json"))))
    assert again == first
    assert again.content_hash == first.content_hash
    hashes = {
        load_scene(scene(disc=DISC | change)).content_hash
        for change in ({}, {"pa_deg": 41}, {"contrast": 2e-6}, {"center_separation_arcsec": 0.1}, {"slope": 0})
    }
    assert len(hashes) == 5
    assert load_scene(scene()).extended == load_scene(scene(disc=None)).extended == ()


def test_quantities_of_astropy():
    found = extended_source(DISC | {"inner_arcsec": 300 * u.mas, "inclination_deg": (np.pi / 3) * u.rad})
    assert found.inner_arcsec == pytest.approx(0.3)
    assert found.inclination_deg == pytest.approx(60)


def test_magnitudes_are_totals_with_the_stars_spectrum():
    faint = extended_source({"v_mag": 15.5, "radius": 0.5, "fwhm": 0.05})
    assert faint.contrast_to(3.0) == pytest.approx(1e-5)
    assert extended_source(DISC).contrast_to(3.0) == 1e-6


def test_files_are_looked_for_beside_the_scene(tmp_path):
    picture(tmp_path / "disc.fits")
    (tmp_path / "s.yaml").write_text(
        "kind: scene\nname: s\ncstar: {v_mag: 3, teff_k: 5230}\n"
        "extended:\n- {file: disc.fits, contrast: 1e-5, pixel_scale_arcsec: 0.01}\n",
        encoding="utf-8",
    )
    assert load_scene(tmp_path / "s.yaml").extended[0].file == str(tmp_path / "disc.fits")


def test_more_faults(refused, tmp_path):
    refused(r"scene.extended.0 = 5: .*a mapping", load_scene, scene(disc=5))
    refused("given with", load_scene, scene(disc=DISC, exozodi=DISC))
    refused(r"file = nope.fits: .*existing", load_scene, scene(disc={"file": "nope.fits", "contrast": 1e-3}))
    with pytest.raises(InputError, match=r"extended.1.name = a: .*that of extended.0"):
        load_scene(scene(extended=[DISC | {"name": "a"}, DISC | {"name": "a"}]))
    refused("fwhm_arcsec", load_scene, scene(disc={"kind": "ring", "contrast": 1e-3, "radius": 0.4}))
    refused("a mapping", extended_source, "disc")
