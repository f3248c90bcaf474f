"""``stars_counts.csv``: how many stars each cut leaves, from the source to the catalogue."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from catalogs.builders._star_identity import Identity
from catalogs.builders._star_physics import luminosity_class
from catalogs.builders._star_select import MIN_PARALLAX_MAS, Removed, is_blend_id
from catalogs.builders._star_sources import SimbadStar

__all__ = ["count_rows"]


def count_rows(
    stars: Sequence[SimbadStar], people: Sequence[Identity], removed: Sequence[Removed]
) -> list[tuple[str, str, int, str, str]]:
    """Return (group, what, count, reference count, note); the reference is an independent count of the source."""
    near = [s for s in stars if s.parallax_mas >= MIN_PARALLAX_MAS]
    fgk = [s for s in near if s.sp_type[:1] in ("F", "G", "K")]
    paper = [s for s in fgk if 0.0 <= s.v_mag <= 7.0]
    classes = Counter(luminosity_class(s.sp_type) for s in paper)
    dwarfs = [s for s in paper if luminosity_class(s.sp_type) in ("V", "IV-V")]
    bright_removed = [item for item in removed if item.star.v_mag <= 7.0]
    blends = [item for item in bright_removed if item.reason.startswith("blend")]
    bright = [p for p in people if p.row.star.v_mag <= 7.0]
    main = [p for p in bright if luminosity_class(p.row.star.sp_type) in ("V", "IV-V")]
    rows: list[tuple[str, str, int, str, str]] = [
        ("source", "all rows", len(stars), "78279", ""),
        ("source", "parallax >= 25 mas", len(near), "5515", ""),
        ("source", "and F, G or K", len(fgk), "3445", "first letter of the type; the reference count is not reproduced (3446 with leading sd, k or d)"),
        ("source", "and 0 <= V <= 7", len(paper), "1094", ""),
        ("source", "and V < 0", sum(s.v_mag < 0.0 for s in fgk), "", "alf Cen A, Arcturus and the blend of alf Cen"),
        ("source class", "V", classes["V"], "771", ""),
        ("source class", "IV-V", classes["IV-V"], "40", ""),
        ("source class", "IV", classes["IV"], "112", ""),
        ("source class", "III", classes["III"] + classes["III-IV"], "91", "with III-IV"),
        ("source class", "none", classes[""], "76", ""),
        ("source class", "I and II", classes["I"] + classes["II"], "4", ""),
        ("source", "dwarfs (V, IV-V) with 0 <= V <= 7", len(dwarfs), "811", ""),
        ("source", "dwarfs without close companion", sum(not s.binary_cut for s in dwarfs), "669", "the paper's 'nearly 700'"),
        ("source", "CCDM and ** identifiers, 0 <= V <= 7", sum(s.simbad_id.startswith(("CCDM", "**")) for s in paper), "59", ""),
        ("source", "of all identifiers, those of blends", sum(is_blend_id(s.simbad_id) for s in paper), "", "two or more component letters; the other CCDM entries are single components"),
        ("catalogue", "V <= 7 in the cut, no bright limit", len(paper) + sum(s.v_mag < 0.0 for s in fgk), "", ""),
        ("catalogue", "removed, V <= 7: blend with listed components", len(blends), "", "see stars_removed.csv"),
        ("catalogue", "removed, V <= 7: adopted parallax below 25 mas", len(bright_removed) - len(blends), "", "see stars_removed.csv"),
        ("catalogue", "rows with V <= 7 (ranked)", len(bright), "", ""),
        ("catalogue", "of them dwarfs (V, IV-V)", len(main), "", ""),
        ("catalogue", "of them without close companion", sum(not p.row.star.binary_cut for p in main), "", ""),
        ("catalogue", "rows with V <= 7.5 (all)", len(people), "", ""),
        ("catalogue", "of them blends kept, no component listed", sum("composite" in p.row.flags for p in people), "", ""),
    ]  # fmt: skip
    return rows
