"""Find the option that was meant by a name that a command does not have: by meaning first, then by spelling."""

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

_WORDS = {
    "--limit": "top first head rows n number count lines max",
    "--top": "limit first head n number count targets rows max",
    "--out": "o output outdir output-dir output-file save write file dir directory folder",
    "--plot": "figure fig image picture png pdf svg draw",
    "--format": "csv ecsv latex tex markdown md form style",
    "--json": "js machine-readable",
    "--score": "sort order by rank-by sort-by order-by metric",
    "--stars": "star target targets name names only",
    "--exposure-s": "exptime exp-time exposure-time texp dit integration",
    "--frames": "ndit n-frames exposures n-exposures",
    "--em-gain": "gain emgain",
    "--workers": "j jobs threads cores processes procs parallel cpus n-jobs",
    "--instrument": "telescope config camera",
    "--catalog": "table input catalogue stars-file",
    "--date": "epoch when at mjd utc",
    "--v-mag-max": "mag-limit max-mag vmax limiting-magnitude faintest",
    "--v-mag": "mag vmag magnitude v",
    "--distance-pc": "parallax dist distance",
    "--planet-radius-rjup": "radius size",
    "--semi-major-axis-au": "sma a semimajor-axis",
    "--separation-arcsec": "sep rho angle",
    "--seed": "random random-seed random-state rng",
    "--realisations": "realizations trials repeats",
    "--time": "hours duration t total-time",
    "--force": "overwrite clobber",
    "--band": "filter filters wavelength",
    "--planets": "draws samples n-planets",
}
"""Names that options have in tools of the field and elsewhere, with the options that they mean here."""


def meant(name: str, command: Any, arguments: Sequence[str]) -> str:
    """Return the options that an unknown one may stand for, in words; empty if none is near.

    Parameters
    ----------
    name : str
        As it was written, with its dashes.
    command : click.Command
        The command that does not have it.
    arguments : sequence of str
        What was written, with the value of the option.
    """
    from cpic_planner.queries import SHORT_KEYS

    known = [flag for param in command.params for flag in (*param.opts, *param.secondary_opts) if flag[:2] == "--"]
    word = name.strip("-").lower().replace("_", "-")
    found = [flag for flag, words in _WORDS.items() if flag in known and word in words.split()]
    if (key := word.replace("-", "_")) in SHORT_KEYS and "--set" in known:
        after = [*arguments[arguments.index(name) + 1 :], ""] if name in arguments else [""]
        given = [text.partition("=")[2] for text in arguments if text.startswith(f"{name}=")] or after
        value = given[0] if given[0] and not given[0].startswith("-") else "x2"
        found.append(f"--set {key}={value}")
    begun = [flag for flag in known if flag.startswith(f"--{word}-")]
    near = get_close_matches(word, [flag[2:] for flag in known], n=2, cutoff=0.7)
    options = list(dict.fromkeys([*found, *begun, *(f"--{flag}" for flag in near if not found)]))[:3]
    return f"did you mean {' or '.join(options)}?" if options else ""
