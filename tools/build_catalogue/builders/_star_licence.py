"""Licence notice of the SIMBAD-derived tables."""

SHORT_LICENCE = "ODbL-1.0 (database derived from SIMBAD; see STARS_LICENCE.md)"

LICENCE_TEXT = """\
# Licence of the star tables

`stars.csv`, `stars_counts.csv`, `stars_removed.csv`, `aliases.csv` and `known_stars.csv` in this folder are adapted
databases derived from an extract of the SIMBAD database. They are made available under the
**Open Database License (ODbL) 1.0**: <https://opendatacommons.org/licenses/odbl/1-0/>. Individual contents are facts;
any rights in them are licensed under the Database Contents License 1.0:
<https://opendatacommons.org/licenses/dbcl/1-0/>.

This licence covers these tables only. The program code has its own licence, and results computed from the tables
(rankings, images, reports) are produced works, which need attribution but no share-alike.

You may share, use and adapt the tables if you

- **attribute**: keep this notice, and name SIMBAD (CDS, Strasbourg) as the source;
- **share alike**: offer an adapted database under the ODbL;
- **keep open**: if you redistribute with technical restrictions, also offer a version without them.

## Acknowledgements

This work has made use of the SIMBAD database, operated at CDS, Strasbourg, France
(Wenger et al. 2000, A&AS 143, 9). The extract is the one distributed with EXOSIMS (Savransky et al.).

Parallaxes are partly those of the European Space Agency (ESA) mission Gaia (<https://www.cosmos.esa.int/gaia>),
processed by the Gaia Data Processing and Analysis Consortium (DPAC,
<https://www.cosmos.esa.int/web/gaia/dpac/consortium>). Funding for the DPAC has been provided by national institutions,
in particular the institutions participating in the Gaia Multilateral Agreement.

Further sources, each public: Hipparcos, the new reduction (van Leeuwen 2007, A&A 474, 653; ESA); ExoCat-1
(Turnbull 2015, arXiv:1510.01731) and system aliases from the NASA Exoplanet Archive, which is operated by the
California Institute of Technology, under contract with the National Aeronautics and Space Administration under the
Exoplanet Exploration Program; star names and cross identifications from d3-celestial (Olaf Frohn, BSD-3-Clause), after
Kostjuk 2002 (CDS IV/27A), Gliese & Jahreiss 1991 (CDS V/70A), the General Catalogue of Variable Stars and XHIP
(Anderson & Francis 2012, CDS V/137D).

Which file came from which source, with digests, is in `PROVENANCE.json`.
"""
