"""``stars_counts.csv``: how many stars each cut leaves, from the source to the catalogue."""

from collections import Counter
from collections.abc import Sequence

from catalogs.simbad import is_blend_id
from catalogs.stellar_physics import luminosity_class
from tools.build_catalogue.builders._star_identity import Identity
from tools.build_catalogue.builders._star_select import MIN_PARALLAX_MAS, Removed
from tools.build_catalogue.builders._star_sources import SimbadStar


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
    see = "see stars_removed.csv"
    source: list[tuple[str, int, str, str]] = [
        ("all rows", len(stars), "78279", ""),
        ("parallax >= 25 mas", len(near), "5515", ""),
        ("and F, G or K", len(fgk), "3445", "first letter of the type; the reference count is not reproduced"),
        ("and 0 <= V <= 7", len(paper), "1094", ""),
        ("and V < 0", sum(s.v_mag < 0.0 for s in fgk), "", "alf Cen A, Arcturus and the blend of alf Cen"),
        ("dwarfs (V, IV-V) with 0 <= V <= 7", len(dwarfs), "811", ""),
        ("dwarfs without close companion", _single(dwarfs), "669", "the paper's 'nearly 700'"),
        ("CCDM and ** identifiers, 0 <= V <= 7", _count_names(paper, ("CCDM", "**")), "59", ""),
        ("of all identifiers, those of blends", _blends(paper), "", "two or more component letters"),
    ]
    source_class: list[tuple[str, int, str, str]] = [
        ("V", classes["V"], "771", ""),
        ("IV-V", classes["IV-V"], "40", ""),
        ("IV", classes["IV"], "112", ""),
        ("III", classes["III"] + classes["III-IV"], "91", "with III-IV"),
        ("none", classes[""], "76", ""),
        ("I and II", classes["I"] + classes["II"], "4", ""),
    ]
    catalogue: list[tuple[str, int, str, str]] = [
        ("V <= 7 in the cut, no bright limit", sum(s.v_mag <= 7.0 for s in fgk), "", ""),
        ("removed, V <= 7: blend with listed components", len(blends), "", see),
        ("removed, V <= 7: adopted parallax below 25 mas", len(bright_removed) - len(blends), "", see),
        ("rows with V <= 7 (ranked)", len(bright), "", ""),
        ("of them dwarfs (V, IV-V)", len(main), "", ""),
        ("of them without close companion", _single([p.row.star for p in main]), "", ""),
        ("rows with V <= 7.5 (all)", len(people), "", ""),
        ("of them blends kept, no component listed", sum("composite" in p.row.flags for p in people), "", ""),
    ]
    groups = (("source", source), ("source class", source_class), ("catalogue", catalogue))
    return [(group, *row) for group, rows in groups for row in rows]


def _single(stars: Sequence[SimbadStar]) -> int:
    return sum(not star.binary_cut for star in stars)


def _count_names(stars: Sequence[SimbadStar], starts: tuple[str, ...]) -> int:
    return sum(star.simbad_id.startswith(starts) for star in stars)


def _blends(stars: Sequence[SimbadStar]) -> int:
    return sum(is_blend_id(star.simbad_id) for star in stars)
