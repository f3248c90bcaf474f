"""The tables behind the TAP service of the tests: a small sky with every trap that the real one has."""

import math

# oid; main_id; ra; dec; plx; err; pmra; pmdec; rv; type; otype; B; V; their other names stand below by oid
_ROWS = """
1; * alf Cen; 219.87383; -60.83222; 742.0; -; -3608.0; 686.0; -; G2V+K1V; **; 0.6; -0.1
2; * alf Cen A; 219.9020583; -60.8339927; 754.81; 4.11; -3679.25; 473.67; -24.6; G2V; SB*; 0.72; 0.01
3; * alf Cen B; 219.8960917; -60.8375278; 796.92; 25.9; -3614.39; 802.98; -20.7; K1V; PM*; 2.21; 1.33
4; * tau Cet; 26.0170132; -15.9374787; 273.81; 0.17; -1721.05; 854.16; -16.68; G8V; PM*; 4.22; 3.5
5; * eps Eri; 53.2326873; -9.4582587; 310.5773; 0.1355; -974.76; 20.88; 16.38; K2V; BY*; 4.61; 3.83
6; HD 999001; 10.0; 20.0; 30.0; 0.03; 300.0; -40.0; 12.0; sdF8; PM*; -; 6.5
7; HD 999002; 50.0; 30.0; 40.0; -; 50.0; 60.0; -; dG2; **; 6.83; 6.2
8; HD 999003; 50.0; 30.005555555555556; 40.3; 0.02; 51.0; 60.5; 3.0; A5V; *; 6.05; 5.9
9; * alf Lyr; 279.2347348; 38.7836889; 130.23; 0.36; 200.94; 286.23; -20.6; A0Va; dS*; 0.03; 0.03
10; HD 95735; 165.8341459; 35.9698869; 392.75; 0.03; -580.06; -4776.59; -85.11; M2+V; Er*; 8.96; 7.49
11; HD 999004; 100.0; -5.0; 26.0; 0.05; 1.0; 2.0; 3.0; -; *; 7.6; 7.0
12; HD 999006; 101.0; -5.0; 26.0; 0.05; 1.0; 2.0; 3.0; ???; *; 7.6; 7.0
13; HD 999007; 102.0; -5.0; 26.0; 0.05; 1.0; 2.0; 3.0; G5V; *; 7.6; -
14; HD 999008; 103.0; -5.0; 24.999; 0.05; 1.0; 2.0; 3.0; G5V; *; 7.6; 7.0
15; HD 999005; 104.0; -5.0; 25.0; 0.05; 1.0; 2.0; 3.0; K3V; *; 8.5; 7.5
16; HD 999009; 105.0; -5.0; 30.0; 0.05; 1.0; 2.0; 3.0; G5V; *; 8.1; 7.501
17; HD 999010; 150.0; 10.0; 35.0; 0.5; 10.0; 10.0; 1.0; G0V+G5V; **; 6.6; 6.0
18; HD 999010A; 150.0005; 10.0; 35.2; 0.05; 11.0; 10.0; 1.0; G0V; *; 7.1; 6.5
19; HD 999010B; 149.9995; 10.0; 34.9; 0.5; 12.0; 10.0; 1.0; G5V; *; 7.8; 7.1
20; * alf Aur; 79.1723279; 45.9979915; 76.2; 0.46; 75.25; -426.89; 29.2; G3III:; SB*; 0.88; 0.08
21; HD 999011; 200.0; 40.0; 45.0; 0.04; 1.0; 1.0; 1.0; kA5hF2mF4; *; 6.9; 6.5
22; HD 999012; 210.0; 40.0; 27.0; 4.0; 1.0; 1.0; 1.0; K0III; RG*; 7.0; 5.9
"""
_IDS = {
    1: "* alf Cen|WDS J14396-6050AB|CCDM J14396-6050AB|GJ   559",
    2: "*  alf Cen A|HIP 71683|HD 128620|GJ   559 A|WDS J14396-6050A|NAME Rigil Kentaurus|2MASS J14393650-6050023",
    3: "*  alf Cen B|HIP 71681|HD 128621|GJ   559 B|WDS J14396-6050B|NAME Toliman",
    4: "* tau Cet|* 52 Cet|HD  10700|HIP 8102|GJ    71|HR   509|NAME Durre Menthor",
    5: "* eps Eri|* 18 Eri|HD  22049|HIP 16537|GJ   144|NAME Ran",
    6: "HD 999001|TYC 1-2-1",
    7: "HD 999002|HIP 119901",
    8: "HD 999003",
    9: "* alf Lyr|NAME Vega|HIP 91262|HD 172167",
    10: "HD  95735|GJ   411|HIP 54035",
    11: "HD 999004",
    12: "HD 999006",
    13: "HD 999007",
    14: "HD 999008",
    15: "HD 999005",
    16: "HD 999009",
    17: "HD 999010|WDS J10000+1000AB",
    18: "WDS J10000+1000A",
    19: "WDS J10000+1000B",
    20: "* alf Aur|HIP 24608|HD  34029|NAME Capella|WDS J05168+4559Aa,Ab|GJ   194|CCDM J05168+4559AP",
    22: "HD 999012|V* ZZ Tst",
}


