"""Terms that reports explain, how intervals of surveys are read, and what to cite."""

from __future__ import annotations

GLOSSARY: tuple[tuple[str, str], ...] = (
    (
        "contrast",
        "Planet-to-star ratio of detected photon rates in the band, before mask and aperture: a property of the planet "
        "and the band.",
    ),
    (
        "contrast limit",
        "The planet-to-star ratio that would just be detected at a stated n-sigma level: a property of the "
        "observation. It is never raw contrast, which is the brightness of starlight in the dark hole relative "
        "to the unmasked peak.",
    ),
    (
        "SNR",
        "Planet signal over its photometric error, the planet's own noise included: how well the flux is measured.",
    ),
    (
        "significance",
        "Planet signal over the noise that would be there without a planet: how sure one is that there is one.",
    ),
    (
        "threshold",
        "The significance that keeps the false-alarm probability of the stated n sigma although the noise is estimated "
        "from few resolution elements (small-sample statistics). It rises where there are few.",
    ),
    (
        "margin",
        "Significance divided by threshold. Somewhat more than half of the visits show a planet of margin 1 if its "
        "place is known.",
    ),
    (
        "detected",
        "At least half of the visits show the planet at its known place, as simulated images have it. A blind search, "
        "which does not know the place, finds it less often where speckles rule: its probability is stated beside.",
    ),
    (
        "limited by",
        "The single change that would make the planet detected in the given time. Speckles: a wavefront that does not "
        "drift; background: no noise but the planet's own and the speckles; photons: neither of them is enough, the "
        "planet is too faint.",
    ),
    (
        "completeness",
        "Fraction of the planets of a stated population, drawn the same for every star, that one observation detects. "
        "Planets outside the dark quadrants or fainter than the limit at their place are missed.",
    ),
    ("score", "What the ranking is by; more is better. Its name stands above the ranking."),
    (
        "Kendall tau",
        "Agreement of two orders: 1 where all pairs of stars stand in the same order, 0 for unrelated orders, −1 for "
        "reversed ones. Equal scores are no order (tau-b).",
    ),
    (
        "speckle floor",
        "Scatter of the starlight that the subtraction leaves because the wavefront has drifted. It grows with the "
        "signal and does not average away with more frames: no length of visit detects a planet below it.",
    ),
    (
        "predicted, recovered",
        "Predicted numbers come from the analytic model; recovered ones from simulated images after the star was "
        "subtracted. A blind search decides whether the planet is found; aperture photometry at its true place gives "
        "the flux, found or not. Recovered numbers are those of one observation, averaged over the realisations.",
    ),
    (
        "realisation",
        "One made-up observation: a drift of the wavefront between and during the visits, and every noise, drawn "
        "anew. Most are drawn as sums of frames over the dark hole; the audited one is run frame by frame with every "
        "effect of the camera, calibrated, and cleaned of particles.",
    ),
    (
        "blind search",
        "A matched filter over the whole dark hole that does not know where the planet is. Its threshold holds the "
        "false-alarm probability per resolution element of the stated n sigma, and allows for the places between them.",
    ),
    (
        "optimistic, pessimistic",
        "The ETC is optimistic by predicted over recovered SNR if that is above 1, pessimistic if below, each by more "
        "than two standard errors; closer to 1 it agrees.",
    ),
    ("separation", "Angle between planet and star on the sky, projected."),
    (
        "dark hole",
        "The four square zones around the star in which starlight is suppressed; the mask's cross lies between them.",
    ),
    ("core throughput", "Light in the photometric aperture over light on the clear 2 m pupil."),
    (
        "RDI",
        "Reference differential imaging: modes of reference frames (singular vectors) are fitted to the science "
        "frames and subtracted.",
    ),
    (
        "integration, wall time",
        "Integration is frames × exposure on the planet. Wall time adds readouts, reference frames and "
        "overhead; orbit and calendar are not in it.",
    ),
    (
        "EM gain",
        "Mean amplification of the electron-multiplying register. It lowers the effective read noise and nearly "
        "doubles the photon-noise variance.",
    ),
)

"""Terms of all reports, in their order."""

WHATIF_GLOSSARY: tuple[tuple[str, str], ...] = (
    (
        "universe",
        "One drawing of chance: unknown planets around the real stars, their orbits, the places of known "
        "planets within their errors, and all noise. Every strategy is played in each.",
    ),
    (
        "planets found",
        "Planets that passed the detection rule in as many visits as it asks for, each counted once. "
        "New: drawn from the population. Known: listed in the table of known planets.",
    ),
    ("characterised", "Found, and seen in every band of the follow-up."),
    (
        "telescope time",
        "What a visit takes from the observatory: slewing, settling, exposing, reference frames, and "
        "the parts of orbits in which the star is out of sight.",
    ),
    ("wall time", "Science and reference frames with readouts; no slews, no occultations."),
    ("reserve", "Visits planned beyond the budget, made in universes in which stop rules free time."),
    (
        "distance from the bound",
        "How far the planned calendar is below a value that no calendar of the same visits can "
        "pass. A better calendar could gain at most that much.",
    ),
    ("false alarms", "Noise, or background stars, that pass the detection rule and look like planets."),
    (
        "detection law",
        "The chance that a planet is found, against its predicted significance over threshold, as "
        "measured on simulated images.",
    ),
    (
        "assumed contrast",
        "Median raw contrast of the dark hole. Brighter than the instrument's own: the mirror's "
        "actuators are off by as much, and the optics are measured with it. Darker: less of the instrument's light.",
    ),
    ("rank", "By planets found, new and known, per hour of telescope time in that strategy."),
)
"""Terms of comparisons of survey strategies, besides those of all reports."""

READING: tuple[str, ...] = (
    "The mean is taken over synthetic universes that all have the same real stars and the same known planets, with "
    "unknown planets drawn anew from the assumed population. It is what a survey gives on average.",
    "The 90 % interval of the mean tells how well so many universes pin that average down. It shrinks with more "
    "universes. It does not hold what the assumptions may get wrong: population, instrument, drift.",
    "The range of single surveys is what chance will make of the one survey that is flown: 5 % of them find fewer, 5 % "
    "more. It does not shrink with more universes.",
    "Differences are taken universe by universe: the same planets, and the same noise where two strategies make the "
    "same visit. That is why a difference can be sure although the intervals of the two means overlap. Judge two "
    "strategies by their difference, not by their intervals.",
)
"""How to read the intervals."""

METHOD_CREDITS: tuple[str, ...] = (
    "Instrument concept: CPI-C on CSST, as published by Zhu et al. (2025, RAA, arXiv:2511.09862).",
    "Small-sample detection thresholds: Mawet et al. (2014, ApJ 792, 97).",
)
"""What to cite besides the data."""


def glossary_of(*words: str) -> tuple[tuple[str, str], ...]:
    """Return some of the terms of all reports, in the order of the glossary."""
    return tuple((word, text) for word, text in GLOSSARY if word in words)
