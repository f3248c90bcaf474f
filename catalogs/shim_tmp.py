import re


def star_name_of(row):
    for key, pre in (
        ("hip", "HIP "),
        ("hd", "HD "),
        ("gj", "GJ "),
        ("hr", "HR "),
        ("tic", "TIC "),
        ("gaia", "Gaia DR3 "),
    ):
        if key in row:
            t = str(row[key])
            return t if not t[:1].isdigit() else pre + t
    if "planet" in row:
        return (host_of_planet(row["planet"]) or (None,))[0]


def host_of_planet(name):
    m = re.fullmatch(r"(.+?)\s+([b-z])", name)
    return (m[1], m[2]) if m else None


def coordinates_of(t):
    return None


def degrees_of(*p):
    return None


def written_unit(text):
    from astropy import units

    m = re.fullmatch(r"\[(.*)\]|(?:dex|log|log10)\((.*)\)", text)
    if text == "dex":
        return units.dimensionless_unscaled, True
    t = {"days": "d", "degrees": "deg", "years": "yr", "hours": "h", "mags": "mag", "jovMass": "jupiterMass"}.get(
        text, text
    )
    if m:
        return units.Unit(m[1] or m[2] or ""), True
    return units.Unit(t), False