def _value(cell):
    """Return the number that a cell holds, None of a dash, else its text."""
    try:
        return None if cell == "-" else int(cell) if cell.isdigit() else float(cell)
    except ValueError:
        return cell


_TABLE = [[_value(cell) for cell in line.split("; ")] for line in _ROWS.strip().splitlines()]
STARS = [(*row, _IDS.get(row[0])) for row in _TABLE]
# oid, Teff, log g, [Fe/H], bibcode
MEASUREMENTS = [
    (4, 5300, 4.4, -0.50, "2005ApJS..159..141V"),
    (4, 5400, 4.6, -0.60, "2021A&A...656A..53S"),
    (4, 5344, 4.5, -0.52, "2013MNRAS.428.3164M"),
    (4, 0, None, 9.99, "1901ApJ.....1....1X"),
    (4, None, None, -0.40, "1999A&A...999..999Z"),
    (2, 5792, 4.31, 0.26, "2013A&A...555A.104T"),
    (2, 5801, 4.30, 0.20, "2003A&A...411..559K"),
    (6, 6100, 4.2, -1.10, "2010A&A...512A..54C"),
    (9, 9600, 3.9, -0.50, "2007ApJ...664.1185Y"),
    (14, 5600, 4.4, 0.0, "2007ApJ...664.1185Y"),
]


def small_sky():
    """Return the tables; objects without V have no row of fluxes or an empty one, as in SIMBAD."""
    names = ("oid", "main_id", "ra", "dec", "plx_value", "plx_err", "pmra", "pmdec", "rvz_radvel", "sp_type", "otype")
    return {
        "basic": [dict(zip(names, star, strict=False)) | {"nbref": 1} for star in STARS],
        "allfluxes": [{"oidref": star[0], "b": star[11], "v": star[12], "k": None} for star in STARS],
        "ids": [{"oidref": star[0], "ids": star[13]} for star in STARS if star[13]],
        "mesfe_h": [
            {"oidref": oid, "teff": teff, "log_g": log_g, "fe_h": fe_h, "bibcode": bibcode, "mespos": i}
            for i, (oid, teff, log_g, fe_h, bibcode) in enumerate(MEASUREMENTS)
        ],
    }


def snapshot_sky(table):
    """Return tables in which SIMBAD would say just what the snapshot says."""
    rows = [table.row(i) for i in range(len(table))]
    tables = {"basic": [], "allfluxes": [], "ids": [], "mesfe_h": []}
    for oid, row in enumerate(rows, start=1):
        names = [row["simbad_id"], row["hd"], row["gj"]]
        shared = sum(other["hip"] == row["hip"] for other in rows) > 1
        names += [f"HIP {row['hip']}"] if row["hip"] and not shared else []
        tables["basic"].append(
            {
                "oid": oid,
                "main_id": row["simbad_id"],
                "ra": row["ra_deg"],
                "dec": row["dec_deg"],
                "plx_value": row["parallax_mas"],
                "plx_err": None if math.isnan(row["parallax_err_mas"]) else row["parallax_err_mas"],
                "pmra": row["pm_ra_mas_yr"],
                "pmdec": row["pm_dec_mas_yr"],
                "rvz_radvel": row["rv_km_s"] if row["rv_km_s_src"] == "measured" else None,
                "sp_type": row["sp_type"],
                "otype": "*",
            }
        )
        tables["allfluxes"].append({"oidref": oid, "b": row["v_mag"] + row["b_v_mag"], "v": row["v_mag"]})
        tables["ids"].append({"oidref": oid, "ids": "|".join(filter(None, names))})
    return tables
