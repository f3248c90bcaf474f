"""Spellings of star names: one canonical key stands for every spelling of a designation.

``designation_key("α Cen B")``, ``("Alpha Centauri B")`` and ``("* alf Cen B")`` all give ``"alf cen b"``.
The key is lower case with one exception: a Latin Bayer letter keeps its case, because ``e Eri`` and ``E Eri``
would be different stars. Greek letters take SIMBAD's three-letter forms (``alf``, ``tet``, ``ksi``), constellations
the IAU abbreviations.
"""

import re
import unicodedata

#: SIMBAD abbreviation of each Greek letter -> (letter, other spellings).
_GREEK_NAMES = """
alf α alpha alp, bet β beta, gam γ gamma, del δ delta, eps ε epsilon epsi, zet ζ zeta, eta η, tet θ theta the thet,
iot ι iota, kap κ kappa, lam λ lambda, mu μ, nu ν, ksi ξ xi, omi ο omicron, pi π, rho ρ, sig σ sigma, tau τ,
ups υ upsilon, phi φ, chi χ khi, psi ψ, ome ω omega
"""
GREEK: dict[str, tuple[str, tuple[str, ...]]] = {
    short: (letter, tuple(others)) for short, letter, *others in map(str.split, _GREEK_NAMES.split(","))
}

_SKY_NAMES = """
And Andromedae, Ant Antliae, Aps Apodis, Aqr Aquarii, Aql Aquilae, Ara Arae, Ari Arietis, Aur
Aurigae, Boo Bootis, Cae Caeli, Cam Camelopardalis, Cnc Cancri, CVn Canum Venaticorum, CMa Canis
Majoris, CMi Canis Minoris, Cap Capricorni, Car Carinae, Cas Cassiopeiae, Cen Centauri, Cep Cephei,
Cet Ceti, Cha Chamaeleontis, Cir Circini, Col Columbae, Com Comae Berenices, CrA Coronae Australis,
CrB Coronae Borealis, Crv Corvi, Crt Crateris, Cru Crucis, Cyg Cygni, Del Delphini, Dor Doradus, Dra
Draconis, Equ Equulei, Eri Eridani, For Fornacis, Gem Geminorum, Gru Gruis, Her Herculis, Hor
Horologii, Hya Hydrae, Hyi Hydri, Ind Indi, Lac Lacertae, Leo Leonis, LMi Leonis Minoris, Lep
Leporis, Lib Librae, Lup Lupi, Lyn Lyncis, Lyr Lyrae, Men Mensae, Mic Microscopii, Mon Monocerotis,
Mus Muscae, Nor Normae, Oct Octantis, Oph Ophiuchi, Ori Orionis, Pav Pavonis, Peg Pegasi, Per
Persei, Phe Phoenicis, Pic Pictoris, Psc Piscium, PsA Piscis Austrini, Pup Puppis, Pyx Pyxidis, Ret
Reticuli, Sge Sagittae, Sgr Sagittarii, Sco Scorpii, Scl Sculptoris, Sct Scuti, Ser Serpentis, Sex
Sextantis, Tau Tauri, Tel Telescopii, Tri Trianguli, TrA Trianguli Australis, Tuc Tucanae, UMa Ursae
Majoris, UMi Ursae Minoris, Vel Velorum, Vir Virginis, Vol Volantis, Vul Vulpeculae
"""
CONSTELLATIONS: dict[str, str] = {short: " ".join(words) for short, *words in map(str.split, _SKY_NAMES.split(","))}
"""Latin genitive of each constellation by its IAU abbreviation."""

_GREEK_FORMS: dict[str, str] = {}
for _short, (_letter, _others) in GREEK.items():
    for _form in (_short, _letter, *_others):
        _GREEK_FORMS[_form] = _short
_GREEK_FORMS.update({"ς": "sig", "ϵ": "eps", "ϑ": "tet", "ϕ": "phi", "ϰ": "kap", "ϱ": "rho", "µ": "mu"})

_SKY: dict[str, str] = {short.lower(): short.lower() for short in CONSTELLATIONS}
_SKY.update({genitive.lower(): short.lower() for short, genitive in CONSTELLATIONS.items()})
_LONGEST_SKY = max(map(len, _SKY))

