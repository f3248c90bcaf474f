"""Questions to the calculator as they might come, from a seed: options of the command line, as words."""

import random

STARS = ["tau Cet", "eps Eri", "HIP 99240", "alpha Cen B", "HD 10700", "82 Eri", "61 Cyg A", "eps Ind", "beta Hyi"]
PLANETS = ["eps Eri b", "47 UMa c", "ups And d", "eps Ind A b"]
BANDS = ["F520", "F662", "F720", "F850"]
CHANGES = ["throughput=x0.7", "drift.visit_nm=0.1nm", "detector.read_noise_e=160", "drift=x2"]


def question(seed):
    """Return the options of one question, as (option, value); a value of None stands for none."""
    draw = random.Random(f"question {seed}")
    some = draw.random
    given = []
    kind = draw.choice(["star", "star", "star", "planet", "own"])
    if kind == "own":
        given += [("--v-mag", f"{draw.uniform(1, 6):.3f}"), ("--sp-type", draw.choice(["F5V", "G8V", "K2V"]))]
        given += [("--distance-pc", f"{draw.uniform(2, 20):.4g}")] * (some() < 0.7)
        given += [("TARGET", "Bob")] * (some() < 0.5)
    else:
        given.append(("TARGET", draw.choice(PLANETS if kind == "planet" else STARS)))
    asked = draw.choice(["snr", "detect", "time", "limit", "sigma"])
    if asked == "snr":
        given.append(("--snr", f"{draw.uniform(3, 12):.3f}"))
    elif asked == "sigma":
        given.append(("--sigma", f"{draw.uniform(3, 8):.2f}"))
    elif asked == "detect":
        given.append(("--detect", None))
    else:
        given.append(("--time-s", f"{draw.uniform(2e3, 1e5):.6g}"))
        given += [("--contrast-limit", None)] * (asked == "limit")
    if kind != "planet":
        if some() < 0.6:
            given.append(("--separation-arcsec", f"{draw.uniform(0.3, 0.9):.4f}"))
        elif asked != "limit" and some() < 0.3:
            given.append(("--separation-au", f"{draw.uniform(1, 4):.3f}"))
        if asked != "limit" and some() < 0.3:
            given.append(("--contrast", f"{10 ** draw.uniform(-9, -7.5):.4g}"))
        elif asked != "limit" and some() < 0.4:
            given.append(("--planet-radius-rjup", f"{draw.uniform(0.5, 1.5):.3f}"))
            given += [("--albedo", draw.choice(["saturn", "uranus", "0.37"]))] * (some() < 0.5)
    else:
        given += [("--date", f"20{draw.randint(28, 35)}-0{draw.randint(1, 9)}-15")]
    given += [("--band", band) for band in sorted(draw.sample(BANDS, draw.randint(1, 2)))]
    given += [("--visits", str(draw.randint(1, 12)))] * (some() < 0.3)
    given += [("--library", draw.choice(["archive", "roll", "same_star_planet_free"]))] * (some() < 0.3)
    given += [("--search", "known_place")] * (some() < 0.3)
    given += [("--exozodi", f"{draw.uniform(0, 5):.3f}")] * (some() < 0.3)
    given += [("--set", draw.choice(CHANGES))] * (some() < 0.3)
    return given


def words(given):
    """Return the words of the command."""
    flat = []
    for option, value in given:
        flat += [value] if option == "TARGET" else [option] if value is None else [option, value]
    return flat


def pairs(given):
    """Return the parameters of the address: names of options with underscores, as the address takes them too."""
    return [(option.lstrip("-").replace("-", "_").lower(), "on" if value is None else value) for option, value in given]
