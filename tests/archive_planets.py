"""Rows of the NASA Exoplanet Archive's table ``ps`` as its service would send them, written by hand."""

ENDS = ("", "err1", "err2", "lim")
MEASURED = "pl_orbper pl_orbsmax pl_orbeccen pl_orblper pl_orbtper pl_tranmid pl_orbincl pl_bmassj pl_msinij pl_radj"
MEASURED = [*MEASURED.split(), "st_mass"]
COLUMNS = {
    "period_days": ("period_err_days", "pl_orbper"),
    "semi_major_axis_au": ("semi_major_axis_err_au", "pl_orbsmax"),
    "eccentricity": ("eccentricity_err", "pl_orbeccen"),
    "omega_star_deg": ("omega_err_deg", "pl_orblper"),
    "periastron_jd": ("periastron_err_days", "pl_orbtper"),
    "conjunction_jd": ("conjunction_err_days", "pl_tranmid"),
    "inclination_deg": ("inclination_err_deg", "pl_orbincl"),
    "radius_rjup": ("radius_err_rjup", "pl_radj"),
    "star_mass_msun": ("star_mass_err_msun", "st_mass"),
}
LINK = "<a refstr=THOMPSON_ET_AL__2025 href=https://ui.adsabs.harvard.edu/abs/{}/abstract target=ref>{}</a>"


def row(pl_name="eps Eri b", hostname="eps Eri", **given):
    """One solution; a number is a value, three of them are a value and its upper and lower error."""
    texts = {
        "pl_name": pl_name,
        "hostname": hostname,
        "pl_letter": pl_name[-1],
        "hd_name": "HD 22049",
        "hip_name": "HIP 16537",
        "default_flag": 1,
        "soltype": "Published Confirmed",
        "pl_controv_flag": 0,
        "discoverymethod": "Radial Velocity",
        "pl_bmassprov": "Msini",
        "pl_refname": LINK.format("2025AJ....170..301T", "Thompson et al. 2025"),
        "pl_pubdate": "2025-11",
        "rowupdate": "2025-12-11",
        "ra": 53.2288,
        "dec": -9.4581,
        "sy_dist": 3.2026,
    }
    numbers = {
        "pl_orbper": (2678.0, 27.0, -29.0),
        "pl_orbsmax": (3.53, 0.04, -0.04),
        "pl_orbeccen": (0.06, 0.06, -0.04),
    }
    numbers |= {"pl_bmassj": 0.98} | {name: given.pop(name) for name in MEASURED if name in given}
    cells = {}
    for name in MEASURED:
        value = numbers.get(name)
        parts = value if isinstance(value, tuple) else (value, None, None)
        cells |= dict(zip([f"{name}{end}" for end in ENDS], (*parts, None if value is None else 0), strict=True))
    return texts | cells | given


def shipped_rows(planets, stars):
    """Rows in which the archive would say what a table of ours says of its counted planets."""
    places = {star["name"]: star for star in map(stars.row, range(len(stars)))}
    found = []
    for i in range(len(planets)):
        if not planets.counted[i]:
            continue
        name, star = planets.text("planet")[i], places[planets.text("star")[i]]
        numbers = {}
        for ours, (error, theirs) in COLUMNS.items():
            value, err = (float(planets.number(column)[i]) for column in (ours, error))
            if value == value:
                numbers[theirs] = (value, err, -err) if err == err else value
        for ours, kind in (("mass_mjup", "Mass"), ("msini_mjup", "Msini")):
            value = float(planets.number(ours)[i])
            if value == value:
                numbers |= {"pl_bmassj": value, "pl_bmassprov": kind}
                break
        else:
            numbers["pl_bmassj"] = None
        blank = dict.fromkeys(MEASURED)
        about = {"hd_name": star["hd"], "hip_name": "", "ra": star["ra_deg"], "dec": star["dec_deg"]}
        about |= {"sy_dist": star["distance_pc"], "pl_letter": name.split()[-1], "rowupdate": "2020-01-01"}
        found.append(row(name, star["name"], **(blank | numbers | about)))
    return found