#: Catalogue prefixes that take a plain number; all the nearby-star lists share the Gliese-Jahreiss numbers.
_PREFIXES = {name: name for name in ("hip", "hd", "hr", "gj", "ltt", "lhs", "nltt", "sao", "ads")}
_PREFIXES |= {"hic": "hip", "bs": "hr"} | dict.fromkeys(("gl", "gliese", "wo", "nn"), "gj")


_CATALOGUE = re.compile(r"([a-z]+)\s*[-_]?\s*0*(\d+(?:\.\d+)?)\s*([a-e]{0,3})", re.IGNORECASE)
_COMPONENT = re.compile(r"[A-Ea-e]{1,3}")
_LETTER_INDEX = re.compile(r"([^\W\d]+)\.?[\s-]*0*(\d{0,2})")
_NUMBER = re.compile(r"0*(\d{1,3})")
_VARIABLE = re.compile(r"v\s*0*(\d{3,4})|([a-z]{2})", re.IGNORECASE)
_LONGEST = 200
_LEAD = re.compile(r"(?:\*\*|\*|V\*|NAME)\s+", re.IGNORECASE)


def _plain(text: str) -> str:
    """Fold compatibility forms (superscripts, thin spaces) and accents; keep Greek letters."""
    folded = unicodedata.normalize("NFKC", text.replace("µ", "μ"))
    stripped = "".join(c for c in unicodedata.normalize("NFD", folded) if unicodedata.category(c) not in ("Mn", "Cf"))
    return " ".join(stripped.replace("_", " ").split())


def _head_key(head: str) -> str:
    """Return the key of what stands before the constellation; ``""`` if it is no designation."""
    if found := _LETTER_INDEX.fullmatch(head):
        word, index = found.groups()
        if word.lower() in _GREEK_FORMS:
            return _GREEK_FORMS[word.lower()] + index
        if len(word) == 1 and word.isascii():
            return word + index
    if found := _NUMBER.fullmatch(head):
        return found[1]
    if found := _VARIABLE.fullmatch(head):
        return f"v{found[1]}" if found[1] else head.lower()
    return ""


def _split_sky(words: list[str]) -> tuple[str, str]:
    """Split words into head and constellation abbreviation; ``("", "")`` if they end in no constellation."""
    for count in (2, 1):
        tail = " ".join(words[-count:]).lower()
        if len(words) > count and tail in _SKY:
            return " ".join(words[:-count]), _SKY[tail]
    if len(words) == 1:  # written without a space: tauCeti, 61Cyg
        for cut in range(max(1, len(words[0]) - _LONGEST_SKY), len(words[0]) - 2):
            tail = words[0][cut:].lower()
            head = words[0][:cut]
            if tail in _SKY and (head.isdigit() or head.rstrip("0123456789").lower() in _GREEK_FORMS):
                return head, _SKY[tail]
    return "", ""


def designation_key(text: str) -> str:
    """Return the canonical key of a star name.

    Parameters
    ----------
    text : str
        A designation or proper name, as people type it.

    Returns
    -------
    str
        Canonical key; ``""`` for blank text. Names of unknown form come back in lower case with single spaces, and so
        do texts of more than 200 characters, which name no star.
    """
    if len(text) > _LONGEST:  # folding its accents and trying its forms would take the square of its length
        return " ".join(text.split()).lower()
    name = _plain(text)
    lead = _LEAD.match(name)
    if lead:
        name = name[lead.end() :]
    if (found := _CATALOGUE.fullmatch(name)) and found[1].lower() in _PREFIXES:
        return " ".join(filter(None, (_PREFIXES[found[1].lower()], found[2], found[3].lower())))
    words = name.split()
    component = ""
    head, sky = _split_sky(words)
    if not sky and len(words) > 1 and _COMPONENT.fullmatch(words[-1]):
        component = words[-1].lower()
        head, sky = _split_sky(words[:-1])
    if sky and (key := _head_key(head)):
        return " ".join(filter(None, (key, sky, component)))
    return re.sub(r"['`’]", "", name).lower()


def split_component(key: str) -> tuple[str, str]:
    """Split a canonical key into system and component letters (``"alf cen b"`` -> ``("alf cen", "b")``).

    The second part is ``""`` when the key names no component.
    """
    base, _, last = key.rpartition(" ")
    if base and last != "cae" and _COMPONENT.fullmatch(last):  # "cae" is Caelum
        return base, last
    return key, ""
